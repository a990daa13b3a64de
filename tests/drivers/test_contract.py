"""What every drive keeps to, whatever the transport: one in a process of its own, in real time, known by its URL."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator

import numpy as np
import pytest

from drivers import capture, operation
from drivers.canopen import drive as canopen_drive
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import ConnectError, FaultError, LostError, RefusedError
from drivers.modbus import drive as modbus_drive
from drivers.uart import drive as uart_drive
from drivers.wire.canopen_od import Abort
from drivers.wire.cia402 import COMMUNICATION, OVERCURRENT, SPEED_ERROR, State, error_text
from drivers.wire.dictionary import WATCHDOG_LAYOUT, signals_of
from drivers.wire.uart_frame import WRONG_VALUE
from emulator.scenario.scenarios import PAPER
from tests.support.served_drive import Listening, first_blocks, in_threads, joined, listening, until
from tests.support.transports import TRANSPORTS, ServedProcess, Transport

SIGNALS = signals_of(WATCHDOG_LAYOUT)  # of a drive that anybody may write to; one with a lease: test_control_lease
pytestmark = pytest.mark.live

STREAMED = 1.0  # s
LOST_WITHIN = 3.0  # s
WATCHDOG = 0.3  # s
ILLEGAL_DATA_VALUE = 3  # exception of Modbus


@pytest.fixture(scope="module", params=TRANSPORTS)
def transport(request: pytest.FixtureRequest) -> Transport:
    return request.param


@pytest.fixture(scope="module")
def bench(transport: Transport) -> Iterator[ServedProcess]:
    with transport.serve(transport.new_url()) as served:
        yield served


@pytest.fixture
def drive(bench: ServedProcess, transport: Transport) -> Iterator[Drive]:
    with connect(bench.url) as connected:
        connected.write("stream_periods", transport.stream_periods)
        yield connected


def test_a_drive_says_who_it_is(drive: Drive) -> None:
    identity = drive.identity
    assert identity.device_name == "pmsm-bench virtual drive"
    assert (identity.vendor_id, identity.product_code, identity.revision) == (0, 0x504D534D, 1)
    assert identity.layout_id == WATCHDOG_LAYOUT
    assert (identity.T_s, identity.i_full, identity.u_full) == (1e-4, 24.0, 387.5)
    assert identity.omega_full == pytest.approx(PAPER.drive.omega_full, rel=1e-6)


def test_every_signal_can_be_read(drive: Drive) -> None:
    values = {signal.name: drive.read(signal.name) for signal in SIGNALS}
    assert values["u_dc"] == pytest.approx(310.0, abs=387.5 / 65536)
    assert values["temp_winding"] == pytest.approx(23.4)
    assert (values["control_R_s"], values["control_L_d"], values["n_p"]) == (0.9664, 4.24e-3, 4.0)
    assert 0.0 <= values["theta_e"] < 6.2832


def test_a_written_value_is_read_back_the_same(drive: Drive) -> None:
    values = {
        "i_q_ref": 1.25, "bandwidth": 1000.0, "control_L_q": 0.0061, "stream_periods": 200.0, "field_weakening": 1.0,
        "speed_ref": -250.0, "sine_count": 16.0, "i_d_levels": 7.0, "level_time": 0.25,
    }
    for name, value in values.items():
        before = drive.read(name)
        drive.write(name, value)
        assert drive.read(name) == value, name
        drive.write(name, before)
        assert drive.read(name) == before, name


def test_the_parameters_are_all_that_can_be_written_but_for_commands(drive: Drive) -> None:
    parameters = drive.parameters()
    assert set(parameters) == {signal.name for signal in SIGNALS if signal.is_parameter}
    assert all(drive.read(name) == value for name, value in parameters.items())


def test_what_is_only_measured_cannot_be_written(drive: Drive) -> None:
    for name in ("i_d", "T_s", "tick", "layout_id", "temp_magnet"):
        with pytest.raises(RefusedError, match=rf"\({name}\) is (ro|const), it cannot be written"):
            drive.write(name, 1.0)


def test_a_value_that_cannot_be_is_refused_before_the_wire(drive: Drive) -> None:
    for name, value, sentence in (
        ("stream_periods", 0.0, r"\(stream_periods\) takes at least 1, got 0$"),
        ("bandwidth", 1e9, r"\(bandwidth\) takes at most 10000.0 rad/s, got 1"),
        ("control_R_s", 0.0, r"\(control_R_s\) takes at least 0.0001 ohm, got 0.0"),
        ("i_q_ref", float("nan"), r"\(i_q_ref\) takes a finite number, got nan"),
        ("i_q_ref", 1e40, r"\(i_q_ref\) takes a 32-bit float, up to 3.4028e\+38 in size, got 1e\+40"),
    ):
        before = drive.read(name)
        with pytest.raises(RefusedError, match=sentence):
            drive.write(name, value)
        assert drive.read(name) == before


def test_a_value_that_this_drive_refuses_is_told_by_name(drive: Drive) -> None:
    before = drive.read("i_q_ref")
    with pytest.raises(RefusedError, match=r"(0x2300:2|register \S+) \(i_q_ref\)") as caught:
        drive.write("i_q_ref", 12.5)  # its current limit is 12 A
    assert caught.value.code in (Abort.VALUE_RANGE, ILLEGAL_DATA_VALUE, WRONG_VALUE)
    assert str(caught.value).count("\n") == 0
    assert drive.read("i_q_ref") == before


def test_an_unknown_name_is_told_with_the_names_there_are(drive: Drive) -> None:
    for call in (lambda: drive.read("torque"), lambda: drive.write("torque", 1.0)):
        with pytest.raises(KeyError, match="the drive has no signal 'torque'; it has T_s, "):
            call()


def test_four_threads_at_once_each_get_their_own_values(drive: Drive) -> None:
    drive.write("stream_periods", 100.0)
    expected = {"T_s": 1e-4, "stream_periods": 100.0, "u_full": 387.5, "control_R_s": 0.9664}

    def reading(name: str, value: float) -> Callable[[], None]:
        def job() -> None:
            assert {drive.read(name) for _ in range(100)} == {value}
        return job

    in_threads([reading(name, value) for name, value in expected.items()])


def test_no_row_of_the_stream_is_lost(drive: Drive, transport: Transport) -> None:
    row_time = transport.stream_periods * drive.identity.T_s
    begun = time.monotonic()
    blocks = first_blocks(drive, round(STREAMED / row_time))
    assert time.monotonic() - begun > 0.8 * STREAMED  # in real time; a machine that is held up takes longer
    assert all(block.lost_before == 0 and block.periods == transport.stream_periods for block in blocks)
    assert np.all(np.diff(joined(blocks, "tick")) == transport.stream_periods)
    assert joined(blocks, "omega_e") == pytest.approx(4.0 * 1200.0 * np.pi / 30.0, rel=1e-3)
    assert joined(blocks, "u_dc") == pytest.approx(310.0, abs=0.01)
    assert blocks[-1].temp_winding == pytest.approx(23.4)


def test_values_can_be_read_and_written_while_streaming(drive: Drive) -> None:
    with listening(drive) as listener:
        for k in range(50):
            drive.write("i_q_ref", k / 100.0)
            assert drive.read("i_q_ref") == k / 100.0
        until(lambda: listener.rows > 100, "no rows")
    assert listener.error is None
    assert all(block.lost_before == 0 for block in listener.blocks)


def test_another_row_length_counts_while_streaming(drive: Drive, transport: Transport) -> None:
    longer = 2 * transport.stream_periods
    with listening(drive) as listener:
        drive.write("stream_periods", longer)
        until(
            lambda: listener.blocks[-1].periods == longer or not listener.thread.is_alive(), "no rows of the new length"
        )
    assert listener.error is None
    assert {block.periods for block in listener.blocks} == {transport.stream_periods, longer}
    assert all(np.all(np.diff(block.tick) == block.periods) for block in listener.blocks)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short silence is enough for a drive to be lost."""
    for client in (canopen_drive, modbus_drive, uart_drive):
        monkeypatch.setattr(client, "SILENCE", 0.2)  # s


@pytest.mark.usefixtures("impatient")
def test_a_slow_reader_is_no_silence_of_the_drive(drive: Drive) -> None:
    stream = drive.stream()
    before = next(stream)
    for _ in range(2):
        pass_time(0.3)
        after = next(stream)
        assert (after.lost_before, after.tick[0]) == (0, before.tick[-1] + before.periods)
        before = after
    drive.close()


def test_a_drive_goes_off_when_the_bench_hangs_though_its_link_stands(drive: Drive) -> None:
    """Taking blocks is all that the bench does for the watchdog, and all that it leaves off."""
    drive.write("stream_periods", 100.0)
    operation.enable(drive)
    drive.write("watchdog_time", WATCHDOG)
    stream = drive.stream()
    begun = time.monotonic()
    powered = list[float]()
    while time.monotonic() - begun < 2.5 * WATCHDOG:
        powered += next(stream).i_q_mean.tolist()
    assert np.abs(powered).max() > 0.5  # A: the bridge is on
    pass_time(1.5 * WATCHDOG)
    assert operation.state(drive) is State.FAULT
    assert operation.fault(drive) == operation.Fault(COMMUNICATION, "the bench fell silent")
    now = drive.read("tick")
    while (off := next(stream)).tick[0] < now:
        pass
    assert np.abs(off.i_q_mean).max() < 0.05
    at_rest(drive)


def test_a_drive_goes_off_when_the_bench_is_gone(bench: ServedProcess, drive: Drive) -> None:
    operation.enable(drive)
    drive.write("watchdog_time", WATCHDOG)
    drive.close()
    pass_time(1.5 * WATCHDOG)
    with connect(bench.url) as again:
        assert operation.state(again) is State.FAULT
        at_rest(again)


def test_a_drive_can_be_closed_twice_and_then_answers_nothing(bench: ServedProcess) -> None:
    drive = connect(bench.url)
    drive.close()
    drive.close()
    with pytest.raises(LostError):
        drive.read("i_d")
    assert list(drive.stream()) == []


def test_connecting_again_and_again_leaves_nothing_behind(bench: ServedProcess) -> None:
    threads = threading.active_count()
    for _ in range(3):
        with connect(bench.url) as drive:
            assert len(first_blocks(drive, 5)) > 0
    assert threading.active_count() <= threads + 2  # the server's own, of a client that has just left


@pytest.mark.usefixtures("impatient")
def test_a_drive_that_hangs_is_lost_in_a_sentence_and_had_again_when_it_goes_on(
    bench: ServedProcess, drive: Drive, capfd: pytest.CaptureFixture[str]
) -> None:
    with listening(drive) as listener:
        bench.process.send_signal(signal.SIGSTOP)
        try:
            lost_in_time(listener, drive)
        finally:
            bench.process.send_signal(signal.SIGCONT)
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0
    assert capfd.readouterr().err == ""


def test_a_drive_that_dies_is_lost_in_a_sentence_and_had_again_when_it_is_back(
    transport: Transport, capfd: pytest.CaptureFixture[str]
) -> None:
    url = transport.new_url()
    with transport.serve(url) as bench, connect(url) as drive, listening(drive) as listener:
        bench.process.kill()
        lost_in_time(listener, drive)
        with pytest.raises(ConnectError):
            connect(url)
    with transport.serve(url), connect(url) as again:
        assert len(first_blocks(again, 20)) > 0
    assert capfd.readouterr().err == ""


def test_a_recording_waits_for_its_level_and_is_what_the_stream_tells_of_the_same_ticks(drive: Drive) -> None:
    operation.enable(drive)
    setup = capture.Setup(("theta_e", "i_d", "i_q"), length=2000, pre=500, trigger="i_q", level=2.0, edge=1)
    with listening(drive) as listener, parameters(drive, i_q_ref=0.0, i_q_step=0.0):
        until(lambda: abs(listener.blocks[-1].i_q_mean[-1]) < 0.2, "its current does not go")
        number = capture.arm(drive, setup)
        pass_time(1.5 * setup.pre * drive.identity.T_s)
        assert capture.seen(drive, number).state == capture.ARMED
        drive.write("i_q_ref", 4.0)
        got = capture.upload(drive, capture.awaited(drive, setup, 5.0))
        until(lambda: listener.blocks[-1].tick[-1] >= got.tick + setup.length, "no rows")
    assert [len(column) for column in got.columns.values()] == [2000] * 3
    assert got.columns["i_q"][499] <= 2.0 < got.columns["i_q"][500]
    places = joined(listener.blocks, "tick") - got.tick
    inside = (places >= 0) & (places < setup.length)
    assert inside.sum() >= setup.length / listener.blocks[-1].periods - 1
    for name, column in got.columns.items():
        off = joined(listener.blocks, name)[inside] - column[places[inside]]
        off = (off + np.pi) % (2.0 * np.pi) - np.pi if name == "theta_e" else off
        assert np.abs(off).max() < 1e-6, name


def test_a_drive_is_led_through_its_states(drive: Drive) -> None:
    operation.disable(drive)
    for word, state in (
        (0x06, State.READY_TO_SWITCH_ON), (0x07, State.SWITCHED_ON), (0x0F, State.OPERATION_ENABLED),
        (0x02, State.QUICK_STOP_ACTIVE), (0x00, State.SWITCH_ON_DISABLED),
    ):
        drive.write("control_word", float(word))
        until(lambda state=state: operation.state(drive) is state, f"it is not in state {state}")
    operation.enable(drive)
    operation.quick_stop(drive)
    assert operation.state(drive) is State.QUICK_STOP_ACTIVE
    operation.enable(drive)
    assert operation.state(drive) is State.OPERATION_ENABLED
    assert operation.fault(drive) is None


def test_a_fault_of_the_drive_is_told_and_left_by_a_reset_alone(drive: Drive) -> None:
    operation.enable(drive)
    with parameters(drive, control_psi_f=10.0):  # Vs, for which its control applies far too high a voltage
        until(lambda: operation.state(drive) is State.FAULT, "it never trips")
        assert operation.fault(drive) == operation.Fault(OVERCURRENT, error_text(OVERCURRENT))
        with pytest.raises(FaultError) as caught:
            operation.enable(drive)
        assert caught.value.code == OVERCURRENT
        operation.quick_stop(drive)
        operation.disable(drive)
        assert operation.state(drive) is State.FAULT
    operation.reset_fault(drive)
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    assert operation.fault(drive) is None
    operation.enable(drive)
    assert operation.state(drive) is State.OPERATION_ENABLED


def test_a_sequence_of_excitation_that_is_commanded_is_what_the_stream_shows(drive: Drive) -> None:
    operation.enable(drive)
    drive.write("stream_periods", 20.0)
    settings = {"i_d_step": 2.0, "i_q_step": 2.0, "step_time": 0.02, "i_d_levels": 2.0, "level_time": 0.02}
    with listening(drive) as listener, parameters(drive, **settings):
        for kind, fewest, most in ((0.0, 0.0, 0.1), (2.0, 3.8, 4.6), (3.0, 3.0, 4.2), (4.0, 3.8, 4.6)):
            with parameters(drive, excitation_kind=kind):
                pass_time(0.05)  # the step to the sequence is over
                begin = listener.rows
                until(lambda begin=begin: listener.rows > begin + 200, "no rows")
                assert fewest <= np.ptp(joined(listener.blocks, "i_d")[begin:]) <= most, kind
    assert listener.error is None


def test_a_speed_that_does_not_follow_is_a_fault_of_its_own(drive: Drive) -> None:
    operation.enable(drive)
    with parameters(drive, speed_error_time=0.02, speed_error_trip=50.0, speed_ref=0.0, speed_control=1.0):
        until(lambda: operation.state(drive) is State.FAULT, "it never trips")  # a dynamometer turns its shaft
        assert operation.fault(drive) == operation.Fault(SPEED_ERROR, "the speed does not follow its reference")
    operation.reset_fault(drive)
    operation.enable(drive)
    assert operation.state(drive) is State.OPERATION_ENABLED


@contextlib.contextmanager
def parameters(drive: Drive, **values: float) -> Generator[None]:
    """Other values for a while."""
    before = {name: drive.read(name) for name in values}
    for name, value in values.items():
        drive.write(name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            drive.write(name, value)


def pass_time(duration: float) -> None:
    """Do nothing for so many s."""
    threading.Event().wait(duration)


def at_rest(drive: Drive) -> None:
    """As other tests expect a drive: on, and without a watchdog."""
    drive.write("watchdog_time", 0.0)
    operation.reset_fault(drive)
    operation.enable(drive)


def lost_in_time(listener: Listening, drive: Drive) -> None:
    """The stream ends with a LostError soon, and the drive can be closed."""
    begun = time.monotonic()
    error = listener.ended()
    drive.close()
    assert time.monotonic() - begun < LOST_WITHIN
    assert isinstance(error, LostError)
    assert str(error)
    assert "Traceback" not in str(error)
