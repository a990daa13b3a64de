"""Drives on a serial line behind a device server: `rfc2217://` and `socket://`, over a UART and over Modbus RTU."""

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from drivers.connect import connect
from drivers.errors import ConnectError, LostError
from tests.drivers.serial_servers import device_server
from tests.support.served_drive import first_blocks, listening, served
from tests.support.transports import modbus_pty_url, pty_url

# pyserial 3.5 names its thread by methods that Python deprecates
pytestmark = [
    pytest.mark.live, pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")
]


@dataclass(frozen=True)
class Line:
    """A drive's line: its device, and the form of its URL behind a server."""

    at: str  # URL
    behind: str  # {protocol}, {port}

    @property
    def device(self) -> str:
        return self.at.partition("://")[2].partition("?")[0]

    @property
    def baudrate(self) -> int:
        return int(re.findall("baudrate=([0-9]+)", self.at)[0])

    def url(self, protocol: str, port: int) -> str:
        return self.behind.format(protocol=protocol, port=port)


@pytest.fixture(scope="module", params=["uart", "modbus"])
def line(request: pytest.FixtureRequest) -> Iterator[Line]:
    if request.param == "uart":
        line = Line(pty_url(), "uart://{protocol}://127.0.0.1:{port}?baudrate=3000000")
    else:
        line = Line(modbus_pty_url(), "modbus+rtu://{protocol}://127.0.0.1:{port}?baudrate=1000000/17")
    with served(line.at):
        yield line


@pytest.fixture(params=["rfc2217", "socket"])
def protocol(request: pytest.FixtureRequest) -> str:
    return request.param


def test_a_drive_is_read_written_and_streams_without_loss(line: Line, protocol: str) -> None:
    with device_server(line.device, line.baudrate, protocol == "rfc2217") as port:
        for value in (1.25, 1.5):  # one client after the other
            with connect(line.url(protocol, port)) as drive:
                drive.write("i_q_ref", value)
                assert drive.read("i_q_ref") == value
                blocks = first_blocks(drive, 500)
                assert all(block.lost_before == 0 for block in blocks)


def test_a_server_that_goes_is_lost_in_a_sentence_and_had_again_when_it_is_back(line: Line, protocol: str) -> None:
    with contextlib.ExitStack() as server:
        port = server.enter_context(device_server(line.device, line.baudrate, protocol == "rfc2217"))
        drive = connect(url := line.url(protocol, port))
        with listening(drive) as listener:
            server.close()
            error = listener.ended()
    assert isinstance(error, LostError)
    assert "\n" not in str(error)
    with pytest.raises(ConnectError, match=r"127\.0\.0\.1"):
        connect(url)
    with (
        device_server(line.device, line.baudrate, protocol == "rfc2217") as port,
        connect(line.url(protocol, port)) as again,
    ):
        assert len(first_blocks(again, 20)) > 0


def test_a_server_of_bare_bytes_is_no_rfc_2217_server() -> None:
    url = pty_url()
    with served(url), device_server(Line(url, "").device, 3_000_000, rfc2217=False) as port:
        url = f"uart://rfc2217://127.0.0.1:{port}?timeout=0.3"
        with pytest.raises(ConnectError, match=r"cannot open rfc2217://.*: Remote does not seem to support RFC2217"):
            connect(url)
