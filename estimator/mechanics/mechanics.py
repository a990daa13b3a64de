"""Mechanics: moment of inertia, friction and load torque from rows of angle and current, or why they cannot be told.

    J d(omega_m)/dt = tau_e - tau_L - B omega_m - T_C sign(omega_m)

The length of the stretches is the one that tells J most closely, among those over which the angle's noise has next to
no part in the acceleration. Shorter ones are asked whether the shaft is rigid.

What cannot be told: J of a shaft that does not accelerate, or that is held or driven by another machine, whose torque
nobody measures; T_C apart from tau_L where the shaft turns in one direction only, which is told as their sum; B where
all speeds are about alike. J, B, T_C and tau_L all scale with psi_f: its error is theirs.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from estimator.arrays import Bools, stretches
from estimator.interval import Z_95
from estimator.machine import Machine
from estimator.mechanics.doubts import suspects_of, unexplained
from estimator.mechanics.regression import FEWEST, B, Fit, Torque, fit_of
from estimator.mechanics.stretches import STEPS, Rows, mean_over, noise_of_angle, rows_of
from estimator.mechanics.suspects import Suspect
from estimator.online.estimate import Estimate, Status
from estimator.samples import Samples

PARAMETERS: Final = ("J", "B", "T_C", "tau_L")
UNITS: Final[Mapping[str, str]] = {"J": "kg m2", "B": "Nm s/rad", "T_C": "Nm", "tau_L": "Nm"}
SHORTEST, LONGEST = 2e-3, 0.256  # s, of a step; a stretch has four
_CLEAR: Final = 0.05  # share of the acceleration's energy that the angle's noise may have
_QUIET: Final = 0.01  # the same of shorter stretches, which are asked whether the shaft is rigid
_CLOSE: Final = 0.1  # standard error of J over J, from which on it is not told
_STEADY: Final = 0.02  # of the highest speed, rms, by which a steady one departs from its mean
_LOOK: Final = 0.05  # s, over which a speed is looked at
_ROUNDING: Final = 3.0  # times the angle's noise, that a speed must stand out by
_FOLLOWS: Final = 0.5  # share of the torque beside friction and load that accelerates the shaft, at least
_RIGID: Final = 1e-3  # share of it that is left unexplained, at most
_TOLD: Final = 0.2  # share of the torque, rms, that half of an interval may be


class Told(StrEnum):
    """What the mechanics of the rows are."""

    OK = "ok"
    DOUBTFUL = "doubtful"  # the equation does not fit
    NO_ACCELERATION = "no_acceleration"  # the shaft does not accelerate: nothing can be told
    NOT_TOLD = "not_told"  # it does, and J cannot be told
    NO_DATA = "no_data"  # too few rows


@dataclass(frozen=True, slots=True)
class Mechanics:
    """What the rows say of the shaft. Estimates by `PARAMETERS`; standard errors have all in that is known."""

    status: Told
    sentence: str  # why, where the status is not ok
    estimates: Mapping[str, Estimate]
    sum: Estimate | None = None  # of tau_L and T_C, where the shaft turns in one direction only
    direction: int = 0  # of the speed there: 1, tau_L + T_C; -1, tau_L - T_C
    stretch: float | None = None  # s, length of a stretch
    stretches: int = 0  # that the estimates rest on
    torque_rms: float | None = None  # Nm, that accelerates the shaft
    residual_rms: float | None = None  # Nm, that the equation leaves over a stretch
    rows: int = 0
    gaps: int = 0


def mechanics(
    samples: Samples | Sequence[Samples], machine: Machine, std: Mapping[str, float] | None = None
) -> Mechanics:
    """What runs of samples without gaps, of one row time, say of the shaft.

    Only angle, speed and currents are read; a row in which one of them is no number is a gap. `std`: standard errors of
    the machine's psi_f, L_d, L_q, SI, as far as they are known; what is left out is taken for exact. The encoder's
    step is that of the samples' resolution.
    """
    runs = [samples] if isinstance(samples, Samples) else list(samples)
    return mechanics_of([rows for run in runs for rows in whole_rows(run, machine.n_p)], machine, std or {},
                        max((run.resolution.theta_e for run in runs), default=0.0))


def unmoved(samples: Sequence[Samples], n_p: int) -> Mechanics | None:
    """What is said of rows whose speed keeps still, at the cost of a look; None where it may move."""
    runs = [rows for run in samples for rows in whole_rows(run, n_p)]
    if not runs:
        return None
    M = max(1, round(_LOOK / runs[0].T))
    speeds = [mean_over(run.omega, M)[::M] for run in runs if len(run.omega) >= M]
    if not speeds:
        return None
    speed = np.concatenate(speeds)
    rounding = math.sqrt(2.0 * noise_of_angle(runs)) / (M * runs[0].T)
    spread, fastest = float(np.std(speed)), float(np.max(np.abs(speed)))
    if spread > max(_STEADY * fastest, _ROUNDING * rounding):
        return None
    said = _steady(spread, float(np.mean(speed))) if fastest > _ROUNDING * rounding else _none(*_STILL)
    return replace(said, rows=sum(len(run.omega) for run in runs), gaps=len(runs) - 1)


def whole_rows(run: Samples, n_p: int) -> list[Rows]:
    """The complete rows of a run, cut where a value is no number."""
    columns = (run.theta_e, run.omega_e, run.i_d, run.i_q, run.i_d_mean, run.i_q_mean)
    finite: Bools = np.logical_and.reduce([np.isfinite(column) for column in columns if column is not None])
    return [rows_of(run[a:b], n_p) for a, b in stretches(finite) if b - a > STEPS]


def mechanics_of(runs: Sequence[Rows], machine: Machine, std: Mapping[str, float], step: float) -> Mechanics:
    """What rows say. `step`: of the encoder, rad electrical; 0: not known."""
    rows, gaps = sum(len(run.omega) for run in runs), max(0, len(runs) - 1)
    said = _said(runs, Torque.of(machine, std), step)
    return replace(said, rows=rows, gaps=gaps)


def _said(runs: Sequence[Rows], torque: Torque, step: float) -> Mechanics:
    if not runs:
        return _none(Told.NO_DATA, "there are no rows")
    T, longest = runs[0].T, max(len(run.omega) for run in runs)
    lengths = [M for M in _lengths(T) if longest > STEPS * M]
    if not lengths or sum(len(run.omega) for run in runs) < FEWEST * lengths[0]:
        return _none(Told.NO_DATA, f"expected {FEWEST * _lengths(T)[0] * T:.2g} s without gaps at least")
    noise = noise_of_angle(runs)
    fastest = [max(float(np.max(np.abs(mean_over(run.omega, M)))) for run in runs if len(run.omega) >= M)
               for M in lengths]

    def fits(beside: Sequence[Suspect]) -> list[Fit]:
        found = (fit_of(runs, M, torque, noise, step, speed, beside) for M, speed in zip(lengths, fastest, strict=True))
        return [fit for fit in found if fit is not None]

    every = fits(())
    clear = [fit for fit in every if fit.noise < _CLEAR]
    if not clear:
        return _unclear(every, min(fastest))
    best = _best(clear)
    suspects: dict[Suspect, float] = {}
    for fit in _asked(clear, best):
        suspects = suspects_of(fit) | suspects
    if suspects:
        clear = [fit for fit in fits(tuple(suspects)) if fit.noise < _CLEAR]
        best = _best(clear)
    if best.relative > _CLOSE or best.explained < _FOLLOWS:
        return _untold(best)
    left = max((unexplained(fit), fit.M) for fit in _asked(clear, best))
    return _told(best, T, suspects, left[0], STEPS * left[1] * T)


def _best(clear: Sequence[Fit]) -> Fit:
    """The fit that tells J most closely."""
    return min(clear, key=lambda fit: fit.relative)


def _asked(clear: Sequence[Fit], best: Fit) -> list[Fit]:
    """Fits that are asked whether the equation holds: the best, and those of shorter stretches with little noise."""
    return [fit for fit in clear if fit is best or (fit.M < best.M and fit.noise < _QUIET)]


def _lengths(T: float) -> list[int]:
    """Rows of a step, each twice the one before."""
    first = max(2, math.ceil(SHORTEST / T - 1e-9))
    return [first * 2**k for k in range(32) if k == 0 or first * 2**k * T <= LONGEST * (1.0 + 1e-9)]


def _none(status: Told, sentence: str) -> Mechanics:
    of_each = Status.NO_DATA if status is Told.NO_DATA else Status.NOT_TOLD
    return Mechanics(
        status, sentence, {name: Estimate(name, None, None, UNITS[name], of_each, sentence) for name in PARAMETERS}
    )


_STILL: Final = (Told.NO_ACCELERATION, "the shaft stands still")


def _steady(spread: float, mean: float) -> Mechanics:
    return _none(
        Told.NO_ACCELERATION, f"the shaft does not accelerate: its speed changes by {spread:.2g} rad/s rms at "
        f"{mean:.3g} rad/s; let it swing, by speed_step",
    )  # fmt: skip


def _unclear(every: Sequence[Fit], fastest: float) -> Mechanics:
    """Of stretches of any length, none has an acceleration beyond the angle's noise."""
    if every:
        return _none(Told.NO_ACCELERATION, "the shaft does not accelerate by more than the angle's noise")
    if fastest == 0.0:
        return _none(*_STILL)
    return _none(Told.NOT_TOLD, f"the shaft turns too little: fewer than {FEWEST} stretches do not touch zero speed")


def _untold(fit: Fit) -> Mechanics:
    speed = fit.stretches.omega
    spread = float(np.std(speed))
    if spread < _STEADY * float(np.max(np.abs(speed))):
        return _steady(spread, float(np.mean(speed)))
    if fit.explained < _FOLLOWS:
        return _none(
            Told.NOT_TOLD, "the torque does not follow the acceleration: the shaft is held, or driven by another "
            "machine, or the load changes more than that",
        )  # fmt: skip
    return _none(
        Told.NOT_TOLD, f"J comes out no closer than {fit.beta[0]:.2g} +- {Z_95 * fit.std[0]:.1g} kg m2: the shaft "
        "accelerates too little beside what else its torque does",
    )  # fmt: skip


def _told(fit: Fit, T: float, suspects: Mapping[Suspect, float], left: float, over: float) -> Mechanics:
    torque_rms = float(fit.beta[0]) * fit.moved
    residual_rms = float(np.sqrt(np.mean(fit.residual**2)))
    soft = ""
    if left > _RIGID:
        soft = (
            f"over stretches of {1e3 * over:.3g} ms the equation leaves {math.sqrt(left):.2g} of the torque that "
            "accelerates the shaft: it gives way or has play, or friction or load are of another kind"
        )
    doubts = {suspect.parameter: f"{suspect.clause}, by {torque:.2g} Nm rms" for suspect, torque in suspects.items()}
    estimates, told_sum = _estimates(fit, soft, doubts)
    sentence = "; ".join([*([soft] if soft else []), *doubts.values(), *_unphysical(estimates)])
    status = Told.DOUBTFUL if sentence else Told.OK
    return Mechanics(
        status, sentence, estimates, told_sum, fit.direction, STEPS * fit.M * T, len(fit.stretches), torque_rms,
        residual_rms,
    )  # fmt: skip


def _estimates(fit: Fit, soft: str, doubts: Mapping[str, str]) -> tuple[dict[str, Estimate], Estimate | None]:
    """By parameter; and the sum that is told in place of two."""
    estimates: dict[str, Estimate] = {}
    rms = float(np.sqrt(np.mean(fit.tau**2)))
    sizes = np.sqrt(np.mean(fit.columns**2, axis=1))
    for k, beta, std, size in zip(fit.places, fit.beta.tolist(), fit.std.tolist(), sizes.tolist(), strict=True):
        name = PARAMETERS[k]
        half = Z_95 * std
        e = Estimate(name, beta, std, UNITS[name], Status.OK)
        if k > 0 and half * size > _TOLD * rms:
            why = f"{name} cannot be told here: no closer than {beta:.2g} +- {half:.1g} {UNITS[name]}"
            e = Estimate(name, None, None, UNITS[name], Status.NOT_TOLD, why + (_ALIKE if k == B else ""))
        elif reason := "; ".join(filter(None, (soft, doubts.get(name, ""), _driving(name, beta, half)))):
            e = replace(e, status=Status.DOUBTFUL, reason=reason)
        estimates[name] = e
    if not fit.direction:
        return estimates, None
    sign = "+" if fit.direction > 0 else "-"
    told = replace(estimates["tau_L"], name=f"tau_L {sign} T_C")
    why = f"tau_L and T_C cannot be told apart: the shaft turns in one direction only; tau_L {sign} T_C is told"
    for name in ("T_C", "tau_L"):
        estimates[name] = Estimate(name, None, None, UNITS[name], Status.NOT_TOLD, why)
    return {name: estimates[name] for name in PARAMETERS}, told


_ALIKE: Final = "; all speeds are about alike"


def _driving(name: str, value: float, half: float) -> str:
    """Friction below zero by more than its interval, a clause."""
    return f"{name} comes out below zero: no friction drives" if name in ("B", "T_C") and value < -1.5 * half else ""


def _unphysical(estimates: Mapping[str, Estimate]) -> list[str]:
    return [
        reason for e in estimates.values() if e.value is not None and e.std is not None
        if (reason := _driving(e.name, e.value, Z_95 * e.std))
    ]
