"""Recordings in forms of other tools: written and read back to the bit, what others write, and what nobody should."""

import importlib
import pickle
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from bench.errors import RecordingError
from bench.recordings.capture_file import write_columns
from bench.recordings.foreign import process
from bench.recordings.foreign.content import Content
from bench.recordings.foreign.mat import write as write_mat
from bench.recordings.table import column_names, header_of, notes, read_whole
from tests.support.recordings import read_recording

_io: Any = scipy.io
T = np.linspace(0.0, 0.0499, 500)
X = np.random.default_rng(3).standard_normal((4, 500))
NOTES = {"capture": "a", "T_s": 1e-4, "drive": "Prüfstand", "steps": {"i_d": 0.01}, "title": "x"}
HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
ENDINGS = {"mat": ".mat", "mdf": ".mf4"}


def columns(path: Path) -> dict[str, Any]:
    """All columns of a file."""
    return read_whole(path, {name: name for name in column_names(path)}, 10**6, "too many")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write_columns(tmp_path / "a.parquet", {"t": T, "i_d": X[0], "theta_e": X[1]}, NOTES)


@pytest.mark.parametrize("form", ENDINGS)
def test_what_is_written_is_read_back_to_the_bit_with_units_and_notes(recording: Path, form: str) -> None:
    path = recording.with_suffix(ENDINGS[form])
    process.write(recording, form, path, {"title": "warm", "marks": [{"t": 0.1, "text": "ß"}]})
    assert notes(path) == NOTES | {"title": "warm", "marks": [{"t": 0.1, "text": "ß"}]}
    assert (header_of(path).names, header_of(path).units) == (("t", "i_d", "theta_e"), ("s", "A", "rad"))
    found, there = columns(path), columns(recording)
    assert all(np.array_equal(found[name], there[name]) for name in there)


def test_a_struct_is_as_matlab_would_have_it(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    process.write(recording, "mat", path, {})
    one = _io.loadmat(path)["recording"][0, 0]
    assert one["signals"][0, 0]["i_d"].shape == (500, 1)
    assert one["units"][0, 0]["theta_e"][0] == "rad"
    assert one["notes"][0, 0]["T_s"][0, 0] == 1e-4
    assert one["notes"][0, 0]["drive"][0] == "Prüfstand"


def test_columns_that_matlab_does_not_take_for_names_keep_theirs(tmp_path: Path) -> None:
    names = ("n [rpm]", "n (rpm)", "1", "x" * 80, "x" * 81, "_")
    path = tmp_path / "a.mat"
    write_mat(path, Content({name: T + k for k, name in enumerate(names)}, {"n [rpm]": "rpm"}))
    assert column_names(path) == names
    assert header_of(path).units[0] == "rpm"
    assert columns(path)["_"][0] == 5.0


def other(name: str) -> dict[str, Any]:
    """A workspace as others save it."""
    signals = np.array([{"values": X[0], "label": "i_d"}, {"values": X[1:3].T, "label": ""}], dtype=object)
    desk = [{"Name": "i_d", "Data": X[0], "Unit": "mA"}, {"Name": "u_d", "Data": X[1]}]
    return {
        "vectors": {"t": T, "i_d": X[0][:, None], "K": 3.0, "name": "a text", "short": [1.0, 2.0]},
        "struct": {"log": {"time_s": T, "motor": {"i_d": X[0], "flag": X[1] > 0}}, "other": {"i_d": X[2]}},
        "simulink": {"out": {"time": T, "signals": signals}},
        "control desk": {"run": {"X": {"Data": T, "Unit": "s"}, "Y": np.array(desk, dtype=object)}},
        "matrix": {"t": T, "x": X.T, "z": X[0] + 1j},
    }[name]


@pytest.mark.parametrize(("name", "found", "said"), [
    ("vectors", ("t", "i_d"), "left out, not of 500 rows: short"),
    ("struct", ("time_s", "log.motor.i_d", "flag", "other.i_d"), ""),
    ("simulink", ("t", "i_d", "signal_2_1", "signal_2_2"), ""),
    ("control desk", ("t", "i_d", "u_d"), ""),
    ("matrix", ("t", "x_1", "x_2", "x_3", "x_4"), "left out, complex: z"),
])  # fmt: skip
def test_what_other_tools_save_is_taken_apart(tmp_path: Path, name: str, found: tuple[str, ...], said: str) -> None:
    path = tmp_path / "a.mat"
    _io.savemat(path, other(name), do_compression=name == "struct")
    header = header_of(path)
    assert (header.names, header.remark) == (found, said)
    assert header.units[1] == ("mA" if name == "control desk" else "")
    assert np.array_equal(columns(path)[found[1]], X[0])


def test_a_column_that_is_missing_for_being_complex_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    there = {"t": T, **dict.fromkeys(("u_d", "u_q", "i_q", "omega_e"), X[0])}
    _io.savemat(path, there | {"i_d": X[0] + 1j})
    with pytest.raises(RecordingError, match=r"missing columns: i_d; present: .*; left out, complex: i_d; map a col"):
        read_recording(path)
    _io.savemat(path, {"log": {"i_d": X[0] + 1j}})
    with pytest.raises(RecordingError, match=r"expected columns of numbers, found none; left out, complex: log.i_d"):
        column_names(path)


def test_a_file_of_level_4_is_known_by_its_name(tmp_path: Path) -> None:
    _io.savemat(tmp_path / "a.mat", {"t": T, "i_d": X[0]}, format="4")
    assert column_names(tmp_path / "a.mat") == ("t", "i_d")


def test_channels_of_other_times_are_left_out_and_told(tmp_path: Path) -> None:
    asammdf: Any = importlib.import_module("asammdf")
    path = tmp_path / "a.mf4"
    with asammdf.MDF(version="4.10") as file:
        for names, t in ((("i_d", "i_q"), T), (("temperature",), T[::100]), (("u_d",), T)):
            file.append([asammdf.Signal(np.cos(t), t, name=name, unit="A") for name in names], common_timebase=True)
        file.append(asammdf.Signal(np.array([b"on", b"off"] * 250), T, name="state", encoding="utf-8"))
        file.save(path, overwrite=True)
    header = header_of(path)
    assert header.names == ("t", "i_d", "i_q", "u_d")
    assert header.remark == "left out, channels of other times: 2"


def bomb() -> bytes:
    """A level-5 file with three variables of 500 MB of zeros each, compressed to 500 kB."""
    size, block = 500_000_000, 1 << 24
    size -= size % block
    tags = struct.pack("<IIIIII", 6, 8, 6, 0, 5, 8) + struct.pack("<ii", 1, size // 8)
    variable = struct.pack("<II", 14, len(tags) + 16 + size) + tags + struct.pack("<HH4s", 1, 1, b"x")
    packer = zlib.compressobj(9)
    begin = packer.compress(variable + struct.pack("<II", 9, size)) + packer.flush(zlib.Z_FULL_FLUSH)
    zeros = packer.compress(bytes(block)) + packer.flush(zlib.Z_FULL_FLUSH)  # the same however often it stands there
    packed = begin + zeros * (size // block)
    return HEAD + (struct.pack("<II", 15, len(packed)) + packed) * 3


@pytest.mark.parametrize(("name", "content", "said"), [
    ("a.mat", HEAD + struct.pack("<II", 15, 100) + bytes(100), "expected a file of MATLAB's, level 4 or 5"),
    ("a.mat", HEAD, "expected columns of numbers, found none"),
    ("a.mat", pickle.dumps({"t": [1.0, 2.0]}), "expected a file of MATLAB's"),
    ("a.mat", b"PK\x03\x04" + bytes(500), "expected a file of MATLAB's"),
    ("a.mf4", b"MDF     4.10    " + bytes(300), "expected a file of ASAM MDF, it cannot be read"),
    ("a.mf4", b"MDF     4.10    " + bytes(range(256)) * 40, "expected a file of ASAM MDF, it cannot be read"),
    ("a.csv", pickle.dumps(np.zeros(300)), "expected CSV in UTF-8, CSV.gz, Parquet, .mat or MDF, came binary data"),
])  # fmt: skip
def test_a_file_that_is_none_gets_a_sentence(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=said):
        column_names(tmp_path / name)


def test_a_file_that_takes_too_much_memory_gets_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "_MEMORY", 1_500_000_000)
    (tmp_path / "a.mat").write_bytes(bomb())
    with pytest.raises(RecordingError, match=r"up to 1\.5 GB of memory, it takes more"):
        column_names(tmp_path / "a.mat")


def test_a_file_that_takes_too_long_gets_a_sentence(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "_TIME", 0.05)
    with pytest.raises(RecordingError, match=r"can be written within 0\.05 s, it takes longer"):
        process.write(recording, "mat", recording.with_suffix(".mat"), {})
    assert not recording.with_suffix(".mat").exists()


def test_a_file_of_level_7_3_is_read_by_h5py_or_refused_with_what_helps(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    try:
        h5py: Any = importlib.import_module("h5py")
    except ImportError:
        path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(100))
        with pytest.raises(RecordingError, match=r"needs h5py: .* -m pip install .h5py.; or save it by save\(FILE"):
            column_names(path)
        return
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["log/i_d"], file["log/elsewhere"] = T[None], X[0][None], h5py.ExternalLink("/etc/x", "/y")
        file["z"] = X[0][None] + 1j
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(128))
    assert column_names(path) == ("i_d", "t")
    assert header_of(path).remark == "left out, complex: z"
