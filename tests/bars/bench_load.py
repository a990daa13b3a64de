"""A bench at work: four emulated drives of 1,000 rows a second, all recorded, with those who look on.

`python -m tests.bars.bench_load [--minutes 10]`

Each drive is on a link of another kind, and moves its currents. 20 event streams are read, and REST is asked 50 times a
second, over connections that stay. Looked at: rows lost on disk, the time of answers, memory of the service from a
warm-up on, and processor time of service and drives together. Who asks is a process of its own, and not counted.
"""

import argparse
import asyncio
import contextlib
import itertools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import httpx
import numpy as np

from bench.recordings.recording import open_recording, whole
from bench.recordings.table import check_undamaged
from tests.bars.bench_idle import LINKS, ROWS, SET_POINTS
from tests.bars.bench_links import load, processor_of
from tests.conftest import command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, until

STREAMS: Final = 20
RATE: Final = 50.0  # requests a second
CONNECTIONS: Final = 10  # that they come over, in turn
PATHS: Final = ("", "/estimates", "/window", "/recordings")  # that are asked for, of each drive
BARS: Final = {"p99": 50e-3, "memory": 5.0, "cores": 1.0}  # s, MB, cores
WARM_UP: Final = 60.0  # s, or a tenth of all: until buffers of fixed size have been used once
PATIENCE: Final = 60.0  # s
_KEPT: Final = 0.99  # of the rows that real time asks for: fewer, and the emulated drives were held up


@dataclass
class Found:
    """What came of it."""

    answers: list[float] = field(default_factory=list[float])  # s that each took
    refused: int = 0  # requests that had another answer than 200, or none
    events: int = 0
    memory: tuple[float, float] = (0.0, 0.0)  # MB, after the warm-up and at the end
    wall: float = 0.0  # s, from the warm-up on
    cores: tuple[float, float] = (0.0, 0.0)  # of the service, and of all drives
    rows: list[int] = field(default_factory=list[int])  # on disk, of each drive
    lost: int = 0  # on disk
    seconds: list[float] = field(default_factory=list[float])  # of each recording
    wrong: list[str] = field(default_factory=list[str])


@contextlib.contextmanager
def _bench(folder: Path) -> Generator[tuple[str, int, list[int]]]:
    """Four drives, one on each kind of link, and the service over them: its address, its process, theirs."""
    with contextlib.ExitStack() as stack:
        port, drives, lines = free_port(), list[int](), list[str]()
        for name, new_url in LINKS.items():
            process = stack.enter_context(emulator("--at", url := new_url(), control="lease"))
            ready(process)
            drives.append(process.pid)
            lines.append(f'[drives.{name.replace("+", "-")}]\nurl = "{url}"\n')
        config = folder / "bench.toml"
        config.write_text('[service]\ncaptures = "captures"\n' + "".join(lines), encoding="utf-8")
        process = stack.enter_context(command("serve", "--config", str(config), "--port", str(port)))
        url = f"http://127.0.0.1:{port}/api"
        wait_for_answer(f"{url}/health", process)
        until(lambda: httpx.get(f"{url}/health").json()["status"] == "ok", "not all drives stream")
        yield url, process.pid, drives


def measured(minutes: float) -> Found:
    """A bench of its own under this load."""
    with tempfile.TemporaryDirectory() as folder, _bench(Path(folder)) as (url, service, drives):
        return _measured(url, service, drives, minutes * 60.0, Path(folder) / "captures")


def _measured(url: str, service: int, drives: list[int], seconds: float, folder: Path) -> Found:
    names = [drive["name"] for drive in _asked("GET", f"{url}/drives")["drives"]]
    for name in names:
        _asked("POST", f"{url}/drives/{name}/start", json=SET_POINTS)
    ids = [_asked("POST", f"{url}/drives/{name}/recordings", json={"title": "load"})["id"] for name in names]
    warm_up, found = min(WARM_UP, 0.1 * seconds), Found()
    loading = [sys.executable, "-m", "tests.bars.bench_load", "--load", url, str(seconds)]
    with subprocess.Popen(loading, stdout=subprocess.PIPE, text=True) as process:
        time.sleep(warm_up)
        began, first = time.monotonic(), _memory(service)
        used = processor_of(service), sum(map(processor_of, drives))
        time.sleep(seconds - warm_up)
        found.wall = time.monotonic() - began
        found.cores = (
            (processor_of(service) - used[0]) / found.wall, (sum(map(processor_of, drives)) - used[1]) / found.wall
        )
        found.memory = first, _memory(service)
        told = json.loads(process.communicate(timeout=PATIENCE)[0])
    found.answers, found.refused, found.events = told["answers"], told["refused"], told["events"]
    for name, id_ in zip(names, ids, strict=True):
        _asked("POST", f"{url}/recordings/{id_}/stop", json={})
        until(lambda id_=id_: _asked("GET", f"{url}/recordings/{id_}")["state"] == "done", f"{name} is not closed")
        _take(found, folder / f"{id_}.parquet", name)
    return found


def _take(found: Found, path: Path, name: str) -> None:
    """What a recording holds."""
    check_undamaged(path)
    with open_recording(path) as reader:
        summary = whole(reader).summary
    found.rows.append(summary.rows)
    found.lost += summary.lost_rows
    found.seconds.append(summary.duration)
    if summary.left_out or summary.irregular_steps or summary.rows < _KEPT * ROWS * summary.duration:
        found.wrong.append(f"{name}: {summary.rows} rows of {summary.duration:.1f} s; {summary.remarks()}")


def _asked(method: str, url: str, **body: Any) -> dict[str, Any]:
    return httpx.request(method, url, timeout=PATIENCE, **body).raise_for_status().json()


def _memory(pid: int) -> float:
    """Memory that a process has in use, MB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(status.partition("VmRSS:")[2].split()[0]) * 1024e-6


class _Asking:
    """Who looks on."""

    def __init__(self, url: str) -> None:
        self._url = httpx.URL(url)
        self.answers = list[float]()
        self.refused = self.events = 0

    async def ask(self, paths: "itertools.cycle[str]", until_: float, offset: float) -> None:
        """Ask for one path after another over one connection, in this connection's turn."""
        period, host = CONNECTIONS / RATE, f"{self._url.host}:{self._url.port}"
        reader, writer = await asyncio.open_connection(self._url.host, self._url.port)
        due = time.monotonic() + offset
        while due < until_:
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            began = time.monotonic()
            writer.write(f"GET {self._url.path}{next(paths)} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
            head = (await reader.readuntil(b"\r\n\r\n")).decode().lower()
            await reader.readexactly(int(head.partition("content-length:")[2].split()[0]))
            self.answers.append(time.monotonic() - began)
            self.refused += head.split()[1] != "200"
            due += period
        writer.close()

    async def listen(self, name: str) -> None:
        """Read a drive's event stream."""
        reader, writer = await asyncio.open_connection(self._url.host, self._url.port)
        path = f"{self._url.path}/drives/{name}/stream"
        writer.write(f"GET {path} HTTP/1.1\r\nHost: {self._url.host}:{self._url.port}\r\n\r\n".encode())
        while line := await reader.readline():
            self.events += line.startswith(b"event: snapshot")


async def _loaded(url: str, seconds: float) -> dict[str, Any]:
    """Make the load; what was answered."""
    asking, end = _Asking(url), time.monotonic() + seconds
    names = [drive["name"] for drive in _asked("GET", f"{url}/drives")["drives"]]
    streams = [asyncio.create_task(asking.listen(names[k % len(names)])) for k in range(STREAMS)]
    paths = itertools.cycle([f"/drives/{name}{what}" for what in PATHS for name in names])
    await asyncio.gather(*(asking.ask(paths, end, k / RATE) for k in range(CONNECTIONS)))
    for stream in streams:
        stream.cancel()
    await asyncio.gather(*streams, return_exceptions=True)
    return {"answers": asking.answers, "refused": asking.refused, "events": asking.events}


def _judged(found: Found) -> bool:
    """Print what was found beside its bars; whether all are held."""
    p50, p99 = np.percentile(found.answers, (50.0, 99.0)) if found.answers else (np.inf, np.inf)
    grown, cores = found.memory[1] - found.memory[0], sum(found.cores)
    rows = ", ".join(f"{rows:,}" for rows in found.rows)
    bars = [
        (f"no row lost on disk: {found.lost} of {rows}", not found.lost and not found.wrong),
        (f"99 % of REST within {BARS['p99'] * 1e3:g} ms: {p99 * 1e3:.1f} ms, median {p50 * 1e3:.1f} ms; "
         f"{len(found.answers)} answers, {found.refused} refused", p99 <= BARS["p99"] and not found.refused),
        (f"memory grows by at most {BARS['memory']:g} MB in {found.wall / 60.0:.1f} min: {grown:.1f} MB, "
         f"{found.memory[0]:.0f} to {found.memory[1]:.0f}", grown <= BARS["memory"]),
        (f"at most {BARS['cores']:g} core in all: {cores:.2f}, service {found.cores[0]:.2f}, "
         f"four drives {found.cores[1]:.2f}", cores <= BARS["cores"]),
    ]  # fmt: skip
    for text, met in bars:
        print(f"{'met' if met else 'MISSED':6} {text}")
    print(f"{STREAMS} event streams brought {found.events} events; load average {load()}", *found.wrong, sep="\n")
    return all(met for _, met in bars)


def main(arguments: list[str] | None = None) -> int:
    """Print the table. 0 when every bar is met."""
    parser = argparse.ArgumentParser("bench_load", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--load", nargs=2, help=argparse.SUPPRESS)  # URL, seconds: be who looks on
    options = parser.parse_args(arguments)
    if options.load:
        url, seconds = options.load
        print(json.dumps(asyncio.run(_loaded(url, float(seconds)))))
        return 0
    return 0 if _judged(measured(options.minutes)) else 1


if __name__ == "__main__":
    sys.exit(main())
