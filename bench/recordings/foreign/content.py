"""What a recording in a foreign form holds, and the plain Parquet that stands for it meanwhile."""

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
import pyarrow
import pyarrow.parquet
from numpy.typing import NDArray

from bench.errors import RecordingError

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet

NOTES: Final = b"pmsm-bench"  # key of the notes that a Parquet file of the bench's carries, a JSON object
UNIT: Final = b"unit"  # key of a column's unit
REMARK: Final = b"pmsm-bench remark"  # key of what is to be said of a file that stands for a foreign one
LEFT_OUT: Final = "left out"  # begins what is said of columns that are not taken
MOST_COLUMNS: Final = 2000
MOST_BYTES: Final = 2_000_000_000  # of numbers

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """Columns of equal length, SI or whatever their units say."""

    columns: Mapping[str, Floats]
    units: Mapping[str, str] = field(default_factory=dict[str, str])  # of columns that tell one
    notes: Mapping[str, Any] = field(default_factory=dict[str, Any])  # the bench's, where it wrote the file
    remarks: tuple[str, ...] = ()  # what was left out

    def keep(self, path: Path) -> None:
        """As a plain Parquet. Raises OSError."""
        fields = [pa.field(name, pa.float64(), metadata={UNIT: self.units.get(name, "")}) for name in self.columns]
        told = {NOTES: json.dumps(dict(self.notes)).encode(), REMARK: "; ".join(self.remarks).encode()}
        table = pa.table(dict(self.columns), schema=pa.schema(fields, metadata=told))
        pq.write_table(table, path, compression="zstd")

    @classmethod
    def kept(cls, path: Path, said: Mapping[str, Any]) -> "Content":
        """Of a Parquet, whose notes are told with what is `said` besides.

        Raises RecordingError where it is too large, OSError, pyarrow's errors.
        """
        schema, rows = pq.read_schema(path), pq.read_metadata(path).num_rows
        if (size := rows * len(schema) * 8) > MOST_BYTES:
            raise RecordingError(
                f"expected at most {MOST_BYTES / 1e9:g} GB of numbers, which the form may hold, the recording has "
                f"{size / 1e9:.3g} GB; Parquet and CSV take any"
            )
        units = {one.name: unit_of(one) for one in schema}
        columns = {one.name: _column(path, one.name) for one in schema if is_number(one.type)}
        return cls(columns, units, notes_of(path) | dict(said))


def _column(path: Path, name: str) -> Floats:
    """One after the other, so that there are not two of all of them."""
    table = pq.read_table(path, columns=[name], use_threads=False, page_checksum_verification=True)
    return table[name].cast(pa.float64(), safe=False).to_numpy()


def is_number(kind: Any) -> bool:
    """Whether a Parquet's column of that type holds numbers."""
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def notes_of(path: Path) -> dict[str, Any]:
    """The bench's notes in a Parquet; empty where there are none. Raises pyarrow's errors, OSError."""
    metadata: dict[bytes, bytes] = pq.read_metadata(path).metadata or {}
    return object_of(metadata.get(NOTES, b"{}"))


def object_of(text: str | bytes) -> dict[str, Any]:
    """A JSON object; empty for anything else."""
    try:
        told = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return cast(dict[str, Any], told) if isinstance(told, dict) else {}


def numbers(values: object) -> Floats | None:
    """Real numbers as float64, whatever their shape; None for anything else."""
    if not isinstance(values, np.ndarray):
        return None
    found = cast(NDArray[Any], values)
    return found.astype(np.float64) if found.dtype.kind in "biuf" else None


def is_complex(values: object) -> bool:
    """Whether they are complex numbers, which no column is of."""
    return isinstance(values, np.ndarray) and cast(NDArray[Any], values).dtype.kind == "c"


def of_one_length(
    found: Sequence[tuple[str, Floats]], units: Mapping[str, str], complexes: Sequence[str] = ()
) -> Content:
    """Columns of those that are as long as most of them; the longest, of as many. Raises RecordingError.

    `complexes`: names of those that are left out for being complex, which is told.
    """
    remarks = (f"{LEFT_OUT}, complex: {_few(complexes)}",) if complexes else ()
    lengths = Counter(len(column) for _, column in found if len(column) > 1)
    if not lengths:
        raise RecordingError("; ".join(("expected columns of numbers, found none", *remarks)))
    rows = max(lengths, key=lambda one: (lengths[one], one))
    taken = [(name, column) for name, column in found if len(column) == rows]
    if len(taken) > MOST_COLUMNS:
        raise RecordingError(f"expected at most {MOST_COLUMNS} columns, came {len(taken)}")
    if twice := [name for name, count in Counter(name for name, _ in taken).items() if count > 1]:
        raise RecordingError(f"expected columns of different names, {twice[0]!r} is there more than once")
    others = [name for name, column in found if len(column) != rows]
    said = (f"{LEFT_OUT}, not of {rows} rows: {_few(others)}",) if others else ()
    units = {name: units[name] for name, _ in taken if name in units}
    return Content(dict(taken), units, remarks=(*remarks, *said))


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(name[:40] for name in names[:5]) + more


def install(what: str) -> str:
    """The command that installs a package for the Python that runs."""
    return f"{sys.executable} -m pip install '{what}'"


def unit_of(one: Any) -> str:
    """Of a Parquet's column; empty where none is told."""
    metadata: dict[bytes, bytes] = one.metadata or {}
    return metadata.get(UNIT, b"").decode("utf-8", "replace")
