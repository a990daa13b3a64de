"""A virtual drive in this process, in real time, on links that may go and come back, for tests."""

import contextlib
import threading
from collections.abc import Generator
from dataclasses import dataclass, field

from emulator.clock import Pacer
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from emulator.servers.faults import Faults, parse_fault
from emulator.servers.link import Link


@dataclass
class Driving:
    """A drive in this process, in real time, and its links."""

    drive: VirtualDrive
    links: list[Link]
    end: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        pacer = Pacer(self.drive.T_s, most=500)
        while not self.end.wait(0.002):
            rows = self.drive.run(pacer.due())
            for link in self.links:
                link.publish(rows)

    def spoil(self, *texts: str) -> None:
        """What befalls the links from now on."""
        for link in self.links:
            link.faults = Faults(map(parse_fault, texts))


@contextlib.contextmanager
def driving(*urls: str) -> Generator[Driving]:
    """The drive at some URLs."""
    drive = VirtualDrive(PAPER)
    drive.warm_up()
    with contextlib.ExitStack() as stack:
        running = Driving(drive, [stack.enter_context(Link(url, drive, Faults())) for url in urls])
        thread = threading.Thread(target=running.run, name="drive's time")
        thread.start()
        try:
            yield running
        finally:
            running.end.set()
            thread.join()
