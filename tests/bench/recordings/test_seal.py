"""Sealed recordings: every damaged byte is told, other readers and writers are not hindered."""

import random
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from bench.errors import BenchError
from bench.recordings.capture_file import write_columns
from bench.recordings.seal import sealed
from tests.support.recordings import read_recording

pq: Any = pyarrow.parquet

ROWS = 300
NOTES = {"decimation": 1, "expected": ROWS, "steps": {"i_d": 0.001}}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    rng, t = np.random.default_rng(1), 1e-4 * np.arange(ROWS)
    columns: dict[str, Any] = {name: rng.integers(-100, 100, ROWS) * 0.001 for name in ("i_d", "i_q", "u_d", "u_q")}
    columns |= {"t": t, "omega_e": np.full(ROWS, 50.0)}
    return write_columns(tmp_path / "a.parquet", columns, NOTES)


def test_a_recording_in_which_any_one_bit_is_another_is_refused_in_a_sentence(recording: Path) -> None:
    whole = recording.read_bytes()
    mark = whole.rfind(b"pmsm-bench crc32 ")
    chosen = random.Random(1).sample(range(8 * len(whole)), 1000)
    for bit in chosen:
        if mark <= bit // 8 < mark + 17:  # no part of what is recorded
            continue
        content = bytearray(whole)
        content[bit // 8] ^= 1 << bit % 8
        recording.write_bytes(content)
        with pytest.raises(BenchError) as refused:
            read_recording(recording)
        assert str(recording) in str(refused.value)
    recording.write_bytes(whole)
    assert len(read_recording(recording).runs[0]) == ROWS


def test_what_is_cut_off_or_put_in_is_refused(recording: Path) -> None:
    whole = recording.read_bytes()
    middle = len(whole) // 2
    for content in (whole[:-1], whole[:middle], whole + b"\0", whole[:middle] + b"\0" * 8 + whole[middle:],
                    whole[:middle] + whole[middle + 8 :], whole[:4] + b"\0" * (len(whole) - 4)):  # fmt: skip
        recording.write_bytes(content)
        with pytest.raises(BenchError):
            read_recording(recording)


def test_other_readers_read_it_and_what_they_write_of_it_is_read(recording: Path) -> None:
    table = pq.read_table(recording, page_checksum_verification=True)
    assert table.num_rows == ROWS
    pq.write_table(table.slice(0, 200), recording)  # with the notes, without a seal
    assert len(read_recording(recording).runs[0]) == 200


def test_a_seal_changes_no_byte_of_pages_and_footer(recording: Path) -> None:
    with_seal = recording.read_bytes()
    at = with_seal.rfind(b"pmsm-bench crc32 ")
    without = with_seal[:at] + with_seal[at + 25 :]
    assert sealed(without) == with_seal
    recording.write_bytes(without)
    assert len(read_recording(recording).runs[0]) == ROWS
