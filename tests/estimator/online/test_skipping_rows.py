"""Rows that skip control periods: emulated recordings, of which one row in several is kept."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, PAPER_RUN, Excitation
from estimator.machine import PARAMETERS
from estimator.online import skipping_rows
from estimator.online.estimate import Status
from estimator.online.skipping_rows import Skipping
from estimator.samples import Samples

TRUTH = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
T_S = 1e-4
LEVELS = replace(PAPER_RUN, excitation=Excitation(i_d_step=2.0, i_q_step=2.0, step_time=20e-3))
FAST = replace(PAPER_RUN, excitation=Excitation(i_d_step=2.0, i_q_step=2.0, step_time=2e-3))
SINES = replace(
    PAPER_RUN,
    excitation=Excitation(i_d_step=2.0, i_q_step=2.0, kind="multisine", sine_frequency=2.0, sine_count=8),
)
PRBS = Excitation(i_d_step=2.0, i_q_step=2.0, step_time=5e-3, kind="prbs")
SATURATED = NONE._replace(saturation=Saturation(L_d_drop=0.15, L_q_drop=0.3))
DEAD = replace(LEVELS, effects=NONE._replace(inverter=Inverter(dead_time=1.5e-6)))


SCENARIOS = {
    "levels": LEVELS, "fast": FAST, "sines": SINES, "dead": DEAD,
    "dead_prbs": replace(DEAD, excitation=PRBS), "sagging": replace(LEVELS, effects=SATURATED),
    "dead_sine": replace(
        DEAD, excitation=Excitation(i_d_step=2.0, i_q_step=2.0, kind="multisine", sine_frequency=20.0, sine_count=1)
    ),
    "standstill": replace(LEVELS, run=replace(PAPER.run, speed_rpm=0.0)),
    "q": replace(LEVELS, excitation=Excitation(i_q_step=2.0, step_time=20e-3)),
    "work": replace(LEVELS, excitation=Excitation()),
}  # fmt: skip


@cache
def columns(scenario: str) -> Mapping[str, NDArray[np.float64]]:
    return VirtualDrive(SCENARIOS[scenario]).record(60_000)


def kept(scenario: str, one_in: int, *, q_only: bool = False) -> Samples:
    c = {name: np.ascontiguousarray(column[::one_in]) for name, column in columns(scenario).items()}
    none = np.zeros(len(c["t"]))
    i_d, u_d = (none, none) if q_only else (c["i_d"], c["u_d"])
    return Samples(c["theta_e"], c["omega_e"], i_d, c["i_q"], u_d, c["u_q"], T_S, one_in, q_only=q_only)


def said(samples: Samples, T_s: float = T_S, piece: int | None = None) -> Skipping:
    state = skipping_rows.init(T_s)
    for begin in range(0, len(samples), piece or len(samples)):
        skipping_rows.update(state, samples[begin : begin + (piece or len(samples))], joined=begin > 0)
    return skipping_rows.estimate(skipping_rows.finish(state))


@pytest.mark.parametrize(
    ("scenario", "one_in"), [("levels", 5), ("levels", 10), ("levels", 20), ("sines", 5), ("sines", 10)]
)
def test_parameters_within_half_a_per_cent(scenario: str, one_in: int) -> None:
    found = said(kept(scenario, one_in))
    assert not found.mismatch
    for name, true in TRUTH.items():
        e = found.result.estimates[name]
        assert e.status is Status.OK, e
        assert e.value == pytest.approx(true, rel=5e-3)
        assert abs((e.value or 0.0) - true) < 3.5 * (e.std or 0.0)
        assert (e.std or 1.0) < 3e-3 * true


@pytest.mark.parametrize("one_in", [10, 20, 50])
def test_currents_that_move_faster_than_rows_come_tell_no_inductance(one_in: int) -> None:
    estimates = said(kept("fast", one_in)).result.estimates
    for name in ("R_s", "L_d", "L_q"):
        assert estimates[name].status is Status.NOT_TOLD
        assert "faster than rows come" in estimates[name].reason
        assert estimates[name].value is None


@pytest.mark.parametrize("scenario", ["dead", "dead_prbs", "dead_sine", "sagging"])
def test_what_the_equation_leaves_out_is_a_mismatch(scenario: str) -> None:
    found = said(kept(scenario, 10))
    assert found.mismatch
    assert found.significance > 6.0


def test_a_motor_that_stands_tells_its_resistance() -> None:
    found = said(kept("standstill", 10)).result.estimates
    assert found["R_s"].status is Status.OK
    assert found["R_s"].value == pytest.approx(TRUTH["R_s"], rel=5e-3)
    assert found["psi_f"].status is Status.NOT_TOLD
    assert "it acts nowhere" in found["psi_f"].reason


def test_the_same_in_whatever_pieces_rows_come() -> None:
    samples = kept("levels", 10)
    whole = said(samples).result.estimates
    for piece in (3000, 1024, 7):
        found = said(samples, piece=piece).result.estimates
        for name in PARAMETERS:
            assert found[name].value == pytest.approx(whole[name].value, rel=1e-9)
            assert found[name].std == pytest.approx(whole[name].std, rel=1e-6)


def test_a_gap_joins_nothing() -> None:
    samples = kept("levels", 10)
    state = skipping_rows.init(T_S)
    skipping_rows.update(state, samples[:2500], joined=False)
    skipping_rows.update(state, samples[2700:], joined=False)
    found = skipping_rows.estimate(skipping_rows.finish(state)).result
    assert found.gaps == 1
    assert found.samples == len(samples) - 200
    for name, true in TRUTH.items():
        assert found.estimates[name].value == pytest.approx(true, rel=5e-3)


def test_what_is_held_stays_and_helps() -> None:
    state = skipping_rows.finish(skipping_rows.update(skipping_rows.init(T_S), kept("levels", 10)))
    alone = skipping_rows.estimate(state).result.estimates["R_s"]
    found = skipping_rows.estimate(state, ("R_s", "L_d", "L_q"), {"psi_f": 0.12}).result.estimates
    assert found["psi_f"].status is Status.HELD
    assert found["R_s"].value == pytest.approx(TRUTH["R_s"], rel=3e-3)
    assert (found["R_s"].std or 1.0) < (alone.std or 0.0)
    with pytest.raises(ValueError, match="psi_f is not estimated and so needs a held value"):
        skipping_rows.estimate(state, ("R_s", "L_d", "L_q"))


def test_the_q_axis_alone() -> None:
    found = said(kept("q", 10, q_only=True)).result.estimates
    assert found["L_d"].status is Status.NOT_TOLD
    for name in ("R_s", "psi_f"):
        assert found[name].status is Status.OK
        assert found[name].value == pytest.approx(TRUTH[name], rel=1e-2)


def test_a_drive_at_work_tells_what_its_load_moves() -> None:
    found = said(kept("work", 10)).result.estimates
    assert found["L_d"].status is Status.NOT_TOLD
    for name in ("R_s", "L_q", "psi_f"):
        e = found[name]
        assert e.status is Status.OK
        assert abs((e.value or 0.0) - TRUTH[name]) < 3.0 * (e.std or 0.0)


def test_few_rows_tell_nothing() -> None:
    few = said(kept("levels", 10)[:60])
    assert {e.status for e in few.result.estimates.values()} == {Status.NO_DATA}
