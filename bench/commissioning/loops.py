"""A drive's loops as they are: steps of speed and currents tried, and held against what their tuning promises."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from bench.actions.safety.limits import RPM, Limits
from bench.commissioning.promise import CurrentLoop, SpeedLoop, at_random, thinned, to_and_fro
from bench.commissioning.response import Response, UnclearStepError, averaged, averaged_with
from bench.commissioning.trial import (
    CurrentTrial,
    SpeedTrial,
    Trials,
    largest_current_step,
    largest_speed_step,
    rise_periods,
    turned,
)
from drivers.capture import Capture
from drivers.drive import Drive
from estimator.machine import Machine

READ: Final = (
    "n_p", "control_R_s", "control_L_d", "control_L_q", "control_psi_f", "bandwidth", "own_gains", "k_p_d", "k_i_d",
    "k_p_q", "k_i_q", "k_p_speed", "k_i_speed", "speed_filter", "current_limit", "saturation_correction",
    "decoupling",
)  # fmt: skip
"""Parameters that decide how its loops answer."""
_REACH: Final = 0.7  # of the voltage, that a trial's speeds may need
_TRIPS: Final = 1.25  # times the fastest, at which the drive may go off
_SPEED: Final = 0.35  # of the fastest of those
_SHARE: Final = 0.25  # of rated current, that a step goes to either side
_I_D: Final = {"speed": -0.15, "d": -0.4, "q": -0.4}  # of rated current, level of i_d while one steps
_VOLTAGE: Final = 0.35  # of the inverter's reach, that a step's first period may ask for
_SPEED_VOLTAGE: Final = 0.6  # of it, that a step of the speed may ask for: else its reference rises slower
_WANDER: Final = 0.5  # of the trial's speed, that it may wander by while i_q steps
_LONG: Final = 8.0  # times of a loop's time constant, between steps
_SHORTEST: Final = 1e-3  # s, between steps of currents, that a drive takes
_FIRST_HOLD: Final = 0.25  # s, between steps of speed, while its acceleration is not known
_HOLDS: Final = (0.02, 2.0)  # s, shortest and longest
_MOST: Final = 0.8  # of a step, over which the acceleration is told
STEPS: Final = 40  # of a promise
_TRIES: Final = 4  # of steps of the speed, until the time between them suits
_ALIKE: Final = 1.5  # times, within which that first one will do


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """One loop's steps."""

    name: str  # "speed", "d", "q"
    response: Response | None
    sentence: str  # why there is none
    hold: int  # samples between steps
    T: float  # s, of a sample
    i_d: float  # A, level meanwhile
    rise: int = 1  # control periods that the reference takes for a step


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What was tried, by which parameters."""

    loops: Sequence[Loop]
    gains: Mapping[str, float]  # `READ`, SI
    K: float  # rad/(s2 A), electrical acceleration by i_q, roughly
    swing: Capture  # of the speed's steps


@dataclass(frozen=True, slots=True)
class Judged:
    """A loop against its promise; times in s, overshoot as a share of the step."""

    name: str
    overshoot: float | None
    settling: float | None
    tracking: float | None  # s, integral of the deviation's size
    promised_overshoot: float
    promised_settling: float
    promised_tracking: float
    sentence: str
    promise: Response = field(compare=False)  # the step itself

    def as_json(self) -> dict[str, Any]:
        """Plain values, without the promised response itself; a time that is infinite is None."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "promise"}
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in values.items()
        }


def fastest(drive: Drive, limits: Limits) -> float:
    """Electrical speed (rad/s) that trials go up to."""
    n_p, psi_f, u_dc = (drive.read(name) for name in ("n_p", "control_psi_f", "u_dc"))
    by_voltage = _REACH * u_dc / math.sqrt(3.0) / psi_f if psi_f > 0.0 and u_dc > 0.0 else math.inf
    by_limit = limits.speed_max_rpm * RPM * n_p if limits.speed_max_rpm else math.inf
    return min(by_voltage, by_limit, drive.read("overspeed_trip") / _TRIPS, drive.identity.omega_full / _TRIPS)


def tried(drive: Drive, trials: Trials, limits: Limits, i_rated: float) -> Tried:
    """Steps of all loops within limits; `i_rated` (A): the current that steps stay well within.

    Raises UnclearStepError where the speed does not follow its reference, DriveError.
    """
    gains = {name: drive.read(name) for name in READ}
    most, reach = min(i_rated, gains["current_limit"]), drive.read("u_dc") / math.sqrt(3.0)
    speed_ref = _SPEED * fastest(drive, limits)
    size = min(largest_speed_step(gains["k_p_speed"], most), 0.3 * speed_ref)
    rise = _rise(2.0 * size * gains["k_p_speed"], *_tuning("q", gains), _SPEED_VOLTAGE * reach)
    wanted = SpeedTrial(size, _FIRST_HOLD, speed_ref, rise, _I_D["speed"] * most)
    got, count, K = _speed_steps(trials, wanted, gains["k_p_speed"])
    T = got.T_s * got.decimation
    speed, rising = turned(got.columns["theta_e"], T), rise_periods(rise, got.T_s)
    loops = [_loop("speed", speed, T, count, 2.0 * size, wanted.i_d_ref, rising)]
    for axis in "dq":
        k_p, alpha = _tuning(axis, gains)
        between = max(_LONG / max(alpha, 1.0), _SHORTEST)
        step = min(_SHARE * most, _VOLTAGE * reach / max(2.0 * k_p, 1e-9))
        if axis == "q":
            step = min(step, largest_current_step(K, between, _WANDER * speed_ref))
        one = CurrentTrial(axis, step, between, speed_ref, _I_D[axis] * most)
        i, count = trials.current(one)
        loops.append(_loop(axis, i, drive.identity.T_s, count, 2.0 * step, one.i_d_ref))
    return Tried(loops, gains, K, got)


def _tuning(axis: str, gains: Mapping[str, float]) -> tuple[float, float]:
    """k_p (V/A) and bandwidth (rad/s) of an axis, by the inductance that the drive takes it for."""
    L = gains[f"control_L_{axis}"]
    if gains["own_gains"]:
        return gains[f"k_p_{axis}"], gains[f"k_p_{axis}"] / L
    return gains["bandwidth"] * L, gains["bandwidth"]


def _rise(current: float, k_p: float, alpha: float, voltage: float) -> float:
    """s, in which i_q may rise by `current` (A) with no more than `voltage` (V); 0 where at once is not more either."""
    return k_p * current / (alpha * voltage) if k_p * current > voltage else 0.0


def _speed_steps(trials: Trials, wanted: SpeedTrial, k_p: float) -> tuple[Capture, int, float]:
    """Steps of the speed with as much time between them as its control takes; samples between them, and K.

    Raises UnclearStepError.
    """
    hold = wanted.hold
    for left in reversed(range(_TRIES)):
        got, count = trials.speed(replace(wanted, hold=hold))
        try:
            K = acceleration(got, count, 2.0 * wanted.size)
        except UnclearStepError:
            if not left or hold >= _HOLDS[1]:
                raise
            hold = min(4.0 * hold, _HOLDS[1])
            continue
        long = min(max(2.5 * _LONG / max(abs(k_p * K), 1e-3) + wanted.rise, _HOLDS[0]), _HOLDS[1])
        trials.settle = long
        if not left or hold / _ALIKE <= long <= hold * _ALIKE:
            return got, count, K
        hold = long
    raise AssertionError("the last try returns or raises")


def acceleration(got: Capture, hold: int, size: float) -> float:
    """Electrical acceleration by i_q, rad/(s2 A), from mean responses to steps of the speed by `size` (rad/s).

    What the speed gains until most of the step is done, over the charge of what i_q then has more than before. Roughly:
    friction that grows with speed is left out. Raises UnclearStepError.
    """
    T = got.T_s * got.decimation
    omega, i_q = turned(got.columns["theta_e"], T), got.columns["i_q"]
    mean, (current,) = averaged_with(omega, T, hold, size, (0.5 * (i_q[1:] + i_q[:-1]),))
    charge = np.cumsum(current) * T
    rising = slice(0, max(2, int(np.argmax(mean.y > _MOST)) or len(mean.y)))
    q, y = charge[rising], mean.y[rising] * size
    return float(q @ y / (q @ q))


def judged(one: Tried, machine: Machine, K: float, damping: float) -> list[Judged]:
    """Each loop against what its gains promise of a machine with B/J (1/s) and, without i_d, K, rad/(s2 A)."""
    found = list[Judged]()
    for loop in one.loops:
        promised, seen = _promised(loop, one.gains, one.swing.T_s, machine, K, damping), loop.response
        found.append(Judged(
            loop.name, seen and seen.overshoot, seen and seen.settling, seen and seen.tracking, promised.overshoot,
            promised.settling, promised.tracking, loop.sentence,
            promised,
        ))  # fmt: skip
    return found


def _promised(
    loop: Loop, gains: Mapping[str, float], T_s: float, machine: Machine, K: float, damping: float
) -> Response:
    """What the gains promise of a loop's trial."""
    flux = machine.psi_f + machine.L_d * loop.i_d  # along d
    accelerates = K * (1.0 + (machine.L_d - machine.L_q) * loop.i_d / machine.psi_f)
    axis, saturates = "d" if loop.name == "d" else "q", bool(gains["saturation_correction"])
    L = machine.L_d if axis == "d" else machine.L_q
    k_p, k_i, alpha = gains[f"k_p_{axis}"], gains[f"k_i_{axis}"], gains["bandwidth"]
    if not gains["own_gains"]:
        k_p, k_i = alpha * (L if saturates else gains[f"control_L_{axis}"]), alpha * gains["control_R_s"]
    fed = flux if saturates else gains["control_psi_f"] + gains["control_L_d"] * loop.i_d
    current = CurrentLoop(
        k_p, k_i, machine.R_s, L, T_s, flux * accelerates if axis == "q" else 0.0,
        fed / flux if gains["decoupling"] else 0.0, gains["speed_filter"],
    )  # fmt: skip
    if loop.name != "speed":
        return averaged(current.answer(at_random(loop.hold, STEPS)), T_s, loop.hold, 1.0)
    own = SpeedLoop(gains["k_p_speed"], gains["k_i_speed"], accelerates, damping, current, gains["speed_filter"])
    every = round(loop.T / T_s)
    reference = to_and_fro(loop.hold * every, STEPS, loop.rise)
    return averaged(thinned(own.answer(reference), every), loop.T, loop.hold, 1.0)


def _loop(name: str, y: Any, T: float, count: int, size: float, i_d: float, rise: int = 1) -> Loop:
    try:
        return Loop(name, averaged(y, T, count, size), "", count, T, i_d, rise)
    except UnclearStepError as error:
        return Loop(name, None, str(error), count, T, i_d, rise)
