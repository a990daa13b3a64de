"""Answered: does the recorded voltage answer the noise of the very currents in its row?

A controller that logs the voltage beside the currents that it computed it from records u[k] = ... - K i[k], their noise
n[k] included. Of a machine, u[k] is what moves i[k+1]: no voltage that acts over a period, or was computed before it,
knows the noise of the sample that begins it. What rows before do not foretell of i[k] is that noise, so with p rows

    u[k] = -K i[k] + sum_l (A_l i[k-l] + B_l u[k-l]) + c        K = 0 unless the row's own current is answered

(R. Frisch, F. V. Waugh, Partial time regressions as compared with individual trends, 1933, doi 10.2307/1907330). At one
speed and one level of current hardly anything else moves the voltage, and of u = R_s i + ... a regression makes
R_s = -K. Knows no effect.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Vector, Vectors
from estimator.diagnosis.likelihood.identifiability import ONE_LEVEL, ONE_SPEED, STANDING
from estimator.diagnosis.words import number, percent
from estimator.samples import Samples

_ROWS_BEFORE: Final = 3  # that foretell currents and voltages
_MOST_ROWS: Final = 12_000
_STRETCH: Final = 400  # rows, that errors are alike over
_FEWEST_STRETCHES: Final = 4
_HARMONICS: Final = 12  # of the angle, which a machine has, too
_SURELY: Final = 10.0  # standard errors of a gain
_SHARE: Final = 0.2  # of what rows before do not foretell of the voltage: less of it misleads no fit
_MOST: Final = 0.5  # of all that the voltage moves by: nothing else moves
_AVERAGED: Final = 400  # periods, over which a speed or a level is a mean, of a current or of an encoder's counts
_TOLD: Final = 1e-10  # of the columns' energy, that is more than their last digits


class Answered(NamedTuple):
    """A voltage that answers the currents of its row."""

    gain: tuple[float, float]  # V/A, on d and q
    share: float  # of what rows before do not foretell of the voltage, that is the answer
    whole: float  # of all that the voltage moves by, but for harmonics of the angle; below zero where currents move
    noise: tuple[float, float]  # A, what rows before do not foretell of i_d and i_q

    @property
    def alone(self) -> bool:
        """Nothing else moves the voltage."""
        return self.whole > _MOST

    @property
    def sentence(self) -> str:
        """What that leaves to be told."""
        d, q = (number(gain, 3) for gain in self.gain)
        gains = f"{d} V/A" if d == q else f"{d} V/A along d and {q} V/A along q"
        return (
            f"the recorded voltage answers the same row's current noise with {gains}: {percent(self.whole)} of what "
            "u_d and u_q move by here, at one speed and one level of current, is the controller's own voltage, which "
            "tells nothing of the machine"
        )


def answered(runs: Sequence[Samples]) -> Answered | None:
    """How the recorded voltage answers the current of its own row; None where it does not surely."""
    if any(run.periods != 1 for run in runs):
        return None
    stretches = list(_stretches(runs))
    if len(stretches) < _FEWEST_STRETCHES:
        return None
    u, i, before, turning = _joined(stretches)
    new_i, new_u = _left(i, before), _left(u, before)
    energy = new_i @ new_i.T
    if np.any(np.diag(energy) <= _TOLD * np.sum(i * i, axis=1)) or not np.any(new_u):
        return None
    inverse = np.linalg.inv(energy).astype(np.float64)
    gain: Array = -new_u @ new_i.T @ inverse
    left = new_u + gain @ new_i
    share = 1.0 - _energy(left) / _energy(new_u)
    std = [_std(left[axis], new_i, inverse, len(stretches))[axis] for axis in (0, 1)]
    if share < _SHARE or any(gain[axis, axis] < _SURELY * std[axis] for axis in (0, 1)):
        return None
    moved = _left(u, turning)
    whole = 1.0 - _energy(moved + gain @ _left(i, turning)) / _energy(moved)
    noise = np.sqrt(np.mean(new_i**2, axis=1))
    return Answered((float(gain[0, 0]), float(gain[1, 1])), share, whole, (float(noise[0]), float(noise[1])))


def answer_alone(runs: Sequence[Samples], i_rated: float | None = None) -> Answered | None:
    """The answer of a recording in which nothing else moves, at one speed and one level of current; None else.

    A rated current (A) that is not known is taken for the highest there is.
    """
    answer = answered(runs)
    if answer is None or not answer.alone:
        return None
    highest = float(np.quantile(np.concatenate([np.hypot(run.i_d, run.i_q) for run in runs]), 0.999))
    return answer if at_one_point(runs, i_rated or highest) else None


def at_one_point(runs: Sequence[Samples], i_rated: float) -> bool:
    """At one speed and one level of current, noise and harmonics aside; at rest a level alone tells R_s."""
    omega_e, i_d, i_q = (_means([getattr(run, name) for run in runs]) for name in ("omega_e", "i_d", "i_q"))
    if not len(omega_e):
        return False
    low, middle, high = np.quantile(omega_e, (0.02, 0.5, 0.98))
    spread = max(float(np.ptp(np.quantile(levels, (0.02, 0.98)))) for levels in (i_d, i_q))
    turns = abs(middle) > STANDING and high - low <= ONE_SPEED * abs(middle)
    return bool(turns) and spread < ONE_LEVEL * i_rated


def _means(parts: Sequence[Array]) -> Array:
    """Means over so many rows."""
    return np.concatenate([
        part[: len(part) // _AVERAGED * _AVERAGED].reshape(-1, _AVERAGED).mean(axis=1) for part in parts
    ])  # fmt: skip


class _Columns(NamedTuple):
    """Rows (along the last axis) of a stretch, or of all."""

    u: Array  # V, d and q
    i: Array  # A, d and q
    before: Array  # what foretells both
    turning: Array  # what turns with the rotor


def _stretches(runs: Sequence[Samples]) -> Iterator[_Columns]:
    """Stretches of the runs, spread evenly."""
    p, n = _ROWS_BEFORE, _STRETCH
    places = [(run, k) for run in runs for k in range(0, len(run) - n - p + 1, n)]
    spread: Array = np.linspace(0.0, len(places) - 1.0, min(_MOST_ROWS // n, len(places)))
    for run, k in (places[int(j)] for j in np.rint(spread)):
        here = run[k : k + n + p]
        both = np.stack((here.u_d, here.u_q, here.i_d, here.i_q))
        one, omega = np.ones((1, n)), here.omega_e[None, p:]
        turn: Vector = np.exp(1j * here.theta_e[p:])
        last, *others = (both[:, p - back : p - back + n] for back in range(1, p + 1))
        harmonics: Vectors = np.stack([turn**order for order in range(1, _HARMONICS + 1)])
        yield _Columns(
            both[:2, p:], both[2:, p:], np.concatenate((one, omega, omega * last, last, *others)),
            np.concatenate((one, omega, harmonics.real, harmonics.imag)),
        )  # fmt: skip


def _joined(stretches: Sequence[_Columns]) -> _Columns:
    return _Columns(*(np.concatenate(columns, axis=1) for columns in zip(*stretches, strict=True)))


def _left(x: Array, columns: Array) -> Array:
    """What least squares by some columns leave."""
    size = np.sqrt(np.mean(columns * columns, axis=1))
    columns = columns[size > 0.0] / size[size > 0.0, None]
    power, turn = np.linalg.eigh(columns @ columns.T)
    kept = power > _TOLD * float(power[-1])
    basis: Array = turn[:, kept].T @ columns
    return x - (x @ basis.T / power[kept]) @ basis


def _std(left: Array, columns: Array, inverse: Array, stretches: int) -> Array:
    """Standard errors of one axis' coefficients, as the stretches scatter."""
    scores = (left * columns).reshape(len(columns), stretches, -1).sum(axis=2)
    return np.sqrt(np.diag(inverse @ scores @ scores.T @ inverse))


def _energy(x: Array) -> float:
    return float(np.sum(x * x))
