"""A window chosen by the data, for each parameter by itself, at every estimate anew and at bounded cost.

A long window averages noise away, and lags by half its length behind a parameter that moves. How much of the past
still belongs to the present is a question to the data: the longest window is cut into at most `RINGS` consecutive
stretches, the older the longer, and every stretch gives its own estimate of the parameter with its own standard error.
Then every window that ends at such a cut is a hypothesis, in two forms:

    level   within the window the parameter stands still
    line    within the window it moves in a straight line, and the line's end is the present value

and what lies before the window is free. A hypothesis is judged by its misfit to the stretches in the window, in
units of their standard errors less what all of them share, and pays `PRICE` for each thing it leaves free:

    score = chi^2 + PRICE (stretches left out of the window + 1 for a line)

The estimate is the mean of all hypotheses, weighted by exp(-score / (2 WARMTH)). Its standard error takes in how far
the hypotheses that remain are apart, which is what is left of the lag, and a tenth of the way from the longest window:
where the parameter's line bends faster than a few stretches can tell, the hypotheses do not show it.

The constants were chosen on emulated runs of seeds 1 to 20; what is reported and tested are seeds from 201 on.

Choosing among windows by whether they agree is from A. Goldenshluger, A. Nemirovski, On spatially adaptive
estimation of nonparametric regression, Mathematical Methods of Statistics 6, 1997; to average by exponential weights
instead of picking one is S. T. Buckland, K. P. Burnham, N. H. Augustin, Model selection: an integral part of inference,
Biometrics 53, 1997, doi 10.2307/2533961. Knows nothing of streams beyond `window_ls`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, UNITS
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.online.fit import PRIOR_SHARE, fit_windows
from estimator.online.solve import check_held, plausible, solution_of
from estimator.online.window_ls import WindowState, sums_of, waiting

RINGS: Final = 12
SHORTEST_ROWS: Final = 16  # regression rows per axis of the newest stretch, and of any other at least
PRICE: Final = 10.0  # a line or a cut must improve chi^2 by about this: 3 standard errors
WARMTH: Final = 1.5
LAG_DOUBT: Final = 0.1  # of what lies between present value and longest window: the lag that no hypothesis shows
WARMTH_OF_DOUBT: Final = 3.0  # of the standard error: it hears hypotheses that the value no longer does


@dataclass(frozen=True, slots=True, eq=False)
class StretchEstimates:
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
    cuts = lengths_of(state.samples, state.m, waiting(state))
    rings = sums_of(state, cuts, [0, *cuts[:-1]])
    sums = sums_of(state, [state.length])
    whole = fit_windows(sums, estimated, held)
    said = solution_of(sums, whole, held)
    found = fit_windows(rings, estimated, held, together=True)
    ends = np.array([0, *cuts[:-1]], np.float64)
    estimates: dict[str, Estimate] = {}
    for j, name in enumerate(PARAMETERS):
        estimates[name] = alone = said.estimates[name]
        if name not in estimated:
            continue
        estimates[name] = replace(alone, window=cuts[-1])
        tells = found.told[:, j] & (found.lasting[:, j] < np.minimum(PRIOR_SHARE * found.beta[:, j], found.std[:, j]))
        if not tells.any():
            continue
        shared = float(found.lasting[tells, j].min())
        std = np.sqrt(found.std[tells, j] ** 2 - shared**2)
        told = StretchEstimates(found.beta[tells, j], std, np.array(cuts, np.float64)[tells], ends[tells])
        if alone.std is not None and float(np.sum(told.std**-2.0)) < 0.5 / alone.std**2:
            continue  # the stretches, each by itself, miss what they tell together
        value, error, length = weighed(told, alone.value)
        moved = LAG_DOUBT * (value - float(whole.beta[0, j])) if alone.std is not None else 0.0
        error = math.hypot(error, moved, max(shared, float(whole.lasting[0, j])))
        if Z_95 * error < value:
            estimates[name] = Estimate(name, value, error, UNITS[name], Status.OK, window=length)
    return WindowEstimate(
        estimates, state.samples, state.gaps, sums.axes * int(sums.rows[0]), state.samples == state.length,
        said.condition, said.residual_rms, state.left_out, said.combinations,
        tuple(name for name, e in estimates.items() if name in said.impossible or (
            e.status is Status.OK and e.value is not None and not plausible(PARAMETERS.index(name), e.value)
        )),
    )


def lengths_of(samples: int, m: int, waiting: int = 0) -> list[int]:
    """Window lengths to choose from, ascending: by factors of about sqrt(2) or more, at most `RINGS` of them.

    All but the last are whole groups of m after the `waiting` newest, so that an unbroken stream is cut between groups.
    """
    shortest = SHORTEST_ROWS * m
    ratio = max(math.sqrt(2.0), (max(samples, 1) / shortest) ** (1.0 / (RINGS - 1)))
    lengths: list[int] = []
    length = shortest
    while samples - waiting - length >= shortest and len(lengths) < RINGS - 1:
        lengths.append(waiting + length)
        length = m * math.ceil(max(length * ratio, length + shortest) / m)
    return [*lengths, samples]


def weighed(told: StretchEstimates, together: float | None = None) -> tuple[float, float, int]:
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
    value = float(_score_weights(score, WARMTH) @ values)
    variance = float(_score_weights(score, WARMTH_OF_DOUBT) @ (variances + (values - value) ** 2))
    reach = np.concatenate((told.start, told.start[1:]))
    return about + value, math.sqrt(variance), int(reach[np.argmin(score)])


def _score_weights(score: Array, warmth: float) -> Array:
    weight = np.exp(-0.5 / warmth * (score - score.min()))
    return weight / weight.sum()
