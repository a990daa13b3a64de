"""The page's capture panel in headless Chromium: start, progress, download, trigger, cancel, and why not."""

from __future__ import annotations

import urllib.request
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from tests.browser.test_page import browser, pytestmark, text, type_over, until
from tests.conftest import RunningBench
from tests.support.recordings import read_recording

__all__ = ["browser", "pytestmark"]

CAPTURES = "/api/drives/emulated/captures"


@pytest.fixture
def page(browser: Chrome, running_bench: RunningBench) -> Iterator[Chrome]:
    """The page, freshly opened, with a streaming drive that nobody captures from."""
    browser.get(running_bench.url)
    until(browser, lambda: text(browser, "link-state") == "streaming", "the link to be streaming")
    until(browser, lambda: shown(browser, "capture-start") and not shown(browser, "capture-cancel"), "the panel")
    yield browser
    httpx.delete(f"{running_bench.url}{CAPTURES}/latest")
    browser.get("about:blank")


def shown(browser: Chrome, element_id: str) -> bool:
    return browser.find_element(By.ID, element_id).is_displayed()


def click(browser: Chrome, element_id: str) -> None:
    browser.find_element(By.ID, element_id).click()


def fill(browser: Chrome, element_id: str, content: str) -> None:
    type_over(browser.find_element(By.ID, element_id), content)


def choose(browser: Chrome, element_id: str, words: str) -> None:
    Select(browser.find_element(By.ID, element_id)).select_by_visible_text(words)


def words(browser: Chrome) -> str:
    return text(browser, "capture-words") if shown(browser, "capture-state") else ""


def test_a_capture_is_started_followed_and_downloaded(
    page: Chrome, running_bench: RunningBench, tmp_path: Path
) -> None:
    until(page, lambda: text(page, "capture-duration") == "= 1.00 s", "how long it is")
    assert not shown(page, "capture-waiting")
    fill(page, "capture-length", "12000")
    assert text(page, "capture-duration") == "= 1.20 s"
    click(page, "capture-start")
    start = page.find_element(By.ID, "capture-start")
    until(page, lambda: (  # all of it for as long as it records, which is a second
        words(page).startswith("Recording, ") and shown(page, "capture-progress") and start.get_attribute("disabled")
    ), "the recording")
    until(page, lambda: words(page).startswith("Done, 12\u202f000 of 12\u202f000 samples"), "the end")
    assert not shown(page, "capture-progress")
    link = page.find_element(By.ID, "capture-file")
    assert link.text == "Download the recording"
    (tmp_path / "got.parquet").write_bytes(urllib.request.urlopen(link.get_attribute("href") or "").read())
    assert len(read_recording(tmp_path / "got.parquet").runs[0]) == 12_000
    assert httpx.get(f"{running_bench.url}{CAPTURES}/latest").json()["request"]["trigger"] == "now"


def test_a_capture_waits_for_a_level_and_is_cancelled(page: Chrome, running_bench: RunningBench) -> None:
    choose(page, "capture-trigger", "when a signal crosses a level")
    choose(page, "capture-signal", "u_dc")
    assert text(page, "capture-unit") == "V"
    fill(page, "capture-level", "380,5")
    fill(page, "capture-pre", "25")
    click(page, "capture-start")
    until(page, lambda: words(page) == "Armed: waiting for the trigger, u_dc rising through 380.5", "it to wait")
    asked = httpx.get(f"{running_bench.url}{CAPTURES}/latest").json()["request"]
    assert asked["trigger"] == {"signal": "u_dc", "level": 380.5, "edge": "rising"}
    assert (asked["pre_trigger"], asked["timeout_s"]) == (0.25, 60.0)
    click(page, "capture-cancel")
    until(page, lambda: words(page).startswith("Cancelled (asked for at "), "the end")
    assert not shown(page, "capture-cancel")
    assert not shown(page, "capture-file")


def test_what_was_said_before_a_capture_ended_does_not_undo_its_end(page: Chrome, running_bench: RunningBench) -> None:
    fill(page, "capture-length", "500")
    click(page, "capture-start")
    until(page, lambda: words(page).startswith("Done, 500 of 500 samples"), "the end")
    late = httpx.get(f"{running_bench.url}{CAPTURES}/latest").json() | {"state": "uploading", "file": None}
    script = """const [late, done] = arguments;
        const panel = document.querySelector("script[type=module]").src.replace("main.js", "panels/capture_panel.js");
        import(panel).then(({showCapture}) => {
          showCapture(late, 1e-4, true); done(document.getElementById("capture-words").textContent);
        });"""
    assert page.execute_async_script(script, late).startswith("Done, 500 of 500 samples")  # type: ignore[no-untyped-call]


def test_a_capture_is_triggered_by_the_operator(page: Chrome) -> None:
    choose(page, "capture-trigger", "when I press Trigger now")
    fill(page, "capture-length", "500")
    click(page, "capture-start")
    until(page, lambda: words(page) == "Armed: waiting for the command to trigger", "it to wait")
    click(page, "capture-now")
    until(page, lambda: words(page).startswith("Done, 500 of 500 samples"), "the end")


def test_why_a_capture_failed_stands_in_the_panel(page: Chrome) -> None:
    choose(page, "capture-trigger", "when a signal crosses a level")
    fill(page, "capture-level", "23")
    fill(page, "capture-timeout", "0,2")
    click(page, "capture-start")
    said = "the trigger, i_q rising through 23, has not come within 0.2 s"
    until(page, lambda: text(page, "capture-message") == said, "the reason")
    assert words(page).startswith("Failed")


@pytest.mark.parametrize(
    ("samples", "said"),
    [("70000", "length: expected a whole number of 1 to 65536, got 70000"),
     ("many", "Samples: expected a number, got “many”.")],
)
def test_what_cannot_be_is_said_and_nothing_is_armed(
    page: Chrome, running_bench: RunningBench, samples: str, said: str
) -> None:
    before = httpx.get(f"{running_bench.url}{CAPTURES}").json()
    fill(page, "capture-length", samples)
    click(page, "capture-start")
    until(page, lambda: text(page, "capture-message") == said, "the refusal")
    assert httpx.get(f"{running_bench.url}{CAPTURES}").json() == before


def test_signals_are_chosen_under_more(page: Chrome, running_bench: RunningBench) -> None:
    assert not shown(page, "capture-decimation")
    page.find_element(By.CSS_SELECTOR, ".capture summary").click()
    for name in ("theta_e", "u_d", "u_q", "i_a"):
        page.find_element(By.CSS_SELECTOR, f"input[name=capture-signals][value={name}]").click()
    fill(page, "capture-decimation", "5")
    fill(page, "capture-length", "100")
    click(page, "capture-start")
    until(page, lambda: words(page).startswith("Done, 100 of 100"), "the end")
    asked = httpx.get(f"{running_bench.url}{CAPTURES}/latest").json()["request"]
    assert (asked["signals"], asked["decimation"]) == (["omega_e", "i_d", "i_q", "i_a"], 5)


def test_a_capture_that_somebody_else_asked_for_is_shown(page: Chrome, running_bench: RunningBench) -> None:
    httpx.post(f"{running_bench.url}{CAPTURES}", json={"trigger": "command"})
    until(page, lambda: words(page) == "Armed: waiting for the command to trigger", "the other's capture")
    assert page.find_element(By.ID, "capture-start").get_attribute("disabled")
