"""The end of a pyserial port. Knows nothing of what passes."""

import contextlib
import socket
from typing import Any

from serial.urlhandler.protocol_socket import Serial as SocketPort


def close(port: Any) -> None:
    """Close a port, be it gone.

    After a socket pyserial would wait for 0.3 s; it leaves one open where the far end has gone first.
    """
    connection = getattr(port, "_socket", None)
    with contextlib.suppress(OSError):
        if not isinstance(port, SocketPort):
            port.close()
        elif connection is not None:
            port.is_open = False
            connection.shutdown(socket.SHUT_RDWR)
    if connection is not None:
        connection.close()
