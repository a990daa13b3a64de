"""Bad samples: what no machine makes is left out and told, and what a machine makes is not."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from emulator.conceal.populations import POPULATIONS
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.bad_samples import without_bad
from estimator.diagnosis.verdict import Verdict
from estimator.diagnosis.words import number as in_words
from estimator.samples import Samples
from tests.estimator.diagnosis.convention_runs import made, recording, scaled, shifted, some_soon

pytestmark = pytest.mark.thorough

COLUMNS: tuple[str, ...] = ("i_d", "i_q", "u_d", "u_q")


def with_rows(run: Samples, at: Mapping[int, Mapping[str, float]]) -> Samples:
    """A run with other values in some rows."""
    columns = {name: getattr(run, name).copy() for name in COLUMNS}
    for row, values in at.items():
        for name, value in values.items():
            columns[name][row] = value
    return replace(run, **columns)


CHATTER = {"over_compensated": 4}
"""Rows of 20,000: a voltage error whose sign chatters as a current crosses zero is, for a row, as a sample of it is."""


@pytest.mark.parametrize("kind", some_soon(["none", "two", "three", *POPULATIONS]))
def test_no_row_of_a_machine_is_left_out_whatever_its_physics(kind: str) -> None:
    for number in range(1, 7):
        runs, nominal = recording(kind, number, seed=31, length=1.0)
        left = without_bad(runs, nominal)
        if kind in CHATTER:
            assert sum(map(len, runs)) - sum(map(len, left.runs)) <= CHATTER[kind], (kind, number, left.remarks)
        else:
            assert left.remarks == (), (kind, number)
            assert left.runs == runs


@pytest.mark.parametrize("number", [1, 2, 3, 5, 8])
def test_a_current_that_jumps_and_returns_is_left_out_with_its_value_and_its_time(number: int) -> None:
    runs, nominal = recording("none", number)
    run = max(runs, key=len)
    high = 2.5 * (nominal.i_rated or 1.0)
    before, after = (run.i_q[k] for k in (1999, 2001))
    left = without_bad([with_rows(run, {2000: {"i_q": high}})], nominal)
    assert left.remarks == (
        f"i_q jumps to {in_words(high)} A at {run.t0 + 2000 * run.T:.6g} s and back: 1 row left out",
    )
    assert [len(part) for part in left.runs] == [2000, len(run) - 2001]
    assert (left.runs[0].i_q[-1], left.runs[1].i_q[0]) == (before, after)
    assert left.runs[1].t0 == pytest.approx(run.t0 + 2001 * run.T)


def test_a_current_that_stays_where_it_jumped_to_is_kept() -> None:
    (run, *_), nominal = recording("none", 1)
    stepped = replace(run, i_q=np.where(np.arange(len(run)) < 5000, run.i_q, run.i_q + 10.0 * (nominal.i_rated or 1.0)))
    assert without_bad([stepped], nominal).remarks == ()


def test_neighbouring_samples_of_kiloamperes_are_left_out_together() -> None:
    (run, *_), nominal = recording("none", 1)
    bad = with_rows(run, {5000: {"i_q": 1e4}, 5001: {"i_d": -1e4}, 900: {"i_d": 1e4}})
    (said,) = without_bad([bad], nominal).remarks
    assert "i_d jumps to 10000 A" in said
    assert said.endswith("and back, and likewise 1 time more: 3 rows left out")


def test_a_voltage_that_the_dc_link_cannot_give_is_left_out_where_it_is_rare() -> None:
    (run, *_), nominal = recording("none", 1)
    assert run.u_dc is not None
    (said,) = without_bad([with_rows(run, {700: {"u_q": 5000.0}})], nominal).remarks
    assert said.startswith(f"u_q is 5000 V at {run.t0 + 700 * run.T:.6g} s, beyond what u_dc = ")
    assert said.endswith(" V can give: 1 row left out")
    for often in (scaled(u=1e3), scaled(u=np.sqrt(3.0))):
        assert without_bad(*made(often, ((run,), nominal))).remarks == ()


@pytest.mark.parametrize("value", [0.0, 31000.0, -310.0, 100.0])
def test_a_dc_link_that_jumps_and_returns_is_left_out(value: float) -> None:
    (run, *_), nominal = recording("none", 1)
    assert run.u_dc is not None
    u_dc = run.u_dc.copy()
    u_dc[800] *= value / 310.0
    (said,) = without_bad([replace(run, u_dc=u_dc)], nominal).remarks
    assert said == f"u_dc jumps to {in_words(u_dc[800])} V at {run.t0 + 800 * run.T:.6g} s and back: 1 row left out"


def test_a_current_that_jumps_by_less_than_others_may_is_left_out() -> None:
    (run, *_), nominal = recording("none", 1)
    by = 0.2 * (nominal.i_rated or 1.0)
    (said,) = without_bad([with_rows(run, {2000: {"i_q": run.i_q[2000] + by}})], nominal).remarks
    assert said.startswith(f"the row at {run.t0 + 2000 * run.T:.6g} s (i_d = ")
    assert "leaves those around it, by over 6 times the noise, and returns as no motor does: 1 row left" in said


def test_rows_of_zeros_while_the_motor_turns_and_rows_that_repeat_are_left_out() -> None:
    (run, *_), nominal = recording("none", 1)
    gone = {row: dict.fromkeys(COLUMNS, 0.0) for row in range(6000, 6020)}
    left = without_bad([with_rows(run, gone)], nominal)
    assert [len(part) for part in left.runs] == [6000, len(run) - 6020]
    assert "i_d, i_q, u_d and u_q are all 0 from" in left.remarks[0]
    stuck = {row: {name: getattr(run, name)[7000] for name in COLUMNS} for row in range(7001, 7300)}
    for angle in (run.theta_e, np.full(len(run), 0.3)):
        left = without_bad([replace(with_rows(run, stuck), theta_e=angle)], nominal)
        assert "i_d, i_q, u_d and u_q do not change at all from" in left.remarks[0]
        assert left.remarks[0].endswith(": 299 rows left out")


def test_a_recording_that_is_not_alive_keeps_its_rows() -> None:
    (run, *_), nominal = recording("none", 1)
    still = np.full(len(run), 1.0)
    still[: len(run) // 4] = np.linspace(0.0, 1.0, len(run) // 4)
    assert without_bad([replace(run, i_d=still, i_q=still, u_d=still, u_q=still)], nominal).remarks == ()


def test_voltages_that_stand_in_another_row_make_no_current_a_glitch() -> None:
    for late in (-2, 1, 2):
        assert without_bad(*made(shifted(("u_d", "u_q"), late), recording("none", 3))).remarks == ()


def test_values_that_are_no_numbers_are_left_to_the_check_of_columns() -> None:
    (run, *_), nominal = recording("none", 1)
    bad = with_rows(run, {5000: {"i_q": np.nan}})
    assert without_bad([bad], nominal) == ((bad,), ())


def test_a_diagnosis_is_the_same_with_bad_samples_and_tells_them() -> None:
    (run, *_), nominal = recording("none", 3, length=1.0)
    bad = with_rows(run, {900: {"i_q": 1e4}, 2000: {"u_d": -5000.0}})
    said = diagnose([bad], nominal)
    assert said.verdict is Verdict.NO_MISMATCH
    assert [remark.partition(" ")[0] for remark in said.remarks] == ["u_d", "i_q"]
