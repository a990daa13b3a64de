"""The moment and the duration of a step of the magnets' flux, in the rows around it.

A regression over all rows does not find the moment: what a step explains is no line of its time.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.averages import energy_of
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.physics import magnet_flux_step
from estimator.physics.rows import Rows
from estimator.twin.model import Model, residual

_NAME: Final = magnet_flux_step.EFFECT.name
_PERIODS_AROUND: Final = (200, 600)  # periods before and after a step, besides its duration, that tell its course
_STEP_ROUNDS: Final = 12
_SAME_MOMENT: Final = 1e-4  # periods
_DURATION: Final = next(p for p in magnet_flux_step.EFFECT.parameters if p.name == "duration")


def with_step_in_place(rows: Rows, smooth: Rows, model: Model) -> Model:
    """The model with its step of the magnets' flux where it leaves least: at the best sample, and around that."""
    if _NAME not in model.effects:
        return model
    rows, smooth = rows.with_machine(model.machine), smooth.with_machine(model.machine)
    change, at, duration = model.effects[_NAME]
    by = filter_of(rows, model.machine)
    z = whitened(residual(rows, smooth, model), by)
    flux = whitened(smooth.balance(np.full(len(rows) + 1, change * model.machine.psi_f)), by)
    k = int(np.searchsorted(rows.t, rows.span[0] + at * rows.span[1]))
    k = max(k, 1)  # the first sample after the step, whose flux error is z[k - 1]
    later = np.cumsum(_more(z[k - 1 :], flux[k - 1 :]))
    sooner = np.cumsum(_more(z[: k - 1], -flux[: k - 1])[::-1])
    best_later, best_sooner = _least_course(later), _least_course(sooner)
    if min(best_later[1], best_sooner[1]) < 0.0:
        place = k + best_later[0] + 1 if best_later[1] < best_sooner[1] else k - best_sooner[0] - 1
        time = float((rows.t[min(max(place, 1), len(rows))] - 0.5 * rows.T_s - rows.span[0]) / rows.span[1])
        model = _with_step(model, change, time, duration)
        z = whitened(residual(rows, smooth, model), by)
    return _settled_step(smooth, z, model)


def _with_step(model: Model, change: float, at: float, duration: float) -> Model:
    return replace(model, effects={**model.effects, _NAME: (change, min(max(at, 0.01), 0.99), duration)})


def _settled_step(rows: Rows, z: Vector, model: Model) -> Model:
    """The model with the moment and the duration that leave least of z around it, by Gauss's and Newton's method."""
    change, at, duration = model.effects[_NAME]
    T_s, (start, length) = rows.T_s, rows.span
    k, wide = int(np.searchsorted(rows.t, start + at * length)), round(duration / T_s)
    part = slice(max(k - _PERIODS_AROUND[0] - wide, 0), min(k + _PERIODS_AROUND[1] + wide, len(rows)))
    around = rows[part]
    by = filter_of(around, model.machine)

    def made(x: Array) -> Vector:
        """A, by the moment and the duration in periods."""
        v = magnet_flux_step.EFFECT.voltage(around, (change, x[0] * T_s / length, x[1] * T_s))
        return _step_current(whitened(v, by), model)

    x = np.array([at * length, duration]) / T_s
    low, high = (limit(rows) / T_s for limit in (_DURATION.low, _DURATION.high) if limit is not None)
    there = _step_current(z[part], model) + made(x)
    for _ in range(_STEP_ROUNDS):
        left, least = there - made(x), energy_of(there - made(x))
        slopes = np.array([made(x + step) - made(x - step) for step in 0.5 * np.eye(2)])
        move = np.linalg.lstsq((slopes @ slopes.conj().T).real, (slopes.conj() @ left).real, rcond=1e-9)[0]
        tried = (x + move * 0.5**n for n in range(_STEP_ROUNDS))
        clipped = (np.array([time, min(max(wide, low), high)]) for time, wide in tried)
        better = next((y for y in clipped if energy_of(there - made(y)) < least), None)
        if better is None or np.max(np.abs(better - x)) < _SAME_MOMENT:
            break
        x = better
    return _with_step(model, change, float(x[0] * T_s / length), float(x[1] * T_s))


def _step_current(z: Vector, model: Model) -> Vector:
    return z.real / model.machine.L_d + 1j * (z.imag / model.machine.L_q)


def _more(z: Vector, added: Vector) -> Array:
    return np.abs(z + added) ** 2 - np.abs(z) ** 2


def _least_course(course: Array) -> tuple[int, float]:
    if len(course) == 0:
        return 0, 0.0
    place = int(np.argmin(course))
    return place, float(course[place])
