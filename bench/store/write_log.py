"""The logs of a service's writes: `writes.jsonl` has every one that reached a drive or a setting, `refused.jsonl` those
that did not. JSON, a line each, appended by a thread of its own: no request waits for a disk. Bounded in size; refusals
in number, too, so that nobody fills a disk, or pushes out what was done, by being refused.
"""

import contextlib
import json
import os
import queue
import select
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Self, cast

SHORT: Final = 500  # letters of a body, a value, a sentence
_SIZE: Final = 8 << 20  # bytes of a file, until another is begun
_FILES: Final = {"writes": 8, "refused": 2}  # kept of each
_WAITING: Final = 10_000  # entries for the disk
_BURST, _RATE = 100, 2.0  # refusals told at once, and per s for longer
_LEAVE: Final = 0.3  # s for the last entries
_SILENT: Final = "refused and not told one by one: they came too fast"


@dataclass(frozen=True, slots=True)
class Entry:
    """A write, or what was refused to read."""

    who: str  # address
    by: str  # "loopback", "token", "page"; empty at the gate
    method: str
    path: str
    status: int
    outcome: str
    body: str = ""
    before: Mapping[str, Any] | None = None
    after: Mapping[str, Any] | None = None
    done: bool = False  # it reached what it is about, whatever came of it
    time: datetime = field(default_factory=lambda: datetime.now(UTC))

    @classmethod
    def of(cls, scope: Mapping[str, Any], status: int, outcome: str, **more: Any) -> Self:
        """Of a request as ASGI tells it."""
        client, state = scope.get("client"), cast(dict[str, Any], scope.get("state") or {})
        return cls(
            client[0] if client else "", state.get("by", ""), short(scope["method"]), short(scope["path"]), status,
            short(outcome), **more,
        )  # fmt: skip

    def line(self) -> str:
        """JSON, in ASCII alone: whatever came, it is one line."""
        told: dict[str, Any] = {"time": self.time.isoformat(timespec="milliseconds")}
        told |= {key: getattr(self, key) for key in ("who", "by", "method", "path", "status", "outcome", "body")}
        for key in ("before", "after"):
            value = getattr(self, key)
            if value is not None:
                text = json.dumps(value, default=str)
                told[key] = value if len(text) <= 4 * SHORT else short(text)
        return json.dumps(told, default=str)

    def sentence(self) -> str:
        """What was written, in short, for the service's own log."""
        changes = "" if self.before is None or self.after is None else "; " + ", ".join(
            f"{key} {self.before.get(key)} -> {value}" for key, value in self.after.items()
        )
        by = f" by {self.by}" if self.by else ""
        said_with = f" {self.body}" if self.body else ""
        said = f"{self.method} {self.path}{said_with} from {self.who}{by}: {self.status} {self.outcome}{changes}"
        return short("".join(letter if " " <= letter <= "~" else ascii(letter)[1:-1] for letter in said))


class Allowance:
    """So much at once, and so much a second for longer. For one thread, or under a lock."""

    def __init__(self, at_once: float, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        """`rate`: 1/s."""
        self._most, self._rate, self._clock = at_once, rate, clock
        self._left, self._counted = at_once, clock()

    def take(self) -> bool:
        """Whether one more is allowed, which is counted then."""
        now = self._clock()
        self._left = min(self._most, self._left + self._rate * (now - self._counted))
        self._counted = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class WriteLog:
    """The logs in a folder, while it is entered; `echo` tells each entry on the service's own log, too."""

    def __init__(
        self, folder: Path, echo: Callable[[str], None] = lambda line: None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._folder, self._echo = folder, echo
        self.also: Callable[[Entry], None] = lambda entry: None  # hears each that was done; does not wait
        self._queue: queue.Queue[Entry | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._work, name="log of writes", daemon=True)
        self._lock = threading.Lock()  # guards what follows
        self._lost = 0  # that the disk was too slow for
        self._silent = 0  # refusals not told one by one
        self._refusals = Allowance(_BURST, _RATE, clock)
        self._failed = False

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(queue.Full):
            self._queue.put(None, timeout=_LEAVE)
        self._thread.join(_LEAVE)

    def tell(self, entry: Entry) -> None:
        """Write it down, soon. Never waits, never fails."""
        with self._lock:
            if not entry.done and not self._refusals.take():
                self._silent += 1
                return
            try:
                self._queue.put_nowait(entry)
            except queue.Full:
                self._lost += 1

    def _work(self) -> None:
        while (entry := self._queue.get()) is not None:
            for each in (*self._told_late(), entry):
                self._append(each)
                self._echo(each.sentence())
                if each.done:
                    self.also(each)
        for each in self._told_late():
            self._append(each)

    def _told_late(self) -> list[Entry]:
        with self._lock:
            silent, self._silent, lost, self._lost = self._silent, 0, self._lost, 0
        told = [Entry("", "", "", "", 0, f"{silent} {_SILENT}")] if silent else []
        late = [Entry("", "", "", "", 0, f"{lost} entries lost: the disk was too slow", done=True)] if lost else []
        return told + late

    def _append(self, entry: Entry) -> None:
        kind = "writes" if entry.done else "refused"
        path = self._folder / f"{kind}.jsonl"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o644)
            try:
                os.write(file, f"{entry.line()}\n".encode())
                full = os.fstat(file).st_size > _SIZE
            finally:
                os.close(file)
            if full:
                self._begin_another(kind, path)
        except OSError as error:
            if not self._failed:
                self._echo(f"the log {path} cannot be written: {error.strerror or error}")
            self._failed = True
        else:
            self._failed = False

    def _begin_another(self, kind: str, path: Path) -> None:
        """Names are times: another service that does the same takes no file away."""
        now = datetime.now(UTC)
        path.rename(path.with_name(f"{kind}-{now:%Y%m%d-%H%M%S}-{now.microsecond:06d}.jsonl"))
        for old in sorted(self._folder.glob(f"{kind}-*.jsonl"))[: -(_FILES[kind] - 1)]:
            old.unlink(missing_ok=True)


def short(text: str) -> str:
    """At most so many letters of it."""
    return text if len(text) <= SHORT else f"{text[: SHORT - 3]}..."


def to_standard_error(line: str) -> None:
    """A line, unless nobody takes it: then the logs go on without."""
    with contextlib.suppress(OSError, ValueError):
        poll = select.poll()
        poll.register(2, select.POLLOUT)
        if poll.poll(0):
            os.write(2, f"pmsm-bench: {line}\n".encode("ascii", "backslashreplace"))
