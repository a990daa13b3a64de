"""The report in headless Chromium: every picture is drawn whole, nothing is fetched, and it prints on A4."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest
from selenium.webdriver import Chrome

from bench.report import report
from tests.diagnoses import ALL, NOMINAL, RECORDING
from tests.test_browser_page import browser, forget_logs, log, pytestmark, requested, until

__all__ = ["browser", "pytestmark"]

_CUT = """
return [...document.querySelectorAll("figure > div")].filter(place => {
  const drawn = place.querySelector(".main-svg"), body = document.body.getBoundingClientRect();
  const box = place.getBoundingClientRect();
  return !drawn || drawn.getBoundingClientRect().height < 80 || box.right > body.right + 1;
}).map(place => place.id)
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
