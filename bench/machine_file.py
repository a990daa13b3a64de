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
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import cast

from bench.errors import ConfigError, shown
from bench.files import read_bytes
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS, Machine

KEYS = {
    "machine": {
        **{name: (*PLAUSIBLE[name], UNITS[name]) for name in PARAMETERS},
        "n_p": (1, 200, "pole pairs"),
        "i_rated": (1e-3, 1e5, "A"),
        "speed_max_rpm": (1e-3, 1e6, "rpm"),
    },
    "drive": {
        "T_s": (1e-7, 10.0, "s"),
        "u_dc": (1.0, 1e5, "V"),
        "encoder_counts": (2, 2**30, "counts"),
        "angle_ahead": (-math.pi, math.pi, "rad"),
    },
}
_LARGEST = 2_000_000  # bytes
EQUATION = "equation"
"""The key of an effect's parameters as its equation has them."""


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
    tables = _tables(content, path)
    machine, drive = tables["machine"], tables["drive"]
    if "encoder_counts" in drive and "n_p" not in machine:
        raise ConfigError(f"{path}: [drive] encoder_counts needs [machine] n_p, expected both or neither")
    return Nominal(
        given={name: machine[name] for name in PARAMETERS if name in machine},
        n_p=int(machine["n_p"]) if "n_p" in machine else None,
        i_rated=machine.get("i_rated"),
        speed_max_rpm=machine.get("speed_max_rpm"),
        T_s=drive.get("T_s"),
        u_dc=drive.get("u_dc"),
        encoder_counts=int(drive["encoder_counts"]) if "encoder_counts" in drive else None,
        angle_ahead=drive.get("angle_ahead", 0.0),
        effects=_effects(content.get("effects", {}), path),
        equations=_equations(content.get("effects", {}), path),
        source=str(path),
    )


def _tables(content: Mapping[str, object], path: str | Path) -> dict[str, dict[str, float]]:
    for key in content:
        if key not in KEYS and key not in ("effects", "flux_map"):
            raise ConfigError(
                f"{path}: unknown entry {shown(key)}, expected the tables [machine] and [drive], [effects.NAME] and "
                "[flux_map]"
            )
    _expect_table(content.get("flux_map", {}), "flux_map", path)
    if "machine" not in content:
        raise ConfigError(f"{path}: the table [machine] is missing, expected it with any of "
                          + ", ".join(KEYS["machine"]))
    return {name: _table(path, name, content.get(name, {})) for name in KEYS}


def _effects(content: object, path: str | Path) -> dict[str, Mapping[str, float]]:
    effects: dict[str, Mapping[str, float]] = {}
    for name, table in _expect_table(content, "effects", path).items():
        where = f"{path}: [effects.{name}]"
        if name not in (known := _known_effects()):
            raise ConfigError(f"{path}: [effects]: unknown effect {shown(name)}, expected one of {', '.join(known)}")
        values = {k: v for k, v in _expect_table(table, f"effects.{name}", path).items() if k != EQUATION}
        for key, value in values.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < math.inf:
                raise ConfigError(f"{where} {shown(key)}: expected a finite number, came {shown(value)}")
        effects[name] = {
            key: float(min(max(value, -1e300), 1e300)) for key, value in cast("dict[str, float]", values).items()
        }
    return effects


def _equations(effects: object, path: str | Path) -> dict[str, tuple[float, ...]]:
    """Of effects that are known."""
    from estimator.physics.library import BY_NAME

    found: dict[str, tuple[float, ...]] = {}
    for name, table in cast("dict[str, dict[str, object]]", effects).items():
        if EQUATION not in table:
            continue
        names = [parameter.name for parameter in BY_NAME[name].parameters] if name in BY_NAME else []
        came = table[EQUATION]
        values = cast("list[object]", came) if isinstance(came, list) else list[object]()
        numbers = [
            float(x) for x in values
            if not isinstance(x, bool) and isinstance(x, int | float) and abs(x) < 1e300
        ]  # fmt: skip
        if not names or len(numbers) != len(names) or len(numbers) != len(values):
            expected = f"{len(names)} finite numbers ({', '.join(names)})" if names else "none"
            where = f"{path}: [effects.{name}] {EQUATION}"
            raise ConfigError(f"{where}: expected {expected}, came {shown(table[EQUATION])}")
        found[name] = tuple(numbers)
    return found


def _known_effects() -> tuple[str, ...]:
    from estimator.physics import convention_error
    from estimator.physics.library import BY_NAME

    return (*BY_NAME, convention_error.NAME)


def load_toml(path: str | Path) -> dict[str, object]:
    """A TOML file's content. Raises ConfigError."""
    try:
        return tomllib.loads(read_bytes(path, _LARGEST).decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected UTF-8 text, byte {error.start} is not") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from error
    except (RecursionError, ValueError) as error:  # brackets without end; a path or a number that cannot be
        raise ConfigError(f"{path}: not TOML: {type(error).__name__}") from error


def _expect_table(content: object, name: str, path: str | Path) -> dict[str, object]:
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected a table [{name}], came {name} = {shown(content)}")
    return cast("dict[str, object]", content)


def _table(path: str | Path, name: str, content: object) -> dict[str, float]:
    allowed = KEYS[name]
    values: dict[str, float] = {}
    for key, value in _expect_table(content, name, path).items():
        where = f"{path}: [{name}] {key}"
        if key not in allowed:
            raise ConfigError(f"{where} is unknown, expected one of {', '.join(allowed)}")
        values[key] = _value(where, value, *allowed[key], whole=key in ("n_p", "encoder_counts"))
    return values


def _value(where: str, value: object, low: float, high: float, unit: str, *, whole: bool) -> float:
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        raise ConfigError(f"{where}: expected a {'whole ' if whole else ''}number of {unit}, came {value!r}")
    if low > 0 and not 0 < value < math.inf:
        raise ConfigError(f"{where} = {value}: expected a finite number of {unit} above zero")
    value = min(value, 1e300)  # TOML's integers have no end
    if not low <= value <= high:
        expected = f"{low:g} to {high:g} {unit}"
        raise ConfigError(f"{where} = {value:g} {unit}: expected {expected}; SI units, per phase")
    return value if whole else float(value)
