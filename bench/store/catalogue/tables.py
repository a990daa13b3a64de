"""Tables of the catalogue, as SQLAlchemy has them. Times are UTC since 1970: whole seconds of windows and in the
history, microseconds elsewhere.
"""

from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    SmallInteger,
    String,
    Table,
    Text,
)
from sqlalchemy import UniqueConstraint as Unique

METADATA: Final = MetaData()

WINDOWS: Final = Table(  # settings of the estimation, whenever somebody changed them
    "window_settings", METADATA,
    Column("id", Integer, primary_key=True),
    Column("bench", String(200), nullable=False, index=True),
    Column("drive", String(200), nullable=False),
    Column("changed", BigInteger, nullable=False),
    Column("configured", Text, nullable=False),  # JSON: what the configuration said then
    Column("settings", Text, nullable=False),  # JSON
)  # fmt: skip

SERIES: Final = Table(  # whose history
    "series", METADATA,
    Column("id", Integer, primary_key=True),
    Column("bench", String(200), nullable=False),
    Column("drive", String(200), nullable=False),
    Column("parameter", String(20), nullable=False),
    Unique("bench", "drive", "parameter", name="series_once"),
)  # fmt: skip

POINTS: Final = Table(  # a parameter over a second, a minute, an hour; SI
    "points", METADATA,
    Column("series", Integer, ForeignKey("series.id"), primary_key=True),
    Column("span", Integer, primary_key=True, autoincrement=False),  # s
    Column("t", BigInteger, primary_key=True, autoincrement=False),  # begin
    Column("value", Double, nullable=False),  # mean
    Column("std", Double),  # mean standard error; null: a value that is held
    Column("low", Double, nullable=False),
    Column("high", Double, nullable=False),
    Column("status", SmallInteger, nullable=False),  # place in `STATUSES`, of the worst
    sqlite_with_rowid=False,
)  # fmt: skip


def _ended(name: str) -> Table:
    """Jobs of a kind that have ended."""
    return Table(
        name, METADATA,
        Column("bench", String(200), primary_key=True),
        Column("id", String(250), primary_key=True),
        Column("drive", String(200), nullable=False),
        Column("asked", BigInteger, nullable=False, index=True),
        Column("state", String(20), nullable=False),
        Column("progress", Double, nullable=False),  # 0 to 1
        Column("samples", Integer, nullable=False),
        Column("reason", Text, nullable=False),
        Column("remarks", Text, nullable=False),  # JSON: a list
        Column("file", Text),  # null: there is no recording
        Column("request", Text, nullable=False),  # JSON
    )  # fmt: skip


CAPTURES: Final = _ended("captures")
EXPERIMENTS: Final = _ended("experiments")

RECORDINGS: Final = Table(  # what the files of a folder say of themselves; the files are the truth
    "recordings", METADATA,
    Column("folder", String(1000), primary_key=True),  # host:path
    Column("id", String(250), primary_key=True),
    Column("changed", BigInteger, nullable=False),  # ns since 1970: the file's, by which it is known to be the same
    Column("bytes", BigInteger, nullable=False),
    Column("kind", String(20), nullable=False),
    Column("drive", Text, nullable=False),
    Column("begun", BigInteger, nullable=False),
    Column("rows", BigInteger, nullable=False),
    Column("seconds", Double),
    Column("columns", Text, nullable=False),  # JSON: a list
    Column("title", Text, nullable=False),
    Column("note", Text, nullable=False),
    Column("marks", Text, nullable=False),  # JSON: a list of objects
    Column("whole", Boolean, nullable=False),
    Column("ended", Text, nullable=False),
    Column("gaps", Integer, nullable=False),
    Column("rows_lost", BigInteger, nullable=False),
    Column("continues", Text, nullable=False),
    Column("url", Text, nullable=False, server_default=""),
    Column("problem", Text, nullable=False),
)  # fmt: skip

DIAGNOSES: Final = Table(  # likewise
    "diagnoses", METADATA,
    Column("folder", String(1000), primary_key=True),
    Column("id", String(50), primary_key=True),
    Column("recording", Text, nullable=False),
    Column("drive", Text, nullable=False),
    Column("asked", BigInteger, nullable=False),
    Column("started", BigInteger),
    Column("ended", BigInteger, nullable=False),
    Column("state", String(20), nullable=False),
    Column("reason", Text, nullable=False),
    Column("verdict", String(50)),
    Column("sentence", Text),
    Column("request", Text, nullable=False),  # JSON
    Column("versions", Text, nullable=False),  # JSON
    Column("sums", Text, nullable=False),  # JSON: SHA-256 of each file
)  # fmt: skip

def _happened(name: str, *columns: Column[Any]) -> Table:
    """What happened to drives, each at a time."""
    return Table(
        name, METADATA,
        Column("id", Integer, primary_key=True),
        Column("bench", String(200), nullable=False),
        Column("drive", String(200), nullable=False),  # empty: none
        Column("at", BigInteger, nullable=False),
        *columns,
        Index(f"ix_{name}_drive", "bench", "drive", "at"),
    )  # fmt: skip


EVENTS: Final = _happened(  # links lost and back, clocks begun anew, states, faults
    "events",
    Column("kind", String(20), nullable=False),
    Column("sentence", Text, nullable=False),
)  # fmt: skip

AUDIT: Final = _happened(  # every write that reached a drive or a setting
    "audit",
    *(Column(name, Text, nullable=False) for name in ("who", "by", "method", "path")),
    Column("status", Integer, nullable=False),
    *(Column(name, Text, nullable=False) for name in ("outcome", "body")),
    *(Column(name, Text, nullable=False) for name in ("before", "after")),  # JSON
)  # fmt: skip

LEASES: Final = _happened(  # who controlled what of a drive, from `at` on
    "leases",
    Column("part", String(20), nullable=False),
    Column("holder", Text, nullable=False),
    Column("ended", BigInteger),  # null: it goes on, or when is not known
    Column("how", Text, nullable=False, server_default=""),  # it ended; empty: it goes on
)  # fmt: skip

PARAMETERS: Final = _happened(  # a drive's parameters, whenever they were other than before
    "parameters",
    Column("why", Text, nullable=False),  # they were read
    Column("device", Text, nullable=False),
    Column("values", Text, nullable=False),  # JSON: by name, SI
)  # fmt: skip

STATUSES: Final[tuple[str, ...]] = ("held", "ok", "doubtful")
SPANS: Final[tuple[int, ...]] = (1, 60, 3600)  # s
