"""What a textbook machine does not foresee in a recording, made white: innovations of a Kalman filter.

The state is the flux linkage in the rotor frame, driven by the recorded voltages; the currents are its measurement:

    d(psi)/dt = u - R_s i        i_d = (psi_d - psi_f) / L_d        i_q = psi_q / L_q

The voltage of a period is taken apart into the pulses of its modulation, centred in the period, as high as the dc link
is then: in a motor with a time constant of few periods their ripple leaves a mean current behind, and a link that sags
loses voltage. Each pulse is one step of the Runge-Kutta method, in axes that stand where the rotor is at the period's
middle. Knows nothing of effects. Not the estimator's flux balance: written anew, so that neither hides an error of the
other.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.frames import TURN, phases, turned
from emulator.kernel import inlined, kernel

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Rotors = tuple[complex, complex, complex]  # exp(j angle) of the rotor against the axes of a period

_B: Final = complex(-0.5, 0.5 * math.sqrt(3.0))  # direction of phase b
_SKIPPED: Final = 2  # first rows, in which a shifted voltage is not there yet


class Noise(NamedTuple):
    """Variances of what is known to be noise, white each."""

    i: float  # A2, of i_d and i_q each, the mean of all directions
    i_unlike: complex  # A2, stationary: half of the mean of its vector's square; zero where it is alike in all
    theta: float  # rad2, of the electrical angle
    u: float  # V2, of u_d and u_q each


class Pulses(NamedTuple):
    """Room to work in, for a period: the same forwards and backwards."""

    voltages: Complexes  # (4,) V, stationary, one after the other; the last one in the middle
    early: Array  # (4,) s before the middle, at which they begin
    rotors: Complexes  # (4, 2) there, and halfway to the next
    duty: Array  # (3,)
    axis: Complexes  # (3,)


class Symmetric(NamedTuple):
    """A matrix over the axes."""

    d: float
    q: float
    dq: float


@inlined
def _rate(psi: complex, u: complex, rotor: complex, per_d: float, per_q: float, psi_f: float) -> complex:
    """d(psi)/dt (V) in axes from which the rotor's stand `rotor` = exp(j angle) away."""
    at = psi * rotor.conjugate()
    return u - rotor * complex((at.real - psi_f) * per_d, at.imag * per_q)


@inlined
def _later(
    psi: complex, u: complex, rotors: Rotors, h: float, per_d: float, per_q: float, psi_f: float
) -> complex:  # fmt: skip
    """Flux linkage (Vs) a time h (s) later; rotors: at its start, in its middle and at its end. per_d, per_q: R_s / L,
    1/s.
    """
    start, middle, end = rotors
    k_1 = _rate(psi, u, start, per_d, per_q, psi_f)
    k_2 = _rate(psi + 0.5 * h * k_1, u, middle, per_d, per_q, psi_f)
    k_3 = _rate(psi + 0.5 * h * k_2, u, middle, per_d, per_q, psi_f)
    k_4 = _rate(psi + h * k_3, u, end, per_d, per_q, psi_f)
    return psi + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)


@inlined
def _pulses(u: complex, u_dc: float, level: float, T_s: float, room: Pulses) -> None:
    """The seven voltages (V) of a period in the order of time, and the times (s, before its middle) at which the first
    four begin; it is the same forwards and backwards.

    `u` (V, stationary) is what the drive set by a dc link of `u_dc` (V) as it read it; the link was at `level` (V).
    """
    u_a, u_b, u_c = phases(u)
    u_0 = -0.5 * (max(u_a, u_b, u_c) + min(u_a, u_b, u_c))
    duty, axis = room.duty, room.axis
    for n in range(3):
        more = min(max(0.5 + ((u_a if n == 0 else u_b if n == 1 else u_c) + u_0) / u_dc, 0.0), 1.0)
        along, place = 1.0 + 0j if n == 0 else _B if n == 1 else _B.conjugate(), n
        while place > 0 and duty[place - 1] < more:  # the longest first
            duty[place], axis[place] = duty[place - 1], axis[place - 1]
            place -= 1
        duty[place], axis[place] = more, along
    room.early[0] = 0.5 * T_s
    room.voltages[0] = room.voltages[3] = 0j
    held = 0j
    for n in range(3):
        room.early[1 + n] = 0.5 * T_s * duty[n]
        held += 2.0 / 3.0 * level * axis[n]
        if n < 2:
            room.voltages[1 + n] = held


@inlined
def _measured(i_d: float, i_q: float, theta: float, machine: Array, noise: Noise) -> Symmetric:
    """Variance of the flux linkage that currents tell: theirs, and that of the angle by which all of it is turned."""
    _, L_d, L_q, psi_f = machine
    a_d, a_q = (L_d - L_q) * i_q, psi_f + (L_d - L_q) * i_d
    unlike = noise.i_unlike * turned(-2.0 * theta)
    return Symmetric(
        L_d * L_d * (noise.i + unlike.real) + a_d * a_d * noise.theta,
        L_q * L_q * (noise.i - unlike.real) + a_q * a_q * noise.theta,
        L_d * L_q * unlike.imag + a_d * a_q * noise.theta,
    )


@inlined
def _gain(p: Symmetric, s: Symmetric) -> tuple[float, float, float, float]:
    """P S^-1, row by row."""
    det = s.d * s.q - s.dq * s.dq
    return (
        (p.d * s.q - p.dq * s.dq) / det, (p.dq * s.d - p.d * s.dq) / det,
        (p.dq * s.q - p.q * s.dq) / det, (p.q * s.d - p.dq * s.dq) / det,
    )  # fmt: skip


@inlined
def _carried(p: Symmetric, f_d: complex, f_q: complex, more: float) -> Symmetric:
    """F P F' and `more` on both axes; f_d and f_q are the columns of F."""
    v_d = complex(f_d.real * p.d + f_q.real * p.dq, f_d.imag * p.d + f_q.imag * p.dq)
    v_q = complex(f_d.real * p.dq + f_q.real * p.q, f_d.imag * p.dq + f_q.imag * p.q)
    return Symmetric(
        v_d.real * f_d.real + v_q.real * f_q.real + more,
        v_d.imag * f_d.imag + v_q.imag * f_q.imag + more,
        v_d.imag * f_d.real + v_q.imag * f_q.real,
    )


@kernel
def innovations(columns: Array, T_s: float, machines: Array, noise: Noise) -> Array:
    """White errors (1, variance 1) of one-step predictions: machines x 2 (n - 3), two a row.

    `columns`: theta_e, i_d, i_q, u_d, u_q, u_dc (6 x n). `machines` (m x 4): R_s, L_d, L_q, psi_f. The filter's gain is
    that of the first machine; so the errors of the others tell how a change of parameters shows in the same filter.
    """
    theta, i_d, i_q, u_d, u_q, u_dc = columns
    m, n = len(machines), len(theta)
    out = np.empty((m, 2 * (n - _SKIPPED - 1)))
    L_d, L_q, psi_f = machines[:, 1].copy(), machines[:, 2].copy(), machines[:, 3].copy()
    per_d, per_q = machines[:, 0] / L_d, machines[:, 0] / L_q
    x = np.empty(m, np.complex128)
    room = Pulses(
        np.empty(4, np.complex128), np.empty(4), np.empty((4, 2), np.complex128), np.empty(3),
        np.empty(3, np.complex128),
    )  # fmt: skip
    for j in range(m):
        x[j] = complex(L_d[j] * i_d[_SKIPPED] + psi_f[j], L_q[j] * i_q[_SKIPPED])
    p = _measured(i_d[_SKIPPED], i_q[_SKIPPED], theta[_SKIPPED], machines[0], noise)
    for k in range(_SKIPPED, n - 1):
        # Over the period
        turn = theta[k + 1] - theta[k]
        turn -= TURN * math.floor(turn / TURN + 0.5)
        half, middle = turned(0.5 * turn), turned(theta[k] + 0.5 * turn)
        back, speed = half.conjugate(), turn / T_s
        _pulses(complex(u_d[k], u_q[k]) * middle, u_dc[k], 0.5 * (u_dc[k] + u_dc[k + 1]), T_s, room)
        for part in range(4):
            begin, end = room.early[part], room.early[part + 1] if part < 3 else -room.early[3]
            room.rotors[part, 0], room.rotors[part, 1] = turned(-speed * begin), turned(-0.5 * speed * (begin + end))
            room.voltages[part] *= middle.conjugate()
        for j in range(m):
            x[j] *= back
        for pulse in range(7):
            part = min(pulse, 6 - pulse)
            h = room.early[part] - room.early[part + 1] if part < 3 else 2.0 * room.early[3]
            if h <= 0.0:
                continue
            start, end = room.rotors[part, 0], room.rotors[min(part + 1, 3), 0]
            rotors = start, room.rotors[part, 1], end if part < 3 else start.conjugate()
            if pulse > 3:
                rotors = end.conjugate(), room.rotors[part, 1].conjugate(), start.conjugate()
            for j in range(m):
                x[j] = _later(x[j], room.voltages[part], rotors, h, per_d[j], per_q[j], psi_f[j])
        for j in range(m):
            x[j] *= back
        # Without magnets and voltage, what is left is what becomes of an error
        whole = back, 1.0 + 0j, half
        f_d = _later(back, 0j, whole, T_s, per_d[0], per_q[0], 0.0) * back
        f_q = _later(1j * back, 0j, whole, T_s, per_d[0], per_q[0], 0.0) * back
        p = _carried(p, f_d, f_q, T_s * T_s * noise.u)

        # At its end
        r = _measured(i_d[k + 1], i_q[k + 1], theta[k + 1], machines[0], noise)
        s = Symmetric(p.d + r.d, p.q + r.q, p.dq + r.dq)
        g_dd, g_dq, g_qd, g_qq = _gain(p, s)
        c_d = math.sqrt(s.d)
        c_dq = s.dq / c_d
        c_q, at = math.sqrt(s.q - c_dq * c_dq), 2 * (k - _SKIPPED)
        for j in range(m):
            e_d = L_d[0] * (i_d[k + 1] - (x[j].real - psi_f[j]) / L_d[j])
            e_q = L_q[0] * (i_q[k + 1] - x[j].imag / L_q[j])
            x[j] += complex(g_dd * e_d + g_dq * e_q, g_qd * e_d + g_qq * e_q)
            out[j, at] = e_d / c_d
            out[j, at + 1] = (e_q - c_dq * out[j, at]) / c_q
        p = Symmetric(
            p.d - g_dd * p.d - g_dq * p.dq, p.q - g_qd * p.dq - g_qq * p.q, p.dq - g_dd * p.dq - g_dq * p.q
        )
    return out
