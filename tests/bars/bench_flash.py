"""Flashes that are cut: by links that lose, corrupt and end, by resets, power that fails, processes that are killed.

`python -m tests.bars.bench_flash [--count 1000] [--link NAME] [--times 5]`

Each time a set is flashed into an emulated drive, a process with a memory on disk, by a process of its own, and one
fault befalls it at a random instant. Afterwards the drive is started anew without faults, and its memory read: it is to
hold the values before or the new ones, and no mixture; a flash that left its journal is finished or rolled back, by
chance, and has to come out so. Printed, too: how long a flash without faults takes, of all scalars, and with the four
tables.
"""

import argparse
import contextlib
import random
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIGKILL
from subprocess import PIPE, TimeoutExpired
from typing import Any

from bench.errors import BenchError
from bench.parameters.flash import Around, End, cut, flash, parameters, resume
from bench.parameters.link import OwnLink
from bench.parameters.parameter_set import FLASHED, ParameterSet, as_toml, read, set_of
from bench.parameters.plan import different
from drivers.connect import connect
from drivers.errors import DriveError
from drivers.wire.dictionary import WireType
from tests.bars.bench_kills import LINKS
from tests.support.forked import Forked
from tests.support.served_drive import emulator, ready

FAULTS = ("lose=0.02", "corrupt=0.02", "late=0.01", "closed@{t}+0.4", "unplugged@{t}+0.5", "reset@{t}", "power", "kill")
SECONDS = {"canopen": (3.0, 6.0), "modbus+tcp": (2.0, 3.0), "modbus+rtu": (2.0, 3.0), "uart": (1.0, 2.0)}
"""Bars: s that a flash of 60 scalars takes, and of them with four tables."""
ENDS = {10: "flashed", 11: "rolled back", 12: "cut", 13: "refused"}
"""By exit codes that no interpreter gives by itself."""
EXPECTED = {"": ("flashed",), "kill": ("flashed", "killed"), "power": (*ENDS.values(), "killed")}
"""Of faults after which a flash may not end as any."""
HIT = 0.5  # share of the faults with an instant, at least, that have to befall a flash under way
_FLASH = 90.0  # s, most for one
_LATER = 1.3  # times as long as a flash takes alone, within which faults are: beside others it takes longer
_GO = 3.0  # s from the drive's start to the flash, whose process is ready by then


@dataclass
class Seen:
    """One flash."""

    link: str
    fault: str
    ended: str = ""
    memory: str = ""  # "old", "new" or what is neither
    resumed: str = ""
    took: float = 0.0  # s
    hit: bool | None = None  # its fault befell it while it was under way; None: it has no instant
    wrong: list[str] = field(default_factory=list[str])


def new_set(
    present: dict[str, float], first: dict[str, float], chance: random.Random, *, tables: bool
) -> ParameterSet:
    """All scalars a little lower than at first, as far as that may be, and with them the tables."""
    values = dict[str, float]()
    for signal in FLASHED:
        now = present[signal.name]
        if signal.table:
            values |= {signal.name: now + chance.uniform(1e-4, 1e-3)} if tables else {}
            continue
        if signal.type is WireType.F32:
            before = first[signal.name]
            wanted = before * chance.uniform(0.8, 0.99) if before else 1e-6 * chance.uniform(0.5, 1.0)
        else:
            wanted = now - 1 if now > (signal.minimum or 0) else now + 1
        low, high = signal.minimum, signal.maximum
        wanted = wanted if low is None else max(wanted, low)
        values[signal.name] = wanted if high is None else min(wanted, high)
    return set_of(values, "drawn", "by chance")


def flashed(
    link: str, url: str, folder: Path, fault: str, chance: random.Random, takes: Sequence[float],
    first: dict[str, float], *, tables: bool,
) -> Seen:  # fmt: skip
    """One flash under one fault, and what the drive's memory then holds; `takes`: s, without faults, without and with
    tables. `first`: the drive's values as delivered, SI.
    """
    seen, memory, journals = Seen(link, fault), folder / "memory", folder / "journals"
    with drive_at(url, memory), connect(url) as drive:
        before = parameters(drive)
    wanted = new_set(before, first, chance, tables=tables)
    (folder / "set.toml").write_text(as_toml(wanted), encoding="utf-8")
    instant = chance.uniform(0.0, _LATER * takes[tables]) if fault else 0.0  # from the flash's beginning
    _under_fault(seen, url, folder, instant, nobody=chance.random() < 0.5)
    new = before | wanted.values
    with drive_at(url, memory), connect(url) as drive:
        now = parameters(drive)
        seen.memory = "new" if not different(new, now) else "old" if not different(before, now) else "a mixture"
        if seen.memory == "a mixture":
            seen.wrong.append(f"neither: {different(new, now)[:3]}, {different(before, now)[:3]}")
        if seen.ended not in EXPECTED.get(fault, tuple(ENDS.values())):
            seen.wrong.append(f"it ended as {seen.ended}")
        if (seen.ended, seen.memory) in (("flashed", "old"), ("rolled back", "new"), ("refused", "new")):
            seen.wrong.append(f"{seen.ended}, and its memory is {seen.memory}")
        if cut(drive.identity, journals) is not None:
            finish = chance.random() < 0.5
            done = resume(lambda: drive, Around(journals, url), finish=finish)
            seen.resumed = str(done.end)
            if done.end is not (End.FLASHED if finish else End.ROLLED_BACK):
                seen.wrong.append(f"resumed: {done.said}")
            if different(new if finish else before, parameters(drive)):
                seen.wrong.append("resumed, and it is not so")
        elif seen.ended == "cut":
            seen.wrong.append("cut, and there is no journal")
    return seen


def _under_fault(seen: Seen, url: str, folder: Path, instant: float, *, nobody: bool) -> None:
    """A flash by a process of its own; `instant`: of the fault, s after its beginning. `nobody`: who flashes ends with
    the drive's power.
    """
    fault = seen.fault
    words = ["--fault", fault.format(t=f"{_GO + instant:.3f}")] if fault not in ("", "power", "kill") else []
    with drive_at(url, folder / "memory", *words) as process:
        go_at = time.monotonic() + _GO * ("@" in fault)
        arguments = "--flash", url, str(folder / "journals"), str(folder / "set.toml")
        with Forked("tests.bars.bench_flash", *arguments, stdin=PIPE, stdout=PIPE) as worker:
            assert worker.stdin is not None
            assert worker.stdout is not None
            worker.stdout.readline()  # it is ready
            time.sleep(max(0.0, go_at - time.monotonic()))
            with contextlib.suppress(BrokenPipeError):  # it could not reach the drive
                worker.stdin.write("go\n")
                worker.stdin.flush()
            told = [float(worker.stdout.readline() or "nan")]  # when it begins
            if fault in ("power", "kill"):
                time.sleep(instant)
                process.kill() if fault == "power" else worker.kill()
                if fault == "power" and nobody:
                    worker.kill()
            try:
                seen.ended = ENDS.get(code := worker.wait(_FLASH), "killed" if code == -SIGKILL else "failed")
            except TimeoutExpired:
                worker.kill()
                seen.ended = "too long"
            told += [float(line) for line in worker.stdout.read().split()]  # and when it has ended
    seen.took = told[-1] - told[0]
    if "@" in fault or fault in ("power", "kill"):
        at = instant + (go_at if "@" in fault else told[0])
        seen.hit = told[0] <= at and (len(told) == 1 or at <= told[1])


@contextlib.contextmanager
def drive_at(url: str, memory: Path, *words: str) -> Generator[Any]:
    """A drive with this memory, as a process."""
    with emulator("--at", url, "--memory", str(memory), *words, control="lease") as process:
        ready(process)
        yield process


def on_link(name: str, count: int, found: list[Seen]) -> None:
    """So many flashes over one link, one fault after the other."""
    chance = random.Random(name)
    with tempfile.TemporaryDirectory() as folder:
        with drive_at(url := LINKS[name](), Path(folder) / "memory"), connect(url) as drive:
            first = parameters(drive)
        plain = [
            flashed(name, LINKS[name](), Path(folder), "", chance, (), first, tables=tables) for tables in (False, True)
        ]
        if wrong := [word for one in plain for word in one.wrong]:
            print(f"FAIL {name} without a fault: {'; '.join(wrong)}", flush=True)
            return
        takes = [one.took for one in plain]
        for k in range(count):
            fault, tables = FAULTS[k % len(FAULTS)], chance.random() < 0.5
            try:
                seen = flashed(name, LINKS[name](), Path(folder), fault, chance, takes, first, tables=tables)
            except (BenchError, DriveError, OSError) as error:
                seen = Seen(name, fault, wrong=[f"{type(error).__name__}: {error}"])
            found.append(seen)
            if len(found) % 100 == 0:
                print(f"  {len(found)} done", flush=True)
            if seen.wrong:
                print(f"FAIL {name} {fault}: {'; '.join(seen.wrong)}", flush=True)


def timed(name: str, times: int) -> tuple[float, float]:
    """Medians (s) of flashes without faults: of scalars alone, and with the tables."""
    url, chance, medians = LINKS[name](), random.Random(1), list[float]()
    with tempfile.TemporaryDirectory() as folder, emulator("--at", url, control="lease") as process:
        ready(process)
        with connect(url) as drive:
            first = parameters(drive)
            for tables in (False, True):
                took = list[float]()
                for _ in range(times):
                    wanted = new_set(parameters(drive), first, chance, tables=tables)
                    begun = time.monotonic()
                    done = flash(lambda: drive, wanted, Around(Path(folder), url))
                    took.append(time.monotonic() - begun)
                    assert done.end is End.FLASHED, done.said
                medians.append(statistics.median(took))
    return medians[0], medians[1]


def main(arguments: list[str] | None = None) -> int:
    """0 where every memory is as it was or as it was to be, and flashes are as quick as they are to be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="flashes under faults, over all links")
    parser.add_argument("--times", type=int, default=5, help="flashes that are timed, each")
    parser.add_argument("--link", choices=LINKS, action="append")
    parser.add_argument("--flash", nargs=3, metavar=("URL", "FOLDER", "SET"), help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.flash:
        return _flash(*options.flash)
    links, found, missed = options.link or list(LINKS), list[Seen](), 0
    print(f"{len([s for s in FLASHED if not s.table])} scalars; s of a flash, median, bar; with four tables, bar")
    for name in links:
        (scalars, all_), bars = timed(name, options.times), SECONDS[name]
        missed += scalars > bars[0] or all_ > bars[1]
        print(f"  {name:10}  {scalars:.2f}  {bars[0]:g}    {all_:.2f}  {bars[1]:g}", flush=True)
    each = -(-options.count // len(links))
    threads = [threading.Thread(target=on_link, args=(link, each, found)) for link in links]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for fault in FAULTS:
        ends = Counter(f"{one.ended}, memory {one.memory}" for one in found if one.fault == fault)
        print(f"  {fault:16} {', '.join(f'{end}: {n}' for end, n in sorted(ends.items()))}")
    resumed = Counter(one.resumed for one in found if one.resumed)
    print(f"  journals that were left: {', '.join(f'{end}: {n}' for end, n in sorted(resumed.items())) or 'none'}")
    good = sum(not one.wrong for one in found)
    instants = [one.hit for one in found if one.hit is not None]
    print(f"  faults with an instant that befell a flash under way: {sum(instants)} of {len(instants)}")
    missed += sum(instants) < HIT * len(instants)
    mixtures = sum(one.memory == "a mixture" for one in found)
    print(f"{good} of {each * len(links)} as they should be; a mixture in {mixtures}")
    return int(good < each * len(links) or missed > 0)


def _flash(url: str, folder: str, path: str) -> int:
    """By a process of its own, which reaches the drive anew where its link ends; how it ended."""
    try:
        with OwnLink(url) as link:
            print("ready", flush=True)
            sys.stdin.readline()
            print(time.monotonic(), flush=True)
            end = str(flash(link, read(Path(path)), Around(Path(folder), url)).end)
    except (BenchError, DriveError):
        end = "refused"
    with contextlib.suppress(BrokenPipeError):
        print(time.monotonic(), flush=True)
    return {ended: code for code, ended in ENDS.items()}[end]


if __name__ == "__main__":
    sys.exit(main())
