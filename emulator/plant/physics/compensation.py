"""Dead-time compensation: what a drive's firmware adds to its legs' voltages, too much or too little of it.

    u_k = d_k u_dc + time / T_s u_dc sat(i_k / width)        sat is the sign where `width` is 0

By `by`, i_k is 0: the sample that the voltage was computed from, turned on to where that acts; 1: the sample as it is;
2: the commanded current there. A sample is noisy: near zero its sign, and the voltage with it, jump from row to row.
The voltage that is recorded is the one before this is added, as most drives have it, or with `recorded` the one after,
which then tells it. S.-G. Jeong, M.-H. Park, "The analysis and compensation of dead-time effects in PWM inverters",
IEEE Trans. Industrial Electronics 38(2), 1991; J.-W. Choi, S.-K. Sul, "Inverter output voltage synthesis using novel
dead time compensation", IEEE Trans. Power Electronics 11(2), 1996.

Shows, where it is more than the legs lose, as their loss of the other sign: six steps per turn in the rotor frame.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.frames import clarke, phases
from emulator.kernel import kernel

BY_TURNED, BY_SAMPLE, BY_COMMAND = 0, 1, 2


class Compensation(NamedTuple):
    """Sizes."""

    time: Annotated[float, Bound("s", low=-2e-5, high=2e-5)] = 0.0  # below zero: of the wrong sign
    width: Annotated[float, Bound("A", low=0.0)] = 0.0  # of current, on either side of zero, in which it rises
    by: Annotated[int, Bound(low=BY_TURNED, high=BY_COMMAND)] = BY_TURNED
    recorded: Annotated[int, Bound(low=0, high=1)] = 0


@kernel
def compensating(compensation: Compensation, i: complex, u_dc: float, T_s: float) -> complex:
    """Voltage (V, stationary) that it adds at a current (A, stationary) and dc link (V)."""
    i_a, i_b, i_c = phases(i)
    share = clarke(
        _saturated(i_a, compensation.width), _saturated(i_b, compensation.width), _saturated(i_c, compensation.width)
    )
    return compensation.time / T_s * u_dc * share


@kernel
def _saturated(i: float, width: float) -> float:
    if abs(i) >= width:
        return 1.0 if i > 0.0 else -1.0 if i < 0.0 else 0.0
    return i / width
