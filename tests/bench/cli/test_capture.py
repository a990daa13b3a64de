"""`pmsm-bench capture` between real processes: three drives on three buses, the service, the file, its replay."""

import json
import os
import pty
import select
import signal
import subprocess
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from bench.recordings.table import column_names
from drivers.connect import connect
from tests.bench.cli.test_cli import pmsm_bench, refused
from tests.bench.test_end_to_end import TRUTH, within
from tests.conftest import COMMAND, command, free_port, wait_for_answer
from tests.support.recordings import read_recording
from tests.support.served_drive import emulator, ready, tcp_url, until
from tests.support.transports import modbus_tcp_url, pty_url

pytestmark = [pytest.mark.live, pytest.mark.thorough]

BUSES: Mapping[str, Callable[[], str]] = {"canopen": tcp_url, "modbus": modbus_tcp_url, "uart": pty_url}
LEVEL = 2730.5 * 24.0 / 32768.0  # A, between two counts: crossed by the drive, and in the recording
NEVER = ("--trigger", "i_q<-23", "--timeout", "0.1")


@dataclass(frozen=True)
class Bench:
    """A service over three drives, named by their buses."""

    url: str
    drives: Mapping[str, str]  # URLs

    def said(self, drive: str) -> dict[str, Any]:
        """The drive's latest capture."""
        return httpx.get(f"{self.url}/api/drives/{drive}/captures/latest").json()


@pytest.fixture(scope="module")
def drives() -> Iterator[dict[str, str]]:
    urls = {name: new_url() for name, new_url in BUSES.items()}
    with ExitStack() as stack:
        for process in [stack.enter_context(emulator("--at", url)) for url in urls.values()]:
            ready(process)
        yield urls


@contextmanager
def serve(drives: Mapping[str, str], folder: Path, port: int) -> Generator["subprocess.Popen[str]"]:
    """`pmsm-bench serve` over these drives, each of which streams; captures in a folder."""
    config = folder / "bench.toml"
    tables = "".join(f'[drives.{name}]\nurl = "{url}"\n' for name, url in drives.items())
    config.write_text(f'[service]\nport = {port}\ncaptures = "captures"\n{tables}', encoding="utf-8")
    with command("serve", "--config", str(config)) as process:
        url = f"http://127.0.0.1:{port}/api"
        wait_for_answer(f"{url}/health", process)
        until(lambda: httpx.get(f"{url}/health").json()["status"] == "ok", "all drives to stream")
        yield process


@pytest.fixture(scope="module")
def bench(drives: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    port = free_port()
    with serve(drives, tmp_path_factory.mktemp("bench"), port):
        yield Bench(f"http://127.0.0.1:{port}", drives)


def test_a_capture_of_a_drive_that_is_off_says_so_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    url, out = tcp_url(), str(tmp_path / "off.parquet")
    with emulator("--at", url, control="lease") as process:
        ready(process)
        assert pmsm_bench(monkeypatch, "capture", "--drive", url, "--length", "500", "--out", out) == 0
    said = "pmsm-bench: the drive is off (switch on disabled): there is no voltage to record until it is started\n"
    assert capsys.readouterr().err == said


@dataclass(frozen=True)
class Ended:
    """A capture's process that has ended."""

    folder: Path  # that it ran in
    status: int
    out: str
    errors: str


def at_once(folder: Path, asked: Mapping[str, list[str]]) -> dict[str, Ended]:
    """Captures with these arguments, each in a folder of its own."""
    with ExitStack() as stack:
        processes = dict[str, subprocess.Popen[str]]()
        for name, arguments in asked.items():
            (folder / name).mkdir()
            processes[name] = stack.enter_context(subprocess.Popen(
                [*COMMAND, "capture", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                cwd=folder / name,
            ))
            stack.callback(processes[name].kill)
        said = {name: process.communicate(timeout=120.0) for name, process in processes.items()}
        return {name: Ended(folder / name, process.returncode, *said[name]) for name, process in processes.items()}


@pytest.fixture(scope="module")
def without_service(drives: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    wanted = ["--length", "3000", "--signals", "i_a, u_dc"]
    return at_once(tmp_path_factory.mktemp("alone"), {name: ["--drive", drives[name], *wanted] for name in BUSES})


@pytest.fixture(scope="module")
def by_service(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    wanted = ["--length", "20000", "--pre-trigger", "0.1", "--trigger", f"i_q>{LEVEL}", "--out", "got.parquet"]
    return at_once(tmp_path_factory.mktemp("served"), {name: [name, "--service", bench.url, *wanted] for name in BUSES})


# Without the service first: a serial line has one client at a time


@pytest.mark.parametrize("name", BUSES)
def test_a_capture_needs_no_service(without_service: dict[str, Ended], name: str) -> None:
    done = without_service[name]
    assert (done.status, done.errors) == (0, "")
    (path,) = done.folder.iterdir()
    assert done.out == f"{path.name}: 3000 samples\n"  # of which `replay` could make nothing
    assert column_names(path) == ("t", "i_a", "u_dc")


def test_a_trigger_that_never_comes_is_told_without_a_service(
    drives: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = refused(["capture", "--drive", drives["uart"], *NEVER], monkeypatch, capsys)
    assert said == "the capture failed: the trigger, i_q falling through -23, has not come within 0.1 s"
    assert list(tmp_path.iterdir()) == []


def test_what_was_interrupted_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("got.part").write_text("")
    said = refused(["capture", "--drive", tcp_url(), "--out", "got.parquet"], monkeypatch, capsys)
    assert said == "got.part is of a capture that was interrupted; remove it, or choose another --out"


def test_two_captures_to_one_file_are_both_kept(drives: dict[str, str], tmp_path: Path) -> None:
    arguments = ("--length", "10000", "--out", str(tmp_path / "got.parquet"))
    with (
        command("capture", "--drive", drives["canopen"], *arguments) as first,
        command("capture", "--drive", drives["modbus"], *arguments) as second,
    ):
        said = [process.communicate(timeout=60.0)[1] for process in (first, second)]
    one, other = (tmp_path / name for name in ("got.parquet", "got-1.parquet"))
    assert sorted((first.returncode, second.returncode)) == [0, 2]
    if other.exists():  # else the second has seen the first before it recorded anything
        assert sorted(said)[1] == (
            f"pmsm-bench: --out: {one} has been made by another meanwhile; the recording is whole, in {other}\n"
        )
    for path in tmp_path.iterdir():
        assert path in (one, other)
        assert len(read_recording(path).runs[0]) == 10_000


def limited(*arguments: str, folder: Path, most: int = 30_000) -> str:
    """What a capture says that can make no file larger than so many bytes."""
    done = subprocess.run(
        ["prlimit", f"--fsize={most}", *COMMAND, "capture", *arguments, "--out", "got.parquet"], capture_output=True,
        text=True, timeout=120, check=False, cwd=folder,
    )
    assert (done.returncode, done.stdout) == (2, "")
    return done.stderr


def test_a_full_disk_is_said_and_leaves_no_file_that_looks_whole(drives: dict[str, str], tmp_path: Path) -> None:
    said = limited("--drive", drives["canopen"], "--length", "8000", folder=tmp_path)
    assert "the recording cannot be written: File too large; the first " in said
    (path,) = tmp_path.iterdir()
    assert path.name in ("got.part", "got.partial.parquet")
    assert path.name in said


def test_ctrl_c_cancels_on_the_drive_without_a_service(drives: dict[str, str], tmp_path: Path) -> None:
    interrupted("--drive", drives["canopen"], folder=tmp_path)
    with connect(drives["canopen"]) as drive:
        assert drive.read("capture_state") == 0.0


def test_a_service_that_is_killed_in_mid_upload_goes_on_when_it_is_back(
    drives: dict[str, str], tmp_path: Path
) -> None:
    port, one = free_port(), {"canopen": drives["canopen"]}
    bench = Bench(f"http://127.0.0.1:{port}", one)
    with ExitStack() as stack:
        with serve(one, tmp_path, port) as service:
            asking = stack.enter_context(command(
                "capture", "canopen", "--service", bench.url, "--length", "30000", "--out", f"{tmp_path}/got.parquet",
            ))
            until(lambda: bench.said("canopen").get("state") == "uploading", "the upload")
            until(lambda: bench.said("canopen")["samples"] > 1000, "some of it")
            service.kill()
            service.communicate()
        (part,) = (tmp_path / "captures").iterdir()
        assert part.suffix == ".part"
        with serve(one, tmp_path, port):
            out, error = asking.communicate(timeout=60.0)
            assert (asking.returncode, error) == (0, "")
            assert out.startswith(f"{tmp_path}/got.parquet: 30000 samples")
            assert bench.said("canopen")["state"] == "done"
    assert len(read_recording(tmp_path / "got.parquet").runs[0]) == 30_000
    assert [path.name for path in (tmp_path / "captures").iterdir()] == [f"{part.stem}.parquet"]


@pytest.mark.parametrize("name", BUSES)
def test_a_capture_replayed_tells_the_motor_within_one_per_cent(
    by_service: dict[str, Ended], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = by_service[name]
    assert (done.status, done.errors) == (0, "")
    assert done.out == "got.parquet: 20000 samples; estimates: pmsm-bench replay got.parquet\n"
    monkeypatch.chdir(done.folder)
    assert [path.name for path in Path().iterdir()] == ["got.parquet"]
    i_q = read_recording(Path("got.parquet")).runs[0].i_q
    assert i_q[1999] <= LEVEL < i_q[2000]
    assert pmsm_bench(monkeypatch, "replay", "got.parquet", "--periods", "10", "--json", "told.json") == 0
    told = json.loads(Path("told.json").read_text())
    assert within(told["estimates"], 0.01), told["estimates"]
    assert set(told["estimates"]) == set(TRUTH)
    assert (told["gaps"], told["remarks"]) == (0, [])


def test_a_download_that_cannot_be_written_leaves_the_recording_in_the_service(bench: Bench, tmp_path: Path) -> None:
    said = limited("canopen", "--service", bench.url, "--length", "8000", folder=tmp_path)
    latest = bench.said("canopen")
    assert said == (
        "pmsm-bench: got.parquet: cannot be written: File too large; the service still has the recording, "
        f"as capture {latest['id']} of drive canopen\n"
    )
    assert list(tmp_path.iterdir()) == []
    assert len(read_recording(Path(latest["file"])).runs[0]) == 8_000


def test_ctrl_c_cancels_in_the_service_and_says_how_it_ended(bench: Bench, tmp_path: Path) -> None:
    shown = interrupted("canopen", "--service", bench.url, folder=tmp_path)
    latest = bench.said("canopen")
    assert latest["state"] == "cancelled"
    assert f"pmsm-bench: {latest['id']} cancelled".encode() in shown


def interrupted(*arguments: str, folder: Path) -> bytes:
    """A capture on a terminal that waits for its trigger, then Ctrl-C: nothing is left; what the terminal showed."""
    terminal, end = pty.openpty()
    with os.fdopen(terminal, "rb", buffering=0) as screen, os.fdopen(end, "wb") as stderr:
        process = subprocess.Popen(
            [*COMMAND, "capture", *arguments, "--trigger", "i_q > 23"], stdout=subprocess.PIPE, stderr=stderr,
            cwd=folder,
        )
        shown = b""
        while b"waiting for the trigger" not in shown:  # the bar tells what is waited for
            assert select.select([screen], [], [], 60.0)[0], shown
            shown += screen.read(4096)
        process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + 15.0
        while process.poll() is None:
            assert time.monotonic() < deadline
            if select.select([screen], [], [], 0.05)[0]:
                shown += screen.read(4096)
        while select.select([screen], [], [], 0.0)[0]:
            shown += screen.read(4096)
        assert process.communicate(timeout=10.0)[0] == b""
    assert process.returncode == 130
    assert list(folder.iterdir()) == []
    return shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "expected a drive's name, or its URL by --drive, got none"),
        (["x", "--drive", "uart:///dev/null"], "expected a drive's name, or its URL by --drive, got both"),
        (["--drive", "uart:///dev/null", "--service", "x"], "expected --drive, which needs no service, or --service, "),
        (["--drive", "uart:///dev/null", "--trigger", "command"], "--trigger command: without a service nobody can "),
        (["x", "--length", "70000"], "length: expected a whole number of 1 to 65536, got 70000"),
        (["x", "--signals", "i_d,torque"], "signals: the recorder has theta_e, "),
        (["x", "--trigger", "i_q=2"], 'trigger: expected "now", "command", "i_q > 2.0" or '),
        (["x", "--out", "x.csv"], "--out: expected a file name that ends in .parquet, got 'x.csv'"),
        (["x", "--out", "there.parquet"], "--out: there.parquet exists already, expected a new file"),
        (["x", "--out", "no/x.parquet"], "--out: there is no folder no"),
        (["--drive", "http://x"], "expected a drive URL that starts with canopen:// "),
        (["--drive", "uart:///dev/nothing-there"], "cannot open /dev/nothing-there at "),
        (["x", "--service", "nowhere"], "no bench service answers at nowhere: "),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_sentence(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.parquet").write_text("")
    assert refused(["capture", *arguments], monkeypatch, capsys).startswith(said)
    assert [path.name for path in tmp_path.iterdir()] == ["there.parquet"]


def test_a_capture_that_fails_says_why(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert refused(["capture", "spindle", "--service", bench.url], monkeypatch, capsys) == (
        "no drive 'spindle'; the drives are canopen, modbus, uart"
    )
    said = refused(["capture", "uart", "--service", bench.url, *NEVER], monkeypatch, capsys)
    assert said == "the capture failed: the trigger, i_q falling through -23, has not come within 0.1 s"
    assert list(tmp_path.iterdir()) == []
