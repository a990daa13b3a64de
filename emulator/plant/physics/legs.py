"""What the three legs of an inverter really hold: dead time, drops, on-resistance, clamping, minimum pulse.

A leg's switches do not change over at once: after every edge both are off for `dead_time`. Then the current's sign
decides, as it flows on through a diode: a current out of the leg comes from the lower rail, one into it goes to the
upper. A current that reaches zero meanwhile stays there (zero-current clamping): both diodes block and the leg floats
on what the motor puts on it. On average, away from zero crossings,

    u_k = d_k u_dc - sign(i_k) (dead_time / T_s u_dc + drops) - r_on i_k

A switch or diode that conducts drops `u_transistor` or `u_diode`, which soften below `knee`, and r_on i. Pulses shorter
than `min_pulse` are left out. R. B. Sepe, J. H. Lang, "Inverter nonlinearities and discrete-time vector current
control", IEEE Trans. Industry Applications, 1994; S.-G. Jeong, M.-H. Park, "The analysis and compensation of dead-time
effects in PWM inverters", IEEE Trans. Industrial Electronics 38(2), 1991.

Shows as voltage lost in steps at every phase current's zero crossing - 6 k +- 1 per turn, six per turn in the rotor
frame - and looks like R_s at one level of current.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

_DROP = Bound("V", low=0.0, high=10.0)


class Inverter(NamedTuple):
    """Sizes."""

    dead_time: Annotated[float, Bound("s", low=0.0, high=2e-5)] = 0.0
    min_pulse: Annotated[float, Bound("s", low=0.0, high=2e-5)] = 0.0
    u_transistor: Annotated[float, _DROP] = 0.0
    u_diode: Annotated[float, _DROP] = 0.0
    r_on: Annotated[float, Bound("ohm", low=0.0)] = 0.0
    knee: Annotated[float, Bound("A", low=0.0)] = 0.0  # zero: a hundredth of the rated current


class Leg(NamedTuple):
    """What one leg holds: v = s u_dc - fixed - soft drop - r i, against the lower rail."""

    s: float  # 1 at the upper rail, 0 at the lower
    fixed: float  # V, of a diode whose current keeps its sign
    out: float  # V, soft drop for a current out of the leg
    into: float  # V, and for one into it
    r: float  # ohm


class Supply(NamedTuple):
    """What feeds the motor for a while: a vector, or three legs."""

    vector: bool
    u: complex  # V, stationary, where it is a vector
    u_dc: float  # V, of the dc link
    knee: float  # A
    a: Leg
    b: Leg
    c: Leg


_NO_LEG = Leg(0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def vector(u: complex, u_dc: float) -> Supply:
    """A supply without loss that holds a stationary vector (V) whatever the current, from a dc link of u_dc (V)."""
    return Supply(True, u, u_dc, 1.0, _NO_LEG, _NO_LEG, _NO_LEG)


@kernel
def is_ideal(inverter: Inverter) -> bool:
    """Legs hold what they are told, but for dead time."""
    return inverter.u_transistor == 0.0 and inverter.u_diode == 0.0 and inverter.r_on == 0.0


@kernel
def low(inverter: Inverter) -> Leg:
    """The lower switch is on: its diode carries a current out of the leg, its transistor one into it."""
    return Leg(0.0, 0.0, inverter.u_diode, inverter.u_transistor, inverter.r_on)


@kernel
def high(inverter: Inverter) -> Leg:
    """The upper switch is on."""
    return Leg(1.0, 0.0, inverter.u_transistor, inverter.u_diode, inverter.r_on)


@kernel
def freewheeling(inverter: Inverter, outward: bool) -> Leg:
    """Both switches are off and a current flows, out of the leg or into it."""
    return Leg(0.0 if outward else 1.0, inverter.u_diode if outward else -inverter.u_diode, 0.0, 0.0, inverter.r_on)


@kernel
def floating(v: float, u_dc: float) -> Leg:
    """No current flows; the motor puts v (V) on the leg."""
    return Leg(v / u_dc, 0.0, 0.0, 0.0, 0.0)


@kernel
def lost(leg: Leg, knee: float, i: float) -> float:
    """Voltage (V) lost in the leg at a current i (A) out of it."""
    soft = leg.out if i > 0.0 else leg.into
    return leg.fixed + leg.r * i + (soft * i / math.sqrt(i * i + knee * knee) if soft > 0.0 else 0.0)
