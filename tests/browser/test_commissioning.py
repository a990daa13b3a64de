"""The page's commissionings in headless Chromium: asked for, watched, stopped, and what came of one flashed."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from bench.parameters.parameter_set import as_toml, set_of
from emulator.scenario.text import text_of
from tests.bench.commissioning.unknown import unknown
from tests.browser.axe import violations
from tests.browser.test_page import browser, forget_logs, pytestmark, run, text, type_over, until
from tests.browser.test_rooms import Operator, errors
from tests.conftest import JSON, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url

__all__ = ["browser", "pytestmark"]

DRIVE = "/api/drives/spindle"
KEPT = "spindle-identify-20260131-120000-000"
FIRST = "spindle-first-start-20260131-120000-000"
HELD = """const send = window.fetch;
window.fetch = async (address, options) => {
  const answer = await send(address, options);
  if (options.method === "POST") await new Promise((go_on) => { window.goOn = go_on; });
  return answer;
};"""  # answers to what is asked for, until goOn() is called
FAILING = """const send = window.fetch;
window.failed = 0;
window.fetch = (address, options) => address.includes("/commissionings/") && window.failed++ < 2
  ? Promise.reject(new TypeError("broken")) : send(address, options);"""  # the first two looks at a commissioning
GONE = "Not known: the service does not answer"
ENDED = "Failed: the service ended in the middle of it; the drive stops by itself."
SENTENCE = "No mismatch: nothing beyond noise is left."
RESULT: dict[str, Any] = {
    "machine": None, "shaft": None, "acceleration": 1.0, "loops": [], "responses": {},
    "diagnosis": {"verdict": "no_mismatch", "sentence": SENTENCE, "findings": []}, "recordings": [],
    "set": as_toml(set_of({"bandwidth": 900.0}, "spindle 2026-01-31", "commissioning")),
    "remarks": ["the shaft tells no inertia"],
}  # fmt: skip


@contextmanager
def drives(folder: Path, *scenario: str) -> Generator[str]:
    """An emulated drive and one that is not there, for a service that is to be begun; where that will answer."""
    port, url = free_port(), tcp_url()
    (folder / "bench.toml").write_text(
        f'[service]\nport = {port}\ncaptures = "c"\nlog = "log"\njournals = "j"\ndatabase = "c.sqlite"\n'
        f'[drives.spindle]\nurl = "{url}"\n[drives.spindle.limits]\ni_max = 6.0\nspeed_max_rpm = 1500.0\n'
        f'[drives.feed]\nurl = "{tcp_url()}"\n', encoding="utf-8",
    )  # fmt: skip
    with emulator("--at", url, *scenario, control="lease") as process:
        ready(process)
        yield f"http://127.0.0.1:{port}"


@contextmanager
def service(folder: Path, root: str) -> Generator[subprocess.Popen[str]]:
    """Over the drives of that folder."""
    with command("serve", "--config", str(folder / "bench.toml")) as process:
        wait_for_answer(f"{root}/api/health", process)
        yield process


@contextmanager
def served(folder: Path, *scenario: str) -> Generator[str]:
    """A service over an emulated drive and one that is not there; where it answers."""
    with drives(folder, *scenario) as root, service(folder, root):
        yield root


def kept(folder: Path, id_: str, kind: str, result: dict[str, Any]) -> None:
    """A commissioning that is done, of a service before."""
    (folder / "unknown.toml").write_text(text_of(unknown()), encoding="utf-8")
    (folder / "c" / "commissionings").mkdir(parents=True)
    (folder / "c" / "commissionings" / f"{id_}.json").write_text(json.dumps({
        "id": id_, "drive": "spindle", "asked": "2026-01-31T12:00:00+00:00", "request": {"kind": kind},
        "state": "done", "phase": "", "reason": "", "result": result,
        "steps": [{"at": "2026-01-31T12:00:01+00:00", "said": "diagnosing"}],
    }), encoding="utf-8")  # fmt: skip


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a motor that nobody knows, which a service before this one has identified."""
    folder = tmp_path_factory.mktemp("bench")
    kept(folder, KEPT, "identify", RESULT)
    with served(folder, "--scenario", str(folder / "unknown.toml")) as one:
        yield one


@pytest.fixture
def page(browser: Chrome, root: str) -> Iterator[Chrome]:
    """The drive's room."""
    enter(browser, root)
    yield browser
    browser.get("about:blank")


def enter(browser: Chrome, root: str) -> None:
    forget_logs(browser)
    browser.get("about:blank")
    browser.get(f"{root}/#drive/spindle")
    until(browser, lambda: "values, read" in text(browser, "parameters-looked"), "the parameters")


def test_what_came_of_one_is_told_with_its_report_and_its_set_is_planned_and_flashed(page: Chrome, root: str) -> None:
    operator = Operator(page)
    assert operator.sees("#commissioning-verdict") == SENTENCE
    assert text(page, "commissioning-title").startswith("Identification, asked for 2026-01-31 ")
    assert text(page, "commissioning-steps").endswith("diagnosing")
    assert "the shaft tells no inertia" in text(page, "commissioning")
    assert not page.find_element(By.ID, "commissioning-stop").is_displayed()
    report = page.find_element(By.ID, "commissioning-report").get_attribute("href") or ""
    assert SENTENCE in httpx.get(report).raise_for_status().text
    href = page.find_element(By.ID, "commissioning-set").get_attribute("href") or ""
    assert href.startswith("data:application/toml")
    assert violations(page) == []
    operator.click("#commissioning-plan")
    until(page, lambda: "1 value changes" in text(page, "plan"), "the plan")
    operator.click("#flash-start")
    assert operator.sees("#dialog-question").startswith("Flash the set of 2026-01-31 ")
    operator.click("#dialog-yes")
    until(page, lambda: "“spindle 2026-01-31” flashed" in text(page, "flash-verdict"), "the verdict")
    told = httpx.get(f"{root}{DRIVE}/parameters/set", timeout=10.0).raise_for_status().json()
    assert told["entries"]["bandwidth"]["value"] == 900.0
    assert errors(page) == []


def test_one_is_asked_for_by_name_watched_and_stopped(page: Chrome, root: str) -> None:
    operator = Operator(page)
    until(page, lambda: text(page, "commissioning-why") == "", "the drive to be free")
    operator.click("#commissioning-plan")
    until(page, lambda: text(page, "plan") != "", "a plan")
    page.find_element(By.CSS_SELECTOR, "#commissioning-kind option[value=first_start]").click()
    type_over(page.find_element(By.ID, "commissioning-current"), "3")
    operator.click("#commissioning-start")
    assert operator.sees("#dialog-question") == "First start of spindle? The motor will move."
    assert "The shaft has to be free." in operator.sees(".dialog p")
    assert httpx.get(f"{root}{DRIVE}/commissionings").json()["commissionings"][0]["id"] == KEPT
    operator.click("#dialog-yes")
    until(page, lambda: text(page, "commissioning-phase").startswith("Aligning the rotor by "), "what is done")
    assert text(page, "commissioning-title").startswith("First start, asked for ")
    assert text(page, "commissioning-since").startswith("since ")
    assert "aligning the rotor by " in text(page, "commissioning-steps")
    assert not page.find_element(By.ID, "commissioning-form").is_displayed()
    assert text(page, "flash-why") == "The commissioning is under way: stop it first."
    assert text(page, "set-plan-why") == "The commissioning is under way: the drive has the settings of a trial."
    assert not page.find_element(By.ID, "set-plan").is_enabled()
    assert violations(page) == []
    operator.click("#commissioning-stop")
    until(page, lambda: text(page, "commissioning-verdict").startswith("Cancelled: "), "its end")
    assert not page.find_element(By.ID, "commissioning-stop").is_displayed()
    assert page.find_elements(By.ID, "commissioning-plan") == []
    until(page, lambda: text(page, "plan") == "" and text(page, "flash-why") == "Plan it first.", "no plan of before")
    until(page, lambda: page.find_element(By.ID, "set-plan").is_enabled(), "that it can be planned anew")
    until(page, lambda: text(page, "control-state").startswith("off: "), "the drive to be off")
    until(page, lambda: text(page, "commissioning-why") == "", "the drive to be free")


def test_one_that_another_has_asked_for_is_shown_also_where_the_page_comes_later(page: Chrome, root: str) -> None:
    with httpx.Client(base_url=f"{root}{DRIVE}", headers=JSON, timeout=30.0) as client:
        client.post("/commissionings", json={"kind": "first_start", "current": 3.0}).raise_for_status()
        until(page, lambda: text(page, "commissioning-phase").endswith(" …"), "that it runs")
        until(page, lambda: len(client.get("/commissionings/latest").json()["steps"]) > 1, "steps")
        page.refresh()
        until(page, lambda: len(page.find_elements(By.CSS_SELECTOR, "#commissioning-steps li")) > 1, "all its steps")
        client.post("/stop", json={}).raise_for_status()
        until(page, lambda: text(page, "commissioning-verdict").startswith("Cancelled: "), "its end")
        assert client.get("/commissionings/latest").json()["state"] == "cancelled"
    until(page, lambda: "values, read" in text(page, "parameters-looked"), "the parameters, which can be read again")


def test_an_answer_that_comes_late_is_that_of_the_drive_that_was_asked(page: Chrome) -> None:
    operator = Operator(page)
    until(page, lambda: text(page, "commissioning-why") == "", "the drive to be free")
    run(page, HELD)
    page.find_element(By.CSS_SELECTOR, "#commissioning-kind option[value=first_start]").click()
    type_over(page.find_element(By.ID, "commissioning-current"), "3")
    operator.click("#commissioning-start")
    operator.click("#dialog-yes")
    until(page, lambda: run(page, "return window.goOn !== undefined"), "the answer")
    page.find_element(By.CSS_SELECTOR, "#drive-select option[value=feed]").click()
    until(page, lambda: text(page, "commissioning-note").startswith("None yet"), "the other drive's room")
    run(page, "window.goOn()")
    until(page, lambda: text(page, "commissioning-why") == "There is no link to the drive.", "its state")
    assert not page.find_element(By.ID, "commissioning").is_displayed()
    page.find_element(By.CSS_SELECTOR, "#drive-select option[value=spindle]").click()
    until(page, lambda: text(page, "commissioning-title").startswith("First start, "), "that of the drive")
    operator.click("#commissioning-stop")
    until(page, lambda: text(page, "commissioning-verdict").startswith("Cancelled: "), "its end")


def test_one_of_another_is_shown_where_the_first_looks_at_it_fail(page: Chrome, root: str) -> None:
    run(page, FAILING)
    with httpx.Client(base_url=f"{root}{DRIVE}", headers=JSON, timeout=30.0) as client:
        client.post("/commissionings", json={"kind": "first_start", "current": 3.0}).raise_for_status()
        until(page, lambda: text(page, "commissioning-phase").endswith(" …"), "that it runs")
        assert run(page, "return window.failed") > 2
        client.post("/stop", json={}).raise_for_status()
    until(page, lambda: text(page, "commissioning-verdict").startswith("Cancelled: "), "its end")


def test_one_whose_service_dies_is_not_known_and_ends_with_the_next_service(browser: Chrome, tmp_path: Path) -> None:
    kept(tmp_path, FIRST, "first_start", {"said": "4 pole pairs"})
    operator = Operator(browser)
    with drives(tmp_path, "--scenario", str(tmp_path / "unknown.toml")) as root:
        with service(tmp_path, root) as process:
            enter(browser, root)
            until(browser, lambda: text(browser, "commissioning-why") == "", "the drive to be free")
            assert violations(browser) == []
            identify(operator)
            ended = f"{FIRST} is of a service that has ended"
            until(browser, lambda: ended in text(browser, "commissioning-message"), "a refusal")
            operator.click("#commissioning-follows")
            identify(operator)
            until(browser, lambda: " " in text(browser, "commissioning-since"), "that it runs")
            process.kill()
            until(browser, lambda: text(browser, "commissioning-phase") == GONE, "that it is not known")
            assert text(browser, "commissioning-since") == ""
            assert violations(browser) == []
            assert not browser.find_element(By.ID, "commissioning-form").is_displayed()
        with service(tmp_path, root):
            until(browser, lambda: text(browser, "commissioning-verdict") == ENDED, "its end")
            assert browser.find_element(By.ID, "commissioning-form").is_displayed()
            assert not browser.find_element(By.ID, "commissioning-stop").is_displayed()
            until(browser, lambda: "values, read" in text(browser, "parameters-looked"), "the parameters, read again")
            until(browser, lambda: text(browser, "commissioning-why") == "", "the drive to be free")
            browser.get("about:blank")


def identify(operator: Operator) -> None:
    operator.click("#commissioning-start")
    assert "for a minute or more while it is diagnosed, and move again after that, up to twice." in operator.sees(
        ".dialog p"
    )
    operator.click("#dialog-yes")
