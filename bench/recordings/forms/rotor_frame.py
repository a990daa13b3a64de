"""Phase and alpha-beta quantities to the rotor's frame, and the speed by the angle.

Amplitude-invariant, d axis on the magnet flux, alpha on phase a. Currents are turned by the angle at a row's start, as
they are sampled there; voltages by the angle in the row's middle, as the convention has them. How far the rotor turns
in a row is told by the next one, or, at the end of a stretch of rows, by the one before. Knows nothing of files.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.recordings.forms.times import JITTER, Column, Part

PHASES: Final = ("a", "b", "c")
AXES: Final = ("alpha", "beta")

Vector = NDArray[np.complex128]


def stationary(letter: str, there: Sequence[str]) -> tuple[str, ...]:
    """Which of these quantities tell currents (letter `i`) or voltages (`u`) in the stationary frame; none: too few.

    Two currents of three are enough, as their sum is zero.
    """
    axes, phases = (tuple(f"{letter}_{one}" for one in names) for names in (AXES, PHASES))
    if set(axes) <= set(there):
        return axes
    found = tuple(name for name in phases if name in there)
    return found if len(found) >= (2 if letter == "i" else 3) else ()


@dataclass(frozen=True, slots=True)
class RotorFrame:
    """What is made of which quantities."""

    currents: tuple[str, ...]  # that i_d and i_q are made of, none: they are there
    voltages: tuple[str, ...]
    speed: bool  # whether omega_e is the angle's derivative
    constants: Mapping[str, float]  # quantities that are no column
    keep: tuple[str, ...]  # quantities that are handed on

    def turned(self, parts: Iterator[Part], step: float) -> Iterator[Part]:
        """Parts with the quantities made. `step`: s between rows."""
        before, waiting = np.empty(0), None  # how far the row before turned; a row that waits for the next one
        for part in parts:
            if not part:
                if waiting is not None:
                    yield self._made(waiting, self._turns(waiting, step), before, step)
                before, waiting = np.empty(0), None
                yield part
                continue
            rows = part if waiting is None else {name: np.r_[waiting[name], x] for name, x in part.items()}
            turns = self._turns(rows, step)
            ready = {name: x[:-1] for name, x in rows.items()}
            if len(turns) > 1:
                yield self._made(ready, turns[:-1], before, step)
                before = turns[-2:-1]
            waiting = {name: x[-1:] for name, x in rows.items()}
        if waiting is not None:
            yield self._made(waiting, self._turns(waiting, step), before, step)

    def _turns(self, rows: Part, step: float) -> Column:
        """How far the rotor turns in each row, rad; nan where no row follows by one step. Shape (n,)."""
        turns = np.full(len(rows["t"]), np.nan)
        follows = np.abs(np.diff(rows["t"]) / step - 1.0) <= JITTER
        expected = 0.0 if self.speed else step * self._of(rows, "omega_e")[:-1]
        off = np.diff(self._of(rows, "theta_e")) - expected
        turns[:-1] = np.where(follows, off - 2.0 * math.pi * np.rint(off / (2.0 * math.pi)) + expected, np.nan)
        return turns

    def _made(self, rows: Part, turns: Column, before: Column, step: float) -> Part:
        made = dict(rows)
        earlier = np.r_[before if len(before) else [np.nan], turns[:-1]]
        theta_e = self._of(rows, "theta_e")
        if self.currents:
            i = self._vector(rows, self.currents) * np.exp(-1j * theta_e)
            made |= {"i_d": i.real, "i_q": i.imag}
        if self.voltages:
            middle = theta_e + 0.5 * np.where(np.isnan(turns), earlier, turns)
            u = self._vector(rows, self.voltages) * np.exp(-1j * middle)
            made |= {"u_d": u.real, "u_q": u.imag}
        if self.speed:
            both = 0.5 * (turns + earlier)
            made["omega_e"] = np.where(np.isnan(both), np.where(np.isnan(turns), earlier, turns), both) / step
        return {name: made[name] for name in self.keep if name in made}

    def _vector(self, rows: Part, names: Sequence[str]) -> Vector:
        """The space vector of quantities in the stationary frame. Shape (n,)."""
        if len(names) == len(AXES) and names[0].endswith(AXES[0]):
            return self._of(rows, names[0]) + 1j * self._of(rows, names[1])
        found = {name[-1]: self._of(rows, name) for name in names}
        a, b, c = (found[one] if one in found else -np.sum(list(found.values()), axis=0) for one in PHASES)
        return np.asarray((2.0 * a - b - c) / 3.0 + 1j * (b - c) / math.sqrt(3.0), dtype=np.complex128)

    def _of(self, rows: Part, name: str) -> Column:
        return rows[name] if name in rows else np.full(len(rows["t"]), self.constants[name])
