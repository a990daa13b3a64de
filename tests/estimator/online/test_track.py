"""Tracking a window over a run gives numpy's least squares at every row."""

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.machine import PARAMETERS
from estimator.online.flux_balance import Balance, flux_balance
from estimator.online.track import track
from tests.support.samples import streamed

BALANCE = flux_balance(streamed(VirtualDrive(PAPER), 6000))


def equations(balance: Balance) -> tuple[np.ndarray, np.ndarray]:
    """Regressors and voltages of both axes."""
    i_d, i_q, x_d, x_q, y_d, y_q, s, _, u_d, u_q = balance.T
    A_d = np.stack([i_d, x_d, -y_q, 0 * s], axis=1)
    A_q = np.stack([i_q, y_d, x_q, s], axis=1)
    return np.concatenate([A_d, A_q]), np.concatenate([u_d, u_q])


@pytest.mark.parametrize("length", [50, 333, 2048, 5000])
@pytest.mark.parametrize("held", [{}, {"psi_f": 0.121}, {"R_s": 0.9, "L_q": 6e-3}])
def test_every_row_has_the_least_squares_solution_of_its_window(length: int, held: dict[str, float]) -> None:
    free = [name for name in PARAMETERS if name not in held]
    tracked = track(BALANCE, length, free, held)
    assert np.isnan(tracked[: length - 1]).all()
    at = [PARAMETERS.index(name) for name in free]
    for k in {length - 1, length, length + 1, 5500, len(BALANCE) - 1} - set(range(length - 1)):
        A, u = equations(BALANCE[k - length + 1 : k + 1])
        rest = u - sum(A[:, PARAMETERS.index(name)] * value for name, value in held.items())
        assert tracked[k, at] == pytest.approx(np.linalg.lstsq(A[:, at], rest)[0], rel=1e-9)
        for name, value in held.items():
            assert tracked[k, PARAMETERS.index(name)] == value


def test_a_window_that_cannot_be_solved_has_no_value() -> None:
    assert np.isnan(track(np.zeros((100, 10)), 20)).all()
