"""The switched bridge: one control period of the plant under the edges of three legs.

A triangular carrier starts each period at its peak, where all legs are low, and has its trough in the middle; a leg is
high while its duty is above the carrier. That makes six edges, symmetric about the middle. Periods begin in the middle
of the zero vector 000, where the current is sampled: the ripple passes through its mean there.

After every edge both switches of a leg are off for the dead time. What a leg holds then is told in `physics.legs`; here
is when, and what a leg floats on whose current has stopped: the voltage that keeps it at zero, found by trial steps, as
current follows voltage in an all but straight line over a step. A bridge that is off is one long dead time.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.frames import clarke, phases
from emulator.kernel import kernel
from emulator.plant.dynamics import Plant, PlantState, bridge_current, stepped
from emulator.plant.modulation import Duties
from emulator.plant.physics import legs
from emulator.plant.physics.dc_link import DcLink, charged
from emulator.plant.physics.legs import Inverter, Leg, Supply

_LOW, _HIGH, _DIODE_LOW, _DIODE_HIGH, _FLOATS = 0, 1, 2, 3, 4
_RISE, _FALL, _FREE, _MODE, _LEVEL = 0, 1, 2, 3, 4  # rows of the scratch
_NO_TIME = 1e-13  # s


class Bridge(NamedTuple):
    """What the inverter is."""

    switched: bool  # edges; else the mean voltage over the whole period
    timer_counts: int  # of the modulator's timer, per control period; 0: ideal
    inverter: Inverter
    link: DcLink
    E: float  # V, of the source behind the dc link
    knee: float  # A, below which a drop softens
    no_current: float  # A, taken as none


class BridgeState(NamedTuple):
    """What a period leaves to the next."""

    u_dc: float  # V
    a_high: bool  # as commanded
    b_high: bool
    c_high: bool
    a_dead: float  # s, for so long both switches stay off
    b_dead: float
    c_dead: float


class Scratch(NamedTuple):
    """Room to work in, for one simulation."""

    legs: NDArray[np.float64]  # 5 x 3
    moments: NDArray[np.float64]  # 17, s since the period's start


@kernel
def scratch() -> Scratch:
    """Room to work in."""
    return Scratch(np.zeros((5, 3)), np.zeros(17))


@kernel
def moments(duties: Duties, dead_time: float, T: float, before: BridgeState, room: Scratch) -> int:
    """How many moments (s) of a period may change a voltage; written to `room.moments` in order, with start and end."""
    at, leg = room.moments, room.legs
    at[0] = 0.0
    count = 1
    for k in range(3):
        duty = duties.a if k == 0 else duties.b if k == 1 else duties.c
        was_high = before.a_high if k == 0 else before.b_high if k == 1 else before.c_high
        dead = before.a_dead if k == 0 else before.b_dead if k == 1 else before.c_dead
        rise, fall = (0.5 - 0.5 * duty) * T, (0.5 + 0.5 * duty) * T
        if (rise <= 0.0) != was_high:
            dead = dead_time
        leg[_RISE, k], leg[_FALL, k], leg[_FREE, k], leg[_MODE, k] = rise, fall, dead, _LOW
        for n in range(5):
            moment = dead if n == 0 else rise if n == 1 else fall if n == 2 else rise if n == 3 else fall
            if n >= 3:
                moment += dead_time
            if (n > 0 and duty <= 0.0) or (n >= 3 and (dead_time == 0.0 or duty >= 1.0)) or not 0.0 < moment < T:
                continue
            place = count
            while at[place - 1] > moment:
                at[place] = at[place - 1]
                place -= 1
            at[place] = moment
            count += 1
    at[count] = T
    return count + 1


@kernel
def switches(k: int, moment: float, dead_time: float, T: float, room: Scratch) -> int:
    """0 where leg k has its lower switch on, 1 the upper, 2 none, at a moment (s) between edges."""
    rise, fall, free = room.legs[_RISE, k], room.legs[_FALL, k], room.legs[_FREE, k]
    if rise < fall and moment >= fall:
        return 2 if moment < fall + dead_time else 0
    if rise < fall and moment >= rise:
        edge = free if rise <= 0.0 else rise + dead_time
        return 2 if moment < edge else 1
    return 2 if moment < free else 0


@kernel
def _left(k: int, dead_time: float, T: float, room: Scratch) -> float:
    """Dead time (s) of leg k that the next period inherits."""
    rise, fall, free = room.legs[_RISE, k], room.legs[_FALL, k], room.legs[_FREE, k]
    last = fall + dead_time if rise < fall < T else free
    return max(last - T, 0.0)


@kernel
def _leg(k: int, inverter: Inverter, u_dc: float, room: Scratch) -> Leg:
    mode = room.legs[_MODE, k]
    if mode == _LOW:
        return legs.low(inverter)
    if mode == _HIGH:
        return legs.high(inverter)
    if mode == _FLOATS:
        return legs.floating(room.legs[_LEVEL, k], u_dc)
    return legs.freewheeling(inverter, mode == _DIODE_LOW)


@kernel
def _supply(bridge: Bridge, u_dc: float, room: Scratch) -> Supply:
    inverter = bridge.inverter
    a, b, c = _leg(0, inverter, u_dc, room), _leg(1, inverter, u_dc, room), _leg(2, inverter, u_dc, room)
    return Supply(False, 0j, u_dc, bridge.knee, a, b, c)


@kernel
def _of_phase(x: complex, k: int) -> float:
    a, b, c = phases(x)
    return a if k == 0 else b if k == 1 else c


@kernel
def _decide(
    bridge: Bridge, plant: Plant, state: PlantState, begin: float, end: float, T: float, powered: bool, room: Scratch
) -> bool:
    """Set every leg's mode between two edges; whether one is dead."""
    dead = False
    i = 0j
    for k in range(3):
        on = switches(k, 0.5 * (begin + end), bridge.inverter.dead_time, T, room) if powered else 2
        if on < 2:
            room.legs[_MODE, k] = on
            continue
        if not dead:
            i = bridge_current(plant, state)
        dead = True
        i_k = _of_phase(i, k)
        if room.legs[_MODE, k] <= _HIGH:  # it has just been switched off
            flows = abs(i_k) > bridge.no_current
            room.legs[_MODE, k] = (_DIODE_LOW if i_k > 0.0 else _DIODE_HIGH) if flows else _FLOATS
    return dead


@kernel
def _tried(plant: Plant, supply: Supply, t: float, h: float, state: PlantState) -> PlantState:
    """`stepped`, for where it is seldom done."""
    return stepped(plant, supply, t, h, state)


@kernel
def _float(bridge: Bridge, plant: Plant, u_dc: float, t: float, h: float, state: PlantState, room: Scratch) -> None:
    """Set the levels of legs that float, so that their currents are zero a time h (s) on; or let a diode conduct."""
    leg = room.legs
    lowest, highest = -bridge.inverter.u_diode, u_dc + bridge.inverter.u_diode
    floats = 0
    for k in range(3):
        if leg[_MODE, k] == _FLOATS:
            floats += 1
    if floats == 1:
        k = 0 if leg[_MODE, 0] == _FLOATS else 1 if leg[_MODE, 1] == _FLOATS else 2
        leg[_LEVEL, k] = lowest
        i_low = _of_phase(bridge_current(plant, _tried(plant, _supply(bridge, u_dc, room), t, h, state)), k)
        leg[_LEVEL, k] = highest
        i_high = _of_phase(bridge_current(plant, _tried(plant, _supply(bridge, u_dc, room), t, h, state)), k)
        if i_low > 0.0:
            leg[_MODE, k] = _DIODE_LOW
        elif i_high < 0.0:
            leg[_MODE, k] = _DIODE_HIGH
        else:
            leg[_LEVEL, k] = lowest + (highest - lowest) * i_low / (i_low - i_high)
        return
    # No current anywhere: the vector that keeps it so
    none = bridge_current(plant, _tried(plant, legs.vector(0j, u_dc), t, h, state))
    by_re = bridge_current(plant, _tried(plant, legs.vector(complex(u_dc, 0.0), u_dc), t, h, state)) - none
    by_im = bridge_current(plant, _tried(plant, legs.vector(complex(0.0, u_dc), u_dc), t, h, state)) - none
    det = by_re.real * by_im.imag - by_im.real * by_re.imag
    u_re = (by_im.real * none.imag - none.real * by_im.imag) / det
    u_im = (by_re.imag * none.real - by_re.real * none.imag) / det
    v_a, v_b, v_c = phases(complex(u_dc * u_re, u_dc * u_im))
    shift = 0.5 * u_dc - 0.5 * (max(v_a, v_b, v_c) + min(v_a, v_b, v_c))
    if floats == 2:
        k = 0 if leg[_MODE, 0] != _FLOATS else 1 if leg[_MODE, 1] != _FLOATS else 2
        at_rail = leg[_MODE, k] == _HIGH or leg[_MODE, k] == _DIODE_HIGH
        shift = (u_dc if at_rail else 0.0) - (v_a if k == 0 else v_b if k == 1 else v_c)
    for k in range(3):
        if leg[_MODE, k] == _FLOATS:
            v = (v_a if k == 0 else v_b if k == 1 else v_c) + shift
            leg[_LEVEL, k] = v
            if v < lowest:
                leg[_MODE, k] = _DIODE_LOW
            elif v > highest:
                leg[_MODE, k] = _DIODE_HIGH


@kernel
def _some_float(room: Scratch) -> bool:
    mode = room.legs[_MODE]
    return mode[0] == _FLOATS or mode[1] == _FLOATS or mode[2] == _FLOATS


@kernel
def _stops(bridge: Bridge, i: complex, room: Scratch) -> bool:
    """Whether a current (A) flows against its diode: it has stopped before."""
    for k in range(3):
        mode, i_k = room.legs[_MODE, k], _of_phase(i, k)
        if (mode == _DIODE_LOW and i_k < -bridge.no_current) or (mode == _DIODE_HIGH and i_k > bridge.no_current):
            return True
    return False


@kernel
def _stopping(bridge: Bridge, before: complex, after: complex, room: Scratch) -> float:
    """The part of a step after which the first diode's current has stopped; 1 where none has."""
    part = 1.0
    for k in range(3):
        mode = room.legs[_MODE, k]
        sign = 1.0 if mode == _DIODE_LOW else -1.0 if mode == _DIODE_HIGH else 0.0
        i_0, i_1 = sign * _of_phase(before, k), sign * _of_phase(after, k)
        if i_1 < -bridge.no_current:
            part = min(part, max(i_0, 0.0) / (max(i_0, 0.0) - i_1))
    return part


@kernel
def _stop(bridge: Bridge, i: complex, room: Scratch) -> None:
    """Let those diodes block whose current (A) has stopped; the one nearest to zero in any case."""
    nearest, least = -1, math.inf
    for k in range(3):
        if room.legs[_MODE, k] == _DIODE_LOW or room.legs[_MODE, k] == _DIODE_HIGH:
            i_k = abs(_of_phase(i, k))
            if i_k < least:
                nearest, least = k, i_k
            if i_k <= bridge.no_current:
                room.legs[_MODE, k] = _FLOATS
    if nearest >= 0:
        room.legs[_MODE, nearest] = _FLOATS


@kernel
def _through_dead_time(
    bridge: Bridge, plant: Plant, u_dc: float, t: float, h: float, state: PlantState, room: Scratch
) -> PlantState:
    """The state a time h (s) after t with legs that are off, one of them at least."""
    done, tries = 0.0, 0
    while h - done > _NO_TIME and tries < 12:
        tries += 1
        if _some_float(room):
            _float(bridge, plant, u_dc, t + done, h - done, state, room)
        supply = _supply(bridge, u_dc, room)
        after = stepped(plant, supply, t + done, h - done, state)
        part = _stopping(bridge, bridge_current(plant, state), bridge_current(plant, after), room)
        if part >= 1.0 or tries == 12:
            return after
        if part * (h - done) > _NO_TIME:
            state = _tried(plant, supply, t + done, part * (h - done), state)
        done += part * (h - done)
        _stop(bridge, bridge_current(plant, state), room)
    return state


@kernel
def switched(
    bridge: Bridge,
    plant: Plant,
    duties: Duties,
    powered: bool,
    t: float,
    T: float,
    sub_steps: int,
    before: BridgeState,
    state: PlantState,
    room: Scratch,
) -> tuple[BridgeState, PlantState]:
    """Bridge and plant one control period T (s) after t. No integration step is longer than T / sub_steps."""
    inverter, link = bridge.inverter, bridge.link
    dead_time, u_dc, ideal = inverter.dead_time, before.u_dc, legs.is_ideal(inverter)
    edges = moments(duties, dead_time, T, before, room)
    for n in range(edges - 1):
        begin, end = room.moments[n], room.moments[n + 1]
        if end - begin <= _NO_TIME:
            continue
        dead = _decide(bridge, plant, state, begin, end, T, powered, room)
        steps = max(math.ceil((end - begin) / T * sub_steps - 1e-9), 1)  # a whole number of them, but for rounding
        h, drawn = (end - begin) / steps, state.q_dc
        if ideal and not dead:
            s = room.legs[_MODE]
            supply = legs.vector(u_dc * clarke(s[0], s[1], s[2]), u_dc)
        else:
            supply = _supply(bridge, u_dc, room)
        for m in range(steps):
            t_m = t + begin + m * h
            floats = dead and _some_float(room)
            after = state if floats else stepped(plant, supply, t_m, h, state)
            if floats or (dead and _stops(bridge, bridge_current(plant, after), room)):
                after = _through_dead_time(bridge, plant, u_dc, t_m, h, state, room)
                supply = _supply(bridge, u_dc, room)
            state = after
        if link.C > 0.0:
            u_dc = charged(link, bridge.E, u_dc, state.q_dc - drawn, t + begin, end - begin)
    return BridgeState(
        u_dc,
        duties.a >= 1.0, duties.b >= 1.0, duties.c >= 1.0,
        _left(0, dead_time, T, room), _left(1, dead_time, T, room), _left(2, dead_time, T, room),
    ), state  # fmt: skip
