"""The plant: machine and shaft under a constant voltage, integrated over one control period.

State is the flux linkage in the stationary frame, where the voltage of a period is constant:

    d(psi)/dt = u - R_s i        d(theta_m)/dt = omega_m        d(omega_m)/dt: see `mechanics`

by the classic Runge-Kutta method of fourth order in equal sub-steps. Three energies are integrated beside
it, so that the power balance can be drawn.
"""

from typing import NamedTuple

from emulator.frames import turned, wrapped
from emulator.kernel import kernel
from emulator.machine import Machine, current, torque
from emulator.mechanics import Shaft, acceleration, profile_speed


class PlantState(NamedTuple):
    """State of the plant, and by the same fields its rate of change per second."""

    psi: complex  # Vs, stationary frame
    omega_m: float  # rad/s
    theta_m: float  # rad
    W_in: float  # J, electrical energy taken in since the start
    W_copper: float  # J, turned to heat in R_s
    W_shaft: float  # J, given to the shaft


@kernel
def stator_current(machine: Machine, state: PlantState) -> complex:
    """Stationary current vector (A)."""
    rotor = turned(machine.n_p * state.theta_m)
    return rotor * current(machine, state.psi * rotor.conjugate())


@kernel
def rate(machine: Machine, shaft: Shaft, u: complex, t: float, state: PlantState) -> PlantState:
    """Rate of change of the state at a time t (s) under the stationary voltage u (V)."""
    psi, R_s = state.psi, machine.R_s
    i = stator_current(machine, state)
    tau_e = torque(machine, psi, i)
    omega_m = profile_speed(shaft.profile, t) if shaft.held else state.omega_m
    return PlantState(
        u - R_s * i,
        0.0 if shaft.held else acceleration(shaft, tau_e, omega_m),
        omega_m,
        1.5 * (u.real * i.real + u.imag * i.imag),
        1.5 * R_s * (i.real * i.real + i.imag * i.imag),
        tau_e * omega_m,
    )


@kernel
def moved(state: PlantState, along: PlantState, h: float) -> PlantState:
    """state + h along."""
    return PlantState(
        state.psi + h * along.psi,
        state.omega_m + h * along.omega_m,
        state.theta_m + h * along.theta_m,
        state.W_in + h * along.W_in,
        state.W_copper + h * along.W_copper,
        state.W_shaft + h * along.W_shaft,
    )


@kernel
def advanced(
    machine: Machine, shaft: Shaft, u: complex, t: float, T: float, sub_steps: int, state: PlantState
) -> PlantState:
    """The state a time T (s) after t under the constant stationary voltage u (V). theta_m within one turn."""
    h = T / sub_steps
    for n in range(sub_steps):
        t_n = t + n * h
        k_1 = rate(machine, shaft, u, t_n, state)
        k_2 = rate(machine, shaft, u, t_n + h / 2.0, moved(state, k_1, h / 2.0))
        k_3 = rate(machine, shaft, u, t_n + h / 2.0, moved(state, k_2, h / 2.0))
        k_4 = rate(machine, shaft, u, t_n + h, moved(state, k_3, h))
        state = moved(moved(moved(moved(state, k_1, h / 6.0), k_2, h / 3.0), k_3, h / 3.0), k_4, h / 6.0)
    omega_m = profile_speed(shaft.profile, t + T) if shaft.held else state.omega_m
    return PlantState(state.psi, omega_m, wrapped(state.theta_m), state.W_in, state.W_copper, state.W_shaft)
