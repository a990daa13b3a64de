"""Pictures of a mismatch before and after: series in time, a short window, spectra and maps, small enough for a report.

Shows mean voltages over several periods, as single ones show the noise of the current rather than the mismatch.
Knows nothing of effects, nor of how a picture is drawn.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.averages import Means, means, usual_periods
from estimator.diagnosis.verdict import Map, Traces
from estimator.diagnosis.where.spectra import welch
from estimator.physics.rows import Rows

_PICTURE_BINS: Final = 300
_WINDOW: Final = 400  # periods
_WELCH_PERIODS: Final = 1024  # periods of a spectrum
_CELLS: Final = 24  # of a map, either way
_LEAST_MEANS: Final = 3  # means in a cell


def traces(
    rows: Rows, r_before: Vector, r_after: Vector, i_before: Vector, i_after: Vector,
    floor: Callable[[int], float] | None = None,
) -> Traces:  # fmt: skip
    """What to draw of residual voltages (V of each period) and free-running currents (A at samples, or NaN).

    `floor`: what noise alone leaves (V rms) of means over so many periods.
    """
    m, n = usual_periods(rows), min(_WELCH_PERIODS, len(rows))
    before, after = means(rows, r_before, m), means(rows, r_after, m)
    edges = np.linspace(float(rows.t[0]), float(rows.t[-1]), min(_PICTURE_BINS, max(1, len(before.v))) + 1)
    window = _window(rows, before)
    now = slice(window.start, window.stop + 1)
    return Traces(
        t=0.5 * (edges[:-1] + edges[1:]),
        before_V=_rms_in_bins(rows.t[before.at], edges, before.v),
        after_V=_rms_in_bins(rows.t[after.at], edges, after.v),
        window_t=rows.t[window],
        window={
            "u_d": (_smoothed(r_before, window, m).real, _smoothed(r_after, window, m).real),
            "u_q": (_smoothed(r_before, window, m).imag, _smoothed(r_after, window, m).imag),
        },
        window_i={
            "i_d": (rows.i[now].real[:-1], i_before[now].real[:-1], i_after[now].real[:-1]),
            "i_q": (rows.i[now].imag[:-1], i_before[now].imag[:-1], i_after[now].imag[:-1]),
        },
        frequency=np.arange(n // 2 + 1) / (n * rows.T_s),
        spectrum=(_amplitude_density(rows, r_before), _amplitude_density(rows, r_after)),
        maps=_maps(rows, before, after),
        periods=m,
        floor_V=None if floor is None else floor(m),
    )


def _rms_in_bins(x: Array, edges: Array, v: Vector) -> Array:
    """Root mean square in bins; NaN where there is nothing."""
    count = np.histogram(x, edges)[0]
    total = np.histogram(x, edges, weights=np.abs(v) ** 2)[0]
    return np.sqrt(np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0))


def _window(rows: Rows, before: Means) -> slice:
    """The periods of the short stretch that holds most of the mismatch."""
    n = min(_WINDOW, len(rows))
    energy = np.zeros(len(rows) + 1)
    energy[1:][before.at] = np.abs(before.v) ** 2
    total = np.cumsum(energy)
    start = int(np.argmax(total[n:] - total[: len(total) - n]))
    return slice(start, start + n)


def _smoothed(r: Vector, window: slice, m: int) -> Vector:
    """Moving mean over m periods, or over as many of them as there are."""
    near = slice(max(window.start - m, 0), window.stop + m)
    ones = np.ones(m)
    count: Array = np.convolve(np.ones(len(r[near])), ones)
    mean = np.convolve(r[near], ones).astype(np.complex128) / count
    return mean[window.start - near.start + m // 2 :][: window.stop - window.start]


def _amplitude_density(rows: Rows, r: Vector) -> Array:
    """Amplitude density (V/sqrt(Hz)) of d and q together, one-sided, by Welch's method."""
    power = welch(r, _WELCH_PERIODS, off_mean=True)
    both_ways = power + np.roll(power[::-1], 1)
    return np.sqrt(both_ways[: len(power) // 2 + 1] * rows.T_s)


def _maps(rows: Rows, before: Means, after: Means) -> tuple[Map, ...]:
    at = before.at
    i, t = rows.i[at], rows.t[at]
    rpm = rows.omega_e[np.minimum(at, len(rows) - 1)] / rows.machine.n_p * 60.0 / (2.0 * np.pi)
    angle = np.degrees(np.mod(rows.theta_e[at], 2.0 * np.pi))
    smallest = np.min(np.abs([rows.phase(k)[at] for k in range(3)]), axis=0)
    return (
        _map("speed (rpm)", rpm, "i_q (A)", i.imag, before, after),
        _map("i_d (A)", i.real, "i_q (A)", i.imag, before, after),
        _map("electrical angle (deg)", angle, "smallest phase current (A)", smallest, before, after),
        _map("time (s)", t, "speed (rpm)", rpm, before, after),
    )


def _edges(x: Array) -> Array:
    low, high = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
    room = max(1e-3 * abs(high), 1e-6) if high - low < 1e-6 * max(abs(high), 1e-9) else 0.0
    return np.linspace(low - room, high + room, _CELLS + 1)


def _map(x: str, of_x: Array, y: str, of_y: Array, before: Means, after: Means) -> Map:
    x_edges, y_edges = _edges(of_x), _edges(of_y)
    count = np.histogram2d(of_y, of_x, (y_edges, x_edges))[0]

    def rms(v: Vector) -> Array:
        total = np.histogram2d(of_y, of_x, (y_edges, x_edges), weights=np.abs(v) ** 2)[0]
        return np.sqrt(np.divide(total, count, out=np.full(count.shape, np.nan), where=count >= _LEAST_MEANS))

    return Map(x, y, x_edges, y_edges, rms(before.v), rms(after.v))
