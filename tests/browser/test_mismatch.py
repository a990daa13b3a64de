"""The page in headless Chromium over a drive with dead time: it says plainly that the model does not explain it."""

from __future__ import annotations

import re
from pathlib import Path

from selenium.webdriver import Chrome

from emulator.scenario.text import text_of
from tests.bench.live.test_watch import DEAD_TIME
from tests.browser.test_page import Bench, browser, forget_logs, log, page, pytestmark, text, until
from tests.conftest import bench_up

__all__ = ["browser", "page", "pytestmark"]

_SEEN = "return getComputedStyle(document.getElementById('mismatch')).display !== 'none'"


def test_nothing_is_said_of_a_drive_that_the_model_explains(page: Chrome, running_bench: Bench) -> None:
    status = "return document.getElementById('mismatch').dataset.status"
    until(page, lambda: page.execute_script(status) == "explained", "the drive to be explained")
    assert text(page, "mismatch") == ""
    assert not page.execute_script(_SEEN)


def test_an_operator_sees_since_when_and_where_the_model_does_not_explain_the_drive(
    browser: Chrome, tmp_path: Path
) -> None:
    scenario = tmp_path / "dead_time.toml"
    scenario.write_text(text_of(DEAD_TIME), encoding="utf-8")
    with bench_up("--scenario", str(scenario)) as bench:
        forget_logs(browser)
        browser.get(bench.url)
        until(browser, lambda: text(browser, "mismatch") != "", "the mismatch to be told")
        assert re.fullmatch(
            r"The model has not explained the drive since \d\d:\d\d:\d\d, [\d.]+ V rms above noise: "
            r"(mostly on [dq]|on both axes).*\. Record a capture and diagnose it\.",
            text(browser, "mismatch"),
        )
        assert browser.execute_script(_SEEN)
        browser.set_window_size(400, 900)
        fits = "return document.documentElement.scrollWidth <= window.innerWidth"
        until(browser, lambda: browser.execute_script(fits), "a narrow page to hold it")
        browser.set_window_size(1440, 1000)
        assert browser.save_screenshot(str(tmp_path / "mismatch.png"))
        assert log(browser, "browser") == []
        browser.get("about:blank")
