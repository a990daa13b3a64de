"""Where numbers stand along an axis, and which of them are told. Knows nothing of pictures."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from bench.diagnoses.figures.figure import Axis
from bench.engineering import odds, quantity, scaled
from estimator.interval import Z_95

_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_ANGLES: Final = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0)  # deg
_EXPONENTS: Final = (1.0, 2.0, 3.0, 6.0, 12.0)  # between exponents that are told
_SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EDGE: Final = 1e-9  # of an axis: as good as on its end


@dataclass(frozen=True, slots=True)
class Tick:
    """A number that is told."""

    at: float  # px
    text: str


@dataclass(frozen=True, slots=True)
class Scale:
    """An axis over px; its low end stands at `start`, its high one at `end`."""

    axis: Axis
    start: float  # px
    end: float

    def at(self, value: float | None) -> float | None:
        """px of a number; None where it has no place."""
        if value is None or (self.axis.scale == "log" and value <= 0.0):
            return None
        low, high = self._course(self.axis.low), self._course(self.axis.high)
        return self.start + (self._course(value) - low) / (high - low) * (self.end - self.start)

    @property
    def zero(self) -> float | None:
        """px of 0; None where it is not between the ends."""
        return self.at(0.0) if self.axis.low < 0.0 < self.axis.high and not self.axis.names else None

    @property
    def label(self) -> str:
        """What stands along it, and in which unit its ticks are."""
        return ", ".join(part for part in (self.axis.label, self._unit[1]) if part)

    def told(self, value: float) -> str:
        """A number on it, with its unit; or its name."""
        if self.axis.names:
            return self.axis.names[round(value)]
        if self.axis.scale == "exponent":
            return odds(10.0**value)
        by, unit = self._unit
        return f"{value / by:.4g} {unit}".rstrip().replace("-", "−")

    def told_between(self, low: float, high: float) -> str:
        """A 95 % interval on it: its middle, with half of it."""
        return quantity((low + high) / 2, self.axis.unit, (high - low) / 2 / Z_95 or None).replace("-", "−")

    def ticks(self, apart: float) -> list[Tick]:
        """Numbers at least about so many px apart."""
        most = max(abs(self.end - self.start) / apart, 1.0)
        if self.axis.names:
            return [Tick(self._place(k), name) for k, name in enumerate(self.axis.names)]
        if self.axis.scale == "log":
            return [Tick(self._place(value), text) for value, text in self._powers(most)]
        return list(self._even(most))

    @property
    def _unit(self) -> tuple[float, str]:
        """By what numbers are divided, and the unit of the quotient."""
        unit = self.axis.unit
        if self.axis.scale != "linear" or unit in ("1", "rad"):
            return 1.0, unit
        return scaled(max(abs(self.axis.low), abs(self.axis.high)), unit)

    def _course(self, value: float) -> float:
        return math.log10(value) if self.axis.scale == "log" else value

    def _place(self, value: float) -> float:
        at = self.at(value)
        assert at is not None
        return at

    def _even(self, most: float) -> Iterator[Tick]:
        by = self._unit[0]
        low, high = self.axis.low / by, self.axis.high / by
        exponent, least = self.axis.scale == "exponent", (high - low) / most
        step = _of(_EXPONENTS, least) if exponent else _of(_ANGLES, least) if self.axis.unit == "deg" else _step(least)
        decimals = max(0, -math.floor(math.log10(step) + _EDGE))
        room = _EDGE * (high - low)
        for k in range(math.ceil((low - room) / step), math.floor((high + room) / step) + 1):
            text = _power(k * step) if exponent else f"{k * step + 0.0:.{decimals}f}".replace("-", "−")
            yield Tick(self._place(k * step * by), text)

    def _powers(self, most: float) -> Iterator[tuple[float, str]]:
        """Powers of ten, and 2 and 5 times these where there is room."""
        low, high = math.log10(self.axis.low), math.log10(self.axis.high)
        decades = range(math.floor(low), math.ceil(high) + 1)
        every = max(1, math.ceil((high - low) / most))
        factors = (1, 2, 5) if 3.0 * (high - low) <= most else (1,)
        for decade in decades:
            for factor in factors if decade % every == 0 else ():
                value = factor * 10.0**decade
                if low - _EDGE <= math.log10(value) <= high + _EDGE:
                    parts = ([str(factor)] if factor > 1 else []) + ([_power(decade)] if decade or factor == 1 else [])
                    yield value, "·".join(parts)


def _step(least: float) -> float:
    """1, 2 or 5 times a power of ten, no less."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in _STEPS if step * power >= least * (1.0 - _EDGE))


def _of(steps: Sequence[float], least: float) -> float:
    return next((step for step in steps if step >= least), _step(least))


def _power(exponent: float) -> str:
    """Ten to it."""
    if exponent in (0, 1):
        return "10" if exponent else "1"
    return "10" + f"{exponent:.0f}".translate(_SUPERSCRIPTS)
