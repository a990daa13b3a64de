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

from emulator.drive.stream import NO_ROW, Period, Row, extended, write_row
from emulator.firmware.control import Commissioning, FirmwareState, Settings, computed, seen, switched_on
from emulator.firmware.correction import corrected, lost
from emulator.frames import nearest, turned, wrapped
from emulator.kernel import kernel
from emulator.plant.bridge import Bridge, BridgeState, Scratch, scratch, switched
from emulator.plant.course import Course, machine_at
from emulator.plant.dynamics import Plant, PlantState, advanced, bridge_current, field, settled, stepped
from emulator.plant.dynamics import started as plant_started
from emulator.plant.inverter import limited
from emulator.plant.machine import Machine
from emulator.plant.magnetics import magnetics_of
from emulator.plant.mechanics import profile_speed
from emulator.plant.modulation import Duties, modulated, voltage_of
from emulator.plant.physics import demagnetisation as demagnetisations
from emulator.plant.physics import thermal as thermals
from emulator.plant.physics import warming as warmings
from emulator.plant.physics.angle_signal import Tracked, followed, sensed
from emulator.plant.physics.compensation import BY_COMMAND, BY_SAMPLE, Compensation, compensating
from emulator.plant.physics.current_filter import Charges, mean_current, passed
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.hall import NO_HALL, Edges, edges_after, first_edges, hall_read, told_angle
from emulator.plant.physics.legs import vector
from emulator.plant.physics.sensing import VoltageSensing, longest_skew, read_voltage
from emulator.plant.physics.strangers import Telegraph, keyed, telegraph_voltage
from emulator.plant.physics.thermal import Temperatures, Thermal, warmed
from emulator.plant.physics.timing import Timing
from emulator.plant.sensors import Earlier, Sample, Sensors, averaged, measured_current, sampled

_LEAST_READ: Final = 0.01  # of the dc link: no converter tells a voltage below zero
RECORDED: Final = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e", "u_dc", "i_a", "i_b", "i_c")


class Bench(NamedTuple):
    """What stays while a call of `simulated` runs."""

    plant: Plant  # at 23.4 degC, its magnets whole
    course: Course  # what temperature makes of the machine over time, where it is prescribed
    thermal: Thermal
    demagnetisation: Demagnetisation
    warming: warmings.Courses
    telegraph: Telegraph
    sensors: Sensors
    voltage: VoltageSensing
    timing: Timing
    compensation: Compensation
    fixed: Commissioning
    bridge: Bridge
    sub_steps: int  # integration steps per control period
    moves: bool  # magnets or inductances move, which takes energy
    tells_filtered: bool  # recordings have the speed that the drive controls by
    crossed: bool  # the motor's phases b and c are connected the other way round


class State(NamedTuple):
    """All that changes from period to period; `sample` is the one taken at `tick`."""

    tick: int
    plant: PlantState
    machine: Machine  # of the period before
    heat: Temperatures
    telegraph: bool  # its offset is there
    bridge: BridgeState
    W_given: float  # J, that moving magnets and inductances gave to the field
    u_waiting: complex  # V, stationary, computed and held back by a delay
    u_before: complex  # V, rotor frame, of the period before
    sample: Sample
    earlier: Earlier  # samples before that, as the converter gave them
    charges: Charges
    tracked: Tracked
    edges: Edges
    encoder: float  # rad, mechanical, what the encoder read then
    firmware: FirmwareState
    row: Row


@kernel
def machine_now(bench: Bench, t: float, heat: Temperatures) -> Machine:
    """The machine as it is at a time (s) and so warm."""
    m = machine_at(bench.plant.machine, bench.course, t)
    R_s, psi_f = m.R_s, m.psi_f
    if bench.thermal.C_w > 0.0:
        R_s *= thermals.resistance_factor(bench.thermal, heat)
        psi_f *= thermals.flux_factor(bench.thermal, heat)
    if bench.demagnetisation.share > 0.0:
        psi_f *= demagnetisations.flux_factor(bench.demagnetisation, t)
    if len(bench.warming.winding) > 0:
        R_s *= warmings.factor_at(bench.warming.winding, t)
    if len(bench.warming.magnets) > 0:
        psi_f *= warmings.factor_at(bench.warming.magnets, t)
    return Machine(R_s, m.L_d, m.L_q, psi_f, m.n_p, m.i_rated, m.J, m.B)


@kernel
def plant_of(bench: Bench, machine: Machine, telegraph: bool) -> Plant:
    """The plant with the machine as it is now."""
    p = bench.plant
    m = p.magnetics
    magnetics = magnetics_of(machine, m.psi_0, m.curve, m.harmonics, m.ripples, p.flux_map)
    offset = telegraph_voltage(bench.telegraph, telegraph)
    return Plant(
        machine, p.R_cold, magnetics, p.flux_map, p.shaft, p.iron, p.imbalance, p.skin, p.short, p.stray, offset,
        p.resonance, p.filter_time,
    )  # fmt: skip


@kernel
def _read(
    sensors: Sensors, n_p: int, was_at: float, plant: PlantState, T: float, tracked: Tracked, edges: Edges
) -> tuple[Tracked, Edges]:
    """What is known of the shaft T (s) after it was at an angle (rad)."""
    if sensors.hall.rate == NO_HALL:
        return followed(sensors.signal, n_p, plant.theta_m, plant.omega_m, T, tracked), edges
    edges = edges_after(sensors.hall, n_p * nearest(plant.theta_m - was_at), T, edges)
    return Tracked(plant.omega_m, hall_read(sensors.hall, n_p, plant.theta_m, edges), 0.0, 0.0), edges


@kernel
def _to_converter(bench: Bench, plant: Plant, state: PlantState, charges: Charges) -> complex:
    """Stationary current vector (A) that comes to the converter, or that it averages."""
    way = bench.sensors.filter
    if way.periods > 0:
        return mean_current(way.periods, bench.fixed.T_s, state.charge, charges)
    return state.i_f if way.tau > 0.0 else bridge_current(plant, state)


@kernel
def _sampled(
    bench: Bench, plant: Plant, state: PlantState, charges: Charges, tracked: Tracked, u: complex, powered: bool,
    tick: int,
) -> Sample:
    """The sample at a tick; u (V) is what a bridge without edges applies from then on; off, one with edges none."""
    i, slope, skew = _to_converter(bench, plant, state, charges), 0j, longest_skew(bench.sensors.current)
    t = tick * bench.fixed.T_s
    if skew > 0.0 and (powered or not bench.bridge.switched):
        supply = vector(0j if bench.bridge.switched else u, bench.bridge.E)  # edges: the zero vector is on then
        later = stepped(plant, supply, t, skew, state)
        slope = (_to_converter(bench, plant, later, charges) - i) / skew
    theta_m = tracked.read - tracked.error
    sees = crossed(bench.crossed, i), crossed(bench.crossed, slope), crossed(bench.crossed, u)
    return sampled(bench.sensors, sees[0], theta_m, tick, sees[1], t, sees[2])


@kernel
def crossed(exchanged: bool, x: complex) -> complex:
    """A stationary vector with phases b and c exchanged, where they are."""
    return x.conjugate() if exchanged else x


def started(bench: Bench, settings: Settings, powered: bool, temperature: float) -> State:
    """The state at tick 0: no current, angle zero, speed as the profile says, all at a temperature (degC)."""
    omega_m = profile_speed(bench.plant.shaft.profile, 0.0)
    heat = Temperatures(temperature, temperature, temperature)
    machine = machine_now(bench, 0.0, heat)
    plant = plant_of(bench, machine, False)
    state = plant_started(plant, 0.0, omega_m)
    back_emf = 1j * machine.n_p * omega_m * machine.psi_f  # at angle zero
    charges = (0j, 0j, 0j)  # no current has flown
    signal = bench.sensors.signal
    read = sensed(signal, machine.n_p, state.theta_m - signal.latency * omega_m)
    hall, omega_e = bench.sensors.hall, machine.n_p * omega_m
    edges = first_edges(hall, machine.n_p * state.theta_m, omega_e)
    if hall.rate != NO_HALL:
        read = hall_read(hall, machine.n_p, state.theta_m, edges)
    tracked = Tracked(omega_m, read, 0.0, omega_m)
    raw = _sampled(bench, plant, state, charges, tracked, back_emf, powered, 0)
    n_p, psi_f = settings.n_p, settings.control_psi_f  # what the drive takes the machine for
    sample = corrected(settings.sensing, settings.tables.angle_table, n_p, raw, n_p * omega_m)
    firmware = switched_on(sample.theta_m, omega_m, n_p, psi_f, bench.fixed.T_s, powered)
    bridge = BridgeState(bench.bridge.E, False, False, False, 0.0, 0.0, 0.0)
    return State(
        0, state, machine, heat, False, bridge, 0.0, firmware.u_next, 0j, sample, (raw, raw, raw), charges, tracked,
        edges, raw.theta_m, firmware, NO_ROW,
    )  # fmt: skip


@kernel
def _duties(bench: Bench, u: complex, u_dc: float) -> Duties:
    """What the modulator makes of a stationary voltage (V)."""
    shortest = bench.bridge.inverter.min_pulse / bench.fixed.T_s
    return modulated(u if bench.fixed.overmodulates else limited(u, u_dc), u_dc, bench.bridge.timer_counts, shortest)


@kernel
def _within_reach(bench: Bench, u: complex, u_dc: float) -> complex:
    """The voltage (V, stationary) that a drive takes for applied."""
    return voltage_of(_duties(bench, u, u_dc), u_dc) if bench.bridge.switched else limited(u, u_dc)


@kernel
def _compensating(bench: Bench, firmware: FirmwareState, u_dc: float) -> complex:
    """Voltage (V, stationary) that is added to what was computed, for the dead time's sake."""
    i, by = firmware.i_next, bench.compensation.by
    if by == BY_SAMPLE:
        i = firmware.i_sampled
    elif by == BY_COMMAND:
        i = firmware.i_wanted
    return compensating(bench.compensation, i, u_dc, bench.fixed.T_s)


@kernel
def _compensated(
    bench: Bench, settings: Settings, u: complex, applied: FirmwareState, firmware: FirmwareState, u_dc: float
) -> tuple[complex, complex, complex]:
    """A voltage (V, stationary) that is computed, with what is added for the bridge's sake and recorded; what is added
    and is not; and what will be to the next one, and recorded.
    """
    added = lost(settings.inverter, settings.tables.inverter_table, applied.i_next, u_dc, bench.fixed.T_s)
    if bench.compensation.time == 0.0:
        return u, added, 0j
    more = _compensating(bench, applied, u_dc)
    if bench.compensation.recorded == 0:
        return u, added + more, 0j
    return u + more, added, _compensating(bench, firmware, u_dc)


@kernel
def _write_line(
    line: NDArray[np.float64], t: float, omega_e: float, period: Period, theta_e: float, sample: Sample
) -> None:
    """One line of a recording: `RECORDED`."""
    line[0] = t
    line[1], line[2] = period.u.real, period.u.imag
    line[3], line[4] = period.i.real, period.i.imag
    line[5], line[6], line[7] = omega_e, theta_e, period.u_dc
    line[8], line[9], line[10] = sample.i_a, sample.i_b, sample.i_c


@kernel
def _driven(
    bench: Bench, now: Plant, u: complex, added: complex, exchanged: bool, known: bool, u_dc: float, t: float,
    bridge: BridgeState, plant: PlantState, room: Scratch,
) -> tuple[complex, BridgeState, PlantState]:
    """A control period from t (s) on, of a voltage (V, stationary) and what is added to it for the bridge's sake.

    The voltage that the drive takes for applied, and bridge and plant afterwards.
    """
    T_s, set_ = bench.fixed.T_s, crossed(exchanged, u + added)
    if bench.bridge.switched:
        duties = _duties(bench, set_, u_dc) if known else Duties(0.0, 0.0, 0.0)
        bridge, plant = switched(bench.bridge, now, duties, known, t, T_s, bench.sub_steps, bridge, plant, room)
        set_ = voltage_of(duties, u_dc)
    else:
        set_ = limited(set_, u_dc)
        supply = vector(set_ * (bridge.u_dc / u_dc), bridge.u_dc)
        plant = advanced(now, supply, t, T_s, bench.sub_steps, plant)
    return crossed(exchanged, set_) - added, bridge, plant


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
    T_s, n_p, sensing, tables = bench.fixed.T_s, settings.n_p, settings.sensing, settings.tables
    exchanged = bench.crossed != (sensing.phases_swapped != 0)
    (
        tick, plant, machine, heat, telegraph, bridge, W_given, u_waiting, u_before, sample, earlier, charges,
        tracked, edges, encoder, firmware, row,
    ) = state  # fmt: skip
    room, complete = scratch(), 0
    for n in range(periods):
        t = tick * T_s
        u_dc = max(sensing.u_dc_gain * read_voltage(bench.voltage, bridge.u_dc), _LEAST_READ * bench.fixed.u_dc)
        # The period: the voltage computed one period ago is applied while the next is computed, or this one at once
        ready, firmware = firmware, computed(bench.fixed, settings, firmware, sample, u_dc, t)
        applied = firmware if bench.timing.delay < 0 else ready
        u, known = applied.u_next, applied.powered
        if bench.timing.delay > 0:
            u, u_waiting = u_waiting, u
        u, added, told = _compensated(bench, settings, u, applied, firmware, u_dc) if known else (u, 0j, 0j)
        if bench.telegraph.amplitude > 0.0:
            telegraph = keyed(bench.telegraph, telegraph, T_s, bench.fixed.seed, tick)
        was, machine = machine, machine_now(bench, t + 0.5 * T_s, heat)
        now = plant_of(bench, machine, telegraph)
        if bench.moves:
            W_given += field(now, plant) - field(plant_of(bench, was, telegraph), plant)
        W_copper, W_iron, was_at, edges_before = plant.W_copper, plant.W_iron, plant.theta_m, edges
        u, bridge, plant = _driven(bench, now, u, added, exchanged, known, u_dc, t, bridge, plant, room)
        plant = settled(now, t + T_s, plant)
        if bench.thermal.C_w > 0.0:
            heat = warmed(bench.thermal, heat, plant.W_copper - W_copper, plant.W_iron - W_iron, T_s)
        then = plant_of(bench, machine_now(bench, (tick + 1) * T_s, heat), telegraph)
        u_next = u_waiting if bench.timing.delay > 0 else firmware.u_next
        u_held = limited(crossed(exchanged, u_next), u_dc) * (bridge.u_dc / u_dc)
        tracked, edges = _read(bench.sensors, then.machine.n_p, was_at, plant, T_s, tracked, edges)
        latest = _sampled(bench, then, plant, charges, tracked, u_held, firmware.powered, tick + 1)
        raw = averaged(latest, earlier, bench.sensors.filter.samples)
        before, encoder, earlier, charges = (
            sample, raw.theta_m, (latest, earlier[0], earlier[1]), passed(plant.charge, charges),
        )  # fmt: skip
        sample = seen(settings, firmware, corrected(sensing, tables.angle_table, n_p, raw, firmware.omega_e))

        # What the drive knows of it
        theta_e = wrapped(n_p * before.theta_m)
        turn = n_p * nearest(sample.theta_m - before.theta_m)
        u_told = u * turned(-(theta_e + turn / 2.0)) if known else complex(math.nan, math.nan)
        u_dq = u_told
        if bench.timing.shift < 0:
            u_dq = u_before
        elif bench.timing.shift > 0 and known:
            u_dq = _within_reach(bench, u_next + told, u_dc) * turned(-(theta_e + 1.5 * turn))
        u_before = u_told
        period = Period(
            theta_e,
            turn,
            measured_current(before) * turned(-theta_e),
            measured_current(sample) * turned(-(theta_e + turn)),
            u_dq,
            u_dc,
        )
        row = extended(row, tick, period, settings.stream_periods)
        if row.taken == row.periods:
            write_row(row, T_s, ticks, rows, complete)
            complete += 1
        if len(recording) > 0:
            _write_line(
                recording[n], t, firmware.omega_e if bench.tells_filtered else turn / T_s, period,
                told_angle(bench.sensors.hall, edges_before, theta_e), before,
            )  # fmt: skip
        tick += 1
    after = State(
        tick, plant, machine, heat, telegraph, bridge, W_given, u_waiting, u_before, sample, earlier, charges,
        tracked, edges, encoder, firmware, row,
    )  # fmt: skip
    return after, complete
