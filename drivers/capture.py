"""A recording by the drive's own recorder, at the rate of its control: set up, trigger, upload. Over any transport.

The upload goes on after a lost link where it stood, as long as the drive still has the same recording.
Knows nothing of buses.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.drive import Drive
from drivers.errors import FrameError, GoneError, NoReplyError
from drivers.settled import settle
from drivers.wire.codec import FullScales, channel_number, counts_to_si
from drivers.wire.dictionary import CAPTURE_CHANNELS, CAPTURE_SAMPLES

PATIENCE: Final = 2.0  # s, for the recorder to be armed
_POLL: Final = 0.02  # s
_ARMED_BY: Final = 0.2  # s after which a recorder whose answer was lost has not been told to arm
_STOP, _ARM, _TRIGGER = 0.0, 1.0, 2.0
_CHANNELS: Final = tuple(f"capture_channel_{k + 1}" for k in range(CAPTURE_CHANNELS))
_SET_UP: Final = (*_CHANNELS, "capture_decimation", "capture_length", "capture_pre")

ARMED, TRIGGERED, DONE = 1, 2, 3  # states of the recorder; 0: idle


@dataclass(frozen=True, slots=True)
class Setup:
    """What to record. Channels by name, see `dictionary.CHANNELS`; phase currents in A, the rest as in the stream."""

    channels: tuple[str, ...]
    length: int  # samples
    decimation: int = 1  # control periods per sample
    pre: int = 0  # samples before the trigger
    trigger: str = ""  # channel; none: at once
    level: float = 0.0  # SI
    edge: int = 1  # 1 upwards, -1 downwards, 0 either way

    def __post_init__(self) -> None:
        """Raise ValueError, in a sentence, when no drive could do it."""
        for name in (*self.channels, *((self.trigger,) if self.trigger else ())):
            channel_number(name)
        if not 1 <= len(self.channels) <= CAPTURE_CHANNELS or len(set(self.channels)) < len(self.channels):
            raise ValueError(f"expected 1 to {CAPTURE_CHANNELS} different channels, got {', '.join(self.channels)}")
        if not 1 <= self.length <= CAPTURE_SAMPLES:
            raise ValueError(f"expected a length of 1 to {CAPTURE_SAMPLES} samples, got {self.length}")
        if not 1 <= self.decimation <= 1000:
            raise ValueError(f"expected a decimation of 1 to 1000 control periods, got {self.decimation}")
        if not 0 <= self.pre < self.length:
            raise ValueError(f"expected 0 to {self.length - 1} samples before the trigger, got {self.pre}")
        if self.edge not in (-1, 0, 1):
            raise ValueError(f"expected an edge of 1, -1 or 0, got {self.edge}")


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """A recording; columns of equal length in SI, by channel."""

    columns: dict[str, NDArray[np.float64]]
    tick: int  # of the first sample
    T_s: float  # s, control period
    decimation: int  # control periods per sample

    @property
    def t(self) -> NDArray[np.float64]:
        """Times in s by the drive's clock."""
        n = len(next(iter(self.columns.values())))
        return self.T_s * (self.tick + self.decimation * np.arange(n, dtype=np.float64))


@dataclass(slots=True)
class Upload:
    """An upload under way; it outlives the link."""

    setup: Setup
    number: int  # of the drive's recording
    tick: int
    count: int  # samples there are
    data: bytearray = field(default_factory=bytearray)

    @property
    def done(self) -> int:
        """Samples uploaded."""
        return len(self.data) // (2 * len(self.setup.channels))


@dataclass(frozen=True, slots=True)
class Seen:
    """Where the recorder stands."""

    state: int
    count: int  # samples recorded


def arm(drive: Drive, setup: Setup, *, by_command: bool = False) -> int:
    """Set the recorder up and arm it; the number of the recording to come.

    Without a trigger it starts at once, `by_command` when `trigger` is called.
    """
    before = drive.read("capture_number")
    stop(drive)
    for name, value in zip(_SET_UP, _numbers(setup), strict=True):
        drive.write(name, float(value))
    drive.write("trigger_channel", float(channel_number(setup.trigger)) if setup.trigger else 0.0)
    drive.write("trigger_level", setup.level)
    drive.write("trigger_edge", float(setup.edge))
    settle(lambda: drive.write("capture_command", _ARM), lambda: _armed(drive, before, _ARMED_BY))
    if not _armed(drive, before, PATIENCE):  # until then, what it tells is of the recording before
        raise NoReplyError(f"the recorder has not been armed within {PATIENCE:g} s")
    number = drive.read("capture_number")
    if not setup.trigger and not by_command:
        trigger(drive)
    return int(number)


def trigger(drive: Drive) -> None:
    """Trigger now, whatever the trigger waits for."""
    settle(lambda: drive.write("capture_command", _TRIGGER), lambda: int(drive.read("capture_state")) != ARMED)


def stop(drive: Drive) -> None:
    """Wait for the trigger no longer; a recording under way ends where it stands."""
    settle(lambda: drive.write("capture_command", _STOP), lambda: False)  # it may be told twice


def _armed(drive: Drive, before: float, patience: float) -> bool:
    """Whether the recorder has another recording than the one of number `before`, within so many s."""
    deadline = time.monotonic() + patience
    while drive.read("capture_number") == before:
        if time.monotonic() > deadline:
            return False
        time.sleep(_POLL / 10.0)
    return True


def seen(drive: Drive, number: int) -> Seen:
    """Where the recording of this number stands. Raises GoneError where the drive no longer has it."""
    state, count = int(drive.read("capture_state")), int(drive.read("capture_count"))
    now = int(drive.read("capture_number"))  # last: what has been read before is of this recording, or of one before
    if now != number:
        raise GoneError(f"the drive no longer has recording {number}, it has {now or 'none'}")
    return Seen(state, count)


def found(drive: Drive, setup: Setup) -> Upload:
    """The recording that the drive has, to be uploaded."""
    number, tick, count = (int(drive.read(name)) for name in ("capture_number", "capture_tick", "capture_count"))
    return Upload(setup, number, tick, count)


def check_ours(drive: Drive, under_way: Upload, number: int, since: int) -> None:
    """Raise GoneError where a recording that was found is not the one of this number, armed at tick `since`.

    Numbers count anew when the drive resets, and so does its tick.
    """
    set_up = [int(drive.read(name)) for name in _SET_UP]
    if under_way.number != number or earlier(under_way.tick, since) or set_up != _numbers(under_way.setup):
        raise GoneError(
            f"the drive no longer has recording {number}, armed at tick {since}: it has {under_way.number} "
            f"of tick {under_way.tick}, or its recorder is set up for another"
        )
    _check_same(drive, under_way)


def earlier(tick: int, than: int) -> bool:
    """One tick is before another, as a counter of 32 bits tells it."""
    return (tick - than) % (1 << 32) >= 1 << 31


def _numbers(setup: Setup) -> list[int]:
    """What `_SET_UP` is in the drive."""
    channels = [channel_number(name) for name in setup.channels]
    return [*channels, *[0] * (CAPTURE_CHANNELS - len(channels)), setup.decimation, setup.length, setup.pre]


def awaited(drive: Drive, setup: Setup, patience: float) -> Upload:
    """Wait for the recording to be complete, at most `patience` s. Raises NoReplyError."""
    deadline = time.monotonic() + patience
    while (state := int(drive.read("capture_state"))) != DONE:
        if time.monotonic() > deadline:
            raise NoReplyError(
                f"no recording within {patience:g} s: "
                + ("the trigger has not come" if state == ARMED else "it is still under way")
            )
        time.sleep(_POLL)
    return found(drive, setup)


def upload(drive: Drive, under_way: Upload, on_samples: Callable[[int], None] | None = None) -> Capture:
    """Upload what is missing; call again, with the drive connected anew, after a DriveError.

    Raises GoneError when the drive has another recording by now.
    """
    _check_same(drive, under_way)
    size = 2 * len(under_way.setup.channels)
    del under_way.data[under_way.done * size :]
    if under_way.done < under_way.count:
        for piece in drive.captured(under_way.done, under_way.count - under_way.done):
            under_way.data += piece
            if on_samples is not None:
                on_samples(under_way.done)
        _check_same(drive, under_way)
    if len(under_way.data) != under_way.count * size:
        raise FrameError(f"expected a recording of {under_way.count * size} bytes, got {len(under_way.data)}")
    return decoded(under_way, drive.identity.T_s, drive.identity.full)


def decoded(under_way: Upload, T_s: float, full: FullScales) -> Capture:
    """What has been uploaded so far, in SI."""
    channels, done = under_way.setup.channels, under_way.done
    counts = np.frombuffer(bytes(under_way.data), "<i2", done * len(channels)).reshape(done, -1)
    columns = counts_to_si(counts, channels, full)
    return Capture(dict(zip(channels, columns, strict=True)), under_way.tick, T_s, under_way.setup.decimation)


def _check_same(drive: Drive, under_way: Upload) -> None:
    """Raise GoneError where the drive has another recording, or none any more."""
    number, tick = int(drive.read("capture_number")), int(drive.read("capture_tick"))
    same = (number, tick, int(drive.read("capture_count"))) == (under_way.number, under_way.tick, under_way.count)
    if not same or int(drive.read("capture_state")) != DONE:
        raise GoneError(
            f"the drive no longer has recording {under_way.number} of tick {under_way.tick}, "
            f"it has {number} of tick {tick}"
        )
