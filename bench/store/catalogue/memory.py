"""What a bench remembers in a catalogue: settings and history here, the rest by its own part. Raises UnavailableError
where the catalogue cannot be had.
"""

import json
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Connection, Engine, delete, func, insert, select

from bench.store.catalogue.chronicle import Chronicle
from bench.store.catalogue.database import connected, insert_into
from bench.store.catalogue.ended import EndedJobs
from bench.store.catalogue.found import FoundFiles
from bench.store.catalogue.tables import DIAGNOSES, POINTS, RECORDINGS, SERIES, SPANS, STATUSES, WINDOWS

_DAY: Final = 86_400  # s
FEWEST: Final = 400  # points that a history shows, where there are as many
MOST: Final = 1500


@dataclass(frozen=True, slots=True)
class Point:
    """A parameter of a drive in a second."""

    drive: str
    parameter: str
    t: int  # s since 1970
    value: float
    std: float | None
    status: str  # one of `STATUSES`


@dataclass(frozen=True, slots=True)
class Course:
    """A parameter over time: columns of equal length, SI."""

    t: tuple[float, ...]  # s since 1970, begin of each span
    value: tuple[float, ...]  # mean
    std: tuple[float | None, ...]
    low: tuple[float, ...]  # least and largest value in the span
    high: tuple[float, ...]
    status: tuple[str, ...]


class Memory:
    """What a bench remembers, in a catalogue that other benches may have a part in. From any thread."""

    def __init__(self, engine: Engine, bench: str) -> None:
        self._engine, self._bench = engine, bench
        self.ended, self.chronicle = EndedJobs(engine, bench), Chronicle(engine, bench)
        self._series: dict[tuple[str, str], int] = {}  # ids by drive and parameter

    def recordings(self, folder: Path) -> FoundFiles:
        """What the recordings of a folder say."""
        return FoundFiles(self._engine, RECORDINGS, folder)

    def diagnoses(self, folder: Path) -> FoundFiles:
        """What the diagnoses of a folder say."""
        return FoundFiles(self._engine, DIAGNOSES, folder)

    def close(self) -> None:
        """Close the catalogue's connections; one that is used again is opened anew."""
        self._engine.dispose()

    def look(self) -> None:
        """Nothing but to see that the catalogue is there."""
        with connected(self._engine) as connection:
            connection.execute(select(SERIES.c.id).limit(1))

    def remember_window(self, drive: str, configured: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        """Settings that somebody has chosen; `configured`: what the configuration says."""
        with connected(self._engine) as connection:
            connection.execute(insert(WINDOWS).values(
                bench=self._bench, drive=drive, changed=int(time.time()), configured=_json(configured),
                settings=_json(settings),
            ))

    def window(self, drive: str, configured: Mapping[str, Any]) -> dict[str, Any] | None:
        """The settings chosen last, unless the configuration has changed since."""
        with connected(self._engine) as connection:
            found = connection.execute(
                select(WINDOWS.c.configured, WINDOWS.c.settings).order_by(WINDOWS.c.id.desc()).limit(1)
                .where(WINDOWS.c.bench == self._bench, WINDOWS.c.drive == drive)
            ).first()
        return json.loads(found.settings) if found is not None and found.configured == _json(configured) else None

    def add(self, points: Iterable[Point]) -> None:
        """Put seconds into the history; one that is there stays."""
        given = [
            {"series": self._id(one.drive, one.parameter), "span": 1, "t": one.t, "value": one.value, "std": one.std,
             "low": one.value, "high": one.value, "status": STATUSES.index(one.status)}
            for one in points
        ]  # fmt: skip
        if given:
            with connected(self._engine) as connection:
                connection.execute(insert_into(self._engine, POINTS).on_conflict_do_nothing(), given)

    def condense(self, now: float) -> None:
        """Seconds that are over into minutes, minutes into hours; seconds of more than a day ago go."""
        with connected(self._engine) as connection:
            for fine, coarse in pairwise(SPANS):
                self._condense(connection, fine, coarse, int(now) // coarse * coarse)
            connection.execute(delete(POINTS).where(
                POINTS.c.series.in_(self._own()), POINTS.c.span == 1, POINTS.c.t < int(now) - _DAY,
            ))

    def history(self, drive: str, since: float, until: float) -> tuple[int, dict[str, Course]]:
        """A drive's parameters between two times, in s since 1970, by spans of so many s that show enough.
        """
        span = next((span for span in reversed(SPANS) if (until - since) / span >= FEWEST), SPANS[0])
        if span == 1 and since < time.time() - _DAY:  # there are no seconds of then
            span = SPANS[1]
        together = span * max(1, math.ceil((until - since) / span / MOST))
        p, t = POINTS.c, POINTS.c.t - POINTS.c.t % together
        with connected(self._engine) as connection:
            rows = connection.execute(
                select(SERIES.c.parameter, t.label("at"), func.avg(p.value), func.avg(p.std), func.min(p.low),
                       func.max(p.high), func.max(p.status))
                .join(SERIES, SERIES.c.id == p.series).group_by(SERIES.c.parameter, t).order_by(t)
                .where(SERIES.c.bench == self._bench, SERIES.c.drive == drive, p.span == span,
                       p.t > since - together, p.t <= until)
            ).all()  # fmt: skip
        by_parameter: dict[str, list[Any]] = {}
        for row in rows:
            by_parameter.setdefault(row.parameter, []).append(row[1:])
        return together, {name: _course(points) for name, points in by_parameter.items()}

    def _condense(self, connection: Connection, fine: int, coarse: int, end: int) -> None:
        p = POINTS.c
        begin = connection.execute(
            select(func.max(p.t)).where(p.span == coarse, p.series.in_(self._own()))
        ).scalar()
        since = 0 if begin is None else begin + coarse
        t = p.t - p.t % coarse
        condensed = (
            select(p.series, t.label("t"), func.avg(p.value), func.avg(p.std), func.min(p.low), func.max(p.high),
                   func.max(p.status))
            .where(p.span == fine, p.t >= since, p.t < end, p.series.in_(self._own())).group_by(p.series, t)
        )  # fmt: skip
        rows = [
            {"series": series, "span": coarse, "t": at, "value": value, "std": std, "low": low, "high": high,
             "status": status} for series, at, value, std, low, high, status in connection.execute(condensed).all()
        ]  # fmt: skip
        if rows:
            connection.execute(insert_into(self._engine, POINTS).on_conflict_do_nothing(), rows)

    def _own(self) -> Any:
        return select(SERIES.c.id).where(SERIES.c.bench == self._bench)

    def _id(self, drive: str, parameter: str) -> int:
        key = drive, parameter
        if key not in self._series:
            given = {"bench": self._bench, "drive": drive, "parameter": parameter}
            with connected(self._engine) as connection:
                connection.execute(insert_into(self._engine, SERIES).on_conflict_do_nothing(), given)
                self._series[key] = connection.execute(
                    select(SERIES.c.id).where(*(SERIES.c[name] == value for name, value in given.items()))
                ).scalar_one()
        return self._series[key]


def point_of(drive: str, parameter: str, t: float, value: float | None, std: float | None, status: str) -> Point | None:
    """A point, where there is one to remember."""
    if value is None or status not in STATUSES or not math.isfinite(value):
        return None
    return Point(drive, parameter, int(t), value, std if std is None or math.isfinite(std) else None, status)


def _course(points: Sequence[Sequence[Any]]) -> Course:
    def column(k: int) -> tuple[Any, ...]:
        return tuple(point[k] for point in points)

    return Course(column(0), column(1), column(2), column(3), column(4), tuple(STATUSES[int(one)] for one in column(5)))


def _json(settings: Mapping[str, Any]) -> str:
    return json.dumps(settings, sort_keys=True)
