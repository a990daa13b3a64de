"""The rotor's movement within an encoder's count: what torque and order of the turn say of it.

A mean over some periods rids an angle of its rounding, and of what the rotor does meanwhile. Lost movement would look
like what currents do, or like harmonics of the magnets' flux: it goes by the same torque, has the same orders. What is
known of it is kept. Knows nothing of recordings.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from estimator.flux_balance import TURN
from estimator.kernel import kernel

Real = NDArray[np.float64]
Vector = NDArray[np.complex128]

_BEND: Final = 32  # periods to either side, over which torque bends a movement
_HELD: Final = 40  # times that many periods: fewer say nothing of a shaft
_KNOWN: Final = 3  # moves: torque, friction, and one in proportion to speed
_PUSHED: Final = 5.0  # standard deviations, by which torque is seen to move it
_ORDERS: Final = 24  # of the electrical turn, at which a rotor may swing: cogging, ripple of the torque
_PARTS: Final = 48
_PLAIN: Final = 6.0  # times what is expected by chance: no part counts for more
_OFTEN: Final = 1.8  # the same, on the mean of all parts
_ALWAYS: Final = 16.0  # the same, over the whole
_TURNS: Final = 128  # periods to either side, within which a turn is too fast for a mean
_ROBUST: Final = 3  # fits, each without what is far off the one before
_FAR: Final = 3.0  # times what half of the values are off at most
_COURSE: Final = 256  # periods to either side, over which a swing is alike
_ANEW: Final = 1024  # values, after which a sum begins anew: it keeps its digits


def driven(theta: Real, torques: Sequence[Real], ends: Sequence[int]) -> Real:
    """What torque and friction make of a movement (rad); zero where the shaft is held: nothing of it goes by them.

    J d(omega)/dt = torque - C sign(omega) - B omega - load, its inertia and frictions by least squares of how the
    movement bends over some periods. What is even in time is no matter: a mean follows it. Of several torques the first
    is known but for the inertia, and others count where they are seen beside it.
    """
    n, none = len(theta), np.zeros(len(theta))
    if n < _HELD * _BEND:
        return none
    omega = cast(Real, np.gradient(_mean(theta, _BEND)))
    moves = [_twice_summed(x) for x in (torques[0], np.sign(omega), omega, *torques[1:])]

    def bend(x: Real) -> Real:
        mean = _mean(x, _BEND // 2)
        return (mean[2 * _BEND :] - 2.0 * mean[_BEND:-_BEND] + mean[: -2 * _BEND])[inner]

    whole = np.ones(n, np.bool_)
    for end in ends:
        whole[max(end - 2 * _BEND, 0) : end + 2 * _BEND] = False
    inner = whole[_BEND:-_BEND]
    bends = [bend(x) for x in moves]
    size = [float(np.sqrt(np.mean(x**2))) for x in bends]
    if not size[0] > 0.0 or np.sum(inner) < _HELD * _BEND:
        return none
    seen = bend(theta)
    there = [k for k in range(_KNOWN) if size[k] > 0.0]
    found, sure = _coefficients([bends[k] / size[k] for k in there], seen)
    if sure[0] < _PUSHED:
        return none
    for k in (k for k in range(_KNOWN, len(moves)) if size[k] > 0.0):
        more = [*there, k]
        other, sure = _coefficients([bends[j] / size[j] for j in more], seen)
        if abs(sure[-1]) > _PUSHED:
            there, found = more, other
    return cast(Real, sum(found[j] / size[k] * moves[k] for j, k in enumerate(there)))


def _coefficients(columns: Sequence[Real], seen: Real) -> tuple[Real, Real]:
    """Of columns, that make what is seen, by least squares; and in standard errors of bends."""
    A = np.array(columns)
    inverse = np.linalg.pinv(A @ A.T)
    found = inverse @ (A @ seen)
    left = float(np.mean((seen - found @ A) ** 2)) * 3.0 * _BEND  # neighbours share periods
    return found, found / np.sqrt(np.maximum(left * np.diag(inverse), 1e-300))


def by_torque(off: Real, torques: Sequence[Real], widths: NDArray[np.intp], step: float) -> Real:
    """Of what a smooth angle leaves off (rad): the rotor's own movement by torques, if more than rounding.

    What a mean loses of a torque's first and second integral, and, where a shaft bends, of the torque itself.
    """
    moves = [(_twice_summed(x), np.cumsum(x - np.mean(x)), x) for x in torques]
    return _lost(off, [x for some in moves for x in some], widths, step)


class Swings(NamedTuple):
    """What an encoder may swing by, once and twice in a mechanical turn (rad): cosines and sines, (4, n)."""

    whole: Real
    fast: Real  # what of it is too fast for a mean


def swings_of(theta_m: Real) -> Swings:
    """By the mechanical angle (rad)."""
    turn = cast(Vector, np.exp(1j * theta_m))
    whole = np.array((turn.real, turn.imag, (turn * turn).real, (turn * turn).imag))
    return Swings(whole, np.array([_fast(x) for x in whole]))


def turned(course: Real, swings: Swings, step: float) -> Real:
    """What of an angle's course (rad) goes by the mechanical turn, once or twice; zero where that is mere rounding.

    An eccentric encoder's error is the same in each turn. Where it is many counts, no long mean would follow it.
    """
    seen = _fast(course)
    size = np.maximum(np.sqrt(np.mean(swings.fast**2, axis=1)), 1e-300)
    fast = swings.fast / size[:, None]
    found, calm = np.zeros(len(fast)), np.ones(len(course), np.bool_)
    for _ in range(_ROBUST):
        found, _ = _coefficients(list(fast[:, calm]), seen[calm])
        off = np.abs(seen - found @ fast)
        calm = off < max(step, _FAR * float(np.median(off)))  # where speed changes suddenly it is not
    told = found @ fast[:, calm]
    return (found / size) @ swings.whole if float(told @ told) > _ALWAYS * step**2 / 12.0 else np.zeros(len(course))


def _fast(x: Real) -> Real:
    """What a long mean loses."""
    return x - smooth(x, min(_TURNS, (len(x) - 1) // 4))


def _lost(off: Real, moves: Sequence[Real], widths: NDArray[np.intp], step: float) -> Real:
    """Of what means of some widths leave off: what they lose of moves, each of any size."""
    found = np.zeros(len(off))
    for w in np.unique(widths[widths > 0]).tolist():
        there = widths == w
        lost = np.array([(x - smooth(x, w))[there] for x in moves])
        lost /= np.maximum(np.sqrt(np.mean(lost**2, axis=1)), 1e-300)[:, None]
        fitted = cast(Real, np.linalg.pinv(lost @ lost.T) @ (lost @ off[there]) @ lost)
        if float(fitted @ fitted) > _ALWAYS * step**2 / 12.0:
            found[there] = fitted
    return found


def at_orders(off: Real, theta: Real, widths: NDArray[np.intp], step: float) -> Real:
    """Of what a smooth angle leaves off (rad): the rotor's own swing at orders of the turn, if more than rounding.

    A mean's window is longer than these are, and effects have the same orders.
    """
    swing, w = np.zeros(len(off)), min(_COURSE, (len(off) - 1) // 4)
    if len(off) < _PARTS:
        return swing
    by_period, once = np.abs(cast(Real, np.gradient(theta))), cast(Vector, np.exp(1j * theta))
    turn = once.copy()
    for order in range(1, _ORDERS + 1):
        fast = order * by_period * w > TURN  # slower ones a mean does not lose
        seen = np.where(fast, off - swing, 0.0) * turn.conj()
        parts = np.array([np.sum(part) / math.sqrt(len(part)) for part in np.array_split(seen, _PARTS)])
        chance = step**2 / 12.0  # mean square of each, by rounding alone
        often = float(np.mean(np.minimum(np.abs(parts) ** 2 / chance, _PLAIN)))
        if often > _OFTEN or abs(np.sum(seen)) ** 2 > _ALWAYS * chance * len(off):
            a, b = (_held(_mean(x.copy(), w), w) for x in (seen.real, seen.imag))
            swing += np.where(fast, 2.0 * (a * turn.real - b * turn.imag), 0.0)
        turn *= once
    return np.where(widths > 0, swing, 0.0)  # where no mean was taken nothing is lost


def _twice_summed(x: Real) -> Real:
    """What bends by x from value to value, but for its mean."""
    return np.concatenate((np.zeros(1), np.cumsum(np.cumsum(x - np.mean(x)))[:-1]))


def smooth(x: Real, w: int) -> Real:
    """Twice the moving mean less its own mean: that lies twice as far inside of a curve."""
    inside = _mean(x, w)
    return 2.0 * inside - _mean(inside, w)


def _held(mean: Real, w: int) -> Real:
    """A moving mean, near the ends as it is where it first is one."""
    mean[:w], mean[len(mean) - w :] = mean[w], mean[len(mean) - w - 1]
    return mean


@kernel
def _mean(x: Real, w: int) -> Real:
    """Moving mean over 2 w + 1 values; as it is at the ends."""
    out, n = x.copy(), len(x)
    for begin in range(w, n - w, _ANEW):
        base, total = x[begin], 0.0
        for k in range(begin - w, begin + w + 1):
            total += x[k] - base
        for k in range(begin, min(begin + _ANEW, n - w)):
            out[k] = base + total / (2 * w + 1)
            if k + w + 1 < n:
                total += x[k + w + 1] - x[k - w]
    return out
