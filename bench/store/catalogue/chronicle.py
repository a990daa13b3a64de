"""What happened to drives, in the catalogue: events, writes that reached them, who controlled them, their parameters.

Each kind is bounded in number; the oldest go. Raises UnavailableError where the catalogue cannot be had.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final

from sqlalchemy import Engine, Table, and_, delete, func, insert, or_, select, update

from bench.store.catalogue.database import connected, microseconds, plain, time_at
from bench.store.catalogue.tables import AUDIT, EVENTS, LEASES, PARAMETERS

WRITE, LEASE = "write", "lease"  # kinds of what happened, besides those of events
_MOST: Final = 200_000  # rows of a table
_LEFT: Final = "the service ended without giving it up; the drive's own lease runs out by itself"
_ORDER: Final = (EVENTS, AUDIT, LEASES, PARAMETERS)  # of what is of one moment
_ID: Final = re.compile("([0-9])-([0-9]{1,18})")
_ALL: Final = 2**31 - 1  # ids

Place = tuple[datetime, str]
"""In a list: the moment, and the id among those of that moment; an empty one is before all of them."""


@dataclass(frozen=True, slots=True)
class Happening:
    """Something that happened to a drive."""

    drive: str
    at: datetime
    kind: str  # link, clock, state, fault, flash, write, lease
    sentence: str
    told: Mapping[str, Any] = field(default_factory=dict[str, Any])  # of a write, or a lease: all that is known
    id: str = field(default="", compare=False)  # among those of a moment, the later the larger

    @property
    def place(self) -> Place:
        """In the list of all."""
        return self.at, self.id


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """A drive's parameters at a moment; SI, None where one is not finite."""

    drive: str
    at: datetime
    why: str  # it was read: what began
    device: str  # in words
    values: Mapping[str, float | None]
    id: str = field(default="", compare=False)

    @property
    def place(self) -> Place:
        """In the list of all."""
        return self.at, self.id


class Chronicle:
    """That of a bench; from any thread."""

    def __init__(self, engine: Engine, bench: str) -> None:
        self._engine, self._bench = engine, bench

    def happened(self, one: Happening) -> None:
        """Add an event."""
        self._insert(EVENTS, {
            "drive": one.drive, "at": microseconds(one.at), "kind": one.kind, "sentence": plain(one.sentence),
        })  # fmt: skip

    def wrote(self, drive: str, at: datetime, told: Mapping[str, Any]) -> None:
        """Add a write, as the log of writes tells it; of no drive: an empty name."""
        texts = {key: plain(str(told[key])) for key in ("who", "by", "method", "path", "outcome", "body")}
        changes = {key: json.dumps(told.get(key), default=str) for key in ("before", "after")}
        self._insert(AUDIT, {"drive": drive, "at": microseconds(at), "status": told["status"]} | texts | changes)

    def took(self, drive: str, part: str, holder: str, at: datetime) -> None:
        """Somebody controls a part of a drive from now on."""
        self._insert(LEASES, {"drive": drive, "part": part, "holder": plain(holder), "at": microseconds(at)})

    def gave_up(self, drive: str, part: str, holder: str, at: datetime, how: str) -> None:
        """And does no longer."""
        own = self._own(LEASES, drive)
        with connected(self._engine) as connection:
            connection.execute(
                update(LEASES).where(*own, LEASES.c.part == part, LEASES.c.holder == plain(holder), LEASES.c.how == "")
                .values(ended=microseconds(at), how=plain(how))
            )

    def left(self, before: datetime) -> None:
        """Those that have controlled drives since before a service began did so under another one, which was killed."""
        with connected(self._engine) as connection:
            connection.execute(
                update(LEASES).values(how=_LEFT)
                .where(LEASES.c.bench == self._bench, LEASES.c.how == "", LEASES.c.at < microseconds(before))
            )

    def page(
        self, drive: str, kind: str | None, before: Place | None, limit: int
    ) -> tuple[list[Happening], int]:
        """What happened to a drive before a place, the newest first; how many there are."""
        found: list[Happening] = []
        total = 0
        for table in _tables_of(kind):
            of = [*self._own(table, drive), *_before(table, before)]
            if table is EVENTS and kind is not None:
                of.append(table.c.kind == kind)
            newest = select(table).where(*of).order_by(table.c.at.desc(), table.c.id.desc()).limit(limit)
            with connected(self._engine) as connection:
                total += connection.execute(select(func.count()).select_from(table).where(*of)).scalar_one()
                found += [_happening(table, row) for row in connection.execute(newest).mappings()]
        return sorted(found, key=lambda one: one.place, reverse=True)[:limit], total

    def add_snapshot(self, one: ParameterSet) -> None:
        """Add a drive's parameters."""
        self._insert(PARAMETERS, {
            "drive": one.drive, "at": microseconds(one.at), "why": plain(one.why), "device": plain(one.device),
            "values": json.dumps(one.values, sort_keys=True),
        })  # fmt: skip

    def snapshots(self, drive: str, before: Place | None, limit: int) -> tuple[list[ParameterSet], int]:
        """A drive's parameters before a place, the newest first, and how many times they were kept."""
        t = PARAMETERS.c
        of = [*self._own(PARAMETERS, drive), *_before(PARAMETERS, before)]
        newest = select(PARAMETERS).where(*of).order_by(t.at.desc(), t.id.desc()).limit(limit)
        with connected(self._engine) as connection:
            total = connection.execute(select(func.count()).select_from(PARAMETERS).where(*of)).scalar_one()
            rows = connection.execute(newest).mappings().all()
        return [
            ParameterSet(
                row["drive"], time_at(row["at"]), row["why"], row["device"], json.loads(row["values"]),
                _id(PARAMETERS, row["id"]),
            )
            for row in rows
        ], total

    def prune(self, most: int = _MOST) -> None:
        """Of each kind so many stay, the newest."""
        for table in (EVENTS, AUDIT, LEASES, PARAMETERS):
            own = table.c.bench == self._bench
            with connected(self._engine) as connection:
                oldest = connection.execute(
                    select(table.c.id).where(own).order_by(table.c.id.desc()).offset(most - 1).limit(1)
                ).scalar()
                if oldest is not None:
                    connection.execute(delete(table).where(own, table.c.id < oldest))

    def _own(self, table: Table, drive: str) -> list[Any]:
        return [table.c.bench == self._bench, table.c.drive == drive]

    def _insert(self, table: Table, row: Mapping[str, Any]) -> None:
        with connected(self._engine) as connection:
            connection.execute(insert(table).values(bench=self._bench, **row))


def _tables_of(kind: str | None) -> Sequence[Table]:
    special = {WRITE: AUDIT, LEASE: LEASES}
    return (EVENTS, AUDIT, LEASES) if kind is None else (special.get(kind, EVENTS),)


def _id(table: Table, number: int) -> str:
    """Of a row, among those of a moment in any table."""
    return f"{_ORDER.index(table)}-{number:010d}"


def _before(table: Table, place: Place | None) -> list[Any]:
    """The condition on a table's rows that they are before a place."""
    if place is None:
        return []
    at, id_ = microseconds(place[0]), _ID.fullmatch(place[1])
    order, number = (int(id_[1]), int(id_[2])) if id_ else (-1, 0)
    ours = _ORDER.index(table)
    most = min(number, _ALL) if ours == order else _ALL if ours < order else 0
    return [or_(table.c.at < at, and_(table.c.at == at, table.c.id < most))]


def _happening(table: Table, row: Mapping[Any, Any]) -> Happening:
    at, id_ = time_at(row["at"]), _id(table, row["id"])
    if table is AUDIT:
        names = ("who", "by", "method", "path", "status", "outcome", "body")
        changes = {key: json.loads(row[key]) for key in ("before", "after")}
        sentence = f"{row['method']} {row['path']} from {row['who']}: {row['status']} {row['outcome']}"
        return Happening(row["drive"], at, WRITE, sentence, _those(row, names) | changes, id_)
    if table is LEASES:
        ended = None if row["ended"] is None else time_at(row["ended"])
        what = "" if row["part"] == "control" else "'s recorder"
        sentence = f"{row['holder']} has the drive{what}" if not row["how"] else (
            f"{row['holder']} had the drive{what}, until it ended: {row['how']}"
        )
        told = _those(row, ("part", "holder", "how")) | {"ended": ended}
        return Happening(row["drive"], at, LEASE, sentence, told, id_)
    return Happening(row["drive"], at, row["kind"], row["sentence"], id=id_)


def _those(row: Mapping[Any, Any], names: Iterable[str]) -> dict[str, Any]:
    return {name: row[name] for name in names}
