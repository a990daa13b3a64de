"""Captures as a service keeps them: every state, every refusal, links and services that end in between."""

import contextlib
import os
import re
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from bench.actions.capture import State, Status
from bench.actions.capture_request import Request
from bench.config import Config, DriveConfig
from bench.errors import BenchError, ConflictError, LimitError, RecordingError, UnavailableError, UnknownError
from bench.live.window import Window
from bench.recordings.capture_file import CapturePart, Heading
from bench.recordings.table import notes
from bench.service.service import Service
from drivers import capture, operation
from drivers.connect import connect
from drivers.errors import LostError, RefusedError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from emulator.servers.faults import Faults, parse_fault
from tests.conftest import bus_url, free_port
from tests.support.driving import driving
from tests.support.recordings import read_recording
from tests.support.relay import relayed
from tests.support.served_drive import PATIENCE, Served, served, tcp_url, until
from tests.support.transports import modbus_tcp_url

pytestmark = pytest.mark.live

NEVER = {"trigger": "i_q > 23"}
LEVEL = 2730.5 * 24.0 / 32768.0  # A, between two counts: what has crossed it has done so in the recording too


@contextmanager
def brisk(url: str, *, paced: bool = False) -> Generator[Served]:
    """A drive whose time passes quickly, so that long recordings are soon made, with few rows in it."""
    with served(url, burst=500, paced=paced) as one:
        one.drive.write("stream_periods", 50.0)
        yield one


@pytest.fixture
def drive() -> Iterator[Served]:
    with brisk(tcp_url()) as one:
        yield one


@contextmanager
def running(url: str, folder: Path) -> Generator[Service]:
    """A service over one drive called `spindle`, which streams."""
    with Service(Config((DriveConfig("spindle", url, Window()),), captures=folder)) as service:
        streams(service)
        yield service


@pytest.fixture
def service(drive: Served, tmp_path: Path) -> Iterator[Service]:
    with running(drive.url, tmp_path) as one:
        yield one


def streams(service: Service) -> None:
    rows = service.link("spindle").rows
    until(lambda: service.link("spindle").rows > rows, "rows")


def ask(service: Service, **given: Any) -> Status:
    return service.captures.ask("spindle", given)


def reached(service: Service, state: State, id_: str = "latest") -> Status:
    """The capture in this state; fails where it has ended in another, or comes no further."""
    before, since = None, time.monotonic()
    while (status := service.captures.one("spindle", id_)).state is not state:
        assert not status.state.ended, status
        if status != before:
            before, since = status, time.monotonic()
        assert time.monotonic() - since < PATIENCE, status
        time.sleep(0.005)
    return status


def uploading(service: Service, samples: int = 1) -> Status:
    """The capture with so many samples uploaded, and more to come."""
    reached(service, State.UPLOADING)
    until(lambda: service.captures.one("spindle", "latest").samples >= samples, "samples")
    status = service.captures.one("spindle", "latest")
    assert status.state is State.UPLOADING
    return status


def check_by_twin(path: Path, length: int) -> None:
    """A recording is what a twin of the drive, which was never reset, did at those times, within half a count."""
    (run,) = read_recording(path).runs
    assert len(run) == length
    twin = VirtualDrive(PAPER)
    twin.run(round(run.t0 / 1e-4))
    whole = twin.record(length)
    i, u = run.resolution.i, run.resolution.u
    for name, step in (("i_d", i), ("i_q", i), ("u_d", u), ("u_q", u)):
        assert np.abs(getattr(run, name) - whole[name]).max() <= 0.5001 * step, name


def test_a_capture_goes_through_its_states_to_a_recording_that_tells_units_and_steps(
    service: Service, tmp_path: Path
) -> None:
    begun = ask(service, length=3000, pre_trigger=0.25, trigger=f"i_q<{LEVEL}")
    assert (begun.state, begun.progress) == (State.ARMED, 0.0)
    done = reached(service, State.DONE)
    assert (done.samples, done.progress, done.reason) == (3000, 1.0, "")
    path = tmp_path / f"{done.id}.parquet"
    assert done.file == path
    assert list(tmp_path.iterdir()) == [path]
    check_by_twin(path, 3000)
    recording = read_recording(path)
    i_q = recording.runs[0].i_q
    assert i_q[750] <= LEVEL < i_q[749]
    assert recording.summary.remarks() == ()
    told = notes(path)
    assert (told["drive"], told["complete"], told["samples"], told["decimation"]) == ("spindle", True, 3000, 1)
    assert told["request"]["trigger"] == {"signal": "i_q", "level": LEVEL, "edge": "falling"}
    assert told["steps"]["i_q"] == pytest.approx(24.0 / 32768)
    assert told["T_s"] == pytest.approx(1e-4)


def test_a_capture_of_a_drive_that_is_off_says_so_before_and_in_the_recording(
    service: Service, drive: Served
) -> None:
    operation.disable(service.control("spindle")._link.drive())
    off = "the drive is off (switch on disabled)"
    assert ask(service, length=500).remark == f"{off}: there is no voltage to record until it is started"
    done, was = reached(service, State.DONE), off.replace(" is ", " was ")
    assert done.remark == f"when the recorder was armed {was}; when it was uploaded {was}"
    assert done.file is not None
    with pytest.raises(RecordingError, match=re.escape(f"(no value: u_d in 500, u_q in 500); {done.remark}")):
        read_recording(done.file)


@dataclass(frozen=True)
class Way:
    """A transport over TCP: the URL at a port, and a drive served there in this process."""

    url: Callable[[int], str]
    serve: Callable[[str], AbstractContextManager[Any]]


WAYS = {
    "canopen": Way(bus_url, brisk),
    "modbus": Way(lambda port: f"modbus+tcp://127.0.0.1:{port}/1", brisk),
    "uart": Way(lambda port: f"uart://socket://127.0.0.1:{port}?baudrate=3000000", lambda url: brisk(url, paced=True)),
}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS.keys())
def test_the_stream_loses_no_row_while_a_capture_is_uploaded(way: Way, tmp_path: Path) -> None:
    url = way.url(free_port())
    with way.serve(url), running(url, tmp_path) as service:
        ask(service, length=20_000)
        rows = reached(service, State.UPLOADING) and service.link("spindle").rows
        reached(service, State.DONE)
        link = service.link("spindle")
        assert link.rows > rows
        assert (link.gaps, link.rows_lost, link.reconnects) == (0, 0, 0)


def test_what_is_chosen_is_recorded_and_nothing_else(service: Service) -> None:
    ask(service, signals=["i_a", "u_dc"], length=200, decimation=7)
    path = reached(service, State.DONE).file
    assert path is not None
    parquet: Any = pyarrow.parquet
    table: Any = parquet.read_table(path)
    assert table.column_names == ["t", "i_a", "u_dc"]
    assert [field.metadata[b"unit"] for field in table.schema] == [b"s", b"A", b"V"]
    assert np.diff(table["t"].to_numpy()) == pytest.approx(7e-4)
    assert table["u_dc"].to_numpy() == pytest.approx(310.0, abs=0.01)


def test_a_decimated_capture_is_refused_as_a_recording_of_every_period(service: Service) -> None:
    ask(service, length=200, decimation=2)
    path = reached(service, State.DONE).file
    assert path is not None
    with pytest.raises(BenchError, match="expected every control period, it holds one of 2; capture with a decimation"):
        read_recording(path)


def test_a_capture_by_command_waits_for_it(service: Service) -> None:
    id_ = ask(service, length=100, trigger="command").id
    until(lambda: "waiting for the command" in service.captures.one("spindle", id_).reason, "waiting")
    service.captures.trigger("spindle", id_)
    assert reached(service, State.DONE, id_).samples == 100
    with pytest.raises(ConflictError, match=f"capture {id_} is done, there is nothing to trigger"):
        service.captures.trigger("spindle", id_)


def test_a_trigger_that_never_comes_ends_in_a_sentence_and_a_drive_that_waits_no_longer(
    service: Service, drive: Served, tmp_path: Path
) -> None:
    ask(service, **NEVER, timeout_s=0.2)
    status = reached(service, State.FAILED)
    assert status.reason == "the trigger, i_q rising through 23, has not come within 0.2 s"
    assert status.file is None
    assert list(tmp_path.iterdir()) == []
    until(lambda: drive.drive.read("capture_state") == 0.0, "the recorder to stop")
    assert service.writer("spindle") is None
    with pytest.raises(ConflictError, match=f"capture {status.id} has no recording, it is failed"):
        service.captures.file("spindle", status.id)


def test_a_capture_is_cancelled_on_the_drive_too(service: Service, drive: Served, tmp_path: Path) -> None:
    id_ = ask(service, **NEVER).id
    assert drive.drive.read("capture_state") == 1.0
    assert service.captures.cancel("spindle", id_).state is State.CANCELLED
    until(lambda: drive.drive.read("capture_state") == 0.0, "the recorder to stop")
    with pytest.raises(ConflictError, match=f"capture {id_} is cancelled, there is nothing to cancel"):
        service.captures.cancel("spindle", id_)
    ask(service, length=60_000)
    uploading(service)
    assert service.captures.cancel("spindle", "latest").state is State.CANCELLED
    assert list(tmp_path.iterdir()) == []
    ask(service, length=10)  # the drive is free again
    reached(service, State.DONE)


def test_a_second_writer_is_told_who_writes_and_until_when(service: Service, drive: Served) -> None:
    first = service.captures.ask("spindle", NEVER | {"timeout_s": 100.0}, "127.0.0.1")
    writer = service.writer("spindle")
    assert writer is not None
    assert 100.0 < (writer.until - first.asked).total_seconds() < 300.0
    number = drive.drive.read("capture_number")
    with pytest.raises(ConflictError) as refused:
        ask(service)
    assert str(refused.value) == (
        f"drive spindle's recorder takes one writer at a time, and capture {first.id} (asked for from 127.0.0.1) "
        f"holds it until {writer.until:%H:%M:%S} UTC at the latest"
    )
    assert drive.drive.read("capture_number") == number
    assert service.captures.all("spindle") == [service.captures.one("spindle", first.id)]
    service.captures.cancel("spindle", first.id)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"signals": ["torque"]}, "signals: the recorder has theta_e, i_d, .*, got 'torque'"),
        ({"signals": []}, "signals: expected a list out of theta_e, .*, got \\[\\]"),
        ({"signals": "i_d"}, "signals: expected a list out of .*, got 'i_d'"),
        ({"signals": ["i_d", "i_d"]}, "expected 1 to 8 different channels, got i_d, i_d"),
        ({"signals": ["none"]}, "signals: the recorder has .*, got 'none'"),
        ({"length": 65_537}, "length: expected a whole number of 1 to 65536, got 65537"),
        ({"length": 0}, "length: .*, got 0"),
        ({"length": 1.5}, "length: .*, got 1.5"),
        ({"length": True}, "length: .*, got true"),
        ({"decimation": 1001}, "decimation: expected a whole number of 1 to 1000, got 1001"),
        ({"pre_trigger": 1.5}, "pre_trigger: expected a number of 0 to 1, got 1.5"),
        ({"timeout_s": 0}, "timeout_s: expected a number of 0.1 to 86400, got 0"),
        ({"trigger": "sometimes"}, 'trigger: expected "now", "command", "i_q > 2.0" or .*, got \'sometimes\''),
        ({"trigger": "i_q > soon"}, "trigger: .*, got 'i_q > soon'"),
        ({"trigger": "torque > 2"}, "trigger signal: the recorder has .*, got 'torque'"),
        ({"trigger": {"signal": "i_q"}}, "trigger level: expected a number of .*, got null"),
        ({"trigger": {"signal": "i_q", "level": float("nan")}}, "trigger level: .*, got nan"),
        ({"trigger": {"signal": "i_q", "level": 1, "edge": "up"}}, "trigger edge: expected rising, falling or either"),
        ({"trigger": {"signal": "i_q", "level": 1, "edge": "\udcff"}},
         "trigger edge: expected rising, falling or either, got '.+udcff'"),
        ({"trigger": {"signal": "i_q", "slope": 1}}, "trigger: expected signal, level or edge, got 'slope'"),
        ({"trigger": None}, "trigger: .*, got null"),
        ({"samples": 5}, "expected signals, length, .* or timeout_s, got 'samples'"),
    ],
    ids=str,
)
def test_what_no_drive_could_do_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(LimitError, match=said):
        Request.of(given)


@pytest.mark.parametrize(
    ("trigger", "said"),
    [
        ("i_q > 24", "trigger level: i_q of this drive is -24 to 24 A, its full scale, got 24"),
        ("i_a < -100", "trigger level: i_a of this drive is -24 to 24 A, its full scale, got -100"),
        ("theta_e > 7", "trigger level: theta_e of this drive is 0 to 6.28319 rad, its full scale, got 7"),
        ("theta_e < -1", "trigger level: theta_e of this drive is 0 to 6.28319 rad, its full scale, got -1"),
    ],
)
def test_a_level_that_a_signal_cannot_come_to_is_refused(service: Service, trigger: str, said: str) -> None:
    with pytest.raises(LimitError) as refused:
        ask(service, trigger=trigger)
    assert str(refused.value) == said
    assert service.writer("spindle") is None


def test_a_drive_of_two_names_takes_one_writer(tmp_path: Path) -> None:
    urls = {"spindle": tcp_url(), "alias": modbus_tcp_url()}
    drives = tuple(DriveConfig(name, url, Window()) for name, url in urls.items())
    with driving(*urls.values()), Service(Config(drives, captures=tmp_path)) as service:
        until(lambda: all(service.link(name).identity is not None for name in urls), "both links")
        until(lambda: service.link("spindle").rows > 0, "the stream")
        first = ask(service, **NEVER)
        with pytest.raises(ConflictError, match=f"drive alias's recorder takes one writer .* capture {first.id} holds"):
            service.captures.ask("alias", {})


def test_a_refusal_comes_before_the_wire(service: Service, drive: Served) -> None:
    number = drive.drive.read("capture_number")
    with pytest.raises(LimitError, match="length: "):
        ask(service, length=65_537)
    assert drive.drive.read("capture_number") == number
    assert service.writer("spindle") is None
    assert service.captures.all("spindle") == []


def test_an_unknown_capture_is_told_with_the_latest(service: Service) -> None:
    with pytest.raises(UnknownError, match="drive spindle has no capture 'latest'; there is none"):
        service.captures.one("spindle", "latest")
    id_ = ask(service, length=10).id
    reached(service, State.DONE)
    with pytest.raises(UnknownError, match=f"drive spindle has no capture 'x'; the latest is {id_}"):
        service.captures.one("spindle", "x")


def test_a_drive_without_a_recorder_is_said(tmp_path: Path) -> None:
    faults = Faults([parse_fault("refuse=0x2400")])
    with served(tcp_url(), faults=faults) as drive, running(drive.url, tmp_path) as service:
        with pytest.raises(RefusedError, match=r"drive spindle has no recorder: node 5 .* to 0x2400:19"):
            ask(service)
        assert service.writer("spindle") is None
        assert service.captures.all("spindle") == []


def test_a_drive_that_is_not_there_is_said(tmp_path: Path) -> None:
    with (
        Service(Config((DriveConfig("spindle", tcp_url(), Window()),), captures=tmp_path)) as service,
        pytest.raises(LostError, match="there is no link to drive spindle"),
    ):
        ask(service)


def test_a_folder_that_cannot_be_is_said_before_anything_is_recorded(drive: Served, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    number = drive.drive.read("capture_number")
    with (
        running(drive.url, tmp_path / "file" / "captures") as service,
        pytest.raises(UnavailableError, match=r"^the folder of captures cannot be written: Not a directory$"),
    ):
        ask(service)
    assert drive.drive.read("capture_number") == number


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS.keys())
def test_an_upload_goes_on_where_it_was_when_the_link_comes_back(way: Way, tmp_path: Path) -> None:
    port = free_port()
    with (
        way.serve(way.url(port)), relayed(port) as line, running(way.url(line.port), tmp_path) as service
    ):
        ask(service, length=60_000)
        before = uploading(service, 8192)
        line.cut()
        until(lambda: "it goes on when the link is back: " in service.captures.one("spindle", "latest").reason, "it")
        stood = service.captures.one("spindle", "latest")
        assert before.samples <= stood.samples < 60_000
        line.mend()
        until(lambda: service.captures.one("spindle", "latest").reason == "", "it to go on")
        assert service.captures.one("spindle", "latest").samples >= stood.samples
        done = reached(service, State.DONE)
        assert done.file is not None
        check_by_twin(done.file, 60_000)


def test_an_armed_capture_outlives_its_link(drive: Served, tmp_path: Path) -> None:
    with relayed(int(drive.url.split(":")[2].split("/")[0])) as line, running(bus_url(line.port), tmp_path) as service:
        ask(service, length=500, trigger="command")
        line.cut()
        until(lambda: "when the link is back" in service.captures.one("spindle", "latest").reason, "the loss")
        line.mend()
        until(lambda: "waiting for the command" in service.captures.one("spindle", "latest").reason, "the link")
        streams(service)
        service.captures.trigger("spindle", "latest")
        reached(service, State.DONE)


def test_a_drive_that_resets_in_between_has_lost_its_capture_and_what_was_uploaded_is_kept_as_partial(
    tmp_path: Path
) -> None:
    with brisk(tcp_url()) as drive, running(drive.url, tmp_path) as service:
        ask(service, length=60_000)
        uploading(service, 8192)
        drive.drive.reset()
        status = reached(service, State.FAILED)
        assert status.reason.startswith("the drive no longer has recording ")
        assert status.reason.endswith(f"; the first {status.samples} of 60000 samples are kept")
        partial = tmp_path / f"{status.id}.partial.parquet"
        assert status.file == partial
        assert list(tmp_path.iterdir()) == [partial]
        recording = read_recording(partial)
        assert len(recording.runs[0]) == status.samples >= 8192
        assert recording.summary.remarks() == (f"the recording is partial: {status.samples} of 60000 rows",)
        until(lambda: service.writer("spindle") is None, "the lease")
        ask(service, **NEVER)
        until(lambda: drive.drive.read("capture_state") == 1.0, "it to be armed")
        drive.drive.reset()
        assert reached(service, State.FAILED).reason.startswith("the drive no longer has recording 1, it has ")


def test_a_recording_that_another_client_begins_after_a_reset_is_not_taken_for_ours(tmp_path: Path) -> None:
    with (
        brisk(tcp_url()) as drive, relayed(int(drive.url.split(":")[2].split("/")[0])) as line,
        running(bus_url(line.port), tmp_path) as service,
    ):
        until(lambda: drive.drive.tick > 20_000, "time to pass")
        ask(service, length=100, trigger="command")
        line.cut()
        drive.drive.reset()
        until(lambda: drive.drive.resets == 1, "the reset")
        with connect(drive.url) as other:
            setup = replace(Request.of({}).setup, length=100)
            assert capture.arm(other, setup) == 1  # the numbers begin anew
            capture.awaited(other, setup, PATIENCE)
        line.mend()
        status = reached(service, State.FAILED)
        assert status.reason.startswith("the drive no longer has recording 1, ")
        assert list(tmp_path.iterdir()) == []


def test_another_client_that_stops_the_recorder_is_said(service: Service, drive: Served) -> None:
    ask(service, **NEVER)
    drive.drive.write("capture_command", 0.0)
    assert reached(service, State.FAILED).reason == (
        "another client has stopped the recorder before the recording was complete"
    )


def test_a_second_service_on_the_same_folder_leaves_an_upload_under_way_alone(drive: Served, tmp_path: Path) -> None:
    with running(drive.url, tmp_path) as service:
        id_ = ask(service, length=60_000).id
        uploading(service)
        with Service(Config((DriveConfig("spindle", drive.url, Window()),), captures=tmp_path)) as second:
            assert second.captures.all("spindle") == []
        done = reached(service, State.DONE, id_)
        path = tmp_path / f"{id_}.parquet"
        assert done.file == path
        check_by_twin(path, 60_000)


def test_a_service_that_ends_leaves_no_recorder_armed(drive: Served, tmp_path: Path) -> None:
    with running(drive.url, tmp_path) as service:
        ask(service, **NEVER)
        until(lambda: drive.drive.read("capture_state") == 1.0, "it to be armed")
    assert service.captures.one("spindle", "latest").state is State.CANCELLED
    assert service.captures.one("spindle", "latest").reason == "the service has ended"
    until(lambda: drive.drive.read("capture_state") == 0.0, "the recorder to stop")


def test_an_upload_that_a_service_left_goes_on_in_the_next(drive: Served, tmp_path: Path) -> None:
    with running(drive.url, tmp_path) as service:
        id_ = ask(service, length=60_000).id
        uploading(service, 8192)
    stood = service.captures.one("spindle", id_)
    assert stood.state is State.UPLOADING
    assert stood.reason == "the service has ended; it goes on when the service runs again"
    assert [path.name for path in tmp_path.iterdir()] == [f"{id_}.part"]  # nothing that looks complete
    with (tmp_path / f"{id_}.part").open("ab") as part:
        part.write(b"\0" * 5)  # as a write cut short leaves it
    with running(drive.url, tmp_path) as service:
        assert service.captures.one("spindle", id_).samples >= stood.samples
        assert service.captures.one("spindle", id_).asked == stood.asked
        done = reached(service, State.DONE, id_)
        assert [path.name for path in tmp_path.iterdir()] == [f"{id_}.parquet"]
        assert done.file is not None
        check_by_twin(done.file, 60_000)


def test_what_a_service_left_and_the_drive_no_longer_has_is_kept_as_partial(tmp_path: Path) -> None:
    with brisk(tcp_url()) as drive:
        with running(drive.url, tmp_path) as service:
            id_ = ask(service, length=60_000).id
            uploading(service, 4096)
        drive.drive.reset()
        until(lambda: drive.drive.resets == 1, "the reset")
        with running(drive.url, tmp_path) as service:
            status = reached(service, State.FAILED, id_)
            assert 4096 <= status.samples < 60_000
            assert [path.name for path in tmp_path.iterdir()] == [f"{id_}.partial.parquet"]


def heading(id_: str, drive: str, url: str) -> Heading:
    asked, request = "2026-01-31T12:00:00+00:00", Request(("i_d",), 60_000).as_json()
    return Heading(id_, drive, url, "x", asked, request, 1e-4, {}, 1, 2, 3, 60_000)


def left(folder: Path, heading: Heading, samples: bytes = b"123456") -> Path:
    """A part file as a service leaves it."""
    part = CapturePart.begun(folder / f"{heading.id}.part", heading)
    part.keep(bytearray(samples), len(samples))
    part.close()
    return part.path


def test_part_files_of_other_drives_are_left_alone(drive: Served, tmp_path: Path) -> None:
    left(tmp_path, heading("a-1", "a", drive.url))
    left(tmp_path, heading("spindle-1", "spindle", "canopen://socketcan/can0/5"))
    left(tmp_path, replace(heading("c-1", "a", drive.url), drive=["spindle"]))  # pyright: ignore[reportArgumentType]
    for name, content in (("b.part", b"{}\n"), ("c.part", b""), ("d.part", b"\xff[\n"), ("g.part", b"[" * 100_000)):
        (tmp_path / name).write_bytes(content)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "h.part").mkdir()
    os.mkfifo(tmp_path / "i.part")
    with running(drive.url, tmp_path) as service:
        assert service.captures.all("spindle") == []
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'{"id": 1}\n123456', "is of an earlier version, without checksums: .* left as it is"),
        (b"", "is damaged at its beginning, and is left as it is"),
        (b"pmsm-bench part 2\n" + b"\0" * 8192, "is damaged in its heading, and is left as it is"),
    ],
)
def test_a_part_file_that_cannot_be_read_is_said_and_left_as_it_is(
    drive: Served, tmp_path: Path, content: bytes, said: str
) -> None:
    id_ = "spindle-20260131-120000-000"
    path = tmp_path / f"{id_}.part"
    path.write_bytes(content)
    with running(drive.url, tmp_path) as service:
        (status,) = service.captures.all("spindle")
        assert (status.id, status.state) == (id_, State.FAILED)
        assert re.fullmatch(f"{id_}.part {said}", status.reason)
    assert path.read_bytes() == content


@pytest.mark.parametrize("damage", ["zeros", "bit", "cut"])
def test_what_a_power_cut_has_damaged_of_an_upload_is_taken_again_from_the_drive(
    drive: Served, tmp_path: Path, damage: str
) -> None:
    with running(drive.url, tmp_path) as service:
        id_ = ask(service, length=60_000).id
        uploading(service, 8192)
    path = tmp_path / f"{id_}.part"
    content = bytearray(path.read_bytes())
    if damage == "zeros":
        content[-8192:] = bytes(8192)
    elif damage == "bit":
        content[-20_000] ^= 4
    else:
        del content[-5000:]
    path.write_bytes(content)
    with running(drive.url, tmp_path) as service:
        done = reached(service, State.DONE, id_)
        assert done.file is not None
        check_by_twin(done.file, 60_000)
    assert [found.name for found in tmp_path.iterdir()] == [f"{id_}.parquet"]


def test_of_a_damaged_upload_that_the_drive_no_longer_has_the_sound_part_is_kept_and_the_rest_beside_it(
    tmp_path: Path
) -> None:
    with brisk(tcp_url()) as drive:
        with running(drive.url, tmp_path) as service:
            id_ = ask(service, length=60_000).id
            stood = uploading(service, 8192).samples
        drive.drive.reset()
        until(lambda: drive.drive.resets == 1, "the reset")
        path = tmp_path / f"{id_}.part"
        content = path.read_bytes()[:-8192] + bytes(8192)
        path.write_bytes(content)
        with running(drive.url, tmp_path) as service:
            status = reached(service, State.FAILED, id_)
            assert 0 < status.samples < 60_000
            assert status.file is not None
            check_by_twin(status.file, status.samples)
    assert (tmp_path / f"{id_}.damaged").read_bytes() == content
    assert stood > 0


@contextmanager
def killed(service: Service) -> Generator[None]:
    """A service that ends as one that is killed does: it writes and says nothing more."""
    (run,) = service.captures._runs.values()
    run._left = lambda: None
    yield
    assert not service.captures._runs


@pytest.mark.parametrize("trigger", ["command", "now"])
def test_a_capture_that_a_killed_service_left_in_the_drive_is_taken_up_again(
    drive: Served, tmp_path: Path, trigger: str
) -> None:
    with contextlib.ExitStack() as after:
        with running(drive.url, tmp_path) as service:
            id_ = ask(service, length=2000, trigger=trigger).id
            after.enter_context(killed(service))
        (path,) = tmp_path.iterdir()
        assert path.name == f"{id_}.part"
    assert drive.drive.read("capture_state") in (1.0, 2.0, 3.0)
    with running(drive.url, tmp_path) as service:
        if trigger == "command":
            until(lambda: "waiting for the command" in service.captures.one("spindle", id_).reason, "waiting")
            service.captures.trigger("spindle", id_)
        done = reached(service, State.DONE, id_)
        assert done.file is not None
        check_by_twin(done.file, 2000)
    assert [found.name for found in tmp_path.iterdir()] == [f"{id_}.parquet"]


def test_a_capture_that_a_killed_service_left_and_the_drive_no_longer_has_is_said(tmp_path: Path) -> None:
    with brisk(tcp_url()) as drive:
        with contextlib.ExitStack() as after, running(drive.url, tmp_path) as service:
            until(lambda: drive.drive.tick > 20_000, "time to pass")
            id_ = ask(service, **NEVER).id
            after.enter_context(killed(service))
        drive.drive.reset()
        until(lambda: drive.drive.resets == 1, "the reset")
        with running(drive.url, tmp_path) as service:
            status = reached(service, State.FAILED, id_)
            assert status.reason.startswith("the drive no longer has recording 1, it has ")
    assert list(tmp_path.iterdir()) == []


def test_how_long_the_trigger_of_a_capture_that_was_left_is_waited_for_goes_by_the_drives_clock(
    drive: Served, tmp_path: Path
) -> None:
    with contextlib.ExitStack() as after, running(drive.url, tmp_path) as service:
        id_ = ask(service, **NEVER, timeout_s=100.0).id
        after.enter_context(killed(service))
    part = CapturePart.found(tmp_path / f"{id_}.part")
    assert part is not None
    with contextlib.closing(part):
        part.change(replace(part.heading, asked="2001-01-01T00:00:00+00:00"))  # as where the bench's clock has been set
    with running(drive.url, tmp_path) as service:
        until(lambda: "waiting for" in service.captures.one("spindle", id_).reason, "waiting")
        assert service.captures.one("spindle", id_).state is State.ARMED
        service.captures.cancel("spindle", id_)


def test_a_capture_whose_recorder_was_never_armed_is_said(drive: Served, tmp_path: Path) -> None:
    left(tmp_path, replace(heading("spindle-1", "spindle", drive.url), number=0, count=None), b"")
    with running(drive.url, tmp_path) as service:
        (status,) = service.captures.all("spindle")
        assert (status.state, status.reason) == (
            State.FAILED, "the service ended before the drive's recorder was armed"
        )
    assert list(tmp_path.iterdir()) == []


def test_without_room_for_the_recording_nothing_is_armed(
    service: Service, drive: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = drive.drive.read("capture_number")
    monkeypatch.setattr("bench.files._BESIDES", 10**18)
    with pytest.raises(UnavailableError, match=r"^the capture cannot be kept on disk: expected .* MB for 10000 "):
        ask(service)
    assert drive.drive.read("capture_number") == number
    assert list(tmp_path.iterdir()) == []
    assert service.writer("spindle") is None


def test_one_under_way_is_the_latest_though_the_clock_has_been_set_back_since_others(service: Service) -> None:
    ahead = Status("ahead", "spindle", Request(), datetime(2099, 1, 31, tzinfo=UTC), State.DONE)
    one = ask(service, **NEVER)
    service.captures.remember([ahead])
    assert service.captures.latest("spindle") == service.captures.one("spindle", "latest")
    assert service.captures.one("spindle", "latest").id == one.id
    service.captures.cancel("spindle", "latest")
    assert service.captures.one("spindle", "latest") == ahead


def test_only_so_many_captures_are_remembered(service: Service) -> None:
    service.captures.remembered = 3
    asked = list[str]()
    for _ in range(5):
        asked.append(ask(service, length=5).id)
        reached(service, State.DONE, asked[-1])
    assert [status.id for status in service.captures.all("spindle")] == asked[:1:-1]


def test_a_lost_link_is_waited_for_no_longer_than_it_is_worth(
    drive: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.actions.capture.LINK_PATIENCE", 0.5)
    with relayed(int(drive.url.split(":")[2].split("/")[0])) as line, running(bus_url(line.port), tmp_path) as service:
        ask(service, length=60_000)
        uploading(service)
        line.cut()
        status = reached(service, State.FAILED)
        assert status.reason.startswith("it could not go on for 0.5 s: ")
        assert f"the first {status.samples} of 60000 samples are kept" in status.reason


def test_a_recording_is_kept_under_another_name_where_its_own_is_taken(service: Service, tmp_path: Path) -> None:
    id_ = ask(service, length=500, trigger="command").id
    names = [f"{id_}.parquet", f"{id_}-1.parquet"]
    for name in names:
        (tmp_path / name).write_text(f"another's {name}")
    service.captures.trigger("spindle", id_)
    status = reached(service, State.DONE)
    kept = tmp_path / f"{id_}-2.parquet"
    assert status.file == kept
    check_by_twin(kept, 500)
    assert [(tmp_path / name).read_text() for name in names] == [f"another's {name}" for name in names]
    assert len(list(tmp_path.iterdir())) == 3


def test_an_earlier_partial_recording_is_not_written_over(tmp_path: Path) -> None:
    with brisk(tcp_url()) as drive, running(drive.url, tmp_path) as service:
        id_ = ask(service, length=60_000).id
        (tmp_path / f"{id_}.partial.parquet").write_text("precious")
        uploading(service)
        drive.drive.reset()
        assert reached(service, State.FAILED).file == tmp_path / f"{id_}-1.partial.parquet"
        assert (tmp_path / f"{id_}.partial.parquet").read_text() == "precious"


def test_a_capture_writes_over_no_part_file_and_removes_its_own_alone(drive: Served, tmp_path: Path) -> None:
    (tmp_path / "x.part").write_text("another's")
    part = CapturePart.begun(tmp_path / "x.part", heading("x", "spindle", drive.url))
    assert part.path == tmp_path / "x-1.part"
    part.remove()
    assert [path.name for path in tmp_path.iterdir()] == ["x.part"]
    assert (tmp_path / "x.part").read_text() == "another's"


def test_a_recording_that_another_client_stops_half_way_is_partial(
    service: Service, drive: Served, tmp_path: Path
) -> None:
    id_ = ask(service, length=50_000, decimation=10).id
    reached(service, State.TRIGGERED)
    drive.drive.write("capture_command", 0.0)
    status = reached(service, State.FAILED)
    assert 0 < status.samples < 50_000
    assert status.reason == (
        "another client has stopped the recorder before the recording was complete; "
        f"the first {status.samples} of 50000 samples are kept"
    )
    partial = tmp_path / f"{id_}.partial.parquet"
    assert status.file == partial
    assert list(tmp_path.iterdir()) == [partial]
    told = notes(partial)
    assert (told["samples"], told["expected"], told["complete"]) == (status.samples, 50_000, False)


def remembered(service: Service, captures: int) -> list[Status]:
    until(lambda: len(service.captures.all("spindle")) == captures, "what was before")
    return service.captures.all("spindle")


@pytest.mark.parametrize("database", ["catalogue.sqlite", ""])
def test_what_has_ended_is_there_after_a_restart_as_it_was(drive: Served, tmp_path: Path, database: str) -> None:
    """Without a catalogue those that made a recording, of which it tells."""
    config = Config(
        (DriveConfig("spindle", drive.url, Window()),), captures=tmp_path / "captures",
        database=database and str(tmp_path / database),
    )  # fmt: skip
    with Service(config) as service:
        streams(service)
        whole = ask(service, length=500)
        until(lambda: service.captures.one("spindle", whole.id).state is State.DONE, "its end")
        late = ask(service, **NEVER, timeout_s=0.1)
        until(lambda: service.captures.one("spindle", late.id).state is State.FAILED, "its end")
        cancelled = ask(service, **NEVER)
        service.captures.cancel("spindle", cancelled.id)
        before = service.captures.all("spindle")
    assert [status.state for status in before] == [State.CANCELLED, State.FAILED, State.DONE]
    with Service(config) as service:
        assert remembered(service, 3 if database else 1) == (before if database else before[2:])
        assert service.captures.one("spindle", whole.id) == before[2]
        assert service.captures.file("spindle", whole.id).is_file()
        if database:
            assert service.captures.one("spindle", cancelled.id).state is State.CANCELLED
            with pytest.raises(ConflictError, match="there is nothing to cancel"):
                service.captures.cancel("spindle", late.id)
