"""Gains by rule in a set: for its machine, or the drive's, all or none of them."""

import pytest

from bench.errors import LimitError
from bench.parameters.parameter_set import Entry, ParameterSet, as_toml, parse
from bench.parameters.tuned import tuned_set
from bench.parameters.tuning import current_loop, speed_loop

T_S = 1e-4
GIVEN = ParameterSet("servo", {
    "control_R_s": Entry(0.97, 0.96, 0.98), "control_L_d": Entry(4e-3), "control_L_q": Entry(6e-3),
    "control_psi_f": Entry(0.12), "dead_time": Entry(2e-6),
}, 3, serial=5)  # fmt: skip
DRIVE = {"n_p": 4.0, "speed_filter": 1e-3, "control_R_s": 7.0}


def test_the_set_keeps_what_it_has_and_gets_the_gains_of_the_rule() -> None:
    made = tuned_set(GIVEN, {}, T_S, bandwidth=1000.0)
    assert made.set.values == GIVEN.values | dict(current_loop(0.97, 4e-3, 6e-3, T_S, 1000.0).values)
    assert (made.set.name, made.set.version, made.set.serial) == ("servo", 3, 5)
    assert made.set.entries["control_R_s"] == GIVEN.entries["control_R_s"]
    assert made.set.entries["k_p_d"].source == "tuned by rule"
    assert made.remarks == ("current control: 1000 rad/s, phase margin 81.4 deg",)
    assert parse(as_toml(made.set), "x") == made.set


def test_an_inertia_asks_for_the_speed_control_with_what_the_drive_has() -> None:
    made = tuned_set(GIVEN, DRIVE, T_S, J=2e-3, a=3.0)
    alpha = 1.0 / (3.0 * T_S)
    speed = speed_loop(2e-3, 0.12, 4, 1.0 / alpha + 1e-3 + 0.5 * T_S, a=3.0)
    assert {name: made.set.values[name] for name in speed.values} == speed.values
    assert made.set.values["k_i_d"] == pytest.approx(alpha * 0.97)  # the set's before the drive's
    assert made.remarks[1].startswith(f"speed control: {speed.bandwidth:.4g} rad/s, phase margin 53.1 deg")


def test_gains_of_doubtful_values_are_doubtful_and_tables_are_spoken_of() -> None:
    entries = {**GIVEN.entries, "control_L_q": Entry(6e-3, status="doubtful"), "saturation_correction": Entry(1.0)}
    made = tuned_set(ParameterSet("servo", entries), {}, T_S)
    assert made.set.entries["k_p_q"].status == "doubtful"
    assert made.set.entries["k_p_q"].source == "tuned by rule from doubtful control_L_q"
    assert "where tables say less" in made.remarks[1]


@pytest.mark.parametrize(("T_s", "more", "said"), [
    (None, {}, "gains need the control period: expected of the drive, or told"),
    (T_S, {"J": 1e-3}, "gains need n_p, speed_filter: expected in the set, or of the drive"),
    (T_S, {"bandwidth": 1e5}, "bandwidth: expected at most 3333 rad/s"),
    (0.0, {}, "expected a control period above zero"),
    (1e-6, {}, "current control: 0x2200:6"),
])
def test_what_cannot_be_is_a_sentence(T_s: float | None, more: dict[str, float], said: str) -> None:
    with pytest.raises(LimitError, match=said):
        tuned_set(GIVEN, {}, T_s, **more)
