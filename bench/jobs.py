"""Jobs of one kind: known by id, each worked on by a thread, cancelled, waited for; the oldest are forgotten.

Knows nothing of what they do, and of HTTP.
"""

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, Generic, Protocol, TypeVar

from bench.errors import ConflictError, UnavailableError

LATEST: Final = "latest"  # in place of an id
_CANCEL: Final = 5.0  # s for a job to end


class JobStatus(Protocol):
    """A job at one moment."""

    @property
    def id(self) -> str:
        """By which it is asked for."""
        ...

    @property
    def state(self) -> str:
        """In a word."""
        ...


class JobRun(Protocol):
    """A job under way."""

    def cancel(self) -> None:
        """Have it end, and what it has made discarded; does not wait."""
        ...

    def leave(self) -> None:
        """Have it end, since the service does; does not wait."""
        ...


S = TypeVar("S", bound=JobStatus)
R = TypeVar("R", bound=JobRun)


class Jobs(Generic[S, R]):
    """The jobs of one kind, until `leave`."""

    def __init__(self, kind: str) -> None:
        """`kind`: what sentences say before the id of one."""
        self._kind = kind
        self._lock = threading.Condition()  # guards what follows; notified when a job is to end, and when it has
        self._known: dict[str, S] = {}  # by id, the oldest first
        self._runs: dict[str, R] = {}  # by id, those under way
        self._ending = False

    def leave(self) -> None:
        """Have all end, since the service does."""
        with self._lock:
            self._ending = True
            for run in self._runs.values():
                run.leave()
            self._lock.notify_all()

    def join(self, timeout: float) -> None:
        """Wait for their end, at most so many seconds."""
        with self._lock:
            self._lock.wait_for(lambda: not self._runs, timeout)

    def under_way_by_state(self) -> Counter[str]:
        """How many are under way, by their state in a word."""
        with self._lock:
            return Counter(str(self._known[id_].state) for id_ in self._runs)

    # --- for the kinds of jobs

    def _under_way(self, status: S, otherwise: str) -> R:
        """Raises ConflictError where it has ended."""
        with self._lock:
            found = self._runs.get(status.id)
        if found is None:
            raise ConflictError(f"{self._kind} {status.id} is {status.state}, {otherwise}")
        return found

    def _cancel(self, status: S) -> None:
        """End a job, and wait for its end. Raises ConflictError where it has ended; UnavailableError."""
        with self._lock:
            run = self._under_way(status, "there is nothing to cancel")
            run.cancel()
            self._lock.notify_all()
            if not self._lock.wait_for(lambda: self._runs.get(status.id) is not run, _CANCEL):
                raise UnavailableError(f"{self._kind} {status.id} is to end, but has not within {_CANCEL:g} s")

    def _put(self, status: S, run: R, work: Callable[[], None]) -> None:
        """Under the lock: a job is under way; a thread does its `work`, which comes to `_end`."""
        threading.Thread(target=work, name=f"{self._kind} {status.id}", daemon=True).start()
        self._known[status.id], self._runs[status.id] = status, run

    def _change(self, id_: str, **changes: Any) -> None:
        with self._lock:
            status: Any = self._known[id_]
            self._known[id_] = replace(status, **changes)

    def _end(self, id_: str, **changes: Any) -> None:
        """A job has ended, with these last changes."""
        with self._lock:
            self._change(id_, **changes)
            del self._runs[id_]
            self._lock.notify_all()

    def _forget(self, kept: int) -> None:
        """Under the lock: of the jobs that have ended, only so many, the newest, stay known."""
        ended = [id_ for id_ in self._known if id_ not in self._runs]
        for id_ in ended[: max(0, len(ended) - kept)]:
            del self._known[id_]
