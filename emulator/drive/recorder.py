"""The drive's recorder: chosen channels of every control period, decimated, around a trigger, as 16-bit counts.

Fed with what the simulation records, run by run. Knows nothing of buses.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.wire.codec import FullScales, si_to_counts
from drivers.wire.dictionary import CAPTURE_CHANNELS, CHANNELS
from emulator.drive.simulation import RECORDED

Array = NDArray[np.float64]
Counts = NDArray[np.int16]

IDLE: Final = 0
ARMED: Final = 1
TRIGGERED: Final = 2
DONE: Final = 3


@dataclass(frozen=True, slots=True)
class Setup:
    """What to record."""

    channels: tuple[str, ...]
    decimation: int
    length: int  # samples
    pre: int  # samples of these before the trigger
    trigger: str  # channel, or "none": by command
    level: float  # SI
    edge: int  # 1 upwards, -1 downwards, 0 either way

    @classmethod
    def of(cls, values: dict[str, float]) -> "Setup":
        """From the drive's settings. Raises ValueError, in a sentence, when they cannot be."""
        numbers = [int(values[f"capture_channel_{k}"]) for k in range(1, CAPTURE_CHANNELS + 1)]
        channels = tuple(CHANNELS[number] for number in numbers if number)
        setup = cls(
            channels, int(values["capture_decimation"]), int(values["capture_length"]), int(values["capture_pre"]),
            CHANNELS[int(values["trigger_channel"])], values["trigger_level"], int(values["trigger_edge"]),
        )
        if not channels:
            raise ValueError("the recorder needs a channel, got none")
        if setup.pre >= setup.length:
            raise ValueError(f"capture_pre takes less than capture_length, {setup.length}, got {setup.pre}")
        return setup


@dataclass(slots=True, eq=False)
class Recorder:
    """The recorder; methods change it in place."""

    full: FullScales
    state: int = IDLE
    number: int = 0
    setup: Setup | None = None
    tick: int = 0  # of the first sample
    _samples: list[Counts] = field(default_factory=list[Counts])  # in pieces, oldest first
    _levels: list[Array] = field(default_factory=list[Array])
    _count: int = 0
    _trigger_at: int = -1  # number of the sample at the trigger, as of the pieces
    _by_command: bool = False
    _before: float = float("nan")  # the trigger's channel, one sample earlier

    @property
    def count(self) -> int:
        """Samples recorded."""
        return self._count if self.state in (TRIGGERED, DONE) else 0

    def arm(self, setup: Setup) -> None:
        """Begin anew; a recording that was there is gone."""
        self.setup, self.state, self.number = setup, ARMED, (self.number + 1) & 0xFFFF
        self._samples, self._count, self._trigger_at, self._by_command = [], 0, -1, False
        self._before = float("nan")

    def trigger(self) -> None:
        """Trigger with the next sample; without effect where none is awaited."""
        self._by_command = self.state == ARMED

    def stop(self) -> None:
        """Stop where it stands; what is there may be uploaded once it has triggered."""
        self.state = DONE if self.state in (TRIGGERED, DONE) else IDLE

    def take(self, tick: int, recording: Array) -> None:
        """Take in the periods from `tick` on, columns as in `RECORDED`."""
        setup = self.setup
        if self.state not in (ARMED, TRIGGERED) or setup is None or not len(recording):
            return
        first = -tick % setup.decimation
        samples = recording[first :: setup.decimation]
        if not len(samples):
            return
        if not self._count:
            self.tick = tick + first
        columns = [samples[:, RECORDED.index(name)] for name in setup.channels]
        self._samples.append(si_to_counts(columns, setup.channels, self.full))
        if self.state == ARMED:
            self._look(setup, samples)
        self._count += len(samples)
        self._trim(setup)

    def data(self, offset: int, count: int) -> bytes:
        """Samples from `offset` on, little-endian counts, all channels of one sample after another."""
        if self.state not in (TRIGGERED, DONE) or not self._samples:
            return b""
        if len(self._samples) > 1:
            self._samples = [np.concatenate(self._samples)]
        return self._samples[0][offset : offset + count].astype("<i2").tobytes()

    def _look(self, setup: Setup, samples: Array) -> None:
        """Find the trigger among new samples, not before there are `pre` ones."""
        start = max(0, setup.pre - self._count)
        found = np.empty(0, np.int64)
        if self._by_command:
            found = np.arange(start, len(samples))[:1]
        elif setup.trigger != "none":
            level = samples[:, RECORDED.index(setup.trigger)]
            above = np.concatenate(([self._before], level)) > setup.level
            known = ~np.isnan(np.concatenate(([self._before], level)))
            up, down = above[1:] & ~above[:-1], ~above[1:] & above[:-1]
            crossed = up if setup.edge > 0 else down if setup.edge < 0 else up | down
            found = np.flatnonzero(crossed & known[1:] & known[:-1])
            found = found[found >= start]
            self._before = float(level[-1])
        if len(found):
            self._trigger_at, self.state = self._count + int(found[0]), TRIGGERED

    def _trim(self, setup: Setup) -> None:
        """Drop what is too long ago; end when there is enough."""
        keep_from = self._trigger_at - setup.pre if self.state == TRIGGERED else self._count - setup.pre
        if keep_from > 0 and (self.state == TRIGGERED or self._count > 2 * setup.pre + 4096):
            kept = np.concatenate(self._samples)[keep_from:]
            self._samples, self._count = [kept], self._count - keep_from
            self.tick += keep_from * setup.decimation
            self._trigger_at -= keep_from if self._trigger_at >= 0 else 0
        if self.state == TRIGGERED and self._count >= setup.length:
            self._samples = [np.concatenate(self._samples)[: setup.length]]
            self._count, self.state = setup.length, DONE
