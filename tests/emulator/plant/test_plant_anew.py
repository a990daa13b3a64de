"""The plant beside machines worked out anew from the effects' documented equations, in other variables.

Shorted turns and unequal phases in phase quantities, a matrix of inductances and a star point; saturation, harmonics,
iron, skin and a compliant shaft from one energy that is differentiated by differences.
"""

import cmath
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.drive.assembly import plant_of_scenario
from emulator.plant.dynamics import Plant, PlantState, advanced, motor_current, settled, started
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.imbalance import Imbalance
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import vector as held
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.skin import Skin
from emulator.plant.physics.turn_short import TurnShort, loop_inductance
from emulator.scenario.scenarios import Run, Scenario
from tests.emulator.plant.physics.effect_runs import SALIENT as M
from tests.emulator.plant.physics.effect_runs import with_effects

T = 1e-4  # s
AXES = np.array([0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0])
Array = NDArray[np.complexfloating | np.floating]


def integrated(rate: Callable[[float, Array], Array], x: Array, time: float, steps: int) -> Array:
    h = time / steps
    for n in range(steps):
        t = n * h
        k_1 = rate(t, x)
        k_2 = rate(t + h / 2.0, x + h / 2.0 * k_1)
        k_3 = rate(t + h / 2.0, x + h / 2.0 * k_2)
        x = x + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + rate(t + h, x + h * k_3))
    return x


def by_the_emulator(scenario: Scenario, u: complex, i_dq: complex, periods: int) -> tuple[Plant, PlantState]:
    _, plant = plant_of_scenario(scenario)
    state = started(plant, 0.0, scenario.profile.omega_0, i_dq)
    for n in range(periods):
        state = settled(plant, (n + 1) * T, advanced(plant, held(u, 310.0), n * T, T, 20, state))
    return plant, state


@pytest.mark.parametrize("phase", [0, 1, 2])
def test_shorted_turns_and_unequal_phases_are_as_in_phase_quantities(phase: int) -> None:
    short, unequal, rpm, u, i_dq = TurnShort(0.3, 0.4, phase), Imbalance(0.2, -0.1, 0.05), 1500.0, 30j + 5.0, 1.0 + 2j
    scenario = with_effects(run=Run(speed_rpm=rpm), turn_short=short, imbalance=unequal)
    plant, state = by_the_emulator(scenario, u, i_dq, 20)

    w, L_t, mu = M.n_p * rpm * math.pi / 30.0, loop_inductance(short, M.R_s), short.share
    mean, swing = (M.L_d + M.L_q) / 3.0, (M.L_d - M.L_q) / 3.0
    apart, along = AXES[:, None] - AXES, AXES[:, None] + AXES
    R, v = M.R_s * (1.0 + np.array(unequal)), np.array([(u * cmath.exp(-1j * axis)).real for axis in AXES])

    def rate(t: float, x: Array) -> Array:
        i, i_t, theta, k = x[:3], x[3], w * t, phase
        short_turns = np.eye(3)[k] * mu * i_t
        L = mean * np.cos(apart) + swing * np.cos(2.0 * theta - along)
        motional = w * (-2.0 * swing * np.sin(2.0 * theta - along) @ (i - short_turns) - M.psi_f * np.sin(theta - AXES))
        # Unknown: the rates of i and i_t, and the star point's voltage
        A, b = np.zeros((5, 5)), np.zeros(5)
        A[:3, :3], A[:3, 3], A[:3, 4], b[:3] = L, -mu * L[:, k], 1.0, v - R * (i - short_turns) - motional
        A[3, :3], A[3, 3] = -mu * L[k], L_t + mu**2 * L[k, k]
        b[3] = mu * (R[k] * i[k] + motional[k]) - (short.R_t + mu * R[k]) * i_t
        A[4, :3] = 1.0
        return np.linalg.lstsq(A, b, rcond=None)[0][:4]

    begun = np.array([*(i_dq * np.exp(-1j * AXES)).real, 0.0])
    expected = integrated(rate, begun, 20 * T, 1000)
    found = (motor_current(plant, state) * np.exp(-1j * AXES)).real
    assert np.append(found, state.i_t) == pytest.approx(expected, abs=1e-4)
    assert abs(expected[3]) > 1.0


def test_field_iron_skin_and_shaft_together_are_as_from_one_energy() -> None:
    iron, ripple, skin = IronLoss(150.0, 800.0, 2e-4), Harmonics(0.02, 0.03, 0.01, -0.01, 0.05, 0.04), Skin(0.4, 600.0)
    sizes, shaft, tau_L, u = Saturation(0.1, 0.25, 0.1), Compliance(300.0, 0.02, 5e-4), 0.5, cmath.rect(40.0, 1.0)
    scenario = with_effects(
        run=Run(shaft="free", speed_rpm=900.0, tau_L=tau_L), iron_loss=iron, harmonics=ripple, skin=skin,
        saturation=sizes, compliance=shaft,
    )  # fmt: skip
    _, state = by_the_emulator(scenario, u, 0.5 + 1j, 30)
    _, begun = by_the_emulator(scenario, u, 0.5 + 1j, 0)

    i_rated, psi_f = M.i_rated, M.psi_f
    by_d = (1.0 - sizes.L_d_drop) * M.L_d * i_rated  # Vs, at rated current
    by_q = (1.0 - sizes.L_q_drop) * M.L_q * i_rated
    a_d = (i_rated - by_d / M.L_d) / ((psi_f + by_d) ** 3 - psi_f**3 - 3.0 * psi_f**2 * by_d)
    a_q = (i_rated - by_q / M.L_q) / by_q**3
    c = sizes.cross_drop / (1.0 - sizes.cross_drop) / M.L_q / ((psi_f + by_d) ** 2 - psi_f**2)
    g_d, g_q = 1.0 / M.L_d - 3.0 * a_d * psi_f**2, 1.0 / M.L_q - c * psi_f**2

    def energy(psi: complex, theta: float) -> float:
        six = 6.0 * theta
        x = psi - psi_f * complex(
            ripple.d_6 * math.cos(six) + ripple.d_12 * math.cos(2.0 * six),
            ripple.q_6 * math.sin(six) + ripple.q_12 * math.sin(2.0 * six),
        )
        d, q = x.real, x.imag
        smooth = g_d * d * d / 2.0 + a_d * d**4 / 4.0 + g_q * q * q / 2.0 + a_q * q**4 / 4.0 + c * (d * q) ** 2 / 2.0
        magnets = (g_d * psi_f + a_d * psi_f**3) * d
        return smooth - magnets + ripple.inductance / M.L_q * math.cos(six) * abs(x - psi_f) ** 2 / 2.0

    def slope(of: Callable[[float], float]) -> float:
        return (of(1e-5) - of(-1e-5)) / 2e-5

    def rate(_: float, x: Array) -> Array:
        psi, i_i, i_x = (complex(value) for value in x[:3])
        omega_m, theta_m, omega_L, twist = (float(value.real) for value in x[3:])
        theta = M.n_p * theta_m
        p = psi * cmath.exp(-1j * theta)
        i = complex(slope(lambda e: energy(p + e, theta)), slope(lambda e: energy(p + 1j * e, theta)))
        pull = p.real * i.imag - p.imag * i.real - slope(lambda e: energy(p, theta + e))
        tau = 1.5 * M.n_p * pull - ripple.cogging * math.sin(6.0 * theta)
        i_s, R_x = i * cmath.exp(1j * theta) + i_i, 2.0 * skin.rise * M.R_s
        u_x = R_x * (i_s - i_x)
        e = u - M.R_s * i_s - u_x
        speed = M.n_p * abs(omega_m) + 10.0
        R_i = iron.R_c * speed / (speed + iron.omega_h)
        tau_s = shaft.stiffness * twist + shaft.damping * (omega_m - omega_L)
        return np.array([
            e, (e - R_i * i_i) / (iron.lag * iron.R_c), u_x * 2.0 * math.pi * skin.frequency / R_x,
            (tau - M.B * omega_m - tau_s) / M.J, omega_m, (tau_s - tau_L) / shaft.J_L, omega_m - omega_L,
        ])  # fmt: skip

    def listed(s: PlantState) -> Array:
        return np.array([s.psi, s.i_i, s.i_x, s.omega_m, s.theta_m, s.omega_L, s.twist])

    expected = integrated(rate, listed(begun), 30 * T, 600)
    assert listed(state) == pytest.approx(expected, rel=1e-5)
