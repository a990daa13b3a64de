"""MATLAB's .mat. Written: a struct `recording` of level 5. Read: that, and what other tools write.

    recording.signals.i_d    N x 1 double, one field a column
    recording.units.i_d      'A'
    recording.columns        names of the columns, where MATLAB does not take them for fields
    recording.notes          title, drive, T_s, ... as fields
    recording.json           all of the notes

Of other files each vector of numbers is a column, in structs too; Simulink's structure with time, and ControlDesk's `X`
and `Y` are known. Objects, cells and texts are left out: nothing in a file is run.
"""

import importlib
import json
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
import scipy.io

from bench.errors import RecordingError
from bench.recordings.foreign.content import (
    Content,
    Floats,
    install,
    is_complex,
    numbers,
    object_of,
    of_one_length,
)

_io: Any = scipy.io  # comes with types that say little

ROOT: Final = "recording"
_LONGEST: Final = 63  # characters of a field's name
_DEPTH: Final = 5  # structs in structs
_WIDEST: Final = 64  # columns of a matrix that are taken apart
_HDF5: Final = b"\x89HDF\r\n\x1a\n"
_HEAD: Final = 512  # bytes before that, of level 7.3

Named = tuple[str, str, Floats]  # where it stands, its own name, its numbers


def write(path: Path, content: Content) -> None:
    """One of level 5. Raises OSError."""
    fields = _fields(content)
    plain = {key: value for key, value in content.notes.items() if isinstance(value, str | int | float)}
    told: dict[str, Any] = {
        "signals": {fields[name]: column for name, column in content.columns.items()},
        "units": {fields[name]: content.units.get(name, "") for name in content.columns},
        "columns": np.array(list(content.columns), dtype=object),
        "notes": {_field(key): value for key, value in plain.items()},
        "json": json.dumps(dict(content.notes)),
    }
    with path.open("wb") as file:
        _io.savemat(file, {ROOT: told}, oned_as="column", long_field_names=True)


def read(path: Path) -> Content:
    """Raises RecordingError."""
    with path.open("rb") as file:
        head = file.read(_HEAD + len(_HDF5))
        file.seek(0)
        found = _of_hdf5(path) if _HDF5 in (head[: len(_HDF5)], head[_HEAD:]) else _loaded(file)
    root = found.get(ROOT)
    if isinstance(root, dict) and isinstance(cast(dict[str, Any], root).get("signals"), dict):
        return _own(cast(dict[str, Any], root))
    named, units, complexes = list[Named](), dict[str, str](), list[str]()
    for name, value in found.items():
        if not name.startswith("_"):
            named += _vectors(name, name, value, units, _DEPTH)
            complexes += _complexes(name, value, _DEPTH)
    bare = Counter(own for _, own, _ in named)
    columns = [(own if bare[own] == 1 else where, column) for where, own, column in named]
    return of_one_length(columns, units, complexes)


def _loaded(file: Any) -> dict[str, Any]:
    try:
        return _io.loadmat(file, appendmat=False, simplify_cells=True)
    except (ValueError, TypeError, LookupError, AttributeError, EOFError, OSError, OverflowError, zlib.error) as error:
        said = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordingError(f"expected a file of MATLAB's, level 4 or 5, it is damaged: {said}") from None
    except NotImplementedError:
        raise RecordingError("expected a file of MATLAB's of level 4, 5 or 7.3, it is of another") from None


def _own(root: Mapping[str, Any]) -> Content:
    """One of the bench's."""
    signals = cast(dict[str, Any], root["signals"])
    names, told = np.atleast_1d(root.get("columns", [])).tolist(), root.get("units")
    if len(names) != len(signals) or not all(isinstance(name, str) for name in names):
        names = list(signals)
    found, units = list[tuple[str, Floats]](), dict[str, str]()
    for name, field in zip(names, signals, strict=True):
        column = numbers(np.atleast_1d(signals[field]))
        if column is not None and column.ndim == 1:
            found.append((name, column))
        unit = cast(dict[str, Any], told).get(field) if isinstance(told, dict) else None
        units |= {name: unit} if isinstance(unit, str) else {}
    said = root.get("json")
    made = of_one_length(found, units)
    return Content(made.columns, made.units, object_of(said) if isinstance(said, str) else {}, made.remarks)


# --- files of others


def _vectors(where: str, own: str, value: Any, units: dict[str, str], depth: int) -> Iterator[Named]:
    """The vectors of numbers in a value; units are told where they stand beside one."""
    if isinstance(value, dict):
        fields = cast(dict[str, Any], value) if depth else {}
        known = _of_simulink(fields) or _of_control_desk(fields, units)
        if known:
            yield from ((f"{where}.{name}", name, column) for name, column in known)
            return
        for name, inner in fields.items():
            yield from _vectors(f"{where}.{name}", name, inner, units, depth - 1)
        return
    column = numbers(value)
    if column is not None and column.ndim == 1:
        yield where, own, column
    elif column is not None and column.ndim == 2 and column.shape[1] <= _WIDEST:
        for k in range(column.shape[1]):
            yield f"{where}_{k + 1}", f"{own}_{k + 1}", column[:, k]


def _complexes(where: str, value: Any, depth: int) -> Iterator[str]:
    """Where complex numbers stand in a value."""
    if is_complex(value):
        yield where
    elif isinstance(value, dict) and depth:
        for name, inner in cast(dict[str, Any], value).items():
            yield from _complexes(f"{where}.{name}", inner, depth - 1)


def _of_simulink(fields: Mapping[str, Any]) -> list[tuple[str, Floats]]:
    """A structure with time: `time`, and `signals` of `values` and `label`."""
    time = numbers(fields.get("time"))
    if time is None or time.ndim != 1 or "signals" not in fields:
        return []
    found = [("t", time)]
    for k, signal in enumerate(_structs(fields["signals"])):
        values, label = numbers(signal.get("values")), signal.get("label")
        name = label if isinstance(label, str) and label else f"signal_{k + 1}"
        if values is not None and values.ndim == 1:
            found.append((name, values))
        elif values is not None and values.ndim == 2 and values.shape[1] <= _WIDEST:
            found += [(f"{name}_{j + 1}", values[:, j]) for j in range(values.shape[1])]
    return found


def _of_control_desk(fields: Mapping[str, Any], units: dict[str, str]) -> list[tuple[str, Floats]]:
    """`X` with `Data`, the times; `Y` of `Name`, `Data` and `Unit`."""
    if not {"X", "Y"} <= set(fields):
        return []
    times = [numbers(one.get("Data")) for one in _structs(fields["X"])]
    found = [("t", time) for time in times[:1] if time is not None and time.ndim == 1]
    for one in _structs(fields["Y"]):
        name, values, unit = one.get("Name"), numbers(one.get("Data")), one.get("Unit")
        if isinstance(name, str) and values is not None and values.ndim == 1:
            found.append((name, values))
            units |= {name: unit} if isinstance(unit, str) else {}
    return found


def _structs(value: object) -> list[dict[str, Any]]:
    """A struct, or an array of them."""
    several = cast(list[object], value) if isinstance(value, list | np.ndarray) else [value]
    return [cast(dict[str, Any], one) for one in several if isinstance(one, dict)]


# --- level 7.3


def _of_hdf5(path: Path) -> dict[str, Any]:
    try:
        h5py: Any = importlib.import_module("h5py")
    except ImportError:
        raise RecordingError(
            f"a file of MATLAB's of level 7.3 needs h5py: {install('h5py')}; or save it by save(FILE, ..., '-v7')"
        ) from None
    try:
        with h5py.File(path, "r") as file:
            return _group(h5py, file, _DEPTH)
    except (OSError, ValueError, TypeError, LookupError, RuntimeError) as error:
        raise RecordingError(f"expected a file of MATLAB's of level 7.3, it is damaged: {str(error)[:200]}") from None


def _group(h5py: Any, group: Any, depth: int) -> dict[str, Any]:
    """Numbers and structs; what is linked from other files is left out."""
    found: dict[str, Any] = {}
    for name in group:
        link = group.get(name, getlink=True)
        if name.startswith("#") or isinstance(link, h5py.ExternalLink):
            continue
        one = group[name]
        if isinstance(one, h5py.Group) and depth:
            found[name] = _group(h5py, one, depth - 1)
        elif isinstance(one, h5py.Dataset) and one.external is None and one.dtype.names == ("real", "imag"):
            found[name] = np.squeeze(one["real"] + 1j * one["imag"]).T
        elif isinstance(one, h5py.Dataset) and one.external is None and one.dtype.kind in "biuf":
            found[name] = np.squeeze(one[()]).T  # in MATLAB's order
            if one.attrs.get("MATLAB_class") == b"char":
                found[name] = "".join(chr(int(code)) for code in np.ravel(found[name])[:1_000_000])
    return found


# --- names


def _fields(content: Content) -> dict[str, str]:
    """A field's name for each column, all of them different."""
    taken = dict[str, str]()
    for name in content.columns:
        field, k = _field(name), 1
        while field in taken.values():
            k += 1
            field = f"{_field(name)[: _LONGEST - 5]}_{k}"
        taken[name] = field
    return taken


def _field(name: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return (plain if plain[:1].isalpha() else f"x{plain}")[:_LONGEST]
