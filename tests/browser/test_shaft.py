"""The shaft's panel in headless Chromium: what is told with intervals, and the sentence where nothing can be."""

from __future__ import annotations

import re
from pathlib import Path

from selenium.webdriver import Chrome

from emulator.scenario.text import text_of
from tests.browser.test_page import Bench, browser, forget_logs, log, page, pytestmark, text, until
from tests.conftest import bench_up
from tests.estimator.mechanics import shafts

__all__ = ["browser", "page", "pytestmark"]


def test_of_a_shaft_on_a_dynamometer_the_panel_says_that_nothing_can_be_told(
    page: Chrome, running_bench: Bench
) -> None:
    until(page, lambda: "does not accelerate" in text(page, "shaft-sentence"), "the sentence")
    assert {text(page, f"shaft-{name}") for name in ("J", "B", "T_C", "tau_L")} == {"—"}


def test_a_shaft_that_swings_is_shown_with_its_intervals(browser: Chrome, tmp_path: Path) -> None:
    scenario = tmp_path / "swings.toml"
    scenario.write_text(text_of(shafts.shaft(counts=65536)), encoding="utf-8")
    with bench_up("--scenario", str(scenario)) as bench:
        forget_logs(browser)
        browser.get(bench.url)
        until(browser, lambda: "±" in text(browser, "shaft-T_C"), "friction and load to be told apart")
        assert re.fullmatch(r"[78]\.\d+ ± 0\.\d+ kg cm²", text(browser, "shaft-J"))
        assert re.fullmatch(r"[\d.\u202f]+ ± [\d.]+ [mµ]Nm s/rad", text(browser, "shaft-B"))
        for name in ("T_C", "tau_L"):
            assert re.fullmatch(r"[\d.]+ ± [\d.]+ mNm", text(browser, f"shaft-{name}"))
        fits = "return document.documentElement.scrollWidth <= window.innerWidth"
        for width in (400, 1440):
            browser.set_window_size(width, 1000)
            until(browser, lambda: browser.execute_script(fits), "the page to hold it")
            assert browser.save_screenshot(str(tmp_path / f"shaft{width}.png"))
        assert log(browser, "browser") == []
        browser.get("about:blank")
