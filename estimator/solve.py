"""From the sums of a window to parameters: least squares, its second-order terms, its noise, its doubts.

The rows are those of `flux_balance`, on the d and the q axis. `WindowSums` holds, per axis, the products of each row
with itself and with the next one; nothing else of the window is needed, so a solution costs the same for any length.

The equations are linear but for small terms of the mean current (see `flux_balance`), which are iterated:

    u_d = ... - R_s psi_f/L_d h + b_d (x_d - y_q)        b = (R_s T_s)^2 / (12 L), d and q axis
    u_q = ...                   + b_q (x_q + y_d)

Current noise sits inside the regressors (errors in variables) and would read inductances low. What it adds to the
normal matrix is estimated from the residual's colour and taken out (bias-eliminating least squares; survey:
T. Soederstroem, Errors-in-variables methods in system identification, Automatica 43, 2007,
doi 10.1016/j.automatica.2006.11.025). Standard errors are of sandwich form with a residual that is coloured the way
differenced noise is: correlated between neighbouring rows, and not further. Knows nothing of streams.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.estimate import Estimate, Status
from estimator.excitation import Excitation, excitation
from estimator.machine import PARAMETERS, UNITS

Array = NDArray[np.float64]

NOISE_DOUBT: Final = 0.1  # the bias that current noise leaves is known to within this share of it
FAINT_I: Final = 1e-9  # A, and
FAINT_SPEED: Final = 1e-6  # rad/s: what is smaller is arithmetic, not a signal
_ROUNDS: Final = 4  # of the iteration; each gains three digits
_H: Final = 4  # place of h, and
_SIZE: Final = 6  # size of (R_s, L_d, L_q, psi_f, h, u)
_PLACES: Final = (np.array([0, 1, 2, 4, 5]), np.array([0, 1, 2, 3, 5]))  # of a d-axis and a q-axis row in it


@dataclass(frozen=True, slots=True, eq=False)
class WindowSums:
    """Sums over a window's regression rows, by axis (d, q), over (R_s, L_d, L_q, psi_f, h, u)."""

    lag0: tuple[Array, Array]  # (6, 6) each: z_k z_k'
    lag1: tuple[Array, Array]  # (6, 6) each: z_k z_{k+1}' + its transpose, over neighbouring rows
    rows: int
    pairs: int  # of neighbouring rows
    T_s: float  # s, control period
    periods: int  # control periods that a row covers

    @property
    def T(self) -> float:
        """Time that a row covers in s."""
        return self.T_s * self.periods


@dataclass(frozen=True, slots=True)
class Solution:
    """What the sums say."""

    estimates: dict[str, Estimate]
    condition: float | None
    residual_rms: float | None  # V


def sums_from(triangles: Array, rows: int, pairs: int, T_s: float, periods: int) -> WindowSums:
    """Sums from upper triangles (4, 15): d and q axis at lag 0, d and q axis at lag 1."""
    d0, q0, d1, q1 = (_square(triangle, _PLACES[k % 2]) for k, triangle in enumerate(triangles))
    return WindowSums((d0, q0), (d1, q1), rows, pairs, T_s, periods)


def check_held(estimated: Sequence[str], held: Mapping[str, float]) -> None:
    """Raise ValueError, in a sentence, when a parameter is neither estimated nor held."""
    for name in PARAMETERS:
        if name not in estimated and name not in held:
            raise ValueError(f"{name} is not estimated and so needs a held value, got none")


def solve(
    sums: WindowSums, estimated: Sequence[str], held: Mapping[str, float], *, noise_aware: bool = True
) -> Solution:
    """Least-squares solution for `estimated`, the others at their `held` values (SI).

    `noise_aware` takes the energy of current noise out of the normal matrix; without it the result is plain least
    squares, and the bias is added to the standard errors instead. A parameter that the sums cannot tell gets no
    value of its own: its held one, if any, and a reason.
    """
    free = [PARAMETERS.index(name) for name in PARAMETERS if name in estimated]
    if 2 * sums.rows <= len(free):
        reason = f"{2 * sums.rows} equations are too few for {len(free)} parameters"
        nothing = {
            name: Estimate(name, None, None, UNITS[name], Status.NO_DATA, reason) if name in estimated
            else _at_held(name, held, Status.HELD, "held at the given value")
            for name in PARAMETERS
        }
        return Solution(nothing, None, None)

    G = (sums.lag0[0] + sums.lag0[1])[np.ix_(free, free)]
    ex = excitation(G, np.zeros_like(G))
    noise = np.zeros(len(free))
    beta = np.array([0.0 if name in estimated else held[name] for name in PARAMETERS])
    small = np.zeros(3)
    for _ in range(_ROUNDS):
        beta[free] = 0.0
        d, q = _axes(beta, small)
        beta[free] = -ex.inverse @ (sums.lag0[0] @ d + sums.lag0[1] @ q)[free]
        small = _second_order(_known(beta, ex, free, held), sums.T_s)
        noise = _regressor_noise(sums, beta, _axes(beta, small))[free]
        if noise_aware:
            ex = excitation(G, np.diag(noise))
    if not noise_aware:
        ex = replace(excitation(G, np.diag(noise)), inverse=ex.inverse)

    covariance, rss = _covariance(sums, _axes(beta, small), free, ex.inverse)
    bias = ex.inverse @ (noise * beta[free])
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0) + ((NOISE_DOUBT if noise_aware else 1.0) * bias) ** 2)
    estimates: dict[str, Estimate] = {}
    for k, name in enumerate(PARAMETERS):
        if name not in estimated:
            estimates[name] = _at_held(name, held, Status.HELD, "held at the given value")
        elif ex.told[free.index(k)]:
            estimates[name] = _told(name, float(beta[k]), float(std[free.index(k)]), held)
        else:
            estimates[name] = _at_held(name, held, Status.NOT_TOLD, _why(name, free.index(k), free, ex))
    return Solution(estimates, ex.condition, math.sqrt(rss / (2 * sums.rows)))


def _square(triangle: Array, places: NDArray[np.int64]) -> Array:
    full = np.zeros((_SIZE, _SIZE))
    rows, columns = np.triu_indices(len(places))
    full[places[rows], places[columns]] = triangle
    full[places[columns], places[rows]] = triangle
    return full


def _axes(beta: Array, small: Array) -> tuple[Array, Array]:
    """Coefficients c (6,) of the d and the q axis, so that c' z is minus the residual of a row z."""
    h, b_d, b_q = small
    R_s, L_d, L_q, psi_f = beta
    d = np.array([R_s, L_d + b_d, L_q + b_d, psi_f, h, -1.0])
    return d, np.array([R_s, L_d + b_q, L_q + b_q, psi_f, h, -1.0])


def _known(beta: Array, ex: Excitation, free: list[int], held: Mapping[str, float]) -> Array:
    """The parameters where told or held, 0 elsewhere; shape (4,)."""
    known = beta.copy()
    for j, told in zip(free, ex.told, strict=True):
        if not told:
            known[j] = held.get(PARAMETERS[j], 0.0)
    return known


def _second_order(known: Array, T_s: float) -> Array:
    """Coefficients of the small terms: of h in V, b_d and b_q in H; 0 where a parameter is not known."""
    R_s, L_d, L_q, psi_f = known
    h = -R_s * psi_f / L_d if L_d > 0.0 else 0.0
    b_d, b_q = ((R_s * T_s) ** 2 / (12.0 * L) if abs(R_s) * T_s < 3.0 * L else 0.0 for L in (L_d, L_q))
    return np.array([h, b_d, b_q])


def _regressor_noise(sums: WindowSums, beta: Array, axes: tuple[Array, Array]) -> Array:
    """Energy that current noise contributes to each regressor, shape (4,).

    White noise of variance sigma2 in the sampled current leaves a residual whose lag-1 covariance is
    -(L sigma/T)^2, however the machine is excited. Where the window does not tell L, the flux difference x itself
    has one of -sigma2/T^2; so has a signal that steps from row to row, but not without a residual to match.
    """
    n, T = sums.rows, sums.T
    sigma2 = np.full(2, FAINT_I**2)  # A2, per sample and axis
    for axis, (c, S0, S1) in enumerate(zip(axes, sums.lag0, sums.lag1, strict=True)):
        j = 1 + axis  # L_d of the d axis, L_q of the q axis
        L2 = max(float(beta[j]) ** 2, 1e-18)
        gamma0 = max(0.0, float(c @ S0 @ c)) / n
        pairs = max(1, sums.pairs)
        gamma1 = float(c @ S1 @ c) / (2 * pairs)
        by_residual = min(max(0.0, -gamma1) / L2, S0[j, j] / (2 * n))
        by_signal = min(max(0.0, -S1[j, j] / (2 * pairs)), gamma0 / (2.0 * L2))
        sigma2[axis] += T**2 * max(by_residual, by_signal)
    of_mean = sigma2 / sums.periods
    s2 = sums.lag0[1][3, 3]  # sum of s^2, (rad/s)^2
    x = n * 2.0 * sigma2 / T**2 + s2 * of_mean
    return np.array([n * of_mean.sum(), x[0], x[1], n * FAINT_SPEED**2])


def _covariance(
    sums: WindowSums, axes: tuple[Array, Array], free: list[int], inverse: Array
) -> tuple[Array, float]:
    """Sandwich covariance with first-order moving-average residuals per axis, and the residual's sum of squares."""
    n = sums.rows
    dof = 2.0 * n / (2.0 * n - len(free))
    meat = np.zeros((len(free), len(free)))
    total = 0.0
    for c, S0, S1 in zip(axes, sums.lag0, sums.lag1, strict=True):
        rss = max(0.0, float(c @ S0 @ c))
        total += rss
        gamma0 = dof * rss / n
        gamma1 = dof * float(c @ S1 @ c) / (2.0 * sums.pairs) if sums.pairs else 0.0
        gamma1 = min(max(gamma1, -0.5 * gamma0), 0.5 * gamma0)
        meat += gamma0 * S0[np.ix_(free, free)] + gamma1 * S1[np.ix_(free, free)]
    return inverse @ meat @ inverse, total


def _told(name: str, value: float, std: float, held: Mapping[str, float]) -> Estimate:
    """The estimate, unless its interval is as wide as its value."""
    unit = UNITS[name]
    if 1.96 * std < abs(value):
        return Estimate(name, value, std, unit, Status.OK)
    reason = f"this window tells no more of {name} than {value:.3g} +- {1.96 * std:.2g} {unit}"
    return _at_held(name, held, Status.NOT_TOLD, reason)


def _at_held(name: str, held: Mapping[str, float], status: Status, reason: str) -> Estimate:
    return Estimate(name, held.get(name), None, UNITS[name], status, reason)


_SILENT: Final = {
    "R_s": "no current flows",
    "L_d": "i_d is zero or does not stand out of its noise",
    "L_q": "i_q is zero or does not stand out of its noise",
    "psi_f": "the motor stands still",
}


def _why(name: str, j: int, free: list[int], ex: Excitation) -> str:
    """Why the window cannot tell a parameter, in a sentence."""
    groups = [group for group in ex.combinations if j in group]
    partners = sorted({PARAMETERS[free[k]] for group in groups for k in group if k != j}, key=PARAMETERS.index)
    if (j,) in groups or not partners:
        return f"this window cannot tell {name}: {_SILENT[name]}"
    return f"this window cannot tell {name} apart from {' and '.join(partners)}: currents and speed vary too little"
