"""How a CSV is written, told by its beginning: encoding, separator, decimal sign, header, units.

Lines before the header may say anything, with or without a `#`: the header is the line above the first of the lines
that look like rows. Below it, a row of units may stand. Nothing is guessed that would change a value: where a comma may
be a decimal or a thousands one, a RecordingError asks. Knows nothing of columns' meanings.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Final

from bench.errors import RecordingError, shown
from bench.recordings.forms.units import is_unit, may_be_unit

SEPARATORS: Final = "\t;,|"
_LINE: Final = re.compile(rb"[^\r\n]+")
_SEEN: Final = 300  # lines that tell the form
_LIKE: Final = 0.6  # of the usual share of numbers, that a row has at least
_ABOVE: Final = 3  # lines above the rows among which the header is
_BYTE_ORDER: Final = b"\xef\xbb\xbf"
_COMMENT: Final = "#%"

_EXPONENT: Final = r"(?:[eE][+-]?\d+)?"
_NUMBER: Final = re.compile(rf"[+-]?(?:\d+[.,]?\d*|[.,]\d+){_EXPONENT}")
_WITH_COMMA: Final = re.compile(rf"[+-]?\d*,\d+{_EXPONENT}")
_WITH_POINT: Final = re.compile(rf"[+-]?\d*\.\d+{_EXPONENT}")
THOUSANDS: Final = re.compile(
    r"[+-]?[1-9]\d{0,2}(?:(?:,\d{3})+(?:\.\d*)?|(?:\.\d{3})+(?:,\d*)?|(?:[ '\u00a0]\d{3})+(?:[.,]\d*)?)"
)


@dataclass(frozen=True, slots=True)
class CsvForm:
    """A table in text."""

    names: tuple[str, ...]
    units: tuple[str, ...]  # of the columns, empty where the file has no row of them
    separator: str
    decimal: str  # `.` or `,`
    width: int  # cells of a row: the names, or one more that is empty
    offset: int  # bytes before the first row, in UTF-8
    before: int  # lines before the header
    encoding: str

    def remark(self) -> str:
        """What is not as in a plain CSV, in words."""
        said: list[str] = []
        if self.encoding != "utf-8":
            said.append(f"text in {self.encoding}")
        if self.separator != ",":
            said.append(f"columns separated by {'tabs' if self.separator == chr(9) else shown(self.separator)}")
        if self.decimal != ".":
            said.append("decimal commas")
        if self.before:
            said.append(f"lines before the header: {self.before}")
        if self.units:
            said.append("a row of units below the header")
        return f"the file has {', '.join(said)}" if said else ""


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where header and rows are, if the columns are separated like this."""

    separator: str
    header: int  # line
    units: int | None  # line
    first: int  # line of the first row
    width: int
    numbers: float  # share of a row's cells that are


def form_of(head: bytes, encoding: str, *, whole: bool) -> CsvForm | None:
    """The form that a file's first bytes (UTF-8, or of eight bits) tell; None of a file without a line.

    `whole`: they are all of it. Raises RecordingError.
    """
    spans = [found.span() for found in _LINE.finditer(head.removeprefix(_BYTE_ORDER)) if found[0].strip()]
    if not whole:
        spans = spans[:-1] or spans
    if not spans:
        return None
    spans, skipped = spans[:_SEEN], len(_BYTE_ORDER) if head.startswith(_BYTE_ORDER) else 0
    told = [decoded(head[skipped + a : skipped + b]) for a, b in spans]
    texts = [text for text, _ in told]
    layout = _best(texts)
    separator = layout.separator
    names = _cells(texts[layout.header], separator)
    names[0] = names[0].lstrip(_COMMENT).strip() or names[0]
    units = [] if layout.units is None else [cell.strip("[]()") for cell in _cells(texts[layout.units], separator)]
    below = layout.header if layout.units is None else layout.units
    used = [told[k][1] for k in (layout.header, below)]
    return CsvForm(
        names=tuple(names), units=tuple(units), separator=separator, width=layout.width,
        decimal=_decimal([_cells(text, separator) for text in texts[layout.first :]]),
        offset=skipped + spans[below][1], before=layout.header,
        encoding=next((one for one in used if one != "utf-8"), encoding),
    )


def decoded(line: bytes) -> tuple[str, str]:
    """A line's text and its encoding: UTF-8, or else that of Windows."""
    try:
        return line.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace"), "cp1252"


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [""])] or [""]


def _best(texts: Sequence[str]) -> _Layout:
    """The layout by which the rows are numbers; else the first line is the header."""
    found = [one for separator in SEPARATORS if (one := _layout(texts, separator)) is not None]
    if found:
        return max(found, key=lambda one: (one.numbers, one.width))
    separator = max(",\t;|", key=lambda one: len(_cells(texts[0], one)))
    return _Layout(separator, 0, None, 1, len(_cells(texts[0], separator)), 0.0)


def _layout(texts: Sequence[str], separator: str) -> _Layout | None:
    rows = [_cells(text, separator) for text in texts]
    shares = [_numbers(row) for row in rows]
    later = range(len(rows) // 2, len(rows))
    counts = Counter(len(rows[k]) for k in later if shares[k] > 0.0 and len(rows[k]) > 1)
    if not counts:
        return None
    width = counts.most_common(1)[0][0]
    typical = median(shares[k] for k in later if len(rows[k]) == width and shares[k] > 0.0)

    def is_row(k: int) -> bool:
        return k >= len(rows) or (len(rows[k]) == width and shares[k] >= _LIKE * typical)

    first = next((k for k in range(len(rows)) if is_row(k) and (is_row(k + 1) or is_row(k + 2))), None)
    if first is None:
        return None
    ends = all(not row[-1] for row in rows[first:] if len(row) == width)  # each row with an empty cell
    above = [k for k in range(first - 1, max(first - 1 - _ABOVE, -1), -1) if _names(rows[k], width, ends=ends)]
    if not above:
        return None
    header, units = above[0], None
    if len(above) > 1 and above[1] == header - 1 and _are_units(rows[header]):
        header, units = above[1], header
    return _Layout(separator, header, units, first, width, typical)


def _names(row: Sequence[str], width: int, *, ends: bool) -> bool:
    """Whether a line may name the columns of rows of so many cells: an empty cell at an end is none."""
    if _numbers(row) >= 0.5 or not any(row):
        return False
    return len(row) == width or (len(row) == width - 1 and ends) or (len(row) == width + 1 and not row[-1])


def _are_units(row: Sequence[str]) -> bool:
    cells = [cell.strip("[]()") for cell in row]
    known = sum(map(is_unit, cells))
    return known > 0 and 2 * sum(map(may_be_unit, cells)) >= len(cells)


def _numbers(row: Sequence[str]) -> float:
    """Share of the cells with something in them that are numbers."""
    filled = [cell for cell in row if cell]
    return sum(_NUMBER.fullmatch(cell) is not None for cell in filled) / len(filled) if filled else 0.0


def _decimal(rows: Sequence[Sequence[str]]) -> str:
    cells = [cell for row in rows for cell in row]
    commas = [cell for cell in cells if _WITH_COMMA.fullmatch(cell)]
    if not commas:
        return "."
    if not all(map(THOUSANDS.fullmatch, commas)):
        return ","
    if any(map(_WITH_POINT.fullmatch, cells)):
        return "."  # these are none then, which whoever reads them says
    raise RecordingError(
        f"expected numbers that can be told, came {commas[0]!r}: is it a decimal comma or one between thousands? "
        "write thousands without a separator"
    )
