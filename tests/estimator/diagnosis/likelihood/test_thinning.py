"""Long recordings: blocks of their rows find the model, and what no block holds is seen all the same."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.conceal.recording import Choice
from emulator.conceal.suite import Suite, make
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.likelihood.columns import regression
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.thinning import PARTS, in_parts, settled, thinned
from estimator.diagnosis.verdict import Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Resolution, Samples
from estimator.twin.model import Model
from tests.score.diagnosed import loaded

T_s = 1e-4
BLOCKS = 96
MACHINE = Machine(0.5, 1.5e-3, 2e-3, 0.07, 4, 9.0)


def long_rows(n: int) -> Rows:
    t = T_s * np.arange(n)
    omega = 300.0 + 100.0 * np.sin(t)
    random = np.random.default_rng(1)
    i_d, i_q, u_d, u_q = random.normal(0.0, 1.0, (4, n))
    run = Samples(
        np.mod(np.cumsum(omega) * T_s, 2.0 * np.pi), omega, i_d, i_q, u_d, u_q, T_s=T_s, resolution=Resolution(0, 0, 0),
        u_dc=np.full(n, 300.0),
    )  # fmt: skip
    return rows_of([run], MACHINE, 9.0)


def test_blocks_are_rows_as_they_are_from_the_first_to_the_last() -> None:
    rows = long_rows(30_001)
    part = thinned(rows, 9600, BLOCKS)
    assert len(part) == 9600 + BLOCKS - 1  # and the seams
    assert part.t[0] == rows.t[0]
    assert part.t[-1] == rows.t[-1]
    first = np.rint((part.t - rows.t[0]) / T_s).astype(int)
    assert np.all(np.diff(first)[part.joined] == 1)
    assert np.count_nonzero(np.diff(first) > 1) == BLOCKS - 1
    assert np.count_nonzero(~part.joined) == BLOCKS - 1 + 10 * BLOCKS  # and where a block of 100 begins
    of = first[:-1]
    for name in ("u", "half"):
        assert np.array_equal(getattr(part, name), getattr(rows, name)[of])
    assert np.array_equal(part.duties, rows.duties[of])
    for name in ("i", "theta_e", "rotor", "heat"):  # the heat is that of all rows so far
        assert np.array_equal(getattr(part, name), getattr(rows, name)[first])
    assert part.span == rows.span


def gapped_rows(gaps: int) -> Rows:
    rows = long_rows(30_001)
    t, joined = rows.t.copy(), rows.joined.copy()
    for k in np.linspace(1_000, 29_000, gaps).astype(int):
        joined[k] = False
        t[k + 1 :] += T_s
    return replace(rows, t=t, joined=joined)


@pytest.mark.parametrize(("gaps", "after"), [(1, 12), (100, 12), (500, 2), (1_000, 0)])
def test_what_is_next_to_a_gap_does_not_count_as_long_as_that_is_little(gaps: int, after: int) -> None:
    rows = gapped_rows(gaps)
    left_out = ~settled(rows).joined
    at = np.flatnonzero(~rows.joined)
    assert all(left_out[k - 1 : k + after + 1].all() for k in at)
    assert not any(left_out[k + after + 1] or left_out[k - 2] for k in at)


def test_blocks_lie_at_all_places_of_what_comes_again_and_again() -> None:
    rows = long_rows(96_001)
    first = np.rint((thinned(rows, 9600, BLOCKS).t - rows.t[0]) / T_s).astype(int)
    assert np.all(np.histogram(first % 1000, 20, (0, 1000))[0] > 0.4 * len(first) / 20)


def test_what_effects_remember_is_the_same_a_stretch_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = settled(long_rows(60_001))
    given = Given(MACHINE, dict.fromkeys(PARAMETERS, 0.1), 0.0)
    for effects in ({}, {"ac_resistance": (0.5, 60.0), "winding_resistance_drift": (0.1, 1.0, 0.0)}):
        model = Model(MACHINE, effects)
        whole = regression(rows, rows, model, given)
        monkeypatch.setattr("estimator.diagnosis.likelihood.columns._LONG_RECORDING", 10_000)
        parts = regression(rows, rows, model, given)
        monkeypatch.undo()
        size = np.sqrt(np.einsum("sii->i", whole.gram))
        off = np.abs(parts.gram - whole.gram) / np.maximum(np.outer(size, size), 1e-300)
        assert off.max() < 1e-9, (effects, [whole.columns[k] for k in np.argsort(-off.max((0, 1)))[:3]])


def test_few_rows_stay_as_they_are() -> None:
    rows = long_rows(9000)
    assert thinned(rows, 9000, BLOCKS) is rows
    assert in_parts(rows) == [rows]


def test_many_rows_come_few_first() -> None:
    rows = long_rows(150_001)
    few, more, whole = in_parts(rows)
    assert len(few) == pytest.approx(16_000, abs=100)
    assert len(more) == pytest.approx(64_000, abs=100)
    assert whole is rows


def concealed(folder: Path, kind: str, seed: int) -> tuple[list[Samples], Machine]:
    """A recording of 60 s."""
    make(Suite(Choice(seed, (kind,), (0.5, 1.0), ("servo_4nm",), 60.0), 1, folder / "out", folder / "answers", 1),
         lambda _count: None)  # fmt: skip
    return loaded(folder / "out", "0001")


@pytest.mark.slow
def test_a_long_recording_tells_its_effects(tmp_path: Path) -> None:
    found = diagnose(*concealed(tmp_path, "two", 1950))
    assert found.verdict is Verdict.EXPLAINED
    assert {finding.effect for finding in found.findings} == {"winding_resistance_drift", "current_sensor_gain"}


@pytest.mark.slow
def test_a_burst_between_the_blocks_is_left_unexplained(tmp_path: Path) -> None:
    runs, nominal = concealed(tmp_path, "none", 79)
    (run,) = runs
    part = thinned(rows_of([run], nominal, 9.0), *PARTS[-1])
    gap = int(np.argmax(np.diff(part.t)))
    begin, end = float(part.t[gap]), float(part.t[gap + 1])
    t = run.t0 + run.T_s * np.arange(len(run))
    burst = (t > begin + 0.05) & (t < min(end - 0.05, begin + 0.25))
    assert np.count_nonzero(burst) > 1000
    found = diagnose([replace(run, u_d=run.u_d + 2.0 * burst)], nominal)
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.unexplained is not None
    told = found.unexplained.where.region["time"]
    assert isinstance(told, tuple)
    low, high = told
    assert low < float(t[burst][0]) + 0.05
    assert high > float(t[burst][-1]) - 0.05
