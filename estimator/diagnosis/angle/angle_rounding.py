"""The angle's rounding: what an encoder's counts leave between the recorded angle and one that turns smoothly.

A rotor has inertia, so what of its angle is gone after some periods is no movement. Currents and voltages of the
stationary frame are right whatever angle they were turned by, as long as they are turned back by the same one: so
recordings can be rid of it. A drive turns them by its encoder's counts, and may record the angle in coarser numbers:
then they are turned back by a share of the rounding only, that of the counts in the variance of both. Knows nothing of
effects.
"""

import math
from collections.abc import Sequence
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.angle.rotor_movement import turning
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows

_TWICE_ROUNDED: Final = 2.24  # resolutions, by which two roundings may differ from one period to the next
_ANGLE_DIGITS: Final = 7  # of an angle, that tell values apart
_FINEST: Final = 2e-6  # rad: a finer step does not matter
_COMPARED_STEPS: Final = 10.0  # steps, over which they are compared
_ON_GRID: Final = 0.1  # steps, by which multiples of one may be off
_QUIET_ROUNDING: Final = 0.2  # of the currents' noise: rounding that is quieter stays
_BY_COUNTS: Final = 0.5  # share of the rounding, from which on it is mostly that of counts
_FINER: Final = 0.7  # of a step: counts of one that is less hold coarser ones
_SAME_GRID: Final = 0.02  # of a step, by which two grids may be apart
_STANDING_STEPS: Final = 1e-3  # steps in a period
_BEAT: Final = 0.3  # share of the rounding's energy, from which on it looks like movement
_AT_MOST: Final = 2.5  # times the energy that is told


def unrounded(rows: Rows, step: float) -> Rows:
    """The rows with an angle that turns smoothly. `step`: the angle's resolution as told, rad; 0 where not known.

    Where the currents' noise is louder, rounding is a part of it: what a rotor does in a few periods is kept then - but
    where numbers coarser than counts turn voltages, too, which adds up over periods.
    """
    step = _resolution(rows, step)
    at, course, ends = _samples_by_clock(rows)
    torques = [np.interp(np.arange(len(course)), at, torque) for torque in _torques(rows)]
    off, variance = (x[at] for x in _rounding_left(course, torques, ends, _reach(rows, step), rows.machine.n_p))
    # What stands is off by as much all the time
    turns = np.abs(np.gradient(rows.theta_e - off)) > _STANDING_STEPS * step
    error = math.sqrt(float(np.mean(variance[turns]))) if turns.any() else 0.0
    rows = rows.changed(angle_step=step, angle_error=math.hypot(error, rows.angle_error))
    quiet = rows.machine.psi_f * step < _QUIET_ROUNDING * math.sqrt(12.0) * _loudness(rows)
    return rows.changed(rounding=off) if quiet and rows.angle_turned > _BY_COUNTS else less_angle(rows, off)


def less_angle(rows: Rows, off: Array) -> Rows:
    """The rows with an angle that is `off` (rad, at samples) less, turned back by what the drive had turned them by."""
    theta_e, by = rows.theta_e - off, rows.angle_turned * off
    middle = np.exp(0.5j * (by[1:] + by[:-1]))
    return rows.turned(
        middle, theta_e=theta_e, half=np.exp(0.5j * np.diff(theta_e)), i=rows.i * np.exp(1j * by), u=rows.u * middle,
        turned_by=rows.turned_by + by,
    )  # fmt: skip


def resolution_of(rows: Rows, told: float) -> float:
    """The angle's resolution (rad): as told, or the step by multiples of which it moves; 0 where it moves by any."""
    return told if told > 0.0 else grid_of(rows.D[rows.joined])


def grid_of(moves: Array) -> float:
    """The step (rad) of whose multiples all movements are; 0 where there is none."""
    apart = np.diff(np.unique(np.round(np.abs(moves), _ANGLE_DIGITS)))
    if len(apart) == 0 or float(np.min(apart)) < _FINEST:
        return 0.0
    near = apart[apart < _COMPARED_STEPS * np.min(apart)]
    counts = np.rint(near / np.min(apart))
    step = float(np.sum(near) / np.sum(counts))
    return step if bool(np.all(np.abs(near / step - counts) < _ON_GRID)) else 0.0


def _loudness(rows: Rows) -> float:
    """White noise of the currents as a flux linkage (Vs), on the axis where it is less."""
    m = rows.machine
    fast = m.L_d * np.diff(rows.i.real, 4), m.L_q * np.diff(rows.i.imag, 4)  # noise grows by sqrt(70), signals do not
    return min((float(np.median(np.abs(x))) / 0.6744898 / math.sqrt(70.0) for x in fast if len(x)), default=0.0)


def beat_of(rows: Rows) -> float:
    """Angle (rad, rms) that rounding leaves for so long that it looks like movement; zero where it averages out."""
    return rows.angle_error if rows.angle_error**2 > _BEAT * rows.angle_step**2 / 12.0 else 0.0


def hidden_energy(rows: Rows) -> float:
    """What rounding may leave in the flux error (Vs^2, summed over periods): it cannot be told from movement."""
    return _AT_MOST * left_energy(rows)


def left_energy(rows: Rows) -> float:
    """What is left of the rounding in the flux error (Vs^2, summed over periods)."""
    return _energy_of(rows, rows.angle_error**2)


def beat_energy(rows: Rows) -> float:
    """What is left of the rounding in the flux error, where it looks like movement; otherwise none."""
    return _energy_of(rows, beat_of(rows) ** 2)


def _energy_of(rows: Rows, square: float) -> float:
    """Of the flux error by an angle error of a mean square (rad^2)."""
    m, i = rows.machine, rows.i
    saliency = m.L_d - m.L_q  # per angle: j psi_f + saliency (i_q + j i_d), Vs/rad
    by_magnets = m.psi_f * (len(i) * m.psi_f + 2.0 * saliency * float(np.sum(i.real)))
    return (by_magnets + saliency**2 * float(np.vdot(i, i).real)) * square


def _resolution(rows: Rows, told: float) -> float:
    """The angle's resolution (rad): as told, or, where that is finer than what shows, as it shows.

    A period turns by a step more than the one before and the one after, or less; by up to sqrt(5) resolutions where
    a number with a step of its own holds the counts. Movement changes by less, in three periods.
    """
    together = rows.joined[2:] & rows.joined[1:-1] & rows.joined[:-2]
    more = 0.5 * np.abs(np.diff(rows.D, 2))[together]
    shown = float(np.quantile(more, 0.99)) if len(more) else 0.0
    return told if shown <= _TWICE_ROUNDED * told else shown


def _samples_by_clock(rows: Rows) -> tuple[NDArray[np.intp], Array, list[int]]:
    """Place of each sample among equal steps of time, the angle (rad) at these, and where runs begin and end.

    Over a few samples that are not there, the angle goes on.
    """
    apart, long, D = rows.apart, rows.pauses, rows.D.copy()
    lost, whole = np.flatnonzero(~rows.joined & ~long), np.flatnonzero(rows.joined)
    if len(lost) and len(whole):
        speed = np.interp(lost, whole, D[whole])
        D[lost] += TURN * np.rint((apart[lost] * speed - D[lost]) / TURN)
    at = np.concatenate((np.zeros(1, np.intp), np.cumsum(np.where(long, 1, apart))))
    theta = rows.theta_e[0] + np.concatenate((np.zeros(1), np.cumsum(D)))
    n = int(at[-1]) + 1
    course = cast(Array, np.interp(np.arange(n), at, theta))
    return at, course, [0, *at[1:][long].tolist(), n]


def _torques(rows: Rows) -> tuple[Array, Array]:
    """Of the currents at samples, a pole pair, over 1.5, Vs A: by the nominal machine, and what of it goes by i_d i_q:
    nominal inductances do not tell how far L_d and L_q are apart.
    """
    m, i = rows.machine, rows.i
    both = i.real * i.imag
    return m.psi_f * i.imag + (m.L_d - m.L_q) * both, m.L_q * both


def counts_and_numbers(rows: Rows, step: float) -> tuple[float, float]:
    """Steps (rad) of counts, and of the numbers that hold them: a resolution is the root of both squares."""
    finest = resolution_of(rows, 0.0) if rows.angle_turned == 1.0 else 0.0
    by_counts = math.sqrt(step**2 - finest**2) if 0.0 < finest < _FINER * step else step * math.sqrt(rows.angle_turned)
    return by_counts, math.sqrt(max(step**2 - by_counts**2, 0.0))


def _reach(rows: Rows, step: float) -> float:
    """How far (rad) a count may be off to either side: half of it; of both, where numbers do not hold counts."""
    by_counts, by_numbers = counts_and_numbers(rows, step)
    if by_numbers == 0.0:
        return 0.5 * by_counts
    held = by_counts > by_numbers and abs(math.remainder(by_counts, by_numbers)) < _SAME_GRID * by_numbers
    return 0.5 * by_counts if held else 0.5 * (by_counts + by_numbers)


def _rounding_left(
    theta: Array, torques: Sequence[Array], ends: Sequence[int], reach: float, n_p: int
) -> tuple[Array, Array]:
    """Angle less the smooth one (rad), and the variance (rad^2) of what is left of the rounding."""
    if reach == 0.0:
        return np.zeros(len(theta)), np.zeros(len(theta))
    known, course = turning(theta, reach, torques, ends, n_p)
    return np.clip(theta - known - course.course, -reach, reach), course.variance
