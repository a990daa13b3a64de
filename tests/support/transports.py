"""Where the contract of a drive is kept: every transport, by how an emulated drive is served over it."""

import itertools
import tempfile
import uuid
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from subprocess import Popen

import pytest

from tests.conftest import free_port
from tests.support.served_drive import emulator, ready, tcp_url

_nodes = itertools.count(5)


@dataclass(frozen=True)
class ServedProcess:
    """An emulated drive in a process of its own, and the URL it is at."""

    url: str
    process: "Popen[str]"


@contextmanager
def serving(url: str, *options: str, control: str = "watchdog") -> Generator[ServedProcess]:
    """An emulated drive at a URL, ready; `options` are those of the emulator, `control` as of `served`."""
    with emulator("--at", url, *options, control=control) as process:
        ready(process)
        yield ServedProcess(url, process)


@dataclass(frozen=True)
class Transport:
    """A way to a drive."""

    new_url: Callable[[], str]  # where nobody is yet
    stream_periods: int = 10  # row length that it keeps up with
    serve: Callable[..., AbstractContextManager[ServedProcess]] = serving


def vcan_url() -> str:
    """A new node on vcan0; skips where this kernel has none."""
    if not Path("/sys/class/net/vcan0").exists():
        pytest.skip("there is no vcan0 here; `make test-vcan` runs this where there is")
    return f"canopen://socketcan/vcan0/{next(_nodes)}"


def pty_url() -> str:
    """A serial line at a path of its own."""
    return f"uart://{tempfile.gettempdir()}/pmsm-bench-{uuid.uuid4().hex}?baudrate=3000000"


def serial_socket_url() -> str:
    """A serial line behind a free TCP port."""
    return f"uart://socket://127.0.0.1:{free_port()}"


def modbus_tcp_url() -> str:
    """A unit at a free TCP port."""
    return f"modbus+tcp://127.0.0.1:{free_port()}/1"


def modbus_pty_url() -> str:
    """A unit on a serial line at a path of its own."""
    return f"modbus+rtu://{tempfile.gettempdir()}/pmsm-bench-{uuid.uuid4().hex}?baudrate=1000000/17"


def modbus_socket_url() -> str:
    """A unit on a serial line behind a free TCP port."""
    return f"modbus+rtu://socket://127.0.0.1:{free_port()}/247"


TRANSPORTS = [
    pytest.param(Transport(tcp_url), id="canopen-socketcand"),
    pytest.param(Transport(vcan_url, stream_periods=50), id="canopen-vcan", marks=pytest.mark.vcan),
    pytest.param(Transport(modbus_tcp_url, stream_periods=2), id="modbus-tcp"),
    pytest.param(Transport(modbus_pty_url, stream_periods=2), id="modbus-pty"),
    pytest.param(Transport(modbus_socket_url), id="modbus-socket"),
    pytest.param(Transport(pty_url, stream_periods=1), id="uart-pty"),
    pytest.param(Transport(serial_socket_url, stream_periods=1), id="uart-socket"),
]
