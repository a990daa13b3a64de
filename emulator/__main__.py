"""`python -m emulator`: the virtual drive in real time, at the URLs that a bench connects to."""

import argparse
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from drivers.wire.can_url import parse_can_url
from drivers.wire.modbus_url import parse_modbus_url
from drivers.wire.uart_url import parse_uart_url
from emulator.bounds import ScenarioError
from emulator.canopen_server import CanopenNode
from emulator.clock import Pacer
from emulator.faults import FORMS, Faults, parse_fault
from emulator.modbus_server import ModbusServer
from emulator.scenarios import BUILT_IN, Scenario, load
from emulator.socketcand import BusError
from emulator.uart_server import UartServer
from emulator.virtual_drive import StreamRows, VirtualDrive

DEFAULT_URL = "canopen://socketcand/127.0.0.1:29536/can0/5"
_STEP = 2e-3  # s, how often the virtual drive catches up with real time
_CATCH_UP = 0.05  # s, most that it runs at once


def main(arguments: list[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM. 0 at the end, 2 when it cannot start."""
    parser = argparse.ArgumentParser("pmsm-bench emulate", description=__doc__)
    parser.add_argument(
        "--at", action="append", metavar="URL", help=f"where to be; may be repeated (default {DEFAULT_URL})"
    )
    parser.add_argument("--scenario", default="paper", metavar="NAME|FILE.toml", help="what to emulate (default paper)")
    parser.add_argument(
        "--fault", action="append", default=[], metavar="FAULT", help=f"what befalls its links, repeatable: {FORMS}"
    )
    parser.add_argument("--with-input", action="store_true", help="end when standard input does, as with its parent")
    options = parser.parse_args(arguments)
    stop = threading.Event()
    if options.with_input:
        threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), name="input", daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stop.set())
    try:
        faults = Faults(parse_fault(text) for text in options.fault)
        run(scenario_named(options.scenario), options.at or [DEFAULT_URL], stop, faults)
    except (ScenarioError, BusError, ValueError) as error:
        print(f"pmsm-bench emulate: {error}", file=sys.stderr)
        return 2
    return 0


def scenario_named(name: str) -> Scenario:
    """A built-in scenario, or the one in a file. Raises ScenarioError."""
    return BUILT_IN[name] if name in BUILT_IN else load(Path(name))


class Server(Protocol):
    """The drive's end of a link; serves from construction to the end of its context."""

    def publish(self, rows: StreamRows) -> None:
        """Send what has become due. Called after every run of the virtual drive."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def run(scenario: Scenario, urls: Sequence[str], stop: threading.Event, faults: Faults) -> None:
    """Be the scenario's drive at some URLs, in real time, until told to stop."""
    drive = VirtualDrive(scenario)
    drive.warm_up()
    with ExitStack() as links:
        servers = [links.enter_context(server_at(url, drive, faults)) for url in urls]
        print(f"emulated drive {scenario.name!r} is at {' and '.join(urls)}", flush=True)
        pacer = Pacer(drive.T_s, most=round(_CATCH_UP / drive.T_s))
        while not stop.is_set():
            if faults.reset_due(drive.elapsed):
                drive.reset()
            rows = drive.run(pacer.due())
            for server in servers:
                server.publish(rows)
            stop.wait(pacer.wait_time(round(_STEP / drive.T_s)))


def server_at(url: str, drive: VirtualDrive, faults: Faults) -> Server:
    """The drive's end of the link that a URL names. Raises ValueError, BusError."""
    if url.startswith("uart://"):
        return UartServer(drive, parse_uart_url(url))
    if url.startswith("modbus+"):
        return ModbusServer(drive, parse_modbus_url(url), faults)
    return CanopenNode(drive, parse_can_url(url), faults)


if __name__ == "__main__":
    sys.exit(main())
