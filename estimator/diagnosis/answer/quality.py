"""How well a model follows a recording, before and after: one step ahead, free-running, and how white the rest is.

Every figure stands beside its noise floor. With noise n of the sampled currents, white, of flux L n known as `noise`,
and rho = exp(-R_s T_s / L), what is left of

    a period's voltage      exp(jD/2) L n[k+1] - rho exp(-jD/2) L n[k], over T_s        (1 + rho^2) |L n|^2 / T_s^2
    a free run's current    n[k] - rho^k n[0], k periods after its start                (1 + rho^2k) |n|^2

A model's effects see the noise, too: a bent flux linkage makes more volts of it at some currents than at others. By how
much louder it is with them, noise that is laid over the currents tells. No floor is above what is left. Rms values are
of d and q together, over 2 N numbers. Knows nothing of how a model was found.
"""

import math
from typing import Final

import numpy as np

from estimator.arrays import Array, Bools, Vector, stretches
from estimator.diagnosis.likelihood.noise import Noise, flux_errors
from estimator.diagnosis.likelihood.thinning import thinned
from estimator.diagnosis.verdict import ErrorChange, Fit
from estimator.physics.rows import Rows
from estimator.twin.currents import WINDOW, implied_voltage
from estimator.twin.model import Model, residual

SHORTEST: Final = 16
"""Periods that the longest stretch must have."""
_SEGMENTS: Final = (64, 32, SHORTEST)  # periods, of spectra: the longest that there are
_NOISE_BLOCKS: Final = (8_000, 16)  # periods and blocks of them, over which noise is laid
_LOW: Final = 0.1  # of the sampling rate
_UPPER_BAND: Final = 0.25


def fit_quality(
    rows: Rows, before: Model, after: Model, runs: tuple[Vector, Vector], held_out: Bools, noise: Noise
) -> Fit:
    """Both models, with their free-running currents, on the periods that are `held_out`.

    One stretch of them at least is `SHORTEST` periods long.
    """
    used = held_out & rows.joined
    both = [_measured(rows, model, i, used, after, noise) for model, i in zip((before, after), runs, strict=True)]
    (step_0, run_0, above_0, low_0), (step_1, run_1, above_1, low_1) = both
    floor_V, floor_A = _floors(rows, after, noise)
    floor_V, floor_A = min(floor_V, step_0, step_1), min(floor_A, run_0, run_1)
    explained = min(max(1.0 - above_1 / above_0, 0.0), 1.0) if above_0 > 0.0 else 0.0
    one_step, free_run = ErrorChange(step_0, step_1, floor_V), ErrorChange(run_0, run_1, floor_A)
    return Fit(not bool(np.all(held_out)), one_step, free_run, explained, ErrorChange(low_0, low_1, 1.0))


def _measured(
    rows: Rows, model: Model, i: Vector, used: Bools, after: Model, noise: Noise
) -> tuple[float, float, float, float]:
    """Rms of what is left one step ahead (V) and free-running (A), its power above the noise, its low frequencies'."""
    left = rows.u - implied_voltage(rows, model)
    off = (i - rows.i)[1:]
    z = flux_errors(left, rows, after)
    z = z.real / noise[0] + 1j * (z.imag / noise[1])
    above = max(float(np.mean(np.abs(z[used]) ** 2)) - 2.0, 0.0)
    return rms(left[used]), rms(off[used]), above, _low_over_white(z, used)


def rms(x: Vector) -> float:
    """Of one axis, as of d and q together."""
    return math.sqrt(float(np.mean(np.abs(x) ** 2)) / 2.0)


def longest(used: Bools) -> int:
    """Periods of the longest stretch."""
    return max((b - a for a, b in stretches(used)), default=0)


def _low_over_white(z: Vector, used: Bools) -> float:
    """Power below a tenth of the sampling rate, over that of white noise of the power above a quarter of it."""
    size = next(size for size in _SEGMENTS if size <= longest(used))
    whole = [z[a : b - (b - a) % size].reshape(-1, size) for a, b in stretches(used)]
    parts: Vector = np.concatenate(whole) * np.hanning(size)
    frequency = np.abs(np.fft.fftfreq(size))

    def ratio(x: Array) -> float:
        power: Array = np.mean(np.abs(np.fft.fft(x, axis=1)) ** 2, axis=0)
        return float(np.mean(power[frequency < _LOW]) / np.mean(power[frequency > _UPPER_BAND]))

    return 0.5 * (ratio(parts.real) + ratio(parts.imag))


def floor_of_means(rows: Rows, model: Model, noise: Noise, periods: int) -> float:
    """Rms of the length (V, d and q together) that noise alone leaves of voltages averaged over m periods.

    Only the ends of a mean keep their noise whole; in between, (1 - rho) of it is left:

        (1 + rho^2 + (m - 1) (1 - rho)^2) |L n|^2 / (m T_s)^2
    """
    machine, m = model.machine, periods
    rho = math.exp(-2.0 * machine.R_s * rows.T_s / (machine.L_d + machine.L_q))
    left = 1.0 + rho**2 + (m - 1) * (1.0 - rho) ** 2
    return math.sqrt(left * _flux_noise(rows, model, noise)) / (m * rows.T_s)


def _flux_noise(rows: Rows, model: Model, noise: Noise) -> float:
    """Mean |L n|^2 of d and q together, Vs^2."""
    m = model.machine
    psi_d, psi_q, _ = noise
    if model.bend is None:
        return psi_d**2 + psi_q**2
    dd, qq, dq = model.bend.inductances(m, rows.i)
    by_d, by_q = float(np.mean(dd**2 + dq**2)), float(np.mean(qq**2 + dq**2))
    return (psi_d / m.L_d) ** 2 * by_d + (psi_q / m.L_q) ** 2 * by_q


def _floors(rows: Rows, model: Model, noise: Noise) -> tuple[float, float]:
    """Rms (V, A) that noise alone leaves one step ahead and in free runs."""
    m, T_s = model.machine, rows.T_s
    decay = math.exp(-4.0 * m.R_s * T_s / (m.L_d + m.L_q))  # rho^2
    psi_d, psi_q, _ = noise
    window = round(WINDOW / T_s)
    starts = (decay - decay**window) / (1.0 - decay) / window  # mean of rho^2k within a window
    amperes = math.sqrt((1.0 + starts) * ((psi_d / m.L_d) ** 2 + (psi_q / m.L_q) ** 2) / 2.0)
    return _louder(rows, model, noise) * floor_of_means(rows, model, noise, 1) / math.sqrt(2.0), amperes


def _louder(rows: Rows, model: Model, noise: Noise) -> float:
    """Rms of the voltage that noise of the currents makes with a model's effects, over that of the machine alone."""
    if not model.effects:
        return 1.0
    rows = thinned(rows, *_NOISE_BLOCKS)
    m, n, chance = model.machine, len(rows) + 1, np.random.default_rng(0)
    each = noise[0] / m.L_d * chance.standard_normal(n) + 1j * noise[1] / m.L_q * chance.standard_normal(n)
    noisy = rows.with_currents(rows.i + each)
    left = residual(rows, rows, model)
    with_them, alone = residual(noisy, noisy, model) - left, residual(noisy, rows, model) - left
    return rms(with_them[rows.joined]) / rms(alone[rows.joined])
