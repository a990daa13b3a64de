"""Sets in files: as they were, and all that is wrong told at once."""

import json
import math
from dataclasses import replace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import ConfigError
from bench.parameters.parameter_set import (
    FLASHED,
    Entry,
    ParameterSet,
    as_document,
    as_toml,
    of_document,
    of_toml,
    parse,
    problem_of,
    set_of,
)
from bench.parameters.plan import different, plan
from drivers.drive import Identity
from drivers.wire.codec import decode, encode
from drivers.wire.dictionary import TABLES, Signal, layout_id

SCALARS = [signal.name for signal in FLASHED if not signal.table]


def test_a_set_comes_back_from_its_file_as_it_was() -> None:
    entries = {
        "bandwidth": Entry(1250.0), "n_p": Entry(4.0), "dead_time": Entry(2e-6, 1.9e-6, 2.1e-6, "doubtful", 'a "find"'),
        "control_R_s": Entry(1.0, 0.9, 1.1, note="copper, 0.393 %/K", at_degC=60.0, at_20_degC=0.864),
        **{f"angle_table_{k}": Entry(k * 1e-4) for k in range(1, 65)},
    }
    given = ParameterSet("servo 6 A", entries, 3, 0xDE84BEF1, 77)
    assert parse(as_toml(given), "x") == given
    assert of_document(json.loads(json.dumps(as_document(given))), "x") == given


@pytest.mark.parametrize(("inside", "said"), [
    ("note = 1", "expected texts of up to 300 characters as status, source, note and unit"),
    ('at_degC = "warm"', "expected a number as at_degC"),
    ("at_20 = 1.0", "expected one of at_20_degC, at_degC, high, low, note, source, status, unit, value"),
])
def test_what_is_said_of_a_value_is_checked(inside: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse(f'name = "a"\n[parameters]\ncontrol_R_s = {{ value = 1.0, {inside} }}\n', "x")


def test_all_that_is_wrong_is_told_at_once() -> None:
    with pytest.raises(ConfigError) as told:
        parse(
            'version = 0\nmotor = 1\n[drive]\nserial = "x"\n[parameters]\nbandwidth = 1.0\nspeed = 1\ni_q_ref = 1.0\n'
            'n_p = 2.5\ncontrol_R_s = nan\nk_p_d = "a"\n[tables]\npsi = []\nangle_table = [1.0]\n', "set.toml",
        )
    assert str(told.value).splitlines() == [
        "set.toml: 'motor' is none of drive, name, parameters, tables, version",
        "set.toml: 0x2210:2 (k_p_d) takes a number, got 'a'",
        "set.toml: name: expected 1 to 60 characters, got ''",
        "set.toml: version: expected a whole number from 1 on, got 0",
        "set.toml: serial: expected a number of 32 bits such as 0xDE84BEF1, got 'x'",
        "set.toml: 0x2200:6 (bandwidth) takes at least 10.0 rad/s, got 1.0",
        "set.toml: no signal 'speed'",
        "set.toml: 0x2300:2 (i_q_ref) is no parameter that is flashed",
        "set.toml: 0x2200:1 (n_p) takes a whole number, got 2.5",
        "set.toml: 0x2200:2 (control_R_s) takes a finite number, got nan",
        "set.toml: no table 'psi'; there are psi_d_table, psi_q_table, angle_table, inverter_table",
        "set.toml: angle_table: expected a list of 64 numbers, got [1.0]",
    ]


def test_what_is_wrong_with_single_values_leaves_the_others_to_be_planned() -> None:
    good = set_of({"bandwidth": 900.0}, "a", "")
    document: dict[str, Any] = {"name": "a", "entries": {
        "bandwidth": 900.0, "n_p": 2.5, "watchdog_time": 0.0, "dead_time": {"value": 2e-6, "unit": "us"}, "speed": 1.0,
    }}  # fmt: skip
    assert of_document(document, "x") == replace(good, unfit=(
        "0x2200:1 (n_p) takes a whole number, got 2.5", "0x2300:6 (watchdog_time) takes at least 0.05 s, got 0.0",
        "0x2240:2 (dead_time) is in s, got 'us'", "no signal 'speed'",
    ))
    assert of_toml('name = "a"\n[parameters]\nbandwidth = 900.0\n[tables]\npsi = []\n', "x").unfit == (
        "no table 'psi'; there are psi_d_table, psi_q_table, angle_table, inverter_table",
    )


@pytest.mark.parametrize(("document", "said"), [
    ({}, "name: expected 1 to 60 characters"), ({"name": "a"}, "expected values in entries, got none"),
    ({"name": "a", "entries": []}, "entries: expected a section"),
    ({"name": "a", "version": 10**30, "entries": {"n_p": 4}}, "version: expected a whole number from 1 on"),
    ({"name": "a", "values": {}, "entries": {"n_p": 4}}, "'values' is none of entries, layout_id, name"),
    ({"name": "a", "entries": {"n_p": {"value": 4, "low": 10**400}}}, "expected a number as low"),
    ({"name": "a", "entries": {"n_p": "4"}}, r"0x2200:1 \(n_p\) takes a number, got '4'"),
    ({"name": "a", "entries": {"speed": {}}}, "'speed' takes a number, got null"),
    ({"name": "a", "entries": {"n_p": {"value": 4, "notes": ""}}}, "'notes': expected one of at_20_degC"),
    ({"name": "a", "entries": {"n_p": {"value": 4, "status": "\ud800"}}}, "expected texts of up to 300 characters"),
])  # fmt: skip
def test_what_is_no_set_is_refused(document: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        of_document(document, "x")


def test_all_that_is_wrong_with_one_entry_is_told() -> None:
    entry = {"value": 2.0, "low": math.nan, "high": "a", "unit": "ms", "note": 1, "notes": ""}
    with pytest.raises(ConfigError) as told:
        of_document({"name": "a", "entries": {"speed_filter": entry}}, "x")
    assert str(told.value).splitlines() == [
        "x: 'speed_filter' 'notes': expected one of at_20_degC, at_degC, high, low, note, source, status, unit, value",
        "x: 'speed_filter': expected a number as low, got nan", "x: 'speed_filter': expected a number as high, got 'a'",
        "x: 'speed_filter': expected texts of up to 300 characters as status, source, note and unit",
        "x: 0x2220:3 (speed_filter) takes at most 1.0 s, got 2.0", "x: 0x2220:3 (speed_filter) is in s, got 'ms'",
    ]


@given(st.text(max_size=200))
def test_no_text_makes_a_traceback(text: str) -> None:
    try:
        parse(text, "x")
    except ConfigError as error:
        assert str(error).startswith("x: ")


TOML_VALUES = st.one_of(
    st.floats(), st.integers(-(10**20), 10**20), st.booleans(), st.text(max_size=5), st.lists(st.floats(), max_size=3),
    st.dictionaries(st.sampled_from(["value", "low", "high", "status", "source", "x"]), st.floats(), max_size=3),
)  # fmt: skip


@given(st.dictionaries(st.sampled_from([*SCALARS, "i_q_ref", "tick", "nothing"]), TOML_VALUES, max_size=8))
def test_no_values_make_a_traceback(values: dict[str, object]) -> None:
    def text(value: Any) -> str:
        if isinstance(value, dict):
            entries = cast(dict[str, object], value).items()
            return "{" + ", ".join(f"{key} = {text(one)}" for key, one in entries) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(text, cast(list[object], value))) + "]"
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, str):
            return '"' + "".join(c for c in value if c.isalnum() and c.isascii()) + '"'
        return repr(value)

    lines = "".join(f"{name} = {text(value)}\n" for name, value in values.items())
    try:
        found = parse(f'name = "a"\n[parameters]\n{lines}', "x")
    except ConfigError:
        return
    for name, value in found.values.items():
        assert problem_of(name, value) == ""


ENDS = (
    0.0, 5e-324, 1e-50, 1.1754943508222875e-38, 3.4028234663852886e38, 3.4028235677973362e38, 3.4028235677973366e38,
    3.5e38, 1e300, math.inf, math.nan,
)  # fmt: skip
"""Where a 32-bit float ends."""


@given(st.sampled_from(FLASHED), st.floats())
def test_a_value_that_is_taken_can_be_sent_and_is_taken_again(signal: Signal, value: float) -> None:
    bounds = [bound for bound in (signal.minimum, signal.maximum) if bound is not None]
    near = [math.nextafter(bound, end) for bound in bounds for end in (-math.inf, math.inf)]
    for one in (value, *bounds, *near, *ENDS, *(-end for end in ENDS)):
        if problem_of(signal.name, one) == "":
            held = decode(signal, encode(signal, one, {}), {})
            assert problem_of(signal.name, held) == ""
            assert different({signal.name: held}, {signal.name: one}) == []


@pytest.mark.parametrize("value", [3.5e38, 1e300, -1e300])
def test_a_value_that_no_32_bit_float_is_is_told_with_all_others(value: float) -> None:
    given = of_document({"name": "a", "entries": {"i_a_offset": value, "bandwidth": 1.0}}, "x")
    assert given.unfit == (
        f"0x2230:4 (i_a_offset) takes a 32-bit float, up to 3.4028e+38 in size, got {value}",
        "0x2200:6 (bandwidth) takes at least 10.0 rad/s, got 1.0",
    )


def test_a_drive_that_holds_what_nobody_may_write_is_planned_for() -> None:
    identity = Identity("a drive", 0, 1, 1, 1, layout_id(), 1e-4, 20.0, 400.0, 3000.0)
    to_do = plan(set_of({"watchdog_time": 0.5}, "a", ""), identity, {"watchdog_time": 0.0})
    assert [(change.old, change.new) for change in to_do.changes] == [(0.0, 0.5)]
    assert different({"watchdog_time": 0.0}, {"watchdog_time": 0.0}) == []


def test_set_points_and_the_stream_are_no_part_of_a_set() -> None:
    names = set(set_of({"i_q_ref": 1.0, "stream_periods": 10.0, "bandwidth": 900.0}, "a", "pulled").entries)
    assert names == {"bandwidth"}
    assert len(FLASHED) > 60 + 4 * 64 - 20
    assert set(TABLES) == {signal.table for signal in FLASHED if signal.table}
