"""The past of estimates on the page, in Chromium: a day of one value a second, a year of one a minute.

`python -m tests.bars.bench_history`

The catalogue of a bench is filled with both, of all four parameters, with one value far off the others in each.
Printed: how long it takes from a click on "1 d" and on "1 y" until all four plots show it, and in it that value,
thinned as it is (bar: 1 s).
"""

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from selenium.webdriver import Chrome
from sqlalchemy import text

from bench.files import catalogue_file
from bench.store.catalogue.database import opened
from tests.browser.chromium import chromium
from tests.conftest import bench_up

NAMES: Final = ("R_s", "L_d", "L_q", "psi_f")
DAY, YEAR = 86_400, 365 * 86_400
WIDE: Final = {DAY: 24, YEAR: 365}  # of the axis, in its hours and days
MOST: Final = 1.0  # s
_PATIENCE: Final = 30.0  # s
_FILL: Final = """
INSERT OR IGNORE INTO points (series, span, t, value, std, low, high, status)
WITH RECURSIVE moments(t) AS (SELECT :begin UNION ALL SELECT t + :span FROM moments WHERE t + :span < :end),
four(series) AS (VALUES (1), (2), (3), (4)),
told(t, far) AS (SELECT t, t <= :day AND :day < t + :span OR t <= :year AND :year < t + :span FROM moments)
SELECT series, :span, t, CASE WHEN far AND :span = 1 THEN 9.0 ELSE 1.0 END, 0.01, 0.99,
       CASE WHEN far THEN 9.0 ELSE 1.01 END, 1 FROM told, four
"""
_SHOWN: Final = """
const [wide, names] = arguments;
return names.every((name) => {
  const plot = document.getElementById(`plot-${name}`);
  if (!plot.data || plot.layout.xaxis.range[1] - plot.layout.xaxis.range[0] !== wide) return false;
  const all = plot.data.flatMap((trace) => Array.from(trace.y));
  const values = all.filter((value) => value !== null).sort((a, b) => a - b);
  return values.length > 2000 && values.at(-1) > 5 * values[values.length >> 1];
});
"""


def filled(now: int) -> None:
    """A day of seconds and a year of minutes and hours, in the catalogue of the one bench that has one."""
    engine = opened(str(catalogue_file()))
    with engine.begin() as connection:
        for span, begin in ((1, now - DAY), (60, now - YEAR), (3600, now - YEAR)):
            far = {"day": now - DAY // 2, "year": now - YEAR // 2}
            connection.execute(text(_FILL), {"span": span, "begin": begin, "end": now, **far})
    engine.dispose()


def opened_on(browser: Chrome, span: int) -> float:
    """Time (s) from the click on a span until all plots show it, with the value that is far off."""
    begun = time.monotonic()
    browser.execute_script("document.querySelector(`input[name=span][value='${arguments[0]}']`).click()", span)
    while not browser.execute_script(_SHOWN, WIDE[span], NAMES):
        if time.monotonic() - begun > _PATIENCE:
            return _PATIENCE
        time.sleep(0.01)
    return time.monotonic() - begun


def main() -> int:
    """0 where both are there in time."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_DATA_HOME"] = folder
        with bench_up() as bench:
            filled(int(time.time()) // 3600 * 3600)
            with chromium(Path(folder) / "profile", "window-size=1400,900") as browser:
                browser.get(bench.url)
                time.sleep(5.0)
                took: dict[int, list[float]] = {DAY: [], YEAR: []}
                for _ in range(5):
                    for span, found in took.items():
                        found.append(opened_on(browser, span))
                        browser.execute_script("document.querySelector('input[name=span][value=\"60\"]').click()")
                        time.sleep(1.0)
    missed = 0
    for words, span in (("a day, one a second", DAY), ("a year, one a minute", YEAR)):
        median, most = statistics.median(took[span]), max(took[span])
        missed += most > MOST
        print(f"{words}: {median:.2f} s, at most {most:.2f} s of {len(took[span])}, bar {MOST:g} s")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
