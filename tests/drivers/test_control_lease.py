"""The control lease over every transport: one holder moves the motor, all read and stop it, nothing outlives it."""

import contextlib
import math
import threading
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import pytest

from drivers import lease as control
from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import RefusedError
from drivers.lease import Controlled, HeldError, Lease
from drivers.wire.cia402 import COMMUNICATION, OVERSPEED, Command, State
from drivers.wire.dictionary import SET_POINTS, SIGNALS, layout_id
from drivers.wire.lease import Action, End, Record
from tests.support.served_drive import until
from tests.support.transports import TRANSPORTS, ServedProcess, Transport, serial_socket_url

pytestmark = pytest.mark.live

SHORT = 0.3  # s
LINKS = [link for link in TRANSPORTS if not str(link.id).endswith("-socket")]  # those differ in their plugs alone


@pytest.fixture(scope="module", params=LINKS)
def transport(request: pytest.FixtureRequest) -> Transport:
    return request.param


@pytest.fixture(scope="module")
def second() -> str:
    """Another link to the same drive."""
    return serial_socket_url()


@pytest.fixture(scope="module")
def bench(transport: Transport, second: str) -> Iterator[ServedProcess]:
    with transport.serve(transport.new_url(), "--at", second, control="lease") as served:
        yield served


@pytest.fixture
def drive(bench: ServedProcess) -> Iterator[Drive]:
    """Off, without a fault, controlled by nobody."""
    with connect(bench.url) as connected:
        control.stop(connected)
        if operation.fault(connected):
            operation.reset_fault(connected)
        yield connected


def test_a_drive_powers_up_switched_off_and_controlled_by_nobody(transport: Transport) -> None:
    with transport.serve(transport.new_url(), control="lease") as served, connect(served.url) as drive:
        assert operation.state(drive) is State.SWITCH_ON_DISABLED
        assert control.held(drive) is None
        assert set_points(drive) == {0.0}
        assert drive.identity.has_lease


def test_every_signal_of_its_layout_can_be_read(drive: Drive) -> None:
    assert drive.identity.layout_id == layout_id()
    assert drive.identity.signals == SIGNALS
    assert all(math.isfinite(drive.read(signal.name)) or signal.full_scale for signal in SIGNALS)
    parameters = drive.parameters()
    assert set(parameters) == {signal.name for signal in SIGNALS if signal.is_parameter}
    assert parameters["overspeed_trip"] == pytest.approx(0.9 * 310.0 / math.sqrt(3.0) / 0.12)


def test_no_row_of_its_stream_is_lost_while_it_is_controlled(drive: Drive, transport: Transport) -> None:
    drive.write("stream_periods", transport.stream_periods)
    lease = Lease("streaming", 2.0)
    lease.take(drive)
    lease.start(drive, {"i_q_ref": 1.0})
    rows, lost = 0, 0
    for block in drive.stream():
        lease.keep(drive)
        rows, lost = rows + len(block), lost + block.lost_before
        if rows > 0.5 / (transport.stream_periods * drive.identity.T_s):
            break
    assert lost == 0
    assert operation.state(drive) is State.OPERATION_ENABLED


def test_its_holder_gives_set_points_and_starts_it_and_all_can_read_who_that_is(drive: Drive) -> None:
    with Controlled(drive, Lease("tester", 2.0)) as controlled:
        controlled.start(i_q_ref=2.0, i_q_step=0.0)
        assert operation.state(drive) is State.OPERATION_ENABLED
        until(lambda: drive.read("i_q") == pytest.approx(2.0, abs=0.1), "its current does not come")
        held = control.held(drive)
        assert held is not None
        assert held.holder == "tester"
        assert held.left is not None and 0.0 < held.left <= 2.0
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    assert control.held(drive) is None
    assert drive.read("lease_end") == End.RELEASED
    assert set_points(drive) == {0.0}


def test_without_a_token_no_set_point_and_no_start_is_taken(drive: Drive) -> None:
    for name in SET_POINTS:
        with pytest.raises(RefusedError, match=rf"\({name}\)"):
            drive.write(name, 1.0)
    for word in (Command.SHUTDOWN, Command.SWITCH_ON):
        drive.write("control_word", float(word.bits))
    with pytest.raises(RefusedError, match=r"\(control_word\)"):
        drive.write("control_word", float(Command.ENABLE_OPERATION.bits))
    with pytest.raises(RefusedError):
        drive.control(Record(77, Action.RENEW, seconds=1.0))
    assert operation.state(drive) is not State.OPERATION_ENABLED
    assert set_points(drive) == {0.0}


def test_a_second_holder_is_told_who_is_the_first_and_changes_nothing(second: str, drive: Drive) -> None:
    with Controlled(drive, Lease("first", 2.0)) as controlled, connect(second) as other:
        controlled.start(i_q_ref=1.0)
        with pytest.raises(HeldError, match=r"^'first' controls the drive for [0-9.]+ s more, unless renewed$"):
            Lease("second").take(other)
        with pytest.raises(RefusedError):
            other.write("bandwidth", 500.0)
        assert drive.read("bandwidth") == 1250.0
        assert operation.state(other) is State.OPERATION_ENABLED
        assert other.read("i_q_ref") == 1.0


def test_anybody_may_stop_it_and_its_holder_has_it_no_longer(second: str, drive: Drive) -> None:
    with Controlled(drive, Lease("first", 2.0)) as controlled, connect(second) as other:
        controlled.start(i_q_ref=1.0)
        control.stop(other)
        assert operation.state(drive) is State.SWITCH_ON_DISABLED
        with pytest.raises(HeldError, match="control of the drive was ended by another's stop"):
            controlled.write(i_q_ref=1.0)
        assert set_points(drive) == {0.0}


def test_configuration_is_anybodys_while_nobody_controls_it(drive: Drive) -> None:
    drive.write("bandwidth", 600.0)
    assert drive.read("bandwidth") == 600.0
    drive.write("bandwidth", 1250.0)


def test_a_holder_that_falls_silent_loses_it_though_others_read_and_stream_all_the_time(
    second: str, drive: Drive
) -> None:
    lease = Lease("silent", SHORT)
    lease.take(drive)
    lease.start(drive, {"i_q_ref": 3.0, "i_d_step": 1.0})
    with connect(second) as other, reading(drive), reading(other):
        begun = drive.read("tick")
        until(lambda: operation.state(drive) is State.FAULT, "it stays on")
        assert (drive.read("tick") - begun) * drive.identity.T_s < SHORT + 0.5
    assert operation.fault(drive) == operation.Fault(COMMUNICATION, "the bench fell silent")
    assert control.held(drive) is None
    assert drive.read("lease_end") == End.RAN_OUT
    assert set_points(drive) == {0.0}
    operation.reset_fault(drive)
    with Controlled(drive) as controlled:
        controlled.start()
        assert drive.read("i_q_ref") == 0.0  # what the lease before had asked for is nobody's any more


def test_one_that_renews_keeps_it_for_as_long_as_it_does(drive: Drive) -> None:
    with Controlled(drive, Lease("steady", SHORT)) as controlled:
        controlled.start()
        begun = drive.read("tick")
        while (drive.read("tick") - begun) * drive.identity.T_s < 3.0 * SHORT:
            controlled.lease.keep(drive)
        assert operation.state(drive) is State.OPERATION_ENABLED


def test_a_record_is_taken_whole_or_not_at_all(drive: Drive) -> None:
    with Controlled(drive, Lease("whole", 2.0)) as controlled:
        with pytest.raises(RefusedError):
            controlled.start(i_d_ref=1.0, i_q_ref=1e3)  # beyond its current limit
        assert operation.state(drive) is State.SWITCH_ON_DISABLED
        assert set_points(drive) == {0.0}
        with pytest.raises(RefusedError, match=r"bandwidth\) takes at most"):
            controlled.write(i_d_ref=1.0, bandwidth=1e9)
        assert set_points(drive) == {0.0}


def test_a_lease_longer_than_the_watchdogs_time_is_refused(drive: Drive) -> None:
    assert drive.read("watchdog_time") == 2.0
    with pytest.raises(RefusedError):
        drive.control(Record(77, Action.TAKE, seconds=5.0, holder="long"))
    with pytest.raises(RefusedError, match=r"\(watchdog_time\)"):
        drive.write("watchdog_time", 0.0)
    assert control.held(drive) is None


def test_a_reset_ends_it_and_leaves_the_drive_off(transport: Transport) -> None:
    resetting = transport.serve(transport.new_url(), "--fault", "reset@4", control="lease")
    with resetting as served, connect(served.url) as drive:
        lease = Lease("reset", 2.0)
        lease.take(drive)
        lease.start(drive, {"i_q_ref": 1.0})
        ticks = [drive.read("tick")]

        def has_reset() -> bool:
            ticks.append(drive.read("tick"))
            return ticks[-1] < ticks[-2]

        until(has_reset, "it does not reset")
        assert operation.state(drive) is State.SWITCH_ON_DISABLED
        assert control.held(drive) is None
        assert set_points(drive) == {0.0}


def test_a_drive_of_the_layout_without_leases_is_taken_with_its_watchdog(transport: Transport) -> None:
    with transport.serve(transport.new_url(), control="watchdog") as served, connect(served.url) as drive:
        assert drive.identity.layout_id == 0x576E360A
        assert control.held(drive) is None
        names = {signal.name for signal in SIGNALS[:76]}
        assert set(drive.parameters()) < names
        with pytest.raises(RefusedError):
            drive.read("lease_left")
        lease = Lease("old", SHORT)
        lease.take(drive)
        assert drive.read("watchdog_time") == pytest.approx(SHORT)
        lease.start(drive, {"i_q_ref": 1.0})
        assert operation.state(drive) is State.OPERATION_ENABLED
        lease.release(drive)
        assert operation.state(drive) is State.SWITCH_ON_DISABLED
        assert set_points(drive) == {0.0}


def test_a_drive_under_local_control_runs_and_refuses_a_lease_until_it_was_stopped(transport: Transport) -> None:
    with transport.serve(transport.new_url(), control="local") as served, connect(served.url) as drive:
        assert operation.state(drive) is State.OPERATION_ENABLED
        assert control.held(drive) == control.Held("local", None)
        with pytest.raises(HeldError, match=r"^a master inside the drive controls the drive; stop it there first$"):
            Lease("early").take(drive)
        control.stop(drive)
        with Controlled(drive) as controlled:
            controlled.start(i_q_ref=1.0)


RUNAWAY = """
[motor]
R_s = 0.9664
L_d = 4.24e-3
L_q = 6.21e-3
psi_f = 0.12
n_p = 6
i_rated = 6.0
J = 1e-2
[run]
shaft = "free"
speed_rpm = 0.0
"""
SPEED = "speed_control = true\nspeed_reference = 'ramp'\n"
OPPOSITE = "[effects.angle_sensing]\noffset = 0.5235987755982988\n"  # rad: half an electrical turn, torque's sign


@pytest.mark.parametrize(
    ("more", "asked"),
    [("", {"i_q_ref": 2.0}), (SPEED + OPPOSITE, {"speed_ref": 200.0})],
    ids=["torque command on a free shaft", "speed control by an angle of the wrong sign"],
)
def test_a_motor_that_runs_away_is_tripped_by_overspeed(
    transport: Transport, tmp_path: Path, more: str, asked: dict[str, float]
) -> None:
    scenario = tmp_path / "runaway.toml"
    scenario.write_text(RUNAWAY + more, encoding="utf-8")
    running_away = transport.serve(transport.new_url(), "--scenario", str(scenario), control="lease")
    with running_away as served, connect(served.url) as drive:
        lease = Lease("runaway", 2.0)
        lease.take(drive)
        lease.start(drive, asked | {"overspeed_trip": 500.0})  # rad/s, as a bench has it of the machine's largest speed

        def tripped() -> bool:
            lease.keep(drive)
            return operation.state(drive) is State.FAULT

        until(tripped, "it never trips", 30.0)
        assert operation.fault(drive) == operation.Fault(OVERSPEED, "overspeed")
        assert set_points(drive) == {0.0}
        lease.release(drive)


def set_points(drive: Drive) -> set[float]:
    """The values of all set points."""
    return {drive.read(name) for name in SET_POINTS}


@contextlib.contextmanager
def reading(drive: Drive) -> Generator[None]:
    """A client that reads all the time."""
    ended = threading.Event()

    def read() -> None:
        while not ended.is_set():
            drive.read("status_word")

    with in_thread(read):
        yield
        ended.set()


@contextlib.contextmanager
def in_thread(work: Callable[[], None]) -> Generator[None]:
    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        thread.join()
