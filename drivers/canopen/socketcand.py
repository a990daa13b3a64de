"""A CAN bus behind a TCP port: the raw mode of the socketcand protocol, as its client. Knows nothing of CANopen.

Many frames come at once, and are taken apart at once: python-can's own client makes an object of each, which is most of
the work of a stream. Protocol: github.com/linux-can/socketcand, doc/protocol.md.
"""

import contextlib
import re
import socket
from typing import Final

from drivers.errors import ConnectError

Frame = tuple[int, bytes]
"""CAN identifier (11 bit) and up to 8 data bytes."""

_TIMEOUT: Final = 2.0  # s, for each answer
_LONGEST: Final = 200  # bytes of what is no whole command yet
_FRAME: Final = re.compile(rb"< frame ([0-9A-Fa-f]{3}) [0-9.]+ ((?:[0-9A-Fa-f]{2}){0,8}) >")
_QUICK: Final[int | None] = getattr(socket, "TCP_QUICKACK", None)


class Frames:
    """Frames out of a stream of bytes, however it is split; what is none, or of a 29-bit identifier, is passed over."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        """The frames complete with these bytes, in order."""
        whole, end, rest = (self._rest + data).rpartition(b">")
        self._rest = rest if len(rest) <= _LONGEST else b""
        return [(int(cob_id, 16), bytes.fromhex(text.decode())) for cob_id, text in _FRAME.findall(whole + end)]


def send_command(cob_id: int, data: bytes) -> bytes:
    """The command that sends a frame of an 11-bit identifier."""
    return f"< send {cob_id:03X} {len(data):X} {data.hex(' ')} >".encode()


def acknowledge(server: socket.socket) -> None:
    """Have what has come acknowledged at once, where the system can: a server may wait for that."""
    if _QUICK is not None:
        with contextlib.suppress(OSError):
            server.setsockopt(socket.IPPROTO_TCP, _QUICK, 1)


def connected(host: str, port: int, channel: str) -> socket.socket:
    """A connection to the bus of that name, in raw mode. Raises ConnectError where none is served."""
    try:
        server = socket.create_connection((host, port), _TIMEOUT)
        try:
            server.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            greeting = server.recv(256)
            if greeting != b"< hi >":
                raise ConnectError(f"{host}:{port} is no socketcand: expected '< hi >', got {_text(greeting)}")
            server.sendall(f"< open {channel} >".encode())
            if (answer := server.recv(256)) == b"< ok >":
                server.sendall(b"< rawmode >")
                answer = server.recv(256)
            if answer == b"< ok >":
                server.settimeout(None)
                return server
        except BaseException:
            server.close()
            raise
        server.close()
    except TimeoutError:
        raise ConnectError(
            f"{host}:{port} does not answer: expected a socketcand server's greeting within {_TIMEOUT:g} s"
        ) from None
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConnectError(f"nothing serves a CAN bus at {host}:{port}: {reason}") from None
    raise ConnectError(f"socketcand at {host}:{port} has no bus {channel!r}: it answered {_text(answer)}")


def _text(data: bytes) -> str:
    return repr(data[:40].decode("latin-1")) if data else "nothing"
