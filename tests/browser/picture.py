"""`python -m tests.browser.picture [REPORT.html]`: the README's pictures; Debian: chromium, chromium-driver.

Of the page, with an emulated drive that turns, where all four parameters are told and their plots have run for a while;
or of the report that is named.
"""

import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from tests.browser.chromium import chromium
from tests.conftest import bench_up

FILE: Final = Path(".readme") / "page.png"
SIZE: Final = (1400, 900)  # px
REPORT: Final = Path(".readme") / "report.png"
REPORT_SIZE: Final = (760, 1500)
SETTLED: Final = 60.0  # s of plots
PATIENCE: Final = 60.0  # s
_TOLD: Final = '.tile[data-status="ok"]'


def page_taken(file: Path = FILE) -> None:
    """Write the picture of the page."""
    with bench_up() as bench, opened(bench.url, SIZE) as chrome:
        WebDriverWait(chrome, PATIENCE).until(lambda page: len(page.find_elements(By.CSS_SELECTOR, _TOLD)) == 4)
        time.sleep(SETTLED)
        chrome.save_screenshot(str(file))


def report_taken(report: Path, file: Path = REPORT) -> None:
    """Write the picture of a report's beginning."""
    with opened(report.absolute().as_uri(), REPORT_SIZE) as chrome:
        chrome.save_screenshot(str(file))


@contextmanager
def opened(address: str, size: tuple[int, int]) -> Generator[Chrome]:
    """A page in a window of that size."""
    metrics = dict(zip(("width", "height"), size, strict=True)) | {"deviceScaleFactor": 1, "mobile": False}
    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile), "hide-scrollbars") as chrome:
        chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        chrome.get(address)
        yield chrome


if __name__ == "__main__":
    if len(sys.argv) > 1:
        report_taken(Path(sys.argv[1]))
    else:
        page_taken()
