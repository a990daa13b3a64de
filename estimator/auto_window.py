"""A window chosen by the data, for each parameter by itself, at every estimate anew and at bounded cost.

A long window averages noise away, and lags by half its length behind a parameter that moves. How much of the past
still belongs to the present is a question to the data: the longest window is cut into at most `RINGS` consecutive
stretches, the older the longer, and every stretch gives its own estimate of the parameter with its own standard error.
Then every window that ends at such a cut is a hypothesis, in two forms:

    level   within the window the parameter stands still
    line    within the window it moves in a straight line, and the line's end is the present value

and what lies before the window is free. A hypothesis is judged by its misfit to the stretches in the window, in
units of their standard errors, and pays `PRICE` for each thing it leaves free:

    score = chi^2 + PRICE (stretches left out of the window + 1 for a line)

The estimate is the mean of all hypotheses, weighted by exp(-score / (2 WARMTH)). Its standard error takes in how far
the hypotheses that remain are apart, which is what is left of the lag. It knows of no lag that no hypothesis shows:
where the parameter's line bends faster than a few stretches can tell, it is too small.

The constants were chosen on emulated runs of seeds 1 to 20; what is reported and tested are seeds from 101 on.

Choosing among windows by whether they agree is from A. Goldenshluger, A. Nemirovski, On spatially adaptive
estimation of nonparametric regression, Mathematical Methods of Statistics 6, 1997; to average by exponential weights
instead of picking one is S. T. Buckland, K. P. Burnham, N. H. Augustin, Model selection: an integral part of inference,
Biometrics 53, 1997, doi 10.2307/2533961. Knows nothing of streams beyond `window_ls`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.estimate import Estimate, Status, WindowEstimate
from estimator.machine import PARAMETERS, UNITS
from estimator.solve import NOISE_DOUBT, Solution, WindowSums, check_held, solve
from estimator.window_ls import WindowState, sums_of

Array = NDArray[np.float64]

RINGS: Final = 12
SHORTEST: Final = 16  # regression rows per axis of the newest stretch, and of any other at least
PRICE: Final = 10.0  # a line or a cut must improve chi^2 by about this: 3 standard errors
WARMTH: Final = 1.5
WARMTH_OF_DOUBT: Final = 3.0  # of the standard error: it hears hypotheses that the value no longer does
SHARED: Final = 50.0  # rows: a stretch's own residual counts against that of all stretches as its rows against these


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Estimates of one parameter from consecutive stretches of the stream, newest first; arrays of equal length."""

    value: Array
    std: Array
    start: Array  # samples ago that the stretch began
    end: Array  # samples ago that it ended


def estimate(
    state: WindowState, estimated: Sequence[str] = PARAMETERS, held: Mapping[str, float] | None = None
) -> WindowEstimate:
    """What the newest samples say; counts, condition and residual are those of the longest window.

    Parameters not in `estimated` need a value in `held` (SI). Each estimate's `window` is that of the weightiest
    hypothesis.
    """
    held = held or {}
    check_held(estimated, held)
    cuts = lengths_of(state.samples, state.m)
    sums = [sums_of(state, length) for length in cuts]
    rings = [sums[0], *(_less(longer, shorter) for shorter, longer in pairwise(sums))]
    whole = solve(sums[-1], estimated, held)
    solutions = [whole] if len(rings) == 1 else [solve(ring, estimated, held) for ring in rings]
    plain = solve(sums[-1], estimated, held, noise_aware=False)
    errors = _common_errors(rings, solutions, estimated)
    estimates: dict[str, Estimate] = {}
    for name in PARAMETERS:
        estimates[name] = whole.estimates[name]
        if name not in estimated:
            continue
        estimates[name] = replace(estimates[name], window=cuts[-1])
        told = _stretches(name, solutions, errors, cuts)
        alone = whole.estimates[name].std
        if alone is not None and _precision(told) < 0.5 / alone**2:
            continue  # the stretches, each by itself, miss what they tell together
        if len(told.value):
            value, std, length = weighed(told, whole.estimates[name].value)
            doubt = NOISE_DOUBT * ((whole.estimates[name].value or value) - (plain.estimates[name].value or value))
            estimates[name] = Estimate(name, value, math.hypot(std, doubt), UNITS[name], Status.OK, window=length)
    return WindowEstimate(
        estimates, state.samples, state.gaps, 2 * sums[-1].rows, state.samples == state.length, whole.condition,
        whole.residual_rms,
    )


def lengths_of(samples: int, m: int) -> list[int]:
    """Window lengths to choose from, ascending: by factors of about sqrt(2) or more, at most `RINGS` of them."""
    shortest = SHORTEST * m
    ratio = max(math.sqrt(2.0), (max(samples, 1) / shortest) ** (1.0 / (RINGS - 1)))
    lengths: list[int] = []
    length = shortest
    while samples - length >= shortest and len(lengths) < RINGS - 1:
        lengths.append(length)
        length = m * math.ceil(max(length * ratio, length + shortest) / m)
    return [*lengths, samples]


def weighed(told: Stretches, together: float | None = None) -> tuple[float, float, int]:
    """Present value, its standard error, and the length of the weightiest window in samples.

    `together` is the value that all stretches give in one solution, which is the better level of the longest window.
    """
    y, w = told.value, told.std**-2.0
    t = 0.5 * (told.start + told.end) - told.end[0]  # age in samples, as of the end of the newest stretch that tells
    S, St, Stt = np.cumsum(w), np.cumsum(w * t), np.cumsum(w * t * t)
    # Sums about the mean of all, so that chi^2 keeps its digits
    about = float(np.sum(w * y) / S[-1])
    z = y - about
    Sz, Stz, Szz = np.cumsum(w * z), np.cumsum(w * t * z), np.cumsum(w * z * z)
    left_out = np.arange(len(y))[::-1]

    level = Sz / S
    misfit_of_level = Szz - level * Sz
    # A line takes two stretches at least
    D = S[1:] * Stt[1:] - St[1:] ** 2
    line = (Stt[1:] * Sz[1:] - St[1:] * Stz[1:]) / D
    slope = (S[1:] * Stz[1:] - St[1:] * Sz[1:]) / D
    misfit_of_line = Szz[1:] - line * Sz[1:] - slope * Stz[1:]

    if together is not None:
        level[-1] = together - about

    values, variances = np.concatenate((level, line)), np.concatenate((1.0 / S, Stt[1:] / D))
    misfit = np.concatenate((misfit_of_level, misfit_of_line))
    score = misfit + PRICE * np.concatenate((left_out, left_out[1:] + 1))
    freedom = np.concatenate((np.arange(len(y)), np.arange(len(y) - 1)))
    variances *= np.maximum(1.0, misfit / np.maximum(freedom, 1))
    value = float(_weights(score, WARMTH) @ values)
    variance = float(_weights(score, WARMTH_OF_DOUBT) @ (variances + (values - value) ** 2))
    reach = np.concatenate((told.start, told.start[1:]))
    return about + value, math.sqrt(variance), int(reach[np.argmin(score)])


def _weights(score: Array, warmth: float) -> Array:
    weight = np.exp(-0.5 / warmth * (score - score.min()))
    return weight / weight.sum()


def _less(longer: WindowSums, shorter: WindowSums) -> WindowSums:
    """Sums over what a window has before a shorter one.

    The difference holds the pair that straddles the cut, which is no neighbour within the stretch. With it the noise of
    the stretch's two ends would cancel; it is taken out as an average pair.
    """
    pairs = longer.pairs - shorter.pairs
    inside = (pairs - 1) / pairs if pairs > 1 else 0.0
    (d0, q0), (d1, q1) = longer.lag0, longer.lag1
    (e0, r0), (e1, r1) = shorter.lag0, shorter.lag1
    return replace(
        longer, lag0=(d0 - e0, q0 - r0), lag1=(inside * (d1 - e1), inside * (q1 - r1)),
        rows=longer.rows - shorter.rows, pairs=max(pairs - 1, 0),
    )


def _common_errors(
    rings: Sequence[WindowSums], solutions: Sequence[Solution], estimated: Sequence[str]
) -> list[dict[str, float]]:
    """Standard errors of each stretch with a residual whose colour is that of all stretches together.

    A short stretch knows the colour of its own residual badly, and so by chance a standard error near zero. Its size
    is taken from its own and all others' residuals, in proportion to its rows and `SHARED`. Stretches that do not
    tell all of `estimated` keep the errors they have.
    """
    errors = [{name: e.std for name, e in s.estimates.items() if e.std is not None} for s in solutions]
    full = [k for k, e in enumerate(errors) if len(e) == len(estimated)]
    if not full:
        return errors
    free = [PARAMETERS.index(name) for name in PARAMETERS if name in estimated]
    S0 = np.array([rings[k].lag0 for k in full])  # (stretches, 2 axes, 6, 6)
    S1 = np.array([rings[k].lag1 for k in full])
    c = np.array([_coefficients(solutions[k]) for k in full])
    rows, pairs = (np.array([[getattr(rings[k], n)] for k in full], np.float64) for n in ("rows", "pairs"))
    squares, products = (np.einsum("ki,kaij,kj->ka", c, S, c) for S in (S0, S1))
    freedom = rows - 0.5 * len(free)
    gamma0 = np.sum(squares, axis=0) / np.sum(freedom)  # V2, by axis
    gamma1 = np.sum(products, axis=0) / max(2.0 * np.sum(pairs), 1.0) * np.sum(rows) / np.sum(freedom)
    rho = np.clip(gamma1 / np.maximum(gamma0, 1e-300), -0.5, 0.5)
    gamma0 = (squares + SHARED * gamma0) / (freedom + SHARED)
    meat = np.einsum("ka,kaij->kij", gamma0, S0) + np.einsum("ka,kaij->kij", gamma0 * rho, S1)
    G = S0.sum(axis=1)
    at = np.ix_(free, free)
    for k, g, middle in zip(full, G, meat, strict=True):
        inverse = np.array(np.linalg.inv(g[at]), np.float64)
        variance = np.diag(inverse @ middle[at] @ inverse)
        errors[k] = {PARAMETERS[j]: math.sqrt(max(v, 0.0)) for j, v in zip(free, variance.tolist(), strict=True)}
    return errors


def _coefficients(solution: Solution) -> list[float]:
    """Of a regression row (R_s, L_d, L_q, psi_f, h, u), so that their product is minus its residual."""
    R_s, L_d, L_q, psi_f = (solution.estimates[name].value or 0.0 for name in PARAMETERS)
    return [R_s, L_d, L_q, psi_f, -R_s * psi_f / L_d if L_d > 0.0 else 0.0, -1.0]


def _stretches(
    name: str, solutions: Sequence[Solution], errors: Sequence[Mapping[str, float]], cuts: Sequence[int]
) -> Stretches:
    """What each stretch says of a parameter, without those that do not tell it."""
    found: list[tuple[float, float, float, float]] = []
    for solution, std, start, end in zip(solutions, errors, cuts, [0, *cuts[:-1]], strict=True):
        e = solution.estimates[name]
        if e.status is Status.OK and e.value is not None and std.get(name, 0.0) > 0.0:
            found.append((e.value, std[name], float(start), float(end)))
    return Stretches(*np.array(found).reshape(-1, 4).T)


def _precision(told: Stretches) -> float:
    return float(np.sum(told.std**-2.0))
