"""What a bench costs that nobody looks at: processor time of the service, and of its emulated drive, over each link.

`python -m tests.bars.bench_idle [--seconds 30] [--link NAME]`

Service and drive are processes of their own. The drive has been started and moves its currents: its stream of 1,000
rows a second is estimated ten times a second, and its lease renewed. After a warm-up nobody asks for anything. Other
work of a machine makes processor time dearer, as it takes caches and clock: a fixed loop, timed beside it, tells.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import httpx

from tests.bars.bench_links import load, processor_of, service
from tests.support.served_drive import emulator, ready, tcp_url
from tests.support.transports import modbus_pty_url, modbus_tcp_url, serial_socket_url

LINKS: Final[Mapping[str, Callable[[], str]]] = {
    "modbus+tcp": modbus_tcp_url, "modbus+rtu": modbus_pty_url, "uart": serial_socket_url, "canopen": tcp_url,
}
SERVICE: Final = {"modbus+tcp": 0.05, "modbus+rtu": 0.05, "uart": 0.05, "canopen": 0.09}  # of a core
DRIVE: Final = 0.10  # of a core
SET_POINTS: Final = {"i_q_ref": 2.0, "i_d_step": 3.0, "i_q_step": 3.0}  # those of the paper
WARM_UP: Final = 5.0  # s
ROWS: Final = 1000.0  # 1/s
_KEPT: Final = 0.99  # of these: fewer, and the emulated drive was held up
_LOOP: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Idle:
    """One link's."""

    link: str
    wall: float  # s
    service: float  # s of processor
    drive: float  # s of processor
    rows: int
    lost: int

    @property
    def good(self) -> bool:
        """Both bars are held, and all rows have come."""
        kept = not self.lost and self.rows >= _KEPT * ROWS * self.wall
        return kept and self.service <= SERVICE[self.link] * self.wall and self.drive <= DRIVE * self.wall


def measured(link: str, seconds: float) -> Idle:
    """A bench of its own, idle for so many s."""
    url = LINKS[link]()
    with emulator("--at", url, control="lease") as drive:
        ready(drive)
        with service([url]) as (port, pid):
            told = f"http://127.0.0.1:{port}/api/drives/0"
            httpx.post(f"{told}/start", json=SET_POINTS, timeout=10.0).raise_for_status()
            time.sleep(WARM_UP)
            before, began = _stream(told), time.monotonic()
            used = processor_of(pid), processor_of(drive.pid)
            time.sleep(seconds)
            wall = time.monotonic() - began
            of_service, of_drive = processor_of(pid) - used[0], processor_of(drive.pid) - used[1]
            after = _stream(told)
    return Idle(link, wall, of_service, of_drive, after["rows"] - before["rows"],
                after["rows_lost"] - before["rows_lost"])  # fmt: skip


def _stream(drive: str) -> dict[str, Any]:
    return httpx.get(drive, timeout=10.0).raise_for_status().json()["stream"]


def loop_time() -> float:
    """Processor time in s of a loop that is always the same."""
    begun = time.thread_time()
    for _ in range(_LOOP):
        pass
    return time.thread_time() - begun


def told(one: Idle) -> str:
    """A line of the table."""
    shares = [
        f"{name} {100 * used / one.wall:5.2f} % of a core, bar {100 * bar:.0f} %"
        for name, used, bar in (("service", one.service, SERVICE[one.link]), ("drive", one.drive, DRIVE))
    ]
    return f"{'met' if one.good else 'MISSED':6} {one.link:10} {'; '.join(shares)}; {one.rows} rows, {one.lost} lost"


def main(arguments: list[str] | None = None) -> int:
    """Print the table. 0 when every bar is met."""
    parser = argparse.ArgumentParser("bench_idle", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of every link")
    parser.add_argument("--link", choices=LINKS, action="append")
    options = parser.parse_args(arguments)
    found = list[Idle]()
    for link in options.link or LINKS:
        before = loop_time()
        found.append(measured(link, options.seconds))
        print(f"{told(found[-1])}; load average {load()}, a loop of {_LOOP:,} took {1e3 * before:.0f} ms before and "
              f"{1e3 * loop_time():.0f} ms after", flush=True)  # fmt: skip
    return 0 if all(one.good for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
