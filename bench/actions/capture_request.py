"""What a capture is asked to be: signals, length, trigger. From a mapping, as REST and the command line give it."""

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import Field, TypeAdapter, WrapValidator

from bench.errors import LimitError
from bench.expected import CLOSED, Else, Number, Table, Word, taken
from drivers.capture import Setup
from drivers.wire.codec import FullScales, channel_signal
from drivers.wire.dictionary import CAPTURE_CHANNELS, CAPTURE_SAMPLES, CHANNELS

NEEDED: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")  # by the estimator
EDGES: Final = {"rising": 1, "falling": -1, "either": 0}
NOW, COMMAND = "now", "command"
_CROSSING: Final = re.compile(r"\s*(\w+)\s*([<>])\s*(\S+)\s*")
_WAYS: Final = {">": "rising", "<": "falling"}
_HAS: Final = ", ".join(CHANNELS[1:])
_Channel = Annotated[str, Word(CHANNELS[1:], f"the recorder has {_HAS}")]


@dataclass(frozen=True, slots=True)
class Level:
    """A trigger: a signal crosses a level."""

    __pydantic_config__: ClassVar = CLOSED

    signal: Annotated[_Channel, Field(description="any that can be recorded", examples=["i_q"])]
    level: Annotated[
        float, Number(-1e30, 1e30), Field(description="in the signal's SI unit: A, V, rad/s, rad", examples=[2.0])
    ]
    edge: Annotated[Literal["rising", "falling", "either"], Word()] = "rising"

    def __str__(self) -> str:
        way = f"{self.edge} through" if self.edge != "either" else "through"
        return f"{self.signal} {way} {self.level:g}"


_LEVEL: Final = TypeAdapter(Annotated[Level, Table(
    'expected "now", "command", "i_q > 2.0" or {"signal", "level", "edge"}'
)])
_Text = Annotated[str, Field(pattern=rf"^(now|command|\s*({'|'.join(CHANNELS[1:])})\s*[<>]\s*\S+\s*)$")]


def _trigger(value: object, _inner: object) -> Level | str:
    return NOW if value == NOW else COMMAND if value == COMMAND else _LEVEL.validate_python(level_of(value))


def level_of(value: object) -> object:
    """`i_q>2.0` (rising) or `i_q<-2.0` (falling), as one types it, as a level; what else came as it is."""
    found = _CROSSING.fullmatch(value) if isinstance(value, str) else None
    try:
        return {"signal": found[1], "level": float(found[3]), "edge": _WAYS[found[2]]} if found else value
    except ValueError:
        return value


@dataclass(frozen=True, slots=True)
class Request:
    """What to capture; what is left out is as usual."""

    __pydantic_config__: ClassVar = CLOSED

    signals: Annotated[
        tuple[_Channel, ...], Field(min_length=1), Else(f"expected a list out of {_HAS}"),
        Field(description="the usual ones are those the estimation rests on",
              json_schema_extra={"maxItems": CAPTURE_CHANNELS, "uniqueItems": True}),
    ] = NEEDED
    length: Annotated[int, Number(1, CAPTURE_SAMPLES), Field(description="samples")] = 10_000
    decimation: Annotated[
        int, Number(1, 1000), Field(description="control periods per sample; an estimation needs each period")
    ] = 1
    pre_trigger: Annotated[
        float, Number(0.0, 1.0), Field(description="share of the samples from before the trigger", examples=[0.1])
    ] = 0.0
    trigger: Annotated[
        Level | Literal["now", "command"], WrapValidator(_trigger, json_schema_input_type=Level | _Text),
        Field(description='now: at once; command: by POST .../trigger; or a level, also as "i_q > 2.0" (rising), '
                          '"i_q < -2.0" (falling)'),
    ] = "now"
    timeout_s: Annotated[float, Number(0.1, 86_400.0), Field(description="time for the trigger to come, s")] = 60.0

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "Request":
        """What is given, the rest as usual. Raises LimitError, in a sentence."""
        request = taken(REQUEST, given, "", LimitError)
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


REQUEST: Final = TypeAdapter(Annotated[Request, Table("expected what to capture")])
