"""A virtual drive at a URL, for tests: in this process or in one of its own."""

import contextlib
import queue
import signal
import subprocess
import threading
import time
import uuid
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from drivers.block import Block
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.wire.modbus_url import parse_modbus_url
from drivers.wire.uart_url import parse_uart_url
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.scenario.scenarios import PAPER, Scenario
from emulator.servers.faults import Faults
from emulator.servers.link import server_at
from emulator.servers.modbus.server import ModbusServer
from emulator.servers.uart import UartServer
from tests.conftest import bus_url, free_port
from tests.support.forked import Forked

PATIENCE = 15.0  # s
READY = 120.0  # s, the first start compiles
_BURST = 97  # control periods; a row is under way at the end of nearly every burst
_BEHIND = 16384  # bytes of rows that a client may be behind


@dataclass
class Served:
    """A drive at a URL. Its time passes in bursts while `running`, by no clock, or by `step`.

    On a UART line it passes no quicker than clients take rows, while `patient`.
    """

    url: str
    drive: VirtualDrive
    server: Any  # the drive's end, whose inside tests may look at
    burst: int  # control periods
    patient: bool
    rows: list[StreamRows] = field(default_factory=list[StreamRows], repr=False)  # all that it has sent or could have
    running: threading.Event = field(default_factory=threading.Event)
    _end: threading.Event = field(default_factory=threading.Event)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def run(self) -> None:
        """Let time pass until `end`; it stands still while `running` is clear."""
        while not self._end.wait(0.004):
            if self.running.is_set() and not (self.patient and self._behind() > _BEHIND):
                self.step(self.burst)

    def step(self, periods: int) -> None:
        """Let so many control periods pass."""
        with self._lock:
            rows = self.drive.run(periods)
            self.rows.append(rows)
            self.server.publish(rows)

    def end(self) -> None:
        """Let no more time pass."""
        self._end.set()

    def produced(self) -> dict[str, np.ndarray]:
        """Every row of the drive by column name."""
        rows = list(self.rows)
        return {f.name: np.concatenate([getattr(part, f.name) for part in rows]) for f in fields(StreamRows)}

    def _behind(self) -> int:
        if not isinstance(self.server, UartServer):
            return 0
        return max((line._behind for line in list(self.server._lines.values())), default=0)


@contextlib.contextmanager
def served(
    url: str, scenario: Scenario = PAPER, faults: Faults | None = None, *, running: bool = True, burst: int = _BURST,
    paced: bool = False, control: str = "watchdog",
) -> Generator[Served]:
    """A virtual drive at a URL, in this process; `paced`: its serial line is no quicker than its baud rate.

    `control`: who starts it; by default it is in operation from the start, without a lease.
    """
    drive = VirtualDrive(replace(scenario, drive=replace(scenario.drive, control=control)), on_links=True)
    drive.warm_up()
    faults = faults or Faults()
    server = _paced(url, drive, faults) if paced else server_at(url, drive, faults)
    with contextlib.closing(server):
        bench = Served(url, drive, server, burst, patient=not paced)
        bench.step(_BURST)
        if running:
            bench.running.set()
        thread = threading.Thread(target=bench.run, name="drive's time")
        thread.start()
        try:
            yield bench
        finally:
            bench.end()
            thread.join()


def _paced(url: str, drive: VirtualDrive, faults: Faults) -> UartServer | ModbusServer:
    if url.startswith("uart"):
        return UartServer(drive, parse_uart_url(url), faults, paced=True)
    return ModbusServer(drive, parse_modbus_url(url), faults, paced=True)


def virtual_url() -> str:
    """A node on a bus of its own inside this process."""
    return f"canopen://virtual/{uuid.uuid4().hex}/5"


def tcp_url() -> str:
    """A node on a bus at a free TCP port."""
    return bus_url(free_port())


@contextlib.contextmanager
def emulator(*arguments: str, control: str = "watchdog") -> Generator["subprocess.Popen[str]"]:
    """The emulated drive as a process, killed at the end where it still runs; `control` as of `served`."""
    process = Forked(
        "emulator.__main__", *arguments, "--control", control, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
        process.communicate(timeout=PATIENCE)


def ready(process: "subprocess.Popen[str]") -> str:
    """The line with which the emulator says that it is there."""
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, process.communicate(timeout=PATIENCE)
    return line


def until(happened: Callable[[], bool], what: str, patience: float = 60.0) -> None:
    """Return when it has happened; fail when it does not within so many s."""
    deadline = time.monotonic() + patience
    while not happened():
        assert time.monotonic() < deadline, what
        time.sleep(0.012)


def first_blocks(drive: Drive, rows: int) -> list[Block]:
    """The blocks of a stream until so many rows have come."""
    blocks = list[Block]()
    stream = drive.stream()
    for block in stream:
        blocks.append(block)
        if sum(map(len, blocks)) >= rows:
            break
    with contextlib.suppress(AttributeError):
        stream.close()  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
    return blocks


def joined(blocks: list[Block], name: str) -> np.ndarray:
    """A column of many blocks."""
    return np.concatenate([getattr(block, name) for block in blocks])


class Listening:
    """A stream iterated in a thread of its own: its blocks so far, and how it ended."""

    def __init__(self, drive: Drive) -> None:
        self.blocks = list[Block]()
        self.error: DriveError | None = None
        self._drive = drive
        self.thread = threading.Thread(target=self._run, name="listening")
        self.thread.start()

    @property
    def rows(self) -> int:
        """So many have come."""
        return sum(map(len, self.blocks))

    def ended(self) -> DriveError | None:
        """How it ended; fails when it does not."""
        self.thread.join(PATIENCE)
        assert not self.thread.is_alive(), "the stream has not ended"
        return self.error

    def _run(self) -> None:
        try:
            for block in self._drive.stream():
                self.blocks.append(block)
        except DriveError as error:
            self.error = error


@contextlib.contextmanager
def listening(drive: Drive) -> Generator[Listening]:
    """A stream under way, ended at the end."""
    listener = Listening(drive)
    try:
        until(lambda: listener.rows > 20 or not listener.thread.is_alive(), "no rows")
        yield listener
    finally:
        drive.close()
        listener.thread.join(PATIENCE)


def in_threads(work: list[Callable[[], None]]) -> None:
    """Do all at once; the first failure is raised."""
    failures: queue.SimpleQueue[BaseException] = queue.SimpleQueue()

    def guarded(job: Callable[[], None]) -> None:
        try:
            job()
        except BaseException as error:  # noqa: BLE001 - raised again below
            failures.put(error)

    threads = [threading.Thread(target=guarded, args=(job,)) for job in work]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    if not failures.empty():
        raise failures.get()
