"""Captures and experiments that have ended, in the catalogue: what was asked of whom, and how it went.

Raises UnavailableError where the catalogue cannot be had.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from sqlalchemy import Engine, Table, select

from bench.store.catalogue.database import connected, microseconds, plain, put, time_at
from bench.store.catalogue.tables import CAPTURES, EXPERIMENTS

_TABLES: Final[Mapping[str, Table]] = {"capture": CAPTURES, "experiment": EXPERIMENTS}


@dataclass(frozen=True, slots=True)
class EndedJob:
    """A capture or an experiment that has ended."""

    kind: str  # capture, experiment
    id: str
    drive: str
    asked: datetime
    state: str
    progress: float  # 0 to 1
    samples: int
    reason: str
    remarks: tuple[str, ...]
    file: str | None  # the recording
    request: Mapping[str, Any]  # as plain values


class EndedJobs:
    """Those of a bench; from any thread."""

    def __init__(self, engine: Engine, bench: str) -> None:
        self._engine, self._bench = engine, bench

    def add(self, job: EndedJob) -> None:
        """Remember one; another of its id goes."""
        row = {
            "bench": self._bench, "id": job.id, "drive": job.drive, "asked": microseconds(job.asked),
            "state": job.state, "progress": job.progress, "samples": job.samples, "reason": plain(job.reason),
            "remarks": json.dumps(job.remarks), "file": job.file and plain(job.file),
            "request": json.dumps(job.request),
        }  # fmt: skip
        with connected(self._engine) as connection:
            connection.execute(put(self._engine, _TABLES[job.kind]), row)

    def latest(self, kind: str, most: int) -> list[EndedJob]:
        """The newest, at most so many, the oldest first."""
        table = _TABLES[kind]
        chosen = select(table).where(table.c.bench == self._bench).order_by(table.c.asked.desc()).limit(most)
        with connected(self._engine) as connection:
            rows = connection.execute(chosen).all()
        return [
            EndedJob(
                kind, row.id, row.drive, time_at(row.asked), row.state, row.progress, row.samples, row.reason,
                tuple(json.loads(row.remarks)), row.file, json.loads(row.request),
            ) for row in reversed(rows)
        ]  # fmt: skip
