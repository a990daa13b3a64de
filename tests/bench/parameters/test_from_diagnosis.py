"""A set from a diagnosis: what goes in, how sure it is, and what is said of the rest."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.diagnoses.diagnose import Diagnosed, as_json
from bench.diagnoses.together.published import as_json as together_as_json
from bench.errors import ConfigError, LimitError
from bench.parameters.from_diagnosis import set_from_diagnosis
from bench.parameters.parameter_set import as_toml, parse
from bench.parameters.tuning import current_loop
from estimator.diagnosis.verdict import Diagnosis, Quantity, Verdict
from tests.support.diagnoses import (
    AMBIGUOUS,
    CONVENTION,
    EXPLAINED,
    NO_MISMATCH,
    NOMINAL,
    NOTHING_TOLD,
    RECORDING,
    UNEXPLAINED,
)
from tests.support.together import ALIKE, BOTH, NOTHING, diagnosed

SEEN = {"i_d": (-4.0, 1.0), "i_q": (-3.0, 5.0)}
CONTROL = ("control_R_s", "control_L_d", "control_L_q", "control_psi_f")


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    return as_json(Diagnosed(RECORDING, NOMINAL, diagnosis, SEEN, 310.0))


def test_the_machine_after_the_effects_and_what_makes_up_for_them() -> None:
    made = set_from_diagnosis(content(EXPLAINED), {}, serial=77)
    assert made.remarks == ()
    given, told = made.set, made.set.entries
    assert (given.name, given.serial, given.version) == ("diagnosis of 0007.parquet", 77, 1)
    R_s = told["control_R_s"]
    assert (R_s.value, R_s.status, R_s.source) == (0.9668, "ok", "diagnosis of 0007.parquet")
    assert (R_s.low, R_s.high) == pytest.approx((0.9668 - 1.96 * 4e-4, 0.9668 + 1.96 * 4e-4))
    assert told["dead_time"].value == 2e-6
    assert told["dead_time"].source == "diagnosis of 0007.parquet: inverter_voltage_error"
    assert told["saturation_correction"].value == 1.0
    assert "recorded were i_d from -4 to 1 A, i_q from -3 to 5 A" in told["table_i_q_max"].note
    assert told["psi_d_table_1"].value < told["psi_d_table_64"].value
    assert "own_gains" not in told
    assert parse(as_toml(given), "x") == given


def test_gains_are_by_the_rule_where_they_are_asked_for() -> None:
    told = set_from_diagnosis(content(NO_MISMATCH), {}, own_gains=True, bandwidth=800.0).set.values
    tuned = current_loop(0.9668, 4.238e-3, 6.212e-3, 1e-4, 800.0)
    assert {name: told[name] for name in tuned.values} == tuned.values
    assert set(told) == {*CONTROL, *tuned.values}
    with pytest.raises(LimitError, match="bandwidth"):
        set_from_diagnosis(content(NO_MISMATCH), {}, own_gains=True, bandwidth=8000.0)


@pytest.mark.parametrize("diagnosis", [UNEXPLAINED, AMBIGUOUS])
def test_a_verdict_that_leaves_something_open_makes_every_value_doubtful(diagnosis: Diagnosis) -> None:
    made = set_from_diagnosis(content(diagnosis), {}, own_gains=True)
    words = diagnosis.verdict.value
    assert {entry.status for entry in made.set.entries.values()} == {"doubtful"}
    assert made.set.entries["control_L_d"].source == f"diagnosis of 0007.parquet; {words}"


def test_only_a_further_effect_that_the_machine_was_fitted_with_leaves_values_as_they_are() -> None:
    perhaps = replace(AMBIGUOUS.ambiguous[0], effects=("iron_loss",), rivals=False)
    beside = replace(perhaps, machine_holds=True)
    for doubts, status in (((beside,), "ok"), ((perhaps,), "doubtful"), ((beside, perhaps), "doubtful")):
        diagnosis = replace(EXPLAINED, verdict=Verdict.AMBIGUOUS, ambiguous=doubts)
        made = set_from_diagnosis(content(diagnosis), {})
        assert {made.set.entries[name].status for name in CONTROL} == {status}
        assert "it is not told whether there is iron_loss" in made.remarks


def test_a_finding_that_is_not_told_from_others_is_doubtful() -> None:
    doubt = replace(AMBIGUOUS.ambiguous[0], effects=("d_axis_saturation", "iron_loss"))
    made = set_from_diagnosis(content(replace(EXPLAINED, ambiguous=(doubt,))), {})
    told = made.set.entries
    assert told["saturation_correction"].status == "doubtful"
    assert told["saturation_correction"].source.endswith("d_axis_saturation cannot be told from other causes")
    assert told["dead_time"].status == "ok"


def test_where_nothing_is_told_there_are_no_values() -> None:
    made = set_from_diagnosis(content(NOTHING_TOLD), {})
    assert made.set.entries == {}
    assert made.remarks == (
        "the recording tells too little of the machine: it gives no values",
        "record at 500 rpm or more, with steps of i_d and i_q",
    )


def test_bad_numbers_are_left_out_with_a_sentence() -> None:
    after = dict(EXPLAINED.machine_after) | {
        "L_d": Quantity(None, None, "H"), "L_q": Quantity(6e-3, None, "H"), "psi_f": Quantity(0.12, 0.02, "Vs"),
        "R_s": Quantity(-0.1, 0.01, "ohm"),
    }  # fmt: skip
    made = set_from_diagnosis(content(replace(NO_MISMATCH, machine_after=after)), {}, own_gains=True)
    assert made.remarks == (
        "control_R_s is left out: 0x2200:2 (control_R_s) takes at least 0.0001 ohm, got -0.1",
        "control_L_d is left out: L_d is not told",
        "gains of the current control are left out: they need R_s, L_d, L_q and the control period",
    )
    told = made.set.entries
    assert (told["control_L_q"].status, told["control_L_q"].low) == ("doubtful", None)
    assert told["control_L_q"].source.endswith("; no interval is told")
    assert told["control_psi_f"].source.endswith("; told within 0.039 Vs only")


def test_what_the_drive_had_counts_and_that_it_is_not_known_is_said() -> None:
    had = {"inverter_correction": 1.0, "dead_time": 1e-6}
    assert set_from_diagnosis(content(EXPLAINED), had).set.values["dead_time"] == pytest.approx(3e-6)
    made = set_from_diagnosis(content(EXPLAINED))
    assert made.set.values["dead_time"] == 2e-6
    assert made.remarks == ("what the drive made up for while it was recorded is not known: it is taken for nothing",)


def test_a_diagnosis_without_the_currents_that_were_seen_has_tables_to_the_rated_one() -> None:
    said = content(EXPLAINED)
    for key in ("currents", "T_s", "u_dc"):
        del said["recording"][key]
    told = set_from_diagnosis(said, {}).set.entries
    assert (told["table_i_d_min"].value, told["table_i_q_max"].value) == (-6.0, 6.0)
    assert "it is not told which currents were recorded" in told["table_i_q_max"].note


def test_of_several_recordings_what_is_one_is_taken_over_and_what_differs_is_the_last_ones_and_doubtful() -> None:
    made = set_from_diagnosis(together_as_json(diagnosed(BOTH)), {})
    told, why = made.set.entries, "not the same in all recordings: this is that of warm"
    assert made.set.name == "diagnosis of cold and warm"
    L_d = told["control_L_d"]
    assert (L_d.value, L_d.status, L_d.source) == (4.2385e-3, "ok", "diagnosis of cold and warm")
    R_s = told["control_R_s"]
    assert (R_s.value, R_s.status, R_s.source) == (1.0248, "doubtful", f"diagnosis of cold and warm; {why}")
    assert (told["dead_time"].value, told["dead_time"].status) == (2e-6, "doubtful")
    assert (told["saturation_correction"].value, told["saturation_correction"].status) == (1.0, "ok")
    assert made.remarks == (
        f"control_R_s: R_s is {why}",
        f"inverter_correction, dead_time, inverter_width, inverter_drop: inverter_voltage_error is {why}",
    )
    assert parse(as_toml(made.set), "x") == made.set


def test_of_several_recordings_that_say_the_same_nothing_is_doubtful() -> None:
    made = set_from_diagnosis(together_as_json(diagnosed(ALIKE)), {}, own_gains=True)
    assert {entry.status for entry in made.set.entries.values()} == {"ok"}
    assert made.set.values["control_R_s"] == 0.9669
    assert "own_gains" in made.set.values  # by the control period of all
    assert made.remarks == ()
    assert set_from_diagnosis(together_as_json(diagnosed(NOTHING)), {}).set.entries == {}


def test_what_a_recording_alone_has_in_another_convention_is_said_to_be_left_out() -> None:
    said = replace(ALIKE, diagnoses=(NO_MISMATCH, CONVENTION))
    made = set_from_diagnosis(together_as_json(diagnosed(said)), {})
    assert made.remarks == (
        "convention_error is each recording's own, and left out: a diagnosis of that recording alone gives a set with "
        "it",
    )


@pytest.mark.parametrize("wrong", [{}, {"verdict": "perhaps"}, {"verdict": None}, {"estimates": {}}])
def test_what_is_no_diagnosis_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="expected a diagnosis"):
        set_from_diagnosis(wrong)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3), max_leaves=5,
)  # fmt: skip


def paths(content: Any, before: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """To every place in nested values."""
    inside: Iterable[tuple[Any, Any]] = ()
    if isinstance(content, dict):
        inside = cast(dict[Any, Any], content).items()
    elif isinstance(content, list):
        inside = enumerate(cast(list[Any], content))
    for key, value in inside:
        yield (*before, key)
        yield from paths(value, (*before, key))


@given(st.data())
def test_no_content_makes_a_traceback(data: st.DataObject) -> None:
    said = data.draw(st.sampled_from([content(EXPLAINED), together_as_json(diagnosed(BOTH))]))
    *way, last = data.draw(st.sampled_from(list(paths(said))))
    at: Any = said
    for key in way:
        at = at[key]
    at[last] = data.draw(ANYTHING)
    try:
        made = set_from_diagnosis(said, {}, own_gains=True, electrical_turn=0)
    except (ConfigError, LimitError):
        return
    if made.set.entries:
        assert parse(as_toml(made.set), "x").values == made.set.values
