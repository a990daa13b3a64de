"""The drive's state machine by CiA 402: every transition of the standard, faults and their reset, the watchdog."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from drivers.wire.cia402 import (
    COMMUNICATION,
    OVERCURRENT,
    OVERTEMPERATURE_MOTOR,
    OVERVOLTAGE,
    SPEED_ERROR,
    UNDERVOLTAGE,
    Command,
    State,
    command_of,
    error_register,
    error_text,
    state_of,
)
from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.firmware.control import computed
from emulator.firmware.operation import Operation
from emulator.plant.physics.thermal import Thermal
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, check

OFF, READY, ON, ENABLED = (
    State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED,
)
STOPPED, FAULT = State.QUICK_STOP_ACTIVE, State.FAULT

# IEC 61800-7-201, by the numbers of its transitions: (number, state, control word, next state)
TRANSITIONS = [
    (2, OFF, 0x06, READY), (3, READY, 0x07, ON), (4, ON, 0x0F, ENABLED), (5, ENABLED, 0x07, ON), (6, ON, 0x06, READY),
    (7, READY, 0x00, OFF), (7, READY, 0x02, OFF), (8, ENABLED, 0x06, READY), (9, ENABLED, 0x00, OFF),
    (10, ON, 0x00, OFF), (10, ON, 0x02, OFF), (11, ENABLED, 0x02, STOPPED), (12, STOPPED, 0x00, OFF),
    (15, FAULT, 0x80, OFF), (16, STOPPED, 0x0F, ENABLED),
]


def scenario(**drive: object) -> Scenario:
    """The paper's, with another drive."""
    return replace(PAPER, drive=replace(PAPER.drive, **drive))  # pyright: ignore[reportArgumentType]


def told(drive: VirtualDrive) -> State | None:
    return state_of(int(drive.read("status_word")))


def commanded(drive: VirtualDrive, *words: int) -> None:
    for word in words:
        drive.write("control_word", word)
    drive.run(1)


@pytest.mark.parametrize(("number", "before", "word", "after"), TRANSITIONS)
def test_a_transition_of_the_standard_happens(number: int, before: State, word: int, after: State) -> None:
    operation = Operation(before)
    operation.command(word)
    assert operation.state is after, number


def test_no_other_word_leads_anywhere() -> None:
    allowed = {(before, word) for _, before, word, _ in TRANSITIONS} | {(READY, 0x0F)}  # 3 and 4 at once
    for before, word in itertools.product((OFF, READY, ON, ENABLED, STOPPED), (0x00, 0x02, 0x06, 0x07, 0x0F, 0x80)):
        if (before, word) not in allowed:
            operation = Operation(before)
            operation.command(word)
            assert operation.state is before, (before, word)


@pytest.mark.parametrize("word", range(256))
def test_a_word_is_one_command_by_its_bits_alone(word: int) -> None:
    command = command_of(word)
    assert command is command_of(word | 0xFF00)
    if word & 0x80:
        assert command is Command.FAULT_RESET
    elif not word & 0x02:
        assert command is Command.DISABLE_VOLTAGE
    elif not word & 0x04:
        assert command is Command.QUICK_STOP
    elif not word & 0x01:
        assert command is Command.SHUTDOWN
    else:
        assert command is (Command.ENABLE_OPERATION if word & 0x08 else Command.SWITCH_ON)


def test_a_status_word_tells_its_state_whatever_its_other_bits_are() -> None:
    for state in State:
        assert state_of(state.bits) is state
        assert state_of(state.bits | 0xFF90) is state
    assert str(ENABLED) == "operation enabled"
    assert state_of(0x0006) is None


def test_a_fault_is_reset_by_the_rising_edge_of_its_bit_alone() -> None:
    operation = Operation(ENABLED)
    operation.command(0x8F)
    operation.fault(OVERCURRENT)
    operation.command(0x8F)  # the bit was set before already
    assert (operation.state, operation.error_code) == (FAULT, OVERCURRENT)
    operation.command(0x0F)
    assert operation.state is FAULT
    operation.command(0x80)
    assert (operation.state, operation.error_code) == (OFF, 0)


def test_the_first_cause_of_a_fault_stands() -> None:
    operation = Operation(ENABLED)
    operation.fault(OVERCURRENT)
    operation.fault(COMMUNICATION)
    assert operation.error_code == OVERCURRENT


def test_an_error_code_has_a_text_and_a_register_by_its_kind() -> None:
    codes = (0, OVERCURRENT, OVERTEMPERATURE_MOTOR, COMMUNICATION, OVERVOLTAGE, UNDERVOLTAGE, SPEED_ERROR, 0x6100)
    assert codes == (0, 0x2310, 0x4210, 0x8130, 0x3210, 0x3220, 0x8400, 0x6100)
    assert [error_register(code) for code in codes] == [0x00, 0x03, 0x09, 0x11, 0x05, 0x05, 0x21, 0x81]
    assert [error_register(code) for code in (0x8210, 0x82FF, 0x8300, 0x8611, 0x8700)] == [0x11, 0x11, 0x21, 0x21, 0x11]
    assert error_text(OVERCURRENT) == "overcurrent"
    assert len({error_text(code) for code in codes[1:-1]}) == 6
    assert error_text(0x9999) == "unknown error"


def test_a_drive_goes_through_its_states_and_its_bridge_is_on_in_one_of_them() -> None:
    drive = VirtualDrive(scenario(enabled=False))
    drive.run(200)
    for word, state in ((0x06, READY), (0x07, ON), (0x0F, ENABLED), (0x02, STOPPED), (0x00, OFF)):
        commanded(drive, word)
        assert told(drive) is state
        assert np.isnan(drive.record(5)["u_q"]).all() == (state is not ENABLED)


def test_without_a_bridge_no_current_flows_and_the_stream_says_that_the_voltage_is_not_known() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(500)
    commanded(drive, 0x00)
    drive.run(500)
    rows = drive.run(500)
    assert np.abs(rows.i_q).max() < 0.1
    assert np.isnan(rows.u_d).all()
    assert np.isnan(rows.u_q).all()
    commanded(drive, 0x06, 0x07, 0x0F)
    drive.run(100)
    rows = drive.run(1000)
    assert np.isfinite(rows.u_q).all()
    assert np.ptp(rows.i_q) > 1.0


def test_a_current_beyond_the_limit_trips_the_drive_within_the_period() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(500)
    drive.write("n_p", 8)  # the current control turns into a wrong frame
    drive.write("i_q_ref", 9.0)
    drive.run(2000)
    assert told(drive) is FAULT
    assert drive.read("error_code") == OVERCURRENT
    drive.write("n_p", PAPER.motor.n_p)
    drive.write("i_q_ref", 2.0)
    drive.run(100)
    commanded(drive, 0x80, 0x06, 0x07, 0x0F)
    assert told(drive) is ENABLED
    drive.run(2000)
    assert told(drive) is ENABLED
    assert drive.read("error_code") == 0


def test_a_winding_that_is_too_hot_trips_the_drive_until_it_has_cooled_down() -> None:
    drive = VirtualDrive(scenario(temperature_trip=60.0))
    drive.set_temperature(61.0)
    drive.run(10)
    assert (told(drive), drive.read("error_code")) == (FAULT, OVERTEMPERATURE_MOTOR)
    commanded(drive, 0x80, 0x06, 0x0F)
    assert (told(drive), drive.read("error_code")) == (FAULT, OVERTEMPERATURE_MOTOR)
    drive.set_temperature(50.0)
    commanded(drive, 0x00, 0x80, 0x06, 0x0F)
    assert (told(drive), drive.read("error_code")) == (ENABLED, 0)


@pytest.mark.parametrize(
    ("u_dc", "code"), [(372.1, OVERVOLTAGE), (371.9, 0), (186.1, 0), (185.9, UNDERVOLTAGE)]
)
def test_a_dc_link_beyond_its_limits_trips_the_drive_whenever_its_bridge_is_on(u_dc: float, code: int) -> None:
    drive = VirtualDrive(scenario(u_dc=u_dc))
    assert (drive.read("overvoltage_trip"), drive.read("undervoltage_trip")) == pytest.approx((372.0, 186.0))
    drive.run(1)
    assert (told(drive), drive.read("error_code")) == (FAULT if code else ENABLED, code)
    assert np.isnan(drive.record(3)["u_q"]).all() == bool(code)
    commanded(drive, 0x00, 0x80)
    drive.run(10)
    assert (told(drive), drive.read("error_code")) == (OFF, 0)  # the bridge is off: nothing to protect
    commanded(drive, 0x06, 0x0F)
    assert (told(drive), drive.read("error_code")) == (FAULT if code else ENABLED, code)


def test_the_dc_link_is_watched_by_what_is_measured_of_it() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(10)
    firmware, trips = drive._state.firmware, list[tuple[bool, int]]()
    for u_dc in (310.0, 373.0, 310.0):
        firmware = computed(drive._fixed, drive._settings, firmware, drive._state.sample, u_dc, 0.0)
        trips.append((firmware.powered, firmware.trip))
    assert trips == [(True, 0), (False, 2), (False, 2)]  # it stays off when the voltage is back


def test_limits_of_the_dc_link_that_leave_no_room_are_refused_and_none_is_a_choice() -> None:
    with pytest.raises(ScenarioError, match=r"overvoltage_trip takes above drive\.undervoltage_trip = 186 V, got 100"):
        check(scenario(overvoltage_trip=100.0))
    drive = VirtualDrive(scenario(u_dc=900.0, overvoltage_trip=0.0))
    drive.run(100)
    assert told(drive) is ENABLED


def following(load: float, **drive: object) -> VirtualDrive:
    """A free shaft under speed control, with a load (Nm) that the drive can hold up to 8.6 Nm."""
    run = Run(shaft="free", speed_rpm=600.0, speed_control=True, tau_L=load)
    return VirtualDrive(replace(scenario(**drive), run=run, excitation=Excitation()))


def test_a_speed_that_does_not_follow_trips_the_drive_after_its_time_and_not_before() -> None:
    drive = following(12.0, speed_error_trip=50.0, speed_error_time=0.02)
    r = drive.record(2000)
    lost = int(np.argmax(np.abs(r["omega_e"] - r["omega_e"][0]) > 50.0))
    off = int(np.argmax(np.isnan(r["u_q"])))
    assert off - lost == pytest.approx(200, abs=25)  # periods; the filter of the speed is some late
    assert (told(drive), drive.read("error_code")) == (FAULT, SPEED_ERROR)


def test_a_load_that_the_drive_can_hold_is_none_of_its_following_error() -> None:
    drive = following(2.0, speed_error_trip=50.0, speed_error_time=0.15)
    r = drive.record(5000)
    assert np.abs(r["omega_e"] - r["omega_e"][-1]).max() > 50.0  # for a while
    assert told(drive) is ENABLED
    drive.write("speed_error_time", 0.01)
    drive.write("speed_error_trip", 0.0)
    drive.write("speed_control", 1.0)
    drive.write("speed_ramp", 0.0)
    drive.write("speed_ref", -200.0)
    drive.run(5000)
    assert told(drive) is ENABLED  # 0: never
    drive.write("speed_error_trip", 50.0)
    drive.write("speed_ref", 200.0)
    drive.run(5000)
    assert (told(drive), drive.read("error_code")) == (FAULT, SPEED_ERROR)
    commanded(drive, 0x80, 0x06, 0x0F)
    assert told(drive) is ENABLED


def test_a_following_error_counts_under_speed_control_alone() -> None:
    drive = VirtualDrive(scenario(speed_error_trip=1.0, speed_error_time=0.0))
    drive.run(2000)
    assert told(drive) is ENABLED
    drive.write("speed_control", 1.0)  # its shaft is held by a dynamometer
    drive.write("speed_ref", 0.0)
    drive.run(200)
    assert (told(drive), drive.read("error_code")) == (FAULT, SPEED_ERROR)


def test_a_bench_that_falls_silent_for_the_watchdogs_time_leaves_the_bridge_off() -> None:
    drive = VirtualDrive(PAPER)
    drive.write("watchdog_time", 0.05)
    for _ in range(20):
        drive.hear()
        drive.run(100)
        assert told(drive) is ENABLED
    drive.run(499)
    assert told(drive) is ENABLED
    drive.run(2)
    assert (told(drive), drive.read("error_code")) == (FAULT, COMMUNICATION)


def test_a_watchdog_of_zero_never_bites_and_none_bites_while_the_bridge_is_off() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(20_000)
    assert told(drive) is ENABLED
    drive.write("watchdog_time", 0.01)
    commanded(drive, 0x00)
    drive.run(1000)
    assert told(drive) is OFF
    commanded(drive, 0x06, 0x0F)  # its time counts from here
    assert told(drive) is ENABLED


def test_a_reset_is_like_a_power_cycle() -> None:
    drive = VirtualDrive(PAPER)
    drive.write("bandwidth", 900.0)
    drive.write("store", 0x65766173)
    drive.write("i_q_ref", 1.0)
    commanded(drive, 0x00)
    drive.run(1234)
    drive.reset()
    rows = drive.run(100)
    assert drive.tick == 100
    assert np.all((rows.row_tick >= 0) & (rows.row_tick < 100))
    assert told(drive) is ENABLED
    assert (drive.read("bandwidth"), drive.read("i_q_ref")) == (900.0, 2.0)


def test_restored_parameters_come_with_the_next_reset() -> None:
    drive = VirtualDrive(PAPER)
    drive.write("bandwidth", 900.0)
    drive.write("store", 0x65766173)
    drive.run(1000)
    drive.write("restore", 0x64616F6C)
    drive.run(1000)
    assert drive.read("bandwidth") == 900.0
    drive.reset()
    drive.run(1)
    assert drive.read("bandwidth") == PAPER.drive.bandwidth


def test_a_winding_that_heats_up_within_one_recording_ends_operation_near_the_limit() -> None:
    effects = NONE._replace(thermal=Thermal(C_w=2.0, C_m=20.0, C_h=50.0))
    drive = VirtualDrive(replace(PAPER, effects=effects, excitation=Excitation(i_q_ref=12.0)))
    recording = drive.record(60_000)
    assert drive.read("error_code") == OVERTEMPERATURE_MOTOR
    off = int(np.argmax(np.isnan(recording["u_q"])))
    assert 0 < off < 60_000
    # The limit is 155 degC, and within a tenth of a second the losses add no more than this
    hottest = 155.0 + 0.1 * 1.5 * 0.9664 * (1.0 + 0.00393 * (155.0 - 23.4)) * 12.0**2 / 2.0
    until = VirtualDrive(replace(PAPER, effects=effects, excitation=Excitation(i_q_ref=12.0)))
    until.record(off)
    assert 155.0 < until.truth.temp_winding < hottest


def test_a_temperature_that_is_set_is_that_of_all_nodes_where_losses_heat_them() -> None:
    drive = VirtualDrive(replace(PAPER, effects=NONE._replace(thermal=Thermal(C_w=2.0))))
    drive.set_temperature(60.0)
    drive.run(1)
    assert drive.truth.temp_winding == pytest.approx(60.0, abs=0.01)
    assert drive.truth.temp_magnet == pytest.approx(60.0, abs=0.01)
    assert drive.truth.R_s == pytest.approx(PAPER.motor.R_s * (1.0 + 0.00393 * (60.0 - 23.4)), rel=1e-4)
