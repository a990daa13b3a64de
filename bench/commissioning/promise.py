"""What a tuning promises: the loops' answers to a reference, by their gains and the motor's parameters.

**Current**, an axis alone, its cross-coupling fed forward, that of the speed, which q's current moves, by the one
measured over the period before, filtered:

    i[k+1] = a i[k] + (1 - a)/R_s (u[k-1] - psi_d omega + psi_set omega_f[k-1])      a = exp(-R_s T_s / L)
    u[k] = k_p e[k] + T_s k_i sum(e)              e = i_ref - i

**Speed**, behind the current loop of q; the speed it controls by is the mean over the period before, filtered:

    omega[k+1] = omega[k] + T_s (K (i_q[k] + i_q[k+1])/2 - B/J omega[k])
    K = 1.5 n_p^2 (psi_f + (L_d - L_q) i_d) / J

References are those of a trial, and what comes of them is averaged as the trial's recording is: what is left from the
step before is in both.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from bench.commissioning.response import Column

_SEED: Final = 1


@dataclass(frozen=True, slots=True)
class CurrentLoop:
    """Gains, an axis of the motor, and what the speed does to it."""

    k_p: float  # V/A
    k_i: float  # V/(A s)
    R_s: float  # ohm
    L: float  # H
    T_s: float  # s
    back_emf: float = 0.0  # V/(s A): psi_d K, the rate at which a current's torque changes it; 0 for the d axis
    fed_share: float = 1.0  # of the back-EMF, that is fed forward
    speed_filter: float = 0.0  # s

    def answer(self, reference: Column) -> Column:
        """Current to a reference, every control period, both in A."""
        y, axis = np.empty(len(reference)), _Axis(self)
        for k, wanted in enumerate(reference):
            y[k] = axis.i
            axis.step(wanted)
        return y


class _Axis:
    """A current loop under way; `i` (A) is the current at the present sample."""

    def __init__(self, loop: CurrentLoop) -> None:
        self._loop, self.i, self._integral = loop, 0.0, 0.0
        self._share = math.exp(-loop.R_s * loop.T_s / loop.L)
        self._u = self._fed = 0.0  # V, computed a period ago
        self._emf = self._mean = self._filtered = 0.0  # V: now, over the period before, and by the filtered speed

    def step(self, wanted: float) -> None:
        """One control period, at whose beginning so much (A) is wanted."""
        loop, T_s, a = self._loop, self._loop.T_s, self._share
        e = wanted - self.i
        u = loop.k_p * e + self._integral
        self._integral += T_s * loop.k_i * e
        self._filtered += (self._mean - self._filtered) * T_s / (loop.speed_filter + T_s)
        emf = self._emf + T_s * loop.back_emf * self.i
        self._mean = 0.5 * (self._emf + emf)
        self.i = a * self.i + (1.0 - a) / loop.R_s * (self._u + self._fed - self._mean)
        self._u, self._fed, self._emf = u, loop.fed_share * self._filtered, emf


@dataclass(frozen=True, slots=True)
class SpeedLoop:
    """Gains, and the shaft behind the current control."""

    k_p: float  # A s/rad
    k_i: float  # A/rad
    K: float  # rad/(s2 A), electrical acceleration by i_q
    damping: float  # 1/s, B/J
    current: CurrentLoop  # of the q axis
    speed_filter: float  # s

    def answer(self, reference: Column) -> Column:
        """Mean speed of every control period to a reference, both in rad/s."""
        T_s, y, axis = self.current.T_s, np.empty(len(reference)), _Axis(self.current)
        share = T_s / (self.speed_filter + T_s)
        omega = mean = filtered = integral = 0.0
        for k, wanted in enumerate(reference):
            filtered += (mean - filtered) * share
            e = wanted - filtered
            i_q = axis.i
            axis.step(self.k_p * e + integral)
            integral += self.k_i * T_s * e
            gained = T_s * (0.5 * self.K * (i_q + axis.i) - self.damping * omega)
            y[k] = mean = omega + 0.5 * gained
            omega += gained
        return y


def to_and_fro(hold: int, count: int, rise: int = 1) -> Column:
    """A reference that steps between 0 and 1 at every `hold` samples, `count` times; in `rise` of them it is there."""
    way = np.ones(hold)
    way[: rise - 1] = np.arange(1, rise) / (rise - 0.5)
    ends = np.arange(count) % 2
    before = np.concatenate(([0], ends[:-1]))
    return (before[:, None] + (ends - before)[:, None] * way).ravel()


def at_random(hold: int, count: int) -> Column:
    """A reference that is 0 or 1 for `hold` samples each."""
    return np.repeat(np.random.default_rng(_SEED).integers(0, 2, count), hold).astype(np.float64)


def thinned(y: Column, every: int) -> Column:
    """Means over so many samples."""
    return y[: len(y) // every * every].reshape(-1, every).mean(axis=1)
