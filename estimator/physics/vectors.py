"""Space vectors: the phases' directions, and how a current's vector follows a flux linkage's. Amplitude-invariant."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector

AXES: Final = tuple(complex(math.cos(k * math.tau / 3.0), math.sin(k * math.tau / 3.0)) for k in range(3))
"""Directions of the phases a, b, c."""


@dataclass(frozen=True, slots=True, eq=False)
class Stiffness:
    """d(i)/d(psi) at samples, 1/H: of a flux linkage v, a v + b conj(v)."""

    a: Array
    b: Vector

    def __call__(self, v: Vector) -> Vector:
        """Current (A) that belongs to a small flux linkage (Vs)."""
        return self.a * v + self.b * v.conj()

    def __sub__(self, other: "Stiffness") -> "Stiffness":
        return Stiffness(self.a - other.a, self.b - other.b)

    def flux(self, i: Vector) -> Vector:
        """Flux linkage (Vs) that belongs to a small current (A); no number where a curve that is tried is too bent."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return (self.a * i - self.b * i.conj()) / (self.a * self.a - self.b.real**2 - self.b.imag**2)

    def __getitem__(self, samples: slice) -> "Stiffness":
        """At some samples."""
        return Stiffness(self.a[samples], self.b[samples])


def by_phase(alpha: float, beta: float) -> tuple[float, float, float]:
    """What a vector is on the three phases."""
    a, b, c = ((complex(alpha, beta) * axis.conjugate()).real for axis in AXES)
    return a, b, c
