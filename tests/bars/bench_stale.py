"""How long estimates are called ok after their drive has told nothing new.

`python -m tests.bars.bench_stale [--link NAME]`

Over each link a drive is started and estimated; then it is stopped by another client, put into fault, reset, unplugged,
or its line lags by 3 s. Printed: how long after that moment REST last called a parameter ok, which is to be 1 s at
most, and what it said instead.
"""

import argparse
import contextlib
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx

from drivers import lease as control
from drivers import operation
from drivers.connect import connect
from drivers.errors import DriveError
from drivers.wire.cia402 import State
from tests.bars.bench_kills import LINKS, Service, until
from tests.proof.results import record
from tests.support.relay import Relay, relayed
from tests.support.served_drive import emulator, ready
from tests.support.transports import serial_socket_url

BAR = 1.0  # s
LAG = 3.0  # s
WATCHED = 5.0  # s after an event
RESET_AT = 80.0  # s of the drive's time, when all else has been tried
SET_POINTS = {"i_q_ref": 2.0, "i_d_step": 1.0, "i_q_step": 1.0}


class Tried:
    """One link with its service, drive and the relay between them."""

    def __init__(self, link: str, service: Service, other: str, relay: Relay) -> None:
        self.link, self.service, self.other, self.relay = link, service, other, relay
        self.latest: dict[str, float] = {}  # s after each event, when something was called ok last

    def started(self) -> None:
        """The drive runs, and all it tells is ok."""
        until(lambda: self._control()["state"] is not None, f"{self.link}: no look at the drive")
        if self._control()["fault"] is not None:
            self._post("reset", {})
        self._post("start", SET_POINTS)
        until(lambda: self._ok() == 4, f"{self.link}: estimates are not ok")

    def watch(self, event: str, happen: Callable[[], float]) -> None:
        """Have it happen, which tells when (s, monotonic); tell for how long after that anything is called ok."""
        with ThreadPoolExecutor(1) as other:
            happens, latest = other.submit(happen), 0.0
            while not happens.done() or time.monotonic() - happens.result() < WATCHED:
                asked = time.monotonic()
                if self._ok():
                    latest = asked
                time.sleep(0.01)
        self.latest[event] = max(latest - happens.result(), 0.0)
        said = self._estimates()["R_s"]
        print(f"{self.link:10} {event:9} ok for {self.latest[event]:.2f} s more; then {said['status']}: "
              f"{said['reason']}", flush=True)  # fmt: skip

    def stop(self) -> float:
        """By another client."""
        with connect(self.other) as drive:
            begun = time.monotonic()
            control.stop(drive)
        return begun

    def trip(self) -> float:
        """By a trip at a speed that it exceeds."""
        with connect(self.other) as drive, ThreadPoolExecutor(1) as put:
            done = put.submit(self._put, {"overspeed_trip": 1.0})
            until(lambda: operation.state(drive) is State.FAULT, "no fault")
            begun = time.monotonic()
            done.result()
        return begun

    def await_reset(self) -> float:
        """By itself, as it was told to."""
        with connect(self.other) as drive:
            before = drive.read("tick")
            assert before < RESET_AT / drive.identity.T_s, "it has reset before"
            with contextlib.suppress(DriveError):
                while (now := drive.read("tick")) >= before:
                    before = now
                    time.sleep(0.01)
        return time.monotonic()

    def lag(self) -> float:
        """The line, by 3 s."""
        self.relay.lag = LAG
        return time.monotonic()

    def cut(self) -> float:
        """The line."""
        begun = time.monotonic()
        self.relay.cut()
        return begun

    def untrip(self) -> None:
        """As it was."""
        self._put({"overspeed_trip": 2000.0})

    def _control(self) -> dict[str, Any]:
        return self.service.drive()["control"]

    def _ok(self) -> int:
        return sum(estimate["status"] == "ok" for estimate in self._estimates().values())

    def _estimates(self) -> dict[str, dict[str, str]]:
        answer = httpx.get(f"{self.service.url}/api/drives/x/estimates", timeout=10.0)
        return answer.raise_for_status().json()["estimates"]

    def _post(self, what: str, body: dict[str, float]) -> None:
        answer = httpx.post(f"{self.service.url}/api/drives/x/{what}", json=body, timeout=20.0)
        assert answer.is_success, answer.text

    def _put(self, values: dict[str, float]) -> None:
        httpx.put(f"{self.service.url}/api/drives/x/signals", json=values, timeout=20.0).raise_for_status()


@contextlib.contextmanager
def tried(link: str) -> Generator[Tried]:
    """A link with all that it needs."""
    url, other = LINKS[link](), serial_socket_url()
    port = re.search(r"127\.0\.0\.1:(\d+)", url)
    assert port is not None
    with (
        tempfile.TemporaryDirectory() as folder,
        emulator("--at", url, "--at", other, "--fault", f"reset@{RESET_AT:g}", control="lease") as process,
        relayed(int(port[1])) as relay,
    ):
        ready(process)
        service = Service(Path(folder), url.replace(port[0], f"127.0.0.1:{relay.port}"))
        service.start()
        try:
            yield Tried(link, service, other, relay)
        finally:
            service.process.send_signal(signal.SIGINT)
            service.process.wait(30.0)


def on_link(link: str, found: dict[str, dict[str, float]]) -> None:
    """All events over one link."""
    with tried(link) as one:
        found[link] = one.latest
        one.started()
        one.watch("off", one.stop)
        one.started()
        one.watch("fault", one.trip)
        one.untrip()
        one.started()
        one.watch("lag", one.lag)
        one.relay.lag = 0.0
        until(lambda: one.service.drive()["link"]["state"] == "streaming", f"{link}: no stream after the lag")
        one.started()
        one.watch("unplugged", one.cut)
        one.relay.mend()
        until(lambda: one.service.drive()["link"]["state"] == "streaming", f"{link}: no stream after the cut")
        one.started()
        one.watch("reset", one.await_reset)


def main() -> int:
    """0 where nothing was called ok for longer than the bar."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--link", choices=LINKS, action="append")
    links = parser.parse_args().link or list(LINKS)
    found = dict[str, dict[str, float]]()
    for link in links:
        on_link(link, found)
    all_ = [seconds for events in found.values() for seconds in events.values()]
    good = sum(seconds <= BAR for seconds in all_)
    expected, most = 5 * len(links), max(all_, default=0.0)
    print(f"{good} of {expected} within {BAR:g} s, at most {most:.2f} s{'' if good == expected else ': MISSED'}")
    if len(links) == len(LINKS):
        record("service.stale", f"{most:.2f} s at most", good == expected)
    return int(good < expected)


if __name__ == "__main__":
    sys.exit(main())
