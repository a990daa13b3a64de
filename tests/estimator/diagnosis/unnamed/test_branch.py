"""A branch's current: that of its differential equation, by pulses or by mean voltages, and after a pause."""

from itertools import pairwise

import numpy as np
import pytest

from estimator.arrays import Vector
from estimator.diagnosis.unnamed.branch import current_of
from estimator.machine import Machine
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows, rows_of
from estimator.physics.vectors import AXES
from estimator.samples import Samples

T_S, U_DC, N, STEPS = 1e-4, 300.0, 60, 20
F, DAMPING = 0.17, 0.05  # of the sampling rate; over the critical one
MACHINE = Machine(0.5, 2e-3, 3e-3, 0.1, n_p=3, i_rated=10.0)


def run(*, dc_link: bool) -> Samples:
    """A voltage that turns and jumps, of a rotor at 40 Hz."""
    n = N + 1
    theta = TURN * 40.0 * T_S * np.arange(n, dtype=np.float64)
    u_d, u_q = np.full(n, 60.0), np.full(n, 20.0)
    u_d[N // 2 :], u_q[N // 2 :] = 90.0, -40.0
    return Samples(
        theta_e=theta, omega_e=np.full(n, TURN * 40.0), i_d=np.zeros(n), i_q=np.zeros(n), u_d=u_d, u_q=u_q, T_s=T_S,
        u_dc=np.full(n, U_DC) if dc_link else None,
    )  # fmt: skip


def integrated(recording: Rows, *, pulses: bool) -> Vector:
    """L i at samples by the Runge-Kutta method from edge to edge; settled at the start, as `current_of` has it."""
    w, u_s = TURN * F / T_S, recording.u * recording.middle
    x, found = np.array([0j, u_s[0]]), np.zeros(N + 1, np.complex128)  # L i, voltage of the capacitor

    def rate(x: Vector, u: complex) -> Vector:
        return np.array([u - x[1] - 2.0 * DAMPING * w * x[0], w * w * x[0]])

    for k in range(N):
        d = recording.duties[k] if pulses else np.ones(3)
        edges = np.unique(np.concatenate(([0.0, 1.0], 0.5 - 0.5 * d, 0.5 + 0.5 * d)))
        for a, b in pairwise(edges.tolist()):
            legs = sum(axis for axis, high in zip(AXES, abs(0.5 * (a + b) - 0.5) < 0.5 * d, strict=True) if high)
            u, h = 2.0 / 3.0 * U_DC * legs if pulses else complex(u_s[k]), (b - a) * T_S / STEPS
            for _ in range(STEPS):
                k_1 = rate(x, u)
                k_2 = rate(x + 0.5 * h * k_1, u)
                k_3 = rate(x + 0.5 * h * k_2, u)
                x = x + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + rate(x + h * k_3, u))
        found[k + 1] = x[0]
    return found


@pytest.mark.parametrize("dc_link", [True, False])
def test_its_current_is_that_of_its_differential_equation(dc_link: bool) -> None:
    recording = rows_of([run(dc_link=dc_link)], MACHINE, 10.0)
    expected = integrated(recording, pulses=dc_link)
    assert np.max(np.abs(current_of(recording, F, DAMPING) - expected)) < 1e-6 * np.max(np.abs(expected))


def test_a_run_after_a_pause_begins_settled() -> None:
    one, two = (rows_of([run(dc_link=True)] * runs, MACHINE, 10.0) for runs in (1, 2))
    assert current_of(two, F, DAMPING)[-N:] == pytest.approx(current_of(one, F, DAMPING)[-N:])
