"""The page's rooms in headless Chromium: the whole job of an operator, from the first click to the result."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import httpx
import pytest
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver import Chrome
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select, WebDriverWait

from tests.browser.axe import violations
from tests.browser.test_page import browser, forget_logs, log, pytestmark, run, text, type_over, until
from tests.conftest import JSON, RunningBench, bench_up, command, free_port, wait_for_answer
from tests.support.relay import relayed
from tests.support.served_drive import emulator, ready, tcp_url

__all__ = ["browser", "pytestmark"]

T = TypeVar("T")
DRIVE = "/api/drives/emulated"
PATIENCE = 150.0  # s: a diagnosis beside others
FILLED = {  # of each room: whether what it asks for has come
    "live": "return document.getElementById('strips').data?.[1]?.x.length > 0",
    "recordings": "return document.getElementById('recordings-count').textContent !== ''",
    "diagnosis": "return document.getElementById('diagnoses-count').textContent !== ''",
    "drive": "return document.querySelectorAll('#signals tr').length > 0 "
             "&& document.querySelectorAll('#events li').length > 0",
}
CANVAS = "document.getElementById('recording-canvas')"
PLANE = "#recording-canvas .nsewdrag"
ROOMS = ("live", "recordings", "diagnosis", "drive")


class Operator:
    """Who uses the page by the mouse alone, and counts clicks."""

    def __init__(self, browser: Chrome) -> None:
        self._browser = browser
        self.clicks = 0

    def click(self, what: str) -> None:
        """As soon as it can be seen and pressed."""
        self._once_shown(what, WebElement.click)
        self.clicks += 1

    def sees(self, what: str) -> str:
        """Its words, as soon as it is shown."""
        return self._once_shown(what, lambda one: one.text)

    def _once_shown(self, what: str, done: Callable[[WebElement], T]) -> T:
        """Also where the page puts another element in its place meanwhile."""
        result: list[T] = []

        def tried(chrome: Chrome) -> bool:
            found = chrome.find_elements(By.CSS_SELECTOR, what)
            shown = next((one for one in found if one.is_displayed() and one.is_enabled()), None)
            if shown is not None:
                result.append(done(shown))
            return bool(result)

        waiting = WebDriverWait(self._browser, PATIENCE, 0.1, [StaleElementReferenceException])
        waiting.until(tried, f"waited for {what}")
        return result[0]


@pytest.fixture
def page(browser: Chrome, running_bench: RunningBench) -> Iterator[Chrome]:
    """The page, freshly opened, whose link streams."""
    forget_logs(browser)
    browser.get("about:blank")
    browser.get(running_bench.url)
    until(browser, lambda: text(browser, "link-state") == "streaming", "the link to be streaming")
    yield browser
    browser.get("about:blank")


def errors(browser: Chrome) -> list[str]:
    return [entry["message"] for entry in log(browser, "browser") if entry["level"] in {"SEVERE", "WARNING"}]


def room(browser: Chrome, name: str) -> None:
    browser.find_element(By.CSS_SELECTOR, f"nav [data-room={name}]").click()
    until(browser, lambda: browser.find_element(By.ID, f"room-{name}").is_displayed(), f"the room {name}")


def captured(browser: Chrome, bench: RunningBench, length: int) -> str:
    """The id of a capture that is made and then shown in Recordings."""
    with httpx.Client(base_url=bench.url) as client:
        id_ = client.post(f"{DRIVE}/captures", json={"length": length}).raise_for_status().json()["id"]
        until(browser, lambda: client.get(f"{DRIVE}/captures/{id_}").json()["state"] == "done", "a capture")
    browser.get(f"{bench.url}/#recordings/emulated/{id_}")
    until(browser, lambda: "rows as" in text(browser, "recording-thinned"), "a thinned plot")
    return id_


def drag(browser: Chrome, begin: float, end: float) -> None:
    """Over the recording's plot, from and to so much of its width."""
    plane = browser.find_element(By.CSS_SELECTOR, PLANE)
    width = float(run(browser, "return arguments[0].getBoundingClientRect().width", plane))
    move = ActionChains(browser).move_to_element_with_offset(plane, round((begin - 0.5) * width), 0).click_and_hold()
    for _ in range(2):
        move.move_by_offset(round((end - begin) * width / 2), 0)
    move.release().perform()


def test_capture_diagnosis_experiment_and_second_diagnosis_by_the_page_alone(browser: Chrome) -> None:
    """From what `make run` brings up, whose currents then no longer step: one recording of it cannot tell."""
    with bench_up() as bench:
        forget_logs(browser)
        begun = time.monotonic()
        browser.get(bench.url)
        operator = Operator(browser)
        until(browser, lambda: "powered" in text(browser, "control-state"), "a powered motor")
        operator.click("#control-start")
        until(browser, lambda: browser.find_element(By.ID, "start-i_q_step").get_attribute("value") == "3", "the form")
        for name in ("i_d_step", "i_q_step"):
            type_over(browser.find_element(By.ID, f"start-{name}"), "0")
        operator.click("#start-submit")
        until(browser, lambda: not browser.find_element(By.ID, "start-form").is_displayed(), "the set points")
        operator.click("#capture-start")
        operator.click("#capture-diagnose")
        # The latest step's end may be in it: then there is something to tell, and still not all
        assert operator.sees("#diagnosis-verdict") in ("not enough excitation", "ambiguous")
        first = operator.sees("#diagnosis-sentence")
        operator.click(".experiment-run")
        assert "The motor will move" in operator.sees("#dialog-question")
        operator.click("#dialog-yes")
        operator.click(".experiment-diagnose")
        until(browser, lambda: operator.sees("#diagnosis-sentence") != first, "the second diagnosis")
        assert operator.sees("#diagnosis-verdict") == "no mismatch"
        assert operator.clicks <= 12
        assert time.monotonic() - begun < 180.0
        assert errors(browser) == []
        operator.click(".list .beside")
        until(browser, lambda: len(browser.find_elements(By.CLASS_NAME, "verdict")) == 2, "both side by side")
        scales = """return [...document.querySelectorAll(".figure .canvas")]
            .flatMap((one) => one.layout?.coloraxis?.cmax ?? [])"""
        until(browser, lambda: len(run(browser, scales)) >= 2, "colours")
        assert len(set(run(browser, scales))) < len(run(browser, scales))
        for wide in browser.find_elements(By.CSS_SELECTOR, ".narrow .scroll"):
            assert run(browser, "return arguments[0].scrollWidth <= arguments[0].clientWidth", wide), wide.text
        operator.click(".diagnosis .close")
        until(browser, lambda: len(browser.find_elements(By.CLASS_NAME, "verdict")) == 1, "one alone")
        browser.get("about:blank")


def test_a_recording_is_diagnosed_by_the_machine_file_that_is_chosen(
    page: Chrome, running_bench: RunningBench, tmp_path: Path
) -> None:
    path = tmp_path / "other.toml"
    path.write_text("[machine]  # another one\nR_s = 1.25\nL_d = 4e-3\nL_q = 6e-3\npsi_f = 0.12\nn_p = 4\n", "utf-8")
    with httpx.Client(base_url=running_bench.url) as client:
        id_ = client.post(f"{DRIVE}/captures", json={"length": 2000}).raise_for_status().json()["id"]
        until(page, lambda: client.get(f"{DRIVE}/captures/{id_}").json()["state"] == "done", "a capture")
        room(page, "diagnosis")
        until(page, lambda: page.find_elements(By.CSS_SELECTOR, f"option[value='{id_}']"), "the recording")
        Select(page.find_element(By.ID, "diagnose-recording")).select_by_value(id_)
        page.find_element(By.ID, "diagnose-machine").send_keys(str(path))
        Operator(page).click("#diagnose-start")
        asked = f"/api/recordings/{id_}/diagnosis"
        until(page, lambda: client.get(asked).status_code == 200, "the diagnosis")
        assert client.get(asked).json()["request"]["nominal"]["machine"]["R_s"] == 1.25
        until(page, lambda: page.find_element(By.ID, "diagnose-machine").get_attribute("value") == "", "the form")
        client.delete(asked, headers=JSON)


def test_a_recording_is_made_marked_found_plotted_and_deleted(page: Chrome, running_bench: RunningBench) -> None:
    operator = Operator(page)
    type_over(page.find_element(By.ID, "record-title-text"), "warm <b>")
    assert "room for" in operator.sees("#record-room")
    operator.click("#record-start")
    until(page, lambda: "recording" in text(page, "bar-recording"), "the bar to say so")
    type_over(page.find_element(By.ID, "record-mark-text"), "load on")
    operator.click("#record-mark")
    until(page, lambda: "1 mark" in text(page, "record-words"), "the mark")
    room(page, "drive")
    assert "recording" in operator.sees("#bar-recording")  # in every room
    room(page, "live")
    operator.click("#record-stop")
    operator.click("#record-words a")
    until(page, lambda: text(page, "recording-heading") == "warm <b>", "its room")
    until(page, lambda: "load on" in text(page, "recording-marks"), "its mark")
    until(page, lambda: run(page, f"return {CANVAS}.data?.length ?? 0") >= 5, "a plot")
    assert run(page, f"return {CANVAS}.layout.shapes.length") == 1
    type_over(page.find_element(By.ID, "mark-t"), "0,25")
    type_over(page.find_element(By.ID, "mark-text"), "later")
    page.find_element(By.CSS_SELECTOR, "#mark-form button").click()
    until(page, lambda: "later" in text(page, "recording-marks"), "the second mark")
    type_over(page.find_element(By.ID, "recordings-search"), "nowhere")
    until(page, lambda: text(page, "recordings-count") == "None that fits the search.", "an empty list")
    type_over(page.find_element(By.ID, "recordings-search"), "later")
    until(page, lambda: text(page, "recordings-count") == "One recording.", "the one that has the mark")
    operator.click("#recording-delete")
    assert "warm <b>" in operator.sees("#dialog-question")
    assert "Escape stops the motor" in operator.sees(".dialog .help")
    page.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert len(httpx.get(f"{running_bench.url}/api/recordings").json()["recordings"]) >= 1
    operator.click("#recording-delete")
    operator.click("#control-stop")  # which a question does not keep from
    until(page, lambda: text(page, "control-state").startswith("off: the motor is not powered"), "the motor to be off")
    operator.click("#dialog-yes")
    until(page, lambda: text(page, "recordings-count") == "None that fits the search.", "it to be gone")
    assert errors(page) == []


def test_two_recordings_lie_over_each_other_and_zooming_asks_for_every_row(
    page: Chrome, running_bench: RunningBench
) -> None:
    with httpx.Client(base_url=running_bench.url) as client:
        for _ in range(2):
            id_ = client.post(f"{DRIVE}/captures", json={"length": 8000}).raise_for_status().json()["id"]
            until(page, lambda id_=id_: client.get(f"{DRIVE}/captures/{id_}").json()["state"] == "done", "a capture")
    room(page, "recordings")
    Operator(page).click("#recordings-list a")
    until(page, lambda: "8\u202f000 rows as" in text(page, "recording-thinned"), "a thinned plot")
    over = Select(page.find_element(By.ID, "recording-over"))
    until(page, lambda: len(over.options) > 1, "another recording")
    over.select_by_index(1)
    until(page, lambda: run(page, f"return {CANVAS}.data.length") == 10, "both")
    names = run(page, f"return {CANVAS}.data.map((one) => one.name)")
    colours = run(page, f"return {CANVAS}.data.map((one) => one.line.color)")
    assert all(re.match(r"\w+ · capture of \d\d:", name) for name in names)
    assert not set(colours[:5]) & set(colours[5:])
    run(page, "Plotly.relayout('recording-canvas', {'xaxis.range[0]': 0.1, 'xaxis.range[1]': 0.15})")
    until(page, lambda: text(page, "recording-thinned").startswith("Every row is shown."), "every row")
    Operator(page).click("#recording-all-of-it")
    until(page, lambda: "8\u202f000 rows as" in text(page, "recording-thinned"), "all of it again")
    assert errors(page) == []


def test_every_change_of_what_is_shown_of_a_recording_asks_for_it(page: Chrome, running_bench: RunningBench) -> None:
    captured(page, running_bench, 10_000)
    points = f"return {CANVAS}.data[0].x.length"
    drag(page, 0.3, 0.7)
    until(page, lambda: re.match("[34].{4} rows as", text(page, "recording-thinned")), "what it then shows")
    for most in (1000, 200):
        drag(page, 0.4, 0.6)
        until(page, lambda: text(page, "recording-thinned").startswith("Every row is shown."), "every row")
        until(page, lambda most=most: run(page, points) < most, "no others")
    ActionChains(page).double_click(page.find_element(By.CSS_SELECTOR, PLANE)).perform()
    until(page, lambda: text(page, "recording-thinned").startswith("10\u202f000 rows as"), "all of it")
    plane = page.find_element(By.CSS_SELECTOR, PLANE)
    before = run(page, "return scrollY")
    ActionChains(page).scroll_from_origin(ScrollOrigin.from_element(plane), 0, 120).perform()
    until(page, lambda: run(page, "return scrollY") > before, "the page to scroll")
    assert text(page, "recording-thinned").startswith("10\u202f000 rows as")
    assert errors(page) == []


def test_a_drive_whose_rows_are_lost_and_that_has_no_limits_says_so(browser: Chrome, tmp_path: Path) -> None:
    url, port, config = tcp_url(), free_port(), tmp_path / "bench.toml"
    config.write_text(f'[service]\nport = {port}\n[drives.spindle]\nurl = "{url}"\n', encoding="utf-8")
    with (
        emulator("--at", url, "--fault", "lose=0.04", control="lease") as drive,
        command("serve", "--config", str(config)) as process,
    ):
        ready(drive)
        wait_for_answer(f"http://127.0.0.1:{port}/api/health", process)
        browser.get(f"http://127.0.0.1:{port}/#drive")
        until(browser, lambda: text(browser, "bar-slow").startswith("Slow: "), "the rate to be too low")
        assert "warn" in (browser.find_element(By.ID, "fact-rate").get_attribute("class") or "")
        assert text(browser, "fact-rate").endswith("of 1000 Hz: too slow")
        browser.find_element(By.ID, "control-start").click()
        until(browser, lambda: "switches itself off beyond 15 A" in text(browser, "start-limits"), "the drive's own")
        browser.get("about:blank")


def test_a_file_is_brought_and_what_was_made_of_it_is_said(page: Chrome, tmp_path: Path) -> None:
    rows = "".join(f"{k * 1e-4:.4f},1,2,0.1,0.2,100\n" for k in range(500))
    good = f"t,u_d,u_q,i_d,i_q,speed\n{rows}"
    told = {"bad.csv": ("a,b\n1,2\n", "bad.csv: "), "good.csv": (good, "good.csv: 500 rows, 50 ms")}
    room(page, "recordings")
    operator = Operator(page)
    operator.click("#bring summary")
    type_over(page.find_element(By.ID, "bring-map"), "omega_e=speed")
    for name, (content, words) in told.items():
        (tmp_path / name).write_text(content, encoding="utf-8")
        page.find_element(By.ID, "bring-file").send_keys(str(tmp_path / name))
        operator.click("#bring-start")
        until(page, lambda words=words: words in text(page, "bring-message"), words)
    until(page, lambda: text(page, "recording-heading") == "good", "its room")
    until(page, lambda: text(page, "recording-thinned").startswith("Every row is shown."), "its plot")
    type_over(page.find_element(By.ID, "recording-title"), "brought")
    page.find_element(By.CSS_SELECTOR, "#annotation-form button").click()
    until(page, lambda: text(page, "recording-message") == "Saved.", "the title")


def test_a_setting_is_written_within_its_limits(page: Chrome, running_bench: RunningBench) -> None:
    room(page, "drive")
    type_over(page.find_element(By.ID, "signals-filter"), "bandwidth")
    operator = Operator(page)
    for value, told in (("1", "takes at least 10.0 rad/s"), ("1300", "bandwidth was written.")):
        if value == "1":
            operator.click("#signals .edit")
        type_over(page.find_element(By.CSS_SELECTOR, "#signals .entry input"), value)
        operator.click("#signals .entry .primary")
        until(page, lambda told=told: told in text(page, "signals-message"), told)
    assert "1300 rad/s" in text(page, "signals")
    signals = f"{running_bench.url}{DRIVE}/signals"
    assert httpx.get(signals, params={"names": "bandwidth"}).json()["signals"][0]["value"] == 1300.0
    httpx.put(signals, json={"bandwidth": 1250.0}).raise_for_status()
    type_over(page.find_element(By.ID, "signals-filter"), "layout_id")
    assert re.search(r"0x[0-9A-F]{8}\b", text(page, "signals"))
    type_over(page.find_element(By.ID, "signals-filter"), "capture_length")
    assert page.find_elements(By.CSS_SELECTOR, "#signals .edit") == []


def test_signals_that_changed_since_the_last_look_are_told(page: Chrome, running_bench: RunningBench) -> None:
    run(page, "localStorage.clear()")
    room(page, "drive")
    until(page, lambda: "bandwidth" in text(page, "signals"), "the signals")
    assert "1250 rad/s" in text(page, "signals")
    room(page, "live")
    httpx.put(f"{running_bench.url}{DRIVE}/signals", json={"bandwidth": 1300.0}).raise_for_status()
    room(page, "drive")
    until(page, lambda: "was 1250 rad/s" in text(page, "signals"), "the change")
    until(page, lambda: "bandwidth" in text(page, "events"), "who wrote it")
    httpx.put(f"{running_bench.url}{DRIVE}/signals", json={"bandwidth": 1250.0}).raise_for_status()
    assert errors(page) == []


def test_strips_and_dq_plane_show_the_last_seconds_and_can_be_held(page: Chrome) -> None:
    points = "return document.getElementById('strips').data?.[1]?.x.length ?? 0"
    until(page, lambda: run(page, points) > 100, "strips")
    label = page.find_element(By.ID, "vector").get_attribute("aria-label") or ""
    assert "current" in label
    assert "along q" in label
    page.find_element(By.ID, "strips-hold").click()
    newest = "return document.getElementById('strips').data[1].y.at(-1)"
    held = run(page, newest)
    begun = time.monotonic()
    while time.monotonic() - begun < 2.0:  # eight times that they would have been drawn
        assert run(page, newest) == held
    page.find_element(By.ID, "strips-hold").click()
    until(page, lambda: run(page, newest) != held, "them to go on")


def test_how_far_set_points_may_go_is_said_while_they_are_typed(page: Chrome) -> None:
    page.find_element(By.ID, "control-start").click()
    until(page, lambda: "Currents go up to 6 A" in text(page, "start-limits"), "the limit")
    for name, value in (("i_d_ref", "0"), ("i_d_step", "0"), ("i_q_step", "0"), ("i_q_ref", "7")):
        type_over(page.find_element(By.ID, f"start-{name}"), value)
    until(page, lambda: "to 7 A, too far" in text(page, "start-limits"), "that it is too far")


def test_rooms_are_reached_by_keyboard_and_the_browser_leads_back(page: Chrome) -> None:
    for name in ROOMS[1:]:
        page.find_element(By.CSS_SELECTOR, f"nav [data-room={name}]").send_keys(Keys.ENTER)
        until(page, lambda name=name: page.find_element(By.ID, f"room-{name}").is_displayed(), name)
    page.back()
    until(page, lambda: page.find_element(By.ID, "room-diagnosis").is_displayed(), "the room before")
    page.refresh()
    until(page, lambda: page.find_element(By.ID, "room-diagnosis").is_displayed(), "the same room")
    assert page.find_element(By.ID, "control-stop").is_displayed()


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [420, 1400])
def test_every_room_fits_and_keeps_the_rules_of_accessibility(page: Chrome, width: int, theme: str) -> None:
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    page.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": theme}]}
    )
    found: dict[str, Any] = {}
    for name in ROOMS:
        room(page, name)
        until(page, lambda name=name: run(page, FILLED[name]), f"what {name} asks for")
        if told := violations(page):
            found[name] = told
        if (wide := run(page, "return document.documentElement.scrollWidth")) > width:
            found[f"{name} is wide"] = wide
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert found == {}


def test_a_lost_service_is_told_within_two_seconds(browser: Chrome, running_bench: RunningBench) -> None:
    with relayed(urlsplit(running_bench.url).port or 80) as wire:
        browser.get(f"http://127.0.0.1:{wire.port}/#drive")
        until(browser, lambda: text(browser, "link-state") == "streaming", "the link to be streaming")
        wire.cut()
        lost = time.monotonic()
        until(browser, lambda: "Connection to the service lost" in text(browser, "banner"), "the banner")
        assert time.monotonic() - lost < 2.5  # 2 s, and this test's looks
        wire.mend()
        until(browser, lambda: not browser.find_element(By.ID, "banner").is_displayed(), "the banner to go")
        browser.get("about:blank")
