"""Ringing: whether a branch of R, L and C at the machine's terminals shows in a flux error, and where, roughly.

Its current is measured beside the machine's and answers each change of a period's mean voltage, more or less, by

    i_b[k] = sum over j >= 0 of h[j] (u[k-j] - u[k-j-1])        h[j] = a exp(-d w (j+1)) sin(sqrt(1 - d^2) w (j+1))

with w = 2 pi f T_s of the resonance's frequency f and d its damping over the critical one. Where changes of the voltage
reach f, h itself shows; where they do not, the branch is a capacitance a / w, whose current leads the voltage. Only
past changes count: the voltage's control follows the current's noise in its turn. `branch` goes on from there, by the
bridge's pulses. Knows nothing of effects.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.averages import whole
from estimator.diagnosis.unnamed.branch import Branch, fitted_branch
from estimator.diagnosis.where.spectra import welch
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows

_TAPS: Final = 160  # periods of a scan
_SLOWEST_RINGING: Final = 0.05  # of the sampling rate: slower changes are not looked at for what rings
_RINGS: Final = np.geomspace(0.06, 0.45, 64)  # w / 2 pi
_DAMPING: Final = np.array([0.01, 0.03, 0.1, 0.2])
_COLOUR_LINES: Final = 512  # frequencies of the colour
_SURE_SIZE: Final = 7.0  # standard errors of its size
_PLAIN_SHARE: Final = 0.25  # of it, that nothing else may ring with
_STARTS: Final = (0.08, 0.1), (0.13, 0.1), (0.2, 0.07)  # w / 2 pi, damping: where else a branch is sought


def _taps() -> Array:
    """Shape (frequencies, dampings, taps): - h / a, since what a branch takes is missing in the machine's flux."""
    turned = TURN * _RINGS[:, None, None] * np.arange(1, _TAPS + 1)
    return -np.exp(-_DAMPING[:, None] * turned) * np.sin(np.sqrt(1.0 - _DAMPING[:, None] ** 2) * turned)


_TAPPED: Final = _taps()


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """How a current (A, stationary frame) answers the voltage's changes, both as spectra of `size`."""

    rows: Rows
    size: int
    u: Vector
    i: Vector

    def lagged(self, weight: Array | float, i: Vector) -> tuple[Array, Array]:
        """Normal equations of the taps of what makes a current (a spectrum) of the voltage's changes, weighed."""
        auto, lag = np.fft.ifft(np.abs(self.u) ** 2 * weight)[:_TAPS].real, np.arange(_TAPS)
        cross = np.fft.ifft(i * self.u.conj() * weight)[:_TAPS].real
        return auto[np.abs(lag[:, None] - lag[None, :])], cross


class _Ringing(NamedTuple):
    """A branch."""

    f: float  # of the sampling rate
    damping: float
    sure: float
    plain: bool


def ringing(rows: Rows, z: Vector, noise: tuple[float, float]) -> tuple[float, bool] | None:
    """How many standard errors a resonance shows with among fast changes of the voltage, and whether it is plain.

    It is where nothing else rings nearly as loud. noise: the flux error's white standard deviation (Vs) on d and q.
    """
    answer = _answer(rows, z)
    found = None if answer is None else _rings(answer, z, noise)
    return None if found is None else (found.sure, found.plain)


def resonance(rows: Rows, z: Vector, noise: tuple[float, float], machine: Array, least: float = 0.0) -> Branch | None:
    """The branch that explains most of a flux error (Vs, rotor frame) beside a machine's parameters.

    machine: (m, 2 n), what changes of them make of the flux error, real parts before imaginary ones. least: as
    `fitted_branch` has it.
    """
    answer = _answer(rows, z)
    if answer is None:
        return None
    likely = _rings(answer, z, noise), _largest(answer, machine)
    starts = [(one.f, one.damping) for one in likely if one is not None]
    return fitted_branch(rows, z, noise, machine, [*starts, *_STARTS], least)


def _answer(rows: Rows, z: Vector) -> _Answer | None:
    """None where there is too little to tell."""
    n = len(rows)
    if n < 8 * _TAPS:
        return None
    u_s = rows.u * rows.middle
    size = 1 << (n + _TAPS).bit_length()
    u = np.fft.fft(np.diff(u_s, prepend=u_s[:1]) * rows.joined, size)
    return _Answer(rows, size, u, np.fft.fft(_flux_current(rows, z), size))


def _flux_current(rows: Rows, z: Vector) -> Vector:
    """What of the measured current makes a flux error, A, stationary frame."""
    return (z.real / rows.machine.L_d + 1j * (z.imag / rows.machine.L_q)) * rows.rotor[1:]


def _rings(answer: _Answer, z: Vector, noise: tuple[float, float]) -> _Ringing | None:
    """What rings beside the current's colour, where it is sure.

    Not where ever slower or faster ringing explains more: then it is none.
    """
    m = answer.rows.machine
    colour = np.maximum(
        welch(_flux_current(answer.rows, z), _COLOUR_LINES), (noise[0] / m.L_d) ** 2 + (noise[1] / m.L_q) ** 2
    )
    loud = np.maximum(colour, np.maximum(np.roll(colour, 1), np.roll(colour, -1)))
    fast = np.abs(np.fft.fftfreq(answer.size)) > _SLOWEST_RINGING
    gram, cross = answer.lagged(fast * 2.0 / loud[np.arange(answer.size) * _COLOUR_LINES // answer.size], answer.i)
    sure, size = _branch_sizes(gram, cross)
    f, d = np.unravel_index(int(np.argmax(sure)), sure.shape)
    if not sure[f, d] > _SURE_SIZE or f in (0, len(_RINGS) - 1):
        return None
    others, _ = _branch_sizes(gram, cross - gram @ _TAPPED[f, d] * (sure[f, d] / size[f, d]))
    plain = bool(np.max(np.abs(others)) < _PLAIN_SHARE * sure[f, d])
    return _Ringing(float(_RINGS[f]), float(_DAMPING[d]), float(sure[f, d]), plain)


def _largest(answer: _Answer, machine: Array) -> _Ringing | None:
    """The branch that explains most of a current beside the machine, slow changes too: it need not be sure to ring."""
    others = [np.fft.fft(_flux_current(answer.rows, whole(column)), answer.size) for column in machine]
    gram, cross = answer.lagged(1.0, answer.i)
    to = np.array([answer.lagged(1.0, i)[1] for i in others])  # (m, taps)
    inner = np.array([[float(np.vdot(a, b).real) for b in others] for a in others]) / answer.size
    along = np.array([float(np.vdot(a, answer.i).real) for a in others]) / answer.size
    inverse = np.linalg.pinv(inner, rcond=1e-12, hermitian=True)
    sure, _ = _branch_sizes(gram - to.T @ inverse @ to, cross - to.T @ inverse @ along)
    f, d = np.unravel_index(int(np.argmax(sure)), sure.shape)
    return _Ringing(float(_RINGS[f]), float(_DAMPING[d]), 0.0, False) if sure[f, d] > 0.0 else None


def _branch_sizes(gram: Array, cross: Array) -> tuple[Array, Array]:
    """Of all branches: their sizes in standard errors, where noise has unit variance, and one over the latter."""
    size = np.sqrt(np.maximum(np.einsum("fdj,fdj->fd", _TAPPED @ gram, _TAPPED), 1e-300))
    return _TAPPED @ cross / size, size
