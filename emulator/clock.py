"""The clock: how many control periods are due. The only place of the emulator that knows wall time."""

import math
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

_PATIENCE: Final = 0.05  # s, for a drive that is held up
_FRESH: Final = 5e-3  # s, since a step began that is as good as another: of many requests in a row the first has one


class Pacer:
    """Real time in control periods, told in bounded steps.

    `due` never says more than `most` at once, so that a drive that was held up catches up in steps between
    which its bus is served. One held up for longer than `patience` gives that time up: it is counted in
    `overruns`, and the drive's clock stays behind wall time by it.
    """

    def __init__(self, T_s: float, most: int, patience: float = 1.0, now: Callable[[], float] = time.monotonic) -> None:
        """`T_s` control period in s, `patience` in s, `now` a monotonic clock in s."""
        if not (T_s > 0.0 and most >= 1 and patience > 0.0):
            raise ValueError(f"a pacer takes T_s, most and patience above zero, got {T_s}, {most} and {patience}")
        self._T_s, self._most, self._patience, self._now = T_s, most, patience, now
        self._start = now()  # s, when period 0 began
        self._told = 0  # periods said to be due
        self.overruns = 0  # times that it gave up

    def due(self) -> int:
        """Periods to run now, 0 to `most`; they count as run."""
        behind = self.lag
        if behind > self._patience:
            self.overruns += 1
            self._start += behind
        periods = min(max(0, int((self._now() - self._start) / self._T_s) - self._told), self._most)
        self._told += periods
        return periods

    @property
    def lag(self) -> float:
        """How far the periods told are behind wall time, in s."""
        return self._now() - self._start - self._told * self._T_s

    def wait_time(self, periods: int) -> float:
        """Time in s until so many periods are due; 0 when they are."""
        return max(0.0, periods * self._T_s - self.lag)


class Present:
    """Where a drive runs in steps, has it come up to now for whoever asks, from other threads."""

    def __init__(self) -> None:
        self._asked = threading.Event()
        self._reached = threading.Condition()
        self._steps = 0
        self._begun = -math.inf  # s, monotonic, when the latest step began
        self._over = False

    def awaited(self) -> None:
        """Wait for a step that begins after this, but for the blink of an eye before; not for long."""
        if time.monotonic() - self._begun < _FRESH:
            return
        with self._reached:
            steps = self._steps + 1
            self._asked.set()
            self._reached.wait_for(lambda: self._steps >= steps or self._over, _PATIENCE)

    def reached(self) -> None:
        """A step is over."""
        with self._reached:
            self._steps += 1
            self._reached.notify_all()

    def wait(self, seconds: float) -> None:
        """Return when it is time for another step: after so many s, or when one is asked for."""
        self._asked.wait(seconds)
        self._asked.clear()
        self._begun = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nobody waits any more."""
        with self._reached:
            self._over = True
            self._reached.notify_all()
