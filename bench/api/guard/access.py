"""Who may call: whose Host, whose Origin, with which token. Values in, a refusal out; knows nothing of sockets.

Beyond loopback everybody needs the token, to read and to write. On loopback nobody does, so that a page of another
origin, which a browser on this machine may show, is told by its Origin, and one that has its own name lead here (DNS
rebinding) by its Host.
"""

import ipaddress
import socket
import ssl
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from starlette.datastructures import Headers
from starlette.requests import cookie_parser

from bench.api.exchange.kinds import READS
from bench.api.guard.page_pass import given_by, holds
from bench.config import Config
from bench.errors import ConfigError, shown
from bench.service.token import Known

LOCAL: Final = "localhost"
By = Literal["loopback", "token", "page"]
_OWN_SITE: Final = ("same-origin", "none")  # none: typed into the browser


@dataclass(frozen=True, slots=True)
class Refusal:
    """What is answered to somebody who may not."""

    status: int
    detail: str


@dataclass(frozen=True, slots=True)
class Access:
    """Who may call a service that listens at a port."""

    port: int
    scheme: Literal["http", "https"] = "http"
    names: frozenset[str] = frozenset()  # of the service, beside those of loopback; some with a port
    token: Known | None = None  # what everybody needs; None on loopback
    tls: ssl.SSLContext | None = None

    def told(self) -> str:
        """To whom it is open, as its start says it."""
        if self.token is None:
            return "this machine, without a token"
        how = "over TLS" if self.tls else "without TLS: the token can be read on its way (insecure = true)"
        return f"whoever reaches port {self.port} and has the token (`pmsm-bench token`, `--config FILE`), {how}"

    def address(self, host: str) -> str:
        """Where the page is, of a service that listens at `host`."""
        name = socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
        return f"{self.scheme}://{name}:{self.port}"

    def refusal(self, method: str, headers: Headers) -> Refusal | None:
        """Why a request is refused whatever it asks for; None where it is not."""
        host = headers.get("host", "").lower()
        if not self._is_own(host):
            return Refusal(421, f"expected this service's own Host, as {LOCAL}:{self.port}, got {shown(host)}; "
                                "other names of it go into its configuration: [service] names")  # fmt: skip
        for origin in headers.getlist("origin"):
            if origin.lower() != f"{self.scheme}://{host}":
                return Refusal(403, f"expected no Origin, or {self.scheme}://{host}, got {shown(origin)}")
        site = headers.get("sec-fetch-site", "none").lower()
        opened = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")
        if site not in _OWN_SITE and not (opened and method in READS):
            return Refusal(403, f"expected a request of the service's own page, got one of another ({shown(site)})")
        return None

    def by(self, headers: Headers) -> By | None:
        """What lets somebody in; None where the token is missing."""
        if self.token is None:
            return "loopback"
        kind, _, said = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self.token.is_it(said.strip()):
            return "token"
        now = self.token.now
        cookie = cookie_parser(headers.get("cookie", "")).get(self._name, "")
        return "page" if now is not None and holds(cookie, now) else None

    def cookie(self) -> str:
        """A Set-Cookie for who has shown the token."""
        assert self.token is not None
        return given_by(self._name, self.token.now or "", secure=self.tls is not None)

    @property
    def _name(self) -> str:
        return f"pmsm-bench-{self.port}"  # browsers do not tell ports apart

    def _is_own(self, host: str) -> bool:
        name, colon, port = host.rpartition(":") if not host.endswith("]") else (host, "", "")
        if not colon:
            name, port = host, "443" if self.scheme == "https" else "80"
        address = _address(name)
        if name == LOCAL or (address is not None and address.is_loopback):
            return port.isdigit()  # a tunnel's may be another: nobody can have these names lead elsewhere
        is_other = address is not None and self.token is not None
        return f"{name}:{port}" in self.names or (port == str(self.port) and (name in self.names or is_other))


def access_to(config: Config, address: str, port: int) -> Access:
    """Who may call what listens at an address. Makes the token where one is needed. Raises ConfigError."""
    tls = tls_of(config)
    scheme = "http" if tls is None else "https"
    names = frozenset(_lower([config.host, *config.names]))
    if is_loopback(address):
        return Access(port, scheme, names, None, tls)
    if tls is None and not config.insecure:
        raise ConfigError(
            f"host {config.host} is beyond loopback: without TLS everybody on the way reads the token and may move the "
            "drives; expected certificate and key in [service], or insecure = true"
        )
    machine = _lower([socket.gethostname(), f"{socket.gethostname()}.local", socket.getfqdn()])
    return Access(port, scheme, names | set(machine), Known(config.token), tls)


def is_loopback(address: str) -> bool:
    """Whether an address, or `localhost`, is of this machine alone."""
    try:
        return address == LOCAL or ipaddress.ip_address(address.partition("%")[0]).is_loopback
    except ValueError:
        return False


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return None


def _lower(names: Iterable[str]) -> list[str]:
    return [f"[{name}]" if ":" in name and name.count(":") > 1 and name[0] != "[" else name.lower() for name in names]


def tls_of(config: Config) -> ssl.SSLContext | None:
    """TLS by a configuration's certificate; None where it names none. Raises ConfigError."""
    if config.certificate is None or config.key is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(config.certificate, config.key, password=lambda: "")  # nobody is there to be asked
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"certificate {config.certificate} and key {config.key}: expected PEM files that belong together, the key "
            f"without a password: {reason}"
        ) from None
    return context
