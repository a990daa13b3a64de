"""The page's parameters in headless Chromium: values typed or from a file, planned, flashed, and taken back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from bench.parameters.parameter_set import FLASHED
from tests.browser.axe import violations
from tests.browser.test_page import browser, forget_logs, pytestmark, text, type_over, until
from tests.browser.test_rooms import Operator, errors
from tests.conftest import JSON, RunningBench, bench_up

__all__ = ["browser", "pytestmark"]

DRIVE = "/api/drives/emulated"
DOUBTFUL = 'name = "found"\n[parameters]\ncontrol_R_s = { value = 0.9, status = "doubtful", source = "estimate" }\n'
FAR = 'name = "far"\n[parameters]\ncurrent_limit = 7.0\n'


@pytest.fixture(scope="module")
def bench() -> Iterator[RunningBench]:
    """Of its own: a flash resets the drive."""
    with bench_up() as one:
        yield one


@pytest.fixture
def page(browser: Chrome, bench: RunningBench) -> Iterator[Chrome]:
    """The drive's room, with its parameters; the drive is on."""
    forget_logs(browser)
    httpx.post(f"{bench.url}{DRIVE}/start", json={}, timeout=10.0).raise_for_status()
    browser.get(f"{bench.url}/#drive/emulated")
    until(browser, lambda: f"{len(FLASHED)} values, read" in text(browser, "parameters-looked"), "the parameters")
    yield browser
    browser.get("about:blank")


def value(bench: RunningBench, name: str) -> float:
    told = httpx.get(f"{bench.url}{DRIVE}/parameters/set", timeout=10.0).raise_for_status().json()
    return told["entries"][name]["value"]


def flash_elsewhere(page: Chrome, client: httpx.Client, bandwidth: float) -> None:
    """As soon as the link is there."""
    given = {"name": f"at {bandwidth:g}", "entries": {"bandwidth": bandwidth}}
    until(page, lambda: client.post(f"{DRIVE}/flashes", json=given).is_success, "a flash")
    until(page, lambda: client.get(f"{DRIVE}/flashes/latest").json()["state"] == "flashed", "its end")


def test_a_value_is_typed_planned_flashed_and_rolled_back(page: Chrome, bench: RunningBench) -> None:
    operator = Operator(page)
    assert text(page, "set-plan-why") == "There is nothing to plan yet."
    until(page, lambda: text(page, "flash-why") == "The drive is on: stop it first.", "why it cannot be flashed")
    type_over(page.find_element(By.ID, "parameters-filter"), "current-control bandwidth")
    until(page, lambda: len(page.find_elements(By.CSS_SELECTOR, "#parameters tbody tr")) == 1, "one that fits")
    operator.click("#parameters .edit")
    type_over(page.find_element(By.CSS_SELECTOR, "#parameters .entry input"), "900")
    operator.click("#parameters .entry .primary")
    assert "to be 900" in text(page, "parameters")
    operator.click("#set-plan")
    until(page, lambda: "1 value changes" in text(page, "plan"), "the plan")
    row = page.find_element(By.CSS_SELECTOR, "#plan tbody tr").text
    assert row.split() == ["bandwidth", "1250", "900", "rad/s", "00409c44", "00006144"]
    operator.click("#control-stop")
    operator.click("#flash-start")
    assert operator.sees("#dialog-question") == "Flash what was typed into emulated?"
    operator.click("#dialog-yes")
    until(page, lambda: text(page, "flash-verdict").startswith("“by hand” flashed: 1 value changed"), "a verdict")
    until(page, lambda: "900 rad/s" in text(page, "parameters"), "the new value")
    assert value(bench, "bandwidth") == 900.0
    assert "reading back" in text(page, "flash-steps")
    until(page, lambda: "by hand" in text(page, "flash-history"), "the history")
    operator.click("#flash-rollback")
    assert "bandwidth 900 → 1250 rad/s" in operator.sees(".dialog p")
    operator.click("#dialog-yes")
    until(page, lambda: "“before by hand” flashed" in text(page, "flash-verdict"), "the verdict of the way back")
    assert value(bench, "bandwidth") == 1250.0
    until(page, lambda: "flash of 'before by hand', version 1: flashed" in text(page, "events"), "that it is told")
    assert errors(page) == []


def test_one_goes_back_to_before_any_flash_of_the_history(page: Chrome, bench: RunningBench) -> None:
    operator = Operator(page)
    operator.click("#control-stop")
    with httpx.Client(base_url=bench.url, headers=JSON, timeout=10.0) as client:
        for bandwidth in (900.0, 800.0):
            flash_elsewhere(page, client, bandwidth)
    until(page, lambda: "at 800" in text(page, "flash-history"), "both")
    assert violations(page) == []
    assert operator.sees("#flash-history li:nth-child(2) button") == "Go back to before this …"
    operator.click("#flash-history li:nth-child(2) button")
    assert operator.sees("#dialog-question").startswith("Roll emulated back to before “at 900” of ")
    assert "bandwidth 800 → 1250 rad/s" in operator.sees(".dialog p")
    operator.click("#dialog-yes")
    until(page, lambda: "“before at 900” flashed" in text(page, "flash-verdict"), "the verdict")
    assert value(bench, "bandwidth") == 1250.0
    httpx.post(f"{bench.url}{DRIVE}/start", json={}, timeout=10.0).raise_for_status()
    on = "The drive is on: stop it first."  # who controls it is told a little earlier
    until(page, lambda: text(page, "flash-rollback-why") == on, "that it is on")
    assert page.find_elements(By.CSS_SELECTOR, "#flash-history button:enabled") == []


def test_a_file_is_planned_with_what_forbids_it_and_doubts_ask_for_a_reason(
    page: Chrome, bench: RunningBench, tmp_path: Path
) -> None:
    operator = Operator(page)
    operator.click("#control-stop")
    for name, content, said in (("far.toml", FAR, "currents go up to 6 A"), ("found.toml", DOUBTFUL, "is doubtful")):
        (tmp_path / name).write_text(content, encoding="utf-8")
        page.find_element(By.ID, "parameters-file").send_keys(str(tmp_path / name))
        until(page, lambda said=said: said in text(page, "plan"), said)
        if name == "far.toml":
            until(page, lambda: text(page, "flash-why") == "What forbids it stands above.", "why")
    until(page, lambda: text(page, "flash-why") == "The doubts ask for a reason.", "why")
    assert violations(page) == []
    type_over(page.find_element(By.ID, "flash-reason"), "on a test bench")
    operator.click("#flash-start")
    operator.click("#dialog-yes")
    until(page, lambda: "“found” flashed" in text(page, "flash-verdict"), "the verdict")
    until(page, lambda: "in spite of doubts: on a test bench" in text(page, "flash-history"), "the reason")
    with httpx.Client(base_url=bench.url, headers=JSON, timeout=10.0) as client:
        assert client.get(f"{DRIVE}/flashes").json()["past"][0]["override"] == "on a test bench"
    wrong = "".join(f'{name} = "x"\n' for name in [f"none_{k}" for k in range(12)])
    (tmp_path / "bad.toml").write_text(f'name = "bad"\n[parameters]\n{wrong}', encoding="utf-8")
    page.find_element(By.ID, "parameters-file").send_keys(str(tmp_path / "bad.toml"))
    until(page, lambda: "none_11" in text(page, "parameters-message"), "all that is wrong with it")
    assert text(page, "parameters-message").count("\n") >= 11  # a line each
    (tmp_path / "no.toml").write_text("no set", encoding="utf-8")
    page.find_element(By.ID, "parameters-file").send_keys(str(tmp_path / "no.toml"))
    until(page, lambda: "the set: is not TOML" in text(page, "parameters-message"), "why it is no set")
