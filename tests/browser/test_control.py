"""The page's bar for the drive in headless Chromium: its state in words, Stop by mouse and key, Start, Reset."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.browser.test_capture import click, fill, shown
from tests.browser.test_page import SANE, browser, content, pytestmark, run, text, tile, until
from tests.conftest import JSON, RunningBench
from tests.support.relay import relayed
from tests.support.served_drive import until as wait_until

__all__ = ["browser", "pytestmark"]

DRIVE = "/api/drives/emulated"
ON = "on: the motor is powered (operation enabled)"
OFF = "off: the motor is not powered (switch on disabled)"
SET_POINTS = {"i_d_ref": 0.0, "i_q_ref": 2.0, "i_d_step": 0.5, "i_q_step": 0.5}


def control(bench: RunningBench) -> dict[str, Any]:
    return httpx.get(f"{bench.url}{DRIVE}").json()["control"]


def set_points(bench: RunningBench) -> dict[str, float]:
    told = httpx.get(f"{bench.url}{DRIVE}/signals", params={"names": ",".join(SET_POINTS)}).json()["signals"]
    return {signal["name"]: signal["value"] for signal in told}


@pytest.fixture
def page(browser: Chrome, running_bench: RunningBench) -> Iterator[Chrome]:
    """The page, freshly opened, of a drive that runs under this service's control."""
    httpx.post(f"{running_bench.url}{DRIVE}/start", json=SET_POINTS).raise_for_status()
    browser.get(running_bench.url)
    until(browser, lambda: text(browser, "control-state") == ON, "a powered motor")
    yield browser
    browser.get("about:blank")


@pytest.mark.parametrize("by", ["mouse", "key"])
def test_stop_switches_the_drive_off_and_nothing_is_shown_as_measured_now(
    page: Chrome, running_bench: RunningBench, by: str
) -> None:
    until(page, lambda: all(tile(page, name).get_attribute("data-status") == "ok" for name in SANE), "estimates")
    if by == "mouse":
        click(page, "control-stop")
    else:
        page.find_element(By.TAG_NAME, "body").send_keys(Keys.ESCAPE)
    wait_until(lambda: control(running_bench)["state"] == "switch on disabled", "the drive to be off")
    off = time.monotonic()
    until(page, lambda: all(tile(page, name).get_attribute("data-status") == "stale" for name in SANE), "stale tiles")
    assert time.monotonic() - off < 2.0  # of which the page's own way, and this test's looks, are a part
    assert text(page, "control-state") == OFF
    assert re.fullmatch(r"Stopped at \d\d:\d\d:\d\d: the motor is not powered", text(page, "control-answer"))
    assert text(page, "set-points") == ""
    assert set(set_points(running_bench).values()) == {0.0}


def test_a_drive_that_is_off_is_started_with_set_points(page: Chrome, running_bench: RunningBench) -> None:
    click(page, "control-stop")
    until(page, lambda: text(page, "control-state") == OFF, "the drive to be off")
    click(page, "control-start")
    until(page, lambda: shown(page, "start-form"), "the form")
    fill(page, "start-i_q_ref", "1.5")
    click(page, "start-submit")
    until(page, lambda: text(page, "control-state") == ON, "a powered motor")
    assert not shown(page, "start-form")
    assert set_points(running_bench)["i_q_ref"] == pytest.approx(1.5, abs=1e-3)
    assert (control(running_bench)["whom"], control(running_bench)["in_experiment"]) == ("127.0.0.1", False)


def test_set_points_of_a_running_drive_stand_in_the_form_and_can_be_changed(
    page: Chrome, running_bench: RunningBench
) -> None:
    click(page, "control-start")
    until(page, lambda: page.find_element(By.ID, "start-i_q_ref").get_attribute("value") == "2", "the present value")
    assert page.find_element(By.ID, "start-i_d_step").get_attribute("value") == "0.5"
    assert text(page, "start-submit") == "Apply set points"
    fill(page, "start-i_q_ref", "2.5")
    click(page, "start-submit")
    until(page, lambda: not shown(page, "start-form"), "the form to go")
    until(page, lambda: text(page, "control-answer").startswith("Set points applied at "), "that they were applied")
    assert text(page, "set-points").startswith("Set points: i_d 0 A, i_q 2.5 A, steps of i_d ± 0.5 A and i_q ± 0.5 A")
    assert set_points(running_bench) == pytest.approx(SET_POINTS | {"i_q_ref": 2.5}, abs=1e-3)


def test_a_set_point_beyond_the_machine_is_refused_in_a_sentence(page: Chrome, running_bench: RunningBench) -> None:
    before = set_points(running_bench)
    click(page, "control-start")
    fill(page, "start-i_q_ref", "900")
    click(page, "start-submit")
    until(page, lambda: text(page, "control-answer").startswith("Set points: "), "the refusal")
    assert "900" in text(page, "control-answer")
    assert shown(page, "start-form")
    assert set_points(running_bench) == before


def test_a_fault_is_named_with_what_to_do_and_reset(page: Chrome, running_bench: RunningBench) -> None:
    signals = f"{running_bench.url}{DRIVE}/signals"
    (trip,) = httpx.get(signals, params={"names": "overspeed_trip"}).json()["signals"]
    click(page, "control-start")
    until(page, lambda: page.find_element(By.ID, "start-i_q_ref").get_attribute("value") == "2", "the form")
    click(page, "start-submit")
    until(page, lambda: text(page, "control-answer").startswith("Set points applied at "), "an answer")
    click(page, "control-start")
    httpx.put(signals, json={"overspeed_trip": 1.0}, headers=JSON).raise_for_status()
    until(page, lambda: text(page, "control-state") == "fault: the motor is not powered", "the fault")
    until(page, lambda: "(0x8481): " in text(page, "control-fault"), "its name")
    assert text(page, "control-answer") == ""  # what was said before it is over
    assert not page.find_element(By.ID, "start-submit").is_enabled()
    assert text(page, "control-fault").startswith("overspeed (0x8481): ")
    httpx.put(signals, json={"overspeed_trip": trip["value"]}, headers=JSON).raise_for_status()
    until(page, lambda: shown(page, "control-reset"), "Reset")
    click(page, "control-reset")
    until(page, lambda: text(page, "control-state") == OFF, "the drive to be off, without a fault")
    assert not shown(page, "control-reset")


def test_stop_that_is_not_heard_says_so_and_what_to_do(page: Chrome, running_bench: RunningBench) -> None:
    with relayed(urlsplit(running_bench.url).port or 80) as wire:
        page.get(f"http://127.0.0.1:{wire.port}/")
        until(page, lambda: text(page, "control-state") == ON, "a powered motor")
        wire.cut()
        until(page, lambda: "not heard" in text(page, "control-state"), "the bar to say that nothing is known")
        assert page.find_element(By.ID, "control-stop").is_enabled()
        click(page, "control-stop")
        until(page, lambda: "use its emergency stop" in text(page, "control-answer"), "what to do")
        assert "Whether it was taken is not known" in text(page, "control-answer")
        wire.mend()
        until(page, lambda: "press Stop again" in text(page, "control-answer"), "that it was not taken")
        assert not shown(page, "banner")
        click(page, "control-stop")
        until(page, lambda: text(page, "control-state") == OFF, "the drive to be off")
        until(page, lambda: text(page, "control-answer").startswith("Stopped at "), "that it has stopped")


def test_a_stop_that_was_not_heard_is_over_once_the_motor_is_off(page: Chrome, running_bench: RunningBench) -> None:
    with relayed(urlsplit(running_bench.url).port or 80) as wire:
        page.get(f"http://127.0.0.1:{wire.port}/")
        until(page, lambda: text(page, "control-state") == ON, "a powered motor")
        wire.cut()
        until(page, lambda: "not heard" in text(page, "control-state"), "the bar to say that nothing is known")
        click(page, "control-stop")
        until(page, lambda: "is not known" in text(page, "control-answer"), "that no answer came")
        httpx.post(f"{running_bench.url}{DRIVE}/stop", headers=JSON).raise_for_status()
        wire.mend()
        until(page, lambda: text(page, "control-state") == OFF, "the drive to be off")
        until(page, lambda: text(page, "control-answer") == "", "the alarm to go")


@pytest.mark.parametrize("width", [420, 1400])
def test_stop_and_the_rooms_stand_where_they_stood_whatever_the_bar_says(
    page: Chrome, running_bench: RunningBench, width: int
) -> None:
    places = """return [document.getElementById("control-stop"), ...document.querySelectorAll("nav a")]
        .map((one) => { const { x, y } = one.getBoundingClientRect(); return `${Math.round(x)} ${Math.round(y)}`; })"""
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    with relayed(urlsplit(running_bench.url).port or 80) as wire:
        page.get(f"http://127.0.0.1:{wire.port}/")
        page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        until(page, lambda: content(page, "set-points") != "", "set points")
        before = run(page, places)
        assert run(page, "return document.getElementById('control-bar').offsetHeight") < 160
        click(page, "control-start")
        assert run(page, places) == before
        click(page, "start-close")
        assert not shown(page, "start-form")
        click(page, "control-stop")
        until(page, lambda: text(page, "control-state") == OFF, "the drive to be off")
        assert run(page, places) == before
        wire.cut()
        until(page, lambda: shown(page, "banner"), "the banner")
        assert run(page, places) == before
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
