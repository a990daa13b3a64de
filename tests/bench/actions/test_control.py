"""Start, stop and renewal of a drive by the bench, where they meet and where answers are lost."""

import contextlib
import threading
import time
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.actions.control import Control
from bench.actions.safety.lease import Leases
from bench.actions.safety.limits import Limits
from bench.actions.safety.unfinished import Origin
from bench.errors import BenchError, ConflictError, LimitError
from drivers import capture, operation
from drivers.capture import Setup
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, LostError, NoReplyError, RefusedError
from drivers.lease import Controlled, HeldError, Lease
from drivers.wire.cia402 import Command, State
from drivers.wire.lease import Action, Record
from emulator.scenario.scenarios import PAPER, Scenario, parse
from tests.support.served_drive import served, until, virtual_url

pytestmark = pytest.mark.live

SET_POINTS = {"i_q_ref": 2.0}
LIMITS = Limits(10.0, None)
HEAVY = """[motor]
R_s = 0.9664
L_d = 4.24e-3
L_q = 6.21e-3
psi_f = 0.12
n_p = 4
i_rated = 6.0
J = 0.3
[run]
shaft = "free"
speed_control = true
speed_rpm = 0.0
"""


class Between:
    """A drive as the bench has it: late, and some of what it answers lost or refused."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.url = ""
        self.late = 0.0  # s, each request
        self.lost = set[str]()  # calls that are heard by the drive, and not answered
        self.refused = set[str]()  # signals

    def __getattr__(self, name: str) -> Any:
        return getattr(self._drive, name)

    def read(self, name: str) -> float:
        return self._done("read", lambda: self._drive.read(name))

    def write(self, name: str, value: float) -> None:
        if name in self.refused:
            raise RefusedError(f"no {name}", 0)
        self._done("write", lambda: self._drive.write(name, value))

    def control(self, record: Any) -> None:
        self._done("control", lambda: self._drive.control(record))

    def _done(self, what: str, do: Any) -> Any:
        time.sleep(self.late)
        found = do()
        if what in self.lost:
            raise NoReplyError(f"no answer to a {what}")
        return found


class OneLink:
    def __init__(self, drive: Between) -> None:
        self._drive, self.there = drive, True

    def drive(self) -> Any:
        if not self.there:
            raise LostError("there is no link")
        return self._drive


@contextlib.contextmanager
def controlled(
    kind: str, folder: Path, limits: Limits = LIMITS, scenario: Scenario = PAPER
) -> Generator[tuple[Control, Between, OneLink]]:
    with served(virtual_url(), scenario, control=kind) as bench, connect(bench.url) as drive:
        between = Between(drive)
        between.url = bench.url
        link = OneLink(between)
        control = Control("x", link, Leases(), limits, lambda what: Origin(folder, "x", what))
        control.begin()
        try:
            yield control, between, link
        finally:
            between.late, between.lost, between.refused = 0.0, set(), set()
            control.end()
            control.join(5.0)


@pytest.fixture(params=["lease", "watchdog"])
def one(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Control, Between, OneLink]]:
    with controlled(request.param, tmp_path) as made:
        made[0].stop("")
        yield made


@pytest.mark.parametrize("after", [0.0, 0.01, 0.03, 0.06, 0.1, 0.2])
def test_stop_while_a_start_is_under_way_leaves_the_drive_off_and_nobody_in_control(
    one: tuple[Control, Between, OneLink], after: float
) -> None:
    control, drive, _ = one
    drive.late = 0.004
    failed: list[BenchError | DriveError] = []

    def start() -> None:
        try:
            control.start(SET_POINTS, "somebody")
        except (BenchError, DriveError) as error:
            failed.append(error)

    thread = threading.Thread(target=start)
    thread.start()
    time.sleep(after)
    control.stop("another")
    thread.join()
    drive.late = 0.0
    if failed and isinstance(failed[0], ConflictError):
        assert "was stopped meanwhile" in str(failed[0])
    assert operation.state(drive) is not State.OPERATION_ENABLED  # pyright: ignore[reportArgumentType]
    assert control.whom is None
    assert drive.read("i_q_ref") == 0.0


def test_a_first_start_whose_answer_is_lost_is_given_up(one: tuple[Control, Between, OneLink]) -> None:
    control, drive, _ = one
    drive.lost = {"control", "write"}
    with pytest.raises(DriveError):
        control.start(SET_POINTS, "somebody")
    drive.lost = set()
    assert control.whom is None
    until(lambda: drive.read("i_q_ref") == 0.0 or operation.state(drive) is not State.OPERATION_ENABLED, "it is on")  # pyright: ignore[reportArgumentType]


def test_answers_lost_right_after_the_start_leave_the_drive_under_control(
    one: tuple[Control, Between, OneLink]
) -> None:
    control, drive, _ = one
    control.start(SET_POINTS, "somebody")
    drive.lost = {"read", "control"}
    time.sleep(0.3)
    drive.lost = set()
    time.sleep(0.3)
    assert operation.state(drive) is State.OPERATION_ENABLED  # pyright: ignore[reportArgumentType]
    assert control.whom == "somebody"
    control.stop("somebody")
    assert operation.state(drive) is State.SWITCH_ON_DISABLED  # pyright: ignore[reportArgumentType]


def test_stop_switches_off_before_all_else(tmp_path: Path) -> None:
    with controlled("watchdog", tmp_path) as (control, drive, _):
        control.start(SET_POINTS, "somebody")
        drive.refused = {"speed_step"}
        with pytest.raises(RefusedError):
            control.stop("somebody")
        assert operation.state(drive) is State.SWITCH_ON_DISABLED  # pyright: ignore[reportArgumentType]
        assert drive.read("i_q_ref") == 0.0
        assert control.whom is None


def test_nobody_renews_after_a_stop_that_did_not_come_to_the_drive(tmp_path: Path) -> None:
    with controlled("lease", tmp_path) as (control, drive, link):
        control.start(SET_POINTS, "somebody")
        link.there = False
        with pytest.raises(LostError):
            control.stop("somebody")
        link.there = True
        assert control.whom is None
        until(lambda: operation.state(drive) is not State.OPERATION_ENABLED, "nobody renews, and it stays on")  # pyright: ignore[reportArgumentType]


def test_no_drive_is_started_by_its_control_word_alone(one: tuple[Control, Between, OneLink]) -> None:
    control, drive, _ = one
    with pytest.raises(ConflictError, match="pmsm-bench start x"):
        control.write(drive, {"control_word": 15.0}, lambda values: None)  # pyright: ignore[reportArgumentType]


def plainly(control: Control, drive: Between, **values: float) -> None:
    """As `PUT .../signals` writes."""

    def one_by_one(left: Any) -> None:
        for name, value in left.items():
            drive.write(name, value)

    control.write(drive, values, one_by_one)  # pyright: ignore[reportArgumentType]


def test_started_again_it_has_the_set_points_that_were_given_alone(one: tuple[Control, Between, OneLink]) -> None:
    control, drive, _ = one
    control.start({"i_q_ref": 2.0, "i_d_step": 1.0}, "")
    control.start({"i_q_ref": 1.0}, "")
    assert (drive.read("i_q_ref"), drive.read("i_d_step")) == (1.0, 0.0)


@pytest.mark.parametrize("word", [Command.DISABLE_VOLTAGE, Command.SHUTDOWN, Command.SWITCH_ON])
def test_control_ends_where_a_control_word_switches_the_bridge_off(
    one: tuple[Control, Between, OneLink], word: Command
) -> None:
    control, drive, _ = one
    control.start(SET_POINTS, "")
    plainly(control, drive, control_word=float(word.bits))
    assert control.whom is None
    assert control.said == f"control_word = {word.bits} switched it off"
    assert operation.state(drive) is not State.OPERATION_ENABLED  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConflictError):
        plainly(control, drive, control_word=float(Command.ENABLE_OPERATION.bits))
    if drive.identity.has_lease:
        with pytest.raises(ConflictError, match="set points hold only while the drive is controlled"):
            plainly(control, drive, i_q_ref=2.5)


def test_control_ends_where_the_drive_goes_off_by_itself_and_why_is_said(
    one: tuple[Control, Between, OneLink], capfd: pytest.CaptureFixture[str]
) -> None:
    control, drive, _ = one
    control.start({}, "")
    if drive.identity.has_lease:
        plainly(control, drive, overspeed_trip=1.0)
    else:
        drive.write("control_word", 0.0)  # of another client
    until(lambda: control.whom is None, "control to end")
    why = "overspeed (0x8481)" if drive.identity.has_lease else "it is switch on disabled"
    begins = "the drive went off by itself at 20" if drive.identity.has_lease else "the drive was stopped by another"
    assert control.said.startswith(begins)
    assert control.said.endswith(f"Z: {why}")
    heard = list[str]()
    until(lambda: control.said in (heard.append(capfd.readouterr().err) or "".join(heard)), "it is told on the console")
    time.sleep(0.3)
    assert control.whom is None


def test_what_another_bench_controls_is_not_written_to_and_that_bench_is_named(tmp_path: Path) -> None:
    with controlled("lease", tmp_path) as (control, drive, _), Controlled(drive, Lease("other@bench:1")) as other:  # pyright: ignore[reportArgumentType]
        other.start(i_q_ref=1.0)
        both = {"control_word": 0.0, "i_q_ref": 0.0}
        for values in ({"i_q_ref": 2.0}, {"field_weakening": 1.0}, {"control_word": 15.0}, both):
            with pytest.raises(ConflictError, match=r"'other@bench:1' controls the drive for .* more, unless renewed"):
                plainly(control, drive, **values)
        assert drive.read("i_q_ref") == 1.0
        plainly(control, drive, control_word=0.0)  # stops, and that is anybody's
        until(lambda: control.state is not None and control.state.state is State.SWITCH_ON_DISABLED, "it is on")


def test_a_look_never_shows_who_controlled_a_drive_before_its_state_changed(tmp_path: Path) -> None:
    with controlled("lease", tmp_path) as (control, _, _):
        for _ in range(5):
            control.start(SET_POINTS, "")
            for _ in range(30):
                now = control.state
                assert now is not None and (now.state, now.held is None) == (State.OPERATION_ENABLED, False)
                time.sleep(0.01)
            control.stop("")
            for _ in range(30):
                now = control.state
                assert now is not None and (now.state, now.held) == (State.SWITCH_ON_DISABLED, None)
                time.sleep(0.01)


def test_a_start_that_another_bench_keeps_out_leaves_that_ones_motor_alone(
    one: tuple[Control, Between, OneLink], tmp_path: Path
) -> None:
    control, drive, link = one
    control.start(SET_POINTS, "")
    second = Control("x", link, Leases(), LIMITS, lambda what: Origin(tmp_path, "x", what))
    with pytest.raises((ConflictError, HeldError), match=r"controls the drive|another bench on this machine"):
        second.start({}, "")
    time.sleep(0.3)
    assert (control.whom, drive.read("i_q_ref")) == ("", 2.0)
    assert operation.state(drive) is State.OPERATION_ENABLED  # pyright: ignore[reportArgumentType]


def test_a_first_start_runs_with_what_was_given_alone(one: tuple[Control, Between, OneLink]) -> None:
    control, drive, _ = one
    if not drive.identity.has_lease:
        drive.write("i_q_ref", 3.0)  # which such a drive keeps while it is off
    control.start({"i_d_ref": 1.0}, "")
    assert (drive.read("i_d_ref"), drive.read("i_q_ref")) == (1.0, 0.0)


def test_a_reset_of_faults_by_control_word_ends_no_control(one: tuple[Control, Between, OneLink]) -> None:
    control, drive, _ = one
    control.start({}, "somebody")
    plainly(control, drive, control_word=float(Command.FAULT_RESET.bits | Command.ENABLE_OPERATION.bits))
    assert control.whom == "somebody"


def test_control_goes_on_where_nobody_hears_what_the_service_says(
    one: tuple[Control, Between, OneLink], monkeypatch: pytest.MonkeyPatch
) -> None:
    control, drive, _ = one

    def broken(line: str) -> None:
        if "control ended" in line:
            raise BrokenPipeError

    control.start({}, "")
    monkeypatch.setattr("bench.actions.control.to_standard_error", broken)
    drive.write("control_word", 0.0)  # of another client
    until(lambda: control.whom is None, "control to end")
    monkeypatch.undo()
    until(lambda: control.state is not None and control.state.state is State.SWITCH_ON_DISABLED, "a look")
    assert control.thread.is_alive()


def test_control_lasts_while_another_client_uploads_recordings(tmp_path: Path) -> None:
    setup = Setup(("u_d", "u_q"), 3000)
    with controlled("lease", tmp_path) as (control, drive, _), connect(drive.url) as other:
        number = capture.arm(other, setup)
        until(lambda: capture.seen(other, number).state == capture.DONE, "the recording")
        control.start(SET_POINTS, "somebody")
        deadline, uploads = time.monotonic() + 5.0, 0
        while time.monotonic() < deadline:
            assert len(capture.upload(other, capture.found(other, setup)).t) == 3000
            uploads += 1
            assert control.whom == "somebody", control.said
        assert uploads >= 2


# What bounds a motor besides its set points


def test_a_drive_that_is_still_on_when_its_link_is_back_too_late_is_switched_off(tmp_path: Path) -> None:
    """Its clock stood still, say: that its lease must have run out is what our clock says, and not what it is."""
    with controlled("lease", tmp_path) as (control, drive, link):
        control.start(SET_POINTS, "somebody")
        ours = control._controlled
        assert ours is not None
        link.there = False
        deadline = time.monotonic() + 2.5
        while time.monotonic() < deadline:
            drive.control(Record(ours.lease.token, Action.RENEW, seconds=2.0))
            time.sleep(0.1)
        assert control.whom is None
        assert control.said.startswith("nothing has come to the drive for longer than it waits for its bench")
        assert list(tmp_path.rglob("*.control.json"))
        link.there = True
        until(lambda: operation.state(drive._drive) is not State.OPERATION_ENABLED, "it to go off", 0.5)
        until(lambda: "it was still on, and has been switched off" in control.said, "it to be said")
        assert not list(tmp_path.rglob("*.control.json"))


def test_field_weakening_counts_as_a_current(one: tuple[Control, Between, OneLink]) -> None:
    control, drive, _ = one
    plainly(control, drive, field_weakening=1.0, i_d_weakening=8.0)
    with pytest.raises(LimitError, match=r"currents go up to 10 A, .*, got 10\.63 A with the steps"):
        control.start({"i_q_ref": 7.0}, "")
    control.start({"i_q_ref": 5.0}, "")
    with pytest.raises(LimitError, match="got 13 A"):
        plainly(control, drive, i_d_weakening=12.0)
    control.stop("")
    plainly(control, drive, field_weakening=0.0, i_d_weakening=12.0)
    control.start({"i_q_ref": 7.0}, "")
    with pytest.raises(LimitError, match=r"got 13\.89"):
        plainly(control, drive, field_weakening=1.0)


def test_speeds_are_of_the_machine_and_its_guard_is_as_before_afterwards(tmp_path: Path) -> None:
    limits = Limits(10.0, 1500.0, n_p=4)
    most = 1.1 * 1500.0 * 2.0 * 3.14159265 / 60.0 * 4
    with controlled("lease", tmp_path, limits) as (control, drive, link):
        plainly(control, drive, n_p=40.0, overspeed_trip=1e4)
        with pytest.raises(LimitError, match=r"speeds go up to 1500 rpm, .*, got 1600 rpm"):
            control.start({"speed_ref": 1600.0 * 4 * 2.0 * 3.14159265 / 60.0}, "")
        assert drive.read("overspeed_trip") == 1e4
        plainly(control, drive, n_p=4.0)
        control.start({}, "")
        assert drive.read("overspeed_trip") == pytest.approx(most, rel=1e-5)
        with pytest.raises(LimitError, match=r"overspeed_trip goes up to 691\.2 rad/s while the drive is controlled"):
            plainly(control, drive, overspeed_trip=1e4)
        plainly(control, drive, overspeed_trip=600.0)
        control.stop("")
        assert drive.read("overspeed_trip") == 1e4
        control.start({}, "")
        drive.write("control_word", 0.0)  # of another client
        until(lambda: control.whom is None and drive.read("overspeed_trip") == 1e4, "what was before")
        control.start({}, "")
        link.there = False
        until(lambda: control.whom is None, "control to end")
        link.there = True
        until(lambda: drive.read("overspeed_trip") == 1e4, "what was before")
        assert list(tmp_path.iterdir()) == []


def test_a_drive_without_leases_keeps_a_watchdog_that_bites_in_time(tmp_path: Path) -> None:
    with controlled("watchdog", tmp_path) as (control, drive, _):
        control.start(SET_POINTS, "")
        with pytest.raises(LimitError, match="watchdog_time goes up to 2 s while the drive is controlled"):
            plainly(control, drive, watchdog_time=10.0)
        drive.write("watchdog_time", 10.0)  # of another client
        until(lambda: drive.read("watchdog_time") == 2.0, "the bench to set it back", 2.0)


def test_a_speed_loop_that_asks_for_more_than_the_machine_takes_is_stopped(tmp_path: Path) -> None:
    limits = Limits(6.0, None, n_p=4)
    with controlled("lease", tmp_path, limits, parse(HEAVY, "heavy")) as (control, drive, _):
        plainly(control, drive, speed_control=1.0, speed_ramp=0.0)
        control.start({"speed_ref": 600.0}, "")
        assert drive.read("i_q") > 8.0
        until(lambda: control.whom is None, "control to end")
        assert "A for 0." in control.said
        assert "currents go up to 6 A" in control.said
        assert operation.state(drive) is State.SWITCH_ON_DISABLED  # pyright: ignore[reportArgumentType]
