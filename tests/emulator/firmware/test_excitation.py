"""The excitation's sequences: their levels, lengths, spectra, and what of them a drive's currents show."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.firmware.excitation import (
    AXIS_AT_REST,
    KINDS,
    MOST_SINES,
    PRBS_LENGTH,
    Axis,
    climbed,
    fraction,
    jumped,
    multisine,
)
from emulator.scenario.scenarios import PAPER, Scenario, parse

MOTOR = "[motor]\nR_s = 0.5\nL_d = 2e-3\nL_q = 3e-3\npsi_f = 0.1\nn_p = 3\ni_rated = 10\n"


def excited(kind: str, **given: object) -> Scenario:
    """The paper's drive without noise under another sequence."""
    fields: dict[str, object] = {"i_d_step": 2.0, "i_q_step": 1.0, "i_q_ref": 1.0, **given}
    excitation = replace(PAPER.excitation, kind=kind, **fields)  # pyright: ignore[reportArgumentType]
    return replace(PAPER, drive=replace(PAPER.drive, noise_i=0.0, adc_bits=0), excitation=excitation)


def steps(move: Callable[[Axis], Axis]) -> Iterator[Axis]:
    axis = AXIS_AT_REST
    while True:
        axis = move(axis)
        yield axis


def taken(count: int, every: int, levels: int, move: Callable[[Axis], Axis]) -> list[float]:
    """Fractions, one a hold of `every` periods, which must be steady in between."""
    axes = steps(move)
    held = [[fraction(next(axes), levels) for _ in range(every)] for _ in range(count)]
    assert all(len(set(group)) == 1 for group in held)
    return [group[0] for group in held]


def test_a_prbs_is_a_maximum_length_sequence_that_its_other_half_does_not_resemble() -> None:
    d = np.array(taken(2 * PRBS_LENGTH, 3, 2, lambda axis: jumped(axis, 3, 1, PRBS_LENGTH // 2)))
    q = np.array(taken(PRBS_LENGTH, 3, 2, lambda axis: jumped(axis, 3, 1, 0)))
    assert d[:PRBS_LENGTH].tolist() == d[PRBS_LENGTH:].tolist()
    d = d[:PRBS_LENGTH]
    assert d.sum() == 1.0  # of 511 bits one more is set
    assert d.tolist() == np.roll(q, -(PRBS_LENGTH // 2)).tolist()
    products = [float(d @ np.roll(d, lag)) for lag in range(PRBS_LENGTH)]
    assert products == [511.0] + 510 * [-1.0]  # Golomb's two-level autocorrelation
    assert d @ q == -1.0


def test_another_seed_starts_a_prbs_elsewhere() -> None:
    starts = [taken(30, 1, 2, lambda axis, seed=seed: jumped(axis, 1, seed, 0)) for seed in range(5)]
    assert len({tuple(start) for start in starts}) == 5


def test_a_staircase_climbs_and_descends_and_holds_every_level() -> None:
    assert taken(10, 4, 5, lambda axis: climbed(axis, 4, 5)) == [
        -1.0, -0.5, 0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5
    ]
    assert taken(4, 1, 2, lambda axis: climbed(axis, 1, 2)) == [-1.0, 1.0, -1.0, 1.0]


@pytest.mark.parametrize("count", range(1, MOST_SINES + 1))
@pytest.mark.parametrize("first", [1, 2])
def test_a_multisine_has_its_harmonics_alike_and_no_other_and_a_low_crest(first: int, count: int) -> None:
    x = np.array([multisine(first, count, 2.0, k / 2.0 / 4096) for k in range(4096)])
    assert np.abs(x).max() == pytest.approx(1.0, abs=2e-3)
    lines = np.abs(np.fft.rfft(x)) / 2048
    harmonics = first + 2 * np.arange(count)
    assert lines[harmonics] == pytest.approx(lines[first], rel=1e-9)
    assert np.delete(lines, harmonics) == pytest.approx(0.0, abs=1e-12)
    assert 1.0 / np.sqrt(np.mean(x * x)) < 2.2  # all at phase 0 it would be sqrt(2 count), up to 5.7


def test_the_currents_follow_a_multisine_on_lines_of_their_own() -> None:
    drive = VirtualDrive(excited("multisine", sine_frequency=5.0, sine_count=4))
    drive.run(2000)
    r = drive.record(10000)  # 1 s: five periods, lines of 1 Hz
    d, q = (np.abs(np.fft.rfft(r[name])) / 5000 for name in ("i_d", "i_q"))
    own_d, own_q = [5, 15, 25, 35], [10, 20, 30, 40]
    assert d[own_d].min() > 0.5
    assert q[own_q].min() > 0.25
    assert d[own_q].max() < 0.02 * d[own_d].max()
    assert q[own_d].max() < 0.02 * q[own_q].max()
    assert np.abs(r["i_d"]).max() < 2.1


def test_a_staircase_shows_in_i_d_while_i_q_steps_faster() -> None:
    drive = VirtualDrive(excited("staircase", i_d_levels=3, level_time=0.1))
    r = drive.record(4000)
    settled = [r["i_d"][1000 * k + 500 : 1000 * k + 990] for k in range(4)]
    for level, i_d in zip((-2.0, 0.0, 2.0, 0.0), settled, strict=True):
        assert np.median(i_d) == pytest.approx(level, abs=0.02)
    assert np.ptp(r["i_q"]) > 1.5


def test_a_sequence_is_commanded_while_the_drive_runs_and_begins_anew() -> None:
    drive = VirtualDrive(excited("none"))
    drive.run(2000)
    assert np.ptp(drive.record(500)["i_d"]) < 0.01
    runs = list[bytes]()
    for _ in range(2):
        drive.write("excitation_kind", KINDS.index("prbs"))
        drive.run(1)
        runs.append(drive._state.firmware.excited.d.drawn.to_bytes(2))
        r = drive.record(999)
        assert np.percentile(np.abs(r["i_d"]), 50) == pytest.approx(2.0, abs=0.1)
        drive.write("excitation_kind", KINDS.index("none"))
        drive.run(500)
    assert runs[0] == runs[1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sequence_is_the_same_bit_for_bit_however_its_run_is_cut(kind: str) -> None:
    whole, cut = VirtualDrive(excited(kind)), VirtualDrive(excited(kind))
    parts = [cut.record(n) for n in (1, 499, 1500)]
    for name, column in whole.record(2000).items():
        assert np.concatenate([part[name] for part in parts]).tobytes() == column.tobytes(), name


@pytest.mark.parametrize("kind", KINDS[1:])
def test_no_sequence_takes_the_reference_beyond_the_current_limit(kind: str) -> None:
    drive = VirtualDrive(excited(kind))
    for name in ("i_d_step", "i_q_step", "i_q_ref"):
        drive.write(name, 12.0)
    drive.run(200)
    r = drive.record(4000)
    assert np.percentile(np.hypot(r["i_d"], r["i_q"]), 95) < 12.1
    assert drive.read("error_code") == 0.0


def test_fewer_levels_on_the_way_keep_the_current_within_its_step() -> None:
    drive = VirtualDrive(excited("staircase", i_d_levels=11, level_time=0.02))
    drive.run(2100)  # at the top
    drive.write("i_d_levels", 3)
    assert np.abs(drive.record(1000)["i_d"]).max() < 2.3


def test_what_cannot_be_is_refused() -> None:
    drive = VirtualDrive(excited("multisine"))
    drive.write("sine_frequency", 100.0)
    with pytest.raises(ValueError, match=r"\(sine_count\) takes harmonics up to 2500 Hz, got up to 2600 Hz"):
        drive.write("sine_count", 13)
    with pytest.raises(ValueError, match=r"\(excitation_kind\) takes at most 4, got 5$"):
        drive.write("excitation_kind", 5)
    for text, sentence in (
        ('kind = "noise"', "excitation.kind takes none or levels or prbs or multisine or staircase, got 'noise'"),
        ("sine_frequency = 200", "excitation.sine_frequency takes harmonics up to 2500 Hz at T_s = 0.0001 s, got up "),
        ("i_d_levels = 1", "excitation.i_d_levels takes at least 2 and at most 101, got 1"),
    ):
        with pytest.raises(ScenarioError, match=sentence):
            parse(f"{MOTOR}[excitation]\n{text}", "x.toml")
