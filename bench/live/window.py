"""The settings of an estimation: what a user may change while the stream runs. Knows nothing of streams."""

import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import AfterValidator, Field, TypeAdapter, WithJsonSchema

from bench.errors import LimitError
from bench.expected import CLOSED, Else, Number, Table, Word, taken, told
from bench.live.tuning import Tuning
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS
from estimator.online.ekf import TELLABLE
from estimator.online.rls import SMALLEST_LAM
from estimator.online.window_ls import MAX_LENGTH, MAX_M, check_window

AUTO: Final = "auto"
_NAMES: Final = ", ".join(PARAMETERS)


def _countable(value: Any) -> Any:
    if isinstance(value, int) and abs(value) > 10**18:  # JSON's and TOML's integers have no end
        raise told("expected a whole number of at most 18 digits")
    return value


def _in_order(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in PARAMETERS if name in names)


# What may come further depends on the other settings, which `_check` tells
_Samples = Annotated[int, Field(strict=True, json_schema_extra={"minimum": 1, "maximum": MAX_LENGTH})]
_Rows = Annotated[int, Field(strict=True, json_schema_extra={"minimum": 1, "maximum": MAX_M})]
_Whole: Final = Else("expected a whole number")
_Countable: Final = AfterValidator(_countable)
_Parameter = Annotated[str, Word(PARAMETERS, f"expected {_NAMES}")]


def _plausible(low: float, high: float, unit: str) -> Any:
    """A value that is above zero; where its size cannot be, it is given in another unit."""
    return Annotated[
        float, Field(strict=True, gt=0, le=sys.float_info.max), Else(f"expected a number of {unit} above zero"),
        Field(ge=low, le=high), Else(f"expected {low:g} to {high:g} {unit} (SI, per phase)"),
        WithJsonSchema({"type": "number", "minimum": low, "maximum": high, "description": unit}),
    ]  # fmt: skip


_HELD: Final = {name: _plausible(*PLAUSIBLE[name], UNITS[name]) for name in PARAMETERS}


Method = Annotated[Literal["wls", "rls", "ekf"], Word(), Field(
    description="wls: windowed least squares; rls: recursive least squares; ekf: extended Kalman filter for R_s, L_d, "
    "L_q. rls and ekf begin with the next sample; wls keeps the samples it has", examples=["wls"],
)]  # fmt: skip
Length = Annotated[
    _Samples | Literal["auto"], Else(f'expected a whole number or "{AUTO}"'), _Countable,
    Field(description="wls: samples, from the number of parameters times periods_per_row; auto: each parameter's own "
          "window, chosen by the data", examples=[1000]),
]  # fmt: skip
Longest = Annotated[
    _Samples, _Whole, _Countable,
    Field(description="wls with length auto: samples that it chooses from", examples=[10_000]),
]  # fmt: skip
Periods = Annotated[
    _Rows, _Whole, _Countable, Field(description="wls, rls: stream rows summed to one regression row", examples=[1])
]
Estimated = Annotated[
    tuple[_Parameter, ...], Field(min_length=1),
    Else(f"expected a list of {_NAMES}", f"expected at least one of {_NAMES}"), AfterValidator(_in_order),
    Field(description="parameters to estimate; ekf holds psi_f even where it is among them",
          examples=[["R_s", "L_d", "L_q"]]),
]  # fmt: skip
Held = Annotated[
    Mapping[str, float], Table(f"expected values of {_NAMES}", "expected {all}, got {key}", _HELD),
    Field(description="values, SI, used for parameters that are not estimated; ekf needs all four, to start from",
          examples=[{"psi_f": 0.12}]),
]  # fmt: skip
Forgetting = Annotated[
    float, Number(SMALLEST_LAM, 1.0),
    Field(description="rls: weight of the row before; 1: nothing forgotten", examples=[1.0]),
]  # fmt: skip
Ekf = Annotated[
    Tuning, Table('expected settings such as {"preset": "tuned"}'),
    Field(description="of the Kalman filter; what is left out of a change stays"),
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Window:
    """Settings of the estimation. Those that the method does not use are kept, and apply again when it does."""

    __pydantic_config__: ClassVar = CLOSED

    length: Length = 1000
    periods_per_row: Periods = 1
    estimated: Estimated = PARAMETERS
    held: Held = field(default_factory=dict[str, float])
    method: Method = "wls"
    longest: Longest = 10_000
    forgetting_factor: Forgetting = 1.0
    ekf: Ekf = field(default_factory=Tuning)

    @property
    def samples(self) -> int:
        """The most samples that the window holds."""
        return self.longest if isinstance(self.length, str) else self.length

    @property
    def chosen_by_data(self) -> bool:
        """Each parameter uses the window that the data suit."""
        return self.method == "wls" and self.length == AUTO

    def changed(self, change: Mapping[str, Any]) -> "Window":
        """This window with some settings replaced. Raises LimitError, in a sentence, when it cannot work."""
        settings = {f.name: getattr(self, f.name) for f in fields(self)} | dict(change)
        for key, now in (("held", self.held), ("ekf", asdict(self.ekf))):
            if isinstance(change.get(key), Mapping):
                settings[key] = {**now, **change[key]}
        window = taken(WINDOW, settings, "", LimitError)
        if window.ekf.model != self.ekf.model and not {"P_0", "Q"} <= change["ekf"].keys():
            raise LimitError(
                f"ekf: the states of model {window.ekf.model} are others than those of {self.ekf.model}, so P_0 and Q "
                "are needed with it, got none"
            )
        window._check(longest="longest" in change)
        return window

    def _check(self, *, longest: bool) -> None:
        """Raise LimitError where settings do not go together; `longest`: even if it is not in use."""
        m, parameters = self.periods_per_row, len(self.estimated)
        if not isinstance(self.length, str):
            _check_samples("", self.length, m, parameters)
        if longest or isinstance(self.length, str):
            _check_samples("longest: ", self.longest, m, parameters)
        for name in PARAMETERS:
            if name not in self.estimated and name not in self.held:
                raise LimitError(f"{name} is not estimated, so a held value in {UNITS[name]} is needed, got none")
        if self.method == "ekf":
            self._check_filter()

    def _check_filter(self) -> None:
        if not set(self.estimated) & set(TELLABLE):
            raise LimitError(f"method ekf estimates {', '.join(TELLABLE)} and holds the rest, got {self.estimated[0]}")
        if missing := [name for name in PARAMETERS if name not in self.held]:
            raise LimitError(
                f"method ekf starts from held values of {', '.join(PARAMETERS)}, got none of {', '.join(missing)}; "
                "give those in held"
            )


WINDOW: Final = TypeAdapter(Annotated[Window, Table("expected settings of an estimation")])
"""What a change on top of a window comes to, or, all by itself, may be."""


def _check_samples(where: str, samples: int, m: int, parameters: int) -> None:
    try:
        check_window(samples, m, parameters)
    except ValueError as error:
        raise LimitError(f"{where}{error}") from None
