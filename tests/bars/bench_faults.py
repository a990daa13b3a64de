"""Links under faults: `python -m tests.bars.bench_faults [rows|captures]`.

rows: an emulated drive at each of four links, in real time, through a TCP line that can stall; the bench's pump streams
it while a fault befalls the link. Of the rows that the drive made from the first to the last that came, so many came,
and so many are told as lost: together all, within 1 in 1,000. Where a drive's clock began anew unheard, what it made
before is not known, and told as that.

captures: recordings over each link with 1 in 1,000 frames lost, as `pmsm-bench capture` takes them: none may fail.
"""

import argparse
import contextlib
import io
import re
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from bench.cli.commands import capture
from bench.errors import BenchError
from bench.live.acquisition import Acquisition, LinkState
from drivers.block import Block
from drivers.errors import DriveError
from emulator.clock import Pacer
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from emulator.servers.faults import Faults, parse_fault
from emulator.servers.link import Link
from tests.conftest import bus_url, free_port
from tests.drivers.modbus.meddling import Meddled, meddled
from tests.proof.results import record

LINKS: Final[dict[str, Callable[[int], str]]] = {
    "canopen": bus_url,
    "modbus+tcp": lambda port: f"modbus+tcp://127.0.0.1:{port}/1",
    "modbus+rtu": lambda port: f"modbus+rtu://socket://127.0.0.1:{port}/1",
    "uart": lambda port: f"uart://socket://127.0.0.1:{port}",
}
FAULTS: Final[dict[str, tuple[str, ...]]] = {
    "none": (),
    "1 % lost": ("lose=0.01",),
    "1 % twice": ("double=0.01",),
    "1 % corrupted": ("corrupt=0.01",),
    "1 % 20 ms late": ("delay=0.01",),
    "1 % 0.5 s late": ("late=0.01",),
    "noise": ("noise=0.0001",),
    "all of these": ("lose=0.003", "double=0.003", "corrupt=0.003", "delay=0.003", "late=0.003"),
    "all lost for 0.1 s": ("lose=1@3+0.1",),
    "closed for 0.6 s": ("closed@3+0.6",),
    "closed for 3 s": ("closed@3+3",),
    "unplugged for 2 s": ("unplugged@3+2",),
    "reset": ("reset@4",),
    "bus off, or all late, for 0.3 s": ("busoff@3+0.3", "late=1@3+0.3"),
    "stalled for 0.7 s": ("stall@3+0.7",),
    "stalled for 3 s": ("stall@3+3",),
}
SPAN: Final = 9.0  # s, of a run
WITHIN: Final = 1e-3  # of the rows that the drive made
PATIENCE: Final = 20.0  # s, for the stream to be there again
CAPTURES: Final = 50  # over each link
_AT_ONCE: Final = 2  # links
_STEP: Final = 2e-3  # s, how often a drive catches up with real time
_UP: Final = 15  # s that a drive has been up at the beginning of a run
_PERIODS: Final = 20  # control periods per row


@dataclass
class Emulated:
    """A drive in real time, and the rows that it made."""

    drive: VirtualDrive
    link: Link
    faults: Faults
    line: Meddled
    ticks: list[int] = field(default_factory=list[int])  # at which they began; from 0 again after a reset
    ended: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        """Let time pass until the end."""
        pacer = Pacer(self.drive.T_s, most=500)
        while not self.ended.is_set():
            if self.faults.reset_due(self.drive.elapsed):
                self.drive.reset()
            rows = self.drive.run(pacer.due())
            self.ticks += rows.row_tick.tolist()
            self.link.publish(rows)
            self.ended.wait(pacer.wait_time(round(_STEP / self.drive.T_s)))


@dataclass(frozen=True, slots=True)
class Outcome:
    """Rows of one run."""

    made: int  # from the first to the last that came
    came: int
    lost: int  # as told
    anew: int  # times that the clock began anew
    said: str  # what the link said last

    @property
    def met(self) -> bool:
        """All are told."""
        return abs(self.made - self.came - self.lost) <= max(1.0, WITHIN * self.made)


@contextlib.contextmanager
def emulated(make_url: Callable[[int], str], texts: tuple[str, ...], seed: int) -> Generator[Emulated]:
    """A drive at a link through a line."""
    told = [parse_fault(text) for text in texts if not text.startswith("stall")]
    faults = Faults([replace(f, begin=f.begin + (_UP if f.begin else 0.0), end=f.end + _UP) for f in told], seed)
    drive = VirtualDrive(PAPER)
    drive.warm_up()
    drive.write("stream_periods", float(_PERIODS))
    for _ in range(_UP):
        drive.run(10_000)
    if any(text.startswith("reset") for text in texts):
        drive.write("store", float(int.from_bytes(b"save", "little")))
    port = free_port()
    with Link(make_url(port), drive, faults) as link, meddled(port) as line:
        bench = Emulated(drive, link, faults, line)
        thread = threading.Thread(target=bench.run, name="drive's time")
        thread.start()
        try:
            yield bench
        finally:
            bench.ended.set()
            thread.join()


def one(make_url: Callable[[int], str], texts: tuple[str, ...], seed: int = 1) -> Outcome:
    """A run."""
    blocks = list[Block]()
    with emulated(make_url, texts, seed) as bench:
        pump = Acquisition("drive", make_url(bench.line.port), blocks.append)
        pump.start()
        try:
            begun = time.monotonic()
            stalls = [re.fullmatch(r"stall@(.+)\+(.+)", text) for text in texts]
            for stall in filter(None, stalls):
                begin, length = map(float, stall.groups())
                _sleep(begun + begin)
                bench.line.open.clear()
                _sleep(begun + begin + length)
                bench.line.open.set()
            _sleep(begun + SPAN)
            heard, deadline = pump.status.rows, time.monotonic() + PATIENCE
            while pump.status.state is not LinkState.STREAMING or pump.status.rows < heard + 50:
                if time.monotonic() > deadline:
                    break
                time.sleep(0.01)
        finally:
            pump.end()
            pump.join(PATIENCE)
        link = pump.status
    first, last = int(blocks[0].tick[0]), int(blocks[-1].tick[-1])
    ticks = bench.ticks
    made = len(ticks) - ticks[::-1].index(last) - ticks.index(first)
    said = link.last_error.sentence if link.last_error else ""
    return Outcome(made, sum(map(len, blocks)), link.rows_lost, link.clock_resets, said)


def rows(only: str) -> tuple[int, int]:
    """The table of rows; of how many runs all are told, and of how many runs in all."""
    met = of = 0
    print(f"{'fault':32} {'link':12} {'made':>7} {'came':>7} {'lost':>7} {'untold':>7} {'resets':>7}")
    for name, texts in FAULTS.items():
        if only not in name:
            continue
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            runs = {link: pool.submit(one, make_url, _befalls(link, texts)) for link, make_url in LINKS.items()}
        for link, run in runs.items():
            outcome = run.result()
            untold = outcome.made - outcome.came - outcome.lost
            met, of = met + outcome.met, of + 1
            print(f"{name:32} {link:12} {outcome.made:7} {outcome.came:7} {outcome.lost:7} {untold:7} {outcome.anew:7} "
                  f"{'met' if outcome.met else 'MISSED'} {outcome.said[:60]}", flush=True)
    return met, of


def _befalls(link: str, texts: tuple[str, ...]) -> tuple[str, ...]:
    """What befalls a link: bus off one of CAN alone."""
    bus_off = [text for text in texts if text.startswith("busoff")]
    if bus_off and link == "canopen":
        return tuple(bus_off)
    return tuple(text for text in texts if text not in bus_off)


def captures(count: int) -> tuple[int, int]:
    """Captures with 1 in 1,000 frames lost; how many come, of how many."""
    failed = 0
    for link, make_url in LINKS.items():
        with emulated(make_url, ("lose=0.001",), seed=3) as bench, tempfile.TemporaryDirectory() as folder:
            begun, errors = time.monotonic(), list[str]()
            for k in range(count):
                out = Path(folder) / f"{k}.parquet"
                try:
                    with contextlib.redirect_stdout(io.StringIO()):
                        capture.directly(make_url(bench.line.port), {"length": 1000}, out)
                except (BenchError, DriveError) as error:
                    errors.append(str(error))
            failed += len(errors)
            took = time.monotonic() - begun
            print(f"{link:12} {count - len(errors)} of {count} captures, {took:.0f} s", *errors, sep="\n  ", flush=True)
    of = len(LINKS) * count
    print(f"{of - failed} of {of} captures at lose=0.001")
    return of - failed, of


def main(arguments: list[str] | None = None) -> int:
    """Print the tables. 0 when every bar is met."""
    parser = argparse.ArgumentParser("bench_faults", description=__doc__)
    parser.add_argument("what", nargs="?", choices=["rows", "captures"], help="both where not given")
    parser.add_argument("--only", default="", help="faults whose name has this in it")
    parser.add_argument("--count", type=int, default=CAPTURES, help="captures over each link")
    options = parser.parse_args(arguments)
    told, of = (0, 0) if options.what == "captures" else rows(options.only)
    came, asked = (0, 0) if options.what == "rows" else captures(options.count)
    if of and asked and not options.only:
        record("service.faults", f"{told} of {of} within 1 in 1,000; {came} of {asked}")
    return 0 if (told, came) == (of, asked) else 1


def _sleep(until: float) -> None:
    time.sleep(max(0.0, until - time.monotonic()))


if __name__ == "__main__":
    sys.exit(main())
