"""What a tuning promises: the loops' answers to a reference, by their gains and the motor's parameters.

**Current**, an axis alone, its cross-coupling fed forward; the speed that q's current makes, by the filtered one:

    i[k+1] = a i[k] + (1 - a)/R_s (u[k-1] - psi_f omega[k] + psi_set omega_f[k-1])      a = exp(-R_s T_s / L)
    u[k] = k_p e[k] + T_s k_i sum(e)              e = i_ref - i

**Speed**, the current loop as a first order of its bandwidth alpha, the speed it controls by filtered:

    omega[k+1] = omega[k] + T_s (K i_q[k] - B/J omega[k])       K = 1.5 n_p^2 psi_f / J

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
    back_emf: float = 0.0  # V/(s A): psi_f K, the rate at which a current's torque changes it; 0 for the d axis
    fed_share: float = 1.0  # of the back-EMF, that is fed forward
    speed_filter: float = 0.0  # s

    def answer(self, reference: Column) -> Column:
        """Current to a reference, every control period, both in A."""
        T_s, k_p, k_i = self.T_s, self.k_p, self.k_i
        a = math.exp(-self.R_s * T_s / self.L)
        y, i, u, integral = np.empty(len(reference)), 0.0, 0.0, 0.0
        emf, filtered, fed = 0.0, 0.0, 0.0  # V: there is, by the filtered speed, and fed forward
        for k, wanted in enumerate(reference):
            y[k] = i
            e = wanted - i
            u_next = k_p * e + integral
            integral += T_s * k_i * e
            i = a * i + (1.0 - a) / self.R_s * (u - emf + fed)
            emf += T_s * self.back_emf * i
            fed = self.fed_share * filtered
            filtered += (emf - filtered) * T_s / (self.speed_filter + T_s)
            u = u_next
        return y


@dataclass(frozen=True, slots=True)
class SpeedLoop:
    """Gains, and the shaft behind the current control."""

    k_p: float  # A s/rad
    k_i: float  # A/rad
    K: float  # rad/(s2 A), electrical acceleration by i_q
    damping: float  # 1/s, B/J
    alpha: float  # rad/s, bandwidth of the current control
    speed_filter: float  # s
    T_s: float  # s

    def answer(self, reference: Column) -> Column:
        """Speed to a reference, every control period, both in rad/s."""
        T_s, y = self.T_s, np.empty(len(reference))
        lag, share = 1.0 - math.exp(-self.alpha * T_s), T_s / (self.speed_filter + T_s)
        omega, filtered, i_q, integral = 0.0, 0.0, 0.0, 0.0
        for k, wanted in enumerate(reference):
            y[k] = omega
            filtered += (omega - filtered) * share
            e = wanted - filtered
            i_q += (self.k_p * e + integral - i_q) * lag
            integral += self.k_i * T_s * e
            omega += T_s * (self.K * i_q - self.damping * omega)
        return y


def to_and_fro(hold: int, count: int) -> Column:
    """A reference that steps between 0 and 1 at every `hold` samples, `count` times."""
    return np.repeat(np.arange(count) % 2, hold).astype(np.float64)


def at_random(hold: int, count: int) -> Column:
    """A reference that is 0 or 1 for `hold` samples each."""
    return np.repeat(np.random.default_rng(_SEED).integers(0, 2, count), hold).astype(np.float64)


def thinned(y: Column, every: int) -> Column:
    """Means over so many samples."""
    return y[: len(y) // every * every].reshape(-1, every).mean(axis=1)
