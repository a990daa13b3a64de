"""The simulation: plant, sensors, firmware and stream, stepped together by control periods in one loop.

It has no clock and no state of its own: `simulated` takes a state and returns the one after so many periods.

Where parameters move with temperature, a period is integrated with those of its middle, and a sample at t is that
of the machine at t. The flux linkage is the state: an inductance that rises takes the current down with it.

The voltage that the drive records is the one it set: within the inverter's reach and, where the bridge switches,
what the compare registers of its timer hold. A drive reads those back; what its legs make of them it cannot see.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.bridge import Bridge, switched
from emulator.course import Course, machine_at
from emulator.firmware import Commissioning, FirmwareState, Settings, computed, switched_on
from emulator.frames import nearest, turned, wrapped
from emulator.inverter import limited
from emulator.kernel import kernel
from emulator.machine import Machine, flux
from emulator.mechanics import Shaft, profile_speed
from emulator.modulation import modulated, voltage_of
from emulator.plant import PlantState, advanced, stator_current
from emulator.sensors import Sample, Sensors, measured_current, sampled
from emulator.stream import NO_ROW, Period, Row, extended, write_row

RECORDED: Final = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e", "u_dc", "i_a", "i_b", "i_c")


class Bench(NamedTuple):
    """What stays while a call of `simulated` runs."""

    machine: Machine  # at 23.4 degC
    course: Course  # what its temperature makes of it over time
    shaft: Shaft
    sensors: Sensors
    fixed: Commissioning
    bridge: Bridge
    sub_steps: int  # integration steps per control period


class State(NamedTuple):
    """All that changes from period to period; `sample` is the one taken at `tick`."""

    tick: int
    plant: PlantState
    sample: Sample
    firmware: FirmwareState
    row: Row


def started(bench: Bench, n_p: int, psi_f: float, powered: bool) -> State:
    """The state at tick 0: no current, angle zero, speed as the profile says, the bridge on or off.

    `n_p` and `psi_f` (Vs) are what the drive takes the machine for.
    """
    omega_m = profile_speed(bench.shaft.profile, 0.0)
    machine = machine_at(bench.machine, bench.course, 0.0)
    plant = PlantState(flux(machine, 0j), omega_m, 0.0, 0.0, 0.0, 0.0)
    sample = sampled(bench.sensors, stator_current(machine, plant), 0.0, 0)
    firmware = switched_on(sample.theta_m, omega_m, n_p, psi_f, bench.fixed.T_s, powered)
    return State(0, plant, sample, firmware, NO_ROW)


@kernel
def simulated(
    bench: Bench,
    settings: Settings,
    state: State,
    periods: int,
    ticks: NDArray[np.int64],
    rows: NDArray[np.float64],
    recording: NDArray[np.float64],
) -> tuple[State, int]:
    """The state after `periods` control periods, and how many stream rows became complete.

    Those are written to `ticks` (m) and `rows` (m x stream.COLUMNS); every period to a line of `recording`
    (periods x RECORDED) unless that is empty.
    """
    T_s, u_dc, n_p = bench.fixed.T_s, bench.fixed.u_dc, settings.n_p
    tick, plant, sample, firmware, row = state
    complete = 0
    for n in range(periods):
        t = tick * T_s
        # The period: the voltage computed one period ago is applied while the next is computed
        u, known = limited(firmware.u_next, u_dc), firmware.powered
        firmware = computed(bench.fixed, settings, firmware, sample, u_dc, t)
        machine = machine_at(bench.machine, bench.course, t + 0.5 * T_s)
        if bench.bridge.switched:
            duties = modulated(u, u_dc, bench.bridge.timer_counts)
            plant = switched(machine, bench.shaft, duties, u_dc, t, T_s, bench.sub_steps, plant)
            u = voltage_of(duties, u_dc)
        else:
            plant = advanced(machine, bench.shaft, u, t, T_s, bench.sub_steps, plant)
        machine = machine_at(bench.machine, bench.course, (tick + 1) * T_s)
        before, sample = sample, sampled(bench.sensors, stator_current(machine, plant), plant.theta_m, tick + 1)

        # What the drive knows of it
        theta_e = wrapped(n_p * before.theta_m)
        turn = n_p * nearest(sample.theta_m - before.theta_m)
        period = Period(
            theta_e,
            turn,
            measured_current(before) * turned(-theta_e),
            measured_current(sample) * turned(-(theta_e + turn)),
            u * turned(-(theta_e + turn / 2.0)) if known else complex(math.nan, math.nan),
            u_dc,
        )
        row = extended(row, tick, period, settings.stream_periods)
        if row.taken == row.periods:
            write_row(row, T_s, ticks, rows, complete)
            complete += 1
        if len(recording) > 0:
            line = recording[n]
            line[0] = t
            line[1], line[2] = period.u.real, period.u.imag
            line[3], line[4] = period.i.real, period.i.imag
            line[5], line[6], line[7] = turn / T_s, theta_e, u_dc
            line[8], line[9], line[10] = before.i_a, before.i_b, before.i_c
        tick += 1
    return State(tick, plant, sample, firmware, row), complete
