"""The end of a service that was told to: quick whoever is connected, and never without its drives' stop."""

import contextlib
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from drivers import lease, operation
from drivers.connect import connect
from drivers.wire.cia402 import State
from drivers.wire.lease import End
from tests.conftest import command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url, until
from tests.support.transports import modbus_tcp_url, serial_socket_url

pytestmark = [pytest.mark.live, pytest.mark.thorough]

MOST = 3.0  # s
HOLD = {"holds": [{"speed_rpm": 1200.0, "i_d": 0.0, "i_q": 2.0, "seconds": 5.0}], "step": 0.5}


@dataclass(frozen=True)
class Serving:
    """A service over drives called d0, d1, ... in processes of their own."""

    port: int
    process: "subprocess.Popen[str]"
    drives: tuple["subprocess.Popen[str]", ...]

    def ask(self, method: str, path: str, body: object = None) -> httpx.Response:
        return httpx.request(method, f"http://127.0.0.1:{self.port}{path}", json=body or {}, timeout=30.0)

    def start(self) -> None:
        """All drives carry a current."""
        for k in range(len(self.drives)):
            until(lambda k=k: self.ask("POST", f"/api/drives/d{k}/start", {"i_q_ref": 1.0}).is_success, "it to start")

    def freeze(self, number: int = signal.SIGSTOP) -> None:
        """No drive answers any more."""
        for drive in self.drives:
            os.kill(drive.pid, number)

    def ended(self, *numbers: signal.Signals) -> str:
        """Told to end by these signals, one after the other; what it said on standard error."""
        begun = time.monotonic()
        for number in numbers:
            with contextlib.suppress(ProcessLookupError):
                self.process.send_signal(number)
            time.sleep(0.03 if len(numbers) > 1 else 0.0)
        out, errors = self.process.communicate(timeout=30.0)
        took = time.monotonic() - begun
        assert self.process.returncode == 0, errors
        assert took < MOST, errors
        assert "Traceback" not in errors
        assert "ERROR" not in errors
        assert all(f"\nd{k}: " in out for k in range(len(self.drives))), out  # what became of each
        assert out.endswith("ended\n")
        return errors


@contextlib.contextmanager
def serving(folder: Path, *urls: str) -> Generator[Serving]:
    port, config = free_port(), folder / "bench.toml"
    tables = "".join(f'[drives.d{k}]\nurl = "{url}"\n' for k, url in enumerate(urls))
    config.write_text(f'[service]\nport = {port}\ncaptures = "captures"\nlog = "log"\n{tables}', encoding="utf-8")
    with contextlib.ExitStack() as stack:
        drives = tuple(stack.enter_context(emulator("--at", url, control="lease")) for url in urls)
        for drive in drives:
            ready(drive)
        process = stack.enter_context(command("serve", "--config", str(config)))
        wait_for_answer(f"http://127.0.0.1:{port}/api/health", process)
        yield Serving(port, process, drives)


def check_given_up(url: str) -> None:
    """A drive is off since its lease was given up, and not because it ran out."""
    with connect(url) as drive:
        assert operation.state(drive) is not State.OPERATION_ENABLED
        assert lease.held(drive) is None
        assert End(int(drive.read("lease_end"))) is End.RELEASED
        assert drive.read("i_q_ref") == 0.0


def asked(port: int, path: str, receives: int | None = None) -> socket.socket:
    """A connection that asks for something; it takes in so many bytes at a time."""
    one = socket.socket()
    one.settimeout(15.0)
    if receives is not None:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receives)
    one.connect(("127.0.0.1", port))
    one.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    return one


def read_out(one: socket.socket) -> bytes:
    """All that comes until the other side closes."""
    said = b""
    while part := one.recv(65536):
        said += part
    return said


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_streams_and_clients_that_no_longer_read_do_not_keep_it(tmp_path: Path, number: signal.Signals) -> None:
    url = tcp_url()
    with serving(tmp_path, url) as service, contextlib.ExitStack() as stack:
        service.start()
        streams = [stack.enter_context(asked(service.port, "/api/drives/d0/stream")) for _ in range(20)]
        stack.enter_context(asked(service.port, "/api/drives/d0/stream", receives=4096))  # nobody reads these
        stack.enter_context(asked(service.port, "/assets/plotly.min.js", receives=4096))
        idle = stack.enter_context(asked(service.port, "/api/health"))
        said = b""
        while not said.endswith(b"}"):
            said += idle.recv(65536)
        for stream in streams:
            assert b"event: snapshot" in stream.recv(65536)
        with ThreadPoolExecutor(20) as readers:
            told = [readers.submit(read_out, stream) for stream in streams]
            time.sleep(1.0)  # in which what nobody reads fills the buffers on its way
            errors = service.ended(number)
            ends = [future.result() for future in told]
        assert all(end.endswith(b"\r\n0\r\n\r\n") for end in ends)  # whole, as HTTP has it
        assert read_out(idle) == b""
        assert all(" 200 done" in line or "no link" in line for line in errors.splitlines())
        check_given_up(url)


def test_further_signals_do_not_cost_a_drive_its_stop(tmp_path: Path) -> None:
    urls = (tcp_url(), modbus_tcp_url())
    with serving(tmp_path, *urls) as service:
        service.start()
        service.ended(*(signal.SIGTERM, signal.SIGINT) * 4)
        for url in urls:
            check_given_up(url)


def test_an_experiment_under_way_stops_its_drive(tmp_path: Path) -> None:
    url = tcp_url()
    with serving(tmp_path, url) as service:
        until(lambda: service.ask("POST", "/api/drives/d0/experiments", HOLD).is_success, "an experiment")

        def holds() -> bool:
            return service.ask("GET", "/api/drives/d0/experiments/latest").json()["phase"].startswith("holding")

        until(holds, "it to hold")
        service.ended(signal.SIGTERM)
        check_given_up(url)


def test_a_start_under_way_is_undone_and_later_ones_are_refused(tmp_path: Path) -> None:
    url = tcp_url()
    with serving(tmp_path, url) as service:
        service.start()
        ended = threading.Event()

        def starting() -> None:
            with contextlib.suppress(httpx.HTTPError):
                while not ended.is_set():
                    service.ask("POST", "/api/drives/d0/start", {"i_q_ref": 0.5})

        thread = threading.Thread(target=starting)
        thread.start()
        time.sleep(0.1)
        service.ended(signal.SIGTERM)
        ended.set()
        thread.join()
        check_given_up(url)


@pytest.mark.parametrize("make", [tcp_url, modbus_tcp_url, serial_socket_url])
@pytest.mark.parametrize(("method", "path", "body"), [
    ("GET", "signals", None), ("POST", "stop", None), ("POST", "start", {"i_q_ref": 2.0}),
])  # fmt: skip
def test_requests_that_wait_for_a_silent_drive_are_answered_and_do_not_keep_it(
    make: Any, method: str, path: str, body: object, tmp_path: Path
) -> None:
    with serving(tmp_path, make()) as service, ThreadPoolExecutor(2) as clients:
        service.start()
        service.freeze()
        waiting: list[Future[httpx.Response]] = [
            clients.submit(service.ask, method, f"/api/drives/d0/{path}", body) for _ in range(2)
        ]
        time.sleep(0.2)
        service.ended(signal.SIGTERM)
        service.freeze(signal.SIGCONT)
        for answer in waiting:
            assert answer.result().status_code == 503
            assert answer.result().json()["detail"]


def test_several_silent_drives_are_waited_for_at_once(tmp_path: Path) -> None:
    with serving(tmp_path, tcp_url(), tcp_url(), tcp_url(), modbus_tcp_url()) as service:
        service.start()
        service.freeze()
        service.ended(signal.SIGTERM)
        service.freeze(signal.SIGCONT)
