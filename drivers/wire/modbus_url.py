"""The address of a Modbus drive: `modbus+tcp://HOST[:PORT][?timeout=S]/UNIT` or `modbus+rtu://DEVICE[?...]/UNIT`.

DEVICE is a path (`modbus+rtu:///dev/ttyUSB0/1`), a port's name (`modbus+rtu://COM3/1`), or an address of pyserial's as
it stands (`modbus+rtu://socket://host:port/1`, `modbus+rtu://rfc2217://host:port?baudrate=19200/1`). `timeout` is how
long an answer may take, in s, besides its time on the line: for slow gateways. Bench and virtual
drive stand at two ends of the same URL. Pure; opens nothing.
"""

import re
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl, urlsplit

TCP: Final = "modbus+tcp"
RTU: Final = "modbus+rtu"
FORMS: Final = f"{TCP}://HOST[:PORT]/UNIT or {RTU}://DEVICE[?baudrate=115200&parity=N&stopbits=1]/UNIT"
_TIMEOUTS: Final = (0.05, 10.0)  # s
_PORT: Final = 502
_MOST_UNIT: Final = {TCP: 255, RTU: 247}
_PARITIES: Final = ("N", "E", "O")


@dataclass(frozen=True, slots=True)
class TcpPlace:
    """A host and its port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialPlace:
    """A serial line: 8 data bits."""

    device: str
    baudrate: int = 115200  # bit/s
    parity: str = "N"
    stopbits: int = 1

    def __str__(self) -> str:
        return self.device


@dataclass(frozen=True, slots=True)
class ModbusUrl:
    """A unit on a line."""

    place: TcpPlace | SerialPlace
    unit: int
    timeout: float | None = None  # s for an answer; None: as usual

    def __str__(self) -> str:
        """In words, for messages."""
        return f"unit {self.unit} {'at' if isinstance(self.place, TcpPlace) else 'on'} {self.place}"


def parse_modbus_url(url: str) -> ModbusUrl:
    """Take a Modbus URL apart. Raises ValueError, in a sentence, when it is none."""
    scheme, separator, rest = url.partition("://")
    if scheme not in (TCP, RTU) or not separator:
        raise ValueError(f"expected a URL that starts with {TCP}:// or {RTU}://, got {url!r}")
    place, separator, unit = rest.rpartition("/")
    if not separator or not place:
        raise ValueError(f"expected {FORMS}, got {url!r}")
    highest = _MOST_UNIT[scheme]
    number = _number(unit)
    if number is None or not 1 <= number <= highest:
        raise ValueError(f"expected a unit of 1 to {highest} at the end of {url!r}, got {unit!r}")
    device, options = _taken_apart(place, url)
    timeout = _timeout(options.pop("timeout", None), url)
    if scheme == RTU:
        return ModbusUrl(_serial(device, options, url), number, timeout)
    if options:
        raise ValueError(f"expected {TCP}://HOST[:PORT][?timeout=S]/UNIT, got {', '.join(sorted(options))} in {url!r}")
    return ModbusUrl(_tcp(device, url), number, timeout)


def _taken_apart(place: str, url: str) -> tuple[str, dict[str, str]]:
    """A place and its options."""
    device, mark, query = place.partition("?")
    try:
        return device, dict(parse_qsl(query, strict_parsing=True)) if mark else {}
    except ValueError:
        raise ValueError(f"expected option=value after the '?' of {url!r}, got {query!r}") from None


def _timeout(text: str | None, url: str) -> float | None:
    if text is None:
        return None
    if not re.fullmatch(r"[0-9]{1,2}(\.[0-9]{1,3})?", text) or not _TIMEOUTS[0] <= float(text) <= _TIMEOUTS[1]:
        raise ValueError(f"expected a timeout of {_TIMEOUTS[0]:g} to {_TIMEOUTS[1]:g} s in {url!r}, got {text!r}")
    return float(text)


def _tcp(place: str, url: str) -> TcpPlace:
    form = f"{TCP}://HOST[:PORT]/UNIT"
    try:
        parts = urlsplit(f"//{place}")
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f"expected {form}, got {url!r} ({error})") from None
    if not host or port == 0 or parts.path or parts.query or parts.fragment or "@" in place:
        raise ValueError(f"expected {form}, got {url!r}")
    return TcpPlace(host, _PORT if port is None else port)


def _serial(device: str, options: dict[str, str], url: str) -> SerialPlace:
    if not device or any(not character.isprintable() for character in device):
        raise ValueError(f"expected {RTU}://DEVICE[?option=value]/UNIT, got {url!r}")
    unknown = sorted(options.keys() - {"baudrate", "parity", "stopbits"})
    if unknown:
        raise ValueError(
            f"expected the options baudrate, parity, stopbits and timeout in {url!r}, got {', '.join(unknown)}"
        )
    baudrate = _number(options.get("baudrate", "115200"))
    if baudrate is None or not 300 <= baudrate <= 12_000_000:
        raise ValueError(f"expected a baudrate of 300 to 12000000 in {url!r}, got {options['baudrate']!r}")
    parity = options.get("parity", "N")
    if parity not in _PARITIES:
        raise ValueError(f"expected a parity of {', '.join(_PARITIES)} in {url!r}, got {parity!r}")
    stopbits = options.get("stopbits", "1")
    if stopbits not in ("1", "2"):
        raise ValueError(f"expected stopbits of 1 or 2 in {url!r}, got {stopbits!r}")
    return SerialPlace(device, baudrate, parity, int(stopbits))


def _number(text: str) -> int | None:
    return int(text) if re.fullmatch("[0-9]{1,8}", text) else None
