"""Recordings of emulated drives as samples, and what users do to them. Written out here by hand: nothing of the
estimator's corrections is used."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.conceal.recording import Choice, drawn
from emulator.scenario.motors import MOTORS
from estimator.machine import Machine
from estimator.samples import Samples
from tests.support.samples import machine_of

Vectors = NDArray[np.complex128]
Real = NDArray[np.float64]
Runs = tuple[Samples, ...]
Recorded = tuple[Runs, Machine]
Error = Callable[[Samples, Machine], tuple[Samples, Machine]]

TURN: Final = 2.0 * math.pi
LENGTH: Final = 2.0  # s
COLUMNS: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "u_dc", "i_a", "i_b", "i_c")
SOME: Final = ("none", "two", "dead_time", "saturation_q", "iron_loss", "current_gain", "resonance")
"""Kinds of recordings: one of each sort of physics."""


def some_soon(kinds: Iterable[str]) -> list[Any]:
    """Values of a test of every kind: all but `SOME` are for those who wait."""
    return [kind if kind in SOME else pytest.param(kind, marks=pytest.mark.slow) for kind in kinds]


@cache
def recording(kind: str, number: int, seed: int = 21, length: float = LENGTH) -> Recorded:
    """Runs without gaps of a concealed recording, and the data sheet of its motor."""
    concealed, c = drawn(Choice(seed, (kind,), (0.0, 1.0), tuple(MOTORS), length), number)
    T_s = concealed.scenario.drive.T_s
    nominal = machine_of(MOTORS[concealed.drawn.motor].machine)
    tick = np.rint(np.asarray(c["t"]) / T_s).astype(int)
    runs: list[Samples] = []
    for rows in np.split(np.arange(len(tick)), np.flatnonzero(np.diff(tick) != 1) + 1):
        theta_e, omega_e, i_d, i_q, u_d, u_q, u_dc, i_a, i_b, i_c = (np.array(c[name][rows], float) for name in COLUMNS)
        runs.append(Samples(theta_e, omega_e, i_d, i_q, u_d, u_q, T_s, t0=float(T_s * tick[rows[0]]), u_dc=u_dc,
                            i_a=i_a, i_b=i_b, i_c=i_c))  # fmt: skip
    return tuple(run for run in runs if len(run) > 4), nominal


def made(error: Error, recorded: Recorded) -> Recorded:
    """A recording with a user's error."""
    runs, nominal = recorded
    done = [error(run, nominal) for run in runs]
    return tuple(run for run, _ in done), done[0][1]


def currents(run: Samples) -> Vectors:
    return run.i_d + 1j * run.i_q


def voltages(run: Samples) -> Vectors:
    return run.u_d + 1j * run.u_q


def with_vectors(run: Samples, *, i: Vectors | None = None, u: Vectors | None = None) -> Samples:
    i, u = currents(run) if i is None else i, voltages(run) if u is None else u
    return replace(run, i_d=i.real.copy(), i_q=i.imag.copy(), u_d=u.real.copy(), u_q=u.imag.copy())


# --- Errors


def scaled(u: complex = 1.0, i: complex = 1.0) -> Error:
    """Voltages and currents times a factor."""
    return lambda run, nominal: (with_vectors(run, u=u * voltages(run), i=i * currents(run)), nominal)


def in_per_unit(base: float, *, u_dc_known: bool = True) -> Error:
    def error(run: Samples, nominal: Machine) -> tuple[Samples, Machine]:
        assert run.u_dc is not None
        run = with_vectors(run, u=voltages(run) / (base * run.u_dc))
        return run if u_dc_known else replace(run, u_dc=None), nominal

    return error


def period(factor: float) -> Error:
    return lambda run, nominal: (replace(run, T_s=run.T_s * factor, t0=run.t0 * factor), nominal)


def angle(of: Callable[[Real, Machine], Real]) -> Error:
    """Another angle column, made of the unwrapped one."""
    return lambda run, nominal: (replace(run, theta_e=of(np.unwrap(run.theta_e), nominal)), nominal)


def speed(of: Callable[[Machine], float]) -> Error:
    return lambda run, nominal: (replace(run, omega_e=run.omega_e * of(nominal)), nominal)


def by_speed(of: Callable[[Machine], float]) -> Error:
    """A speed in another unit, and no angle but its integral."""

    def error(run: Samples, nominal: Machine) -> tuple[Samples, Machine]:
        omega_e = run.omega_e * of(nominal)
        turned = 0.5 * run.T_s * (omega_e[1:] + omega_e[:-1])
        return replace(run, omega_e=omega_e, theta_e=np.cumsum(np.r_[0.0, turned])), nominal

    return error


def poles_for_pole_pairs(run: Samples, nominal: Machine) -> tuple[Samples, Machine]:
    """Angle and speed made with twice the pole pairs, which the data sheet says too."""
    twice = np.mod(2.0 * np.unwrap(run.theta_e), TURN)
    return replace(run, theta_e=twice, omega_e=2.0 * run.omega_e), replace(nominal, n_p=2 * nominal.n_p)


def axes_swapped(run: Samples, nominal: Machine) -> tuple[Samples, Machine]:
    return replace(run, i_d=run.i_q, i_q=run.i_d, u_d=run.u_q, u_q=run.u_d), nominal


def phases_swapped(first: int, second: int) -> Error:
    """Currents by the transformation, of phases in another order."""

    def error(run: Samples, nominal: Machine) -> tuple[Samples, Machine]:
        a = TURN / 3.0
        phases = [run.i_d * np.cos(run.theta_e - k * a) - run.i_q * np.sin(run.theta_e - k * a) for k in range(3)]
        phases[first], phases[second] = phases[second], phases[first]
        i_d = sum(2.0 / 3.0 * phases[k] * np.cos(run.theta_e - k * a) for k in range(3))
        i_q = sum(-2.0 / 3.0 * phases[k] * np.sin(run.theta_e - k * a) for k in range(3))
        return replace(run, i_d=np.asarray(i_d), i_q=np.asarray(i_q)), nominal

    return error


def shifted(names: tuple[str, ...], late: int) -> Error:
    """Columns so many rows lower in the file than they belong."""

    def error(run: Samples, nominal: Machine) -> tuple[Samples, Machine]:
        moved = replace(run, **{name: np.roll(getattr(run, name), late) for name in names})
        return moved[max(late, 0) : len(run) + min(late, 0)], nominal

    return error
