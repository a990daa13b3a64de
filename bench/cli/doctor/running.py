"""The service's port: free, or whose; and what the service that answers there says of its drives."""

import os
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final, cast

import httpx

from bench.api.guard.access import is_loopback
from bench.api.server import listen
from bench.cli.doctor import processes
from bench.cli.doctor.check import Check, failed, ok, warning
from bench.cli.rest import TOKEN_VARIABLE
from bench.config import Config
from bench.errors import ConfigError
from bench.service import token

_TIMEOUT: Final = 3.0  # s for an answer
_EVERYWHERE: Final = {"0.0.0.0": "127.0.0.1", "::": "::1"}


@dataclass(frozen=True, slots=True)
class Running:
    """A bench service that answers, as it tells of itself."""

    version: str
    drives: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])  # by URL


def looked_at(config: Config) -> tuple[Check, Running | None]:
    """The port, and the service that answers there."""
    what = f"port {config.port}"
    host = _EVERYWHERE.get(config.host, config.host)
    try:
        with socket.create_connection((host, config.port), _TIMEOUT):
            pass
    except OSError:
        return _free(what, config), None
    running = _asked(config, host)
    who = processes.listener(config.port)
    if running is None:
        by = f"by {who}" if who else "by another program"
        return failed(what, f"in use {by}, which is no bench service", "end it, or take another port: --port N"), None
    found = f"a bench service ({running.version}) answers{f', {who}' if who else ''}"
    ours = {drive.url for drive in config.drives}
    if ours and not ours <= running.drives.keys():
        others = ", ".join(running.drives) or "drives that it does not tell"
        return warning(what, f"{found}, over {others}", "for a second service take another port: --port N"), running
    return ok(what, found), running


def _free(what: str, config: Config) -> Check:
    try:
        listen(config.host, config.port).close()
    except ConfigError as error:
        return failed(what, str(error), "see [service] host and port; ports below 1024 are for root alone")
    return ok(what, f"free on {config.host}")


def _asked(config: Config, host: str) -> Running | None:
    """What answers at the port; None where that is no bench service."""
    name = f"[{host}]" if ":" in host else host
    scheme, verify = "http", True
    if config.certificate is not None:
        scheme, verify = "https", _trusting(config)
    try:
        with httpx.Client(base_url=f"{scheme}://{name}:{config.port}", verify=verify, timeout=_TIMEOUT,
                          headers=_headers(config)) as client:  # fmt: skip
            answer = client.get("/api/health")
            health = answer.json()
            if answer.status_code == HTTPStatus.UNAUTHORIZED and "token of this service" in str(health):
                return Running("which does not take this token")
            drives = client.get("/api/drives").json()["drives"]
            return Running(str(health["version"]), {str(drive["url"]): drive for drive in drives})
    except (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError, LookupError, TypeError):
        return None


def _trusting(config: Config) -> ssl.SSLContext:
    """The configuration's own certificate, whatever name it is for: it is asked on its own machine."""
    context = ssl.create_default_context(cafile=config.certificate)
    context.check_hostname = False
    return context


def _headers(config: Config) -> dict[str, str]:
    """With the token, where one is needed and there."""
    said = os.environ.get(TOKEN_VARIABLE)
    if said is None and not is_loopback(config.host):
        try:
            said = token.read(config.token)
        except ConfigError:
            return {}
    return {} if said is None else {"Authorization": f"Bearer {said}"}


def link_check(what: str, drive: Mapping[str, Any]) -> Check:
    """The link to a drive as the running service has it: nobody else need ask."""
    link, stream = cast(Mapping[str, Any], drive["link"]), cast(Mapping[str, Any], drive["stream"])
    if link["state"] == "streaming":
        return ok(what, f"the running service has it: {stream['rate_hz']:.4g} rows/s")
    said = link["last_error"]
    why = f": {said['sentence']}" if said else ""
    return failed(what, f"the running service has no link to it ({link['state']}){why}", "see drive, cable and address")
