"""A witness: a parameter's value as something else than the recording has measured it, with its error.

It is one more row of the regression, x_j = value + N(0, std^2): the update of a normal posterior (R. E. Kalman, A new
approach to linear filtering and prediction problems, 1960, doi 10.1115/1.3662552). One that contradicts the recording
is not averaged with it. Knows nothing of fits.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

CONTRADICTS: Final = 3.0  # joint standard errors


class Witness(NamedTuple):
    """What was measured."""

    value: float  # SI
    std: float  # SI, standard error

    def apart(self, value: float, std: float) -> float:
        """Joint standard errors between it and another value."""
        return abs(value - self.value) / math.hypot(std, self.std)


def updated(
    x: NDArray[np.float64], covariance: NDArray[np.float64], places: Sequence[int], witnesses: Sequence[Witness]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values and their covariance with a witness of each place."""
    H = np.eye(len(x))[list(places)]
    R = np.diag([one.std**2 for one in witnesses])
    K = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
    left = np.eye(len(x)) - K @ H
    return x + K @ (np.array([one.value for one in witnesses]) - H @ x), left @ covariance @ left.T + K @ R @ K.T
