"""A set from estimates: intervals, statuses, and what temperature makes of R_s and psi_f."""

from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import ConfigError
from bench.parameters.from_estimates import set_from_estimates
from bench.parameters.parameter_set import as_toml, parse

UNITS = {"R_s": "ohm", "L_d": "H", "L_q": "H", "psi_f": "Vs"}


def estimate(name: str, value: float | None, std: float | None, status: str = "ok", reason: str = "") -> dict[str, Any]:
    return {"name": name, "value": value, "std": std, "unit": UNITS[name], "status": status, "reason": reason}


ESTIMATES = {
    "R_s": estimate("R_s", 1.2, 1e-3), "L_d": estimate("L_d", 4e-3, 1e-6, "doubtful", "the equations do not fit"),
    "L_q": estimate("L_q", 6e-3, None, "held", "held at the given value"),
    "psi_f": estimate("psi_f", 0.11, 1e-5),
}  # fmt: skip
REPLAY = {
    "estimates": ESTIMATES, "recording": {"path": "runs/run.parquet"},
    "temperatures_degC": {"temp_winding": 70.0, "temp_magnet": 60.0},
}


def test_values_have_their_intervals_and_statuses() -> None:
    made = set_from_estimates(REPLAY, serial=3)
    assert made.remarks == ()
    assert (made.set.name, made.set.serial) == ("estimates of run.parquet", 3)
    told = made.set.entries
    R_s, L_d, L_q = (told[f"control_{name}"] for name in ("R_s", "L_d", "L_q"))
    assert (R_s.value, R_s.status, R_s.source) == (1.2, "ok", "estimates of run.parquet")
    assert (R_s.low, R_s.high) == pytest.approx((1.19804, 1.20196))
    assert (L_d.status, L_d.source) == ("doubtful", "estimates of run.parquet; the equations do not fit")
    assert (L_q.status, L_q.low) == ("held", None)
    assert parse(as_toml(made.set), "x") == made.set


def test_what_it_is_at_20_degrees_stands_beside() -> None:
    told = set_from_estimates(REPLAY).set.entries
    R_s, psi_f = told["control_R_s"], told["control_psi_f"]
    assert (R_s.at_degC, R_s.at_20_degC) == (70.0, pytest.approx(1.2 / (1 + 0.00393 * 50)))
    assert R_s.note == "at 20 degC: copper, 0.393 %/K"
    assert (psi_f.at_degC, psi_f.at_20_degC) == (60.0, pytest.approx(0.11 / (1 - 0.0011 * 40)))
    assert psi_f.note == "at 20 degC: magnets of -0.11 %/K, typical of NdFeB"
    assert told["control_L_d"].note == ""
    own = set_from_estimates(REPLAY, magnets=-0.002).set.entries["control_psi_f"]
    assert (own.at_20_degC, own.note) == (pytest.approx(0.11 / 0.92), "at 20 degC: magnets of -0.2 %/K")


def test_without_a_temperature_that_is_said() -> None:
    told = set_from_estimates({"estimates": ESTIMATES, "drive": "spindle"}).set.entries
    assert told["control_R_s"].source == "estimates of spindle"
    assert told["control_R_s"].at_20_degC is None
    assert told["control_R_s"].note == (
        "no temperature of the winding was recorded: what it is at 20 degC is not known"
    )
    given_ = set_from_estimates({"estimates": ESTIMATES}, temperatures={"temp_winding": 20.0}).set.entries
    assert given_["control_R_s"].at_20_degC == 1.2
    assert "magnets" in given_["control_psi_f"].note


def test_a_snapshot_tells_the_drives_temperatures() -> None:
    snapshot = {
        "drive": {"name": "spindle", "latest": {"temp_winding": 30.0, "temp_magnet": None}},
        "estimates": {"drive": "spindle", "estimates": ESTIMATES},
    }
    told = set_from_estimates(snapshot).set.entries
    assert (told["control_R_s"].at_degC, told["control_psi_f"].at_degC) == (30.0, None)
    assert told["control_R_s"].source == "estimates of spindle"


def test_what_is_not_told_is_left_out_with_its_reason() -> None:
    there = ESTIMATES | {
        "psi_f": estimate("psi_f", None, None, "not_told", "psi_f cannot be told here: the motor stands still"),
        "R_s": estimate("R_s", float("nan"), 1.0), "L_q": {"value": 6e-3, "std": None, "status": "ok"},
    }  # fmt: skip
    made = set_from_estimates({"estimates": there})
    assert made.remarks == (
        "control_R_s is left out: R_s is not told",
        "control_psi_f is left out: psi_f cannot be told here: the motor stands still",
    )
    assert made.set.entries["control_L_q"].status == "doubtful"


@pytest.mark.parametrize("wrong", [{}, {"estimates": None}, {"estimates": {"x": 1}}, {"verdict": "explained"}])
def test_what_holds_no_estimates_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="expected estimates of R_s, L_d, L_q, psi_f"):
        set_from_estimates(wrong)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(["value", "std", "status", "reason", "R_s", "latest", "temp_winding", "path", "estimates"]),
        inner, max_size=4,
    ), max_leaves=12,
)  # fmt: skip


@given(ANYTHING, ANYTHING, ANYTHING, ANYTHING)
def test_no_content_makes_a_traceback(estimates: Any, drive: Any, recording: Any, R_s: Any) -> None:
    given_: Any = cast(dict[str, Any], estimates) | {"R_s": R_s} if isinstance(estimates, dict) else estimates
    try:
        made = set_from_estimates({"estimates": given_, "drive": drive, "recording": recording})
    except ConfigError:
        return
    if made.set.entries:
        assert parse(as_toml(made.set), "x") == made.set
