"""Held out: how well a fit follows stretches that took no part in it, and whether its effects help there."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Vector
from estimator.diagnosis.answer.pictures import traces
from estimator.diagnosis.answer.quality import fit_quality, floor_of_means
from estimator.diagnosis.likelihood.columns import STRETCHES
from estimator.diagnosis.likelihood.evidence import Search
from estimator.diagnosis.search.fitting import Fitted, moved
from estimator.diagnosis.verdict import Fit, Traces
from estimator.physics.rows import Rows
from estimator.twin.currents import free_run
from estimator.twin.model import residual

_HELPS: Final = 0.98  # of a free-running error without any effect, that effects leave at most
_RISES: Final = 1.01  # times the same: more than chance
_BORNE_OUT: Final = 0.5  # of what effects explain, that they have to explain of stretches left out
_NO_MODEL: Final = 3.0  # times the same: no model of the machine


def shown_held_out(rows: Rows, found: Fitted, left: Vector, plain: Search) -> tuple[Fit, Traces]:
    """How well the model follows, by what every other stretch makes of it, and pictures of it.

    Parameters and sizes are solved on half of the stretches; which effects there are and their shapes, on all.
    """
    before, after = (Search(replace(s.regression, gram=s.regression.gram[0::2])) for s in (plain, found.search))
    by_half = moved(before, ()), moved(after, found.choice, shaped=True)
    runs = free_run(rows, by_half[0]), free_run(rows, by_half[1])
    fit = fit_quality(rows, *by_half, runs, odd_stretches(len(rows)), found.noise)

    def floor(periods: int) -> float:
        return floor_of_means(rows, by_half[1], found.noise, periods)

    return fit, traces(rows, residual(rows, rows, moved(plain, ())), left, *runs, floor)


def no_help(found: Fitted, fit: Fit) -> bool:
    """Neither error falls on stretches left out. That of one step alone says little: its volts rise with inductance.

    A small effect makes a small difference: there the errors over their noise have the word, unless the other rises.
    Where the free-running error grows by far, the model is none of the machine.
    """
    step, run = fit.one_step_rms_V, fit.free_run_rms_A
    if run.after > _NO_MODEL * run.before:
        return True
    if step.after <= step.before or run.after <= _HELPS * run.before:
        return False
    return run.after > _RISES * run.before or found.search.borne_out(found.choice) < _BORNE_OUT


def odd_stretches(n: int) -> NDArray[np.bool_]:
    """Of n periods: those of every second stretch, which take no part in a fit."""
    edges = np.linspace(0, n, STRETCHES + 1).astype(int)
    held = np.zeros(n, np.bool_)
    for a, b in zip(edges[1:-1:2], edges[2::2], strict=True):
        held[a:b] = True
    return held
