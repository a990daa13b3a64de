"""The canopen library's own client, which knows our node by our data sheet alone. It shares no code with our client."""

import contextlib
import io
from collections.abc import Generator
from typing import Any

import canopen

from drivers.wire.can_url import parse_can_url
from drivers.wire.canopen_od import eds
from tests.support.served_drive import PATIENCE


def data_sheet() -> Any:
    """Our EDS as a file that the library reads."""
    source: Any = io.StringIO(eds())
    source.name = "pmsm-bench.eds"
    return source


@contextlib.contextmanager
def library_client(at: str) -> Generator[Any]:
    """The library's `RemoteNode` for the node at a URL."""
    url = parse_can_url(at)
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(interface=url.interface, channel=url.channel)
    try:
        node = network.add_node(url.node_id, data_sheet())
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        yield node
    finally:
        network.disconnect()
