"""A virtual drive on a serial line in this process, for tests."""

import contextlib
import threading
from collections.abc import Generator
from dataclasses import dataclass, field, fields

import numpy as np

from drivers.block import Block
from drivers.wire.codec import count_size
from drivers.wire.dictionary import STREAM_ROW, signal_named
from drivers.wire.uart_url import parse_uart_url
from emulator.scenarios import PAPER, Scenario
from emulator.uart_server import UartServer
from emulator.virtual_drive import StreamRows, VirtualDrive
from tests.served_drive import joined

_BURST = 97  # control periods; a row is under way at the end of nearly every burst
_BEHIND = 16384  # bytes of rows that a client may be behind


@dataclass
class ServedUart:
    """A drive at a URL. Its time passes in bursts, by no clock; while `patient`, no quicker than clients take rows."""

    url: str
    drive: VirtualDrive
    server: UartServer
    burst: int = _BURST  # control periods
    patient: bool = True
    rows: list[StreamRows] = field(default_factory=list[StreamRows], repr=False)  # all that it has sent or could have
    running: threading.Event = field(default_factory=threading.Event)
    _end: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        """Let time pass until `end`; it stands still while `running` is clear."""
        while not self._end.wait(0.004):
            behind = max((line._behind for line in list(self.server._lines.values())), default=0)
            if self.running.is_set() and not (self.patient and behind > _BEHIND):
                self.step(self.burst)

    def step(self, periods: int) -> None:
        """Let so many control periods pass."""
        rows = self.drive.run(periods)
        self.rows.append(rows)
        self.server.publish(rows)

    def end(self) -> None:
        """Let no more time pass."""
        self._end.set()

    def check(self, blocks: list[Block]) -> None:
        """Fail where a value of a block is not what the drive produced at that tick, to half a count."""
        produced = {f.name: np.concatenate([getattr(part, f.name) for part in list(self.rows)])
                    for f in fields(StreamRows)}
        full = {name: self.drive.read(name) for name in ("i_full", "u_full", "omega_full")}
        ticks = joined(blocks, "tick")
        place = np.searchsorted(produced["row_tick"], ticks)
        assert np.array_equal(produced["row_tick"][place], ticks)
        for name in STREAM_ROW:
            off = joined(blocks, name) - produced[name][place]
            if name == "theta_e":
                off = (off + np.pi) % (2.0 * np.pi) - np.pi
            assert np.abs(off).max() <= 0.5 * count_size(signal_named(name), full) * 1.001, name


@contextlib.contextmanager
def served_uart(
    url: str, scenario: Scenario = PAPER, paced: bool = False
) -> Generator[ServedUart]:
    """A virtual drive at a URL, in this process."""
    drive = VirtualDrive(scenario)
    drive.warm_up()
    with UartServer(drive, parse_uart_url(url), paced=paced) as server:
        bench = ServedUart(url, drive, server, patient=not paced)
        bench.step(_BURST)
        bench.running.set()
        thread = threading.Thread(target=bench.run, name="drive's time")
        thread.start()
        try:
            yield bench
        finally:
            bench.end()
            thread.join()
