"""The HTTP server: a port, the application, an orderly end."""

import errno
import os
import socket

import uvicorn

from bench.api.app import create_app
from bench.errors import ConfigError
from bench.service import Service

_GRACE = 1  # s for answers under way at the end


def listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises ConfigError when the port is not to be had."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # The protocol is named so that asyncio sends small answers at once: TCP_NODELAY, else 40 ms
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen()
    except (OSError, OverflowError, ValueError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or error
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            reason = f"{reason}; another port: PMSM_BENCH_PORT={port % 65535 + 1}"
        raise ConfigError(f"cannot listen on {host}:{port}: {reason}") from None
    return listener


def serve(service: Service, listener: socket.socket) -> None:
    """Answer requests until SIGINT or SIGTERM."""
    config = uvicorn.Config(
        create_app(service, lambda: server.should_exit), log_level="warning", timeout_graceful_shutdown=_GRACE,
        access_log=False, lifespan="off",
    )
    server = uvicorn.Server(config)
    server.run(sockets=[listener])
