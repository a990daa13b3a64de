"""Place: the smallest region that holds most of a mismatch.

Regions are ranges of what a bench engineer can read off - speed, current, time, the distance of a phase current to its
change of sign - or a line of a spectrum, or an order of the rotor's turning. Knows nothing of effects.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.averages import Means, energy_of, means, noise_of_means, usual_periods, voltage_of
from estimator.diagnosis.likelihood.thinning import GOLDEN
from estimator.diagnosis.verdict import Place
from estimator.diagnosis.where.regions import REGION_SHARE, regions, shares_together, worth
from estimator.diagnosis.where.spectra import Line, energy_of_orders, noise_of_orders, strongest_line
from estimator.diagnosis.words import number, percent
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES

_PHASE_NAMES: Final = ("a", "b", "c")
_ALONG_ONE: Final = 0.9  # of the energy
_PLACE_PERIODS: Final = 60_000  # periods, that say where an effect acts
_PLAIN_ENERGY: Final = 50.0  # standard errors of the noise's energy, at which a signal needs no longer means
_LINE_ENERGY: Final = 0.5  # of the energy, that a line or an order must hold where no range holds more
_LINE_SHARE: Final = 0.05  # of the rows, that a line of a spectrum counts as
_ELECTRICAL_ORDERS: Final = 12  # of the electrical turn
_MECHANICAL_TURNS: Final = 3  # electrical, up to which orders of the mechanical turn go
SLOWEST: Final = 2.0  # Hz
FASTEST: Final = 0.45  # of the sampling rate
STRAIGHT: Final = 0.3  # of an ellipse's long axis, that its short one may have
Region = dict[str, float | str | tuple[float, float]]


def place_of(rows: Rows, signal: Vector, noise: tuple[float, float]) -> Place:
    """The smallest region that holds most of the energy above noise of a flux error (Vs, rotor frame).

    noise: its white standard deviation (Vs) on d and q; zero for what an effect alone makes.
    """
    blocks, power, sigma = _telling_blocks(rows, signal, noise)
    if len(power) < 4 or not power.sum() > 0.0:
        return Place("nowhere in particular: nothing stands above the noise", {}, 0.0, 1.0)
    axis, power, share = _axis_along(rows, blocks, power, sigma)
    found = regions(rows, blocks, power)
    energy, samples = shares_together(found, power)
    spectral = _spectral(rows, signal, noise)
    if spectral is not None:
        held = spectral.energy_share
        if not found or (held >= REGION_SHARE and worth(held, _LINE_SHARE) > worth(energy, samples)):
            return spectral
    region: Region = {one.key: one.limits for one in found}
    on = ""
    if axis is not None:
        region["phase" if axis in _PHASE_NAMES else "axis"] = axis
        on = f"along phase {axis}, " if axis in _PHASE_NAMES else f"on the {axis} axis, "
    if not found:
        return Place(f"{on}at all speeds, currents and times", region, share, 1.0)
    where = " and ".join(one.words for one in found)
    energy *= share
    sentence = f"{on}where {where}: {percent(samples)} of the samples hold {percent(energy)} of the energy"
    return Place(sentence, region, energy, samples)


def _telling_blocks(rows: Rows, signal: Vector, noise: tuple[float, float]) -> tuple[Means, Array, tuple[float, float]]:
    """Mean voltages over as few periods as show the signal, their energy above noise (V^2), and the noise (V)."""
    v = voltage_of(rows, signal)
    usual = usual_periods(rows)
    found: list[tuple[float, tuple[Means, Array, tuple[float, float]]]] = []
    for m in (1, 3, usual, 3 * usual):
        blocks, sigma = means(rows, v, m), noise_of_means(rows, noise, m)
        variance = sigma[0] ** 2 + sigma[1] ** 2
        power = np.abs(blocks.v) ** 2 - variance
        found.append((float(power.sum()) / max(math.sqrt(len(power)) * variance, 1e-300), (blocks, power, sigma)))
        if found[-1][0] > _PLAIN_ENERGY:
            break
    blocks, power, sigma = max(found, key=lambda pair: pair[0])[1]
    if noise == (0.0, 0.0) and len(power) > _PLACE_PERIODS:  # an effect acts all over a long recording
        part = np.arange(_PLACE_PERIODS)
        some = ((part + part * GOLDEN % 1.0) * (len(power) / _PLACE_PERIODS)).astype(np.intp)
        blocks, power = replace(blocks, v=blocks.v[some], at=blocks.at[some]), power[some]
    return blocks, power, sigma


def _axis_along(rows: Rows, blocks: Means, power: Array, sigma: tuple[float, float]) -> tuple[str | None, Array, float]:
    """The axis or phase along which nearly all is, the energy along it, and its share."""
    v_s, mean = blocks.v * rows.rotor[blocks.at], 0.5 * (sigma[0] ** 2 + sigma[1] ** 2)
    along = {"d": blocks.v.real**2 - sigma[0] ** 2, "q": blocks.v.imag**2 - sigma[1] ** 2}
    along |= {name: (v_s * axis.conjugate()).real ** 2 - mean for name, axis in zip(_PHASE_NAMES, AXES, strict=True)}
    total = float(power.sum())
    name = max(along, key=lambda name: float(along[name].sum()))
    share = float(along[name].sum()) / total
    return (name, along[name], min(share, 1.0)) if share >= _ALONG_ONE else (None, power, 1.0)


def _spectral(rows: Rows, signal: Vector, noise: tuple[float, float]) -> Place | None:
    """The line or the order that holds most of a flux error, where one does."""
    variance = noise[0] ** 2 + noise[1] ** 2
    total = energy_of(signal) - len(signal) * variance
    n_p = rows.machine.n_p
    found: list[Place] = []
    for turn, base, highest in (("electrical", 1, _ELECTRICAL_ORDERS), ("mechanical", n_p, _MECHANICAL_TURNS * n_p)):
        share = (energy_of_orders(rows, signal, highest, base) - noise_of_orders(rows, variance, base)) / total
        if base > 1:
            share[base - 1 :: base] = 0.0  # electrical ones too
        k = int(np.argmax(share))
        if share[k] >= _LINE_ENERGY:
            held = min(float(share[k]), 1.0)
            words = f"at order {k + 1} of the {turn} turn in the rotor frame, with {percent(held)} of the energy"
            found.append(Place(words, {f"{turn}_order": float(k + 1), "frame": "rotor"}, held, 1.0))
    for frame in ("stationary", "rotor"):
        line = strongest_line(rows, signal, frame, SLOWEST, FASTEST / rows.T_s, _LINE_ENERGY * total)
        if line is not None and line.gain >= _LINE_ENERGY * total:
            found.append(place_of_line(line, frame, min(line.gain / total, 1.0), len(rows) * rows.T_s))
    return max(found, key=lambda place: place.energy_share, default=None)


def place_of_line(line: Line, frame: str, share: float, time: float) -> Place:
    """In a recording of that length, s."""
    turns = f"at {number(line.frequency)} Hz" if line.frequency * time > 1.0 else "all the time"
    words = f"{turns} in the {frame} frame, with {percent(share)} of the energy"
    region: Region = {"frequency": line.frequency, "frame": frame}
    if line.narrow < STRAIGHT:
        region["direction"] = line.direction
    return Place(words, region, share, 1.0)
