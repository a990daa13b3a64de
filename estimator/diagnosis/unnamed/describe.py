"""Describe: what a mismatch without a name looks like, by the form that explains most of it, else by where it is.

Knows nothing of effects.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.angle.angle_rounding import hidden_energy
from estimator.diagnosis.likelihood.averages import (
    energy_of,
    means,
    noise_of_means,
    parts,
    usual_periods,
    voltage_of,
    without_columns,
)
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.diagnosis.unnamed.branch import Branch
from estimator.diagnosis.unnamed.forms import Drift, Form, TwoLevels, drift, two_levels
from estimator.diagnosis.unnamed.ringing import resonance, ringing
from estimator.diagnosis.verdict import Place, Unexplained
from estimator.diagnosis.where.place import FASTEST, SLOWEST, STRAIGHT, Region, place_of, place_of_line
from estimator.diagnosis.where.spectra import Line, line_beside, strongest_line, white_level
from estimator.diagnosis.words import degrees, number, percent
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows

RESONANCE: Final = "a resonance"
"""How the description of one begins."""
_LEAST_V: Final = 1e-3  # of the voltage's rms: what the twin itself may miss
_EXCESS: Final = 0.02  # of the noise's energy
_SURE_ENERGY: Final = 6.0  # standard errors of the noise's energy
_HIDDEN_ENERGY: Final = 1.3  # of the rounding's energy
_LIKE_RINGING: Final = (0.1, 0.01)  # of the rounding's energy, which the voltage's control follows; what rings plainly
_FORM: Final = 0.5  # of the excess, that a form must explain to name it
_ALL: Final = 0.8  # of the excess: a form that explains it is heard, however small its voltage
_LEVEL_ROUNDS: Final = 8  # of fitting two levels and the machine in turn
_ROUND_GAIN: Final = 0.001  # of the energy, that another round must explain
_SIMPLER: Final = 0.5  # of what a voltage of two levels explains, that a line must explain to stand for it
_NEAR_FREQUENCY: Final = 0.05  # standard deviation of a resonance's frequency over it, to say so


def rings(rows: Rows, z: Vector, noise: tuple[float, float], discrepancy: float = 0.0) -> bool:
    """A resonance shows in a residual flux error (Vs, rotor frame), however little of its energy it holds.

    discrepancy: energy, over the noise's variance, that equations of what is named may leave: no less rings.
    """
    found = ringing(rows, np.where(rows.joined, z, 0j), noise)
    if found is None:
        return False
    sure, plain = found
    return sure**2 > discrepancy + _LIKE_RINGING[plain] * hidden_energy(rows) / (noise[0] * noise[1])


def describe(rows: Rows, z: Vector, noise: tuple[float, float], discrepancy: float = 0.0) -> Unexplained | None:
    """What a residual flux error (Vs, rotor frame) holds above its white noise; None where it holds nothing.

    discrepancy: as `rings` has it.
    """
    hidden = hidden_energy(rows)
    z = np.where(rows.joined, z, 0j)
    noise = min(noise[0], white_level(z.real)), min(noise[1], white_level(z.imag))
    variance, n = noise[0] ** 2 + noise[1] ** 2, int(np.count_nonzero(rows.joined))
    if not variance > 0.0:
        return None
    coarse = math.sqrt(1.0 + hidden / (n * variance))
    line = _line(rows, z)
    beside_line = z if line is None else z - line.flux
    heard_ringing = rings(rows, beside_line, (coarse * noise[0], coarse * noise[1]), discrepancy)
    loud = energy_of(z) - n * variance - _HIDDEN_ENERGY * hidden
    rms_V = _rms_above_noise(rows, z, noise)
    if line is not None and line.gain > _FORM * loud > 0.0:
        rms_V = max(rms_V, math.hypot(abs(line.forth), abs(line.back)))
    u = math.sqrt(energy_of(rows.u) / len(rows))
    chance = _SURE_ENERGY * math.sqrt(2.0 * n) * variance
    least = _EXCESS * n * variance + chance
    enough = loud > least
    heard = enough and rms_V > _LEAST_V * u
    if not enough and not heard_ringing:
        return None
    machine = _of_machine(rows)
    left = without_columns(machine, z)
    excess = energy_of(left) - n * variance
    if not heard_ringing and excess - _HIDDEN_ENERGY * hidden < least:
        return None  # another machine explains it
    forms: list[Form | None] = [resonance(rows, left, noise, machine)]
    if enough:
        line, levels, apart = _line(rows, left), _stationary_levels(rows, left), None
        # Many changes are a rough copy of a line
        if line is not None and (levels is None or line.gain > _SIMPLER * levels.gain):
            apart = line_beside(rows, left, np.concatenate((machine, _by_less_angle(rows))), line)
        forms += [apart or _levels_apart(rows, left, machine), two_levels(rows, left, "rotor"), drift(rows, left)]
    best = max((form for form in forms if form is not None), key=lambda form: form.gain, default=None)
    if not heard and not heard_ringing and (best is None or best.gain < max(_ALL * excess, least)):
        return None
    if best is None or (heard and best.gain < _FORM * (excess - _HIDDEN_ENERGY * hidden)):
        place = place_of(rows, z, noise)
        return Unexplained(rms_V, place, f"{_what(place)} of {number(rms_V)} V rms {place.sentence}")
    return _unexplained(rows, best, excess, rms_V)


def best_resonance(
    rows: Rows, z: Vector, noise: tuple[float, float], smooth: Rows | None = None, least: float = 0.0
) -> tuple[Unexplained, Branch] | None:
    """The resonance that explains most of a residual flux error (Vs, rotor frame).

    Its `changes` are those of R_s, L_d, L_q, psi_f and the angle's zero. smooth: the rows with less noise of the
    currents, which would make inductances small. least: chi square that it has to explain, roughly.
    """
    smooth = smooth or rows
    z, machine = np.where(rows.joined, z, 0j), np.concatenate((_of_machine(smooth), _by_less_angle(smooth)))
    form = resonance(rows, z, noise, machine, least)
    if form is None:
        return None
    excess = energy_of(without_columns(machine, z)) - np.count_nonzero(rows.joined) * (noise[0] ** 2 + noise[1] ** 2)
    return _unexplained(rows, form, excess, _rms_above_noise(rows, z, noise)), form


def _unexplained(rows: Rows, form: Form, excess: float, rms_V: float) -> Unexplained:
    """Of a form; `excess`: energy over noise that it is a part of."""
    if isinstance(form, Line):
        rms_V = max(rms_V, math.hypot(abs(form.forth), abs(form.back)))
    elif isinstance(form, Branch):
        flux = math.sqrt(max(form.gain, 0.0) / np.count_nonzero(rows.joined))
        rms_V = max(rms_V, noise_of_means(rows, (flux, 0.0), usual_periods(rows))[0])
    description, place = _form_in_words(rows, form, min(form.gain / max(excess, form.gain), 1.0))
    return Unexplained(rms_V, place, description)


def _what(place: Place) -> str:
    return "a ripple" if place.region.keys() & {"electrical_order", "mechanical_order"} else "a voltage"


def _line(rows: Rows, z: Vector) -> Line | None:
    return strongest_line(rows, z, "stationary", SLOWEST, FASTEST / rows.T_s)


def _stationary_levels(rows: Rows, z: Vector) -> TwoLevels | None:
    return two_levels(rows, z, "stationary")


def _of_machine(rows: Rows) -> Array:
    """What changes of R_s, L_d, L_q and psi_f make of the flux error: a row each, real parts before imaginary ones."""
    by = filter_of(rows, rows.machine)
    voltages = (
        rows.i_mean, rows.balance(rows.i.real), rows.balance(rows.i - rows.i.real), rows.balance(np.ones(len(rows.i)))
    )  # fmt: skip
    return np.array([parts(whitened(v, by)) for v in voltages])


def _by_less_angle(rows: Rows) -> Array:
    """What less of the angle makes of it."""
    m, i = rows.machine, 1j * rows.i
    voltage = 1j * (m.R_s * rows.i_mean - rows.u) + rows.balance(m.L_d * i.real + 1j * (m.L_q * i.imag))
    return parts(whitened(voltage, filter_of(rows, m)))[None, :]


def _levels_apart(rows: Rows, z: Vector, machine: Array) -> TwoLevels | None:
    """A voltage of two levels, where the machine is fitted beside it: fitted alone, its parameters hide a part of it.
    """
    free, best = z, None
    for _ in range(_LEVEL_ROUNDS):
        levels = _stationary_levels(rows, free)
        if levels is None:
            break
        free = without_columns(machine, z, levels.flux)
        gain = energy_of(z) - energy_of(free - levels.flux)
        before = -math.inf if best is None else best.gain
        if gain > before:
            best = replace(levels, gain=gain)
        if gain < before + _ROUND_GAIN * energy_of(z):
            break
    return best


def _rms_above_noise(rows: Rows, z: Vector, noise: tuple[float, float]) -> float:
    """Rms above noise (V) of the mean voltage over about ten periods."""
    m = usual_periods(rows)
    sigma = noise_of_means(rows, noise, m)
    power = float(np.mean(np.abs(means(rows, voltage_of(rows, z), m).v) ** 2))
    return math.sqrt(max(power - sigma[0] ** 2 - sigma[1] ** 2, 0.0))


# --- Forms


def _form_in_words(rows: Rows, form: Form, share: float) -> tuple[str, Place]:
    """A form in words, and where it is: the voltage on the machine beside the recorded one."""
    if isinstance(form, Line):
        along = f"along {degrees(form.direction)} from phase a" if form.narrow < STRAIGHT else "turning"
        what = f"a {number(form.frequency)} Hz voltage of {number(form.amplitude)} V fixed in the stationary frame"
        return f"{what}, {along}", place_of_line(form, "stationary", share, len(rows) * rows.T_s)
    if isinstance(form, TwoLevels):
        return _said_of_levels(rows, form, share)
    if isinstance(form, Drift):
        region: Region = {"frame": "rotor", "time": (float(rows.t[0]), float(rows.t[-1]))}
        along = f"along {degrees(form.direction)} of the rotor frame"
        what = f"a drift of {number(abs(form.change))} V from begin to end, {along}"
        return what, Place(f"growing with time, with {percent(share)} of the energy", region, share, 1.0)
    f = form.frequency / rows.T_s
    near = f"{'near' if form.unsure < _NEAR_FREQUENCY else 'roughly at'} {number(f / 1e3, 2)} kHz"
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
