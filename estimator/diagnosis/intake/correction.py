"""Corrections: columns that follow another convention, brought to the one expected. Knows not which one is needed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.online.flux_balance import TURN
from estimator.samples import LeftOut, Resolution, Samples

TURNS_TO_DEGREES: Final = 360.0 / TURN
TURNS: Final = 1.0 / TURN
"""Units of an angle over rad; such columns wrap at another number."""

MIRROR: Final = 1  # mirrored in the rotor frame
PHASES: Final = 2  # mirrored in the stationary frame


@dataclass(frozen=True, slots=True)
class Correction:
    """What was done to the columns; undone in the order angle, voltages and currents, rows, time."""

    u: complex = 1.0  # recorded over expected: scale, and turned by an angle
    i: complex = 1.0
    u_mirrored: int = 0  # 0, AXES or PHASES; before it was scaled and turned
    i_mirrored: int = 0
    theta: float = 1.0  # recorded over expected
    omega: float = 1.0
    T_s: float = 1.0
    u_shift: int = 0  # rows by which the column is late
    theta_shift: int = 0
    per_unit: float = 0.0  # base of voltages over the dc link; 0: they are in V
    whole: bool = False  # the angle is the integral of the speed, and no turn of it is hidden

    def angle(self, theta: Array) -> Array:
        """Expected angle, unwrapped along the last axis, from the recorded one."""
        if self.whole:
            return theta / self.theta
        unit = self.theta if self.theta in (TURNS_TO_DEGREES, TURNS) else 1.0
        theta = theta / unit
        turned = np.diff(theta)
        D = turned - TURN * np.floor(turned / TURN + 0.5)
        whole = np.concatenate((theta[..., :1], theta[..., :1] + np.cumsum(D, axis=-1)), axis=-1)
        return whole * (unit / self.theta)

    def current(self, i: Vector, theta: Array) -> Vector:
        """Expected currents from the recorded ones and the expected angle at samples."""
        return _straight(i / self.i, self.i_mirrored, theta)

    def voltage(self, u: Vector, theta: Array, u_dc: Array | None) -> Vector:
        """Expected voltages from the recorded ones and the expected angle in the periods' middle."""
        u = _straight(u / self.u, self.u_mirrored, theta)
        return u * (self.per_unit * u_dc) if self.per_unit and u_dc is not None else u

    def undone(self, runs: Sequence[Samples]) -> tuple[Samples, ...]:
        """The recording as expected."""
        return tuple(part for run in runs if (part := self._undone(run)) is not None)

    def _undone(self, run: Samples) -> Samples | None:
        n = len(run)
        if n < 2 + abs(self.u_shift) + abs(self.theta_shift):
            return None
        theta = self.angle(run.theta_e)
        D = np.diff(theta, append=2.0 * theta[-1] - theta[-2])
        i = self.current(run.i_d + 1j * run.i_q, theta)
        u = self.voltage(run.u_d + 1j * run.u_q, theta + 0.5 * D, run.u_dc)
        late = (self.u_shift, self.theta_shift, 0)
        first, last = -min(late), n - max(late)  # rows that have all columns

        def at(column: Array, shift: int = 0) -> Array:
            return np.ascontiguousarray(column[first + shift : last + shift])

        scale = abs(self.i) if (self.i.imag or self.i.real > 0.0) else -abs(self.i)
        phases = [None if column is None else at(column / scale) for column in (run.i_a, run.i_b, run.i_c)]
        T_s = run.T_s / self.T_s
        told = run.resolution  # counts as they should be, numbers as they are
        return replace(
            run, theta_e=at(theta, self.theta_shift), omega_e=at(run.omega_e / self.omega),
            i_d=at(i.real), i_q=at(i.imag), u_d=at(u.real, self.u_shift), u_q=at(u.imag, self.u_shift),
            T_s=T_s, t0=run.t0 / self.T_s + first * T_s,
            resolution=Resolution(
                told.i / abs(self.i), told.u / abs(self.u), math.hypot(told.encoder, told.numbers / abs(self.theta)),
                told.encoder,
            ),
            u_dc=None if run.u_dc is None else at(run.u_dc), i_a=phases[0], i_b=phases[1], i_c=phases[2],
            left_out=None if run.left_out is None else self._left_out(run.left_out),
        )  # fmt: skip

    def _left_out(self, told: LeftOut) -> LeftOut:
        turned = told.turned
        if turned is not None:  # turns are counted by angle, speed and time: not where one of them is in another unit
            off = self.theta in (TURNS_TO_DEGREES, TURNS) or self.omega != 1.0 or self.T_s != 1.0
            turned = None if off else turned / self.theta
        return LeftOut(turned, told.heat / abs(self.i) ** 2 / self.T_s)


def _straight(x: Vector, mirrored: int, theta: Array) -> Vector:
    if mirrored == MIRROR:
        return x.conj()
    return x.conj() * np.exp(-2j * theta) if mirrored == PHASES else x
