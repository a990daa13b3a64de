"""The address of a CANopen drive: `canopen://INTERFACE/[HOST:PORT/]CHANNEL/NODE[?option=value&...]`.

A channel that is a serial adapter's device keeps its slash: `canopen://slcan//dev/ttyACM0/5?bitrate=1000000`.
Bench and virtual drive stand at two ends of the same URL. Pure; opens nothing.
"""

import re
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, urlsplit

FORMS = (
    "canopen://socketcan/CHANNEL/NODE, canopen://socketcand/HOST:PORT/CHANNEL/NODE "
    "or canopen://INTERFACE/CHANNEL/NODE[?option=value]"
)

_SETS_UP = {"socketcan": "the system sets the bus up (ip link)", "socketcand": "its server sets the bus up"}


@dataclass(frozen=True, slots=True)
class CanUrl:
    """A node on a bus. `host` and `port` are set for `socketcand` alone; `options` go to the CAN interface."""

    interface: str
    channel: str
    node_id: int
    host: str | None = None
    port: int | None = None
    options: dict[str, str] = field(default_factory=dict[str, str])

    @property
    def bus(self) -> str:
        """The bus in words, for messages."""
        return f"{self.interface} {self.channel}" + (f" at {self.host}:{self.port}" if self.host else "")


def parse_can_url(url: str) -> CanUrl:
    """Take a CANopen URL apart. Raises ValueError, in a sentence, when it is none."""
    try:
        parts = urlsplit(url)
        fields = [parts.netloc, *parts.path.removeprefix("/").rstrip("/").split("/")]
        options = dict(parse_qsl(parts.query, strict_parsing=True)) if parts.query else {}
    except ValueError as error:
        raise ValueError(f"expected {FORMS}, got {url!r} ({error})") from None
    if parts.scheme != "canopen":
        raise ValueError(f"expected a URL that starts with canopen://, got {url!r}")
    interface, *middle, node = fields
    if options and interface in _SETS_UP:
        raise ValueError(f"{interface} takes no options, {_SETS_UP[interface]}; got {', '.join(options)} in {url!r}")
    if interface == "socketcand":
        if len(middle) != 2 or not middle[1]:
            raise ValueError(f"expected canopen://socketcand/HOST:PORT/CHANNEL/NODE, got {url!r}")
        host, _, port = middle[0].rpartition(":")
        if not host or not _counts_to(65535, port):
            raise ValueError(f"expected HOST:PORT with a port of 1 to 65535 in {url!r}, got {middle[0]!r}")
        return CanUrl(interface, middle[1], _node_id(node, url), host, int(port))
    channel = "/".join(middle)
    device = interface not in _SETS_UP and re.fullmatch(r"/[^\0]*[^/\0]", channel)
    if not interface or not channel or ("/" in channel and not device):
        raise ValueError(f"expected {FORMS}, got {url!r}")
    return CanUrl(interface, channel, _node_id(node, url), options=options)


def _node_id(text: str, url: str) -> int:
    if not _counts_to(127, text):
        raise ValueError(f"expected a node of 1 to 127 at the end of {url!r}, got {text!r}")
    return int(text)


def _counts_to(highest: int, text: str) -> bool:
    """Whether the text is a number of 1 to `highest`, five digits at most."""
    return re.fullmatch("[0-9]{1,5}", text) is not None and 1 <= int(text) <= highest
