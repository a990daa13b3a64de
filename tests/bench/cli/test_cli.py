"""The console script: help, usage errors, what keeps a service from starting, the live table."""

import os
import pty
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import httpx
import pytest

from bench.cli.commands.run import meanwhile
from bench.cli.main import main
from drivers.wire.canopen_od import eds
from tests.conftest import COMMAND, RunningBench, bus_url, command, free_port
from tests.support.served_drive import until

pytestmark = pytest.mark.live

SUBCOMMANDS = ("serve", "emulate", "up", "eds", "estimates", "capture", "experiment", "replay")


def pmsm_bench(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """The console script in this process; its exit code."""
    monkeypatch.setattr(sys, "argv", ["pmsm-bench", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def refused(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """The one sentence with which the console script refuses."""
    code = pmsm_bench(monkeypatch, *arguments)
    out, error = capsys.readouterr()
    assert (code, out) == (2, "")
    assert error.startswith("pmsm-bench: ")
    assert error.count("\n") == 1
    return error.removeprefix("pmsm-bench: ").rstrip()


@contextmanager
def some_web_server(body: bytes, status: int = 200) -> Generator[str]:
    """The address of a server that is no bench."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
            del format, args

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_every_command_explains_itself(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pmsm_bench(monkeypatch, name, "--help") == 0
    assert f"pmsm-bench {name}" in capsys.readouterr().out


@pytest.mark.parametrize("what", ["eds", "registers", "--help", "emulate"])
def test_output_that_cannot_be_written_is_one_sentence_and_to_a_closed_pipe_silence(what: str) -> None:
    words = [*COMMAND, what] + (["--at", bus_url(free_port())] if what == "emulate" else [])
    with Path("/dev/full").open("w") as full:
        told = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60.0, check=False)
    assert told.returncode == 2
    name = "pmsm-bench emulate" if what == "emulate" else "pmsm-bench"
    assert told.stderr == f"{name}: cannot write: No space left on device\n"
    reader, writer = os.pipe()
    os.close(reader)
    silent = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=60.0, check=False)
    os.close(writer)
    assert (silent.returncode, silent.stderr) == (2, "")


def test_a_fault_of_ours_is_a_sentence_with_a_file_of_details_and_a_code_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(**_: object) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("bench.cli.commands.registers.show", fail)
    assert pmsm_bench(monkeypatch, "registers") == 70
    said = capsys.readouterr().err
    assert said.startswith("pmsm-bench failed: ZeroDivisionError: division by zero; please report this; the details ")
    assert said.count("\n") == 1
    details = Path(said.rpartition(" ")[2].strip())
    assert "in fail" in details.read_text(encoding="utf-8")
    details.unlink()


def test_the_data_sheet_is_printed_or_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pmsm_bench(monkeypatch, "eds") == 0
    printed = capsys.readouterr().out
    assert printed == eds() + "\n"
    assert pmsm_bench(monkeypatch, "eds", "--out", str(tmp_path / "drive.eds")) == 0
    assert (tmp_path / "drive.eds").read_text() == printed
    assert capsys.readouterr().out == ""
    (tmp_path / "drive.eds").write_text("mine")
    said = refused(["eds", "--out", str(tmp_path / "drive.eds")], monkeypatch, capsys)
    assert said == f"--out: {tmp_path}/drive.eds exists already, expected a new file"
    assert (tmp_path / "drive.eds").read_text() == "mine"
    said = refused(["eds", "--out", str(tmp_path)], monkeypatch, capsys)
    assert said == f"cannot write {tmp_path}: Is a directory"


def test_without_a_command_the_help_is_shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pmsm_bench(monkeypatch) == 2
    out, error = capsys.readouterr()
    assert all(name in out for name in SUBCOMMANDS)
    assert error == ""


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nonsense"], "No such command 'nonsense'."),
        (["serve"], "Missing option '--config'."),
        (["serve", "--config", "absent.toml"], "absent.toml: cannot be read: No such file or directory"),
        (["serve", "--bogus"], "No such option: --bogus"),
        (["up", "--port", "web"], "Invalid value for '--port'"),
        (["up", "--port", "70000"], "cannot listen on 127.0.0.1:70000: "),
        (["up", "--port", "-1"], "cannot listen on 127.0.0.1:-1: "),
        (["estimates"], "Missing argument 'name'."),
        (["estimates", "x", "--once", "--service", "nowhere"], "no bench service answers at nowhere: "),
        (["estimates", "x", "--once", "--service", "http://[::1"], "no bench service answers at http://[::1: "),
        (["replay"], "Missing argument 'file'."),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_sentence_and_exit_code_2(
    arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(arguments, monkeypatch, capsys).startswith(said)


def test_a_port_in_use_is_named_with_a_way_round(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = refused(["up", "--port", str(port)], monkeypatch, capsys)
    assert said.startswith(f"cannot listen on 127.0.0.1:{port}: Address already in use; another port: --port ")


def test_a_port_of_the_environment_that_is_none_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PMSM_BENCH_PORT", "web")
    assert refused(["up"], monkeypatch, capsys) == (
        "environment variable PMSM_BENCH_PORT: expected a port of 0 to 65535, got 'web'"
    )


def test_an_address_that_is_not_this_machines_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "bench.toml"
    for host in ("192.0.2.1", "no such host", "a" * 70 + ".example"):
        config.write_text(f'[service]\nhost = "{host}"\n[drives.a]\nurl = "{bus_url(5)}"\n', encoding="utf-8")
        assert refused(["serve", "--config", str(config)], monkeypatch, capsys).startswith(
            f"cannot listen on {host}:8080: "
        )


def test_an_emulated_drive_that_cannot_be_keeps_both_from_starting() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, ExitStack() as stack:
        port = taken.getsockname()[1]
        cases = [
            (["--at", "http://x"], "expected a URL that starts with canopen:// or modbus+tcp:// or"),
            (["--at", "canopen://socketcand/x/5"], "expected canopen://socketcand/HOST:PORT/CHANNEL/NODE, got"),
            (["--scenario", "nope"], "nope: no such file; the built-in scenarios are paper, paper_run, "),
            (["--at", bus_url(port)], f"cannot serve a CAN bus at 127.0.0.1:{port}: Address already in use"),
        ]
        at_once = [
            (stack.enter_context(command("up", "--port", str(free_port()), *arguments)), said)
            for arguments, said in cases
        ]
        for process, said in at_once:
            _, error = process.communicate(timeout=60.0)
            assert process.returncode == 2
            assert error.startswith(f"pmsm-bench: {said}")
            assert error.count("\n") == 1


def test_the_table_of_a_drive_shows_every_parameter_with_its_interval(running_bench: RunningBench) -> None:
    address = f"{running_bench.url}/api/drives/emulated/estimates"
    until(lambda: httpx.get(address).json()["status"] == "ok", "estimates")
    done = subprocess.run(
        [*COMMAND, "estimates", "emulated", "--once", "--service", running_bench.url],
        capture_output=True, text=True, timeout=60, check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "± 95 %" in done.stdout
    for name, unit in (("R_s", "ohm"), ("L_d", "mH"), ("L_q", "mH"), ("psi_f", "mVs")):
        (row,) = [line for line in done.stdout.splitlines() if f" {name} " in line]
        assert unit in row


def test_a_live_table_ends_with_ctrl_c_and_no_complaint(running_bench: RunningBench) -> None:
    terminal, end = pty.openpty()
    with os.fdopen(terminal, "rb", buffering=0) as screen, os.fdopen(end, "wb") as stdout:
        process = subprocess.Popen(
            [*COMMAND, "estimates", "emulated", "--service", running_bench.url], stdout=stdout, stderr=subprocess.PIPE,
        )
        shown = b""
        while shown.count(b"emulated: ok") < 3:  # drawn again and again
            shown += screen.read(4096)
        process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + 15.0
        while select.select([screen], [], [], 0.05)[0] or process.poll() is None:
            assert time.monotonic() < deadline
            if select.select([screen], [], [], 0.05)[0]:
                screen.read(4096)
        assert process.communicate(timeout=10.0)[1] == b""
        assert process.returncode == 0


@pytest.mark.parametrize("name", ["spindle", "a/b", "../health", "?", ""])
def test_an_unknown_drive_of_the_service_is_named(
    name: str, running_bench: RunningBench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(["estimates", name, "--once", "--service", running_bench.url], monkeypatch, capsys)
    assert said.startswith(("no drive ", "nothing at "))


def test_no_service_or_another_one_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"http://127.0.0.1:{free_port()}"
    said = refused(["estimates", "x", "--once", "--service", url], monkeypatch, capsys)
    assert said == (
        f"no bench service answers at {url}: start one by `make run` or `pmsm-bench serve --config FILE`"
    )
    for body, status in ((b"[1]", 200), (b"{}", 200), (b"{}", 500), (b"<html>", 200)):
        with some_web_server(body, status) as url:
            said = refused(["estimates", "x", "--once", "--service", url], monkeypatch, capsys)
        assert url in said


def test_what_is_prepared_fails_in_its_own_words_and_is_left_at_once_when_told_to() -> None:
    def fails() -> None:
        raise ValueError("no room")

    with pytest.raises(ValueError, match="no room"):
        meanwhile(fails)

    def waits() -> None:
        ended.wait(20.0)

    ended, begun = threading.Event(), time.monotonic()
    threading.Timer(0.2, lambda: signal.raise_signal(signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        meanwhile(waits)
    assert time.monotonic() - begun < 10.0
    ended.set()
