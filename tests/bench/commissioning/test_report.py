"""A commissioning's page: what was found, and every value that was flashed."""

import re
from html import unescape
from typing import Any

from bench.commissioning.report import report
from bench.parameters.parameter_set import Entry, ParameterSet, as_toml, set_of

LOOP = {"name": "speed", "overshoot": 0.18, "settling": None, "tracking": 0.009, "promised_overshoot": 0.17,
        "promised_settling": 0.046, "promised_tracking": 0.0088, "sentence": ""}  # fmt: skip
STEP = {"speed": {"t": [-0.01, 0.0, 0.1], "y": [0.0, 0.05, 1.0]}}
FIRST = {
    "said": "4 pole pairs", "set": as_toml(set_of({"n_p": 4.0, "phases_swapped": 1.0}, "first start", "first start")),
    "present": {"n_p": 3.0, "phases_swapped": 0.0},
}
ENTRIES = {
    "control_R_s": Entry(0.9664, 0.9655, 0.9673, source="diagnosis of <x>"),
    "k_p_speed": Entry(0.0448, status="doubtful", note="by a rule"),
    **{f"psi_d_table_{k}": Entry(0.1) for k in range(1, 65)},
}


def page(first: dict[str, Any] | None = None) -> str:
    given = ParameterSet("emulated", ENTRIES, 3, 0xDE84BEF1, 0x12345678)
    found = {
        "machine": None, "shaft": None, "loops": [LOOP], "responses": STEP, "set": as_toml(given),
        "diagnosis": {"verdict": "explained", "sentence": "All is told."}, "remarks": [], "recordings": [],
        "promises": {}, "present": {"control_R_s": 1.2},
    }  # fmt: skip
    return report("spindle", "Today.", found, {"loops": [LOOP], "responses": STEP, "promises": STEP}, first)


def rows(html: str) -> list[list[str]]:
    found = re.findall(r"<tr>(.*?)</tr>", html, re.DOTALL)
    return [[unescape(cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", row)] for row in found]


def test_every_value_of_both_sets_is_there_with_its_interval_and_what_it_is_from() -> None:
    html = page(FIRST)
    for row in (
        ["n_p", "3", "4", "", "first start"], ["phases_swapped", "0", "1", "", "first start"],
        ["control_R_s", "1.2 ohm", "0.9664 ohm", "0.9655 to 0.9673", "diagnosis of <x>"],
        ["k_p_speed", "", "0.0448 A s/rad", "", "doubtful; by a rule"], ["psi_d_table", "", "64 entries", "", ""],
    ):
        assert row in rows(html)
    assert "The set “emulated, version 3”" in html
    assert "Of the drive with serial number 0x12345678 and layout 0xDE84BEF1." in html
    assert "not yet" in html
    assert re.findall(r'<li class="line (\w+)">', html) == ["before", "after", "promised"]


def test_without_a_first_start_there_is_one_set() -> None:
    assert page().count("<h2>The set") == 1


def test_a_set_that_is_not_there_makes_no_after() -> None:
    found = {
        "machine": None, "shaft": None, "loops": [LOOP], "responses": STEP, "set": as_toml(ParameterSet("a", ENTRIES)),
        "diagnosis": {"verdict": "explained", "sentence": "All is told."}, "remarks": [], "recordings": [],
    }  # fmt: skip
    checked = {"loops": [LOOP], "responses": STEP, "promises": STEP, "lacks": ["bandwidth"]}
    html = report("spindle", "Today.", found, checked)
    assert ">tried again</td>" in html
    assert ">after</td>" not in html
    assert "promised, tried again" in html
