"""What a capture is asked to be: signals, length, trigger. From a mapping, as REST and the command line give it."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Final, cast

from bench.errors import LimitError, shown
from bench.live.tuning import number, one_of
from drivers.capture import Setup
from drivers.wire.codec import FullScales, channel_signal
from drivers.wire.dictionary import CAPTURE_SAMPLES, CHANNELS

NEEDED: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")  # by the estimator
EDGES: Final = {"rising": 1, "falling": -1, "either": 0}
NOW, COMMAND = "now", "command"
TIMEOUT: Final = (0.1, 86_400.0)  # s
_CROSSING: Final = re.compile(r"\s*(\w+)\s*([<>])\s*(\S+)\s*")
_WAYS: Final = {">": "rising", "<": "falling"}


@dataclass(frozen=True, slots=True)
class Level:
    """A trigger: a signal crosses a level."""

    signal: str
    level: float  # SI
    edge: str = "rising"

    def __str__(self) -> str:
        way = f"{self.edge} through" if self.edge != "either" else "through"
        return f"{self.signal} {way} {self.level:g}"


@dataclass(frozen=True, slots=True)
class Request:
    """A capture that a drive can do."""

    signals: tuple[str, ...] = NEEDED
    length: int = 10_000  # samples
    decimation: int = 1  # control periods per sample
    pre_trigger: float = 0.0  # share of the samples from before the trigger
    trigger: Level | str = NOW  # or COMMAND
    timeout_s: float = 60.0  # for the trigger to come

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "Request":
        """What is given, the rest as usual. Raises LimitError, in a sentence."""
        known = [f.name for f in fields(cls)]
        for key in given:
            if key not in known:
                raise LimitError(f"expected {', '.join(known[:-1])} or {known[-1]}, got {shown(key)}")
        usual = cls()
        request = cls(
            _signals(given.get("signals", usual.signals)),
            _whole("length", given.get("length", usual.length), CAPTURE_SAMPLES),
            _whole("decimation", given.get("decimation", usual.decimation), 1000),
            number("pre_trigger", given.get("pre_trigger", usual.pre_trigger), 0.0, 1.0),
            _trigger(given.get("trigger", usual.trigger)),
            number("timeout_s", given.get("timeout_s", usual.timeout_s), *TIMEOUT),
        )
        try:
            _ = request.setup
        except ValueError as error:
            raise LimitError(str(error)) from None
        return request

    @property
    def setup(self) -> Setup:
        """In the recorder's terms. Raises ValueError, in a sentence."""
        pre = min(round(self.pre_trigger * self.length), self.length - 1)
        level = self.trigger if isinstance(self.trigger, Level) else Level("", 0.0)
        return Setup(self.signals, self.length, self.decimation, pre, level.signal, level.level, EDGES[level.edge])

    def check_level(self, full: FullScales) -> None:
        """Raise LimitError where a drive of these full scales cannot come to the trigger's level."""
        if not isinstance(self.trigger, Level):
            return
        signal = channel_signal(self.trigger.signal)
        most = full[signal.full_scale] if signal.full_scale else math.tau
        if not (-most if signal.full_scale else 0.0) < self.trigger.level < most:
            least = f"{-most:g}" if signal.full_scale else "0"
            raise LimitError(
                f"trigger level: {self.trigger.signal} of this drive is {least} to {most:g} {signal.unit}, "
                f"its full scale, got {self.trigger.level:g}"
            )

    @property
    def replayable(self) -> bool:
        """An estimation can rest on it: every control period of all that it needs."""
        return self.decimation == 1 and self.length > 1 and set(NEEDED) <= set(self.signals)

    def as_json(self) -> dict[str, Any]:
        """As plain values, of which `of` makes it again."""
        return asdict(self) | {"signals": list(self.signals)}


def _signals(value: object) -> tuple[str, ...]:
    names = cast(Sequence[object], value) if isinstance(value, list | tuple) else ()
    if not names:
        came = shown(cast(object, value))
        raise LimitError(f"signals: expected a list out of {', '.join(CHANNELS[1:])}, got {came}")
    return tuple(_signal("signals", name) for name in names)


def _signal(where: str, name: object) -> str:
    if not isinstance(name, str) or name not in CHANNELS[1:]:
        raise LimitError(f"{where}: the recorder has {', '.join(CHANNELS[1:])}, got {shown(name)}")
    return name


def _whole(key: str, value: object, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
        raise LimitError(f"{key}: expected a whole number of 1 to {most}, got {shown(value)}")
    return value


def _trigger(value: object) -> Level | str:
    if value in (NOW, COMMAND) or isinstance(value, Level):
        return cast(Level | str, value)
    given = _crossing(value) if isinstance(value, str) else value
    if not isinstance(given, Mapping):
        raise LimitError(
            f'trigger: expected "now", "command", "i_q > 2.0" or {{"signal", "level", "edge"}}, got {shown(value)}'
        )
    given = cast(Mapping[str, object], given)
    for key in given:
        if key not in ("signal", "level", "edge"):
            raise LimitError(f"trigger: expected signal, level or edge, got {shown(key)}")
    return Level(
        _signal("trigger signal", given.get("signal")),
        number("trigger level", given.get("level"), -1e30, 1e30),
        one_of("trigger edge", given.get("edge", "rising"), tuple(EDGES)),
    )


def _crossing(text: str) -> dict[str, object] | None:
    """`i_q>2.0` (rising) or `i_q<-2.0` (falling), as one types it."""
    found = _CROSSING.fullmatch(text)
    try:
        return found and {"signal": found[1], "level": float(found[3]), "edge": _WAYS[found[2]]}
    except ValueError:
        return None
