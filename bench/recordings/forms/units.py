"""Units of a recording's quantities: what a number in one of them is in SI, angles and speeds electrical.

Angles in rad, deg and turns, rad/s and Hz are electrical unless they are called mechanical, revolutions a minute or
second are mechanical unless they are called electrical (`erpm`): these need the pole pairs. Knows nothing of columns.
"""

import math
import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.errors import ConfigError

MICRO: Final = "\u00b5"
_MICROS: Final = str.maketrans({"\u03bc": MICRO})  # the Greek letter looks the same

_RPM: Final = math.pi / 30.0  # rad/s
_TIME: Final = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
_VOLTAGE: Final = {"V": 1.0, "mV": 1e-3, "kV": 1e3, "uV": 1e-6}
_CURRENT: Final = {"A": 1.0, "mA": 1e-3, "kA": 1e3, "uA": 1e-6}
_TURN: Final = dict.fromkeys(("turn", "turns", "rev"), 2.0 * math.pi)
_ANGLE: Final = {"rad": 1.0, "mrad": 1e-3} | dict.fromkeys(("deg", "°", "degree", "degrees"), math.pi / 180.0) | _TURN
_OF_A_CIRCLE: Final = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "°/s": math.pi / 180.0, "Hz": 2.0 * math.pi}
_OF_THE_SHAFT: Final = (
    dict.fromkeys(("rpm", "1/min", "min-1", "min^-1", "r/min", "rev/min", "U/min"), _RPM) | {"krpm": 1e3 * _RPM}
    | dict.fromkeys(("rps", "turn/s", "turns/s", "rev/s"), 2.0 * math.pi)
)  # fmt: skip
_SPEED: Final = _OF_A_CIRCLE | _OF_THE_SHAFT
_KINDS: Final = {"u": _VOLTAGE, "i": _CURRENT, "t": _TIME, "theta": _ANGLE, "omega": _SPEED, "speed": _SPEED}
_OTHERS: Final = ("-", "1", "%", "°C", "degC", "C", "K", "Nm", "N m", "W", "ohm", "H", "Vs")  # in rows of units
_ELECTRICAL: Final = ("electrical", "electric", "elec", "elec.", "el", "el.")
_MECHANICAL: Final = ("mechanical", "mech", "mech.")
_SAID_IN: Final = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\s/\s*(\S+)|\sin\s+(\S+))")


@dataclass(frozen=True, slots=True)
class Scale:
    """What is made of a column's numbers: times a factor, plus an offset in SI."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        if self == UNCHANGED:
            return numbers
        return numbers * self.factor + self.offset if self.offset else numbers * self.factor

    def then(self, outer: "Scale") -> "Scale":
        """This one, and another one after it."""
        return Scale(self.factor * outer.factor, self.offset * outer.factor + outer.offset)


UNCHANGED: Final = Scale()


def same_micro(text: str) -> str:
    """A text in which the two micro signs are one."""
    return text.translate(_MICROS)


def name_and_unit(name: str) -> tuple[str, str] | None:
    """The two parts of a name that tells its unit: `t [us]`, `Time (ms)`, `t / us`, `t in us`. None for others."""
    found = _SAID_IN.fullmatch(name.strip())
    if found is None:
        return None
    return found[1].strip(), next(part for part in found.groups()[1:] if part is not None).strip()


def is_unit(text: str) -> bool:
    """A unit of any quantity of a recording."""
    return any(_factor(kind, text) is not None for kind in _KINDS.values())


def may_be_unit(text: str) -> bool:
    """What stands in a row of units: a unit, or none."""
    return not text or text in _OTHERS or is_unit(text)


def units_of(quantity: str) -> tuple[str, ...]:
    """Units that a quantity may have, for a sentence."""
    return tuple(_kind(quantity))


def scale_of(quantity: str, unit: str, n_p: float | None) -> Scale | None:
    """What a unit makes of a quantity's numbers; None for a unit that it does not have.

    Raises ConfigError where the unit is mechanical, and the pole pairs `n_p` are not known.
    """
    found = _factor(_kind(quantity), unit)
    if found is None:
        return None
    factor, mechanical = found
    if quantity == "speed_rpm":  # mechanical itself
        return Scale(factor / _RPM / (1.0 if mechanical else _known(quantity, unit, "electrical", n_p)))
    return Scale(factor * _known(quantity, unit, "mechanical", n_p)) if mechanical else Scale(factor)


def _known(quantity: str, unit: str, kind: str, n_p: float | None) -> float:
    if n_p is None:
        raise ConfigError(
            f"{quantity} in {unit} is {kind}, expected the pole pairs: n_p in --nominal MACHINE.toml, or --set n_p=..."
        )
    return n_p


def _kind(quantity: str) -> dict[str, float]:
    return _KINDS.get(quantity.partition("_")[0], {})


def _factor(kind: dict[str, float], unit: str) -> tuple[float, bool] | None:
    """SI of a unit of that kind, and whether it is of the shaft."""
    words = same_micro(unit).replace(MICRO, "u").replace("(", " ").replace(")", " ").split()
    electrical = any(word.lower() in _ELECTRICAL for word in words)
    mechanical = any(word.lower() in _MECHANICAL for word in words)
    plain = " ".join(word for word in words if word.lower() not in (*_ELECTRICAL, *_MECHANICAL))
    if plain not in kind and plain[:1] == "e" and plain[1:].lower() in _OF_THE_SHAFT:
        electrical, plain = True, plain[1:]
    name = plain if plain in kind else plain.lower()
    if name not in kind or (electrical and mechanical):
        return None
    if kind not in (_ANGLE, _SPEED):
        return None if electrical or mechanical else (kind[name], False)
    return kind[name], mechanical or (kind is _SPEED and name in _OF_THE_SHAFT and not electrical)
