"""The address of a drive on a serial line: `uart:///dev/ttyUSB0?baudrate=3000000`, `uart://socket://host:port`.

Bench and virtual drive stand at two ends of the same URL. Pure; opens nothing.
"""

import re
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, urlencode

FORMS = (
    "uart:///DEVICE[?baudrate=N], uart://COM3[?baudrate=N], uart://socket://HOST:PORT "
    "or uart://rfc2217://HOST:PORT[?option=value]"
)
BAUDRATE = 3_000_000  # where a URL tells none
_LOWEST, _HIGHEST = 1_200, 12_000_000  # baud
_OVER_TCP = ("socket", "rfc2217")


@dataclass(frozen=True, slots=True)
class UartUrl:
    """A serial line: a device of this machine, or one behind a TCP port. `options` go to the serial library."""

    device: str = ""  # path or name; none: over TCP
    protocol: str = ""  # over TCP: "socket" for bare bytes, "rfc2217"
    host: str = ""
    port: int = 0
    baudrate: int = BAUDRATE
    options: dict[str, str] = field(default_factory=dict[str, str])

    @property
    def line(self) -> str:
        """What a serial library opens."""
        if self.device:
            return self.device
        return f"{self.protocol}://{self.host}:{self.port}" + (f"?{urlencode(self.options)}" if self.options else "")

    def __str__(self) -> str:
        """The line in words, for messages; bare bytes over TCP have no baud rate."""
        where = self.device or f"{self.protocol}://{self.host}:{self.port}"
        return where if self.protocol == "socket" else f"{where} at {self.baudrate} baud"


def parse_uart_url(url: str) -> UartUrl:
    """Take a serial line's URL apart. Raises ValueError, in a sentence, when it is none."""
    scheme, found, rest = url.partition("://")
    if scheme != "uart" or not found:
        raise ValueError(f"expected a URL that starts with uart://, got {url!r}")
    place, _, query = rest.partition("?")
    try:
        options = dict(parse_qsl(query, strict_parsing=True)) if query else {}
    except ValueError as error:
        raise ValueError(f"expected {FORMS}, got {url!r} ({error})") from None
    baudrate = _baudrate(options.pop("baudrate", str(BAUDRATE)), url)
    protocol, over_tcp, address = place.partition("://")
    if over_tcp:
        return _over_tcp(protocol, address, baudrate, options, url)
    if options:
        raise ValueError(f"a serial device takes no option but baudrate, got {', '.join(options)} in {url!r}")
    if not re.fullmatch(r"/[^\0]*[^/\0]|COM[0-9]{1,3}", place):
        raise ValueError(f"expected {FORMS}, got {url!r}")
    return UartUrl(device=place, baudrate=baudrate)


def _over_tcp(protocol: str, address: str, baudrate: int, options: dict[str, str], url: str) -> UartUrl:
    if protocol not in _OVER_TCP:
        raise ValueError(f"expected {' or '.join(f'{p}://' for p in _OVER_TCP)} after uart:// in {url!r}")
    host, _, port = address.rpartition(":")
    if not host or re.search(r"[/\s]", host) or not re.fullmatch("[0-9]{1,5}", port) or not 1 <= int(port) <= 65535:
        raise ValueError(f"expected HOST:PORT with a port of 1 to 65535 in {url!r}, got {address!r}")
    return UartUrl(protocol=protocol, host=host, port=int(port), baudrate=baudrate, options=options)


def _baudrate(text: str, url: str) -> int:
    if not re.fullmatch("[0-9]{1,8}", text) or not _LOWEST <= int(text) <= _HIGHEST:
        raise ValueError(f"expected a baud rate of {_LOWEST} to {_HIGHEST} in {url!r}, got {text!r}")
    return int(text)
