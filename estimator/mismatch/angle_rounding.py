"""The angle's rounding: what an encoder's counts leave between the recorded angle and one that turns smoothly.

A rotor has inertia, so what of its angle is gone after some periods is no movement. Currents and voltages of the
stationary frame are right whatever angle they were turned by, as long as they are turned back by the same one: so
recordings can be rid of it. A drive turns them by its encoder's counts, and may record the angle in coarser numbers:
then they are turned back by a share of the rounding only, that of the counts in the variance of both. Knows nothing of
effects.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.flux_balance import TURN
from estimator.mismatch.rotor_movement import at_orders, by_torque, driven, smooth, swings_of, turned
from estimator.physics.rows import Real, Rows

_HALVES: Final = (4, 8, 16, 32)  # periods, of the mean on either side: as long as the rotor lets it be
_LONG: Final = (64, 128)  # the same, where no period is off by more than its rounding: it shows slow beats
_ENDS: Final = 4  # halves, that a mean needs to either side
_ENDS_AT_MOST: Final = 8  # a part of a run at either end, that may be left out
_ROUGH: Final = 2.0  # times the variance that most of the angle has
_STILL: Final = 1e-9  # rad in a period: no count
_TWICE_ROUNDED: Final = 2.24  # resolutions, by which two roundings may differ from one period to the next
_DIGITS: Final = 7  # of an angle, that tell values apart
_FINEST: Final = 2e-6  # rad: a finer step does not matter
_NEAR: Final = 10.0  # steps, over which they are compared
_ON_GRID: Final = 0.1  # steps, by which multiples of one may be off
_QUIET: Final = 0.2  # of the currents' noise: rounding that is quieter stays
_BY_COUNTS: Final = 0.5  # share of the rounding, from which on it is mostly that of counts
_TWICE: Final = 5.0 / 3.0  # times a mean's variance, of twice a mean less its own mean
_SHARP: Final = 0.25  # of a step: numbers that are coarser round an angle off by more than its counts
_FINER: Final = 0.7  # of a step: counts of one that is less hold coarser ones
_OFF: Final = 0.75  # counts, more than which no rounding is
_BEAT: Final = 0.3  # share of the rounding's energy, which looks like movement where a smooth angle holds more of it
_ALIKE: Final = 2.5  # times what a mean of independent errors leaves: those of neighbouring periods are alike
_SAME: Final = 4.0  # standard deviations, by which a mean may differ from one over half its length


def unrounded(rows: Rows, step: float) -> Rows:
    """The rows with an angle that turns smoothly. `step`: the angle's resolution as told, rad; 0 where not known.

    Where the currents' noise is louder, rounding is a part of it: what a rotor does in a few periods is kept then - but
    where numbers coarser than counts turn voltages, too, which adds up over periods. Near the ends of runs, where means
    are short or none, periods are not `joined`: rounding is louder there.
    """
    step = _step_of(rows, step)
    at, course, ends = _by_clock(rows)
    torques = [np.interp(np.arange(len(course)), at, torque) for torque in _torques(rows)]
    each = _rounding(course, torques, ends, step, _numbers(rows, step), rows.machine.n_p)
    rough, (off, variance) = _rough_ends(each[1], ends)[at], (x[at] for x in each)
    hidden = math.sqrt(_hidden(off, variance, step) * step**2 / 12.0)
    quiet = rows.machine.psi_f * step < _QUIET * math.sqrt(12.0) * _loudness(rows)
    if quiet and rows.angle_turned > _BY_COUNTS:
        return replace(rows, angle_step=step, angle_error=0.0, angle_hidden=hidden)
    return replace(
        less_angle(rows, off), joined=rows.joined & (quiet | ~(rough[1:] | rough[:-1])), angle_step=step,
        angle_error=math.sqrt(float(np.mean(variance))), angle_hidden=hidden,
    )  # fmt: skip


def less_angle(rows: Rows, off: Real) -> Rows:
    """The rows with an angle that is `off` (rad, at samples) less, turned back by what the drive had turned them by."""
    theta_e, by = rows.theta_e - off, rows.angle_turned * off
    middle = np.exp(0.5j * (by[1:] + by[:-1]))
    return replace(
        rows, theta_e=theta_e, half=np.exp(0.5j * np.diff(theta_e)), i=rows.i * np.exp(1j * by), u=rows.u * middle,
        u_turned=rows.u_turned * middle, kept=rows.pulses_turned(middle),
    )  # fmt: skip


def resolution_of(rows: Rows, told: float) -> float:
    """The angle's resolution (rad): as told, or the step by multiples of which it moves; 0 where it moves by any."""
    values = np.unique(np.round(np.abs(rows.D[rows.joined]), _DIGITS))
    apart = np.diff(values)
    if told > 0.0 or len(apart) == 0 or float(np.min(apart)) < _FINEST:
        return told
    near = apart[apart < _NEAR * np.min(apart)]
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
    return rows.angle_hidden if rows.angle_hidden**2 > _BEAT * rows.angle_step**2 / 12.0 else 0.0


def hidden_energy(rows: Rows) -> float:
    """What is left of the rounding in the flux error (Vs^2, summed over periods): it cannot be told from movement."""
    return _energy_of(rows, max(_ALIKE * rows.angle_error**2, rows.angle_hidden**2))


def lent_energy(rows: Rows) -> float:
    """What the rounding lends effects of the flux error (Vs^2, summed over periods), where it does not average out."""
    return _energy_of(rows, beat_of(rows) ** 2)


def _energy_of(rows: Rows, square: float) -> float:
    """Of the flux error by an angle error of a mean square (rad^2)."""
    m, i = rows.machine, rows.i
    saliency = m.L_d - m.L_q  # per angle: j psi_f + saliency (i_q + j i_d), Vs/rad
    by_magnets = m.psi_f * (len(i) * m.psi_f + 2.0 * saliency * float(np.sum(i.real)))
    return (by_magnets + saliency**2 * float(np.vdot(i, i).real)) * square


def _hidden(off: Real, variance: Real, step: float) -> float:
    """Share of the rounding's energy that is still in the smooth angle: turning does not average all of it out.

    A rounding error has a known size. What of it the smooth angle does not leave behind is there still; most of it
    where each period turns by nearly whole counts.
    """
    smoothed = variance < 0.5 * step**2 / 12.0
    if not smoothed.any():
        return 0.0
    return max(1.0 - 12.0 * float(np.mean(off[smoothed] ** 2)) / step**2, 0.0)


def _step_of(rows: Rows, told: float) -> float:
    """The angle's resolution (rad): as told, or, where that is finer than what shows, as it shows.

    A period turns by a step more than the one before and the one after, or less; by up to sqrt(5) resolutions where
    a number with a step of its own holds the counts. Movement changes by less, in three periods.
    """
    together = rows.joined[2:] & rows.joined[1:-1] & rows.joined[:-2]
    more = 0.5 * np.abs(np.diff(rows.D, 2))[together]
    shown = float(np.quantile(more, 0.99)) if len(more) else 0.0
    return told if shown <= _TWICE_ROUNDED * told else shown


def _by_clock(rows: Rows) -> tuple[NDArray[np.intp], Real, list[int]]:
    """Place of each sample among equal steps of time, the angle (rad) at these, and where runs begin and end.

    Over a few samples that are not there, the angle goes on.
    """
    apart, long, D = rows.apart, rows.pauses, rows.D.copy()
    for k in np.flatnonzero(~rows.joined & ~long):
        speed = 0.5 * (D[max(k - 1, 0)] + D[min(k + 1, len(D) - 1)])
        D[k] += TURN * round((apart[k] * speed - D[k]) / TURN)
    at = np.concatenate((np.zeros(1, np.intp), np.cumsum(np.where(long, 1, apart))))
    theta = rows.theta_e[0] + np.concatenate((np.zeros(1), np.cumsum(D)))
    n = int(at[-1]) + 1
    course = cast(Real, np.interp(np.arange(n), at, theta))
    return at, course, [0, *at[1:][long].tolist(), n]


def _torques(rows: Rows) -> tuple[Real, Real]:
    """Of the currents at samples, a pole pair, over 1.5, Vs A: by the nominal machine, and what of it goes by i_d i_q:
    nominal inductances do not tell how far L_d and L_q are apart.
    """
    m, i = rows.machine, rows.i
    both = i.real * i.imag
    return m.psi_f * i.imag + (m.L_d - m.L_q) * both, m.L_q * both


def _numbers(rows: Rows, step: float) -> float:
    """Step (rad) of numbers that hold coarser counts; 0 where these are not rounded once more."""
    finest = resolution_of(rows, 0.0)
    return finest if finest < _FINER * step else 0.0


def _rounding(
    theta: Real, torques: Sequence[Real], ends: Sequence[int], step: float, finer: float, n_p: int
) -> tuple[Real, Real]:
    """Angle less the smooth one (rad), and the variance (rad^2) of what is left of the rounding.

    Zero near the ends of runs, and where the rotor's movement is not smooth. What torques make of it need not be:
    what a mean lost of that would look like what currents do. What goes by i_d i_q is asked of a free shaft alone: on
    one that is held, more torques take more of the rounding for movement. `finer`: numbers' step, that holds counts.
    """
    n = len(theta)
    off, variance = np.zeros(n), np.full(n, step**2 / 12.0)
    moved = np.flatnonzero(np.abs(np.diff(theta)) > _STILL)
    if step == 0.0 or len(moved) < 2:
        return off, variance
    # Where it moves on, it is between two counts
    x = np.interp(np.arange(n), moved + 0.5, 0.5 * (theta[moved] + theta[moved + 1]))
    swings, widths = swings_of(x / n_p), np.zeros(n, np.intp)
    pushed = driven(x - turned(x, swings, step), torques, ends)
    known = pushed + turned(x - pushed, swings, step)
    theta, x = theta - known, x - known
    shorter: Real | None = None
    for w in (*_HALVES, *(_LONG if finer < _SHARP * step else ())):
        if n < 6 * w:
            break
        mean = smooth(x, w)
        uncertain = _SAME * step / math.sqrt(12.0 * 2.0 * w)
        wrong = np.abs(theta - mean) > (_OFF * step if w in _HALVES else 0.5 * (step + finer) + uncertain)
        if shorter is not None and w in _HALVES:
            wrong |= np.abs(mean - shorter) > uncertain
        right = _around(wrong, w) == 0
        for end in ends:
            right[max(end - _ENDS * w, 0) : end + _ENDS * w] = False
        off[right], variance[right], widths[right] = (theta - mean)[right], _TWICE * step**2 / 12.0 / (2 * w + 1), w
        shorter = mean
    off -= by_torque(off, torques if pushed.any() else torques[:1], widths, step)
    return off - at_orders(off, theta - off + known, widths, step), variance


def _rough_ends(variance: Real, ends: Sequence[int]) -> NDArray[np.bool_]:
    """Near the ends of runs, what keeps far more of the rounding than most does."""
    rough = np.zeros(len(variance), np.bool_)
    more = variance > _ROUGH * np.median(variance)
    for begin, end in pairwise(ends):
        most = (end - begin) // _ENDS_AT_MOST
        for near in (slice(begin, begin + most), slice(end - most, end)):
            rough[near] = more[near]
    return rough


def _around(x: NDArray[np.bool_], w: int) -> NDArray[np.intp]:
    """How many are true within w places."""
    total, at = np.concatenate((np.zeros(1, np.intp), np.cumsum(x))), np.arange(len(x))
    return total[np.minimum(at + w + 1, len(x))] - total[np.maximum(at - w, 0)]
