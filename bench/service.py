"""The service: pumps, worker and their state, as one context manager. Knows nothing of HTTP."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from types import TracebackType
from typing import Any, Self

from bench.acquisition import Acquisition, Link, LinkState
from bench.captures import Captures
from bench.config import Config
from bench.diagnosis_jobs import DiagnosisJobs
from bench.errors import shown
from bench.estimation import Estimation, Snapshot
from bench.experiments import Experiments
from bench.lease import Leases, Writer
from bench.signals import Reading, checked, read, write
from bench.window import Window

STALE = 1.0  # s without a sample after which estimates are called stale
_WRITE = 30.0  # s that a write of signals may take, on the slowest line
_CANCEL = 0.5  # s in which captures end, while there are still links
_LEAVE = 1.5  # s in which all pumps must end; one that is held up in connecting is left behind


@dataclass(frozen=True, slots=True)
class ThreadHealth:
    """One thread of the service."""

    name: str
    alive: bool
    failure: str | None = None  # its last unexpected failure


class UnknownDriveError(KeyError):
    """No drive of that name."""

    def __str__(self) -> str:
        return str(self.args[0])


class Service:
    """Everything that runs between the drives and whoever asks. Use as a context manager."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self._urls = {drive.name: drive.url for drive in config.drives}
        self._estimation = Estimation(
            {drive.name: drive.window for drive in config.drives},
            {drive.name: drive.nominal.theta_step for drive in config.drives},
            {drive.name: drive.nominal.given for drive in config.drives},
        )
        self._pumps = {name: self._pump(name, url) for name, url in self._urls.items()}
        self._leases = Leases(self._device)
        self.captures = Captures(config.captures, self._urls, self._pumps, self._leases)
        nominals = {drive.name: drive.nominal for drive in config.drives}
        self.experiments = Experiments(config.captures, self._urls, self._pumps, self._leases, nominals)
        self.diagnoses = DiagnosisJobs(config.captures, nominals)
        self._writes = count(1)
        self._started = time.monotonic()

    def __enter__(self) -> Self:
        self._estimation.start()
        for pump in self._pumps.values():
            pump.start()
        self.captures.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        deadline = time.monotonic() + _LEAVE
        self.diagnoses.leave()
        self.experiments.leave()
        self.captures.leave()
        self.experiments.join(_CANCEL)  # while there are links, by which drives and recorders are told to stop
        self.captures.join(_CANCEL)
        for pump in self._pumps.values():
            pump.end()
        for pump in self._pumps.values():
            pump.join(max(0.0, deadline - time.monotonic()))
        self.captures.join(max(0.0, deadline - time.monotonic()))
        self._estimation.stop()
        self.diagnoses.join(_LEAVE)

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the drives, as configured."""
        return tuple(self._urls)

    @property
    def uptime(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._started

    def url(self, name: str) -> str:
        """A drive's address. Raises UnknownDriveError."""
        return self._urls[self._known(name)]

    def link(self, name: str) -> Link:
        """A drive's link and stream. Raises UnknownDriveError."""
        return self._pumps[self._known(name)].link

    def estimates(self, name: str) -> Snapshot:
        """A drive's latest estimates. Raises UnknownDriveError."""
        return self._estimation.snapshot(self._known(name))

    def writer(self, name: str) -> Writer | None:
        """Who writes to a drive at present. Raises UnknownDriveError."""
        return self._leases.writer(self._known(name))

    def change_window(self, name: str, change: Mapping[str, Any]) -> Window:
        """Change a drive's window while it runs. Raises UnknownDriveError, LimitError."""
        return self._estimation.change_window(self._known(name), change)

    def read_signals(self, name: str, signals: Sequence[str]) -> list[Reading]:
        """A drive's signals, all where none is named. Raises UnknownDriveError, LimitError, DriveError."""
        return read(self._pumps[self._known(name)].drive(), signals)

    def write_signals(self, name: str, values: Mapping[str, Any], whom: str = "") -> list[Reading]:
        """Write signals for `whom`, and read them back. Raises as `read_signals`, and ConflictError."""
        wanted, drive = checked(values), self._pumps[self._known(name)].drive()
        holder = f"a write {next(self._writes)}" + (f" (asked for from {whom})" if whom else "")
        self._leases.take(name, holder, _WRITE)
        try:
            return write(drive, wanted)
        finally:
            self._leases.release(name, holder)

    def threads(self) -> list[ThreadHealth]:
        """Every thread, alive or not."""
        worker = ThreadHealth("estimation", self._estimation.thread.is_alive(), self._estimation.failure)
        pumps = [ThreadHealth(pump.thread.name, pump.thread.is_alive()) for pump in self._pumps.values()]
        return [worker, *pumps]

    def healthy(self) -> bool:
        """All threads run and all drives stream."""
        streaming = all(pump.link.state is LinkState.STREAMING for pump in self._pumps.values())
        return streaming and all(thread.alive and thread.failure is None for thread in self.threads())

    def _pump(self, name: str, url: str) -> Acquisition:
        return Acquisition(name, url, lambda block: self._estimation.put(name, block))

    def _device(self, name: str) -> object:
        """What tells a drive from all others, whatever it is called here; None where it does not say."""
        identity = self._pumps[name].link.identity
        if identity is None or not identity.serial:
            return None
        return identity.vendor_id, identity.product_code, identity.serial

    def _known(self, name: str) -> str:
        if name not in self._urls:
            raise UnknownDriveError(f"no drive {shown(name)}; the drives are {', '.join(self._urls)}")
        return name
