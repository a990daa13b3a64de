"""The report in headless Chromium: every picture is drawn whole, nothing is fetched, and it prints on A4."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest
from selenium.webdriver import Chrome

from bench.diagnoses.report import report
from tests.browser.test_page import browser, forget_logs, log, pytestmark, requested, until
from tests.support.diagnoses import ALL, NOMINAL, RECORDING

__all__ = ["browser", "pytestmark"]

_CUT = """
return [...document.querySelectorAll("figure > div")].filter(place => {
  const drawn = place.querySelector(".main-svg"), body = document.body.getBoundingClientRect();
  const box = place.getBoundingClientRect();
  return !drawn || drawn.getBoundingClientRect().height < 80 || box.right > body.right + 1;
}).map(place => place.id)
"""

_TOGETHER = """
const found = [];
const look = (figure, gap, ...places) => {
  const texts = [...figure.querySelectorAll(places.map(place => `${place} text`).join())]
    .filter(text => text.textContent.trim()).map(text => [text.textContent, text.getBoundingClientRect()]);
  for (const [k, [one, a]] of texts.entries())
    for (const [other, b] of texts.slice(k + 1))
      if (a.left < b.right + gap && b.left < a.right + gap && a.top < b.bottom - 2 && b.top < a.bottom - 2)
        found.push(`${figure.id}: ${one} | ${other}`);
};
for (const figure of document.querySelectorAll("figure > div")) {
  look(figure, 8, ".xtick", ".x2tick");
  look(figure, 8, ".g-xtitle", ".g-x2title");
  look(figure, 1, ".ytick", ".g-ytitle", ".xtick", ".g-xtitle");
}
return found;
"""


@pytest.mark.parametrize("name", ALL)
def test_a_report_is_drawn_without_a_network_and_printed(browser: Chrome, tmp_path: Path, name: str) -> None:
    page = tmp_path / "report.html"
    page.write_text(report(ALL[name], RECORDING, NOMINAL), encoding="utf-8")
    forget_logs(browser)
    browser.get(page.as_uri())
    until(browser, lambda: browser.execute_script(_CUT) == [], "all pictures")
    assert requested(browser) == []
    assert log(browser, "browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    printed = base64.b64decode(browser.print_page())
    assert printed.startswith(b"%PDF")
    browser.get("about:blank")


def test_no_words_of_a_picture_run_together(browser: Chrome, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    page.write_text(report(ALL["explained"], RECORDING, NOMINAL), encoding="utf-8")
    browser.get(page.as_uri())
    until(browser, lambda: browser.execute_script(_CUT) == [], "all pictures")
    assert browser.execute_script(_TOGETHER) == []
    browser.get("about:blank")
