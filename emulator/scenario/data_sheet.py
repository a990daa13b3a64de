"""What a scenario's drive would have printed on its plate, for a bench that is started with it.

Nominal values as a machine file has them, how far set points may go, and those of the run. Knows nothing of the bench.
"""

import math
from collections.abc import Mapping
from typing import Final

from drivers.wire.dictionary import SET_POINTS
from emulator.plant.machine import Machine
from emulator.scenario.scenarios import Excitation, Scenario, overspeed_of

_RPM: Final = math.tau / 60.0  # rad/s
_TO_SPARE: Final = 1.1  # from the largest speed to the trip
_PLATE: Final = ("R_s", "L_d", "L_q", "psi_f", "n_p", "i_rated")


def data_sheet(scenario: Scenario) -> dict[str, Mapping[str, float]]:
    """`machine` and `drive` as the tables of a machine file, `limits` and `set_points`, all by name.

    A drive that is not enabled has no set points: it is not meant to be started as it is.
    """
    motor, counts = scenario.motor, scenario.drive.encoder_counts
    speed_max_rpm = _largest_speed(scenario)
    return {
        "machine": {**{name: getattr(motor, name) for name in _PLATE}, "speed_max_rpm": speed_max_rpm},
        "drive": {"encoder_counts": counts} if counts > 1 else {},
        "limits": {"i_max": max(motor.i_rated, _longest_current(scenario)), "speed_max_rpm": speed_max_rpm},
        **({"set_points": _set_points(scenario.excitation)} if scenario.drive.enabled else {}),
    }


def _set_points(excitation: Excitation) -> dict[str, float]:
    return {name: float(getattr(excitation, name)) for name in SET_POINTS}


def _longest_current(scenario: Scenario) -> float:
    """The longest current vector (A) that the run's own references may come to."""
    drive, excitation = scenario.drive, scenario.excitation
    weakening = drive.i_d_weakening if drive.field_weakening else 0.0
    i_d = max(abs(excitation.i_d_ref), abs(excitation.i_d_ref - weakening)) + excitation.i_d_step
    return math.hypot(i_d, abs(excitation.i_q_ref) + excitation.i_q_step)


def _largest_speed(scenario: Scenario) -> float:
    """What the drive's overspeed trip leaves (rpm, mechanical), in three digits; no less than what is referred to."""
    motor = scenario.motor
    left = _rpm(overspeed_of(scenario) / _TO_SPARE, motor)
    digit = 10.0 ** (math.floor(math.log10(left)) - 2)
    return max(math.ceil(left / digit) * digit, _rpm(_fastest_reference(scenario.excitation), motor))


def _fastest_reference(excitation: Excitation) -> float:
    return abs(excitation.speed_ref) + excitation.speed_step


def _rpm(omega_e: float, motor: Machine) -> float:
    return omega_e / (motor.n_p * _RPM)
