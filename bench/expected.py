"""Kinds of what comes from outside: pydantic checks them, OpenAPI shows them, and a sentence tells what came instead.

A kind says what is expected where it is declared, as an annotation:

    doubt: Annotated[float, Number(0.01, 1.0)]
    port: Annotated[int, Field(strict=True, ge=0, le=65535), Else("expected a port of 0 to 65535")]

Knows nothing of what is asked for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Any, Final, TypeVar, cast, get_args

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema

from bench.errors import BenchError, ConfigError, shown

T = TypeVar("T")
CLOSED: Final = ConfigDict(extra="forbid")
"""Of dataclasses, as `__pydantic_config__`: nothing but their fields."""
_TOLD: Final = "told"  # errors that bring their own clause


def taken(kind: TypeAdapter[T], given: object, where: str, refusal: type[BenchError], context: object = None) -> T:
    """What is given, as of that kind. Raises the refusal, in a sentence that begins with `where`.

    `context`: what validators of the kind's own need to know.
    """
    try:
        return kind.validate_python(given, context=context)
    except ValidationError as error:
        raise refusal(sentence(error.errors(include_url=False)[0], where)) from None


def sentence(error: ErrorDetails, where: str = "") -> str:
    """`WHERE KEY: expected WHAT, got WHAT CAME`, of an error as pydantic tells it."""
    context = error.get("ctx", {})
    clause = str(context.get("clause", error["msg"]))
    keys = [_named(part) for part in error["loc"] if isinstance(part, str)]
    head = " ".join([where, *keys[: -1 if context.get("above") else None]]).strip().rstrip(":")
    head += context.get("beside", "")
    came = context.get("came", f", got {shown(error['input'])}")
    return f"{head}: {clause}{came}" if head else f"{clause}{came}"


def told(clause: str, came: str | None = None, *, above: bool = False, beside: str = "") -> PydanticCustomError:
    """The error of a validator: what was expected; `came`: what is said of what came, where it is not the usual.

    `above`: the clause names the key, and is told of what that stands in. `beside`: said right after the key.
    """
    context: dict[str, Any] = {"clause": clause, "above": above, "beside": beside}
    return PydanticCustomError(_TOLD, "not as expected", context if came is None else context | {"came": came})


def by_name(items: Sequence[str], where: str) -> dict[str, str]:
    """`NAME=TEXT` each, or several with commas. Raises ConfigError where a name is given twice."""
    found: dict[str, str] = {}
    for item in ",".join(items).split(","):
        if not item.strip():
            continue
        name, _, text = (part.strip() for part in item.partition("="))
        if name in found:
            raise ConfigError(f"{where}: {name} is given twice")
        found[name] = text
    return found


def _named(key: str) -> str:
    return key if key.isidentifier() else shown(key)


def _either(words: Sequence[str]) -> str:
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


@dataclass(frozen=True)
class Else:
    """Annotates a type: the clause where something else came, unless all that is wrong are parts that tell more."""

    clause: str
    empty: str = ""  # where too few came, and the type says how many at least
    above: bool = False  # see `told`
    unit: str | None = None  # of what came, a number, which is told right after its key; None: at the end, as usual

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return self.around(handler(source))

    def around(self, schema: CoreSchema) -> CoreSchema:
        """Checks what a schema checks, and tells the clause in place of what it says."""

        def checked(value: object, inner: Callable[[object], object]) -> object:
            try:
                return inner(value)
            except ValidationError as error:
                kinds = {line["type"] for line in error.errors()}
                if _TOLD in kinds and kinds <= {_TOLD, "too_short"}:  # the latter: none of its parts was right
                    raise
                if self.unit is not None:
                    raise told(self.clause, "", beside=f" = {value:g} {self.unit}".rstrip()) from None
                few = self.empty and "too_short" in kinds
                raise told(*((self.empty, ", got none") if few else (self.clause,)), above=self.above) from None

        return core_schema.no_info_wrap_validator_function(checked, schema)


@dataclass(frozen=True)
class Word:
    """Annotates a `Literal`, or with `words` a `str`: one of these, and the clause where something else came."""

    words: tuple[str, ...] = ()
    clause: str = ""  # else: all of them, with an "or"

    def __get_pydantic_core_schema__(self, source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        words = self.words or get_args(source)
        clause = self.clause or f"expected {_either(words)}"
        return Else(clause).around(core_schema.literal_schema(list(words)))


@dataclass(frozen=True)
class Number:
    """Annotates `float` or, for whole ones, `int`: the least and the largest, and their unit."""

    low: float
    high: float
    unit: str = ""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        kind = "whole number" if source is int else "number"
        clause = f"expected a {kind} of {self.low:g} to {self.high:g} {self.unit}".rstrip()
        bounds = Field(strict=True, ge=source(self.low), le=source(self.high))
        return handler.generate_schema(Annotated[source, bounds, Else(clause)])


@dataclass(frozen=True, eq=False)  # by identity: kinds have no hash, which a type that may be None needs
class Table:
    """Annotates a dataclass, or with `kinds` a mapping: an object that has these keys only.

    Of a key that is missing, its kind tells that null came.
    """

    clause: str  # where no object came
    unknown: str = "expected {one}, got {key}"  # or, with commas, {all}
    kinds: Mapping[str, Any] | None = None  # types by key; any may be missing
    above: bool = False  # see `told`
    whole: bool = False  # the clause too where keys are missing or more

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        if self.kinds is None:
            known = [f.name for f in fields(source)]
            needed = [f.name for f in fields(source) if f.default is f.default_factory is MISSING]
            inner = handler(source)
        else:
            known, needed = list(self.kinds), list[str]()
            inner = core_schema.typed_dict_schema({
                key: core_schema.typed_dict_field(handler.generate_schema(kind), required=False)
                for key, kind in self.kinds.items()
            }, extra_behavior="forbid")  # fmt: skip

        def checked(value: object, then: Callable[[object], Any]) -> Any:
            if self.kinds is None and isinstance(value, source):
                return then(value)
            if not isinstance(value, Mapping):
                raise told(self.clause, above=self.above)
            given = cast(Mapping[str, object], value)
            if self.whole and set(given) != set(known):
                raise told(self.clause, f", got {shown(', '.join(given))}")
            for key in given:
                if key not in known:
                    names = {"one": _either(known), "all": ", ".join(known)}
                    raise told(self.unknown.format(**names, key=shown(key), name=_named(key)), "")
            found = then(dict.fromkeys(needed) | dict(given))
            return found if self.kinds is None else {key: found[key] for key in given}  # in the order given

        return core_schema.no_info_wrap_validator_function(checked, inner)
