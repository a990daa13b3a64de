"""The machine file: nominal values of a machine and its drive from TOML. Knows nothing of recordings.

    [machine]            # SI, per phase, peak dq
    R_s = 0.9664         # ohm
    L_d = 4.24e-3        # H
    L_q = 6.21e-3        # H
    psi_f = 0.12         # Vs
    n_p = 4
    i_rated = 6.0        # A
    speed_max_rpm = 3000 # rpm, mechanical: set points go no further
    [drive]
    T_s = 1e-4           # s
    u_dc = 310.0         # V
    encoder_counts = 65536  # of a mechanical turn; with n_p
    [effects.inverter_voltage_error]  # as a diagnosis writes them: parameters of physics beyond the textbook, SI
    dead_time = 2e-6
    dead_time_std = 3e-8    # standard error
    equation = [2e-6, 0.0, 0.05, 0.08]  # the effect's parameters as its equation has them, for the twin

Every key may be left out: what is not known is not written, and nothing is assumed in its place. Effects have the names
that a diagnosis gives them. A table [flux_map], as a diagnosis writes it, is for other tools and is not read.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, WithJsonSchema

from bench.errors import ConfigError
from bench.expected import Else, Table, taken
from bench.files import read_bytes
from bench.witness import from_table
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS, Machine
from estimator.witness import Witness

_LARGEST: Final = 2_000_000  # bytes
_MOST: Final = 10**300  # beyond, a number is shown and taken as this
EQUATION: Final = "equation"
"""The key of an effect's parameters as its equation has them."""


def _within(value: Any) -> Any:
    """TOML's integers have no end."""
    return max(-_MOST, min(value, _MOST)) if isinstance(value, int) else value


def _value(low: float, high: float, unit: str, kind: Any = float) -> Any:
    """A number, above zero where its least is; where its size cannot be, it is given in another unit."""
    number, finite = "whole number" if kind is int else "number", f"expected a finite number of {unit} above zero"
    above = (Field(gt=0, allow_inf_nan=False), Else(finite, unit="")) if low > 0 else ()
    shape = {"type": "integer" if kind is int else "number", "minimum": low, "maximum": high, "description": unit}
    return Annotated[
        kind, Field(strict=True), Else(f"expected a {number} of {unit}"), *above, Field(ge=low, le=high),
        Else(f"expected {low:g} to {high:g} {unit}; SI units, per phase", unit=unit), BeforeValidator(_within),
        WithJsonSchema(shape),
    ]  # fmt: skip


def _table(name: str) -> Any:
    """A table of anything."""
    return Annotated[dict[Any, Any], Else(f"expected a table [{name}]", above=True)]


_VALUES: Final = {
    "machine": {
        **{name: _value(*PLAUSIBLE[name], UNITS[name]) for name in PARAMETERS},
        "n_p": _value(1, 200, "pole pairs", int),
        "i_rated": _value(1e-3, 1e5, "A"),
        "speed_max_rpm": _value(1e-3, 1e6, "rpm"),
    },
    "drive": {
        "T_s": _value(1e-7, 10.0, "s"),
        "u_dc": _value(1.0, 1e5, "V"),
        "encoder_counts": _value(2, 2**30, "counts", int),
        "angle_ahead": _value(-math.pi, math.pi, "rad"),
    },
}
_UNKNOWN: Final = "{name} is unknown, expected one of {all}"
_KINDS: Final[Mapping[str, Any]] = {
    name: Annotated[dict[str, Any], Table("", _UNKNOWN, values)] for name, values in _VALUES.items()
}
_TABLES: Final = {name: TypeAdapter[dict[str, Any]](kind) for name, kind in _KINDS.items()}
_ANY: Final = {name: _table(name) for name in (*_KINDS, "effects", "flux_map", "witness")}
_WHOLE: Final = TypeAdapter(Annotated[dict[str, dict[Any, Any]], Table(
    "", "unknown entry {key}, expected the tables [machine] and [drive], [effects.NAME], [flux_map] and [witness]",
    _ANY,
)])  # fmt: skip
Tables = Annotated[dict[str, Any], Table("", kinds=_ANY | _KINDS)]
"""What a machine file has, as a description shows it; `nominal_of` tells more of what is wrong, by table."""
_SIZES: Final = TypeAdapter(dict[Any, Annotated[
    float, Field(strict=True, allow_inf_nan=False), Else("expected a finite number"), BeforeValidator(_within),
    AfterValidator(lambda size: float(max(-_MOST, min(size, _MOST)))),
]])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the machine file says; what it leaves out is None, or absent from `given`."""

    given: Mapping[str, float]  # those of R_s, L_d, L_q, psi_f that are known, SI
    _: KW_ONLY
    n_p: int | None = None  # pole pairs
    i_rated: float | None = None  # A, peak
    speed_max_rpm: float | None = None  # rpm, mechanical
    T_s: float | None = None  # s, control period
    u_dc: float | None = None  # V
    encoder_counts: int | None = None  # of a mechanical turn
    angle_ahead: float = 0.0  # rad electrical, of the recorded angle, within a count
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])  # by name, SI
    equations: Mapping[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])  # by effect
    witnesses: Mapping[str, Witness] = field(default_factory=dict[str, Witness])  # of R_s, L_d, L_q, psi_f
    source: str = field(default="", compare=False)  # the file

    @property
    def theta_step(self) -> float:
        """Electrical angle of an encoder's count in rad; 0 where it is not known."""
        return 2.0 * math.pi * self.n_p / self.encoder_counts if self.n_p and self.encoder_counts else 0.0

    @property
    def told(self) -> dict[str, float]:
        """What is known of the motor itself, by name, SI."""
        others = {"n_p": self.n_p, "i_rated": self.i_rated}
        return {**self.given, **{name: value for name, value in others.items() if value is not None}}

    @property
    def tables(self) -> dict[str, dict[str, float]]:
        """What is known of motor and drive, as the tables of a machine file have it."""
        machine, drive = self.told | {"speed_max_rpm": self.speed_max_rpm}, ("T_s", "u_dc", "encoder_counts")
        every = {"machine": machine, "drive": {name: getattr(self, name) for name in drive}}
        if self.angle_ahead:
            every["drive"]["angle_ahead"] = self.angle_ahead
        return {
            table: {name: value for name, value in values.items() if value is not None}
            for table, values in every.items()
        }

    @property
    def machine(self) -> Machine | None:
        """The whole machine, or None while a parameter or the pole pairs are unknown."""
        if self.n_p is None or any(name not in self.given for name in PARAMETERS):
            return None
        return Machine(**{name: self.given[name] for name in PARAMETERS}, n_p=self.n_p, i_rated=self.i_rated)


def load_machine(path: str | Path) -> Nominal:
    """The machine file's nominal values. Raises ConfigError with a sentence for the user."""
    return nominal_of(load_toml(path), path)


def nominal_of(content: Mapping[str, object], path: str | Path) -> Nominal:
    """Nominal values from the tables of a machine file; `path` says where they are from. Raises ConfigError."""
    given = taken(_WHOLE, content, f"{path}:", ConfigError)
    if "machine" not in given:
        known = ", ".join(_VALUES["machine"])
        raise ConfigError(f"{path}: the table [machine] is missing, expected it with any of {known}")
    machine, drive = (
        taken(kind, given.get(name, {}), f"{path}: [{name}]", ConfigError) for name, kind in _TABLES.items()
    )
    if "encoder_counts" in drive and "n_p" not in machine:
        raise ConfigError(f"{path}: [drive] encoder_counts needs [machine] n_p, expected both or neither")
    effects, equations = _effects(given["effects"], path) if "effects" in given else ({}, {})
    witnesses = from_table(given.get("witness", {}), f"{path}: [witness]")
    values = machine | drive
    return Nominal(
        {name: values.pop(name) for name in PARAMETERS if name in values}, effects=effects, equations=equations,
        witnesses=witnesses, source=str(path), **values,
    )


def _effects(
    given: Mapping[str, object], path: str | Path
) -> tuple[dict[str, Mapping[str, float]], dict[str, tuple[float, ...]]]:
    """Sizes and equations by effect. Raises ConfigError."""
    from estimator.physics import convention_error, speed_lag
    from estimator.physics.library import BY_NAME

    names = {name: [parameter.name for parameter in effect.parameters] for name, effect in BY_NAME.items()}
    names |= {convention_error.NAME: [], speed_lag.NAME: []}
    kinds = {name: _table(f"effects.{name}") for name in names}
    known = TypeAdapter[Mapping[str, dict[Any, Any]]](
        Annotated[Mapping[str, dict[Any, Any]], Table("", "unknown effect {key}, expected one of {all}", kinds)]
    )
    effects: dict[str, Mapping[str, float]] = {}
    equations: dict[str, tuple[float, ...]] = {}
    for name, table in taken(known, given, f"{path}: [effects]:", ConfigError).items():
        where = f"{path}: [effects.{name}]"
        effects[name] = taken(_SIZES, {k: v for k, v in table.items() if k != EQUATION}, where, ConfigError)
        if EQUATION in table:
            equation = TypeAdapter(_equation(names[name]))
            equations[name] = taken(equation, table[EQUATION], f"{where} {EQUATION}", ConfigError)
    return effects, equations


def _equation(names: Sequence[str]) -> Any:
    """A number for each; of an effect without names, none at all."""
    expected = f"{len(names)} finite numbers ({', '.join(names)})" if names else "none"
    number = Annotated[float, Field(strict=True, gt=-1e300, lt=1e300)]
    return Annotated[
        tuple[number, ...], Field(min_length=len(names) or 1, max_length=len(names)), Else(f"expected {expected}")
    ]


def load_toml(path: str | Path) -> dict[str, object]:
    """A TOML file's content. Raises ConfigError."""
    try:
        return toml_of(read_bytes(path, _LARGEST).decode("utf-8-sig"), path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected UTF-8 text, byte {error.start} is not") from error
    except ValueError as error:  # a path that cannot be
        raise ConfigError(f"{path}: not TOML: {type(error).__name__}") from error


def toml_of(text: str, where: str | Path) -> dict[str, object]:
    """The content of TOML. Raises ConfigError."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{where}: not TOML: {error}") from error
    except (RecursionError, ValueError) as error:  # brackets without end; a number that cannot be
        raise ConfigError(f"{where}: not TOML: {type(error).__name__}") from error
