"""What a replay judges of a recording, and which rows it leaves out: windows of the emulated drive's stream."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bench.live.watch import Explained
from bench.live.window import Window
from bench.recordings.judgement import Judgement, Verdict
from bench.recordings.runs import Chunk
from bench.recordings.screen import ROWS as LOOKED_AT
from bench.recordings.screen import Screen
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.timing import Timing
from emulator.scenario.effects import Effects
from emulator.scenario.scenarios import PAPER
from estimator.samples import Samples
from tests.estimator.diagnosis.intake.test_answered import in_loop
from tests.estimator.diagnosis.test_watch import paper, windows

NOMINAL = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}


def judged(runs: Iterator[Samples] | list[Samples], **nominal: float) -> Judgement:
    judgement = Judgement(Window(), nominal)
    for run in runs:
        judgement.take(run)
    return judgement


@pytest.fixture(scope="module")
def plain() -> list[Samples]:
    return list(windows(paper(), 4))


@pytest.mark.parametrize("parts", [1, 3])
def test_a_drive_like_the_equations_is_explained_whatever_the_chunks(plain: list[Samples], parts: int) -> None:
    chunks = [run[k * len(run) // parts : (k + 1) * len(run) // parts] for run in plain for k in range(parts)]
    said = judged(chunks, **NOMINAL).verdict()
    assert (said.status, said.unexplained) == (Explained.YES, 0)


def test_a_dead_time_is_not_explained_from_its_first_window_on() -> None:
    runs = list(windows(paper(Effects(inverter=Inverter(dead_time=2e-6))), 4))
    judgement = judged(runs, **NOMINAL)
    said = judgement.verdict()
    assert said.status is Explained.NO
    assert said.since == pytest.approx(runs[0].t0)
    assert "the model does not explain the recording" in said.sentence()
    rows = sum(map(len, runs))
    assert judgement.concerns(rows, 10)
    assert judgement.concerns(rows, None)


def test_constant_currents_cannot_be_told() -> None:
    still = replace(PAPER, excitation=replace(PAPER.excitation, kind="none", i_q_ref=3.0))
    said = judged(windows(still, 2)).verdict()
    assert said.status is Explained.NOT_TOLD
    assert said.sentence().startswith("whether the equations fit cannot be told: ")


@pytest.mark.parametrize("timing", [Timing(delay=-1), Timing(shift=1)])
def test_voltages_that_answer_their_own_rows_tell_nothing_at_one_point_and_are_doubted(timing: Timing) -> None:
    judgement = judged([in_loop(timing, 65.0)], **NOMINAL)
    said = judgement.verdict()
    assert said.status is Explained.NOT_TOLD
    assert "the recorded voltage answers the same row's current noise with 65.0 V/A" in said.sentence()
    if timing.shift:  # where parameters would be told that are none of the machine
        assert judgement.concerns(judgement.done, None)


def test_nothing_is_judged_of_nothing() -> None:
    assert Judgement(Window(), {}).verdict() == Verdict()


# --- rows that are left out


def chunked(samples: Samples, size: int) -> Iterator[Chunk]:
    for begin in range(0, len(samples), size):
        yield Chunk(samples[begin : begin + size], 1, begin > 0)


def screened(samples: Samples, size: int) -> tuple[list[Chunk], tuple[str, ...]]:
    screen = Screen()
    chunks = [left for chunk in chunked(samples, size) for left in screen.take(chunk)]
    return [*chunks, *screen.finish()], screen.remarks()


def test_rows_that_no_machine_makes_are_left_out_and_told_and_nothing_else_is(plain: list[Samples]) -> None:
    samples, bad = plain[0], len(plain[0]) // 2
    i_q = samples.i_q.copy()
    i_q[bad] += 50.0
    chunks, (remark,) = screened(replace(samples, i_q=i_q), 1000)
    begins = [round((chunk.samples.t0 - samples.t0) / samples.T) for chunk in chunks]
    there = {begin + k for begin, chunk in zip(begins, chunks, strict=True) for k in range(len(chunk.samples))}
    gone = set(range(len(samples))) - there
    assert bad in gone | {row + 1 for row in gone}
    assert len(gone) <= 2
    assert "does not go with those around it" in remark


@pytest.mark.parametrize("size", [999, LOOKED_AT])
def test_a_sound_recording_passes_as_it_is(plain: list[Samples], size: int) -> None:
    samples = plain[0]
    chunks, remarks = screened(samples, size)
    assert remarks == ()
    assert np.array_equal(np.concatenate([chunk.samples.i_q for chunk in chunks]), samples.i_q)
    assert all(after.joined for _, after in pairwise(chunks))
