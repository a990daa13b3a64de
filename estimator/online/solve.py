"""From the numbers of one window to what it says: values with standard errors, and sentences where it cannot tell.

Knows nothing of streams; `fit` makes the numbers.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.interval import Z_95
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS
from estimator.online.estimate import Combination, Estimate, Status
from estimator.online.excitation import combinations
from estimator.online.fit import FAINT_I, FAINT_SPEED, WindowFit, fit_windows, spread_of_speed
from estimator.online.sums import WindowSums

_STEADY: Final = 0.02  # share of its mean by which a steady signal departs from it, or 3 times its noise


@dataclass(frozen=True, slots=True)
class Solution:
    """What the sums say."""

    estimates: dict[str, Estimate]
    combinations: tuple[Combination, ...]
    condition: float | None
    residual_rms: float | None  # V
    impossible: tuple[str, ...] = ()  # parameters that come out as no motor has them


def check_held(estimated: Sequence[str], held: Mapping[str, float]) -> None:
    """Raise ValueError, in a sentence, when a parameter is neither estimated nor held."""
    for name in PARAMETERS:
        if name not in estimated and name not in held:
            raise ValueError(f"{name} is not estimated and so needs a held value, got none")


def solve(
    sums: WindowSums, estimated: Sequence[str], held: Mapping[str, float], *, noise_aware: bool = True
) -> Solution:
    """What one window (K = 1) says of `estimated`, the others at their `held` values (SI); see `fit.fit`.

    A parameter that the sums cannot tell gets no value of its own: its held one, if any, and a reason.
    """
    return solution_of(sums, fit_windows(sums, estimated, held, noise_aware=noise_aware), held)


def solution_of(sums: WindowSums, found: WindowFit, held: Mapping[str, float]) -> Solution:
    """What the first of the windows in `found` says; `sums` are theirs."""
    rows, p = float(sums.rows[0]), len(found.free)
    if sums.axes * rows <= p:
        return Solution(_no_data(round(sums.axes * rows), found.free, held), (), None, None)
    untold = [j for j, k in enumerate(found.free) if not (found.told[0, k] and found.beta[0, k] > 0.0)]
    groups = combinations(found.weak[0], untold)
    said = [Combination(tuple(PARAMETERS[found.free[j]] for j in g), _why_untold(g, sums, found)) for g in groups]
    reasons = {name: each.reason for each in said for name in each.parameters}
    estimates: dict[str, Estimate] = {}
    for k, name in enumerate(PARAMETERS):
        if k not in found.free:
            estimates[name] = at_held(name, held)
        elif name in reasons:
            estimates[name] = replace(at_held(name, held), status=Status.NOT_TOLD, reason=reasons[name])
        else:
            value, std = float(found.beta[0, k]), float(found.std[0, k])
            estimates[name] = Estimate(name, value, std, UNITS[name], Status.OK)
    condition = float(found.condition[0])
    return Solution(
        estimates, tuple(said), condition if math.isfinite(condition) else None, float(found.residual_rms[0]),
        tuple(PARAMETERS[k] for k in found.free if found.told[0, k] and not plausible(k, float(found.beta[0, k]))),
    )


def plausible(k: int, value: float) -> bool:
    """Whether some motor may have this value (SI) of the k-th parameter."""
    low, high = PLAUSIBLE[PARAMETERS[k]]
    return low <= value <= high


def _no_data(equations: int, free: list[int], held: Mapping[str, float]) -> dict[str, Estimate]:
    reason = f"{equations} equations are too few for {len(free)} parameters"
    return {
        name: Estimate(name, None, None, UNITS[name], Status.NO_DATA, reason) if k in free
        else at_held(name, held)
        for k, name in enumerate(PARAMETERS)
    }


def at_held(name: str, held: Mapping[str, float]) -> Estimate:
    """A parameter that is not estimated, at its value (SI) of those held."""
    return Estimate(name, held.get(name), None, UNITS[name], Status.HELD, "held at the given value")


def _why_untold(group: tuple[int, ...], sums: WindowSums, found: WindowFit) -> str:
    """Why a window cannot tell parameters apart, or one at all, in a sentence. `group` counts the free parameters."""
    places = [found.free[j] for j in group]
    names = [PARAMETERS[k] for k in places]
    signals = _Signals.of(sums, found)
    if len(names) > 1:
        return f"{_words_listed(names)} cannot be told apart here: {signals.steadiness(names)}"
    (name,), (k,) = names, places
    if np.sum(found.weak[0, group[0]] ** 2) > 0.5:
        return f"{name} cannot be told here: {signals.silence(name)}"
    value, half = float(found.beta[0, k]), Z_95 * float(found.std[0, k])
    if half < abs(value):
        return (
            f"{name} cannot be told here: it comes out as {value:.3g} +- {half:.2g} {UNITS[name]}, which no motor has; "
            "the equations do not fit these data"
        )
    return f"{name} cannot be told here: no closer than {value:.3g} +- {half:.2g} {UNITS[name]}"


def _words_listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


@dataclass(frozen=True, slots=True)
class _Signals:
    """What the currents and the speed of a window did."""

    still: bool  # the motor stands
    flows: tuple[bool, bool]  # i_d, i_q stand out of their noise
    rms: float  # A, of the current
    noise: float  # A rms, as far as it is told
    left: float  # V rms, of the voltages
    steady: tuple[bool, bool, bool]  # i_d, i_q, speed

    @classmethod
    def of(cls, sums: WindowSums, found: WindowFit) -> "_Signals":
        """From the sums: at speed, y_d = i_d s and i_q keep in step with s where i_d and i_q are steady."""
        d, q = sums.lag0[0]
        n = float(sums.rows[0])
        ss, y_y, y_s, i_i, i_s = q[3, 3], q[1, 1], q[1, 3], q[0, 0], q[0, 3]
        level2 = np.array([d[0, 0], i_i]) / n  # A^2
        noise2 = 9.0 * found.noise[0] + FAINT_I**2
        still = ss <= n * FAINT_SPEED**2
        if still:  # a current that changes has flux differences x
            x2 = np.array([d[1, 1], q[2, 2]]) / n * sums.T**2
            off2 = np.where(x2 > 4.0 * sums.periods * noise2, level2, 0.0)
        else:
            off2 = np.array([(y_y - y_s**2 / ss) / ss, (i_i - i_s**2 / ss) / n])
        steady = off2 <= np.maximum(_STEADY**2 * level2, noise2)
        steady_speed = bool(still or spread_of_speed(sums)[0] < 4.0 * _STEADY**2)
        flows = level2 > noise2
        return cls(
            bool(still), (bool(flows[0]), bool(flows[1])), math.sqrt(float(level2.sum())),
            math.sqrt(float(np.sum(found.noise[0]))), float(found.residual_rms[0]),
            (bool(steady[0]) and not sums.q_only, bool(steady[1]), steady_speed),
        )

    def silence(self, name: str) -> str:
        """Why a parameter acts nowhere."""
        if name == "psi_f":
            return "the motor stands still"
        if name == "R_s":
            if not any(self.flows):
                return f"its currents, {self.rms:.2g} A rms, do not stand out of their noise, {self.noise:.2g} A"
            return f"its share of {self.rms:.3g} A rms is lost in what is left of the voltages, {self.left:.3g} V rms"
        letter, flows = ("i_d", self.flows[0]) if name == "L_d" else ("i_q", self.flows[1])
        if self.still and flows:
            return f"{letter} is constant and the motor stands still"
        return f"{letter} is zero or does not stand out of its noise"

    def steadiness(self, names: Sequence[str]) -> str:
        """Why parameters act alike. L_d and psi_f are one flux linkage while i_d is constant, at any speed."""
        letters = ("i_d",) if set(names) == {"L_d", "psi_f"} else ("i_d", "i_q", "speed")
        constant = [letter for letter, steady in zip(letters, self.steady, strict=False) if steady]
        if not constant:
            return f"currents and speed vary too little beside what is left of the voltages, {self.left:.3g} V rms"
        return f"{_words_listed(constant)} {'is' if len(constant) == 1 else 'are'} constant"
