"""A rough fit: R_s, L_d, L_q and psi_f from a few stretches of a recording, whatever was done to its columns.

The flux balance with the mean of a period's two currents, whitened; good to a per cent, and quick enough to be asked
fifty times. Knows no effect.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.intake.correction import Correction
from estimator.diagnosis.likelihood.whitening import whiten, whitening_of
from estimator.machine import PARAMETERS, Machine
from estimator.physics.vectors import AXES
from estimator.samples import Samples

MOST_ROWS: Final = 6000  # rows
PADDING: Final = 2  # rows by which columns may be shifted
TURNED: Final = 0.3  # rad in a stretch: the least that speed and angle are compared at
_LAST_DIGITS: Final = 1e-12  # of an angle
_STRETCH_LENGTHS: Final = (256, 64, 16)  # rows of a stretch, the first that the runs are long enough for


@dataclass(frozen=True, slots=True, eq=False)
class RoughStretches:
    """Stretches of equal length, as recorded; one a row of every array."""

    i: Vector  # A, at n + 1 samples and the padding on both sides; so all others
    u: Vector  # V
    theta_e: Array  # rad
    omega_e: Array  # rad/s
    u_dc: Array | None  # V
    i_s: Vector | None  # A, stationary frame, of the phase currents
    T_s: float  # s

    @property
    def count(self) -> int:
        """Stretches."""
        return len(self.i)

    def at(self, places: NDArray[np.intp]) -> "RoughStretches":
        """Some of them."""
        whole: dict[str, Array | Vector] = {
            f.name: x for f in fields(self) if isinstance(x := getattr(self, f.name), np.ndarray)
        }
        return replace(self, **{name: column[places] for name, column in whole.items()})


@dataclass(frozen=True, slots=True, eq=False)
class RoughFit:
    """What a fit gives."""

    value: Array  # R_s, L_d, L_q, psi_f
    std: Array  # as the stretches scatter; infinite where the stretches do not tell
    left: float  # mean square of what is left, V^2 as recorded
    share: float  # of the voltages' mean square that is explained, 0 to 1


def stretches_of(runs: Sequence[Samples]) -> RoughStretches | None:
    """Half spread evenly, half where currents change most; None where no run is long enough."""
    for n in _STRETCH_LENGTHS:
        whole = n + 1 + 2 * PADDING
        places = [(run, k) for run in runs for k in range(0, len(run) - whole + 1, n)]
        if len(places) * n >= min(MOST_ROWS, 0.7 * sum(map(len, runs))) or (n == _STRETCH_LENGTHS[-1] and places):
            return _cut_stretches(places, whole, MOST_ROWS // n)
    return None


def speed_over_rate(stretches: RoughStretches, correction: Correction) -> float:
    """Speed column over the rate of the corrected angle; NaN where the two cannot be compared."""
    theta = correction.angle(stretches.theta_e)
    by_angle = theta[:, -1] - theta[:, 0]
    omega = stretches.omega_e / correction.omega
    by_speed = stretches.T_s / correction.T_s * (omega.sum(axis=1) - 0.5 * (omega[:, 0] + omega[:, -1]))
    turned = float(by_angle @ by_angle)
    if turned < TURNED**2 * len(theta):
        return math.nan
    ratio = float(by_speed @ by_angle) / turned
    left = by_speed - ratio * by_angle
    return ratio if ratio != 0.0 and left @ left < 0.01 * (by_speed @ by_speed) else math.nan


def angle_by_speed(stretches: RoughStretches) -> bool:
    """Whether the angle is the integral of the speed column by the trapezoidal rule, to its last digits."""
    theta, omega = stretches.theta_e, stretches.omega_e
    off = np.diff(theta) - 0.5 * stretches.T_s * (omega[:, 1:] + omega[:, :-1])
    return bool(np.any(omega)) and float(np.max(np.abs(off))) < _LAST_DIGITS * (1.0 + float(np.max(np.abs(theta))))


def rows_of_angle(stretches: RoughStretches) -> int:
    """Rows by which the angle column is late against the angle that turns the phase currents into i_d and i_q."""
    if stretches.i_s is None:
        return 0
    n = stretches.i.shape[1] - 2 * PADDING
    core = slice(PADDING, PADDING + n)

    def off(late: int) -> float:
        turned = np.exp(1j * stretches.theta_e[:, PADDING + late : PADDING + late + n])
        assert stretches.i_s is not None
        return float(np.mean(np.abs(stretches.i[:, core] * turned - stretches.i_s[:, core]) ** 2))

    by_rows = {late: off(late) for late in range(-PADDING, PADDING + 1)}
    least = min(by_rows, key=lambda late: by_rows[late])
    return least if by_rows[least] < 0.05 * by_rows[0] else 0


def _cut_stretches(places: list[tuple[Samples, int]], whole: int, most: int) -> RoughStretches:
    chosen = set(range(len(places)))
    if len(places) > most:
        chosen = {round(k) for k in np.linspace(0, len(places) - 1, most // 2)}
        look = [k for k in range(0, len(places), max(1, len(places) // 400)) if k not in chosen]
        moved = [_moved_currents(run, k, whole) for run, k in (places[j] for j in look)]
        chosen |= {look[j] for j in np.argsort(moved)[len(moved) - (most - len(chosen)) :]}
    kept = [places[j] for j in sorted(chosen)]

    def column(name: str) -> Array:
        return np.stack([getattr(run, name)[k : k + whole] for run, k in kept])

    def known(*names: str) -> bool:
        return all(getattr(run, name) is not None for run, _ in kept for name in names)

    i_s = None
    if known("i_a", "i_b", "i_c"):
        i_s = 2.0 / 3.0 * (AXES[0] * column("i_a") + AXES[1] * column("i_b") + AXES[2] * column("i_c"))
    return RoughStretches(
        column("i_d") + 1j * column("i_q"), column("u_d") + 1j * column("u_q"), column("theta_e"), column("omega_e"),
        column("u_dc") if known("u_dc") else None, i_s, kept[0][0].T_s,
    )  # fmt: skip


def _moved_currents(run: Samples, k: int, whole: int) -> float:
    """How much the currents of a stretch move, A."""
    return math.hypot(float(np.std(run.i_d[k : k + whole])), float(np.std(run.i_q[k : k + whole])))


def rough_fit(stretches: RoughStretches, correction: Correction, machine: Machine) -> RoughFit:
    """The machine of the stretches as corrected; `machine` sets the whitening only."""
    S = stretches.count
    theta = correction.angle(stretches.theta_e)
    i = correction.current(stretches.i, theta)
    middle = 0.5 * (theta[:, 1:] + theta[:, :-1])
    u_dc = None if stretches.u_dc is None else stretches.u_dc[:, :-1]
    u = correction.voltage(stretches.u[:, :-1], middle, u_dc)
    n = i.shape[1] - 1 - 2 * PADDING

    def at(column: Array | Vector, shift: int, more: int) -> Array | Vector:
        return column[:, PADDING + shift : PADDING + shift + n + more]

    i, u = at(i, 0, 1), at(u, correction.u_shift, 0)
    half = np.exp(0.5j * np.diff(at(theta, correction.theta_shift, 1)))
    T_s = stretches.T_s / correction.T_s
    i_0, i_1, back = i[:, :-1], i[:, 1:], half.conj()
    v = np.empty((len(PARAMETERS) + 1, S, n), np.complex128)
    v[0] = 0.5 * (half * i_1 + back * i_0)
    v[1] = (half * i_1.real - back * i_0.real) / T_s
    v[2] = 1j * (half * i_1.imag - back * i_0.imag) / T_s
    v[3] = (half - back) / T_s
    v[4] = u
    joined = np.ones((S, n), np.bool_)
    joined[:, 0] = False
    rho = min(max(math.exp(-machine.R_s * T_s / (0.5 * (machine.L_d + machine.L_q))), 0.5), 0.99)
    flat = v.reshape(len(v), -1)
    alike = whitening_of(half.ravel(), joined.ravel(), (1.0, 1.0), (rho, rho), 1.0)
    whiten(flat, *alike, np.zeros(len(v), np.complex128))
    x = np.ascontiguousarray(np.concatenate((v.real, v.imag), axis=2).transpose(1, 0, 2))  # (S, 5, 2 n)
    found = _least_squares(x @ x.transpose(0, 2, 1), 2 * n * S)
    volts = 1.0 if not correction.per_unit or u_dc is None else correction.per_unit * float(np.mean(u_dc))
    return replace(found, left=found.left * (abs(correction.u) / volts) ** 2)


def _least_squares(grams: Array, count: int) -> RoughFit:
    """Least squares over the stretches' sums of products, of so many numbers."""
    gram = grams.sum(axis=0)
    P = len(gram) - 1
    size = np.sqrt(np.diag(gram))
    told = np.flatnonzero(size[:P] > 1e-9 * np.max(size[:P]))
    value, std = np.zeros(P), np.full(P, math.inf)
    scale = 1.0 / size[told]
    A = gram[np.ix_(told, told)] * np.outer(scale, scale)
    power, turn = np.linalg.eigh(A)
    kept = power > 1e-10
    inverse = (turn[:, kept] / power[kept]) @ turn[:, kept].T
    x = inverse @ (gram[told, P] * scale)
    score = (grams[:, told, P] - grams[:, told][:, :, told] @ (x * scale)) * scale  # of each stretch
    left = max(float(gram[P, P] - x @ (gram[told, P] * scale)), 0.0)
    m = len(grams)
    covariance = inverse @ (score.T @ score * (m / max(m - 1, 1))) @ inverse + inverse * (left / count)
    value[told], std[told] = x * scale, np.sqrt(np.diag(covariance)) * scale
    if not np.all(kept):  # what lies along directions that no row moves in
        blind = np.abs(turn[:, ~kept]).max(axis=1) > 0.1
        std[told[blind]] = math.inf
    return RoughFit(value, std, left / count, 1.0 - left / max(float(gram[P, P]), 1e-300))
