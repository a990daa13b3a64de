"""The plant: machine, shaft and what hangs on them, integrated under a supply.

The state is the flux linkage in the stationary frame, and with it whatever effects remember:

    d(psi)/dt = u - R i                 i_s = i(psi, theta_e) + i_i + 2/3 mu i_t e_k
    d(theta_m)/dt = omega_m             d(omega_m)/dt: see `mechanics`

by the classic Runge-Kutta method of fourth order in equal sub-steps. The energies that come in, turn to heat and leave
by the shaft are integrated beside it, so that the power balance can be drawn. Parameters stand still within a control
period; what magnets and inductances give to the field's energy when they move is told by `given_by`.
"""

import math
from typing import NamedTuple

from emulator.frames import clarke, phases, turned, turned_slightly, wrapped
from emulator.kernel import inlined, kernel
from emulator.plant.machine import Machine
from emulator.plant.magnetics import Magnetics, current_and_pull, field_energy, flux_of, sixth
from emulator.plant.mechanics import Shaft, drag, profile_speed
from emulator.plant.physics import iron_loss
from emulator.plant.physics.compliance import stored_energy as energy_of_the_spring
from emulator.plant.physics.flux_map import FluxMap
from emulator.plant.physics.imbalance import Imbalance, axis_of, drop, share_of
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.iron_loss import stored_energy as energy_of_the_iron
from emulator.plant.physics.legs import Supply, lost
from emulator.plant.physics.skin import Skin, rung_inductance, rung_resistance
from emulator.plant.physics.skin import stored_energy as energy_of_the_rung
from emulator.plant.physics.strangers import Resonance, Stray, stray_voltage
from emulator.plant.physics.strangers import stored_energy as energy_of_the_branch
from emulator.plant.physics.turn_short import TurnShort, loop_inductance
from emulator.plant.physics.turn_short import stored_energy as energy_of_the_loop


class Plant(NamedTuple):
    """What the plant is during one control period."""

    machine: Machine
    R_cold: float  # ohm, R_s at 23.4 degC, by which inductances beside the main ones are told
    magnetics: Magnetics
    flux_map: FluxMap
    shaft: Shaft
    iron: IronLoss
    imbalance: Imbalance
    skin: Skin
    short: TurnShort
    stray: Stray
    telegraph: complex  # V, stationary, that a telegraph offset adds now
    resonance: Resonance
    filter_time: float  # s, of the filter before the current converter; 0: none


class PlantState(NamedTuple):
    """State of the plant, and by the same fields its rate of change per second."""

    psi: complex  # Vs, stationary frame
    i_i: complex  # A, of the iron
    i_x: complex  # A, past the rung of the skin effect
    i_t: float  # A, in shorted turns
    i_r: complex  # A, of the branch at the terminals
    v_r: complex  # V, on its capacitor
    omega_m: float  # rad/s
    theta_m: float  # rad
    omega_L: float  # rad/s, of the load behind a compliant shaft
    twist: float  # rad, of that shaft
    W_dc: float  # J, taken from the dc link since the start
    W_stray: float  # J, given by stray voltages
    W_inverter: float  # J, turned to heat in the legs and a branch at the terminals
    W_copper: float  # J, in the windings and shorted turns
    W_iron: float  # J
    W_friction: float  # J, in all that drags, the shaft's damper too
    W_shaft: float  # J, electromagnetic and cogging torque have given to the rotor
    W_load: float  # J, given to load torque or dynamometer
    q_dc: float  # C, drawn from the dc link
    i_f: complex  # A, stationary, behind the filter before the current converter
    charge: complex  # C, stationary, integral of what comes to the converter


AT_REST = PlantState(
    0j, 0j, 0j, 0.0, 0j, 0j, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0j, 0j
)


def started(plant: Plant, theta_m: float, omega_m: float, i_dq: complex = 0j) -> PlantState:
    """The state at an angle (rad) and a speed (rad/s) with a stator current (A, rotor frame) that stands."""
    rotor = turned(plant.machine.n_p * theta_m)
    psi = flux_of(plant.magnetics, plant.flux_map, i_dq, rotor) * rotor
    i = i_dq * rotor
    return AT_REST._replace(psi=psi, i_x=i, i_f=i, omega_m=omega_m, omega_L=omega_m, theta_m=theta_m)


@kernel
def motor_current(plant: Plant, state: PlantState) -> complex:
    """Stationary current vector (A) of the motor."""
    rotor = turned(plant.machine.n_p * state.theta_m)
    i = rotor * current_and_pull(plant.magnetics, plant.flux_map, state.psi * rotor.conjugate(), rotor)[0] + state.i_i
    if plant.short.share > 0.0:
        i += 2.0 / 3.0 * plant.short.share * state.i_t * axis_of(plant.short.phase)
    return i


@kernel
def bridge_current(plant: Plant, state: PlantState) -> complex:
    """Stationary current vector (A) of the bridge: the motor's and that of a branch at its terminals."""
    return motor_current(plant, state) + state.i_r


@kernel
def _scalar(x: complex, y: complex) -> float:
    return x.real * y.real + x.imag * y.imag


@inlined
def _fed(supply: Supply, i: complex) -> tuple[complex, float, float, float]:
    """What a supply does at a bridge's current (A): its vector (V), power taken and lost (W), dc-link current (A)."""
    if supply.vector:
        P_dc = 1.5 * _scalar(supply.u, i)
        return supply.u, P_dc, 0.0, P_dc / supply.u_dc
    i_a, i_b, i_c = phases(i)
    a, b, c, u_dc, knee = supply.a, supply.b, supply.c, supply.u_dc, supply.knee
    lost_a, lost_b, lost_c = lost(a, knee, i_a), lost(b, knee, i_b), lost(c, knee, i_c)
    u = clarke(a.s * u_dc - lost_a, b.s * u_dc - lost_b, c.s * u_dc - lost_c)
    i_dc = a.s * i_a + b.s * i_b + c.s * i_c
    return u, u_dc * i_dc, lost_a * i_a + lost_b * i_b + lost_c * i_c, i_dc


@inlined
def _shorted(plant: Plant, u: complex, u_R: complex, i_s: complex, i_t: float) -> tuple[complex, float, float]:
    """Shorted turns: the windings' drop (V) with them, d(i_t)/dt (A/s), and power lost beside u_R i_s (W)."""
    share, R_t, phase = plant.short
    along = axis_of(phase)
    R_k = plant.machine.R_s * (1.0 + share_of(plant.imbalance, phase))
    i_k = _scalar(i_s, along)
    u_R -= 2.0 / 3.0 * share * R_k * i_t * along
    around = share * (R_k * i_k + _scalar(u - u_R, along)) - (R_t + share * R_k) * i_t
    lost_power = (R_t + share * R_k) * i_t * i_t - share * R_k * i_k * i_t
    return u_R, around / loop_inductance(plant.short, plant.R_cold), lost_power


@inlined
def _turning(shaft: Shaft, state: PlantState, tau: float, omega_m: float, omega_L: float) -> tuple[
    float, float, float, float
]:
    """d(omega_m)/dt, d(omega_L)/dt (rad/s2), power of friction and of the load (W) under a rotor's torque (Nm)."""
    tau_drag = drag(shaft, omega_m)
    stiffness, damping, J_L = shaft.compliance
    if stiffness > 0.0:
        slip = omega_m - omega_L
        tau_s = stiffness * state.twist + damping * slip
        load = tau_s if shaft.held else shaft.tau_L
        return (
            (tau - tau_drag - tau_s) / shaft.J,
            0.0 if shaft.held else (tau_s - shaft.tau_L) / J_L,
            tau_drag * omega_m + damping * slip * slip,
            load * omega_L,
        )
    if shaft.held:  # friction is the dynamometer's own matter
        return 0.0, 0.0, 0.0, tau * omega_m
    return (tau - shaft.tau_L - tau_drag) / shaft.J, 0.0, tau_drag * omega_m, shaft.tau_L * omega_m


@inlined
def rate(plant: Plant, supply: Supply, t: float, rotor: complex, state: PlantState) -> PlantState:
    """Rate of change of the state at a time t (s); rotor = exp(j n_p theta_m)."""
    shaft, R_s, n_p = plant.shaft, plant.machine.R_s, plant.machine.n_p
    psi, i_i, i_t, i_r = state.psi, state.i_i, state.i_t, state.i_r

    omega_m, omega_L = state.omega_m, state.omega_L
    if shaft.held:
        omega_L = profile_speed(shaft.profile, t)
    if shaft.compliance.stiffness == 0.0:
        if shaft.held:
            omega_m = omega_L
        omega_L = omega_m

    i_dq, pull = current_and_pull(plant.magnetics, plant.flux_map, psi * rotor.conjugate(), rotor)
    i_s = rotor * i_dq + i_i
    if plant.short.share > 0.0:
        i_s += 2.0 / 3.0 * plant.short.share * i_t * axis_of(plant.short.phase)
    i_bridge = i_s + i_r

    u, P_dc, P_inverter, i_dc = _fed(supply, i_bridge)
    stray = plant.telegraph
    if plant.stray.amplitude > 0.0:
        stray += stray_voltage(plant.stray, t)
    u += stray

    # Windings; what is no heat goes to the rung's field
    u_R = drop(plant.imbalance, R_s, i_s)
    di_x, to_rung = 0j, 0.0
    if plant.skin.rise > 0.0:
        u_x = rung_resistance(plant.skin, plant.R_cold) * (i_s - state.i_x)
        di_x = u_x / rung_inductance(plant.skin, plant.R_cold)
        u_R += u_x
        to_rung = 1.5 * _scalar(u_x, state.i_x)
    di_t, P_short = 0.0, 0.0
    if plant.short.share > 0.0:
        u_R, di_t, P_short = _shorted(plant, u, u_R, i_s, i_t)
    P_copper = 1.5 * _scalar(u_R, i_s) + P_short - to_rung
    e = u - u_R

    di_i, P_iron = 0j, 0.0
    if plant.iron.R_c > 0.0:
        di_i = iron_loss.rate_of(plant.iron, e, n_p * omega_m, i_i)
        P_iron = 1.5 * iron_loss.resistance(plant.iron, n_p * omega_m) * _scalar(i_i, i_i)

    di_r, dv_r = 0j, 0j
    if plant.resonance.C > 0.0:
        di_r = (u - plant.resonance.R * i_r - state.v_r) / plant.resonance.L
        dv_r = i_r / plant.resonance.C
        P_inverter += 1.5 * plant.resonance.R * _scalar(i_r, i_r)  # it does not warm the winding

    tau = 1.5 * n_p * pull
    if plant.magnetics.harmonics.cogging > 0.0:
        tau -= plant.magnetics.harmonics.cogging * sixth(rotor).imag
    domega_m, domega_L, P_friction, P_load = _turning(shaft, state, tau, omega_m, omega_L)
    to_converter, di_f = i_bridge, 0j
    if plant.filter_time > 0.0:
        to_converter, di_f = state.i_f, (i_bridge - state.i_f) / plant.filter_time
    return PlantState(
        e, di_i, di_x, di_t, di_r, dv_r,
        domega_m, omega_m, domega_L, omega_m - omega_L,
        P_dc, 1.5 * _scalar(stray, i_bridge), P_inverter, P_copper, P_iron, P_friction, tau * omega_m, P_load, i_dc,
        di_f, to_converter,
    )  # fmt: skip


@inlined
def moved(state: PlantState, along: PlantState, h: float) -> PlantState:
    """state + h along."""
    s, d = state, along
    return PlantState(
        s.psi + h * d.psi, s.i_i + h * d.i_i, s.i_x + h * d.i_x, s.i_t + h * d.i_t, s.i_r + h * d.i_r,
        s.v_r + h * d.v_r, s.omega_m + h * d.omega_m, s.theta_m + h * d.theta_m, s.omega_L + h * d.omega_L,
        s.twist + h * d.twist, s.W_dc + h * d.W_dc, s.W_stray + h * d.W_stray, s.W_inverter + h * d.W_inverter,
        s.W_copper + h * d.W_copper, s.W_iron + h * d.W_iron, s.W_friction + h * d.W_friction,
        s.W_shaft + h * d.W_shaft, s.W_load + h * d.W_load, s.q_dc + h * d.q_dc,
        s.i_f + h * d.i_f, s.charge + h * d.charge,
    )  # fmt: skip


@inlined
def stepped(plant: Plant, supply: Supply, t: float, h: float, state: PlantState) -> PlantState:
    """The state a time h (s) after t, by one step of the Runge-Kutta method."""
    n_p = plant.machine.n_p
    start = turned(n_p * state.theta_m)
    theta, half = state.theta_m, 0.5 * h
    k_1 = rate(plant, supply, t, start, state)
    at = moved(state, k_1, half)
    k_2 = rate(plant, supply, t + half, start * turned_slightly(n_p * (at.theta_m - theta)), at)
    at = moved(state, k_2, half)
    k_3 = rate(plant, supply, t + half, start * turned_slightly(n_p * (at.theta_m - theta)), at)
    at = moved(state, k_3, h)
    k_4 = rate(plant, supply, t + h, start * turned_slightly(n_p * (at.theta_m - theta)), at)
    return moved(moved(moved(moved(state, k_1, h / 6.0), k_2, h / 3.0), k_3, h / 3.0), k_4, h / 6.0)


@kernel
def advanced(plant: Plant, supply: Supply, t: float, T: float, sub_steps: int, state: PlantState) -> PlantState:
    """The state a time T (s) after t under one supply, in equal sub-steps."""
    h = T / sub_steps
    for n in range(sub_steps):
        state = stepped(plant, supply, t + n * h, h, state)
    return state


@kernel
def settled(plant: Plant, t: float, state: PlantState) -> PlantState:
    """The state at the end t (s) of a control period: angle within a turn, a held speed as held."""
    s, shaft = state, plant.shaft
    omega_m, omega_L = s.omega_m, s.omega_L
    if shaft.held:
        omega_L = profile_speed(shaft.profile, t)
        if shaft.compliance.stiffness == 0.0:
            omega_m = omega_L
    return PlantState(
        s.psi, s.i_i, s.i_x, s.i_t, s.i_r, s.v_r, omega_m, wrapped(s.theta_m), omega_L, s.twist,
        s.W_dc, s.W_stray, s.W_inverter, s.W_copper, s.W_iron, s.W_friction, s.W_shaft, s.W_load, s.q_dc,
        s.i_f, s.charge,
    )  # fmt: skip


@kernel
def field(plant: Plant, state: PlantState) -> float:
    """Energy (J) of the machine's field, but for a constant."""
    rotor = turned(plant.machine.n_p * state.theta_m)
    return field_energy(plant.magnetics, plant.flux_map, state.psi * rotor.conjugate(), rotor)


def stored_energy(plant: Plant, state: PlantState) -> float:
    """Energy (J) in the fields of machine, iron, windings and a branch at the terminals, but for a constant."""
    cogging, n_p = plant.magnetics.harmonics.cogging, plant.machine.n_p
    total = field(plant, state) - cogging * math.cos(6.0 * n_p * state.theta_m) / (6.0 * n_p)
    total += energy_of_the_iron(plant.iron, state.i_i)
    total += energy_of_the_rung(plant.skin, plant.R_cold, state.i_x)
    total += energy_of_the_loop(plant.short, plant.R_cold, state.i_t)
    return total + energy_of_the_branch(plant.resonance, state.i_r, state.v_r)


def mechanical_energy(plant: Plant, state: PlantState) -> float:
    """Energy (J) that torque on the rotor has left: of motion, and in a compliant shaft."""
    shaft = plant.shaft
    if shaft.compliance.stiffness == 0.0:
        return 0.0 if shaft.held else 0.5 * shaft.J * state.omega_m**2
    loaded = 0.0 if shaft.held else 0.5 * shaft.compliance.J_L * state.omega_L**2
    return 0.5 * shaft.J * state.omega_m**2 + loaded + energy_of_the_spring(shaft.compliance, state.twist)
