"""Recordings of a drive's stream as a service keeps them: what the drive made, with gaps, triggers, limits."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest

from bench.actions import recording
from bench.actions.recording import State, Status
from bench.config import Config, DriveConfig
from bench.errors import ConflictError, LimitError, UnavailableError
from bench.live.window import Window
from bench.recordings.table import notes
from bench.service.service import Service
from bench.store.segments import path_of
from bench.store.shelf import Recording
from tests.conftest import bus_url
from tests.support.recordings import read_recording
from tests.support.relay import relayed
from tests.support.served_drive import Served, served, tcp_url, until
from tests.support.transports import modbus_tcp_url, serial_socket_url

pytestmark = pytest.mark.live

LINKS = {"canopen": tcp_url, "modbus": modbus_tcp_url, "uart": serial_socket_url}


@contextmanager
def running(url: str, folder: Path, **config: Any) -> Generator[Service]:
    """A service over one drive called `spindle`, which streams."""
    with Service(Config((DriveConfig("spindle", url, Window()),), captures=folder, **config)) as service:
        until(lambda: service.link("spindle").rows > 0, "rows")
        yield service


@pytest.fixture
def drive() -> Iterator[Served]:
    with served(tcp_url()) as one:
        yield one


@pytest.fixture
def service(drive: Served, tmp_path: Path) -> Iterator[Service]:
    with running(drive.url, tmp_path) as one:
        yield one


def ask(service: Service, **given: Any) -> Status:
    return service.recordings.ask("spindle", given, "me")


def now(service: Service, id_: str) -> Status:
    status = service.recordings.find(id_)
    assert status is not None
    return status


def ended(service: Service, id_: str) -> Status:
    until(lambda: now(service, id_).state.ended, "its end")
    return now(service, id_)


def done(service: Service, id_: str) -> Recording:
    status = ended(service, id_)
    assert status.state is State.DONE, status
    return service.shelf.one(id_)


def recorded(service: Service, id_: str, rows: int) -> None:
    until(lambda: now(service, id_).rows >= rows, "rows on disk")


def check_as_made(path: Path, drive: Served) -> list[tuple[int, int]]:
    """Each run is rows that the drive made, one after the other, within half a count; which ones."""
    steps, made, found = notes(path)["steps"], drive.produced(), list[tuple[int, int]]()
    for run in read_recording(path).runs:
        i_q, n = made["i_q"], len(run)
        starts = np.flatnonzero(np.abs(i_q[: len(i_q) - n + 1] - run.i_q[0]) <= 0.51 * steps["i_q"]).tolist()
        at = [k for k in starts if np.abs(i_q[k : k + n] - run.i_q).max() <= 0.51 * steps["i_q"]]
        assert len(at) == 1
        for name in ("i_d", "u_d", "u_q"):
            assert np.abs(getattr(run, name) - made[name][at[0] : at[0] + n]).max() <= 0.51 * steps[name], name
        found.append((at[0], at[0] + n))
    return found


@pytest.mark.parametrize("link", LINKS)
def test_a_recording_is_every_row_that_the_drive_made_meanwhile(link: str, tmp_path: Path) -> None:
    with served(LINKS[link]()) as drive, running(drive.url, tmp_path) as service:
        id_ = ask(service, title="warm").id
        recorded(service, id_, 500)
        with pytest.raises(ConflictError, match=f"drive spindle is recorded already: {id_}"):
            ask(service)
        service.recordings.mark(now(service, id_), "here", "me")
        service.recordings.stop(now(service, id_), "me")
        one = done(service, id_)
        assert (one.title, one.ended, one.gaps, one.whole) == ("warm", "stopped by me", 0, True)
        assert [mark.text for mark in one.marks] == ["here"]
        assert one.rows == now(service, id_).rows >= 500
        check_as_made(one.path, drive)
        told = notes(one.path)
        assert told["device"].startswith("pmsm-bench virtual drive")
        (parameters,) = [event["values"] for event in told["events"] if event["what"] == "parameters"]
        assert parameters["n_p"] == 4.0
        assert told["window"]["length"] == 1000
        assert {path.name for path in tmp_path.iterdir()} == {one.path.name}


def test_it_ends_by_itself_after_its_time(service: Service) -> None:
    id_ = ask(service, seconds=0.35).id
    one = done(service, id_)
    assert (one.rows, one.seconds, one.ended) == (350, pytest.approx(0.35), "its 0.35 s are over")


def test_it_ends_by_itself_at_its_size(service: Service) -> None:
    id_ = ask(service, megabytes=0.1).id
    status = ended(service, id_)
    assert status.reason == "its 0.1 MB are full"
    assert service.shelf.one(id_).whole


def test_a_trigger_keeps_what_was_before_it(service: Service) -> None:
    service.write_signals("spindle", {"i_q_ref": 0.0, "i_q_step": 1.0})
    time.sleep(0.1)
    id_ = ask(service, trigger="i_q > 2.5", pre_trigger_s=0.4, seconds=0.2).id
    time.sleep(0.6)
    assert (now(service, id_).state, now(service, id_).rows) == (State.ARMED, 0)
    assert now(service, id_).reason == "waiting for i_q rising through 2.5"
    with pytest.raises(ConflictError, match="is armed, there is nothing to mark"):
        service.recordings.mark(now(service, id_), "x", "")
    service.write_signals("spindle", {"i_q_ref": 3.0, "i_q_step": 2.0})
    one = done(service, id_)
    (run,) = read_recording(one.path).runs
    (trigger,) = [event["t"] for event in notes(one.path)["events"] if event["what"] == "trigger"]
    assert trigger == pytest.approx(0.4, abs=2e-3)
    assert one.seconds == pytest.approx(0.6, abs=2e-3)
    k = round((trigger - run.t0) / run.T)
    assert run.i_q[k] >= 2.5 > run.i_q[k - 1]
    assert run.i_q[:k].max() < 2.5


def test_a_trigger_that_does_not_come_is_given_up(service: Service, tmp_path: Path) -> None:
    status = ended(service, ask(service, trigger="i_q > 20", timeout_s=0.3).id)
    assert status.state is State.FAILED
    assert status.reason == "the trigger, i_q rising through 20, has not come within 0.3 s"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("hours", [-1, 1])
def test_a_clock_that_is_set_does_not_change_how_long_a_trigger_is_waited_for(
    service: Service, monkeypatch: pytest.MonkeyPatch, hours: int
) -> None:
    class Set(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> Self:
            return super().now(tz) + timedelta(hours=hours)

    id_ = ask(service, trigger="i_q > 20", timeout_s=1.5).id
    monkeypatch.setattr(recording, "datetime", Set)
    time.sleep(0.6)
    assert now(service, id_).state is State.ARMED
    assert ended(service, id_).reason == "the trigger, i_q rising through 20, has not come within 1.5 s"


def test_what_is_discarded_leaves_nothing(service: Service, tmp_path: Path) -> None:
    id_ = ask(service).id
    recorded(service, id_, 100)
    service.recordings.discard(now(service, id_))
    assert now(service, id_).state is State.CANCELLED
    assert list(tmp_path.iterdir()) == []


def test_a_lost_link_is_a_gap_that_is_told(tmp_path: Path) -> None:
    with (
        served(tcp_url()) as drive, relayed(int(drive.url.split(":")[2].split("/")[0])) as relay,
        running(bus_url(relay.port), tmp_path) as service,
    ):
        id_ = ask(service).id
        recorded(service, id_, 300)
        relay.cut()
        until(lambda: service.link("spindle").state == "lost", "the loss")
        relay.mend()
        rows = now(service, id_).rows
        recorded(service, id_, rows + 300)
        service.recordings.stop(now(service, id_), "")
        one = done(service, id_)
        assert one.gaps >= 1
        assert one.rows_lost > 0
        check_as_made(one.path, drive)
        (gap, *_) = [event for event in notes(one.path)["events"] if event["what"] == "gap"]
        summary = read_recording(one.path).summary
        assert summary.lost_rows == one.rows_lost
        assert gap["t"] > 0.0
        told = [event["state"] for event in notes(one.path)["events"] if event["what"] == "drive"]
        assert "link lost" in told


def test_a_drive_that_has_reset_goes_on_by_the_benchs_clock(drive: Served, service: Service) -> None:
    id_ = ask(service).id
    recorded(service, id_, 300)
    drive.drive.reset()
    rows = now(service, id_).rows
    recorded(service, id_, rows + 800)
    service.recordings.stop(now(service, id_), "")
    one = done(service, id_)
    events = [event for event in notes(one.path)["events"] if event["what"] == "clock reset"]
    assert len(events) == 1
    recording = read_recording(one.path)
    assert len(recording.runs) >= 2
    assert recording.summary.irregular_steps == 0


def test_rows_of_another_length_go_on_in_another_recording(drive: Served, service: Service) -> None:
    first = ask(service, title="a").id
    recorded(service, first, 200)
    service.write_signals("spindle", {"stream_periods": 20.0})
    assert "rows have become 20 control periods long, from 10" in done(service, first).ended
    until(lambda: service.recordings.under_way("spindle") is not None, "the next one")
    second = service.recordings.under_way("spindle")
    assert second is not None
    assert second.continues == first
    recorded(service, second.id, 200)
    service.recordings.stop(second, "")
    one = done(service, second.id)
    assert one.title == "a"
    assert read_recording(one.path).summary.periods == 20
    ends, begins = check_as_made(service.shelf.one(first).path, drive), check_as_made(one.path, drive)
    made = drive.produced()["row_tick"]
    lost = re.search(r"; (\d+) of the new ones are lost", service.shelf.one(first).ended)
    between = made[begins[0][0]] - made[ends[-1][1] - 1] - 10  # control periods
    assert between <= 20 * int(lost[1] if lost else 0)  # the link's: no row that came is lost


def test_what_cannot_be_recorded_is_refused(service: Service, tmp_path: Path) -> None:
    for given, said in (
        ({"trigger": "i_a > 2"}, "trigger: the stream has theta_e"),
        ({"trigger": "sometime"}, 'trigger: expected "now", "i_q > 2.0" or'),
        ({"pre_trigger_s": 1.0}, "expected a trigger"),
        ({"seconds": -1.0}, "seconds: expected a number of 0.01"),
        ({"title": "x" * 201}, "title: expected a text of at most 200 characters"),
        ({"length": 3}, "got 'length'"),
    ):
        with pytest.raises(LimitError) as refused:
            ask(service, **given)
        assert said in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_it_is_closed_when_the_service_ends(drive: Served, tmp_path: Path) -> None:
    with running(drive.url, tmp_path) as service:
        id_ = ask(service).id
        recorded(service, id_, 300)
    assert now(service, id_).state is State.DONE
    assert service.shelf.one(id_).ended == "the service ended"
    assert service.shelf.one(id_).whole


def test_what_a_service_left_the_next_one_closes(drive: Served, tmp_path: Path) -> None:
    with running(drive.url, tmp_path) as service:
        id_ = ask(service).id
        recorded(service, id_, 300)
        left = path_of(tmp_path, id_, 1).read_bytes()
    for path in tmp_path.iterdir():
        path.unlink()
    path_of(tmp_path, id_, 1).write_bytes(left[:-3])
    with running(drive.url, tmp_path) as service:
        until(lambda: any(one.id == id_ for one in service.shelf.all()), "the recording")
        one = service.shelf.one(id_)
        assert one.ended.startswith("the bench was killed, or the power failed. the last ")
        assert not one.whole
        assert one.rows > 0
        check_as_made(one.path, drive)
        assert not path_of(tmp_path, id_, 1).exists()


@pytest.mark.slow
def test_what_a_killed_service_recorded_is_there_but_for_the_last_second() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "tests.bars.bench_recordings", "--count", "3", "--link", "canopen"], capture_output=True,
        text=True, check=False, timeout=300.0,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A disk of its own, of 2 MB."""
    folder = tmp_path / "small"
    folder.mkdir()
    if os.geteuid() or shutil.which("mount") is None:
        pytest.skip("a small disk is mounted by root alone")
    done_ = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", folder], capture_output=True, text=True, check=False
    )
    if done_.returncode:
        pytest.skip(f"no small disk can be mounted: {done_.stderr.strip()}")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_full_disk_ends_it_and_what_was_there_is_closed_when_there_is_room(drive: Served, small: Path) -> None:
    with running(drive.url, small, keep_free_megabytes=0.0) as service:
        ballast = small / "ballast"
        id_ = ask(service).id
        recorded(service, id_, 300)
        with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
        until(lambda: now(service, id_).state is not State.RECORDING, "its end")
        status = now(service, id_)
        assert status.state is State.CLOSING
        until(lambda: "it is closed when there is room" in now(service, id_).reason, "the reason")
        assert "nearly full" in status.reason or "No space left" in status.reason
        assert service.link("spindle").state == "streaming"
        rows = now(service, id_).rows
        ballast.unlink()
        one = done(service, id_)
        assert one.rows >= rows
        assert one.whole
        check_as_made(one.path, drive)


def test_a_disk_without_room_is_told_before_anything_is_recorded(drive: Served, small: Path) -> None:
    with running(drive.url, small, keep_free_megabytes=0.0) as service:
        (small / "ballast").write_bytes(bytes(1_900_000))
        with pytest.raises(UnavailableError, match="the disk is nearly full: expected 1 MB free"):
            ask(service)
        assert service.recordings.known() == []
        (small / "ballast").unlink()
    with running(drive.url, small, keep_free_megabytes=100.0) as service:
        with pytest.raises(UnavailableError, match="the disk is nearly full: expected 101 MB free"):
            ask(service)
        room = service.room_for("spindle")
        assert (room.free_bytes, room.days) == (0.0, 0.0)
        assert room.bytes_per_day == pytest.approx(40.0 * 86_400.0 * 1000.0)


def test_a_folder_that_cannot_be_written_is_told(drive: Served, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    config = Config((DriveConfig("spindle", drive.url, Window()),), captures=tmp_path / "file" / "captures")
    with Service(replace(config)) as service:
        until(lambda: service.link("spindle").rows > 0, "rows")
        with pytest.raises(UnavailableError, match="the folder of captures cannot be written"):
            ask(service)
