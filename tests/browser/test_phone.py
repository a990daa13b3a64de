"""The page at a phone's width in headless Chromium: what has to be in sight is, and takes little of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import httpx
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from emulator.scenario.scenarios import PAPER
from emulator.scenario.text import text_of
from tests.browser.axe import violations
from tests.browser.test_commissioning import served
from tests.browser.test_page import browser, pytestmark, run, text, until
from tests.conftest import JSON

__all__ = ["browser", "pytestmark"]

HIGHEST = 140  # px
LINE = 17  # px
WIDTH = 420
IN_SIGHT = (
    "control-stop", "control-state", "control-holder", "control-sto", "control-start", "drive-select", "link-state",
    "bar-speed", "fact-age",
)  # fmt: skip
SEEN = """return arguments[0].map((id) => {
    const one = document.getElementById(id), { left, top, right, bottom } = one.getBoundingClientRect();
    const there = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    return one.contains(there) && left >= 0 && right <= innerWidth && top >= 0 ? "" : id;
}).filter((id) => id !== "")"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a drive with an input that takes its torque off."""
    folder = tmp_path_factory.mktemp("bench")
    drive = replace(PAPER.drive, safe_torque_off="inactive")
    (folder / "guarded.toml").write_text(text_of(replace(PAPER, name="guarded", drive=drive)), encoding="utf-8")
    with served(folder, "--scenario", str(folder / "guarded.toml")) as one:
        yield one


@pytest.fixture
def page(browser: Chrome, root: str) -> Iterator[Chrome]:
    """The live room of a drive that is on."""
    metrics = {"width": WIDTH, "height": 800, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get(f"{root}/#live/spindle")
    until(browser, lambda: text(browser, "link-state") == "streaming", "the link to be streaming")
    for what in ("stop", "start"):
        httpx.post(f"{root}/api/drives/spindle/{what}", json={}, headers=JSON, timeout=10.0).raise_for_status()
    until(browser, lambda: text(browser, "control-state").startswith("on: "), "a powered motor")
    yield browser
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.get("about:blank")


def height(page: Chrome) -> int:
    return run(page, "return document.getElementById('control-bar').offsetHeight")


def test_the_bar_is_low_and_all_that_has_to_be_in_sight_is(page: Chrome) -> None:
    until(page, lambda: text(page, "control-sto") == "STO: torque allowed", "what the drive's input says")
    assert height(page) <= HIGHEST
    for said, most in (("", HIGHEST), ("Stopped at ", HIGHEST + 2 * LINE)):  # and by whom control was ended
        until(page, lambda said=said: text(page, "control-answer").startswith(said), said)
        assert violations(page) == []
        for scrolled in ("0", "document.body.scrollHeight"):
            run(page, f"window.scrollTo(0, {scrolled})")
            assert run(page, SEEN, IN_SIGHT) == []
        assert height(page) <= most
        page.find_element(By.ID, "control-stop").click()


def test_an_alarm_has_its_place_below_and_hides_nothing(page: Chrome, root: str) -> None:
    signals = f"{root}/api/drives/spindle/signals"
    (trip,) = httpx.get(signals, params={"names": "overspeed_trip"}).json()["signals"]
    httpx.put(signals, json={"overspeed_trip": 1.0}, headers=JSON).raise_for_status()
    until(page, lambda: "overspeed (0x8481): " in text(page, "control-fault"), "the fault")
    assert run(page, SEEN, [*IN_SIGHT, "control-fault", "control-reset"]) == []
    httpx.put(signals, json={"overspeed_trip": trip["value"]}, headers=JSON).raise_for_status()
    page.find_element(By.ID, "control-reset").click()
    until(page, lambda: text(page, "control-state").startswith("off: "), "the drive to be off")


def test_all_in_the_bar_is_reached_by_keyboard_and_another_drive_chosen(page: Chrome) -> None:
    reached = list[str]()
    run(page, "document.getElementById('control-stop').focus()")
    for _ in range(7):
        focused = page.switch_to.active_element
        reached.append(focused.get_attribute("id") or focused.get_attribute("data-room") or "")
        focused.send_keys(Keys.TAB)
    assert reached == ["control-stop", "drive-select", "control-start", "live", "recordings", "diagnosis", "drive"]
    page.find_element(By.CSS_SELECTOR, "#drive-select option[value=feed]").click()
    until(page, lambda: text(page, "control-state") == "no link to the drive", "the other drive")
    assert run(page, SEEN, ["control-stop", "control-state", "drive-select", "link-state"]) == []
