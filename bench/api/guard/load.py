"""How much is worked on at once: what is beyond is answered 503, and the Stop of each drive has places of its own."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from anyio import to_thread
from starlette.types import ASGIApp, Receive, Scope, Send

from bench.api.exchange.kinds import READS, is_stop, is_upload, stopped_drive
from bench.api.exchange.problems import problem
from bench.store.write_log import Entry, WriteLog

RETRY: Final = 1  # s
_STOPS: Final = 4
_LINK: Final = re.compile(
    "GET /api/drives/[^/]+/(signals|parameters/set|parameters/rollback)|POST /api/drives/[^/]+/parameters/plan"
)
_STREAM: Final = re.compile(r"GET /api/(drives|diagnoses)/[^/]+/stream")


@dataclass(slots=True)
class Lane:
    """A kind of requests: how many of them at once."""

    what: str
    most: int
    now: int = 0


@dataclass(frozen=True, slots=True)
class Lanes:
    """Every kind. Each request needs one thread at most at a time, and there are as many as requests."""

    stops: dict[str, Lane] = field(default_factory=dict[str, Lane])  # by drive: one that is dead holds up its own alone
    ends: Lane = field(default_factory=lambda: Lane("cancellations", 8))
    streams: Lane = field(default_factory=lambda: Lane("event streams", 32))
    links: Lane = field(default_factory=lambda: Lane("reads of signals", 4))  # a drive answers them one by one
    uploads: Lane = field(default_factory=lambda: Lane("files that are brought", 2))
    others: Lane = field(default_factory=lambda: Lane("requests", 24))

    @classmethod
    def for_drives(cls, names: Iterable[str]) -> "Lanes":
        """With places for the stops of these drives."""
        return cls({name: Lane(f"stops of drive {name}", _STOPS) for name in names})

    def of(self, method: str, path: str) -> Lane:
        """Which a request belongs to."""
        asked = f"{method} {path}"
        if is_stop(method, path):
            return self.stops.get(stopped_drive(method, path) or "", self.ends)
        if is_upload(method, path):
            return self.uploads
        return self.links if _LINK.fullmatch(asked) else self.streams if _STREAM.fullmatch(asked) else self.others

    @property
    def threads(self) -> int:
        """For all at once."""
        stops = sum(lane.most for lane in self.stops.values()) + self.ends.most
        return stops + self.streams.most + self.links.most + self.uploads.most + self.others.most


class Load:
    """ASGI middleware around the application."""

    def __init__(self, app: ASGIApp, log: WriteLog, lanes: Lanes) -> None:
        self._app, self._log, self._lanes = app, log, lanes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        to_thread.current_default_thread_limiter().total_tokens = self._lanes.threads
        lane = self._lanes.of(scope["method"], scope["path"])
        if lane.now >= lane.most:
            said = f"the service answers {lane.most} {lane.what} at once, and so many are under way"
            if scope["method"] not in READS:
                self._log.tell(Entry.of(scope, 503, said))
            answer = problem(503, said)
            answer.headers.update({"Retry-After": str(RETRY), "Connection": "close"})
            await answer(scope, receive, send)
            return
        lane.now += 1
        try:
            await self._app(scope, receive, send)
        finally:
            lane.now -= 1
