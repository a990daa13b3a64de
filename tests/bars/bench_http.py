"""The HTTP interface under too much: requests beyond what it can do, event streams, connections that say nothing - and
Stop, which gets through. `python -m tests.bars.bench_http [--seconds S]`; on 127.0.0.1 alone, and bounded.

The service has 1,024 file descriptors, as most systems give it. The load is a process of its own: it beside the service
on two cores is more than a load from another machine.
"""

import argparse
import asyncio
import contextlib
import json
import math
import resource
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import httpx

from tests.conftest import RunningBench, bench_up
from tests.proof.results import record

_DRIVE: Final = "/api/drives/emulated"
_SET_POINTS: Final = {"i_q_ref": 1.0}
BAR: Final = 1.0  # s, until Stop is answered
_PATIENCE: Final = 10.0  # s
_STARTING: Final = 0.5  # s
_RENEWED: Final = 100  # idle connections a second, of those that were closed


@dataclass(frozen=True)
class Load:
    """What is asked for at once."""

    rate: int = 1000  # requests a second, each with a connection of its own
    streams: int = 200
    idle: int = 1000  # connections
    seconds: float = 15.0


@dataclass(frozen=True)
class Measured:
    """What came of it."""

    answers: dict[str, int]  # by kind and status, or by what came instead
    offered: float  # requests a second that the load came up with
    stops: list[float]  # s from Stop to its answer: the drive is off by then
    alone: float  # s, without a load
    rows: int
    lost: int
    gaps: int
    reconnects: int
    wall: float  # s under load
    shares: dict[str, tuple[float, ...]]  # of the wall time, by process: on a processor, waiting for one


def measured(load: Load) -> Measured:
    """A bench of its own, under a load, with a drive that is started and stopped."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (1024, hard))
    try:
        with bench_up() as bench:
            return _measured(bench, load)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def _measured(bench: RunningBench, load: Load) -> Measured:
    url = bench.url
    alone = _stopped(url)
    before = _drive(url)
    command = [sys.executable, "-m", "tests.bars.bench_http", "--load", url, *map(str, vars(load).values())]
    stops = list[float]()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "all are there\n"
        began, at_first = time.monotonic(), _scheduled(bench.process.pid)
        while process.poll() is None and (len(stops) < 20):
            with contextlib.suppress(TimeoutError):
                stops.append(_stopped(url, process))
        wall = time.monotonic() - began
        at_last = _scheduled(bench.process.pid)
        told = json.loads(process.communicate(timeout=_PATIENCE + load.seconds)[0])
    after = _drive(url)
    stream = {key: after["stream"][key] - before["stream"][key] for key in ("rows", "rows_lost", "gaps")}
    return Measured(
        told["answers"], told["offered"], stops, alone, stream["rows"], stream["rows_lost"], stream["gaps"],
        after["link"]["reconnects"] - before["link"]["reconnects"], wall,
        {name: tuple((b - a) / wall for a, b in zip(at_first[name], at_last[name], strict=True)) for name in at_first},
    )


def _scheduled(service: int) -> dict[str, tuple[float, ...]]:
    """s that the first thread of the service, and of its emulated drive, ran and waited for a processor."""
    emulator = Path(f"/proc/{service}/task/{service}/children").read_text(encoding="ascii").split()[0]
    told = dict[str, tuple[float, ...]]()
    for name, process in (("service", str(service)), ("emulated drive", emulator)):
        ran, waited, _ = Path(f"/proc/{process}/task/{process}/schedstat").read_text(encoding="ascii").split()
        told[name] = (int(ran) * 1e-9, int(waited) * 1e-9)
    return told


def _drive(url: str) -> dict[str, Any]:
    return httpx.get(f"{url}{_DRIVE}", timeout=_PATIENCE).json()


def _stopped(url: str, while_: "subprocess.Popen[str] | None" = None) -> float:
    """Start the drive, where there is soon room for the request, and stop it. s from Stop to its answer."""
    deadline = time.monotonic() + _STARTING
    while time.monotonic() < deadline and (while_ is None or while_.poll() is None):
        with contextlib.suppress(httpx.HTTPError):
            if httpx.post(f"{url}{_DRIVE}/start", json=_SET_POINTS, timeout=_PATIENCE).is_success:
                break
    with httpx.Client(timeout=_PATIENCE) as client:  # which takes its time to be made
        began = time.monotonic()
        stopped = client.post(f"{url}{_DRIVE}/stop")
        took = time.monotonic() - began
    if stopped.json().get("state") != "switch on disabled":
        print(f"Stop was answered: {stopped.text}", file=sys.stderr)
        return math.inf
    return took


class _Asking:
    """Connections to a service, and what came of them."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self._host, self._port = parts.hostname or "", parts.port or 0
        self.answers = Counter[str]()

    async def ask(self, kind: str, path: str = "", *headers: str) -> None:
        """Ask for a path, or for nothing, and read all that is answered until the other side closes."""
        lines = [f"GET {path} HTTP/1.1", f"Host: {self._host}:{self._port}", *headers, "", ""] if path else []
        try:
            async with asyncio.timeout(_PATIENCE):
                reader, writer = await asyncio.open_connection(self._host, self._port)
        except (OSError, TimeoutError) as error:
            self.answers[f"{kind} not connected ({type(error).__name__})"] += 1
            return
        try:
            writer.write("\r\n".join(lines).encode())
            async with asyncio.timeout(_PATIENCE):
                line = await reader.readline()
            status, rest = line.split()[1].decode() if line else "closed", b""
            if status != "503":
                self.answers[f"{kind} {status}"] += 1
            async with asyncio.timeout(None if kind == "stream" else _PATIENCE):
                while part := await reader.read(65536):
                    rest = part
            if status == "503":
                self.answers[f"{kind} 503: {json.loads(rest.splitlines()[-1])['detail']}"] += 1
        except (OSError, TimeoutError, ValueError) as error:
            self.answers[f"{kind} broken off ({type(error).__name__})"] += 1
        finally:
            writer.close()


async def _loaded(url: str, load: Load) -> dict[str, Any]:
    """Make the load; what was answered."""
    asking = _Asking(url)
    streams = [asyncio.create_task(asking.ask("stream", f"{_DRIVE}/stream")) for _ in range(load.streams)]
    await asyncio.sleep(1.0)
    idle = [asyncio.create_task(asking.ask("idle")) for _ in range(load.idle)]
    await asyncio.sleep(1.0)
    print("all are there", flush=True)
    began, requests, again = time.monotonic(), list[asyncio.Task[None]](), 0
    while (now := time.monotonic() - began) < load.seconds:
        due = int(now * load.rate) - len(requests)
        requests += [asyncio.create_task(asking.ask("request", _DRIVE, "Connection: close")) for _ in range(due)]
        idle = [task for task in idle if not task.done()]
        renewed = min(load.idle - len(idle), int(now * _RENEWED) - again)
        again += renewed
        idle += [asyncio.create_task(asking.ask("idle")) for _ in range(renewed)]
        await asyncio.sleep(0.002)
    offered = len(requests) / (time.monotonic() - began)
    for task in (*streams, *idle):
        task.cancel()
    await asyncio.gather(*requests, *streams, *idle, return_exceptions=True)
    return {"answers": dict(sorted(asking.answers.items())), "offered": offered}


def _recorded(said: Measured) -> None:
    stops = sorted(said.stops) or [math.inf]
    others = [kind for kind in said.answers if " 503" not in kind and " 200" not in kind]
    surplus = f"surplus is answered 503, or {', '.join(others)}" if others else "all surplus is answered 503"
    stop = f"median {stops[len(stops) // 2]:.1f} s, longest {stops[-1]:.2f} s"
    record("service.http", f"{stop}; {surplus}; {said.lost or 'no'} row lost", stops[-1] <= BAR)


def _told(load: Load, said: Measured) -> str:
    stops = sorted(said.stops)
    lines = [
        f"offered: {said.offered:.0f} requests/s for {load.seconds:g} s, {load.streams} event streams, {load.idle} "
        f"idle connections, of those that are closed {_RENEWED} a second anew",
        *(f"  {count} {kind}" for kind, count in said.answers.items()),
        f"Stop, until the drive is off: {said.alone:.2f} s without load, and {len(stops)} times under it",
        f"  median {stops[len(stops) // 2]:.2f} s, longest {stops[-1]:.2f} s" if stops else "",
        *(f"  {name}: ran {ran:.0%} of {said.wall:.0f} s, waited {waited:.0%} for a processor that others had"
          for name, (ran, waited) in said.shares.items()),
        f"rows: {said.rows}, lost {said.lost}, gaps {said.gaps}, reconnects {said.reconnects}",
    ]  # fmt: skip
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--load", nargs=5, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.load is not None:
        limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(limit, 8192), limit))
        address, rate, streams, idle, seconds = given.load
        print(json.dumps(asyncio.run(_loaded(address, Load(int(rate), int(streams), int(idle), float(seconds))))))
    else:
        wanted = Load(seconds=given.seconds)
        print(_told(wanted, found := measured(wanted)))
        _recorded(found)
