"""`python -m emulator`: the virtual drive in real time, at the URL that a bench connects to."""

import argparse
import signal
import sys
import threading
from pathlib import Path

from drivers.wire.can_url import parse_can_url
from emulator.bounds import ScenarioError
from emulator.canopen_server import CanopenNode
from emulator.clock import Pacer
from emulator.scenarios import BUILT_IN, Scenario, load
from emulator.socketcand import BusError
from emulator.virtual_drive import VirtualDrive

DEFAULT_URL = "canopen://socketcand/127.0.0.1:29536/can0/5"
_STEP = 2e-3  # s, how often the virtual drive catches up with real time
_CATCH_UP = 0.05  # s, most that it runs at once


def main(arguments: list[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM. 0 at the end, 2 when it cannot start."""
    parser = argparse.ArgumentParser("pmsm-bench emulate", description=__doc__)
    parser.add_argument("--at", default=DEFAULT_URL, metavar="URL", help=f"where to be (default {DEFAULT_URL})")
    parser.add_argument("--scenario", default="paper", metavar="NAME|FILE.toml", help="what to emulate (default paper)")
    parser.add_argument("--with-input", action="store_true", help="end when standard input does, as with its parent")
    options = parser.parse_args(arguments)
    stop = threading.Event()
    if options.with_input:
        threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), name="input", daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stop.set())
    try:
        run(scenario_named(options.scenario), options.at, stop)
    except (ScenarioError, BusError, ValueError) as error:
        print(f"pmsm-bench emulate: {error}", file=sys.stderr)
        return 2
    return 0


def scenario_named(name: str) -> Scenario:
    """A built-in scenario, or the one in a file. Raises ScenarioError."""
    return BUILT_IN[name] if name in BUILT_IN else load(Path(name))


def run(scenario: Scenario, url: str, stop: threading.Event) -> None:
    """Be the scenario's drive at a URL, in real time, until told to stop."""
    place = parse_can_url(url)
    drive = VirtualDrive(scenario)
    drive.warm_up()
    with CanopenNode(drive, place) as node:
        print(f"emulated drive {scenario.name!r} is at {url}", flush=True)
        pacer = Pacer(drive.T_s, most=round(_CATCH_UP / drive.T_s))
        while not stop.is_set():
            node.publish(drive.run(pacer.due()))
            stop.wait(pacer.wait_time(round(_STEP / drive.T_s)))


if __name__ == "__main__":
    sys.exit(main())
