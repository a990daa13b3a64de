"""Locate: the smallest region that holds most of a mismatch, and what a mismatch without a name looks like.

Regions are ranges of what a bench engineer can read off - speed, current, time, the distance of a phase current to its
change of sign - or a line of a spectrum, or an order of the rotor's turning. Knows nothing of effects.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.flux_balance import TURN
from estimator.mismatch.angle_rounding import hidden_energy
from estimator.mismatch.averages import (
    Array,
    Means,
    beside,
    energy_of,
    means,
    noise_of_means,
    parts,
    usual_periods,
    voltage_of,
)
from estimator.mismatch.branch import Branch
from estimator.mismatch.forms import Drift, Form, TwoLevels, drift, two_levels
from estimator.mismatch.model import filter_of, whitened
from estimator.mismatch.regions import MOST, regions, together, worth
from estimator.mismatch.ringing import resonance, ringing
from estimator.mismatch.spectra import Line, energy_of_orders, line_beside, noise_of_orders, strongest_line, white_level
from estimator.mismatch.thinning import GOLDEN
from estimator.mismatch.verdict import Place, Unexplained
from estimator.mismatch.words import degrees, number, percent
from estimator.physics.rows import AXES, Rows, Vector

_PHASES: Final = ("a", "b", "c")
_ONE_AXIS: Final = 0.9  # of the energy
_MANY: Final = 60_000  # periods, that say where an effect acts
_PLAIN: Final = 50.0  # standard errors of the noise's energy, at which a signal needs no longer means
_HALF: Final = 0.5  # of the energy, that a line or an order must hold where no range holds more
_LINE_SHARE: Final = 0.05  # of the rows, that a line of a spectrum counts as
_ORDERS: Final = 12  # of the electrical turn
_TURNS: Final = 3  # electrical, up to which orders of the mechanical turn go
RESONANCE: Final = "a resonance"
"""How the description of one begins."""
_SLOWEST: Final = 2.0  # Hz
_FASTEST: Final = 0.45  # of the sampling rate
_LEAST_V: Final = 1e-3  # of the voltage's rms: what the twin itself may miss
_EXCESS: Final = 0.02  # of the noise's energy
_SURE: Final = 6.0  # standard errors of the noise's energy
_HIDDEN: Final = 1.3  # of the rounding's energy
_LIKE_RINGING: Final = (0.1, 0.01)  # of the rounding's energy, which the voltage's control follows; what rings plainly
_FORM: Final = 0.5  # of the excess, that a form must explain to name it
_ALL: Final = 0.8  # of the excess: a form that explains it is heard, however small its voltage
_ROUNDS: Final = 8  # of fitting two levels and the machine in turn
_NEARER: Final = 0.001  # of the energy, that another round must explain
_SIMPLER: Final = 0.5  # of what a voltage of two levels explains, that a line must explain to stand for it
_NEAR: Final = 0.05  # standard deviation of a resonance's frequency over it, to say so
_STRAIGHT: Final = 0.3  # of an ellipse's long axis, that its short one may have

Region = dict[str, float | str | tuple[float, float]]


def place_of(rows: Rows, signal: Vector, noise: tuple[float, float]) -> Place:
    """The smallest region that holds most of the energy above noise of a flux error (Vs, rotor frame).

    noise: its white standard deviation (Vs) on d and q; zero for what an effect alone makes.
    """
    blocks, power, sigma = _blocks(rows, signal, noise)
    if len(power) < 4 or not power.sum() > 0.0:
        return Place("nowhere in particular: nothing stands above the noise", {}, 0.0, 1.0)
    axis, power, share = _axis(rows, blocks, power, sigma)
    found = regions(rows, blocks, power)
    energy, samples = together(found, power)
    spectral = _spectral(rows, signal, noise)
    if spectral is not None:
        held = spectral.energy_share
        if not found or (held >= MOST and worth(held, _LINE_SHARE) > worth(energy, samples)):
            return spectral
    region: Region = {one.key: one.limits for one in found}
    on = ""
    if axis is not None:
        region["phase" if axis in _PHASES else "axis"] = axis
        on = f"along phase {axis}, " if axis in _PHASES else f"on the {axis} axis, "
    if not found:
        return Place(f"{on}at all speeds, currents and times", region, share, 1.0)
    where = " and ".join(one.words for one in found)
    energy *= share
    sentence = f"{on}where {where}: {percent(samples)} of the samples hold {percent(energy)} of the energy"
    return Place(sentence, region, energy, samples)


def rings(rows: Rows, z: Vector, noise: tuple[float, float], missed: float = 0.0) -> bool:
    """A resonance shows in a residual flux error (Vs, rotor frame), however little of its energy it holds.

    missed: energy, over the noise's variance, that equations of what is named may leave: no less rings.
    """
    found = ringing(rows, np.where(rows.joined, z, 0j), noise)
    if found is None:
        return False
    sure, plain = found
    return sure**2 > missed + _LIKE_RINGING[plain] * hidden_energy(rows) / (noise[0] * noise[1])


def describe(rows: Rows, z: Vector, noise: tuple[float, float], missed: float = 0.0) -> Unexplained | None:
    """What a residual flux error (Vs, rotor frame) holds above its white noise; None where it holds nothing.

    missed: as `rings` has it.
    """
    hidden = hidden_energy(rows)
    z = np.where(rows.joined, z, 0j)
    noise = min(noise[0], white_level(z.real)), min(noise[1], white_level(z.imag))
    variance, n = noise[0] ** 2 + noise[1] ** 2, int(np.count_nonzero(rows.joined))
    if not variance > 0.0:
        return None
    coarse = math.sqrt(1.0 + hidden / (n * variance))
    line = _line(rows, z)
    heard_ringing = rings(rows, z if line is None else z - line.flux, (coarse * noise[0], coarse * noise[1]), missed)
    loud = energy_of(z) - n * variance - _HIDDEN * hidden
    rms_V = _rms(rows, z, noise)
    if line is not None and line.gain > _FORM * loud > 0.0:
        rms_V = max(rms_V, math.hypot(abs(line.forth), abs(line.back)))
    u = math.sqrt(energy_of(rows.u) / len(rows))
    chance = _SURE * math.sqrt(2.0 * n) * variance
    least = _EXCESS * n * variance + chance
    enough = loud > least
    heard = enough and rms_V > _LEAST_V * u
    if not enough and not heard_ringing:
        return None
    machine = _of_machine(rows)
    left = beside(machine, z)
    excess = energy_of(left) - n * variance
    if not heard_ringing and excess - _HIDDEN * hidden < least:
        return None  # another machine explains it
    forms: list[Form | None] = [resonance(rows, left, noise, machine)]
    if enough:
        line, levels = _line(rows, left), _levels(rows, left)
        # Many changes are a rough copy of a line
        if line is not None and (levels is None or line.gain > _SIMPLER * levels.gain):
            apart = line_beside(rows, left, np.concatenate((machine, _of_angle(rows))), line)
        else:
            apart = _levels_apart(rows, left, machine)
        forms += [apart, two_levels(rows, left, "rotor"), drift(rows, left)]
    best = max((form for form in forms if form is not None), key=lambda form: form.gain, default=None)
    if not heard and not heard_ringing and (best is None or best.gain < max(_ALL * excess, least)):
        return None
    if best is None or (heard and best.gain < _FORM * (excess - _HIDDEN * hidden)):
        place = place_of(rows, z, noise)
        return Unexplained(rms_V, place, f"{_what(place)} of {number(rms_V)} V rms {place.sentence}")
    return _unexplained(rows, best, excess, rms_V)


def branch(
    rows: Rows, z: Vector, noise: tuple[float, float], smooth: Rows | None = None, least: float = 0.0
) -> tuple[Unexplained, Branch] | None:
    """The resonance that explains most of a residual flux error (Vs, rotor frame).

    Its `changes` are those of R_s, L_d, L_q, psi_f and the angle's zero. smooth: the rows with less noise of the
    currents, which would make inductances small. least: chi square that it has to explain, roughly.
    """
    smooth = smooth or rows
    z, machine = np.where(rows.joined, z, 0j), np.concatenate((_of_machine(smooth), _of_angle(smooth)))
    form = resonance(rows, z, noise, machine, least)
    if form is None:
        return None
    excess = energy_of(beside(machine, z)) - np.count_nonzero(rows.joined) * (noise[0] ** 2 + noise[1] ** 2)
    return _unexplained(rows, form, excess, _rms(rows, z, noise)), form


def _unexplained(rows: Rows, form: Form, excess: float, rms_V: float) -> Unexplained:
    """Of a form; `excess`: energy over noise that it is a part of."""
    if isinstance(form, Line):
        rms_V = max(rms_V, math.hypot(abs(form.forth), abs(form.back)))
    elif isinstance(form, Branch):
        flux = math.sqrt(max(form.gain, 0.0) / np.count_nonzero(rows.joined))
        rms_V = max(rms_V, noise_of_means(rows, (flux, 0.0), usual_periods(rows))[0])
    description, place = _said(rows, form, min(form.gain / max(excess, form.gain), 1.0))
    return Unexplained(rms_V, place, description)


def _what(place: Place) -> str:
    return "a ripple" if place.region.keys() & {"electrical_order", "mechanical_order"} else "a voltage"


def _line(rows: Rows, z: Vector) -> Line | None:
    return strongest_line(rows, z, "stationary", _SLOWEST, _FASTEST / rows.T_s)


def _levels(rows: Rows, z: Vector) -> TwoLevels | None:
    return two_levels(rows, z, "stationary")


def _of_machine(rows: Rows) -> Array:
    """What changes of R_s, L_d, L_q and psi_f make of the flux error: a row each, real parts before imaginary ones."""
    by = filter_of(rows, rows.machine)
    voltages = (
        rows.i_mean, rows.balance(rows.i.real), rows.balance(rows.i - rows.i.real), rows.balance(np.ones(len(rows.i)))
    )  # fmt: skip
    return np.array([parts(whitened(v, by)) for v in voltages])


def _of_angle(rows: Rows) -> Array:
    """What less of the angle makes of it."""
    m, i = rows.machine, 1j * rows.i
    voltage = 1j * (m.R_s * rows.i_mean - rows.u) + rows.balance(m.L_d * i.real + 1j * (m.L_q * i.imag))
    return parts(whitened(voltage, filter_of(rows, m)))[None, :]


def _levels_apart(rows: Rows, z: Vector, machine: Array) -> TwoLevels | None:
    """A voltage of two levels, where the machine is fitted beside it: fitted alone, its parameters hide a part of it.
    """
    free, best = z, None
    for _ in range(_ROUNDS):
        levels = _levels(rows, free)
        if levels is None:
            break
        free = beside(machine, z, levels.flux)
        gain = energy_of(z) - energy_of(free - levels.flux)
        before = -math.inf if best is None else best.gain
        if gain > before:
            best = replace(levels, gain=gain)
        if gain < before + _NEARER * energy_of(z):
            break
    return best


def _rms(rows: Rows, z: Vector, noise: tuple[float, float]) -> float:
    """Rms above noise (V) of the mean voltage over about ten periods."""
    m = usual_periods(rows)
    sigma = noise_of_means(rows, noise, m)
    power = float(np.mean(np.abs(means(rows, voltage_of(rows, z), m).v) ** 2))
    return math.sqrt(max(power - sigma[0] ** 2 - sigma[1] ** 2, 0.0))


# --- Ranges


def _blocks(rows: Rows, signal: Vector, noise: tuple[float, float]) -> tuple[Means, Array, tuple[float, float]]:
    """Mean voltages over as few periods as show the signal, their energy above noise (V^2), and the noise (V)."""
    v = voltage_of(rows, signal)
    usual = usual_periods(rows)
    found: list[tuple[float, tuple[Means, Array, tuple[float, float]]]] = []
    for m in (1, 3, usual, 3 * usual):
        blocks, sigma = means(rows, v, m), noise_of_means(rows, noise, m)
        variance = sigma[0] ** 2 + sigma[1] ** 2
        power = np.abs(blocks.v) ** 2 - variance
        found.append((float(power.sum()) / max(math.sqrt(len(power)) * variance, 1e-300), (blocks, power, sigma)))
        if found[-1][0] > _PLAIN:
            break
    blocks, power, sigma = max(found, key=lambda pair: pair[0])[1]
    if noise == (0.0, 0.0) and len(power) > _MANY:  # an effect acts all over a long recording
        part = np.arange(_MANY)
        some = ((part + part * GOLDEN % 1.0) * (len(power) / _MANY)).astype(np.intp)
        blocks, power = replace(blocks, v=blocks.v[some], at=blocks.at[some]), power[some]
    return blocks, power, sigma


def _axis(
    rows: Rows, blocks: Means, power: Array, sigma: tuple[float, float]
) -> tuple[str | None, Array, float]:
    """The axis or phase along which nearly all is, the energy along it, and its share."""
    v_s, mean = blocks.v * rows.rotor[blocks.at], 0.5 * (sigma[0] ** 2 + sigma[1] ** 2)
    along = {"d": blocks.v.real**2 - sigma[0] ** 2, "q": blocks.v.imag**2 - sigma[1] ** 2}
    along |= {name: (v_s * axis.conjugate()).real ** 2 - mean for name, axis in zip(_PHASES, AXES, strict=True)}
    total = float(power.sum())
    name = max(along, key=lambda name: float(along[name].sum()))
    share = float(along[name].sum()) / total
    return (name, along[name], min(share, 1.0)) if share >= _ONE_AXIS else (None, power, 1.0)


# --- Lines and orders


def _spectral(rows: Rows, signal: Vector, noise: tuple[float, float]) -> Place | None:
    """The line or the order that holds most of a flux error, where one does."""
    variance = noise[0] ** 2 + noise[1] ** 2
    total = energy_of(signal) - len(signal) * variance
    n_p = rows.machine.n_p
    found: list[Place] = []
    for turn, base, highest in (("electrical", 1, _ORDERS), ("mechanical", n_p, _TURNS * n_p)):
        share = (energy_of_orders(rows, signal, highest, base) - noise_of_orders(rows, variance, base)) / total
        if base > 1:
            share[base - 1 :: base] = 0.0  # electrical ones too
        k = int(np.argmax(share))
        if share[k] >= _HALF:
            held = min(float(share[k]), 1.0)
            words = f"at order {k + 1} of the {turn} turn in the rotor frame, with {percent(held)} of the energy"
            found.append(Place(words, {f"{turn}_order": float(k + 1), "frame": "rotor"}, held, 1.0))
    for frame in ("stationary", "rotor"):
        line = strongest_line(rows, signal, frame, _SLOWEST, _FASTEST / rows.T_s, _HALF * total)
        if line is not None and line.gain >= _HALF * total:
            found.append(_place_of_line(line, frame, min(line.gain / total, 1.0), len(rows) * rows.T_s))
    return max(found, key=lambda place: place.energy_share, default=None)


def _place_of_line(line: Line, frame: str, share: float, time: float) -> Place:
    """In a recording of that length, s."""
    turns = f"at {number(line.frequency)} Hz" if line.frequency * time > 1.0 else "all the time"
    words = f"{turns} in the {frame} frame, with {percent(share)} of the energy"
    region: Region = {"frequency": line.frequency, "frame": frame}
    if line.narrow < _STRAIGHT:
        region["direction"] = line.direction
    return Place(words, region, share, 1.0)


# --- Forms


def _said(rows: Rows, form: Form, share: float) -> tuple[str, Place]:
    """A form in words, and where it is: the voltage on the machine beside the recorded one."""
    if isinstance(form, Line):
        along = f"along {degrees(form.direction)} from phase a" if form.narrow < _STRAIGHT else "turning"
        what = f"a {number(form.frequency)} Hz voltage of {number(form.amplitude)} V fixed in the stationary frame"
        return f"{what}, {along}", _place_of_line(form, "stationary", share, len(rows) * rows.T_s)
    if isinstance(form, TwoLevels):
        return _said_of_levels(rows, form, share)
    if isinstance(form, Drift):
        region: Region = {"frame": "rotor", "time": (float(rows.t[0]), float(rows.t[-1]))}
        along = f"along {degrees(form.direction)} of the rotor frame"
        what = f"a drift of {number(abs(form.change))} V from begin to end, {along}"
        return what, Place(f"growing with time, with {percent(share)} of the energy", region, share, 1.0)
    f = form.frequency / rows.T_s
    near = f"{'near' if form.unsure < _NEAR else 'roughly at'} {number(f / 1e3, 2)} kHz"
    where = f"{near} in the stationary frame, with {percent(share)} of the energy"
    region = {"frequency": f, "frame": "stationary"}
    what = f"{RESONANCE} {near}: a current beside the machine's that follows the voltage"
    return what, Place(where, region, share, 1.0)


def _said_of_levels(rows: Rows, form: TwoLevels, share: float) -> tuple[str, Place]:
    volts = number(abs(form.step))
    along = f"along {degrees(form.direction)} of the {form.frame} frame"
    region: Region = {"frame": form.frame, "direction": form.direction, "changes": float(len(form.changes))}
    held = f"{percent(form.share)} of the samples hold {percent(share)} of the energy"
    if len(form.changes) == 1:
        t = float(form.changes[0])
        change = form.direction + (0.0 if form.starts[0] >= t else math.pi)
        region |= {"direction": math.remainder(change, TURN), "time": (t, float(rows.t[-1]))}
        what = f"a step of {volts} V at {number(t)} s, along {degrees(change)} of the {form.frame} frame"
        return what, Place(f"from {number(t)} s: {held}", region, share, form.share)
    region["time"] = (float(form.starts[0]), float(form.starts[-1] + form.lengths[-1]))
    stay = number(1e3 * float(np.mean(form.lengths)), 2)
    times = "once" if len(form.starts) == 1 else f"{len(form.starts)} times"
    what = f"a voltage of {volts} V {along} that comes and goes, {times}, for {stay} ms on average"
    return what, Place(f"{along} while it is there: {held}", region, share, form.share)
