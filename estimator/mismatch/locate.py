"""Locate: the smallest region that holds most of a mismatch, and what a mismatch without a name looks like.

Regions are ranges of what a bench engineer can read off - speed, current, time, the distance of a phase current to its
change of sign - or a line of a spectrum, or an order of the rotor's turning. Knows nothing of effects.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.flux_balance import TURN
from estimator.mismatch.angle_rounding import flux_of_rounding
from estimator.mismatch.averages import Array, Means, means, noise_of_means, usual_periods, voltage_of
from estimator.mismatch.forms import Resonance, TwoLevels, degrees, resonance, two_levels
from estimator.mismatch.spectra import Line, energy_of_orders, strongest_line, white_level
from estimator.mismatch.verdict import Place, Unexplained
from estimator.physics.rows import Rows, Vector

MOST: Final = 0.7  # of the energy, that a region must hold
_BINS: Final = 24
_ONE_AXIS: Final = 0.9
_WORTH: Final = 0.25  # nat that a condition must tell
_SECOND: Final = 0.35  # nat that a second one must add
_LINE_SHARE: Final = 0.05  # of the rows, that a line of a spectrum counts as
_LEAST_V: Final = 5e-4  # of the voltage's rms: what the twin itself may miss
_EXCESS: Final = 0.02  # of the noise's energy
_FORM: Final = 0.5  # of the excess, that a form must explain to name it

Regions = dict[str, float | str | tuple[float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class _Condition:
    """A range of one quantity."""

    key: str
    bins: NDArray[np.intp]  # of each block
    edges: Array  # of bins, SI
    low: int
    high: int  # exclusive
    energy: float  # share
    samples: float  # share

    @property
    def worth(self) -> float:
        return _worth(self.energy, self.samples)


def _worth(energy: float, samples: float) -> float:
    """What a region tells of where the energy is, nat: that of a distribution over inside and outside."""
    e, s = min(max(energy, 1e-9), 1.0 - 1e-6), min(max(samples, 1e-9), 1.0 - 1e-9)
    return e * math.log(e / s) + (1.0 - e) * math.log((1.0 - e) / (1.0 - s)) if e > s else 0.0


def place_of(rows: Rows, signal: Vector, noise: tuple[float, float]) -> Place:
    """The smallest region that holds most of the energy above noise of a flux error (Vs, rotor frame).

    noise: its white standard deviation (Vs) on d and q; zero for what an effect alone makes.
    """
    blocks, power, sigma = _blocks(rows, signal, noise)
    total = float(power.sum())
    if len(power) < 4 or not total > 0.0:
        return Place("nowhere in particular: nothing stands above the noise", {}, 0.0, 1.0)
    axis, power, share = _axis(blocks, power, sigma)
    found = _regions(rows, blocks, power)
    spectral = _spectral(rows, signal, noise)
    energy, samples = _together(found, power) if found else (1.0, 1.0)
    if spectral is not None and _worth(spectral.energy_share, _LINE_SHARE) > _worth(energy, samples):
        return spectral
    region: Regions = {} if axis is None else {"axis": axis}
    on = "" if axis is None else f"on the {axis} axis, "
    for c in found:
        region[c.key] = _range(c)
    if not found:
        words = f"{on}at all speeds, currents and times" if axis else "at all speeds, currents and times, on both axes"
        return Place(words, region, share, 1.0)
    where = " and ".join(_words(c) for c in found)
    words = f"{on}where {where}: {_percent(samples)} of the samples hold {_percent(energy * share)} of the energy"
    return Place(words, region, energy * share, samples)


# --- Blocks


def _blocks(rows: Rows, signal: Vector, noise: tuple[float, float]) -> tuple[Means, Array, tuple[float, float]]:
    """Mean voltages over as few periods as show the signal, and their energy above noise (V^2)."""
    v = voltage_of(rows, signal)
    best: tuple[float, Means, Array, tuple[float, float]] | None = None
    for m in (1,) if not any(noise) else (1, 3, usual_periods(rows), 3 * usual_periods(rows)):
        blocks, sigma = means(rows, v, m), noise_of_means(rows, noise, m)
        power = np.abs(blocks.v) ** 2 - sigma[0] ** 2 - sigma[1] ** 2
        sure = float(power.sum()) / max(math.sqrt(len(power)) * (sigma[0] ** 2 + sigma[1] ** 2), 1e-300)
        if best is None or sure > 1.5 * best[0]:
            best = sure, blocks, power, sigma
    assert best is not None
    return best[1:]


def _axis(blocks: Means, power: Array, sigma: tuple[float, float]) -> tuple[str | None, Array, float]:
    """The axis that holds nearly all, the energy on it, and its share."""
    on_d, on_q = blocks.v.real**2 - sigma[0] ** 2, blocks.v.imag**2 - sigma[1] ** 2
    total = float(power.sum())
    for name, part in (("d", on_d), ("q", on_q)):
        share = float(part.sum()) / total
        if share >= _ONE_AXIS:
            return name, part, min(share, 1.0)
    return None, power, 1.0


# --- Ranges


def _regions(rows: Rows, blocks: Means, power: Array) -> list[_Condition]:
    """The best one or two ranges."""
    singles = [c for c in (_single(key, x, power) for key, x in _quantities(rows, blocks).items()) if c is not None]
    if not singles:
        return []
    singles.sort(key=lambda c: -c.worth)
    best = singles[:1]
    if singles[0].worth < _WORTH:
        best = []
    start = best[0].worth if best else _WORTH
    for n, one in enumerate(singles[:6]):
        for other in singles[n + 1 : 6]:
            pair = _pair(one, other, power)
            if pair is None:
                continue
            worth = _worth(*_together(pair, power))
            if worth > max(start + _SECOND, _worth(*_together(best, power)) if len(best) == 2 else 0.0):
                best = list(pair)
    return best


def _quantities(rows: Rows, blocks: Means) -> dict[str, Array]:
    at = blocks.at
    i = rows.i[at]
    currents = np.abs([rows.phase(k)[at] for k in range(3)])
    return {
        "zero_crossing": currents.min(axis=0),
        "i_q": i.imag,
        "i_d": i.real,
        "current": np.abs(i),
        "speed": rows.omega_e[np.minimum(at, len(rows) - 1)],
        "time": rows.t[at],
    }


def _single(key: str, x: Array, power: Array) -> _Condition | None:
    """The range of one quantity that tells most."""
    edges = np.unique(np.quantile(x[:: max(1, len(x) // 4096)], np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 3:
        return None
    edges[0], edges[-1] = min(edges[0], x.min()), max(edges[-1], x.max())
    bins = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    n = len(edges) - 1
    energy, samples = _shares(np.bincount(bins, power, n)), _shares(np.bincount(bins, minlength=n).astype(float))
    low, high = np.triu_indices(n + 1, 1)
    if key == "zero_crossing":
        low, high = low[low == 0], high[low == 0]
    e, s = energy[high] - energy[low], samples[high] - samples[low]
    worth = np.array([_worth(a, b) if a >= MOST else 0.0 for a, b in zip(e, s, strict=True)])
    k = int(np.argmax(worth))
    return _Condition(key, bins, edges, int(low[k]), int(high[k]), float(min(e[k], 1.0)), float(s[k]))


def _shares(x: Array) -> Array:
    total = np.concatenate((np.zeros(1), np.cumsum(x)))
    return total / total[-1]


def _pair(one: _Condition, other: _Condition, power: Array) -> tuple[_Condition, _Condition] | None:
    """The rectangle of two quantities that tells most."""
    nx, ny = len(one.edges) - 1, len(other.edges) - 1
    flat = one.bins * ny + other.bins
    tables = [
        np.pad(np.bincount(flat, w, nx * ny).reshape(nx, ny).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        for w in (power, None)
    ]
    x0, x1 = np.triu_indices(nx + 1, 1)
    y0, y1 = np.triu_indices(ny + 1, 1)
    if one.key == "zero_crossing":
        x0, x1 = x0[x0 == 0], x1[x0 == 0]
    if other.key == "zero_crossing":
        y0, y1 = y0[y0 == 0], y1[y0 == 0]
    e, s = (
        (t[np.ix_(x1, y1)] - t[np.ix_(x0, y1)] - t[np.ix_(x1, y0)] + t[np.ix_(x0, y0)]) / t[-1, -1] for t in tables
    )
    e, s = np.clip(e, 1e-9, 1.0 - 1e-6), np.clip(s, 1e-9, 1.0 - 1e-9)
    worth = np.where((e >= MOST) & (e > s), e * np.log(e / s) + (1.0 - e) * np.log((1.0 - e) / (1.0 - s)), 0.0)
    a, b = np.unravel_index(int(np.argmax(worth)), worth.shape)
    if not worth[a, b] > 0.0:
        return None
    return (
        _Condition(one.key, one.bins, one.edges, int(x0[a]), int(x1[a]), float(e[a, b]), float(s[a, b])),
        _Condition(other.key, other.bins, other.edges, int(y0[b]), int(y1[b]), float(e[a, b]), float(s[a, b])),
    )


def _together(found: Sequence[_Condition], power: Array) -> tuple[float, float]:
    """Shares of energy and samples where all hold."""
    inside = np.ones(len(power), np.bool_)
    for c in found:
        inside &= (c.bins >= c.low) & (c.bins < c.high)
    return min(float(power[inside].sum() / power.sum()), 1.0), float(inside.mean())


# --- Lines and orders


def _spectral(rows: Rows, signal: Vector, noise: tuple[float, float]) -> Place | None:
    """The line or the order that holds most of a flux error, where one does."""
    total = float(np.sum(np.abs(signal) ** 2)) - len(signal) * (noise[0] ** 2 + noise[1] ** 2)
    if not total > 0.0:
        return None
    found: list[tuple[float, Place]] = []
    n_p = rows.machine.n_p
    for key, base, orders in (
        ("electrical_order", 1.0, np.arange(1.0, 13.0)),
        ("mechanical_order", 1.0 / n_p, np.array([k for k in range(1, 3 * n_p + 1) if k % n_p], float)),
    ):
        if len(orders) == 0:
            continue
        energy, count = energy_of_orders(rows, signal, np.concatenate((orders, -orders)) * base, 1.0 / base)
        noise_part = (noise[0] ** 2 + noise[1] ** 2) * len(signal) / count if count else 0.0
        both = (energy[: len(orders)] + energy[len(orders) :] - 2.0 * noise_part) / total
        k = int(np.argmax(both))
        share = min(float(both[k]), 1.0)
        if share >= MOST:
            order = int(orders[k])
            turn = "electrical" if key == "electrical_order" else "mechanical"
            words = f"at order {order} of the {turn} turn, in the rotor frame: this order holds {_percent(share)} of the energy"
            found.append((share, Place(words, {key: order, "frame": "rotor"}, share, 1.0)))
    for frame in ("stationary", "rotor"):
        line = strongest_line(rows, signal * rows.rotor[1:] if frame == "stationary" else signal, 2.0, 0.45 / rows.T_s)
        if line is not None and line.gain >= MOST * total:
            place = _place_of_line(line, frame, line.gain / total)
            found.append((1.02 * place.energy_share, place))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _place_of_line(line: Line, frame: str, share: float) -> Place:
    share = min(share, 1.0)
    words = f"at {_number(line.frequency)} Hz in the {frame} frame: this line holds {_percent(share)} of the energy"
    return Place(words, {"frequency": line.frequency, "frame": frame}, share, 1.0)


# --- What has no name


def describe(rows: Rows, z: Vector, noise: tuple[float, float]) -> Unexplained | None:
    """What a residual flux error (Vs, rotor frame) with white noise holds; None where nothing stands above that."""
    rounded, hidden = flux_of_rounding(rows)
    z = np.where(rows.joined, z - rounded, 0j)
    noise = min(noise[0], white_level(z.real)), min(noise[1], white_level(z.imag))
    floor = len(z) * (noise[0] ** 2 + noise[1] ** 2)
    excess = float(np.sum(np.abs(z) ** 2)) - floor
    m = usual_periods(rows)
    sigma = noise_of_means(rows, noise, m)
    blocks = means(rows, voltage_of(rows, z), m)
    rms_V = math.sqrt(max(float(np.mean(np.abs(blocks.v) ** 2)) - sigma[0] ** 2 - sigma[1] ** 2, 0.0))
    u = math.sqrt(float(np.mean(np.abs(rows.u) ** 2)))
    ringing = resonance(rows, z, noise)
    if (excess < _EXCESS * floor + 2.0 * hidden or rms_V < _LEAST_V * u) and ringing is None:
        return None
    line = strongest_line(rows, z * rows.rotor[1:], 2.0, 0.45 / rows.T_s)
    levels = [two_levels(rows, z, frame) for frame in ("stationary", "rotor")]
    forms: list[Line | TwoLevels | Resonance] = [f for f in (line, ringing, *levels) if f is not None]
    best = max(forms, key=lambda f: f.gain, default=None)
    if best is not None and best.gain >= _FORM * excess:
        words, place = _said(rows, best, min(best.gain / excess, 1.0))
        if isinstance(best, Line):
            rms_V = max(rms_V, math.sqrt(abs(best.forth) ** 2 + abs(best.back) ** 2))
    else:
        place = place_of(rows, z, noise)
        words = f"a voltage of {_number(rms_V)} V rms {place.sentence}"
    return Unexplained(rms_V, place, words)


def _said(rows: Rows, form: Line | TwoLevels | Resonance, share: float) -> tuple[str, Place]:
    """A form in words, and where it is. Voltages are those on the machine beside the recorded one."""
    if isinstance(form, Line):
        along = f"along {degrees(form.direction):.0f} deg from phase a" if form.narrow < 0.3 else "turning"
        words = f"a {_number(form.frequency)} Hz voltage of {_number(form.amplitude)} V fixed in the stationary frame, {along}"
        place = _place_of_line(form, "stationary", share)
        if form.narrow < 0.3:
            place = Place(place.sentence, {**place.region, "direction": form.direction}, share, 1.0)
        return words, place
    if isinstance(form, Resonance):
        words = f"a resonance near {_number(form.frequency / 1e3, 2)} kHz: a current beside the machine's that follows the voltage"
        where = f"near {_number(form.frequency / 1e3, 2)} kHz in the stationary frame, following the voltage: this holds {_percent(share)} of the energy"
        return words, Place(where, {"frequency": form.frequency, "frame": "stationary"}, share, 1.0)
    volts, direction = _number(abs(form.step)), cmath.phase(-form.step)
    region: Regions = {"frame": form.frame, "direction": direction}
    along = f"along {degrees(direction):.0f} deg of the {form.frame} frame"
    if len(form.changes) == 1:
        t = float(form.changes[0])
        region["time"] = (t, float(rows.t[-1]))
        words = f"a step of {volts} V at {_number(t)} s, {along}"
        return words, Place(f"from {_number(t)} s on, {along}", region, share, form.share)
    region["time"] = (float(form.starts[0]), float(form.starts[-1] + form.lengths[-1]))
    words = (
        f"a voltage of {volts} V {along} that comes and goes, {len(form.starts)} times, for "
        f"{_number(1e3 * float(np.mean(form.lengths)), 2)} ms on average"
    )
    where = f"{along}, while it is there: {_percent(form.share)} of the samples; it holds {_percent(share)} of the energy"
    return words, Place(where, region, share, form.share)


# --- Words


def _number(x: float, digits: int = 3) -> str:
    """Without an exponent where an engineer would write none."""
    if x == 0.0 or not math.isfinite(x):
        return f"{x:g}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(x))))
    return f"{x:.{places}f}" if 1e-4 <= abs(x) < 1e6 else f"{x:.{digits - 1}e}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.995 else "all"


def _range(c: _Condition) -> tuple[float, float]:
    low, high = float(c.edges[c.low]), float(c.edges[c.high])
    return (0.0, high) if c.key == "zero_crossing" else (low, high)


def _words(c: _Condition) -> str:
    low, high = _range(c)
    name, unit, scale = {
        "zero_crossing": ("a phase current", "A", 1.0),
        "i_q": ("i_q", "A", 1.0),
        "i_d": ("i_d", "A", 1.0),
        "current": ("the current", "A", 1.0),
        "speed": ("the electrical speed", "Hz", 1.0 / TURN),
        "time": ("the time", "s", 1.0),
    }[c.key]
    if c.key == "zero_crossing":
        return f"a phase current is within {_number(high, 2)} A of changing sign"
    first, last = c.low == 0, c.high == len(c.edges) - 1
    a, b = _number(low * scale), _number(high * scale)
    if first and not last:
        return f"{name} is below {b} {unit}"
    if last and not first:
        return f"{name} is above {a} {unit}"
    return f"{name} is between {a} and {b} {unit}"
