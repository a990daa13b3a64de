"""Phase sensors: one of three that reads the wrong sign, or nothing, read off the columns themselves.

Three wires carry no net current, so each phase is minus the sum of the other two, but for offsets:

    i_k = g_k -(i_l + i_m)        g_k = 1: sound; -1: the wrong sign; no change of i_k at all: dead

Unequal gains near 1 are the library's `current_sensor_gain`. A rotor that is held, where any two phases go together,
tells nothing. Knows no effect.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.words import listed, number
from estimator.physics.vectors import AXES
from estimator.samples import Samples

PHASES: Final = ("i_a", "i_b", "i_c")
_FEWEST: Final = 200  # rows
_TOGETHER: Final = 0.8  # squared correlation of the other two phases, from which nothing is told; a turning one's: 1/4
_LEFT: Final = 0.05  # of a phase's mean square, that may be left where it is proportional to the other two's sum
_SAME: Final = 0.2  # log, by which the factor of a turned sensor may differ from 1
_BY_GAIN: Final = 0.3  # by which the library's gains differ
_DEAD: Final = 0.05  # of the current that should be read, which a dead sensor's noise is below
_MADE_OF: Final = 0.05  # of the mean square of what the fault does to i_d and i_q, which may be left


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong with one sensor."""

    phase: int  # 0, 1, 2: a, b, c
    factor: float  # recorded over minus the sum of the other two: -1, 0 where it is dead, or another
    says: str  # in a sentence's part
    made_of: bool | None  # whether i_d and i_q are made of what it reads; None: of something else still

    @property
    def name(self) -> str:
        """The column's."""
        return PHASES[self.phase]

    @property
    def sure(self) -> bool:
        """Whether it is known what the sensor should have read: a gain may be that of the other two."""
        return self.factor in (-1.0, 0.0)

    def remark(self) -> str:
        """In a sentence, where i_d and i_q are not corrected for it."""
        made = {True: "i_d and i_q are made of it", False: "i_d and i_q are not made of it, and hold"}
        unclear = "whether i_d and i_q are made of it cannot be told: check them by theta_e"
        return f"{self.says}; {unclear if self.made_of is None else made[self.made_of]}; {self.remedy()}"

    def remedy(self) -> str:
        """What to do about the file, in a sentence's part."""
        others = " and ".join(name for name in PHASES if name != self.name)
        also = ", with i_d and i_q left out, which are then made of the phase currents" if self.made_of else ""
        if self.factor == 0.0:
            also = " i_d and i_q are then made of" if self.made_of else " they are enough without it:"
            left_out = f"{self.name}, i_d and i_q" if self.made_of else self.name
            return f"check the sensor, or leave {left_out} out of the file:{also} {others}"
        if self.factor == -1.0:
            return f"check the sensor's direction, or --map {self.name}=COLUMN*-1{also}"
        return f"check the sensors' ranges, or --map {self.name}=COLUMN*{1.0 / self.factor:.4g}{also}"


@dataclass(slots=True, eq=False)
class PhaseSums:
    """Takes phase currents in any order of their rows; `fault` after the last."""

    _count: int = 0
    _sums: Array = field(default_factory=lambda: np.zeros(3))
    _products: Array = field(default_factory=lambda: np.zeros((3, 3)))
    _low: Array = field(default_factory=lambda: np.full(3, math.inf))
    _high: Array = field(default_factory=lambda: np.full(3, -math.inf))
    _off: Array = field(default_factory=lambda: np.zeros(4))  # A^2: of i_d, i_q from all three, and without each

    def take(self, phases: Sequence[Array], i_dq: Vector, theta_e: Array) -> None:
        """Phase currents (A) of rows, and what the rows have as i_d + j i_q and angle (rad); all (n,)."""
        x: Array = np.stack(phases)
        known: NDArray[np.bool_] = np.isfinite(x).all(axis=0) & np.isfinite(i_dq) & np.isfinite(theta_e)
        x, i_dq, theta_e = x[:, known], i_dq[known], theta_e[known]
        if not x.shape[1]:
            return
        self._count += x.shape[1]
        self._sums += x.sum(axis=1)
        self._products += x @ x.T
        self._low, self._high = np.minimum(self._low, x.min(axis=1)), np.maximum(self._high, x.max(axis=1))
        turned, net = np.exp(-1j * theta_e), x.sum(axis=0)
        off: Vector = 2.0 / 3.0 * (np.array(AXES) @ x) * turned - i_dq
        self._off[0] += float(np.sum(np.abs(off) ** 2))
        for k, axis in enumerate(AXES):  # that phase minus the sum of the others
            without = off - 2.0 / 3.0 * axis * net * turned
            self._off[1 + k] += float(np.sum(np.abs(without) ** 2))

    def fault(self) -> Fault | None:
        """The one sensor that is off; None where none is, or it is not told which."""
        if self._count < _FEWEST:
            return None
        mean = self._sums / self._count
        covariance = self._products / self._count - np.outer(mean, mean)
        found = [fault for k in range(3) if (fault := self._of(k, covariance)) is not None]
        return found[0] if len(found) == 1 else None

    def _of(self, k: int, covariance: Array) -> Fault | None:
        a, b = (one for one in range(3) if one != k)
        own, both = float(covariance[k, k]), float(covariance[a, a] + covariance[b, b] + 2.0 * covariance[a, b])
        together = float(covariance[a, b]) ** 2
        if both <= 0.0 or together >= _TOGETHER * float(covariance[a, a] * covariance[b, b]):
            return None
        factor = -float(covariance[k, a] + covariance[k, b]) / both
        others = tuple(PHASES[one] for one in (a, b))
        if own > 0.0 and own - factor**2 * both < _LEFT * own:
            if factor < 0.0 and abs(math.log(-factor)) < _SAME:
                says = (
                    f"i_a + i_b + i_c is not zero: it is -2 {PHASES[k]}, with {PHASES[k]} = -({' + '.join(others)}): "
                    f"{PHASES[k]} has the wrong sign"
                )
                return Fault(k, -1.0, says, self._made_of(k))
            if abs(factor - 1.0) > _BY_GAIN:
                says = (
                    f"i_a + i_b + i_c is not zero: {PHASES[k]} is {factor:.3g} times -({' + '.join(others)}), expected "
                    "once"
                )
                return Fault(k, factor, says, self._made_of(k))
        elif own < _DEAD**2 * both:
            return Fault(k, 0.0, self._reads_nothing(k, others), self._made_of(k))
        return None

    def _reads_nothing(self, k: int, others: Sequence[str]) -> str:
        low, high = float(self._low[k]), float(self._high[k])
        if low == high:
            value = "0" if low == 0.0 else f"{number(low)} A"
            return f"{PHASES[k]} is {value} in all rows while {listed(others)} are not"
        return (
            f"{PHASES[k]} stays between {number(low)} and {number(high)} A in all rows while {listed(others)}, which "
            "it balances, do not"
        )

    def _made_of(self, k: int) -> bool | None:
        recorded, without = float(self._off[0]), float(self._off[1 + k])
        least = _MADE_OF * max(recorded, without)
        return True if recorded < least else False if without < least else None


def sensor_fault(runs: Iterable[Samples]) -> Fault | None:
    """The one phase current of a recording that is off."""
    sums = PhaseSums()
    for run in runs:
        if run.i_a is None or run.i_b is None or run.i_c is None:
            return None
        sums.take((run.i_a, run.i_b, run.i_c), run.i_d + 1j * run.i_q, run.theta_e)
    return sums.fault()


def without_fault(runs: Iterable[Samples], fault: Fault) -> tuple[Samples, ...]:
    """The recording as a sound sensor would have made it: turned, or by the other two where it is dead."""
    return tuple(_sound(run, fault) for run in runs)


def _sound(run: Samples, fault: Fault) -> Samples:
    phases = [column for column in (run.i_a, run.i_b, run.i_c) if column is not None]
    recorded = phases[fault.phase]
    right = -recorded if fault.factor else recorded - sum(phases)
    if fault.made_of:
        i = run.i_d + 1j * run.i_q + 2.0 / 3.0 * AXES[fault.phase] * (right - recorded) * np.exp(-1j * run.theta_e)
        run = replace(run, i_d=np.ascontiguousarray(i.real), i_q=np.ascontiguousarray(i.imag))
    if not fault.factor:  # two sensors are left, whose sum tells nothing
        return replace(run, i_a=None, i_b=None, i_c=None)
    phases[fault.phase] = right
    return replace(run, i_a=phases[0], i_b=phases[1], i_c=phases[2])
