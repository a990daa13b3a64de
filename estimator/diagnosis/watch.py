"""Detect: do constant parameters explain a window of the stream, or is more left of its voltages than noise?

Rows may cover several control periods. Their flux balances (see `flux_balance`) are whitened, the parameters are fitted
to them, and what is left is compared with its own white noise. Noise of the sampled currents is differenced in a
balance e, and white, by axis, in the flux error

    z[k+1] = exp(-jD/2) (a exp(-jD/2) z[k] + T e[k])        a = exp(-R_s T_s/L) (1 + q/2 - sqrt(q + q^2/4))

where q is the variance of what the row's mean current and the voltage's resolution add, over that of the differenced
flux: a first-order moving average and white noise are one together. The white level is that of the quieter half of the
spectrum; a mismatch stands above it, in an octave or as a line. Octaves are judged by E. Paulson, An approximate
normalization of the analysis of variance distribution, Annals of Mathematical Statistics 13, 1942,
doi 10.1214/aoms/1177731608. Knows nothing of effects and of threads.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array, Bools, Vector, Vectors
from estimator.diagnosis.likelihood.averages import Means
from estimator.diagnosis.likelihood.constant_parameters import (
    LEAST_L,
    POLE,
    ROUND_OFF,
    balance_columns,
    half_turn,
    least_squares,
    of_h,
    on_q,
    whiten_axes,
)
from estimator.diagnosis.verdict import Place
from estimator.diagnosis.where.regions import regions, shares_together
from estimator.diagnosis.words import percent
from estimator.machine import PARAMETERS, Machine
from estimator.online.estimate import Estimate, Status
from estimator.online.flux_balance import TURN, angle_turned, flux_balance
from estimator.physics.rows import Rows
from estimator.samples import Samples

FEWEST_WATCHED: Final = 200  # rows; of fewer nothing is said
SURE_SIGMAS: Final = 6.0  # standard deviations of noise
LEAST: Final = 1e-3  # of the voltage's rms: less does not matter
GONE: Final = 0.7  # of either: a mismatch that was there is there no more
_COLOUR: Final = 1.3  # times its white level, that noise may have in an octave
_ROUNDING_ENERGY: Final = 1.2  # of the energy that an angle in steps may leave
_CURRENT_MOVES: Final = 3.0  # standard deviations of noise, by which a current that moves departs from its mean
_SPEED_MOVES: Final = 0.02  # of its rms
_LONGEST: Final = 0.95  # and at most: a noise at a run's start is forgotten soon
_PLAIN_SIGMAS: Final = 50.0  # standard deviations of noise, at which means over fewer rows show where a mismatch is
_AXIS_SHARE: Final = 0.7  # of the energy


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """What is left of a window's voltages when constant parameters have explained what they can."""

    rows: int
    moves: bool  # currents or speed do; any parameters fit a single operating point
    significance: float  # in standard deviations of noise, which alone leaves about 2
    ratio: float  # its energy over that of noise, which alone leaves 1
    rms_V: float  # what stands above noise, V
    least_V: float  # that matters, V
    v: Vector  # V, of each row, rotor frame
    noise: tuple[float, float]  # Vs, of the flux error, white, on d and q
    seen: Rows  # at the rows' middles

    @property
    def mismatch(self) -> bool:
        """More than noise, and enough to matter."""
        return self.moves and self.significance > SURE_SIGMAS and self.rms_V > self.least_V

    @property
    def clear(self) -> bool:
        """Clearly no mismatch, of a window that would show one."""
        return self.moves and (self.significance < GONE * SURE_SIGMAS or self.rms_V < GONE * self.least_V)


def mismatch_of(runs: Sequence[Samples], estimates: Mapping[str, Estimate]) -> Left | None:
    """Judge a window's rows, given as runs without gaps; None where nothing can be said of them.

    `estimates` say which parameters are held; the others are fitted anew, but for an inductance of an axis on which no
    current moves, which stays as estimated.
    """
    runs = [run for run in runs if len(run) > 1]
    if sum(len(run) - 1 for run in runs) < FEWEST_WATCHED:
        return None
    one, parts = runs[0], [flux_balance(run) for run in runs]
    balance = np.concatenate(parts)
    joined = np.ones(len(balance), np.bool_)
    joined[np.cumsum([0, *map(len, parts[:-1])])] = False
    D = angle_turned(balance, one.T_s)
    beta, free = _start(balance, estimates, one.T)
    if not all(free[k] or beta[k] > 0.0 for k in (1, 2)):
        return None
    q_only = one.q_only
    columns, held, poles = balance_columns(balance, q_only=q_only), beta, (POLE, POLE)
    step = max(
        one.resolution.theta_e, _largest_step(np.concatenate([run.theta_e for run in runs]), one.periods * D, joined)
    )
    for last in (False, True):
        by_angle = _voltage_by_angle(columns, beta)
        columns[6] = on_q(by_angle) if q_only else by_angle
        white = columns.copy()
        whiten_axes(white, half_turn(D, q_only=q_only), joined, one.T, *poles)
        beta, offset = _fit_free(white, held, beta, free, step)
        coefficients = np.array([*-beta, 1.0, of_h(beta), -offset])
        z: Vector = coefficients @ white
        rounded = _rounding_variance(beta, columns, step, one.T, poles)
        rounded = (0.0, rounded[1]) if q_only else rounded
        axes = tuple(_spectrum_of(x, n) for x, n in zip((z.real, z.imag), rounded, strict=True))
        if not last:
            poles = _poles(beta, columns, one, axes)
    volts2 = sum(axis.excess(pole, one.T) for axis, pole in zip(axes, poles, strict=True))
    return Left(
        len(z), _moves(columns, beta, one, axes), max(axis.significance for axis in axes),
        sum(axis.ratio for axis in axes) / (1.0 if q_only else 2.0), math.sqrt(volts2),
        _least_voltage(columns, beta, one), coefficients @ columns, (axes[0].level, axes[1].level),
        _seen(balance, D, runs, beta),
    )  # fmt: skip


def place_in_window(left: Left) -> Place:
    """Where it acts: axis, speed, current, time, or distance of a phase current to its change of sign."""
    blocks, power_d, power_q = _mean_voltages(left)
    total = float((power_d + power_q).sum())
    if len(blocks.v) < 4 or not total > 0.0:
        return Place("nowhere in particular", {}, 0.0, 1.0)
    shares = {"d": float(power_d.sum()) / total, "q": float(power_q.sum()) / total}
    axis = max(shares, key=lambda name: shares[name])
    on_one = shares[axis] >= _AXIS_SHARE
    power = (power_d if axis == "d" else power_q) if on_one else power_d + power_q
    found = regions(left.seen, blocks, power, most=1)
    on = f"mostly on {axis}" if on_one else "on both axes"
    region: dict[str, float | str | tuple[float, float]] = {one.key: one.limits for one in found}
    if on_one:
        region["axis"] = axis
    if not found:
        return Place(f"{on}, at all speeds, currents and times", region, min(shares[axis], 1.0) if on_one else 1.0, 1.0)
    energy, samples = shares_together(found, power)
    where = " and ".join(one.words for one in found)
    sentence = f"{on} where {where} ({percent(energy)} of the energy in {percent(samples)} of the time)"
    return Place(sentence, region, energy, samples)


def warm_up() -> None:
    """Compile the kernels, or load them from the cache."""
    nothing = np.zeros(1, np.complex128)
    whiten_axes(nothing[None, :].copy(), nothing, np.ones(1, np.bool_), 1.0, POLE, POLE)


# --- The fit


def _start(balance: Array, estimates: Mapping[str, Estimate], T: float) -> tuple[Array, Bools]:
    """Values to begin with, 0 where there are none, and which of them are fitted."""
    beta = np.array([estimates[name].value or 0.0 for name in PARAMETERS])
    free = np.array([estimates[name].status is not Status.HELD for name in PARAMETERS])
    for k, name, i, x in ((1, "L_d", balance[:, 0], balance[:, 2]), (2, "L_q", balance[:, 1], balance[:, 3])):
        noise = float(np.median(np.abs(x))) * T / 0.6744898 / math.sqrt(2.0)  # or changes, if they are more
        free[k] &= float(np.std(i)) > (1.0 if estimates[name].status is Status.OK else _CURRENT_MOVES) * noise
    beta[1:3] = np.where(beta[1:3] > 0.0, beta[1:3], beta[2:0:-1])  # the other axis' stands in
    return beta, free


def _voltage_by_angle(columns: Vectors, beta: Array) -> Vector:
    """What an angle that is read low by a constant adds to the voltage, V/rad."""
    return -1j * ((beta[1] - beta[2]) * (columns[1] - columns[2]) + beta[3] * columns[3])


def _fit_free(white: Vectors, held: Array, beta: Array, free: Bools, step: float) -> tuple[Array, float]:
    """Least squares for the free parameters, and for an angle that is off by up to its sensor's step (rad)."""
    y = white[4] + of_h(beta) * white[5]
    for k in np.flatnonzero(~free):
        y -= held[k] * white[k]
    found = np.where(free, 0.0, held)
    used = np.flatnonzero(np.append(free, step > 0.0))
    places = np.where(used < 4, used, 6)
    value = least_squares(white[places], y)
    offset = float(value[-1]) if step > 0.0 else 0.0
    if abs(offset) > step:
        offset = math.copysign(step, offset)
        value = least_squares(white[places[:-1]], y - offset * white[6])
    found[free] = value[: int(np.count_nonzero(free))]
    return found, offset


# --- The noise


def _poles(beta: Array, columns: Vectors, one: Samples, axes: "tuple[_Spectrum, ...]") -> tuple[float, float]:
    """a of the filter, on d and q; on an axis that has no rows any does."""
    R_s, L_d, L_q, _ = beta.tolist()
    N, T, s2 = one.periods, one.T, _mean_square(columns[3].imag)
    poles = [POLE, POLE]
    for k, (L, other) in enumerate(((L_d, L_q), (L_q, L_d))):
        if L > LEAST_L and not (one.q_only and k == 0):
            q = (N - 1) / N**2 * ((R_s * T / L) ** 2 + s2 * (T * other / L) ** 2)
            if axes[k].level > 0.0:
                q += one.resolution.u**2 / 12.0 * (T / axes[k].level) ** 2
            pole = math.exp(-abs(R_s) * one.T_s / L) * (1.0 + 0.5 * q - math.sqrt(q + 0.25 * q * q))
            poles[k] = min(pole, _LONGEST)
    return poles[0], poles[1]


def _largest_step(theta_e: Array, turned: Array, joined: Bools) -> float:
    """The largest step (rad) in which the angle may have been told: as close as two of them are, and as uneven."""
    gaps = np.diff(np.sort(np.mod(theta_e, TURN)))
    gaps = gaps[gaps > ROUND_OFF]
    uneven: Array = np.diff(turned)[joined[1:] & joined[:-1]]
    if len(gaps) == 0 or len(uneven) == 0:
        return 0.0
    return min(float(gaps.min()), math.sqrt(2.0 * _mean_square(uneven)))


def _rounding_variance(
    beta: Array, columns: Vectors, step: float, T: float, poles: tuple[float, float]
) -> tuple[float, float]:
    """Variance (Vs^2) of the flux error, d and q, that an angle in steps (rad) leaves: at rows' ends and in means."""
    saliency, i, s = float(beta[1] - beta[2]), columns[0], columns[3].imag
    d = _mean_square(saliency * i.imag)  # Vs^2/rad^2
    q = _mean_square(float(beta[3]) + saliency * i.real)
    turn2, each = T**2 * _mean_square(s), _ROUNDING_ENERGY * step**2 / 12.0
    return each * (d + turn2 * q / (1.0 - poles[0] ** 2)), each * (q + turn2 * d / (1.0 - poles[1] ** 2))


@dataclass(frozen=True, slots=True, eq=False)
class _Spectrum:
    """A flux error's spectrum on one axis, in units of its white level."""

    power: Array  # of frequencies from the lowest to half the rate
    level: float  # Vs, of the white noise
    rounding: float  # summed, that an angle in steps may add
    edges: tuple[int, ...]  # of octaves
    deviates: Array  # standard normal, of octaves, in noise
    line: float  # and of the highest line

    @property
    def significance(self) -> float:
        """Of the octave or line that stands out most."""
        return max(float(self.deviates.max()), self.line)

    @property
    def ratio(self) -> float:
        """Energy over that of the white noise."""
        return float(self.power.mean())

    def excess(self, pole: float, T: float) -> float:
        """Mean square (V^2) of the voltage that stands above the noise."""
        n = len(self.power)
        above = np.zeros(n)
        for a, b, deviate in zip(self.edges, self.edges[1:], self.deviates, strict=False):
            if deviate > GONE * SURE_SIGMAS:
                energy = float(self.power[a:b].sum())
                above[a:b] = (self.power[a:b] - 1.0) * max(1.0 - self.rounding / energy, 0.0)
        if self.line > GONE * SURE_SIGMAS:
            k = int(np.argmax(self.power))
            above[k] = self.power[k] - 1.0 - self.rounding
        turn = np.abs(1.0 - pole * np.exp(-1j * math.pi * np.arange(1, n + 1) / n)) ** 2
        return max(float(np.mean(above * turn)), 0.0) * (self.level / T) ** 2


def _spectrum_of(x: Array, rounded: float) -> _Spectrum:
    power = np.abs(np.fft.rfft(x)[1:]) ** 2 / len(x)
    n = len(power)
    white = max(float(np.median(power)) / math.log(2.0), 1e-300)
    power /= white
    rounding = n * rounded / white
    edges = (0, *(2**j for j in range(1, (n - 1).bit_length())), n)
    if edges[-1] - edges[-2] < edges[-2] // 4:
        edges = (*edges[:-2], n)
    counts: Array = np.diff(edges).astype(np.float64)
    means = np.maximum(np.add.reduceat(power, edges[:-1]) - rounding, 0.0) / counts
    line = math.sqrt(2.0 * max((float(power.max()) - rounding) / _COLOUR - math.log(n), 0.0))
    return _Spectrum(power, math.sqrt(white), rounding, edges, _deviates(means / _COLOUR, counts, n), line)


def _deviates(means: Array, counts: Array, all_of_them: int) -> Array:
    """Standard normal deviates of means over so many frequencies, of two degrees of freedom each."""
    a, b, root = 1.0 / (9.0 * counts), 1.0 / (9.0 * all_of_them), np.cbrt(means)
    return ((1.0 - b) * root - (1.0 - a)) / np.sqrt(b * root**2 + a)


def _moves(columns: Vectors, beta: Array, one: Samples, axes: tuple[_Spectrum, ...]) -> bool:
    i, s = columns[0], columns[3].imag
    for current, L, axis in zip((i.real, i.imag), beta[1:3].tolist(), axes, strict=True):
        noise = axis.level / abs(L) / math.sqrt(one.periods) if L != 0.0 else math.inf
        if float(np.std(current)) > max(_CURRENT_MOVES * noise, 2.0 * one.resolution.i):
            return True
    return float(np.std(s)) > _SPEED_MOVES * math.sqrt(_mean_square(s))


def _least_voltage(columns: Vectors, beta: Array, one: Samples) -> float:
    """Voltage (V) that matters: of the applied one, and no less than the records resolve."""
    u = columns[4]
    u_rms = math.sqrt(_mean_square(u.real) + _mean_square(u.imag))
    return max(LEAST * u_rms, one.resolution.u, float(np.max(np.abs(beta[1:3]))) * one.resolution.i / one.T)


def _mean_square(x: Array) -> float:
    return float(np.mean(x**2))


# --- The place


def _seen(balance: Array, D: Array, runs: Sequence[Samples], beta: Array) -> Rows:
    """Mean currents, angle, speed and time in the middle of each row."""
    one = runs[0]
    theta: Array = np.concatenate([run.theta_e[:-1] for run in runs])
    t: Array = np.concatenate([run.t0 + run.T * np.arange(0.5, len(run) - 1, dtype=np.float64) for run in runs])
    turned = one.periods * D
    R_s, L_d, L_q, psi_f = beta.tolist()
    i: Vector = balance[:, 0] + 1j * balance[:, 1]
    rated = float(np.max(np.abs(i)))
    return Rows(
        Machine(R_s, L_d, L_q, psi_f, 1), one.T, rated, t, i, theta + 0.5 * turned, np.exp(0.5j * turned),
        i, np.ones(len(i), np.bool_), None, None, np.zeros(len(i)), (float(t[0]), float(t[-1] - t[0])),
    ).knowing({Rows.D: turned})  # fmt: skip


def _mean_voltages(left: Left) -> tuple[Means, Array, Array]:
    """Mean voltages over as few rows as show the mismatch, and their energies above noise (V^2) on d and q."""
    best: tuple[float, tuple[Means, Array, Array]] | None = None
    for m in (1, 3, 10):
        n = len(left.v) // m * m
        v: Vector = left.v[:n].reshape(-1, m).mean(axis=1)
        d2, q2 = (2.0 * (flux / (m * left.seen.T_s)) ** 2 for flux in left.noise)
        power_d, power_q = v.real**2 - d2, v.imag**2 - q2
        plain = float((power_d + power_q).sum()) / max(math.sqrt(2.0 * len(v)) * (d2 + q2), 1e-300)
        if best is None or plain > best[0]:
            best = plain, (Means(v, np.arange(m // 2, n, m), m), power_d, power_q)
        if plain > _PLAIN_SIGMAS:
            break
    assert best is not None
    return best[1]
