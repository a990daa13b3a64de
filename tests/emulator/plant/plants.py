"""Plants for tests: a machine on a shaft, with no effect or some, and the bridge before it."""

from dataclasses import replace

from emulator.drive.assembly import plant_of_scenario
from emulator.frames import turned
from emulator.plant.bridge import Bridge, BridgeState
from emulator.plant.dynamics import Plant, PlantState, bridge_current, started
from emulator.plant.machine import Machine
from emulator.plant.mechanics import Profile, Shaft
from emulator.plant.physics.dc_link import DcLink
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER

U_DC = PAPER.drive.u_dc
IDEAL = Bridge(True, 5000, Inverter(), DcLink(), U_DC, 1.0, 1e-9)
STILL = Profile(0.0, 0.0, 0.0, 0.0, 0.0)
LOCKED = Shaft(True, STILL, PAPER.motor.J, PAPER.motor.B, 0.0)
BEFORE = BridgeState(U_DC, False, False, False, 0.0, 0.0, 0.0)


def plant_with(machine: Machine, shaft: Shaft, effects: Effects = NONE) -> Plant:
    """The plant of a machine on a shaft."""
    plant = plant_of_scenario(replace(PAPER, motor=machine, effects=effects))[1]
    return plant._replace(shaft=shaft._replace(friction=effects.friction, compliance=effects.compliance))


def at_rest(plant: Plant, theta_m: float = 0.0, omega_m: float = 0.0) -> PlantState:
    """The state at an angle (rad) and a speed (rad/s), without current."""
    return started(plant, theta_m, omega_m)


def rotor_current(plant: Plant, state: PlantState) -> complex:
    """Current (A) in the rotor frame."""
    return bridge_current(plant, state) * turned(-plant.machine.n_p * state.theta_m)


def textbook_flux(machine: Machine, i_dq: complex) -> complex:
    """psi_dq (Vs) of a current (A), without saturation."""
    return complex(machine.L_d * i_dq.real + machine.psi_f, machine.L_q * i_dq.imag)


def textbook_energy(machine: Machine, i_dq: complex) -> float:
    """Energy (J) that a current (A) adds to the magnets' own, without saturation."""
    return 0.75 * (machine.L_d * i_dq.real**2 + machine.L_q * i_dq.imag**2)


def textbook_torque(machine: Machine, i_dq: complex) -> float:
    """tau_e (Nm) of a current (A), without saturation."""
    return 1.5 * machine.n_p * (textbook_flux(machine, i_dq).conjugate() * i_dq).imag
