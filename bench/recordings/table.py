"""Tables on disk, part by part: CSV, CSV.gz and Parquet to columns of float64. Knows nothing of drives.

The one file that knows pyarrow's readers. A part is as long as its caller asks or shorter, so that a file
larger than memory can be read. Missing cells are NaN; rows count from 1, the header not counted. Whatever is
wrong with a file is a RecordingError that says what was expected and what came.
"""

import csv
import json
import re
from bisect import bisect_left
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NoReturn, cast

import numpy as np
import pyarrow
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from bench.errors import RecordingError
from bench.files import check_regular
from bench.recordings.seal import check_seal

pa: Any = pyarrow  # comes without types
pc: Any = pyarrow.compute
pa_csv: Any = pyarrow.csv
pq: Any = pyarrow.parquet

Part = dict[str, NDArray[np.float64]]  # columns of equal length, one stretch of rows

NOTES: Final = b"pmsm-bench"  # key of the notes that a Parquet file of the bench's carries, a JSON object

HEAD = 1 << 16  # bytes in which a CSV's header must end
BLOCK = 1 << 20  # bytes of CSV taken at a time
MISSING = ("", "-", "NA", "N/A", "#N/A", "null", "NULL", "None", "-nan")  # besides nan
ROWS = 1 << 16  # taken at a time where all are wanted
SHOWN = 40  # characters of a cell or a name that a message shows

# How pyarrow says that a line has not the header's number of cells; its rows count the header.
CUT = re.compile(r"Row #(\d+): Expected (\d+) columns, got (\d+): (.*)", re.DOTALL)

# What pyarrow raises over a damaged file, besides its own tree.
FAILURES: tuple[type[Exception], ...] = (
    pa.ArrowException, OSError, EOFError, ValueError, LookupError, OverflowError, MemoryError, csv.Error,
)


def check_undamaged(path: Path) -> None:
    """Raise RecordingError where a Parquet file of the bench's is not as it was written. It is read whole for that."""
    with _as_sentences(path, "its bytes"):
        if _kind(path) == "parquet":
            check_seal(path)


def column_names(path: Path) -> tuple[str, ...]:
    """The file's column names in its order."""
    with _as_sentences(path, "its header"):
        if _kind(path) == "parquet":
            return tuple(pq.read_schema(path).names)
        names = _csv_head(path).names
    if len(names) == 1 and (mark := next((mark for mark in ";\t|" if mark in names[0]), None)):
        raise RecordingError(f"{path}: expected columns separated by commas, and decimal points; came {mark!r}")
    return names


def read_parts(path: Path, columns: Sequence[str], rows: int) -> Generator[Part]:
    """The named columns in parts of at most `rows` rows, in the file's order. Closing it closes the file."""
    names = column_names(path)
    for column in columns:
        if names.count(column) != 1:
            raise RecordingError(f"{path}: expected one column {quoted(column)}, found {names.count(column)}")
    read = _parquet_parts if _kind(path) == "parquet" else _csv_parts
    yield from read(path, list(columns), rows)


def read_whole(path: Path, columns: Mapping[str, str], most: int, too_many: str) -> dict[str, NDArray[np.float64]]:
    """Whole columns by quantity. Raises RecordingError: `too_many` beyond so many rows, and where there are none."""
    check_undamaged(path)
    parts: list[Part] = []
    rows = 0
    for part in read_parts(path, tuple(dict.fromkeys(columns.values())), ROWS):
        parts.append(part)
        rows += len(next(iter(part.values())))
        if rows > most:
            raise RecordingError(f"{path}: {too_many}")
    if not rows:
        raise RecordingError(f"{path}: expected rows below the header, came none")
    return {name: np.concatenate([part[column] for part in parts]) for name, column in columns.items()}


def row_count(path: Path) -> int | None:
    """Rows of a file whose format says so at its start (Parquet); None otherwise."""
    if _kind(path) != "parquet":
        return None
    with _as_sentences(path, "its end"):
        return int(pq.read_metadata(path).num_rows)


def notes(path: Path) -> dict[str, Any]:
    """What the bench noted in a Parquet file when it wrote it; empty in any other file."""
    if _kind(path) != "parquet":
        return {}
    with _as_sentences(path, "its end"):
        kept: Any = pq.read_schema(path).metadata or {}
    try:
        told = json.loads(kept.get(NOTES, b"{}"))
    except (ValueError, RecursionError):
        return {}
    return cast(dict[str, Any], told) if isinstance(told, dict) else {}


def quoted(text: str) -> str:
    """A foreign text, short and on one line."""
    return repr(text if len(text) <= SHOWN else text[: SHOWN - 3] + "...")


def _kind(path: Path) -> str:
    """`csv`, `gzip` or `parquet`, by content."""
    check_regular(path)
    with path.open("rb") as file:
        head = file.read(4096)
    if head.startswith(b"PAR1"):
        return "parquet"
    if path.suffix.lower() in {".parquet", ".pq"} and head:
        raise RecordingError(f"{path}: expected a Parquet file, begins with {head[:4]!r} in place of b'PAR1'")
    if head.startswith(b"\x1f\x8b"):
        return "gzip"
    if b"\0" in head:
        raise RecordingError(f"{path}: expected CSV in UTF-8, CSV.gz or Parquet, came binary data")
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


@dataclass(frozen=True, slots=True)
class _Head:
    names: tuple[str, ...]
    lines: int  # up to and with the header
    empty: bool  # nothing follows


def _open_text(path: Path) -> Any:
    return pa.input_stream(str(path), compression="gzip" if _kind(path) == "gzip" else None)


def _csv_head(path: Path) -> _Head:
    with _open_text(path) as file:
        head: bytes = file.read(HEAD)
    lines = re.split(rb"\r\n|\n|\r", head.removeprefix(b"\xef\xbb\xbf"))
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        if number == len(lines) and len(head) == HEAD:
            raise RecordingError(f"{path}: expected a header line, found none in the first {HEAD} bytes")
        names = next(csv.reader([line.decode("utf-8", errors="replace")]))
        rest = b"".join(lines[number:]).strip()
        return _Head(tuple(name.strip() for name in names), number, not rest and len(head) < HEAD)
    raise RecordingError(f"{path}: the file is empty, expected a header line and rows")


def _csv_parts(path: Path, columns: list[str], rows: int) -> Iterator[Part]:
    with _as_sentences(path, "its header"):
        head = _csv_head(path)
    if head.empty:
        return
    done = 0
    try:
        # Cells are taken as bytes and turned into numbers here, where row and text can still be named.
        with _open_text(path) as file, pa_csv.open_csv(
            file,
            read_options=pa_csv.ReadOptions(
                column_names=_distinct(head.names, columns), skip_rows=head.lines, block_size=BLOCK,
                use_threads=False,
            ),
            convert_options=pa_csv.ConvertOptions(
                include_columns=columns, column_types=dict.fromkeys(columns, pa.binary()),
                strings_can_be_null=True,
            ),
        ) as reader:
            for batch in reader:
                for start in range(0, batch.num_rows, rows):
                    cells = batch.slice(start, rows)
                    yield {name: _from_text(path, name, cells.column(name), done) for name in columns}
                    done += cells.num_rows
    except FAILURES as error:
        if cut := CUT.search(str(error)):
            row, expected, came, text = cut.groups()
            raise RecordingError(
                f"{path}: row {int(row) - 1}: expected {expected} cells, came {came}: {quoted(text)}"
            ) from error
        _refuse(path, f"the rows after {done}", error)


def _distinct(names: tuple[str, ...], columns: list[str]) -> list[str]:
    """Names as pyarrow takes them: those not read may repeat in a file, here they may not."""
    return [name if name in columns else f"\0{place}" for place, name in enumerate(names)]


def _from_text(path: Path, name: str, cells: Any, done: int) -> NDArray[np.float64]:
    try:
        return _as_floats(cells)
    except pa.ArrowInvalid:
        pass
    first = bisect_left(range(len(cells)), True, key=lambda k: not _are_numbers(cells[: k + 1]))
    text = cells[first].as_py().decode("utf-8", errors="replace")
    raise RecordingError(
        f"{path}: column {quoted(name)}, row {done + first + 1}: expected a number, came {quoted(text)}"
    )


def _are_numbers(cells: Any) -> bool:
    try:
        _as_floats(cells)
    except pa.ArrowInvalid:
        return False
    return True


def _as_floats(cells: Any) -> NDArray[np.float64]:
    text = cells.cast(pa.string())
    try:
        numbers = text.cast(pa.float64())
    except pa.ArrowInvalid:
        text = pc.utf8_trim_whitespace(text)
        missing = pc.is_in(text, value_set=pa.array(MISSING))
        numbers = pc.if_else(missing, pa.scalar(None, pa.string()), text).cast(pa.float64())
    return numbers.to_numpy(zero_copy_only=False)


# --- Parquet


def _parquet_parts(path: Path, columns: list[str], rows: int) -> Iterator[Part]:
    done = 0
    try:
        # Not pre-buffered and through a small buffer: a row group is streamed, however long it is.
        options = {"pre_buffer": False, "buffer_size": HEAD, "page_checksum_verification": True}
        with pq.ParquetFile(path, **options) as file:
            for name in columns:
                _expect_numbers(path, name, file.schema_arrow.field(name).type)
            for batch in file.iter_batches(batch_size=rows, columns=columns):
                yield {
                    name: batch.column(name).cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
                    for name in columns
                }
                done += batch.num_rows
    except FAILURES as error:
        _refuse(path, f"the rows after {done}", error)


def _expect_numbers(path: Path, name: str, kind: Any) -> None:
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise RecordingError(f"{path}: column {quoted(name)}: expected numbers, it holds {quoted(str(kind))}")
