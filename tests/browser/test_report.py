"""The report in headless Chromium: every picture is drawn whole, nothing is fetched, and it prints on A4."""

from __future__ import annotations

import base64
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver import Chrome

from tests.browser.test_page import browser, forget_logs, log, pytestmark, requested
from tests.support.diagnoses import ALL, page_of

__all__ = ["browser", "pytestmark"]

WIDTHS = (420, 760, 1440)

_CUT = """
return [...document.querySelectorAll("figure")].filter(figure => {
  const body = document.body.getBoundingClientRect();
  const drawn = [...figure.querySelectorAll("svg")].map(one => [one, one.getBoundingClientRect()])
    .filter(([, box]) => box.height > 0);
  return drawn.length !== 1 || drawn[0][1].height < 80 || drawn[0][1].right > body.right + 1 ||
    [...drawn[0][0].querySelectorAll("text, path")].some(one => {
      const box = one.getBoundingClientRect(), all = drawn[0][1];
      return box.left < all.left - 1 || box.right > all.right + 1 || box.top < all.top - 1 ||
        box.bottom > all.bottom + 1;
    });
}).map(figure => figure.id)
"""

_TOGETHER = """
const found = [];
for (const figure of document.querySelectorAll("figure")) {
  const texts = [...figure.querySelectorAll("svg text")].map(text => [text.textContent, text.getBoundingClientRect()])
    .filter(([, box]) => box.height > 0);
  for (const [k, [one, a]] of texts.entries())
    for (const [other, b] of texts.slice(k + 1))
      if (a.left < b.right + 2 && b.left < a.right + 2 && a.top < b.bottom - 3 && b.top < a.bottom - 3)
        found.push(`${figure.id}: ${one} | ${other}`);
}
return found;
"""

_COLOURS = """
const of = (what, which) => getComputedStyle(document.querySelector(what))[which];
return [of("html", "backgroundColor"), of("body", "color"), of(".line.before", "stroke"), of(".q0", "fill")];
"""


@contextmanager
def opened(browser: Chrome, folder: Path, name: str) -> Generator[None]:
    """The report of a diagnosis, as a file."""
    page = folder / "report.html"
    page.write_text(page_of(ALL[name]), encoding="utf-8")
    forget_logs(browser)
    browser.get(page.as_uri())
    try:
        yield
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
        browser.get("about:blank")


def run(browser: Chrome, script: str) -> Any:
    return browser.execute_script(script)  # pyright: ignore[reportUnknownMemberType]


def looked_at(browser: Chrome, width: int) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def media(browser: Chrome, kind: str, scheme: str) -> None:
    asked = {"media": kind, "features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", asked)


@pytest.mark.parametrize("name", ALL)
def test_a_report_is_drawn_without_a_network_and_printed(browser: Chrome, tmp_path: Path, name: str) -> None:
    with opened(browser, tmp_path, name):
        for width in WIDTHS:
            looked_at(browser, width)
            assert run(browser, _CUT) == [], width
            assert run(browser, "return document.documentElement.scrollWidth <= window.innerWidth"), width
        assert requested(browser) == []
        assert log(browser, "browser") == []
        printed = base64.b64decode(browser.print_page())
        assert printed.startswith(b"%PDF")


@pytest.mark.parametrize("width", WIDTHS)
def test_no_words_of_a_picture_run_together(browser: Chrome, tmp_path: Path, width: int) -> None:
    with opened(browser, tmp_path, "explained"):
        looked_at(browser, width)
        assert run(browser, _TOGETHER) == []


def test_a_report_is_dark_where_it_is_asked_for_and_light_on_paper(browser: Chrome, tmp_path: Path) -> None:
    with opened(browser, tmp_path, "explained"):
        media(browser, "screen", "light")
        light = run(browser, _COLOURS)
        media(browser, "screen", "dark")
        dark = run(browser, _COLOURS)
        assert not set(light) & set(dark)
        media(browser, "print", "dark")
        assert run(browser, _COLOURS) == light
