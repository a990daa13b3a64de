"""A CSV's rows to columns of float64, block by block, and the lines that are no rows: left out, counted and told.

A block is read by pyarrow as a whole; where it has a line that cannot be read, line by line. The line ends a stretch of
rows: a part without columns, `{}`, stands in its place. Where many lines are like that, the file is refused.
"""

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
import pyarrow
import pyarrow.compute
import pyarrow.csv
from numpy.typing import NDArray

from bench.errors import RecordingError
from bench.recordings.forms.csv_form import THOUSANDS, CsvForm, decoded

pa: Any = pyarrow  # comes without types
pc: Any = pyarrow.compute
pa_csv: Any = pyarrow.csv

Part = dict[str, NDArray[np.float64]]  # columns of equal length, one stretch of rows; none: a line was left out

BLOCK: Final = 1 << 20  # bytes of CSV taken at a time
LONGEST: Final = 1 << 24  # bytes of a line
MISSING: Final = ["", "-", "NA", "N/A", "#N/A", "null", "NULL", "None", "-nan"]  # besides nan
MANY: Final = 0.01  # share of lines that cannot be read, from which on a file is none
HOPELESS: Final = 0.1  # such a share of what has been read so far
SHOWN: Final = 40  # characters of a cell or a name that a message shows
_ALIKE: Final = 10  # rows with as many decimals, beside which one with fewer is cut


class Bytes(Protocol):
    """A file open to be read."""

    def read(self, size: int, /) -> bytes: ...


def quoted(text: str) -> str:
    """A foreign text, short and on one line."""
    return repr(text if len(text) <= SHOWN else text[: SHOWN - 3] + "...")


@dataclass(slots=True)
class Lines:
    """The account of a file's lines below its header."""

    rows: int = 0  # so far, with those left out
    bad: int = 0  # that cannot be read
    first: str = ""  # what is wrong with the first of them
    wide: int = 0  # of them, that have more cells than the header has, in a file with commas between columns
    cells: Counter[int] = field(default_factory=Counter[int])  # those that have another number of them, by that
    headers: int = 0  # that repeat the header
    cut: str = ""  # what is wrong with a last line that does not end

    def complain(self, said: str) -> None:
        """A line cannot be read."""
        self.bad += 1
        self.first = self.first or said

    def check(self, share: float, names: int) -> None:
        """Raise RecordingError where more than that share of the lines cannot be read; `names`: in the header."""
        if self.bad > share * self.rows:
            many = f"; {self.bad} of {self.rows} rows cannot be read" if self.bad > 1 else ""
            commas = ": are there commas in numbers beside commas between columns?" if self.wide == self.bad else ""
            alike = [f"the header has {names} names, every row {n} cells: " for n in self.cells if self._all_have(n)]
            raise RecordingError(f"{''.join(alike)}{self.first}{many}{commas}")

    def _all_have(self, cells: int) -> bool:
        return self.cells[cells] == self.rows

    def remarks(self) -> tuple[str, ...]:
        """A sentence for each kind of line that was left out."""
        said: list[str] = []
        if self.bad:
            said.append(f"lines left out that cannot be read: {self.bad} of {self.rows}; {self.first}")
        if self.headers:
            said.append(f"lines left out that are the header again: {self.headers}")
        if self.cut:
            said.append(f"the last line is cut short and left out: {self.cut}")
        return tuple(said)


def parts_of(file: Bytes, form: CsvForm, columns: Sequence[str], rows: int, lines: Lines) -> Iterator[Part]:
    """The named columns in parts of at most so many rows. Raises RecordingError, pyarrow's errors and csv.Error."""
    _skip(file, form.offset)
    reading = _reading(form, columns)
    for block, open_ended in _blocks(file):
        for stretch in _stretches(block, form, columns, reading, lines, open_ended=open_ended):
            yield from _divided(stretch, rows)
    lines.check(MANY, len(form.names))


def _stretches(
    block: bytes, form: CsvForm, columns: Sequence[str], reading: dict[str, Any], lines: Lines, *, open_ended: bool
) -> list[Part]:
    """A block's stretches of rows, with an empty part for every line that is none."""
    if not (open_ended and _is_cut(block, form)):
        try:
            whole = _columns_of(block, form, columns, reading)
        except pa.ArrowInvalid:
            pass
        else:
            lines.rows += len(whole[columns[0]])
            return [whole]
    stretches = list(_line_by_line(block, form, columns, lines, open_ended=open_ended))
    lines.check(HOPELESS, len(form.names))
    return stretches


def _skip(file: Bytes, size: int) -> None:
    while size > 0 and (read := file.read(size)):
        size -= len(read)


def _blocks(file: Bytes) -> Iterator[tuple[bytes, bool]]:
    """Whole lines, and whether the last of them has no end."""
    block = rest = b""
    while read := file.read(BLOCK):
        rest += read
        if len(rest) > LONGEST:
            raise RecordingError(f"expected lines, found none that ends within {LONGEST} bytes")
        end = rest.rfind(b"\n") + 1 or rest.rfind(b"\r", 0, -1) + 1  # a last \r may be half of an end
        if end:
            if block:
                yield block, False
            block, rest = rest[:end], rest[end:]
    yield block + rest, bool(rest.strip()) and not rest.endswith((b"\r", b"\n"))


def _divided(stretch: Part, rows: int) -> Iterator[Part]:
    if not stretch:
        yield stretch
        return
    for start in range(0, len(next(iter(stretch.values()))), rows):
        yield {name: column[start : start + rows] for name, column in stretch.items()}


# --- a block at once


def _reading(form: CsvForm, columns: Sequence[str]) -> dict[str, Any]:
    """How pyarrow reads a block."""
    names = [name if name in columns else f"\0{place}" for place, name in enumerate(form.names)]  # others may repeat
    beyond = [f"\0{place}" for place in range(len(names), form.width)]
    kinds = dict.fromkeys(columns, pa.float64()) | dict.fromkeys(beyond, pa.binary())
    return {
        "read_options": pa_csv.ReadOptions(
            column_names=[*names[: form.width], *beyond], block_size=2 * LONGEST, use_threads=False
        ),
        "parse_options": pa_csv.ParseOptions(delimiter=form.separator),
        "convert_options": pa_csv.ConvertOptions(
            include_columns=list(kinds), column_types=kinds, null_values=MISSING, decimal_point=form.decimal
        ),
    }


def _columns_of(block: bytes, form: CsvForm, columns: Sequence[str], reading: dict[str, Any]) -> Part:
    """Raises pyarrow's ArrowInvalid where a line cannot be read."""
    if not block.strip():
        return dict.fromkeys(columns, np.empty(0))
    table = pa_csv.read_csv(pa.BufferReader(block), **reading)
    if form.width > len(form.names) and pc.max(pc.binary_length(table.columns[-1])).as_py():
        raise pa.ArrowInvalid  # a cell too many that has something in it
    return {name: table[name].to_numpy() for name in columns}


# --- a block line by line


def _line_by_line(
    block: bytes, form: CsvForm, columns: Sequence[str], lines: Lines, *, open_ended: bool
) -> Iterator[Part]:
    """Stretches of rows, and an empty part for every line that is none. `open_ended`: the last line has no end."""
    places = [form.names.index(name) for name in columns]
    texts = [line for line in re.split(rb"\r\n|\n|\r", block) if line.strip()]
    good: list[list[float]] = []

    def stretch() -> Iterator[Part]:
        if good:
            yield dict(zip(columns, np.array(good).T.copy(), strict=True))
            good.clear()

    for k, line in enumerate(texts):
        lines.rows += 1
        cut = open_ended and k == len(texts) - 1
        row = _row(decoded(line)[0], form, places, lines, cut=cut and _is_cut(block, form), last=cut)
        if row is not None:
            good.append(row)
            continue
        yield from stretch()
        yield {}
    yield from stretch()


def _row(line: str, form: CsvForm, places: Sequence[int], lines: Lines, *, cut: bool, last: bool) -> list[float] | None:
    """The numbers of a line; None where it has none, which is then told."""
    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=form.separator), [""])]
    names = list(form.names)
    while len(cells) > len(names) and not cells[-1]:
        cells.pop()
    if tuple(cells) in (form.names, form.units):
        lines.headers += tuple(cells) == form.names
        return None
    said = ""
    if len(cells) < len(names) - (not names[-1]) or len(cells) > len(names):
        said = f"row {lines.rows}: expected {len(names)} cells, came {len(cells)}: {quoted(line)}"
        lines.cells[len(cells)] += 1
        lines.wide += len(cells) > len(names) and form.separator == ","
    elif cut:
        said = f"row {lines.rows}: expected as many decimals as above it, came {quoted(cells[-1])}"
    else:
        row = [_number(cells[place], form.decimal) for place in places]
        if None not in row:
            return [x for x in row if x is not None]
        wrong = places[row.index(None)]
        said = f"column {quoted(names[wrong])}, row {lines.rows}: expected a number, came {quoted(cells[wrong])}"
        if THOUSANDS.fullmatch(cells[wrong]):
            said += ": thousands are to stand without separators"
    if last:
        lines.cut = said
    else:
        lines.complain(said)
    return None


def _number(cell: str, decimal: str) -> float | None:
    """A cell's number, nan where nothing is in it, None where it is none."""
    if cell in MISSING:
        return float("nan")
    if (decimal == "," and "." in cell) or "_" in cell or not cell.isascii():
        return None
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def _is_cut(block: bytes, form: CsvForm) -> bool:
    """Whether the last line, which has no end, has fewer decimals in its last cell than all lines above it."""
    lines = [line for line in re.split(rb"\r\n|\n|\r", block[-1 << 14 :]) if line.strip()][1:]
    if len(lines) <= _ALIKE:
        return False
    cells = (line.rpartition(form.separator.encode())[2] for line in lines)
    *above, last = (len(cell.rpartition(form.decimal.encode())[2]) for cell in cells)
    return len(set(above)) == 1 and last < above[0]
