"""The service: pumps, worker and their state, as one context manager. Knows nothing of HTTP."""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from types import TracebackType
from typing import Any, Self

from bench.actions.captures import Captures
from bench.actions.control import Control
from bench.actions.experiments import Experiments, Status
from bench.actions.lease import Leases, Part, Writer
from bench.actions.unfinished import Origin, folder_beside, undo
from bench.config import Config
from bench.diagnoses.diagnosis_jobs import DiagnosisJobs
from bench.errors import LimitError, shown
from bench.live.acquisition import Acquisition, Link, LinkState
from bench.live.estimation import Estimation, Snapshot
from bench.live.trust import trusted
from bench.live.window import Window
from bench.service.signals import Reading, checked, read, read_back, values_of, write
from bench.write_log import to_standard_error
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.wire.dictionary import SET_POINTS

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
        self._undone: dict[str, str] = {}
        self._estimation = Estimation(
            {drive.name: drive.window for drive in config.drives},
            {drive.name: drive.nominal.theta_step for drive in config.drives},
            {drive.name: drive.nominal.given for drive in config.drives},
        )
        self._pumps = {name: self._pump(name, url) for name, url in self._urls.items()}
        self._leases = Leases(self._device)
        self._controls = {
            name: Control(name, self._pumps[name], self._leases, drive.limits, self._origin(name))
            for name, drive in zip(self._urls, config.drives, strict=True)
        }
        self.captures = Captures(config.captures, self._urls, self._pumps, self._leases)
        nominals = {drive.name: drive.nominal for drive in config.drives}
        limits = {drive.name: drive.limits for drive in config.drives}
        self.experiments = Experiments(config.captures, self._urls, self._pumps, self._leases, nominals, limits)
        self.diagnoses = DiagnosisJobs(config.captures, nominals)
        self._writes = count(1)
        self._started = time.monotonic()

    def __enter__(self) -> Self:
        self._estimation.start()
        for pump in self._pumps.values():
            pump.start()
        for one in self._controls.values():
            one.begin()
        self.captures.start()
        self.experiments.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        deadline = time.monotonic() + _LEAVE
        for one in self._controls.values():
            one.end()
        self.diagnoses.leave()
        self.experiments.leave()
        self.captures.leave()
        self.experiments.join(_CANCEL)  # while there are links, by which drives and recorders are told to stop
        self.captures.join(_CANCEL)
        for pump in self._pumps.values():
            pump.end()
        for one in self._controls.values():
            one.join(max(0.0, deadline - time.monotonic()))
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
        """A drive's latest estimates, as far as they are to be believed now. Raises UnknownDriveError."""
        return trusted(self._estimation.snapshot(self._known(name)), self.link(name), self.control(name).off_words)

    def experiment_on(self, name: str) -> str | None:
        """The experiment that has a drive, by its name; None where none has. Raises UnknownDriveError."""
        writer = self._leases.writer(self._known(name))
        return writer.holder if writer is not None and writer.holder in self.experiments.holders else None

    def writer(self, name: str) -> Writer | None:
        """Who writes to a drive at present, besides this service's control of it. Raises UnknownDriveError."""
        writer = self._leases.writer(self._known(name)) if self.control(name).whom is None else None
        return writer or self._leases.writer(name, Part.RECORDER)

    def control(self, name: str) -> Control:
        """A drive's state and control. Raises UnknownDriveError."""
        return self._controls[self._known(name)]

    def undone(self, name: str) -> str:
        """What a bench before this one left and this one undid, in a sentence. Raises UnknownDriveError."""
        return self._undone.get(self._known(name), "")

    def start_drive(self, name: str, values: Mapping[str, Any], whom: str = "") -> None:
        """Start a drive with set points for `whom`. Raises UnknownDriveError, LimitError, ConflictError, DriveError."""
        wanted = checked(values) if values else {}
        for signal in wanted:
            if signal not in SET_POINTS:
                raise LimitError(f"a drive is started with set points ({', '.join(SET_POINTS)}), got {signal}")
        self.control(name).start(wanted, whom)
        self._undone.pop(name, None)

    def stop_drive(self, name: str, whom: str = "") -> None:
        """Stop a drive, whoever controls it. Raises UnknownDriveError, DriveError."""
        one = self.control(name)
        for other in self._names_of(name):
            self.experiments.stop(other)
            self._controls[other].void()
        one.stop(whom)

    def begin_experiment(self, name: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Have a drive do an experiment for `whom`. Raises UnknownDriveError, and as `Experiments.ask`."""
        self.control(name).said = ""
        status = self.experiments.ask(name, given, whom)
        self._undone.pop(name, None)
        return status

    def set_points(self, name: str) -> dict[str, float]:
        """A drive's set points, SI. Raises UnknownDriveError, DriveError."""
        return values_of(self._pumps[self._known(name)].drive(), SET_POINTS)

    def change_window(self, name: str, change: Mapping[str, Any]) -> Window:
        """Change a drive's window while it runs. Raises UnknownDriveError, LimitError."""
        return self._estimation.change_window(self._known(name), change)

    def read_signals(self, name: str, signals: Sequence[str]) -> list[Reading]:
        """A drive's signals, all where none is named. Raises UnknownDriveError, LimitError, DriveError."""
        return read(self._pumps[self._known(name)].drive(), signals)

    def write_signals(
        self, name: str, values: Mapping[str, Any], whom: str = "", before: dict[str, float] | None = None
    ) -> list[Reading]:
        """Write signals for `whom`, and read them back; `before` is told what they were, as far as they can be read.

        Raises as `read_signals`, and ConflictError.
        """
        wanted, one = checked(values), self.control(name)
        drive = self._pumps[name].drive()
        holder = f"a write {next(self._writes)}" + (f" (asked for from {whom})" if whom else "")
        if one.whom is None:
            self._leases.take(name, holder, _WRITE, Part.CONTROL)
        try:
            if before is not None:
                with contextlib.suppress(DriveError):
                    before |= values_of(drive, wanted)
            one.write(drive, wanted, lambda plain: write(drive, plain))
            return read_back(drive, wanted)
        finally:
            self._leases.release(name, holder)

    def threads(self) -> list[ThreadHealth]:
        """Every thread, alive or not."""
        worker = ThreadHealth("estimation", self._estimation.thread.is_alive(), self._estimation.failure)
        others = [pump.thread for pump in self._pumps.values()] + [one.thread for one in self._controls.values()]
        return [worker, *(ThreadHealth(thread.name, thread.is_alive()) for thread in others)]

    def healthy(self) -> bool:
        """All threads run and all drives stream."""
        streaming = all(pump.link.state is LinkState.STREAMING for pump in self._pumps.values())
        return streaming and all(thread.alive and thread.failure is None for thread in self.threads())

    def _pump(self, name: str, url: str) -> Acquisition:
        def connected(drive: Drive) -> None:
            if said := undo(folder_beside(self.config.captures), drive):
                self._undone[name] = said
                to_standard_error(f"drive  {name}: {said}")

        return Acquisition(
            name, url, lambda block: self._estimation.put(name, block, self._pumps[name].link.made), connected
        )

    def _origin(self, name: str) -> Callable[[str], Origin]:
        return lambda what: Origin(folder_beside(self.config.captures), name, what)

    def _device(self, name: str) -> object:
        """What tells a drive from all others, whatever it is called here; None where it does not say."""
        identity = self._pumps[name].link.identity
        if identity is None or not identity.serial:
            return None
        return identity.vendor_id, identity.product_code, identity.serial

    def _names_of(self, name: str) -> list[str]:
        """All names that a drive has here, by its serial number."""
        device = self._device(name)
        return [other for other in self._urls if other == name or (device and self._device(other) == device)]

    def _known(self, name: str) -> str:
        if name not in self._urls:
            raise UnknownDriveError(f"no drive {shown(name)}; the drives are {', '.join(self._urls)}")
        return name
