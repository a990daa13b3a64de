"""Inside the control period: the emulator's bridge, stepped finely, where the drive itself records one sample only."""

from itertools import pairwise

import numpy as np

from emulator.drive.virtual_drive import VirtualDrive
from emulator.frames import phases
from emulator.plant import bridge as bridges
from emulator.plant.dynamics import bridge_current, stepped
from emulator.plant.inverter import limited
from emulator.plant.modulation import modulated
from tests.emulator.plant.physics.effect_runs import Column

_STEP = 2.5e-7  # s


def coming_period(drive: VirtualDrive) -> tuple[Column, Column]:
    """Time (s) within the drive's next control period and the current of phase a (A), between edges too."""
    bench, now = drive._bench, drive._state
    bridge, plant, state, T = bench.bridge, drive.plant_now(), now.plant, bench.fixed.T_s
    u_dc, room, dead_time = now.bridge.u_dc, bridges.scratch(), bridge.inverter.dead_time
    duties = modulated(limited(now.firmware.u_next, u_dc), u_dc, bridge.timer_counts, 0.0)
    edges = bridges.moments(duties, dead_time, T, now.bridge, room)
    moments = room.moments[:edges].copy()
    t, i_a = [0.0], [phases(bridge_current(plant, state))[0]]
    for begin, end in pairwise(moments):
        steps = max(int(np.ceil((end - begin) / _STEP - 1e-6)), 0)
        h = (end - begin) / max(steps, 1)
        dead = bridges._decide(bridge, plant, state, begin, end, T, True, room)
        for n in range(steps):
            at = now.tick * T + begin + n * h
            if dead:
                state = bridges._through_dead_time(bridge, plant, u_dc, at, h, state, room)
            else:
                state = stepped(plant, bridges._supply(bridge, u_dc, room), at, h, state)
            t.append(begin + (n + 1) * h)
            i_a.append(phases(bridge_current(plant, state))[0])
    return np.array(t), np.array(i_a)
