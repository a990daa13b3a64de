"""The virtual drive: all of the emulator behind the drive's dictionary, advanced by control periods.

It has no clock and no thread: whoever calls `run` is its time. `read`, `request`, `control`, `write` and `captured` may
come from other threads; what is written waits and takes effect, in its order, at the start of the next `run`. Clients
come by `request` and `control`, which keep to the control lease; `write` is for the master inside. Knows nothing of
buses.
"""

import math
import struct
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.wire.cia402 import (
    COMMUNICATION,
    OVERCURRENT,
    OVERSPEED,
    OVERTEMPERATURE_MOTOR,
    OVERVOLTAGE,
    SPEED_ERROR,
    UNDERVOLTAGE,
    Command,
    State,
)
from drivers.wire.codec import FULL_SCALES, check_range, decode, encode_held
from drivers.wire.dictionary import (
    AT_REST,
    LEASE_TIMES,
    SIGNALS,
    TABLE_SIZE,
    TABLES,
    WATCHDOG_LAYOUT,
    Signal,
    WireType,
    layout_id,
    signal_named,
    signals_of,
)
from drivers.wire.lease import Bridge, End, Record, holder_words, unpacked
from drivers.wire.memory import MemoryState
from emulator.drive import stream
from emulator.drive.assembly import bench_of
from emulator.drive.control_lease import ControlLease, Denial, DeniedError
from emulator.drive.in_place import begun, now_of, set_bench, set_settings, set_state, state_of, stepped
from emulator.drive.memory import Memory
from emulator.drive.recorder import ARMED, TRIGGERED, Recorder, Setup
from emulator.drive.simulation import RECORDED, machine_now, plant_of, started
from emulator.drive.simulation import State as SimulationState
from emulator.firmware.control import (
    NO_TRIP,
    OFF,
    PROFILE,
    REFERENCE,
    TRIP_CURRENT,
    TRIP_HIGH_VOLTAGE,
    TRIP_LOW_VOLTAGE,
    TRIP_OVERSPEED,
    TRIP_SPEED,
    Settings,
)
from emulator.firmware.correction import Inverter, Saturation, Sensing, Tables
from emulator.firmware.excitation import FASTEST_SINE, KINDS, highest_sine
from emulator.firmware.operation import Operation
from emulator.frames import TURN
from emulator.plant.course import continued, rows_at
from emulator.plant.dynamics import Plant, PlantState
from emulator.plant.machine import at_temperature
from emulator.plant.physics.sensing import read_voltage
from emulator.plant.physics.thermal import Temperatures
from emulator.plant.physics.timing import kept
from emulator.plant.physics.warming import factors_at
from emulator.scenario.scenarios import SAFE_TORQUE_OFF, Scenario, check, overspeed_of

Column = NDArray[np.float64]

_WHOLE: Final = frozenset(s.name for s in SIGNALS if s.access == "rw" and s.type is not WireType.F32)
_PARAMETERS: Final = tuple(s for s in SIGNALS if s.is_parameter)
_PARTS: Final = {"sensing": Sensing, "inverter": Inverter, "saturation": Saturation}  # of the settings
_RESET, _BRIDGE = "reset", "bridge"  # stand among what is written
_NO_SIGNALS: Final = frozenset({_RESET, _BRIDGE})
_SWITCHING_ON: Final = (Command.SHUTDOWN, Command.SWITCH_ON, Command.ENABLE_OPERATION)
_LEASE_TIME: Final = 2.0  # s, `watchdog_time` as delivered
_NEVER: Final = 1e9  # rad/s
_FORCED_SPEED: Final = 3.0  # rad/s, electrical, as delivered
_CURRENTS: Final = frozenset({"i_d_ref", "i_q_ref", "i_d_step", "i_q_step", "i_d_weakening", "current_limit"})
_ROUNDED: Final = 1.0 + 1e-6  # of a limit: what 32 bits make of it may be written again
_NOT_WHILE_ON: Final = frozenset({"reset", "angle_source"})
_NOT_WHILE_STORING: Final = frozenset({"store", "restore", "reset"})
_TRIPS: Final = {
    TRIP_CURRENT: OVERCURRENT, TRIP_HIGH_VOLTAGE: OVERVOLTAGE, TRIP_LOW_VOLTAGE: UNDERVOLTAGE, TRIP_SPEED: SPEED_ERROR,
    TRIP_OVERSPEED: OVERSPEED,
}
_GUARDED: Final = 1000  # control periods after which a recording's drive looks at its temperature again
_NO_RECORDING: Final = np.empty((0, len(RECORDED)))


@dataclass(frozen=True, slots=True, eq=False)
class StreamRows:
    """Complete rows of the stream, columns of equal length n, SI, by the row convention of the dictionary."""

    row_tick: NDArray[np.int64]  # control periods since reset, all bits
    theta_e: Column  # rad, 0 to 2 pi
    i_d: Column  # A
    i_q: Column  # A
    omega_e: Column  # rad/s
    u_d: Column  # V
    u_q: Column  # V
    i_d_mean: Column  # A
    i_q_mean: Column  # A
    u_dc: Column  # V

    def __len__(self) -> int:
        return len(self.row_tick)


@dataclass(frozen=True, slots=True)
class Truth:
    """What the machine is at its present temperature; no drive knows this."""

    R_s: float  # ohm
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Vs
    temp_winding: float  # degC
    temp_magnet: float  # degC


_TRUTH: Final = tuple(field.name for field in fields(Truth))


class VirtualDrive:
    """A drive with a motor, as the scenario says. Raises ScenarioError when that cannot be.

    It runs by itself, and anybody may write to it, unless it is `on_links`: then `scenario.drive.control` says who may.
    """

    def __init__(
        self, scenario: Scenario, serial: int = 1, *, on_links: bool = False, memory: Memory | None = None
    ) -> None:
        check(scenario)
        control = scenario.drive.control if on_links else "watchdog"
        self._local = control == "local"
        self._guarded = control != "watchdog"  # it has a control lease, and no other watchdog
        self.layout_id: Final = layout_id() if self._guarded else WATCHDOG_LAYOUT
        self.names: Final = frozenset(signal.name for signal in signals_of(self.layout_id))
        self._parameters: Final = tuple(signal for signal in _PARAMETERS if signal.name in self.names)
        self.serial: Final = serial
        self.scenario: Final = scenario
        drive, run = scenario.drive, scenario.run
        self._bench = bench_of(scenario)
        self._fixed = self._bench.fixed
        self._runs = drive.enabled and control != "lease"  # from the start, and after a reset
        self._settings = _first_settings(scenario, on_links)
        if control == "lease":
            self._settings = _at_rest(self._settings)
        state = started(self._bench, self._settings, self._runs, run.temperature)
        self._simulation = begun(self._bench, self._settings, state)
        self._now = now_of(self._simulation)
        self._operation = self._switched_on()
        self._reset_at = 0  # tick since power-on of the latest reset
        self.resets = 0  # so many there have been
        self._resetting = False
        self._lock = threading.Lock()  # guards what follows
        self._lease = ControlLease(self._local)
        self._holder: str | None = None  # whose name can be read
        self._recorder = Recorder({name: self._constants()[name] for name in FULL_SCALES})
        self._written: list[tuple[str, float]] = []
        self._heard = False
        self._next_temperature: float | None = None
        self._readable = self._constants() | dict.fromkeys(stream.COLUMNS, 0.0) | {"row_tick": 0.0}
        self._readable |= {s.name: max(0.0, s.minimum or 0.0) for s in SIGNALS if s.access == "rw"}
        self._readable["watchdog_time"] = _LEASE_TIME if self._guarded else 0.0
        self._memory = memory or Memory()
        self._readable |= _flat(self._settings)
        self._delivered = {signal.name: self._readable[signal.name] for signal in _PARAMETERS}
        if self._memory.values:
            self._recall()
            self._apply_settings()
        self._readable |= self._first_sample(state)
        self._publish()

    @property
    def has_lease(self) -> bool:
        """It is of the layout with a control lease."""
        return self._guarded

    @property
    def tick(self) -> int:
        """Control periods since reset, all bits."""
        return self._now.tick - self._reset_at

    @property
    def rows_end(self) -> int:
        """Tick at which the latest complete stream row ended: the one under way began there."""
        return self._now.row_end - self._reset_at

    @property
    def elapsed(self) -> float:
        """Time since power-on in s, whatever resets there were."""
        return self._now.tick * self.T_s

    @property
    def T_s(self) -> float:
        """Control period in s."""
        return self._fixed.T_s

    @property
    def row_periods(self) -> int:
        """Control periods of the rows that began in the latest run."""
        return self._settings.stream_periods

    @property
    def _state(self) -> SimulationState:
        return state_of(self._simulation)

    @property
    def plant(self) -> PlantState:
        """True state of machine and shaft at the present tick."""
        return self._state.plant

    @property
    def energy_given(self) -> float:
        """Energy (J) that moving magnets and inductances have given to the field."""
        return self._state.W_given

    def plant_now(self) -> Plant:
        """What the plant is in the present control period."""
        state = self._state
        return plant_of(self._bench, state.machine, state.telegraph)

    @property
    def truth(self) -> Truth:
        """True parameters now; a temperature that was set counts from the next `run` on."""
        m = machine_now(self._bench, self.elapsed, self._state.heat)
        return Truth(m.R_s, m.L_d, m.L_q, m.psi_f, *self._temperatures())

    def _temperatures(self) -> tuple[float, float]:
        """Of winding and magnets, degC."""
        if self._bench.thermal.C_w > 0.0:
            return self._now.winding, self._now.magnet
        return self._now.temperature, self._now.temperature

    def truth_at(self, t: NDArray[np.floating[Any]]) -> dict[str, Column]:
        """True parameters at times (s since reset), by the names of `Truth`; `truth_at(recording["t"])` fits its rows.

        For times to come: what the scenario's profile, or the temperature last set, will make of them.
        """
        if self._bench.thermal.C_w > 0.0:
            raise ValueError("parameters that follow from losses are known for the present only")
        temperature, R_s, L_d, L_q = np.ascontiguousarray(rows_at(self._bench.course, np.array(t, np.float64)).T)
        step = self._bench.demagnetisation
        left = 1.0 - step.share * np.clip((np.asarray(t) - step.time) / step.duration, 0.0, 1.0)
        winding, magnets = self._bench.warming
        R_s, left = R_s * factors_at(winding, t), left * factors_at(magnets, t)
        psi_f: Column = np.array(self._bench.plant.machine.psi_f * np.broadcast_to(left, R_s.shape), np.float64)
        return dict(zip(_TRUTH, (R_s, L_d, L_q, psi_f, temperature, temperature.copy()), strict=True))

    def warm_up(self) -> None:
        """Compile, or load from the cache, all that `run` needs, without a period passing."""
        self._simulate(0, _NO_RECORDING)
        set_bench(self._simulation, self._bench)
        set_settings(self._simulation, self._settings)
        set_state(self._simulation, self._state)

    def run(self, periods: int) -> StreamRows:
        """Advance by control periods; the stream rows that became complete on the way."""
        return self._advance(periods, _NO_RECORDING)

    def record(self, periods: int) -> dict[str, Column]:
        """Advance by control periods; a recording of every one, columns `simulation.RECORDED` by name.

        Row k: time, angle and currents at the start of period k, the voltage applied over it in the rotor
        frame at its middle. Stream rows that become complete meanwhile are lost to the stream.
        """
        recording, tick = np.empty((max(periods, 0), len(RECORDED))), self._now.tick
        for begin in range(0, max(periods, 1), _GUARDED):
            count = min(_GUARDED, periods - begin)
            self._advance(count, recording[begin : begin + count])
        recording = recording[kept(self._bench.timing, self._fixed.seed, tick, len(recording))]
        return dict(zip(RECORDED, np.ascontiguousarray(recording.T), strict=True))

    def read(self, name: str) -> float:
        """SI value of a signal: as last written, or of the latest row. Raises KeyError for an unknown one."""
        signal_named(name)
        with self._lock:
            return (self._present() if self._written else self._readable)[name]

    def values(self, names: Iterable[str]) -> dict[str, float]:
        """SI values of signals, all of one moment."""
        with self._lock:
            present = self._present()
        return {name: present[name] for name in names}

    def write(self, name: str, value: float) -> None:
        """Write a signal (SI), from the next `run` on. Raises KeyError or ValueError, in a sentence."""
        signal = signal_named(name)
        with self._lock:
            self._check_write(signal, value, self._present())
            self._written.append((name, float(value)))

    def request(self, name: str, value: float) -> None:
        """Write a signal for a client without a token. Raises DeniedError, KeyError or ValueError, in a sentence."""
        signal = signal_named(name)
        with self._lock:
            self._check_write(signal, value, self._present())
            if self._guarded and self._lease.check_write(signal, value, self._operation.powered):
                self._stopped()
            self._written.append((name, float(value)))

    def control(self, data: bytes) -> None:
        """Take a control record, whole or not at all. Raises DeniedError, or ValueError in a sentence."""
        record = unpacked(data, lambda signal: signal.name in self.names)
        full = {name: self._readable[name] for name in FULL_SCALES}
        values = [(signal, decode(signal, part, full)) for signal, part in record.values]
        with self._lock:
            present = self._present()
            self._lease.check_record(record, present["watchdog_time"])
            for signal, value in values:
                self._check_write(signal, value, present)
                present[signal.name] = value
            self._lease.take_record(record)
            self._publish_lease()
            self._written += [(signal.name, value) for signal, value in values]
            self._switch(record)

    def _switch(self, record: Record) -> None:
        """Bridge on or off, after the record's values; a lease that was given up leaves it off, without set points."""
        bridge = record.bridge if self._lease.held else Bridge.OFF
        if bridge is not Bridge.AS_IT_IS:
            self._written.append((_BRIDGE, float(bridge)))
        if bridge is Bridge.OFF:
            self._written += [(name, 0.0) for name in AT_REST]

    def _stopped(self) -> None:
        """Somebody without a token has stopped it: whoever had control has it no longer."""
        if self._lease.held:
            self._lease.over(End.STOPPED)
            self._written += [(name, 0.0) for name in AT_REST]
            self._publish_lease()

    def reset(self) -> None:
        """Start anew at the next `run`, as after a power cycle: stored parameters, tick 0, state as at the start.

        What is being stored is cut.
        """
        with self._lock:
            self._written.append((_RESET, 0.0))

    def hear(self) -> None:
        """A client was heard, which is all that the watchdog of a drive without a control lease waits for."""
        self._heard = True

    def captured(self, offset: int, count: int) -> bytes:
        """Samples of the recording from `offset` on, at most `count`: 16-bit little-endian counts, sample by sample."""
        with self._lock:
            return self._recorder.data(offset, count)

    def set_temperature(self, temperature: float) -> None:
        """Set winding and magnets to a temperature (degC), from the next `run` on. Raises ValueError.

        There they stay: what is left of the scenario's temperature profile is void.
        """
        at_temperature(self.scenario.motor, temperature)
        with self._lock:
            self._next_temperature = temperature

    def _check_write(self, signal: Signal, value: float, present: dict[str, float]) -> None:
        if signal.access != "rw":
            raise ValueError(f"{signal} cannot be written")
        if not math.isfinite(value):
            raise ValueError(f"{signal} takes a finite number, got {value}")
        check_range(signal, value)
        if signal.name == "watchdog_time" and self._guarded and value < LEASE_TIMES[0]:
            raise ValueError(f"{signal} takes at least {LEASE_TIMES[0]:g} s, got {value:g}")
        if signal.name in _NOT_WHILE_ON and self._operation.powered:
            raise DeniedError(Denial.BUSY)
        if signal.name in _NOT_WHILE_STORING and present["memory_state"] == MemoryState.WRITING:
            raise DeniedError(Denial.BUSY)
        if signal.name in _WHOLE and value != int(value):
            raise ValueError(f"{signal} takes a whole number, got {value}")
        if signal.name == "capture_command" and value == 1.0:
            Setup.of(present)
        if signal.name in _CURRENTS and abs(value) > _ROUNDED * self._fixed.i_max:
            raise ValueError(
                f"{signal} takes at most {self._fixed.i_max:g} A, the drive's current limit, got {value:g}"
            )
        self._check_excitation(signal, present | {signal.name: value})

    def _check_excitation(self, signal: Signal, present: dict[str, float]) -> None:
        """Raise ValueError where the control is too slow for what the signals would then be."""
        if signal.name in ("speed_ref", "speed_step"):
            fastest, most = abs(present["speed_ref"]) + present["speed_step"], 1.0 / self.T_s
            if fastest > most:
                raise ValueError(f"{signal} takes speeds up to {most:g} rad/s, 1 rad a period, got up to {fastest:.5g}")
        if signal.name in ("sine_frequency", "sine_count"):
            highest, most = highest_sine(present["sine_frequency"], present["sine_count"]), FASTEST_SINE / self.T_s
            if highest > most:
                raise ValueError(f"{signal} takes harmonics up to {most:g} Hz, got up to {highest:g} Hz")

    def _advance(self, periods: int, recording: NDArray[np.float64]) -> StreamRows:
        if periods < 0:
            raise ValueError(f"a drive runs 0 or more periods, got {periods}")
        self._take_written()
        if self._now.powered != self._operation.powered or self._now.trip != NO_TRIP:
            state = self._state
            firmware = state.firmware._replace(powered=self._operation.powered, trip=NO_TRIP)
            set_state(self._simulation, state._replace(firmware=firmware))
        recording = self._record_for_capture(periods, recording)
        tick = self.tick
        rows = self._simulate(periods, recording)
        self._protect(self._temperatures()[0])
        self._memory.pass_(periods * self.T_s)
        with self._lock:
            self._recorder.take(tick, recording)
        self._publish(rows)
        return rows

    def _record_for_capture(self, periods: int, recording: NDArray[np.float64]) -> NDArray[np.float64]:
        if len(recording) or self._recorder.state not in (ARMED, TRIGGERED):
            return recording
        return np.empty((periods, len(RECORDED)))

    def _protect(self, winding: float) -> None:
        """Go into fault where the simulation tripped, `winding` (degC) is too hot, or nobody was heard for too long."""
        operation, heard = self._operation, self._heard
        was_powered, self._heard = operation.powered, False
        if heard or not operation.powered:
            operation.heard = self.tick
        if self._now.trip != NO_TRIP:
            operation.fault(_TRIPS[self._now.trip])
        if operation.powered and winding > self.scenario.drive.temperature_trip:
            operation.fault(OVERTEMPERATURE_MOTOR)
        if not self._guarded:
            operation.watch(self.tick, round(self._readable["watchdog_time"] / self.T_s))
            return
        with self._lock:
            ran_out = self._lease.passed(self.tick, self.T_s)
        if ran_out and operation.powered:
            operation.fault(COMMUNICATION)
        if ran_out or (was_powered and not operation.powered):
            self._stand_still()

    def _stand_still(self) -> None:
        """No set points: whoever switches the bridge on again says what it is to do."""
        self._settings = _at_rest(self._settings)
        set_settings(self._simulation, self._settings)
        with self._lock:
            self._readable |= dict.fromkeys(AT_REST, 0.0)

    def _simulate(self, periods: int, recording: NDArray[np.float64]) -> StreamRows:
        # One row may end at once, the others take `stream_periods`
        room = 1 + periods // self._settings.stream_periods
        ticks, rows = np.empty(room, np.int64), np.empty((room, len(stream.COLUMNS)))
        self._now, n = stepped(self._simulation, periods, ticks, rows, recording)
        whole = ticks[:n] >= self._reset_at  # a row that a reset cut is none
        return StreamRows(ticks[:n][whole] - self._reset_at, *np.ascontiguousarray(rows[:n][whole].T))

    def _take_written(self) -> None:
        with self._lock:
            written, self._written = self._written, []
            temperature, self._next_temperature = self._next_temperature, None
            for name, value in written:
                self._take(name, value)
            self._publish_state()  # who stops a drive that goes on just now is not told a state of before that
        if temperature is not None and self._bench.thermal.C_w > 0.0:
            heat = Temperatures(temperature, temperature, temperature)
            set_state(self._simulation, self._state._replace(heat=heat))
        elif temperature is not None:
            bench = self._bench
            course = continued(bench.course, self.elapsed, bench.plant.machine, temperature)
            self._bench = bench._replace(course=course)
            set_bench(self._simulation, self._bench)
        if written:
            self._apply_settings()

    def _apply_settings(self) -> None:
        """Go on with the parameters as they are, as readable as they act."""
        with self._lock:
            self._settings = _typed(self._readable)
            self._readable |= _flat(self._settings)
        set_settings(self._simulation, self._settings)

    def _take(self, name: str, value: float) -> None:
        """What has been written, one by one."""
        if name in (_RESET, "reset"):
            self._restart()
            return
        if name in (_BRIDGE, "control_word"):
            self._command(name, int(value))
        if name == _BRIDGE:
            return
        self._readable[name] = value
        if name in ("store", "restore"):
            self._memory.store(self._image() if name == "store" else b"")
            if "memory_state" not in self.names:  # nobody could be told that it takes time
                self._memory.pass_(math.inf)
        elif name == "capture_command":
            self._command_recorder(int(value))

    def _command(self, name: str, value: int) -> None:
        """A control word, or a bridge that goes on or off."""
        operation, was_powered = self._operation, self._operation.powered
        allowed = self.scenario.drive.safe_torque_off != "active"
        if name == "control_word":
            operation.command(value)
        elif value == Bridge.OFF or operation.state is State.QUICK_STOP_ACTIVE:
            operation.command(Command.DISABLE_VOLTAGE.bits)
        if name == _BRIDGE and value == Bridge.ON and not was_powered:
            for command in _SWITCHING_ON:
                operation.command(command.bits)
        if operation.powered and not allowed:
            operation.command(Command.DISABLE_VOLTAGE.bits)
        went_off = was_powered and not operation.powered
        if self._guarded and (went_off or (name == _BRIDGE and value == Bridge.OFF)):
            self._readable |= dict.fromkeys(AT_REST, 0.0)

    def _switched_on(self) -> Operation:
        return Operation(State.OPERATION_ENABLED if self._runs else State.SWITCH_ON_DISABLED)

    def _image(self) -> bytes:
        """All parameters, as they are stored: the layout, then one after the other."""
        parts = [encode_held(signal, self._readable[signal.name], {}) for signal in self._parameters]
        return struct.pack("<I", self.layout_id) + b"".join(parts)

    def _recall(self) -> None:
        """Parameters as delivered, or as they were stored by a drive of this layout."""
        self._readable |= self._delivered
        if self._memory.values[:4] != struct.pack("<I", self.layout_id):
            return
        at = 4
        for signal in self._parameters:
            size = signal.type.bits // 8
            self._readable[signal.name] = decode(signal, self._memory.values[at : at + size], {})
            at += size

    def _restart(self) -> None:
        self._memory.restart()
        self._recall()
        if not self._runs:
            self._readable |= dict.fromkeys(AT_REST, 0.0)
        self._reset_at = self._now.tick
        self._resetting = True
        self._operation = self._switched_on()
        self._lease = ControlLease(self._local)
        self._recorder = Recorder(self._recorder.full)

    def _command_recorder(self, command: int) -> None:
        if command == 0:
            self._recorder.stop()
        elif command == 1:
            self._recorder.arm(Setup.of(self._readable))
        else:
            self._recorder.trigger()
        self._readable["capture_state"] = float(self._recorder.state)

    def _present(self) -> dict[str, float]:
        """Values as they will be when all that is written has been taken."""
        present = self._readable | {name: value for name, value in self._written if name not in _NO_SIGNALS}
        for name, value in self._written:
            if (name, value) == ("capture_command", 1.0):
                present["capture_state"] = float(ARMED)
            elif name in ("store", "restore") and "memory_state" in self.names:
                present["memory_state"] = float(MemoryState.WRITING)
        return present

    def _first_sample(self, state: SimulationState) -> dict[str, float]:
        """What is measured at power-on, which can be read until there is a row; no current flows yet."""
        return {
            "theta_e": self._settings.n_p * state.sample.theta_m % TURN,
            "omega_e": state.firmware.omega_e,
            "u_dc": self._settings.sensing.u_dc_gain * read_voltage(self._bench.voltage, state.bridge.u_dc),
        }

    def _publish(self, rows: StreamRows | None = None) -> None:
        """Make the present readable: tick, temperature, the latest row."""
        latest = {"tick": float(self.tick & 0xFFFF_FFFF)}
        latest["speed_demand"] = self._now.omega_e_ref
        latest["encoder_angle"] = self._now.encoder % TURN
        latest["capture_state"] = float(self._recorder.state)
        latest["capture_count"] = float(self._recorder.count)
        latest["capture_tick"] = float(self._recorder.tick & 0xFFFF_FFFF)
        latest["capture_number"] = float(self._recorder.number)
        memory = self._memory
        latest["memory_state"] = float(MemoryState.WRITING if memory.writing else memory.state)
        latest["memory_count"], latest["memory_checksum"] = float(memory.count), float(memory.checksum)
        latest["temp_winding"], latest["temp_magnet"] = self._temperatures()
        if rows:
            latest |= {name: float(getattr(rows, name)[-1]) for name in stream.COLUMNS}
            latest["row_tick"] = float(rows.row_tick[-1] & 0xFFFF)
        with self._lock:
            self._readable.update(latest)
            self._publish_state()
            self._publish_lease()
            self.resets += self._resetting  # now that all of it can be read
            self._resetting = False

    def _publish_state(self) -> None:
        operation = self._operation
        self._readable |= {"status_word": float(operation.state.bits), "error_code": float(operation.error_code)}

    def _publish_lease(self) -> None:
        lease = self._lease
        if lease.name != self._holder:
            self._holder = lease.name
            self._readable |= {f"lease_holder_{k}": float(word) for k, word in enumerate(holder_words(lease.name), 1)}
        self._readable |= {"lease_left": lease.left(self.tick, self.T_s), "lease_end": float(lease.end)}

    def _constants(self) -> dict[str, float]:
        drive = self.scenario.drive
        return {
            "layout_id": float(self.layout_id),
            "T_s": drive.T_s,
            "i_full": drive.i_full,
            "u_full": drive.u_full,
            "omega_full": drive.omega_full,
            "overcurrent_trip": self._fixed.i_trip,
            "overvoltage_trip": drive.overvoltage_trip,
            "undervoltage_trip": drive.undervoltage_trip,
            "temperature_trip": drive.temperature_trip,
            "safe_torque_off": float(SAFE_TORQUE_OFF.index(drive.safe_torque_off)),
        }


def _first_settings(scenario: Scenario, on_links: bool) -> Settings:
    """The drive as delivered: it takes the motor for what it is at 23.4 degC, unless its settings say otherwise.

    The speed loop is set for a shaft of inertia J: bandwidth alpha_s, integral time 4 / alpha_s.
    """
    motor, drive, run, excitation = scenario.motor, scenario.drive, scenario.run, scenario.excitation
    k_p_speed = run.speed_bandwidth * motor.J / (1.5 * motor.n_p**2 * motor.psi_f)
    follows = PROFILE if run.speed_reference == "profile" else REFERENCE
    settings = Settings(
        stream_periods=drive.stream_periods,
        n_p=motor.n_p,
        control_R_s=motor.R_s,
        control_L_d=motor.L_d,
        control_L_q=motor.L_q,
        control_psi_f=motor.psi_f,
        bandwidth=drive.bandwidth,
        field_weakening=int(drive.field_weakening),
        i_d_weakening=drive.i_d_weakening,
        weakening_voltage=drive.weakening_voltage,
        i_d_ref=excitation.i_d_ref,
        i_q_ref=excitation.i_q_ref,
        i_d_step=excitation.i_d_step,
        i_q_step=excitation.i_q_step,
        step_time=excitation.step_time,
        speed_control=follows if run.speed_control else OFF,
        speed_ref=excitation.speed_ref,
        speed_ramp=excitation.speed_ramp,
        speed_step=excitation.speed_step,
        speed_hold=excitation.speed_hold,
        excitation_kind=KINDS.index(excitation.kind),
        sine_frequency=excitation.sine_frequency,
        sine_count=excitation.sine_count,
        i_d_levels=excitation.i_d_levels,
        level_time=excitation.level_time,
        speed_error_trip=drive.speed_error_trip,
        speed_error_time=drive.speed_error_time,
        overspeed_trip=overspeed_of(scenario) if on_links or drive.overspeed_trip > 0.0 else _NEVER,
        own_gains=0,
        k_p_d=drive.bandwidth * motor.L_d,
        k_i_d=drive.bandwidth * motor.R_s,
        k_p_q=drive.bandwidth * motor.L_q,
        k_i_q=drive.bandwidth * motor.R_s,
        decoupling=1,
        k_p_speed=k_p_speed,
        k_i_speed=k_p_speed * run.speed_bandwidth / 4.0,
        speed_filter=drive.speed_filter,
        current_limit=drive.i_max,
        angle_source=0,
        forced_angle=0.0,
        forced_speed=_FORCED_SPEED,
        sensing=Sensing(),
        inverter=Inverter(),
        saturation=Saturation(),
        tables=Tables(*np.zeros((len(TABLES), TABLE_SIZE))),
    )
    return _typed(_flat(settings) | scenario.settings)


def _at_rest(settings: Settings) -> Settings:
    """Without anything that the motor is to do."""
    return _typed(_flat(settings) | dict.fromkeys(AT_REST, 0.0))


def _flat(settings: Settings) -> dict[str, float]:
    """Every setting by its signal's name."""
    values: dict[str, Any] = settings._asdict()
    tables = values.pop("tables")._asdict()
    for part in _PARTS:
        values |= values.pop(part)._asdict()
    for name, table in tables.items():
        values |= {f"{name}_{k}": value for k, value in enumerate(table, start=1)}
    return {name: float(value) for name, value in values.items()}


def _typed(values: Mapping[str, float]) -> Settings:
    """Settings as they are compiled: a whole number where the signal takes one, else a real one."""

    def taken(names: Iterable[str]) -> dict[str, Any]:
        return {name: int(values[name]) if name in _WHOLE else float(values[name]) for name in names}

    parts: dict[str, Any] = {name: part(**taken(part._fields)) for name, part in _PARTS.items()}
    tables = Tables(**{name: np.array([values[f"{name}_{k}"] for k in range(1, TABLE_SIZE + 1)]) for name in TABLES})
    scalars = [name for name in Settings._fields if name not in (*_PARTS, "tables")]
    return Settings(**taken(scalars), **parts, tables=tables)
