"""The HTTP server: a port, the application, an orderly end."""

import socket

import uvicorn

from bench.api.app import create_app
from bench.errors import ConfigError
from bench.service import Service

_GRACE = 1  # s for open event streams at the end


def listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises ConfigError when the port is not to be had."""
    try:
        return socket.create_server((host, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"cannot listen on {host}:{port}: {reason}; another port: PMSM_BENCH_PORT=8081") from None


def serve(service: Service, listener: socket.socket) -> None:
    """Answer requests until SIGINT or SIGTERM."""
    config = uvicorn.Config(
        create_app(service), log_level="warning", timeout_graceful_shutdown=_GRACE, access_log=False, lifespan="off"
    )
    uvicorn.Server(config).run(sockets=[listener])
