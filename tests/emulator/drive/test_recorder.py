"""The drive's recorder: exactly the samples asked for, compared with all that a twin of the same seed records."""

import numpy as np
import pytest

from drivers.wire.codec import si_to_counts
from drivers.wire.dictionary import CHANNELS
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER

IDLE, ARMED, TRIGGERED, DONE = 0, 1, 2, 3
STOP, ARM, TRIGGER = 0, 1, 2
FULL = {"i_full": PAPER.drive.i_full, "u_full": PAPER.drive.u_full, "omega_full": PAPER.drive.omega_full}
TWIN = VirtualDrive(PAPER).record(12_000)
"""Every period of a drive from its reset on, made without a recorder."""


def armed(channels: tuple[str, ...], trigger: str = "none", **settings: float) -> VirtualDrive:
    """A drive at tick 0 whose recorder is armed."""
    drive = VirtualDrive(PAPER)
    for k, name in enumerate(channels, 1):
        drive.write(f"capture_channel_{k}", CHANNELS.index(name))
    drive.write("trigger_channel", CHANNELS.index(trigger))
    for name, value in settings.items():
        drive.write(name, value)
    drive.write("capture_command", ARM)
    return drive


def expected(channels: tuple[str, ...], first: int, length: int, decimation: int = 1) -> np.ndarray:
    """The counts of a recording from a tick on, out of the twin's."""
    rows = slice(first, first + length * decimation, decimation)
    return si_to_counts([TWIN[name][rows] for name in channels], channels, FULL)


def recorded(drive: VirtualDrive, channels: int) -> np.ndarray:
    return np.frombuffer(drive.captured(0, 65536), "<i2").reshape(-1, channels)


def crossing(name: str, level: float, edge: int, start: int = 1) -> int:
    """The first tick from `start` on at which a channel has crossed a level, by the plain definition."""
    x = TWIN[name]
    for k in range(start, len(x)):
        up, down = x[k - 1] <= level < x[k], x[k] <= level < x[k - 1]
        if (up and edge >= 0) or (down and edge <= 0):
            return k
    raise AssertionError("it never crosses")


def run_until_done(drive: VirtualDrive, burst: int = 37) -> None:
    for _ in range(12_000 // burst):
        drive.run(burst)
        if drive.read("capture_state") == DONE:
            return
    raise AssertionError("it is never done")


@pytest.mark.parametrize("decimation", [1, 3, 10])
def test_a_command_triggers_and_the_samples_are_the_twins(decimation: int) -> None:
    channels = ("i_d", "u_q", "theta_e", "i_b")
    drive = armed(channels, capture_length=500, capture_decimation=decimation)
    drive.run(101)
    assert (drive.read("capture_state"), drive.read("capture_count")) == (ARMED, 0)
    assert drive.captured(0, 65536) == b""
    drive.write("capture_command", TRIGGER)
    run_until_done(drive)
    first = int(drive.read("capture_tick"))
    assert first == -(-101 // decimation) * decimation  # whole multiples of the decimation
    assert drive.read("capture_count") == 500
    assert np.array_equal(recorded(drive, 4), expected(channels, first, 500, decimation))


@pytest.mark.parametrize("edge", [1, -1, 0])
@pytest.mark.parametrize("pre", [0, 1, 250])
def test_a_level_crossed_triggers_with_so_many_samples_before_it(edge: int, pre: int) -> None:
    drive = armed(("i_q", "i_d"), "i_q", trigger_level=2.1, trigger_edge=edge, capture_length=400, capture_pre=pre)
    run_until_done(drive)
    at = crossing("i_q", 2.1, edge, start=max(1, pre))
    assert drive.read("capture_tick") == at - pre
    assert np.array_equal(recorded(drive, 2), expected(("i_q", "i_d"), at - pre, 400))


def test_a_trigger_counts_samples_not_periods_where_they_are_decimated() -> None:
    drive = armed(("i_q",), "i_q", trigger_level=2.1, capture_length=100, capture_pre=40, capture_decimation=7)
    run_until_done(drive)
    first = int(drive.read("capture_tick"))
    assert first % 7 == 0
    level = TWIN["i_q"][::7]
    at = next(k for k in range(40, 1000) if level[k - 1] <= 2.1 < level[k])
    assert first == 7 * (at - 40)
    assert np.array_equal(recorded(drive, 1), expected(("i_q",), first, 100, 7))


@pytest.mark.parametrize("burst", [1, 10, 997])
def test_the_recording_does_not_care_how_time_is_cut(burst: int) -> None:
    drive = armed(("theta_e",), "i_d", trigger_level=-1.0, trigger_edge=-1, capture_length=300, capture_pre=77)
    run_until_done(drive, burst)
    at = crossing("i_d", -1.0, -1, start=77)
    assert np.array_equal(recorded(drive, 1), expected(("theta_e",), at - 77, 300))


def test_what_was_long_ago_is_dropped_while_the_trigger_is_awaited() -> None:
    drive = armed(("i_a",), capture_length=200, capture_pre=100)
    drive.run(9_900)
    drive.write("capture_command", TRIGGER)
    drive.run(300)
    assert drive.read("capture_tick") == 9_800
    assert np.array_equal(recorded(drive, 1), expected(("i_a",), 9_800, 200))


def test_a_part_of_the_recording_is_what_stands_there() -> None:
    drive = armed(("i_d", "i_q"), capture_length=1000)
    drive.write("capture_command", TRIGGER)
    run_until_done(drive)
    whole = drive.captured(0, 65536)
    assert len(whole) == 4000
    assert drive.captured(10, 3) == whole[40:52]
    assert drive.captured(998, 100) == whole[-8:]
    assert drive.captured(1000, 1) == b""


def test_a_recording_that_is_stopped_keeps_what_it_has_and_another_arming_is_another_recording() -> None:
    drive = armed(("i_q",), capture_length=5000)
    drive.write("capture_command", TRIGGER)
    drive.run(600)
    assert (drive.read("capture_state"), drive.read("capture_number")) == (TRIGGERED, 1)
    drive.write("capture_command", STOP)
    drive.run(100)
    assert (drive.read("capture_state"), drive.read("capture_count")) == (DONE, 600)
    assert np.array_equal(recorded(drive, 1), expected(("i_q",), 0, 600))
    drive.write("capture_command", ARM)
    drive.run(100)
    assert (drive.read("capture_state"), drive.read("capture_number")) == (ARMED, 2)
    drive.write("capture_command", STOP)
    drive.run(1)
    assert drive.read("capture_state") == IDLE


def test_the_recorder_disturbs_neither_the_drive_nor_its_stream() -> None:
    plain, drive = VirtualDrive(PAPER), armed(("i_q",), capture_length=100)
    drive.write("capture_command", TRIGGER)
    for _ in range(10):
        one, other = plain.run(77), drive.run(77)
        assert np.array_equal(one.row_tick, other.row_tick)
        assert np.array_equal(one.i_q_mean, other.i_q_mean)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"capture_channel_1": 0.0}, "the recorder needs a channel, got none"),
        ({"capture_pre": 10.0}, "capture_pre takes less than capture_length, 10, got 10"),
    ],
)
def test_a_set_up_that_cannot_be_is_refused_when_it_is_armed(settings: dict[str, float], sentence: str) -> None:
    drive = VirtualDrive(PAPER)
    for name, value in {"capture_channel_1": 2.0, "capture_length": 10.0, **settings}.items():
        drive.write(name, value)
    with pytest.raises(ValueError, match=sentence):
        drive.write("capture_command", ARM)


def test_the_voltage_of_a_bridge_that_is_off_is_recorded_as_not_known() -> None:
    drive = armed(("u_q", "i_q"), capture_length=50)
    drive.write("control_word", 0x00)
    drive.run(1)
    drive.write("capture_command", TRIGGER)
    run_until_done(drive)
    assert np.all(recorded(drive, 2)[:, 0] == -32768)
    assert np.all(recorded(drive, 2)[:, 1] != -32768)
