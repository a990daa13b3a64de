"""The service killed while an experiment holds a current.

`python -m tests.bars.bench_kills [--count 100] [--link NAME]`

Over each link in turn a service begins an experiment on an emulated drive, is killed (SIGKILL) while it holds, and is
started again after 0 to 10 s, as a supervisor does it; at every second kill another client reads the drive all the time
over another link. Printed: how long the drive stayed on after the kill, whether set points are zero and settings as
before the experiment, and what the new service says of both.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.lease import SECONDS
from drivers.wire.cia402 import State
from drivers.wire.dictionary import SET_POINTS
from tests.conftest import COMMAND, free_port, wait_for_answer
from tests.proof.results import record
from tests.support.served_drive import emulator, ready
from tests.support.transports import modbus_socket_url, modbus_tcp_url, serial_socket_url, tcp_url

LINKS = {"canopen": tcp_url, "modbus+tcp": modbus_tcp_url, "modbus+rtu": modbus_socket_url, "uart": serial_socket_url}
SETTINGS = ("excitation_kind", "step_time", "speed_control", "field_weakening", "overspeed_trip", "bandwidth")
HOLD: dict[str, Any] = {"holds": [{"speed_rpm": 1200.0, "i_d": -1.0, "i_q": 4.0, "seconds": 5.0}], "step": 0.5}
PATIENCE = 60.0  # s
SLACK = 0.5  # s: the way of the latest renewal, and of the observation


@dataclass
class Seen:
    """One kill."""

    link: str
    delay: float  # s, before the restart
    read: bool  # another client reads all the time
    on_for: float = 0.0  # s after the kill; without a reader: when it was looked
    off: bool = False  # by then
    still: bool = False  # set points are zero
    restored: bool = False
    undone: str = ""
    told: str = ""  # of the experiment
    wrong: list[str] = field(default_factory=list[str])

    @property
    def good(self) -> bool:
        """All that is asked for."""
        return self.off and self.still and self.restored and bool(self.undone) and bool(self.told) and not self.wrong


class Service:
    """A service as a process, over one drive called x."""

    def __init__(self, folder: Path, url: str) -> None:
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self._config = folder / "bench.toml"
        self._config.write_text(
            f'[service]\nport = {self.port}\ncaptures = "captures"\n[drives.x]\nurl = "{url}"\n', encoding="utf-8"
        )
        self._log = (folder / "log.txt").open("w")

    def start(self) -> None:
        """Return when it streams."""
        self.process = subprocess.Popen(
            [*COMMAND, "serve", "--config", str(self._config)], stdout=self._log, stderr=self._log, text=True
        )
        wait_for_answer(f"{self.url}/api/health", self.process)
        until(lambda: self.drive()["control"]["state"] is not None, "no link to the drive")

    def drive(self) -> dict[str, Any]:
        """Of the drive, as REST tells it."""
        return httpx.get(f"{self.url}/api/drives/x", timeout=10.0).raise_for_status().json()

    def signals(self, names: tuple[str, ...]) -> dict[str, float]:
        """Values of signals."""
        answer = httpx.get(f"{self.url}/api/drives/x/signals", params={"names": ",".join(names)}, timeout=20.0)
        return {signal["name"]: signal["value"] for signal in answer.raise_for_status().json()["signals"]}

    def experiment(self, id_: str = "latest") -> Mapping[str, Any]:
        """An experiment's state; nothing where it is not known."""
        answer = httpx.get(f"{self.url}/api/drives/x/experiments/{id_}", timeout=10.0)
        return answer.json() if answer.is_success else {}

    def hold(self) -> str:
        """Begin an experiment, and return its id when it holds."""
        answer = httpx.post(f"{self.url}/api/drives/x/experiments", json=HOLD, timeout=20.0)
        id_ = answer.raise_for_status().json()["id"]
        until(lambda: str(self.experiment(id_)["phase"]).startswith("holding"), "it does not hold")
        return id_

    def kill(self) -> None:
        """SIGKILL."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


def until(happened: Any, what: str) -> None:
    """Return when it has happened."""
    deadline = time.monotonic() + PATIENCE
    while not happened():
        if time.monotonic() > deadline:
            raise TimeoutError(what)
        time.sleep(0.02)


def on_link(name: str, count: int, seen: list[Seen]) -> None:
    """So many kills over one link."""
    url, other = LINKS[name](), serial_socket_url()
    with tempfile.TemporaryDirectory() as folder, emulator("--at", url, "--at", other, control="lease") as process:
        ready(process)
        service = Service(Path(folder), url)
        service.start()
        for k in range(count):
            one = Seen(name, delay=10.0 * k / max(1, count - 1), read=k % 2 == 1)
            seen.append(one)
            try:
                killed(service, other, one)
            except (TimeoutError, httpx.HTTPError, DriveError, AssertionError) as error:
                one.wrong.append(f"{type(error).__name__}: {error}")
            print(told(one), flush=True)
        service.process.send_signal(signal.SIGINT)
        service.process.wait(30.0)


def killed(service: Service, other: str, one: Seen) -> None:
    """One kill, and all that follows."""
    before = service.signals(SETTINGS)
    id_ = service.hold()
    restart = threading.Timer(one.delay, service.start)
    if one.read:
        with connect(other) as reader:
            service.kill()
            begun = time.monotonic()
            restart.start()
            look(one, reader, begun, begun + SECONDS + SLACK)
    else:
        service.kill()
        begun = time.monotonic()
        restart.start()
        time.sleep(SECONDS + SLACK)
        with connect(other) as reader:
            look(one, reader, begun, 0.0)
    restart.join()
    until(lambda: service.drive()["control"]["state"] is not None, "no link after the restart")
    drive = service.drive()
    one.undone = drive["control"]["undone"]
    one.still = set(service.signals(SET_POINTS).values()) == {0.0}
    one.restored = service.signals(SETTINGS) == before
    until(lambda: service.experiment(id_).get("state", "gone") != "running", "the experiment has no end")
    experiment = service.experiment(id_)
    one.told = f"{experiment.get('state')}: {experiment.get('reason')}" if experiment else ""
    if drive["control"]["fault"] is not None:
        httpx.post(f"{service.url}/api/drives/x/reset", json={}, timeout=20.0).raise_for_status()


def look(one: Seen, reader: Drive, begun: float, deadline: float) -> None:
    """When the drive is off, read until then or a deadline."""
    while True:
        one.off = operation.state(reader) is not State.OPERATION_ENABLED
        one.on_for = time.monotonic() - begun
        if one.off or time.monotonic() > deadline:
            return


def told(one: Seen) -> str:
    """A line of the table."""
    return (
        f"{'ok  ' if one.good else 'FAIL'} {one.link:10} restart after {one.delay:4.1f} s, "
        f"{'read by another' if one.read else 'read by nobody '}: "
        f"{'off' if one.off else 'ON'} {'at' if one.read else 'by'} {one.on_for:.2f} s, "
        f"set points {'zero' if one.still else 'NOT zero'}, settings {'as before' if one.restored else 'OTHER'}; "
        f"{one.undone or 'NOTHING SAID'}; experiment {one.told or 'FORGOTTEN'}{'; ' if one.wrong else ''}"
        + "; ".join(one.wrong)
    )


def main() -> int:
    """0 where every kill went as it should."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="kills, over all links")
    parser.add_argument("--link", choices=LINKS, action="append")
    options = parser.parse_args()
    links, seen = options.link or list(LINKS), list[Seen]()
    threads = [
        threading.Thread(target=on_link, args=(link, -(-options.count // len(links)), seen)) for link in links
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    good = sum(one.good for one in seen)
    off = sum(one.off for one in seen)
    latest = max((one.on_for for one in seen if one.read and one.off), default=0.0)
    print(
        f"{good} of {len(seen)} as they should be; off within {SECONDS + SLACK:g} s in {off} of {len(seen)}, "
        f"the latest that a reader saw after {latest:.2f} s"
    )
    if len(links) == len(LINKS):
        within = f"{SECONDS + SLACK:g} s (the lease's {SECONDS:g} s, and {SLACK:g} s to see it)"
        record("service.kills", f"off within {within} in {off}, at most {latest:.2f} s where a reader saw it; "
               f"set points zero, settings as before, said at the next start in {good}")  # fmt: skip
    return int(good < len(seen))


if __name__ == "__main__":
    sys.exit(main())
