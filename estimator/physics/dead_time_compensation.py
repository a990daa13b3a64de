"""What a drive adds to its legs' voltages for the dead time's sake, and does not record.

    u_k acting = u_k recorded + time / T_s u_dc sat(i_k / width)        sat(x) = x within -1 to 1, its sign beyond

i_k is the sample that the voltage of the row was computed from, a period before it acts, turned on to where it acts, or
as it is; the row's own sample, in drives that are that quick; or the commanded current, as which that of the motor
counts, averaged. A sample is taken with its noise, as the drive took it: near zero its sign jumps from row to row, and
the voltage with it. That is known row by row, and tells a compensation from the loss that it is for, whose sign is that
of the current itself. The noise of a sample moves no voltage before it and is in the flux error of the period that it
ends, to which only earlier samples add here: no bias comes of it.

Where nothing jumps - little noise, a wide zone, a commanded current - only what is added less what is lost shows: more
than the legs lose is this effect, less an `inverter_voltage_error` that is smaller than it is.

S.-G. Jeong, M.-H. Park, "The analysis and compensation of dead-time effects in PWM inverters", IEEE Trans. Industrial
Electronics 38(2), 1991; J.-W. Choi, S.-K. Sul, "Inverter output voltage synthesis using novel dead time compensation",
IEEE Trans. Power Electronics 11(2), 1996.
"""

import math
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.physics.derived import Derived
from estimator.physics.effect import Parameter, Sizes, VoltageError, constant
from estimator.physics.inverter_voltage_error import bus
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES

BY_TURNED, BY_SAMPLE, BY_OWN, BY_COMMAND = range(4)
_AVERAGED: Final = 5  # samples to each side, that stand for a commanded current
_SIGN: Final = 1e-3  # of the rated current: so narrow a zone is a sign
_DOUBTFUL: Final = 3e-3  # of it: so far a drive's current may be from the one that is recorded
_COMPARED: Final = 40  # periods to each side, with which a doubtful one is compared
_FEWEST: Final = 10  # of them
_LINE: Final = 1e-2  # of what periods tell of a line, or of a jump beside it, at least
_APART: Final = 3.0  # standard deviations, by which the voltages of the two signs differ where they tell
_ASTRAY: Final = 3.5  # the same from its own sign's, of a voltage that is the other's


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Recorded less acting voltage, V."""
    time, width, by = sizes
    u_dc = rows.u_dc if rows.u_dc is not None else np.full(len(rows), bus(rows))
    shares = _shares(rows.once(_CURRENTS[round(by)]), float(width), np.array(AXES))
    return (-time / rows.T_s) * u_dc * rows.stationary(shares)


def _phases(i_s: Vector) -> Array:
    return np.stack([(i_s * axis.conjugate()).real for axis in AXES], axis=1)


def _turned(rows: Rows) -> Array:
    return _told(rows, _before(rows, rows.middle[1:] * rows.rotor[:-2].conj()))


def _as_sampled(rows: Rows) -> Array:
    return _told(rows, _before(rows, 1.0))


def _own(rows: Rows) -> Array:
    return _told(rows, rows.sampled_i_s[:-1] * rows.half)


def _commanded(rows: Rows) -> Array:
    """By means of currents around each period's first sample."""
    i = rows.sampled_i_s * rows.rotor.conj()
    w = min(_AVERAGED, (len(i) - 1) // 2)
    sums = np.cumsum(np.concatenate((np.zeros(1), np.full(w, i[0]), i, np.full(w, i[-1]))))
    return _phases((sums[2 * w + 1 :] - sums[: -2 * w - 1])[:-1] / (2 * w + 1) * rows.middle)


def _before(rows: Rows, turn: Vector | float) -> Vector:
    """The sample before each period's own, turned on; where there was none, the period's."""
    i_s, own = rows.sampled_i_s, rows.sampled_i_s[:-1] * rows.half
    return np.concatenate((own[:1], np.where(rows.apart[:-1] == 1, i_s[:-2] * turn, own[1:])))


def _told(rows: Rows, i_s: Vector) -> Array:
    """The three currents (A) of each period; of one so near zero that its sign is in doubt, the sign that the voltage
    tells, where it does.

    What is recorded, and how the drive turns it on, may differ from what it went by.
    """
    phases = _phases(i_s)
    if rows.left is not None:
        _resolve(phases, rows.left, rows.middle, _DOUBTFUL * rows.i_rated, np.array(AXES))
    return phases


@kernel
def _resolve(phases: Array, left: Vector, middle: Vector, doubtful: float, axes: Vector) -> None:
    """Move currents in doubt across zero, or to it, where more is added than lost and the voltage says so.

    Of the periods around it, what is left is a straight line in the rotor frame and a jump along the signs' vector.
    """
    signs, sure = _shares(phases, 0.0, axes), np.ones(len(phases), np.bool_)
    for k in range(len(phases)):
        signs[k] *= middle[k].conjugate()
        sure[k] = np.min(np.abs(phases[k])) >= doubtful
    for k in np.flatnonzero(~sure):
        n, d_1, d_2, vv, ss, sv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        v_0, v_1, s_0, s_1 = 0j, 0j, 0j, 0j
        for m in range(max(k - _COMPARED, 0), min(k + _COMPARED + 1, len(phases))):
            if not sure[m]:
                continue
            d, v, s = (m - k) / _COMPARED, left[m], signs[m]
            n, d_1, d_2 = n + 1.0, d_1 + d, d_2 + d * d
            v_0, v_1, s_0, s_1 = v_0 + v, v_1 + d * v, s_0 + s, s_1 + d * s
            vv += abs(v) ** 2
            ss += abs(s) ** 2
            sv += (s.conjugate() * v).real
        det = n * d_2 - d_1 * d_1
        if n < _FEWEST or det < _LINE * n * n:
            continue
        v_at, v_by = (d_2 * v_0 - d_1 * v_1) / det, (n * v_1 - d_1 * v_0) / det
        s_at, s_by = (d_2 * s_0 - d_1 * s_1) / det, (n * s_1 - d_1 * s_0) / det
        vv -= (v_at.conjugate() * v_0 + v_by.conjugate() * v_1).real
        ss -= (s_at.conjugate() * s_0 + s_by.conjugate() * s_1).real
        sv -= (s_at.conjugate() * v_0 + s_by.conjugate() * v_1).real
        if ss < _LINE * n:
            continue
        jump = -sv / ss
        rest = math.sqrt(max(vv - jump * jump * ss, 0.0) / (2.0 * n - 5.0))
        if 4.0 / 3.0 * jump < _APART * rest:
            continue
        for leg in range(3):
            if abs(phases[k, leg]) < doubtful:
                side = math.copysign(1.0, phases[k, leg])
                own = left[k] - (v_at + jump * s_at) + jump * signs[k]
                half = 2.0 / 3.0 * side * axes[leg] * middle[k].conjugate()  # to a current of zero, which has no sign
                none, other = abs(own - jump * half), abs(own - 2.0 * jump * half)
                if abs(own) > _ASTRAY * rest and min(none, other) < abs(own):
                    steps = 2.0 if other < none else 1.0
                    signs[k] -= steps * half
                    phases[k, leg] = (1.0 - steps) * side * doubtful


@kernel
def _shares(phases: Array, width: float, axes: Vector) -> Vector:
    """The legs' shares of the whole, as a vector."""
    found = np.empty(len(phases), np.complex128)
    for k in range(len(phases)):
        whole = 0j
        for leg in range(3):
            x = phases[k, leg]
            whole += (math.copysign(1.0, x) if abs(x) >= width else x / width) * axes[leg]
        found[k] = 2.0 / 3.0 * whole
    return found


_OF: Final = frozenset(("sampled", "left", "theta_e", "half"))
_CURRENTS: Final = tuple(Derived(make, _OF, None) for make in (_turned, _as_sampled, _own, _commanded))


def _remembered(rows: Rows, sizes: Sizes) -> Array:
    return rows.once(_CURRENTS[round(sizes[2])])


EFFECT = VoltageError(
    "dead_time_compensation", "the drive's compensation of its dead time",
    (
        Parameter("time", "s", lambda rows: 0.01 * rows.T_s, constant(0.0), lambda rows: 0.06 * rows.T_s),
        Parameter("width", "A", lambda rows: 0.02 * rows.i_rated, lambda rows: 1e-4 * rows.i_rated,
                  lambda rows: 0.5 * rows.i_rated, shape=True),
        Parameter("by", "1", constant(1.0), constant(BY_TURNED), constant(BY_COMMAND), shape=True, discrete=True),
    ),
    lambda rows: tuple((_SIGN * rows.i_rated, float(by)) for by in (BY_TURNED, BY_SAMPLE, BY_OWN, BY_COMMAND)),
    "steps of voltage where a sampled phase current changes sign, against what the legs lose, and with its noise",
    ("inverter_voltage_error",),
    error=voltage,
    of_recorded=False,
    undoes="inverter_voltage_error",
    remembers=_remembered,
    told=lambda _rows, p: {"time": (p[0], "s"), "width": (p[1], "A")},
    discrepancy=5e-4,
)  # fmt: skip
