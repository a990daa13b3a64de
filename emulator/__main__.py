"""`python -m emulator`: the virtual drive in real time, at the URLs that a bench connects to.

`python -m emulator conceal`: recordings in which an effect is concealed, see `emulator.conceal`.
"""

import argparse
import errno
import json
import os
import signal
import sys
import threading
import zlib
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from emulator.bounds import ScenarioError
from emulator.clock import Pacer, Present
from emulator.drive.memory import Memory
from emulator.drive.virtual_drive import VirtualDrive
from emulator.errors import BusError
from emulator.input_file import one_line
from emulator.scenario.data_sheet import data_sheet
from emulator.scenario.scenarios import BUILT_IN, CONTROLS, Scenario, load
from emulator.servers.faults import FORMS, Faults, parse_fault, script
from emulator.servers.link import Link

DEFAULT_URL = "canopen://socketcand/127.0.0.1:29536/can0/5"
_STEP = 10e-3  # s, how often the virtual drive catches up with real time, where nobody asks it to
_CATCH_UP = 0.05  # s, most that it runs at once


def main(arguments: list[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM. 0 at the end, 2 when it cannot start, 1 when it cannot say that it has."""
    parser = argparse.ArgumentParser("pmsm-bench emulate", description=__doc__)
    parser.add_argument(
        "--at", action="append", metavar="URL", help=f"where to be; may be repeated (default {DEFAULT_URL})"
    )
    parser.add_argument("--scenario", default="paper", metavar="NAME|FILE.toml", help="what to emulate (default paper)")
    parser.add_argument(
        "--fault", action="append", default=[], metavar="FAULT", help=f"what befalls its links, repeatable: {FORMS}"
    )
    parser.add_argument("--fault-script", metavar="FILE", help="faults from a file, one a line, '#' for comments")
    parser.add_argument(
        "--control", choices=CONTROLS, help="who starts it, in place of the scenario's drive.control: "
        "a client with its lease, a master inside it, or anybody, as before there were leases"
    )
    parser.add_argument(
        "--memory", metavar="FILE", help="where it keeps what it stores, also over its own end (default: in memory)"
    )
    parser.add_argument("--with-input", action="store_true", help="end when standard input does, as with its parent")
    options = parser.parse_args(arguments)
    stop = threading.Event()
    if options.with_input:
        threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), name="input", daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stop.set())
    try:
        told = [parse_fault(text) for text in options.fault]
        faults = Faults(told + (script(Path(options.fault_script)) if options.fault_script else []))
        urls = options.at or [DEFAULT_URL]
        faults.check_links(can=any(url.startswith("canopen://") for url in urls))
        scenario = scenario_named(options.scenario)
        if options.control is not None:
            scenario = replace(scenario, drive=replace(scenario.drive, control=options.control))
        memory = _memory(options.memory)
        run(scenario, urls, stop, faults, memory, tell_data=options.with_input)
    except (ScenarioError, BusError, ValueError) as error:
        print(f"pmsm-bench emulate: {one_line(error)}", file=sys.stderr)
        return 2
    except OSError as error:  # of standard output: links have sentences of their own
        if error.errno != errno.EPIPE:
            print(f"pmsm-bench emulate: cannot write: {error.strerror}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is still to be written at the end
        return 2
    return 0


def scenario_named(name: str) -> Scenario:
    """A built-in scenario, or the one in a file. Raises ScenarioError."""
    return BUILT_IN[name] if name in BUILT_IN else load(Path(name))


def _memory(path: str | None) -> Memory:
    """Raises ValueError, in a sentence."""
    try:
        return Memory(None if path is None else Path(path))
    except OSError as error:
        raise ValueError(f"the drive's memory cannot be kept in {path}: {error.strerror}") from None


def run(
    scenario: Scenario, urls: Sequence[str], stop: threading.Event, faults: Faults, memory: Memory,
    *, tell_data: bool = False,
) -> None:  # fmt: skip
    """Be the scenario's drive at some URLs, in real time, until told to stop.

    `tell_data`: its data sheet as JSON, in the line after the first, for the parent, whose bench starts it.
    """
    serial = zlib.crc32(urls[0].encode()) or 1  # the same whenever it is started there
    drive = VirtualDrive(scenario, serial, on_links=True, memory=memory)
    drive.warm_up()
    with ExitStack() as opened:
        present = opened.enter_context(Present())
        links = [opened.enter_context(Link(url, drive, faults, present.awaited)) for url in urls]
        print(f"emulated drive {scenario.name!r} is at {' and '.join(urls)}", flush=True)
        if tell_data:
            print(json.dumps(data_sheet(scenario)), flush=True)
        pacer = Pacer(drive.T_s, most=round(_CATCH_UP / drive.T_s))
        while not stop.is_set():
            if faults.reset_due(drive.elapsed):
                drive.reset()
            rows = drive.run(pacer.due())
            for link in links:
                link.publish(rows)
            present.reached()
            present.wait(pacer.wait_time(round(_STEP / drive.T_s)))


def _conceal(arguments: list[str]) -> int:
    from emulator.conceal.command import main as conceal

    return conceal(arguments)


if __name__ == "__main__":
    sys.exit(_conceal(sys.argv[2:]) if sys.argv[1:2] == ["conceal"] else main())
