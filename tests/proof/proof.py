"""What a proof says: bars beside figures, tables, and what could not be shown. Knows nothing of how it is printed.

Every proof is a module with `prove(settings) -> Proof`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Settings:
    """How a proof is run."""

    seed: int  # of the population
    quick: bool  # a part of it, that shows the way
    jobs: int  # processes
    folder: Path  # to work in; what is worth keeping stays there


@dataclass(frozen=True, slots=True)
class Bar:
    """A measure and what was asked of it."""

    what: str
    asked: str  # "at least 97 %"; "" where nothing was
    figure: str  # "96.1 % of 204"
    held: bool | None  # None: nothing was asked, or it could not be judged


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under heads."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Proof:
    """What came out."""

    name: str  # of the module
    title: str
    said: str  # what was done and what it shows, in some sentences
    bars: tuple[Bar, ...]
    tables: tuple[Table, ...] = ()
    pictures: tuple[Any, ...] = ()  # plotly figures
    missing: str = ""  # what could not be run, why, and what would let it run
