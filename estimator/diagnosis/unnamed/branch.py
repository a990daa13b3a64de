"""Branch: a series R, L and C per phase at the machine's terminals, as a filter or a long cable makes, in a flux error.

Its current is measured beside the machine's. Of the poles l = w (-d +- j sqrt(1 - d^2)), w = 2 pi f the resonance's
frequency and d its damping over the critical one, each follows the terminals' voltage, and both make the current:

    x[k+1] = exp(l T_s) x[k] + integral of exp(l (t[k+1] - t)) u(t) over the period
    L i = (l x_l - l* x_l*) / (l - l*)

A leg that is high for a share D of the period, in its middle, adds to the integral along its axis

    2/3 u_dc exp(l T_s / 2) 2 sinh(l D T_s / 2) / l

Near the resonance that is not what the period's mean voltage adds, which serves where the link's voltage is not known.
Knows nothing of effects.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Bools, Vector
from estimator.diagnosis.likelihood.averages import energy_of, parts, sizes_in, whole, without_columns
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.diagnosis.likelihood.whitening import Whitening
from estimator.kernel import kernel
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES
from estimator.twin.model import Model, base_voltage

_FREQUENCIES: Final = 0.03, 0.48  # of the sampling rate
_DAMPINGS: Final = 0.003, 0.7
_LOG_STEP: Final = 0.01  # of their logarithms, for differences
_MOST_STEPS: Final = 0.3, 1.0  # of them, at most
_BRANCH_ROUNDS: Final = 4
_PROMISED: Final = 0.2  # of what a branch explains in the end, where one begins
_THIRDS: Final = 2  # of a step, and a third of it, one has to explain more


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """The branch that explains most of a flux error beside a machine."""

    frequency: float  # of the sampling rate
    damping: float  # over the critical one
    unsure: float  # standard deviation of the frequency's logarithm
    left: Vector  # Vs: the flux error less what the branch and the machine explain
    gain: float  # energy of the flux error (Vs^2, summed) that it explains beside the machine
    changes: Array  # shape (m,): of the machine's parameters, that explain most beside it


class _Try(NamedTuple):
    """A branch that may be."""

    gain: float  # chi square that it explains beside the machine
    f: float  # of the sampling rate
    damping: float
    taken: Array  # Vs, its flux error
    column: Array  # the same over the noise, beside the machine


def current_of(rows: Rows, frequency: float, damping: float) -> Vector:
    """L i (Vs, stationary frame) of a branch at samples. frequency: of the sampling rate."""
    w, u_s = TURN * frequency / rows.T_s, rows.u * rows.middle
    pole = complex(-damping * w, math.sqrt(1.0 - damping**2) * w)
    if rows.u_dc is None:
        held = (cmath.exp(pole * rows.T_s) - 1.0) / pole
        added = u_s * held, u_s * held.conjugate()
    else:
        added = _of_pulses(rows.duties, rows.u_dc, pole, rows.T_s)
    return _branch_flux(u_s, *added, rows.apart == 1, pole, rows.T_s)


def fitted_branch(
    rows: Rows, z: Vector, noise: tuple[float, float], machine: Array, starts: Sequence[tuple[float, float]],
    least: float = 0.0,
) -> Branch | None:  # fmt: skip
    """The branch nearest to the best of some frequencies and dampings; None where its current would be negative.

    noise: of a flux error z (Vs, rotor frame), white, on d and q. machine: (m, 2 n), what changes of the machine's
    parameters make of it, real parts before imaginary ones. least: chi square that it has to explain; None where no
    start explains a part of that.
    """
    scale = np.repeat([1.0 / noise[0], 1.0 / noise[1]], len(rows))
    basis, alone = np.linalg.qr((machine * scale).T)[0], base_voltage(rows, Model(rows.machine))
    whitening = filter_of(rows, rows.machine)

    def apart(x: Array) -> Array:
        return x - basis @ (basis.T @ x)

    y = apart(parts(z) * scale)

    def tried(f: float, d: float) -> _Try:
        taken = parts(_alone_taken(rows, current_of(rows, f, d), alone, whitening))
        x = apart(taken * scale)
        return _Try(max(float(x @ y), 0.0) ** 2 / max(float(x @ x), 1e-300), f, d, taken, x)

    best = max((tried(*at) for at in starts), key=lambda one: one.gain)
    if not best.gain > _PROMISED * least:
        return None
    unsure = math.inf
    for _ in range(_BRANCH_ROUNDS):
        f, d, x = best.f, best.damping, best.column
        slopes = np.array([x, (tried(f * math.exp(_LOG_STEP), d).column - x) / _LOG_STEP,
                           (tried(f, d * math.exp(_LOG_STEP)).column - x) / _LOG_STEP])  # fmt: skip
        inverse = np.linalg.pinv(slopes @ slopes.T, rcond=1e-12, hermitian=True)
        size, *by = inverse @ (slopes @ y)
        if not size > 0.0:
            break
        unsure = math.sqrt(inverse[1, 1]) / size
        step = np.clip(np.array(by) / size, np.negative(_MOST_STEPS), _MOST_STEPS)
        smaller = (tried(*_moved_within(f, d, step / 3.0**k)) for k in range(_THIRDS))
        better = next((one for one in smaller if one.gain > best.gain), None)
        if better is None:
            break
        best = better
    both = np.concatenate((machine, best.taken[None, :]))
    sizes = sizes_in(both, z)
    left = z - whole(sizes @ both)
    gain = energy_of(without_columns(machine, z)) - energy_of(left)
    return Branch(best.f, best.damping, unsure, left, gain, sizes[:-1])


def _moved_within(f: float, damping: float, step: Array) -> tuple[float, float]:
    """A frequency and a damping, moved by a step of their logarithms."""
    f, damping = f * math.exp(step[0]), damping * math.exp(step[1])
    return min(max(f, _FREQUENCIES[0]), _FREQUENCIES[1]), min(max(damping, _DAMPINGS[0]), _DAMPINGS[1])


def _alone_taken(rows: Rows, flux_s: Vector, alone: Vector, whitening: Whitening) -> Vector:
    """Flux error (Vs) that a branch makes whose L is as large as the machine's. flux_s: its L i (Vs, stationary frame).

    alone: the voltage (V) that the measured current needs where all of it is the machine's.
    """
    m = rows.machine
    i = rows.i - flux_s * rows.rotor.conj() / (0.5 * (m.L_d + m.L_q))
    without = rows.with_currents(i)
    return np.where(rows.joined, whitened(base_voltage(without, Model(m)) - alone, whitening), 0j)


@kernel
def _of_pulses(duties: Array, u_dc: Array, pole: complex, T_s: float) -> tuple[Vector, Vector]:
    """What legs' pulses add to the state of a pole and of its conjugate, Vs."""
    one, other = np.empty(len(u_dc), np.complex128), np.empty(len(u_dc), np.complex128)
    late = 2.0 / 3.0 * np.exp(0.5 * T_s * pole) / pole
    for k in range(len(u_dc)):
        here, there = 0j, 0j
        for leg in range(3):
            rising = np.exp(0.5 * T_s * duties[k, leg] * pole)
            pulse = late * (rising - 1.0 / rising)
            here += AXES[leg] * pulse
            there += AXES[leg] * pulse.conjugate()
        one[k], other[k] = u_dc[k] * here, u_dc[k] * there
    return one, other


@kernel
def _branch_flux(u_s: Vector, one: Vector, other: Vector, known: Bools, pole: complex, T_s: float) -> Vector:
    """L i at samples, Vs; settled where a run begins."""
    flux = np.empty(len(one) + 1, np.complex128)
    turned = pole.conjugate()
    kept, kept_too, apart = np.exp(pole * T_s), np.exp(turned * T_s), pole - turned
    x, y, begun = 0j, 0j, False
    flux[0] = 0j
    for k in range(len(one)):
        if not begun:
            x, y = -u_s[k] / pole, -u_s[k] / turned
        begun = known[k]
        if begun:
            x, y = kept * x + one[k], kept_too * y + other[k]
            flux[k + 1] = (pole * x - turned * y) / apart
        else:
            flux[k + 1] = 0j
    return flux
