"""Whether a TCP port serves a CAN bus: asked before python-can is, which waits for a server's answers for ever."""

import socket

from drivers.errors import ConnectError

_TIMEOUT = 2.0  # s, for each answer


def check_served(host: str, port: int, channel: str) -> None:
    """Raise ConnectError unless socketcand serves the channel at host:port."""
    try:
        with socket.create_connection((host, port), _TIMEOUT) as server:
            greeting = server.recv(256)
            if greeting != b"< hi >":
                raise ConnectError(f"{host}:{port} is no socketcand: expected '< hi >', got {_text(greeting)}")
            server.sendall(f"< open {channel} >".encode())
            answer = server.recv(256)
    except TimeoutError:
        raise ConnectError(
            f"{host}:{port} does not answer: expected a socketcand server's greeting within {_TIMEOUT:g} s"
        ) from None
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConnectError(f"nothing serves a CAN bus at {host}:{port}: {reason}") from None
    if answer != b"< ok >":
        raise ConnectError(f"socketcand at {host}:{port} has no bus {channel!r}: it answered {_text(answer)}")


def _text(data: bytes) -> str:
    return repr(data[:40].decode("latin-1")) if data else "nothing"
