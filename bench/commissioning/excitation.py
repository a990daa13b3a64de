"""How a motor is excited, so that its parameters, what was left out of its model and its inertia can be told.

The speed ramps from one direction to the other and back, at two fifths of the rated torque, with random steps of both
currents around their levels: resistance wants low speed, magnet flux and inductances high ones, offsets and friction
both directions, saturation large currents, inertia acceleration.
"""

import math
from typing import Final

from bench.commissioning.trial import Excitation
from drivers.wire.dictionary import CAPTURE_SAMPLES

_SPEED: Final = 0.7  # of the fastest
_TORQUE: Final = 0.4  # of rated current, that a ramp takes
_I_D: Final = (-0.1, 0.4)  # of rated current: level, and steps around it
_I_Q: Final = 0.25  # of rated current: steps
_STEP_TIME: Final = 2e-3  # s, shortest between steps; twice in the mean
_WANDER: Final = 0.1  # of the fastest speed, by which steps of i_q may take it away
_MEMORY: Final = 0.05  # s, after which a speed control has taken that back
_SWEEPS: Final = 6
_SECONDS: Final = (1.5, 5.0)  # shortest and longest


def excitation(fastest: float, i_rated: float, K: float, T_s: float) -> Excitation:
    """Of a fastest speed (rad/s, electrical), rated current (A), acceleration K (rad/(s2 A)), control period (s)."""
    ramp = _TORQUE * i_rated * abs(K)
    longest = min(_SECONDS[1], CAPTURE_SAMPLES * T_s)
    hold = 0.05
    speed = min(_SPEED * fastest, 0.5 * ramp * (longest / _SWEEPS - hold))
    seconds = min(max(_SWEEPS * (2.0 * speed / ramp + hold), _SECONDS[0]), longest)
    wanders = math.sqrt(0.5) * abs(K) * math.sqrt(2.0 * _STEP_TIME * _MEMORY)  # rad/s an A
    i_q_step = min(_I_Q * i_rated, _WANDER * fastest / wanders)
    return Excitation(
        speed, ramp, hold, _I_D[0] * i_rated, _I_D[1] * i_rated, i_q_step, max(_STEP_TIME, T_s), seconds
    )
