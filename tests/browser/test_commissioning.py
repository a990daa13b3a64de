"""The page's commissionings in headless Chromium: asked for, watched, stopped, and what came of one flashed."""

from __future__ import annotations

import json
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
from tests.browser.test_page import browser, forget_logs, pytestmark, text, type_over, until
from tests.browser.test_rooms import Operator, errors
from tests.conftest import JSON, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url

__all__ = ["browser", "pytestmark"]

DRIVE = "/api/drives/spindle"
KEPT = "spindle-identify-20260131-120000-000"
SENTENCE = "Nothing beyond noise was left out."
RESULT: dict[str, Any] = {
    "machine": None, "shaft": None, "acceleration": 1.0, "loops": [], "responses": {},
    "diagnosis": {"verdict": "no_mismatch", "sentence": SENTENCE, "findings": []}, "recordings": [],
    "set": as_toml(set_of({"bandwidth": 900.0}, "spindle 2026-01-31", "commissioning")),
    "remarks": ["the shaft tells no inertia"],
}  # fmt: skip


@contextmanager
def served(folder: Path, *scenario: str) -> Generator[str]:
    """A service over an emulated drive and one that is not there; where it answers."""
    port, url = free_port(), tcp_url()
    (folder / "bench.toml").write_text(
        f'[service]\nport = {port}\ncaptures = "c"\nlog = "log"\njournals = "j"\ndatabase = "c.sqlite"\n'
        f'[drives.spindle]\nurl = "{url}"\n[drives.spindle.limits]\ni_max = 6.0\nspeed_max_rpm = 1500.0\n'
        f'[drives.feed]\nurl = "{tcp_url()}"\n', encoding="utf-8",
    )  # fmt: skip
    with emulator("--at", url, *scenario, control="lease") as process:
        ready(process)
        with command("serve", "--config", str(folder / "bench.toml")) as service:
            wait_for_answer(f"http://127.0.0.1:{port}/api/health", service)
            yield f"http://127.0.0.1:{port}"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a motor that nobody knows, which a service before this one has identified."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "unknown.toml").write_text(text_of(unknown()), encoding="utf-8")
    (folder / "c" / "commissionings").mkdir(parents=True)
    (folder / "c" / "commissionings" / f"{KEPT}.json").write_text(json.dumps({
        "id": KEPT, "drive": "spindle", "asked": "2026-01-31T12:00:00+00:00", "request": {"kind": "identify"},
        "state": "done", "phase": "", "reason": "", "result": RESULT,
        "steps": [{"at": "2026-01-31T12:00:01+00:00", "said": "diagnosing"}],
    }), encoding="utf-8")  # fmt: skip
    with served(folder, "--scenario", str(folder / "unknown.toml")) as one:
        yield one


@pytest.fixture
def page(browser: Chrome, root: str) -> Iterator[Chrome]:
    """The drive's room."""
    forget_logs(browser)
    browser.get(f"{root}/#drive/spindle")
    until(browser, lambda: "values, read" in text(browser, "parameters-looked"), "the parameters")
    yield browser
    browser.get("about:blank")


def test_what_came_of_one_is_told_with_its_report_and_its_set_is_planned_and_flashed(page: Chrome, root: str) -> None:
    operator = Operator(page)
    assert operator.sees("#commissioning-verdict") == f"No mismatch: {SENTENCE}"
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
    assert violations(page) == []
    operator.click("#commissioning-stop")
    until(page, lambda: text(page, "commissioning-verdict").startswith("Cancelled: "), "its end")
    assert not page.find_element(By.ID, "commissioning-stop").is_displayed()
    assert page.find_elements(By.ID, "commissioning-plan") == []
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
