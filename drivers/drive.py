"""The `Drive` protocol: what the bench may ask of a drive, whatever the bus."""

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from drivers.block import Block
from drivers.rows import Counts
from drivers.wire.codec import FullScales
from drivers.wire.dictionary import WATCHDOG_LAYOUT, Signal, signals_of
from drivers.wire.lease import Record


@dataclass(frozen=True, slots=True)
class Identity:
    """Who the drive says it is."""

    device_name: str
    vendor_id: int
    product_code: int
    revision: int
    serial: int
    layout_id: int  # checksum of its dictionary
    T_s: float  # s, control period
    i_full: float  # A
    u_full: float  # V
    omega_full: float  # rad/s

    @property
    def full(self) -> FullScales:
        """Its full scales by name, SI."""
        return {"i_full": self.i_full, "u_full": self.u_full, "omega_full": self.omega_full}

    @property
    def has_lease(self) -> bool:
        """Its layout is the one with a control lease."""
        return self.layout_id != WATCHDOG_LAYOUT

    @property
    def has_memory(self) -> bool:
        """Its layout tells of its memory, and has control loops and corrections that can be set."""
        return any(signal.name == "memory_count" for signal in self.signals)

    @property
    def signals(self) -> tuple[Signal, ...]:
        """What it has."""
        return signals_of(self.layout_id)


class Drive(Protocol):
    """A connected drive. Methods raise `DriveError`; all may be called from any thread.

    Use as a context manager: leaving it stops the stream and closes the link.

    Set points, and what switches the bridge on, are given by `control`, see `drivers.lease`. A drive of the layout
    without a control lease (`identity.has_lease`) takes all of it by `write`, from anybody, and has a watchdog instead:
    it waits for the bench to act, not for a link to be up. It is fed by calls, and by taking blocks of `stream`, at
    least every 0.1 s, and by nothing else.
    """

    @property
    def identity(self) -> Identity: ...

    @property
    def counts(self) -> Counts:
        """Rows, gaps and frames of the latest stream."""
        ...

    @property
    def note(self) -> str:
        """What the client has changed of the stream by itself, in a sentence; empty: nothing."""
        ...

    def read(self, name: str) -> float:
        """Value of a signal, SI."""
        ...

    def write(self, name: str, value: float) -> None:
        """Set a signal, SI; returns when the drive has taken it."""
        ...

    def control(self, record: Record) -> None:
        """Have a control record taken, whole or not at all; repeated where no answer comes. Raises RefusedError."""
        ...

    def parameters(self) -> dict[str, float]:
        """Every parameter with its value, SI."""
        ...

    def stream(self) -> Iterator[Block]:
        """Start the stream and yield blocks until the drive is closed. Raises LostError when it falls silent."""
        ...

    def captured(self, offset: int, count: int) -> Iterator[bytes]:
        """The recorder's samples from `offset` on, `count` of them, as they come; see `dictionary.CAPTURE_DATA`."""
        ...

    def close(self) -> None:
        """Stop the stream and close the link; may be called twice, and from another thread than `stream`."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
