"""The virtual drive as its clients see it: rows, recordings, determinism, reads and writes."""

import math
import threading
from dataclasses import fields, replace

import numpy as np
import pytest

from drivers.wire.cia402 import Command, State, state_of
from drivers.wire.dictionary import SIGNALS, WireType
from emulator.drive import stream
from emulator.drive.simulation import RECORDED
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.frames import clarke
from emulator.scenario.scenarios import PAPER, Excitation, Run


def joined(parts: list[StreamRows]) -> dict[str, np.ndarray]:
    return {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(StreamRows)}


def test_a_run_gives_the_same_bits_however_it_is_cut() -> None:
    whole = joined([VirtualDrive(PAPER).run(2000)])
    drive, parts, left = VirtualDrive(PAPER), list[StreamRows](), 2000
    for n in (1, 0, 7, 13, 100, 3, 999, 2, 875):
        parts.append(drive.run(n))
        left -= n
    assert left == 0
    pieces = joined(parts)
    for name, column in whole.items():
        assert np.array_equal(column, pieces[name]), name


def test_another_seed_gives_other_noise_and_other_steps() -> None:
    one = VirtualDrive(PAPER).run(2000)
    other = VirtualDrive(replace(PAPER, run=replace(PAPER.run, seed=2))).run(2000)
    assert not np.any(one.i_d == other.i_d)
    assert np.abs(one.i_q - other.i_q).max() > 1.0


@pytest.mark.parametrize("run", [PAPER.run, Run(speed_rpm=-500.0, rise_rpm=900.0, ramp_time=0.1, swing_rpm=50.0)])
def test_stream_rows_are_the_aggregate_of_the_recording(run: Run) -> None:
    scenario, N = replace(PAPER, run=run), PAPER.drive.stream_periods
    rows = VirtualDrive(scenario).run(2000)
    r = VirtualDrive(scenario).record(2001)
    n = len(rows)
    assert n == 2000 // N
    start = np.arange(n) * N

    def mean(x: np.ndarray) -> np.ndarray:
        return x[: n * N].reshape(n, N).mean(axis=1)

    turn = np.diff(np.unwrap(r["theta_e"]))
    assert np.array_equal(rows.row_tick, start)
    assert np.array_equal(rows.theta_e, r["theta_e"][start])
    for axis in ("d", "q"):
        i = r[f"i_{axis}"]
        assert np.array_equal(getattr(rows, f"i_{axis}"), i[start])
        assert getattr(rows, f"i_{axis}_mean") == pytest.approx(mean((i[:-1] + i[1:]) / 2.0), abs=1e-12)
        assert getattr(rows, f"u_{axis}") == pytest.approx(mean(r[f"u_{axis}"]), abs=1e-11)
    assert rows.omega_e == pytest.approx(mean(turn) / 1e-4, abs=1e-7)
    assert np.all(rows.u_dc == 310.0)


def test_a_recording_has_the_columns_of_the_bench_and_one_row_a_period() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(17)
    r = drive.record(50)
    assert tuple(r) == RECORDED == ("t", "u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e", "u_dc", "i_a", "i_b", "i_c")
    assert r["t"] == pytest.approx(np.arange(17, 67) * 1e-4)
    assert drive.tick == 67
    i_ab = np.array([clarke(*x) for x in zip(r["i_a"], r["i_b"], r["i_c"], strict=True)])
    assert r["i_d"] + 1j * r["i_q"] == pytest.approx(i_ab * np.exp(-1j * r["theta_e"]), abs=1e-12)
    step = 2.0 * PAPER.drive.adc_full / 2**12
    assert r["i_a"] / step == pytest.approx(np.round(r["i_a"] / step), abs=1e-6)


def test_a_row_is_complete_only_with_the_sample_after_it() -> None:
    drive = VirtualDrive(PAPER)
    assert len(drive.run(9)) == 0
    rows = drive.run(1)
    assert rows.row_tick.tolist() == [0]
    assert drive.tick == 10


def test_another_row_length_counts_from_the_next_row_on() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(13)
    drive.write("stream_periods", 5.0)
    assert drive.run(20).row_tick.tolist() == [10, 20, 25]
    drive.write("stream_periods", 1000.0)
    assert drive.run(8).row_tick.tolist() == [30]
    assert drive.run(1100).row_tick.tolist() == [35]


def test_one_second_of_the_stream_tells_all_four_parameters() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(1000)
    rows, truth = drive.run(10010), drive.truth
    # Equations of this test's own: the flux balance over a row, mean by mean, in the rotor frame. The voltage
    # stands still during each control period while the rotor turns, so the flux moves along chords
    i, theta = rows.i_d + 1j * rows.i_q, np.unwrap(rows.theta_e)
    i_mean, b = (rows.i_d_mean + 1j * rows.i_q_mean)[:-1], (rows.u_d + 1j * rows.u_q)[:-1]
    slope, omega = np.diff(i) / 1e-3, 2.0 * np.sin(np.diff(theta) / 20.0) / 1e-4
    a = np.stack([i_mean, slope.real + 1j * omega * i_mean.real, 1j * slope.imag - omega * i_mean.imag, 1j * omega])
    A = np.concatenate([a.real, a.imag], axis=1).T
    found = np.linalg.lstsq(A, np.concatenate([b.real, b.imag]), rcond=None)[0]
    assert found / [truth.R_s, truth.L_d, truth.L_q, truth.psi_f] == pytest.approx(np.ones(4), abs=1.5e-3)
    scaled = A / np.linalg.norm(A, axis=0)
    assert np.linalg.cond(scaled) < 5.0  # no parameter hides behind another


def test_temperature_moves_the_machine_from_the_next_run_on() -> None:
    drive = VirtualDrive(PAPER)
    drive.set_temperature(80.0)
    assert drive.truth.R_s == pytest.approx(0.9664)
    drive.run(0)
    assert drive.truth.R_s == pytest.approx(1.1751)
    assert drive.truth.L_q == pytest.approx(6.48e-3)
    assert drive.truth.temp_winding == drive.read("temp_winding") == drive.read("temp_magnet") == 80.0
    assert drive.read("control_R_s") == pytest.approx(0.9664)  # the drive does not know
    with pytest.raises(ValueError, match=r"the winding takes 23\.4 to 80\.0 degC, got 90"):
        drive.set_temperature(90.0)


def test_every_signal_can_be_read() -> None:
    drive = VirtualDrive(PAPER)
    for signal in SIGNALS:
        assert math.isfinite(drive.read(signal.name))
    rows = drive.run(200000)
    assert drive.read("tick") == 200000.0
    assert drive.read("row_tick") == float(199990 % 65536)
    assert drive.read("T_s") == 1e-4
    for name in stream.COLUMNS:
        assert drive.read(name) == getattr(rows, name)[-1]
    with pytest.raises(KeyError, match="the drive has no signal 'torque'"):
        drive.read("torque")


def test_before_its_first_row_a_drive_tells_what_it_measures_at_power_on() -> None:
    drive = VirtualDrive(PAPER)
    told = drive.values(stream.COLUMNS)
    first = joined([drive.run(PAPER.drive.stream_periods)])
    assert told["u_dc"] == first["u_dc"][0]
    for name in ("theta_e", "omega_e"):
        assert told[name] == pytest.approx(first[name][0], abs=0.01 * max(1.0, abs(first["omega_e"][0])))


def test_a_parameter_that_is_written_is_read_at_once_and_stays() -> None:
    drive = VirtualDrive(PAPER)
    for signal in SIGNALS:
        if signal.is_parameter:
            value = drive.read(signal.name) * 1.01 if signal.type is WireType.F32 else signal.maximum or 0.0
            others = {"overspeed_trip": 2e3, "n_p": 4.0, "stream_periods": 20.0, "watchdog_time": 0.0}
            others["current_limit"] = 9.0
            value = others.get(signal.name, value)
            drive.write(signal.name, value)
            assert drive.read(signal.name) == value
            drive.run(30)
            assert drive.read(signal.name) == value


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("i_q_ref", 12.1, r"0x2300:2 \(i_q_ref\) takes at most 12 A, the drive's current limit, got 12\.1"),
        ("i_d_ref", -50.0, r"0x2300:1 \(i_d_ref\) takes at most 12 A, the drive's current limit, got -50"),
        ("i_d_step", -1.0, r"0x2300:3 \(i_d_step\) takes at least 0\.0 A, got -1\.0"),
        ("step_time", 1e-4, r"0x2300:5 \(step_time\) takes at least 0\.001 s, got 0\.0001"),
        ("bandwidth", math.nan, r"0x2200:6 \(bandwidth\) takes a finite number, got nan"),
        ("stream_periods", 0.0, r"0x2000:4 \(stream_periods\) takes at least 1, got 0$"),
        ("stream_periods", 10.5, r"0x2000:4 \(stream_periods\) takes a whole number, got 10\.5"),
        ("i_d", 1.0, r"0x2100:3 \(i_d\) cannot be written"),
        ("T_s", 1e-3, r"0x2000:2 \(T_s\) cannot be written"),
    ],
)
def test_a_write_that_cannot_be_is_refused_and_changes_nothing(name: str, value: float, sentence: str) -> None:
    drive = VirtualDrive(PAPER)
    before = drive.read(name)
    with pytest.raises(ValueError, match=sentence):
        drive.write(name, value)
    drive.run(10)
    if name not in stream.COLUMNS:
        assert drive.read(name) == before


def test_a_current_reference_takes_effect_with_the_next_run() -> None:
    drive = VirtualDrive(replace(PAPER, excitation=Excitation()))
    drive.write("i_d_ref", -2.0)
    rows = drive.run(1000)
    assert rows.i_d_mean[-10:] == pytest.approx(-2.0, abs=0.02)


def test_reads_and_writes_from_another_thread_do_not_disturb_a_run() -> None:
    drive, stop, failures = VirtualDrive(PAPER), threading.Event(), list[Exception]()

    def serve() -> None:
        value = 0.0
        try:
            while not stop.is_set():
                value = (value + 0.5) % 3.0
                drive.write("control_psi_f", 0.12 + 1e-6 * value)
                drive.read("i_q")
                drive.read("control_psi_f")
        except ValueError as error:
            failures.append(error)

    thread = threading.Thread(target=serve)
    thread.start()
    ticks = np.concatenate([drive.run(10).row_tick for _ in range(1000)])
    stop.set()
    thread.join()
    assert not failures
    assert np.array_equal(ticks, np.arange(0, 10000, 10))


def test_a_drive_that_goes_on_says_so_before_its_step_is_over() -> None:
    """Who stops it meanwhile would else be told that it is off, and see it on afterwards."""
    drive = VirtualDrive(PAPER)
    drive.write("control_word", 0.0)
    drive.run(1)
    assert state_of(int(drive.read("status_word"))) is State.SWITCH_ON_DISABLED
    for command in (Command.SHUTDOWN, Command.SWITCH_ON, Command.ENABLE_OPERATION):
        drive.write("control_word", float(command.bits))
    thread = threading.Thread(target=drive.run, args=(300_000,))
    thread.start()
    while thread.is_alive() and state_of(int(drive.read("status_word"))) is not State.OPERATION_ENABLED:
        pass
    under_way = thread.is_alive()
    thread.join()
    assert under_way


def test_warming_up_takes_no_time_of_the_drives() -> None:
    drive = VirtualDrive(PAPER)
    drive.warm_up()
    assert drive.tick == 0


def test_a_negative_number_of_periods_is_refused() -> None:
    with pytest.raises(ValueError, match="a drive runs 0 or more periods, got -1"):
        VirtualDrive(PAPER).run(-1)
