"""Chance: numbers that follow from a seed, a recording's number and a purpose, whoever else draws meanwhile."""

import math
import random
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Chance:
    """Numbers of one purpose, one after the other.

    Only `random()` is used of Python's generator: seeded with a text, it gives the same numbers in every version.
    """

    def __init__(self, seed: int, number: int, purpose: str) -> None:
        self._draw = random.Random(f"{seed} {number} {purpose}").random

    def uniform(self, low: float, high: float) -> float:
        """Evenly between two numbers."""
        return low + (high - low) * self._draw()

    def log_uniform(self, low: float, high: float) -> float:
        """Between two numbers above zero, evenly in their logarithm."""
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def one_of(self, choices: Sequence[T]) -> T:
        """Each as likely as the others."""
        return choices[int(self._draw() * len(choices))]

    def happens(self, share: float) -> bool:
        """True in that share of the cases."""
        return self._draw() < share

    def sign(self) -> float:
        """1 or -1."""
        return 1.0 if self._draw() < 0.5 else -1.0

    def angle(self) -> float:
        """0 to 2 pi."""
        return self.uniform(0.0, 2.0 * math.pi)

    def seed(self) -> int:
        """For another generator."""
        return int(self._draw() * 2.0**53)
