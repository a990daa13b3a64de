"""Flashes by the service: over its own link while it streams, under its lease, whatever comes between."""

import contextlib
import subprocess
import threading
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from bench.actions.flashes import State, Status
from bench.actions.safety.unfinished import Noted, Origin
from bench.config import Config, drive_of
from bench.errors import ConflictError, LimitError, UnavailableError
from bench.machine_file import Nominal
from bench.parameters import flash
from bench.parameters.link import OwnLink
from bench.parameters.parameter_set import Entry, ParameterSet, set_of
from bench.parameters.plan import different
from bench.service.service import Service
from drivers.connect import connect
from drivers.errors import DriveError, RefusedError
from drivers.lease import Controlled, Lease
from tests.conftest import COMMAND
from tests.support.served_drive import emulator, ready, tcp_url, until
from tests.support.transports import modbus_pty_url, modbus_tcp_url, serial_socket_url

pytestmark = pytest.mark.live

LINKS: dict[str, Callable[[], str]] = {
    "canopen": tcp_url, "modbus+tcp": modbus_tcp_url, "modbus+rtu": modbus_pty_url, "uart": serial_socket_url,
}
SLOWER = set_of({"bandwidth": 900.0}, "slower", "")
NEW = set_of({"bandwidth": 800.0} | {f"psi_d_table_{k}": 1e-3 * k for k in range(1, 65)}, "new", "")


@dataclass(frozen=True)
class Bench:
    """A service's configuration over one emulated drive, called x, in a process of its own."""

    config: Config
    url: str

    @contextlib.contextmanager
    def serving(self) -> Generator[Service]:
        """The service, with a link that streams."""
        with Service(self.config) as service:
            until(lambda: service.link("x").rows > 100, "rows")
            yield service


@contextlib.contextmanager
def over(url: str, folder: Path) -> Generator[Bench]:
    drive = drive_of("x", url, Nominal({}), {"i_max": 6.0})
    with emulator("--at", url, "--memory", str(folder / "memory"), control="lease") as process:
        ready(process)
        yield Bench(Config(
            (drive,), captures=folder / "captures", journals=folder / "data" / "pmsm-bench" / "flash",
            log=folder / "log", database=str(folder / "catalogue.sqlite"),
        ), url)  # fmt: skip


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with over(tcp_url(), tmp_path) as made:
        yield made


def ended(service: Service, status: Status) -> Status:
    until(lambda: service.flashes.one("x", status.id).state is not State.RUNNING, "the flash to end")
    return service.flashes.one("x", status.id)


def values(service: Service) -> dict[str, float]:
    """As the drive has them, as soon as its link is there."""
    found = list[ParameterSet]()

    def read() -> bool:
        with contextlib.suppress(DriveError):
            found.append(service.flashes.present("x", "now"))
        return bool(found)

    until(read, "the drive's values")
    return found[0].values


def value(service: Service, name: str = "bandwidth") -> float:
    return values(service)[name]


def events(service: Service, kind: str) -> list[str]:
    """The newest first."""
    assert service.history is not None
    memory = service.history.open()
    assert memory is not None
    return [one.sentence for one in memory.chronicle.page("x", kind, None, 50)[0]]


@pytest.mark.parametrize("link", LINKS)
def test_it_is_done_while_the_drive_streams_whose_gap_is_counted(link: str, tmp_path: Path) -> None:
    with over(LINKS[link](), tmp_path) as bench, bench.serving() as service:
        done = ended(service, service.flashes.ask("x", SLOWER, "somebody"))
        assert (done.state, done.progress) == (State.FLASHED, 1.0), done.said
        assert [step.said for step in done.steps] == ["writing 1 value", "storing", "resetting", "reading back"]
        until(lambda: service.link("x").reconnects == 1, "the stream to come back")
        rows = service.link("x").rows
        until(lambda: service.link("x").rows > rows + 100, "rows")
        assert (service.link("x").gaps, service.link("x").clock_resets) == (1, 1)
        assert (value(service), service.writer("x"), service.flash_on("x")) == (900.0, None, None)
        (one,) = service.flashes.past("x")
        assert (one.begun.name, one.begun.whom, one.begun.drive) == ("slower", "somebody", "x")
        until(lambda: len(events(service, "flash")) == 2, "who flashed, and how it ended")
        assert "asked for from somebody" in events(service, "flash")[1]
        back = ended(service, service.flashes.ask_back("x"))
        assert (back.state, back.begun.name) == (State.FLASHED, "before slower")
        assert value(service) == 1250.0


def test_what_was_before_any_flash_is_had_again_and_limits_do_not_judge_it(bench: Bench) -> None:
    with bench.serving() as service:
        before = values(service)
        less = set_of({"current_limit": 5.0}, "less", "")
        for given in (less, SLOWER):
            assert ended(service, service.flashes.ask("x", given)).state is State.FLASHED
        first = service.flashes.past("x")[-1].begun
        assert set(service.flashes.planned_back("x", first.since).values) == {"current_limit", "bandwidth"}
        assert service.flashes.planned("x", set_of({"current_limit": before["current_limit"]}, "far", "")).problems
        with pytest.raises(ConflictError, match="such as"):
            service.flashes.ask_back("x", since="2026-01-31")
        back = ended(service, service.flashes.ask_back("x", since=first.since))
        assert (back.state, back.begun.name) == (State.FLASHED, "before less")
        assert not different(before, values(service))


def test_a_drive_that_somebody_is_at_is_not_flashed(bench: Bench) -> None:
    with bench.serving() as service:
        service.start_drive("x", {"i_q_ref": 1.0}, "an operator")
        with pytest.raises(ConflictError, match=r"and the operator's control .* holds it"):
            service.flashes.ask("x", SLOWER)
        service.stop_drive("x")
        capture = service.captures.ask("x", {"trigger": "command"})
        with pytest.raises(ConflictError, match="drive x's recorder takes one writer at a time, and capture"):
            service.flashes.ask("x", SLOWER)
        service.captures.cancel("x", capture.id)
        with connect(bench.url) as other, Controlled(other) as held:
            with pytest.raises(RefusedError, match="controls the drive"):
                service.flashes.ask("x", SLOWER)
            held.start()
            with pytest.raises(ConflictError, match="the drive is on"):
                service.flashes.ask("x", SLOWER)
        status = service.flashes.ask("x", SLOWER)
        with pytest.raises(ConflictError, match="takes one writer at a time, and flash x-flash-"):
            service.flashes.ask("x", SLOWER)
        with pytest.raises(ConflictError, match="takes one writer at a time, and flash x-flash-"):
            service.start_drive("x", {})
        assert ended(service, status).state is State.FLASHED
        with pytest.raises(ConflictError, match="no flash of this drive was cut"):
            service.flashes.resume("x", finish=True)


def test_what_a_bench_that_died_has_left_is_undone_before_anything_is_told_or_flashed(bench: Bench) -> None:
    with bench.serving() as service:
        drive, before = service.drive("x").link.drive(), value(service, "k_p_speed")
        Noted(Origin(bench.config.journals, "x", "a trial"), drive, Lease(), {"k_p_speed": before}).close()
        drive.write("k_p_speed", 0.02 * before)
        assert value(service, "k_p_speed") == before
        assert "k_p_speed restored as before" in service.drive("x").undone
        at_work = Noted(Origin(bench.config.journals, "x", "a trial"), drive, Lease(), {"k_p_speed": before})
        for asked in (lambda: service.flashes.present("x", "now"), lambda: service.flashes.ask("x", SLOWER)):
            with pytest.raises(ConflictError, match="another bench on this machine is at work with this drive"):
                asked()
        at_work.undone()
        assert ended(service, service.flashes.ask("x", SLOWER)).state is State.FLASHED


def test_limits_forbid_and_doubts_ask_for_a_reason_before_anything_is_written(bench: Bench) -> None:
    with bench.serving() as service:
        before = values(service)
        far = set_of({"current_limit": 7.0, "bandwidth": 900.0}, "far", "")
        assert service.flashes.planned("x", far).problems[0].startswith("current_limit: currents go up to 6 A")
        with pytest.raises(LimitError, match="got 7 A"):
            service.flashes.ask("x", far)
        doubtful = ParameterSet("doubtful", {"control_R_s": Entry(0.9, status="doubtful")})
        with pytest.raises(LimitError, match="expected a reason"):
            service.flashes.ask("x", doubtful)
        with pytest.raises(LimitError, match="expected a reason of up to 200 characters"):
            service.flashes.ask("x", doubtful, reason="\n")
        assert not different(before, values(service))
        assert ended(service, service.flashes.ask("x", doubtful, "me", "on a test bench")).state is State.FLASHED
        until(lambda: "with the reason 'on a test bench'" in events(service, "flash")[-1], "the reason")


@pytest.mark.parametrize("after", [0.0, 0.03, 0.06, 0.1, 0.15, 0.3])
def test_stop_is_answered_as_ever_and_the_flash_ends_in_a_known_state(bench: Bench, after: float) -> None:
    with bench.serving() as service:
        before = values(service)
        status = service.flashes.ask("x", NEW)
        time.sleep(after)
        begun = time.monotonic()
        service.stop_drive("x", "an operator")
        assert time.monotonic() - begun < 2.0
        assert service.control("x").said == "stopped by an operator"
        done = ended(service, status)
        assert done.state in (State.FLASHED, State.ROLLED_BACK), done.said
        now = values(service)
        assert not different(before | (NEW.values if done.state is State.FLASHED else {}), now)
        assert service.flashes.cut("x") is None


def test_who_stops_all_the_time_is_answered_each_time(bench: Bench) -> None:
    with bench.serving() as service:
        status = service.flashes.ask("x", NEW)
        for _ in range(10):
            service.stop_drive("x")
        done = ended(service, status)
        assert done.state in (State.FLASHED, State.ROLLED_BACK), done.said


@pytest.mark.parametrize("after", [0.02, 0.05, 0.1])
def test_stop_is_answered_while_another_program_flashes(bench: Bench, tmp_path: Path, after: float) -> None:
    ends = list[flash.Verdict]()
    with bench.serving() as service, OwnLink(bench.url) as link:
        before = values(service)
        around = flash.Around(tmp_path / "other", bench.url)
        one = threading.Thread(target=lambda: ends.append(flash.begin(link, NEW, around).forward()))
        one.start()
        until(lambda: any((tmp_path / "other").glob("*.flash.jsonl")), "its journal")
        time.sleep(after)
        begun = time.monotonic()
        service.stop_drive("x")
        assert time.monotonic() - begun < 2.0
        one.join()
        assert ends[0].end in (flash.End.FLASHED, flash.End.ROLLED_BACK), ends
        assert not different(before | (NEW.values if ends[0].end is flash.End.FLASHED else {}), values(service))


def test_a_recording_of_the_stream_goes_on_with_a_gap(bench: Bench) -> None:
    with bench.serving() as service:
        recording = service.recordings.ask("x", {})
        until(lambda: service.recordings.one("x", recording.id).rows > 200, "rows")
        assert ended(service, service.flashes.ask("x", SLOWER)).state is State.FLASHED
        until(lambda: service.recordings.one("x", recording.id).gaps > 0, "the gap")
        rows = service.recordings.one("x", recording.id).rows
        until(lambda: service.recordings.one("x", recording.id).rows > rows, "rows after it")
        service.recordings.stop(recording, "a test")
        until(lambda: service.recordings.one("x", recording.id).state.ended, "its end")
        assert service.recordings.one("x", recording.id).gaps == 1


def cut_at(bench: Bench, folder: Path, step: str) -> None:
    """A command line's flash, killed as soon as it says that."""
    file = folder / "new.toml"
    file.write_text('name = "slower"\n[parameters]\nbandwidth = 900.0\n', encoding="utf-8")
    arguments = ["params", "flash", str(file), bench.url, "--yes"]
    with subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as one:
        assert one.stderr is not None
        for line in one.stderr:
            if line.startswith(step):
                one.kill()


@pytest.mark.parametrize("finish", [True, False])
def test_one_that_a_command_line_has_left_is_told_and_finished_or_rolled_back(
    bench: Bench, tmp_path: Path, finish: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    cut_at(bench, tmp_path, "storing")
    with bench.serving() as service:
        until(lambda: len(events(service, "flash")) == 1, "that it is told")
        assert events(service, "flash")[0].startswith("a flash of 'slower', version 1 was cut, since 20")
        left = service.flashes.cut("x")
        assert left is not None
        assert (left.name, left.drive) == ("slower", bench.url)
        with pytest.raises(ConflictError, match="has to be finished or rolled back first"):
            service.flashes.ask("x", NEW)
        until(lambda: (now := service.control("x").state) is not None and now.held is None, "the lease to run out")
        done = ended(service, service.flashes.resume("x", finish=finish))
        assert done.state is (State.FLASHED if finish else State.ROLLED_BACK), done.said
        assert service.flashes.cut("x") is None
        assert value(service) == (900.0 if finish else 1250.0)


def test_a_service_that_ends_waits_for_a_flash(bench: Bench) -> None:
    with bench.serving() as service:
        status = service.flashes.ask("x", SLOWER)
    assert service.flashes.one("x", status.id).state is State.FLASHED
    assert "x: its flash has ended: flashed" in service.farewell()
    with pytest.raises(UnavailableError, match="the service is ending"):
        service.flashes.ask("x", SLOWER)
    with bench.serving() as service:
        assert (service.flashes.cut("x"), value(service)) == (None, 900.0)
