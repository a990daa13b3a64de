"""Long recordings in stretches: which rows are taken, and that they are the recording's own."""

from pathlib import Path

import numpy as np
import pytest

from bench.recordings.long_recording import BLOCK, read_in_stretches
from bench.recordings.recording import Recording, open_recording
from estimator.machine import Machine
from estimator.physics.rows import rows_of
from tests.bench.recordings.test_recording import parquet_bytes
from tests.support.recordings import read_recording

T_S = 1e-4  # s
MACHINE = Machine(R_s=0.5, L_d=1e-3, L_q=1e-3, psi_f=0.1, n_p=4)
ROWS, MOST = 50 * BLOCK, 10 * BLOCK
SHORT = slice(31 * BLOCK, 32 * BLOCK)  # an operating point that is visited once


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    k, noise = np.arange(ROWS), np.random.default_rng(1)
    omega, i_q = 300.0 + 100.0 * np.sin(k * 1e-4), 3.0 + noise.normal(0.0, 0.1, ROWS)
    omega[SHORT], i_q[SHORT] = -500.0, -6.0
    return {
        "t": k * T_S, "u_d": noise.normal(0.0, 5.0, ROWS), "u_q": noise.normal(20.0, 5.0, ROWS),
        "i_d": noise.normal(0.0, 0.1, ROWS), "i_q": i_q, "omega_e": omega,
        "theta_e": np.cumsum(omega) * T_S,
    }  # fmt: skip


@pytest.fixture(scope="module")
def path(columns: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "long.parquet"
    wrapped = columns | {"theta_e": columns["theta_e"] % (2.0 * np.pi)}
    path.write_bytes(parquet_bytes(wrapped))
    return path


def in_stretches(path: Path, most: int = MOST, chunk_rows: int = 65_536) -> tuple[Recording, str]:
    return read_in_stretches(lambda: open_recording(path, chunk_rows=chunk_rows), most)


def test_a_recording_that_is_not_long_is_read_as_it_is(path: Path) -> None:
    recording, said = in_stretches(path, ROWS)
    (run,), (whole,) = recording.runs, read_recording(path).runs
    assert said == ""
    assert run.left_out is None
    assert all(np.array_equal(getattr(run, name), getattr(whole, name)) for name in ("theta_e", "i_q", "u_d"))


def test_stretches_are_the_recordings_own_rows_and_as_many_as_asked_for(
    path: Path, columns: dict[str, np.ndarray]
) -> None:
    recording, said = in_stretches(path)
    assert sum(map(len, recording.runs)) == MOST
    assert (recording.summary.rows, recording.summary.used) == (ROWS, MOST)
    assert f"{MOST} of its {ROWS} rows are diagnosed, in {len(recording.runs)} stretches" in said
    for run in recording.runs:
        first = round(run.t0 / T_S)
        assert all(
            np.array_equal(getattr(run, name), columns[name][first : first + len(run)])
            for name in ("i_d", "i_q", "u_d", "u_q", "omega_e")
        )


def taken(recording: Recording) -> np.ndarray:
    """Places in the file of all rows."""
    return np.concatenate([round(run.t0 / T_S) + np.arange(len(run)) for run in recording.runs])


def test_stretches_reach_from_begin_to_end_and_to_what_was_there_once(path: Path) -> None:
    places = taken(in_stretches(path)[0])
    assert (places[0], places[-1]) == (0, ROWS - 1)
    assert np.count_nonzero((places >= SHORT.start) & (places < SHORT.stop)) == BLOCK


@pytest.mark.parametrize("chunk_rows", [1000, 7919, ROWS])
def test_stretches_do_not_depend_on_how_the_file_is_read(path: Path, chunk_rows: int) -> None:
    one, other = in_stretches(path)[0], in_stretches(path, chunk_rows=chunk_rows)[0]
    assert np.array_equal(taken(one), taken(other))
    for run, again in zip(one.runs, other.runs, strict=True):
        assert (run.left_out is None) == (again.left_out is None)
        assert run.left_out is None or run.left_out == pytest.approx(again.left_out)


def test_turns_are_counted_over_what_is_left_out(path: Path, columns: dict[str, np.ndarray]) -> None:
    recording = in_stretches(path)[0]
    rows, places = rows_of(recording.runs, MACHINE, 10.0), taken(recording)
    turned = columns["theta_e"][places] - columns["theta_e"][places[0]]
    assert np.max(np.abs(rows.theta_e - rows.theta_e[0] - turned)) < 1e-6
    assert np.count_nonzero(rows.pauses) == len(recording.runs) - 1


def test_over_lost_rows_turns_are_not_known_and_heat_is(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    there = np.ones(ROWS, np.bool_)
    there[BLOCK + 100 : BLOCK + 200] = False  # in a block that is not taken
    path = tmp_path / "gap.parquet"
    path.write_bytes(parquet_bytes({name: column[there] for name, column in columns.items()}))
    recording = in_stretches(path)[0]
    second = recording.runs[1]
    first, begin = len(recording.runs[0]), round(second.t0 / T_S)
    square = columns["i_d"] ** 2 + columns["i_q"] ** 2
    assert second.left_out is not None
    assert second.left_out.turned is None
    assert second.left_out.heat == pytest.approx(T_S * np.sum((square * there)[first:begin]))
    assert all(run.left_out is not None and run.left_out.turned is not None for run in recording.runs[2:])


def test_heat_goes_on_over_what_is_left_out(path: Path, columns: dict[str, np.ndarray]) -> None:
    recording = in_stretches(path)[0]
    heat = np.cumsum(T_S * (columns["i_d"] ** 2 + columns["i_q"] ** 2))
    assert np.allclose(rows_of(recording.runs, MACHINE, 10.0).heat, heat[taken(recording)])


def test_a_block_whose_current_alone_alternates_is_taken(tmp_path: Path) -> None:
    """By its standard deviation, not its mean square: that of a large mean would hide it."""
    alternating, higher = slice(23 * BLOCK, 24 * BLOCK), slice(37 * BLOCK, 38 * BLOCK)
    k, i_q = np.arange(ROWS), np.full(ROWS, 10.0)
    i_q[alternating] += 0.5 * (-1.0) ** k[alternating]
    i_q[higher] += 0.05
    path, constant = tmp_path / "one.parquet", np.full(ROWS, 1.0)
    path.write_bytes(parquet_bytes({
        "t": k * T_S, "u_d": constant, "u_q": constant, "i_d": constant, "i_q": i_q, "omega_e": constant,
        "theta_e": T_S * k % (2.0 * np.pi),
    }))  # fmt: skip
    recording, _ = in_stretches(path, 2 * BLOCK)
    assert any(np.ptp(run.i_q) > 0.9 for run in recording.runs)
