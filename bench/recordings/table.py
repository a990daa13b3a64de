"""Tables on disk, part by part: CSV, CSV.gz, Parquet, .mat and MDF to columns of float64. Knows nothing of drives.

How a CSV is written is told in `forms`; `foreign` makes a Parquet of the last two, which stands for them. A part is as
long as its caller asks or shorter, so that a file larger than memory can be read; an empty one stands for a line that
cannot be read. Missing cells are NaN; rows count from 1, the header not counted. Whatever is wrong with a file is a
RecordingError that says what was expected and what came.
"""

import codecs
import csv
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from bench.errors import RecordingError
from bench.files import check_regular
from bench.recordings.foreign.content import REMARK, is_number, notes_of, pa, pq, unit_of
from bench.recordings.foreign.process import FORMS, plain
from bench.recordings.forms.csv_form import CsvForm, form_of
from bench.recordings.forms.csv_rows import Bytes, Lines, Part, parts_of, quoted
from bench.recordings.seal import check_seal

HEAD = 1 << 16  # bytes in which a CSV's header must end
ROWS = 1 << 16  # taken at a time where all are wanted

_FORMS: Final = {"csv": "CSV", "gzip": "CSV.gz", "parquet": "Parquet"} | FORMS

# What pyarrow raises over a damaged file, besides its own tree.
FAILURES: tuple[type[Exception], ...] = (
    pa.ArrowException, OSError, EOFError, ValueError, LookupError, OverflowError, MemoryError, csv.Error,
)


@dataclass(frozen=True, slots=True)
class Header:
    """What a file says of its columns."""

    names: tuple[str, ...]
    units: tuple[str, ...] = ()  # of each column; none where the file has no row of them
    remark: str = ""  # what is not as in a plain file


def check_undamaged(path: Path) -> None:
    """Raise RecordingError where a Parquet file of the bench's is not as it was written. It is read whole for that."""
    with _as_sentences(path, "its bytes"):
        if _kind(path) == "parquet":
            check_seal(path)


def column_names(path: Path) -> tuple[str, ...]:
    """The file's column names in its order."""
    return header_of(path).names


def header_of(path: Path) -> Header:
    """What the file says of its columns."""
    with _as_sentences(path, "its header"):
        kind, path = _table(path)
        if kind == "parquet":
            schema = pq.read_schema(path)
            metadata: dict[bytes, bytes] = schema.metadata or {}
            return Header(tuple(schema.names), tuple(map(unit_of, schema)), metadata.get(REMARK, b"").decode())
        form = _csv_form(path)
        return Header(form.names, form.units, form.remark())


def read_parts(path: Path, columns: Sequence[str], rows: int, lines: Lines | None = None) -> Generator[Part]:
    """The named columns in parts of at most `rows` rows, in the file's order. Closing it closes the file.

    An empty part stands for a line that cannot be read; `lines` hears what is wrong with it.
    """
    names = column_names(path)
    for column in columns:
        if names.count(column) != 1:
            raise RecordingError(f"{path}: expected one column {quoted(column)}, found {names.count(column)}")
    kind, path = _table(path)
    if kind == "parquet":
        yield from _parquet_parts(path, list(columns), rows, slice(None))
    else:
        yield from _csv_parts(path, list(columns), rows, Lines() if lines is None else lines)


def read_rows(path: Path, columns: Sequence[str], rows: slice) -> Generator[Part]:
    """These rows of a Parquet, its other row groups and columns unread. Raises RecordingError."""
    yield from _parquet_parts(path, list(columns), ROWS, rows)


def numeric_columns(path: Path) -> dict[str, str]:
    """Columns of a Parquet that hold numbers, each with the unit that the file tells; empty where it tells none."""
    with _as_sentences(path, "its end"):
        fields = list(pq.read_schema(path))
    return {field.name: unit_of(field) for field in fields if is_number(field.type)}


def read_whole(
    path: Path, columns: Mapping[str, str], most: int, too_many: str, lines: Lines | None = None
) -> dict[str, NDArray[np.float64]]:
    """Whole columns by quantity. Raises RecordingError: `too_many` beyond so many rows, and where there are none."""
    check_undamaged(path)
    parts: list[Part] = []
    rows = 0
    for part in read_parts(path, tuple(dict.fromkeys(columns.values())), ROWS, lines):
        if not part:
            continue
        parts.append(part)
        rows += len(next(iter(part.values())))
        if rows > most:
            raise RecordingError(f"{path}: {too_many}")
    if not rows:
        raise RecordingError(f"{path}: expected rows below the header, came none")
    return {name: np.concatenate([part[column] for part in parts]) for name, column in columns.items()}


def row_count(path: Path) -> int | None:
    """Rows of a file whose format says so at its start (Parquet); None otherwise."""
    kind, path = _table(path)
    if kind != "parquet":
        return None
    with _as_sentences(path, "its end"):
        return int(pq.read_metadata(path).num_rows)


def extent(path: Path, name: str) -> float | None:
    """From the least to the largest value of a column, where a Parquet's own statistics say so; None otherwise."""
    kind, path = _table(path)
    if kind != "parquet":
        return None
    with _as_sentences(path, "its end"):
        file = pq.read_metadata(path)
        place = file.schema.names.index(name) if name in file.schema.names else -1
        told = [file.row_group(k).column(place).statistics for k in range(file.num_row_groups)] if place >= 0 else []
    if not told or any(one is None or not one.has_min_max for one in told):
        return None
    return float(max(one.max for one in told) - min(one.min for one in told))


def notes(path: Path) -> dict[str, Any]:
    """What the bench noted in a Parquet file when it wrote it; empty in any other file."""
    kind, path = _table(path)
    if kind != "parquet":
        return {}
    with _as_sentences(path, "its end"):
        return notes_of(path)


def form(path: Path) -> str:
    """How a file is written, in words. Raises RecordingError, OSError."""
    return _FORMS[_kind(path)]


def _table(path: Path) -> tuple[str, Path]:
    """`csv`, `gzip` or `parquet`, and the file, or the Parquet that stands for it."""
    kind = _kind(path)
    return ("parquet", plain(path, kind)) if kind in FORMS else (kind, path)


def _kind(path: Path) -> str:
    """`csv`, `gzip`, `parquet`, `mat` or `mdf`, by content; of MATLAB's level 4, which has no mark, by its name."""
    check_regular(path)
    with path.open("rb") as file:
        head = file.read(4096)
    if head.startswith(b"PAR1"):
        return "parquet"
    if path.suffix.lower() in {".parquet", ".pq"} and head:
        raise RecordingError(f"{path}: expected a Parquet file, begins with {head[:4]!r} in place of b'PAR1'")
    if head.startswith(b"\x1f\x8b"):
        return "gzip"
    if head.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")) or (path.suffix.lower() == ".mat" and head):
        return "mat"
    if head.startswith((b"MDF     ", b"UnFinMF ")):
        return "mdf"
    if b"\0" in head and not head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise RecordingError(f"{path}: expected CSV in UTF-8, CSV.gz, Parquet, .mat or MDF, came binary data")
    return "csv"


@contextmanager
def _as_sentences(path: Path, where: str) -> Generator[None]:
    try:
        yield
    except FAILURES as error:
        _refuse(path, where, error)


def _refuse(path: Path, where: str, error: Exception) -> NoReturn:
    said = str(error)
    if isinstance(error, OSError) and error.strerror is not None:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    if "footer" in said or "smaller than the minimum" in said:
        raise RecordingError(
            f"{path}: the Parquet file is cut short: expected a footer at its end, found none"
        ) from error
    if "Truncated compressed stream" in said:
        raise RecordingError(f"{path}: the gzip file is cut short in {where}: expected more data") from error
    first_line = (said.splitlines() or [type(error).__name__])[0][:200]
    raise RecordingError(f"{path}: damaged in {where}: {first_line}") from error


# --- CSV and CSV.gz


@contextmanager
def _open_text(path: Path) -> Generator[tuple[Bytes, str]]:
    """A text file's bytes, those of UTF-16 as UTF-8, and what they were before."""
    packed = "gzip" if _kind(path) == "gzip" else None
    with pa.input_stream(str(path), compression=packed) as file:
        wide = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    with pa.input_stream(str(path), compression=packed) as file:
        yield (codecs.EncodedFile(file, "utf-8", "utf-16"), "utf-16") if wide else (file, "utf-8")


def _csv_form(path: Path) -> CsvForm:
    with _open_text(path) as (file, encoding):
        head = file.read(HEAD)
    whole = len(head) < HEAD
    if not whole and not re.search(rb"[\r\n]", head):
        raise RecordingError(f"{path}: expected a header line, found none in the first {HEAD} bytes")
    with _naming(path):
        form = form_of(head, encoding, whole=whole)
    if form is None:
        raise RecordingError(f"{path}: the file is empty, expected a header line and rows")
    return form


def _csv_parts(path: Path, columns: list[str], rows: int, lines: Lines) -> Iterator[Part]:
    with _as_sentences(path, "its header"):
        form = _csv_form(path)
    try:
        with _open_text(path) as (file, _), _naming(path):
            yield from parts_of(file, form, columns, rows, lines)
    except FAILURES as error:
        _refuse(path, f"the rows after {lines.rows}", error)


@contextmanager
def _naming(path: Path) -> Generator[None]:
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


# --- Parquet


def _parquet_parts(path: Path, columns: list[str], rows: int, wanted: slice) -> Iterator[Part]:
    done = 0
    try:
        # Not pre-buffered and through a small buffer: a row group is streamed, however long it is.
        options = {"pre_buffer": False, "buffer_size": HEAD, "page_checksum_verification": True}
        with pq.ParquetFile(path, **options) as file:
            for name in columns:
                _expect_numbers(path, name, file.schema_arrow.field(name).type)
            begin, end, _ = wanted.indices(file.metadata.num_rows)
            groups, done = _groups(file.metadata, begin, end)
            for batch in file.iter_batches(batch_size=rows, columns=columns, row_groups=groups):
                part = batch.slice(min(max(0, begin - done), batch.num_rows), max(0, end - max(done, begin)))
                done += batch.num_rows
                if part.num_rows:
                    yield {
                        name: part.column(name).cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
                        for name in columns
                    }
                if done >= end:
                    return
    except FAILURES as error:
        _refuse(path, f"the rows after {done}", error)


def _groups(told: Any, begin: int, end: int) -> tuple[list[int], int]:
    """Row groups that have rows from `begin` to before `end`, and the number of the first of their rows."""
    starts = [0]
    for k in range(told.num_row_groups):
        starts.append(starts[-1] + told.row_group(k).num_rows)
    groups = [k for k, (a, b) in enumerate(pairwise(starts)) if a < end and b > begin]
    return groups, starts[groups[0]] if groups else 0


def _expect_numbers(path: Path, name: str, kind: Any) -> None:
    if not is_number(kind):
        raise RecordingError(f"{path}: column {quoted(name)}: expected numbers, it holds {quoted(str(kind))}")
