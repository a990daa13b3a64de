"""What a recording of the stream is asked to be: trigger, limits, title. From a mapping, as REST and the command line
give it.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import Field, TypeAdapter, WrapValidator

from bench.actions.capture_request import NOW, Level, level_of
from bench.errors import LimitError
from bench.expected import CLOSED, Else, Number, Table, taken
from bench.store.annotations import Title, Words
from drivers.wire.dictionary import STREAM_ROW

_LEVEL: Final = TypeAdapter(Annotated[Level, Table('expected "now", "i_q > 2.0" or {"signal", "level", "edge"}')])
_Text = Annotated[str, Field(pattern=rf"^(now|\s*({'|'.join(STREAM_ROW)})\s*[<>]\s*\S+\s*)$")]


def _trigger(value: object, _inner: object) -> Level | str:
    return NOW if value == NOW else _LEVEL.validate_python(level_of(value))


@dataclass(frozen=True, slots=True)
class RecordingRequest:
    """What to record of a drive's stream; what is left out is as usual."""

    __pydantic_config__: ClassVar = CLOSED

    title: Annotated[Title, Field(description="a few words", examples=["warm, 1200 rpm"])] = ""
    note: Annotated[Words, Field(description="whatever is to be known of it")] = ""
    trigger: Annotated[
        Level | Literal["now"], WrapValidator(_trigger, json_schema_input_type=Level | _Text),
        Field(description='now: at once; or a level of the rows, also as "i_q > 2.0" (rising), "i_q < -2.0" (falling)'),
    ] = "now"
    pre_trigger_s: Annotated[
        float, Number(0.0, 60.0), Field(description="time before the trigger that is kept, s", examples=[2.0])
    ] = 0.0
    timeout_s: Annotated[
        Annotated[float, Number(0.1, 86_400.0)] | None, Else("expected null or a number of 0.1 to 86400"),
        Field(description="time for the trigger to come, s; null: it is waited for"),
    ] = None
    seconds: Annotated[
        Annotated[float, Number(0.01, 1e8)] | None, Else("expected null or a number of 0.01 to 1e8"),
        Field(description="time after which it ends, from the trigger on, s; null: when it is stopped"),
    ] = None
    megabytes: Annotated[
        Annotated[float, Number(0.1, 1e7)] | None, Else("expected null or a number of 0.1 to 1e7"),
        Field(description="size on disk at which it ends, MB; null: when the disk is nearly full"),
    ] = None

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "RecordingRequest":
        """What is given, the rest as usual. Raises LimitError, in a sentence."""
        request = taken(RECORDING, given, "", LimitError)
        level = request.trigger
        if isinstance(level, Level) and level.signal not in STREAM_ROW:
            raise LimitError(
                f"trigger: the stream has {', '.join(STREAM_ROW)}, got {level.signal}, which a capture can wait for"
            )
        if request.pre_trigger_s and not isinstance(level, Level):
            raise LimitError('pre_trigger_s: expected a trigger such as "i_q > 2.0" beside it, got "now"')
        return request

    def as_json(self) -> dict[str, Any]:
        """As plain values, of which `of` makes it again."""
        return asdict(self)


RECORDING: Final = TypeAdapter(Annotated[RecordingRequest, Table("expected what to record")])
