"""The drive's own recorder, from the bench: set up, triggered, uploaded, and the upload resumed after a lost link."""

from collections.abc import Iterator

import numpy as np
import pytest

from drivers import capture
from drivers.capture import Setup
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, GoneError, NoReplyError, RefusedError
from drivers.wire.codec import count_size
from drivers.wire.dictionary import signal_named
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from tests.conftest import bus_url, free_port
from tests.support.relay import Relay, relayed
from tests.support.served_drive import Served, served, until

pytestmark = pytest.mark.live

FULL = {"i_full": PAPER.drive.i_full, "u_full": PAPER.drive.u_full, "omega_full": PAPER.drive.omega_full}
LEVEL = 2730.5 * FULL["i_full"] / 32768.0  # A, between two counts: crossed by the drive, and in the recording


@pytest.fixture(scope="module")
def bench() -> Iterator[Served]:
    with served(bus_url(free_port())) as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[Drive]:
    with connect(bench.url) as connected:
        yield connected


def recorded(drive: Drive, setup: Setup) -> capture.Upload:
    capture.arm(drive, setup)
    return capture.awaited(drive, setup, 10.0)


def check_by_twin(got: capture.Capture) -> None:
    """Every column is what a twin of the drive has at those ticks, within half a count."""
    n = len(got.t)
    twin = VirtualDrive(PAPER)
    twin.run(got.tick)
    whole = twin.record(n * got.decimation)
    for name, column in got.columns.items():
        off = column - whole[name][:: got.decimation]
        if name == "theta_e":
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
        assert np.abs(off).max() <= 0.5 * count_size(signal_named(name), FULL) * 1.001, name
    assert got.t == pytest.approx(whole["t"][:: got.decimation])


def test_a_recording_is_what_the_drive_did_within_half_a_count(drive: Drive) -> None:
    setup = Setup(("theta_e", "i_d", "i_q", "u_d", "u_q", "omega_e"), length=1000, decimation=3)
    got = capture.upload(drive, recorded(drive, setup))
    assert [len(column) for column in got.columns.values()] == [1000] * 6
    check_by_twin(got)


def test_a_trigger_is_awaited_with_what_was_before_it(drive: Drive) -> None:
    setup = Setup(("i_q",), length=300, pre=100, trigger="i_q", level=LEVEL, edge=-1)
    got = capture.upload(drive, recorded(drive, setup))
    i_q = got.columns["i_q"]
    assert i_q[100] <= LEVEL < i_q[99]
    check_by_twin(got)


def test_a_trigger_that_never_comes_is_told_and_a_command_takes_its_place(drive: Drive) -> None:
    setup = Setup(("i_q",), length=50, trigger="i_q", level=100.0)
    capture.arm(drive, setup)
    with pytest.raises(NoReplyError, match=r"no recording within 0.05 s: the trigger has not come"):
        capture.awaited(drive, setup, 0.05)
    capture.trigger(drive)
    assert capture.awaited(drive, setup, 10.0).count == 50


def test_an_upload_tells_how_far_it_is(drive: Drive) -> None:
    told = list[int]()
    under_way = recorded(drive, Setup(("i_d", "i_q"), length=10_000))
    capture.upload(drive, under_way, told.append)
    assert told == [4096, 8192, 10_000]


@pytest.fixture
def line(bench: Served) -> Iterator[Relay]:
    with relayed(int(bench.url.split(":")[2].split("/")[0])) as relay:
        yield relay


def test_an_upload_goes_on_where_it_was_when_the_link_was_lost(bench: Served, line: Relay) -> None:
    setup = Setup(("theta_e", "i_q"), length=10_000)
    url = bus_url(line.port)
    with connect(url) as first:
        under_way = recorded(first, setup)

        def cut(_done: int) -> None:
            line.cut()

        with pytest.raises(DriveError):
            capture.upload(first, under_way, cut)
    assert under_way.done == 4096
    line.mend()
    told = list[int]()
    with connect(url) as again:
        got = capture.upload(again, under_way, told.append)
    assert told == [8192, 10_000]
    check_by_twin(got)


def test_a_recording_that_another_has_replaced_is_not_mixed_with_it(drive: Drive) -> None:
    setup = Setup(("i_q",), length=5000)
    under_way = recorded(drive, setup)
    pieces = drive.captured(0, 5000)
    under_way.data += next(pieces)
    recorded(drive, setup)
    with pytest.raises(RefusedError, match=rf"the drive no longer has recording {under_way.number} of tick"):
        capture.upload(drive, under_way)


def test_a_recording_of_another_is_not_taken_for_ours(bench: Served, drive: Drive) -> None:
    setup = Setup(("i_q",), length=50)
    since = int(drive.read("tick"))
    number = capture.arm(drive, setup)
    ours = capture.awaited(drive, setup, 10.0)
    capture.check_ours(drive, ours, number, since)
    for name in ("capture_length", "capture_channel_1"):  # the same number, but of another set-up
        drive.write(name, 7.0)
        with pytest.raises(GoneError, match=rf"no longer has recording {number}, armed at tick {since}"):
            capture.check_ours(drive, ours, number, since)
        drive.write("capture_length", 50.0)
    recorded(drive, setup)
    with pytest.raises(GoneError, match=rf"it has {number + 1} of tick"):
        capture.check_ours(drive, capture.found(drive, setup), number, since)
    resets = bench.drive.resets
    bench.drive.reset()
    until(lambda: bench.drive.resets > resets, "it does not reset")
    for _ in range(number):  # the numbers begin anew, and so does the tick
        recorded(drive, setup)
    theirs = capture.found(drive, setup)
    assert theirs.number == number
    with pytest.raises(GoneError, match=rf"it has {number} of tick {theirs.tick}"):
        capture.check_ours(drive, theirs, number, since + 1_000_000)


def test_a_recording_does_not_outlive_a_reset_of_the_drive(bench: Served, drive: Drive) -> None:
    under_way = recorded(drive, Setup(("i_q",), length=10))
    resets = bench.drive.resets
    bench.drive.reset()
    until(lambda: bench.drive.resets > resets, "it does not reset")
    with pytest.raises(RefusedError, match=r"it has 0 of tick 0"):
        capture.upload(drive, under_way)


@pytest.mark.parametrize(
    ("setup", "sentence"),
    [
        ({"channels": ("torque",), "length": 1}, "expected a channel out of .*, got 'torque'"),
        ({"channels": (), "length": 1}, "expected 1 to 8 different channels, got "),
        ({"channels": ("i_d", "i_d"), "length": 1}, "expected 1 to 8 different channels, got i_d, i_d"),
        ({"channels": ("i_d",), "length": 65_537}, "expected a length of 1 to 65536 samples, got 65537"),
        ({"channels": ("i_d",), "length": 9, "decimation": 0}, "expected a decimation of 1 to 1000 .*, got 0"),
        ({"channels": ("i_d",), "length": 9, "pre": 9}, "expected 0 to 8 samples before the trigger, got 9"),
        ({"channels": ("i_d",), "length": 9, "edge": 2}, "expected an edge of 1, -1 or 0, got 2"),
        ({"channels": ("i_d",), "length": 9, "trigger": "x"}, "expected a channel out of .*, got 'x'"),
    ],
)
def test_a_set_up_that_no_drive_could_do_is_refused(setup: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Setup(**setup)  # pyright: ignore[reportArgumentType]
