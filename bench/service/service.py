"""The service: pumps, worker and their state, as one context manager. Knows nothing of HTTP."""

import contextlib
import json
import re
import shutil
import socket
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Final, Self
from urllib.parse import unquote

from bench.actions import captures, experiments
from bench.actions.captures import Captures
from bench.actions.control import Control
from bench.actions.drive_jobs import sensible
from bench.actions.experiments import Experiments, Status
from bench.actions.flashes import Flashes
from bench.actions.recording import Surroundings
from bench.actions.recordings import Recordings
from bench.actions.safety.lease import Change, Leases, Part, Writer
from bench.actions.safety.limits import Limits
from bench.actions.safety.under_control import CancelledError
from bench.actions.safety.unfinished import Origin, undo
from bench.commissioning.commissionings import Commissionings
from bench.commissioning.commissionings import Status as Commissioning
from bench.config import Config, DriveConfig
from bench.diagnoses.diagnosis_jobs import RESULT, DiagnosisJobs, JobState
from bench.errors import BenchError, ConflictError, LimitError, UnavailableError, UnknownError, shown
from bench.files import sweep
from bench.live.acquisition import Acquisition, Link, LinkState
from bench.live.estimation import Estimation, Snapshot
from bench.live.recent import Latest, Recent
from bench.live.trust import STALE, trusted
from bench.live.window import Window
from bench.machine_file import Nominal
from bench.service.parameters import Snapshots
from bench.service.signals import Reading, checked, read, read_back, values_of, write
from bench.store.catalogue.chronicle import Happening, ParameterSet
from bench.store.catalogue.ended import EndedJob
from bench.store.catalogue.found import FoundFiles, Row
from bench.store.catalogue.keeper import Keeper
from bench.store.catalogue.memory import Memory, Point, point_of
from bench.store.diagnoses import Diagnoses
from bench.store.rows import BYTES_PER_ROW
from bench.store.shelf import Recording, Shelf
from bench.store.write_log import Entry, to_standard_error
from drivers.block import Block
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.wire.dictionary import SET_POINTS

_WRITE = 30.0  # s that a write of signals may take, on the slowest line
_STOP = 1.2  # s in which drives are stopped, and jobs on them end, while there are still links
_FLASH = 6.0  # s more that a flash under way is waited for, beyond which its journal tells the next start
_LEAVE = 1.8  # s in which all must end; a pump that is held up in connecting is left behind
_DIAGNOSED = 0.2  # s between looks at a diagnosis that is waited for
_LAST = 0.3  # s more, for the estimation
_OF_DRIVE: Final = re.compile("/api/drives/([^/]+)")


@dataclass(frozen=True, slots=True)
class ThreadHealth:
    """One thread of the service."""

    name: str
    alive: bool
    failure: str | None = None  # its last unexpected failure


@dataclass(frozen=True, slots=True)
class Room:
    """For recordings of a drive."""

    free_bytes: float  # without what is left for others
    bytes_per_day: float | None  # at most; None while no rows come
    days: float | None  # that there is room for


@dataclass(slots=True)
class ServiceDrive:
    """A drive of the service."""

    url: str
    nominal: Nominal  # what is known of its motor
    limits: Limits  # of its set points
    link: Acquisition
    control: Control
    recent: Recent  # the latest rows
    undone: str = ""  # what a bench before this one left and this one undid, in a sentence


def _name_of(config: Config) -> str:
    """What tells this bench from others in the same catalogue."""
    return f"{socket.gethostname()}:{config.port}"


class Service:
    """Everything that runs between the drives and whoever asks. Use as a context manager."""

    def __init__(self, config: Config) -> None:
        self.config = config
        machines = {drive.name: drive.nominal for drive in config.drives}
        self._configured = {drive.name: drive.window for drive in config.drives}
        self.history = (
            None if not config.database else Keeper(config.database, _name_of(config), self._points, self._recall)
        )
        windows = {drive.name: self._remembered(drive) for drive in config.drives}
        self._estimation = Estimation(windows, machines)
        self._leases = Leases(self._device, self._lease_changed)
        self.drives = {drive.name: self._made(drive) for drive in config.drives}  # as configured
        self._snapshots = Snapshots(self.drives, self._parameters_changed)
        self.captures = Captures(config.captures, self.drives, self._leases, self._ended)
        self.experiments = Experiments(config.captures, config.journals, self.drives, self._leases, self._ended)
        self.commissionings = Commissionings(
            config.captures, config.journals, self.drives, self._leases, self._diagnosed
        )
        self.flashes = Flashes(config.journals, self.drives, self._leases, self._flash_happened, self._has_undone)
        self._kept = Diagnoses(config.captures, self._diagnoses_read)
        self.diagnoses = DiagnosisJobs(config.captures, machines, kept=self._kept)
        self.recordings = Recordings(
            config.captures, self.drives, self._leases, config.keep_free_megabytes * 1e6,
            Surroundings(
                self._state_words, lambda name: asdict(self.estimates(name).window), self._snapshots.read
            ),
        )
        for jobs in (self.captures, self.experiments, self.commissionings):
            jobs.on_begin = self._snapshots.ask
        self.shelf = Shelf(config.captures, self._recordings_read)
        self._writes = count(1)
        self._leaving: threading.Thread | None = None
        self._experiments_on, self._flashes_on = list[str](), list[str]()  # drives, when it was to end
        self._recorded = list[str]()  # recordings, then
        self._started, self._begun = time.monotonic(), datetime.now(UTC)

    def __enter__(self) -> Self:
        self._estimation.start()
        if self.history is not None:
            self.history.read()
            self.history.start()
            self._snapshots.start()
        for drive in self.drives.values():
            drive.link.start()
        for drive in self.drives.values():
            drive.control.begin()
        sweep(self.config.captures)
        self.recordings.start()
        self.captures.start()
        self.experiments.start()
        self.commissionings.start()
        self.diagnoses.start()
        _begun("recordings that were made", self._read_past)
        return self

    def __exit__(self, *_: object) -> None:
        self.leave()
        assert self._leaving is not None
        self._leaving.join(_FLASH + _LEAVE + _LAST)

    def leave(self) -> None:
        """Begin the end, without waiting for it: drives are stopped, jobs on them end, then links are closed.

        For one thread; asked again, it does nothing.
        """
        if self._leaving is None:
            self._leaving = threading.Thread(target=self._end, name="end", daemon=True)
            self._leaving.start()

    def farewell(self) -> list[str]:
        """What became of drives and recordings when it ended, a sentence each."""
        return [*map(self._left, self.drives), *map(self._closed, self._recorded)]

    @property
    def uptime(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._started

    @property
    def free_bytes(self) -> float:
        """Of the disk, for recordings: without what they leave for others."""
        folder = self.config.captures
        there = next(place for place in (folder, *folder.parents) if place.exists())
        return max(0.0, shutil.disk_usage(there).free - self.config.keep_free_megabytes * 1e6)

    def room_for(self, name: str) -> Room:
        """What recording a drive takes, and for how long there is room. Raises UnknownError."""
        link, free = self.link(name), self.free_bytes
        a_day = None if not link.row_time else 86_400.0 / link.row_time * BYTES_PER_ROW
        return Room(free, a_day, None if a_day is None else free / (2.0 * a_day))  # closing takes as much again

    def drive(self, name: str) -> ServiceDrive:
        """A drive. Raises UnknownError."""
        if name not in self.drives:
            raise UnknownError(f"no drive {shown(name)}; the drives are {', '.join(self.drives)}")
        return self.drives[name]

    def link(self, name: str) -> Link:
        """A drive's link and stream. Raises UnknownError."""
        return self.drive(name).link.status

    def latest(self, name: str) -> Latest | None:
        """What a drive does now; None where its newest row is too old for an estimate, too. Raises UnknownError."""
        drive, age = self.drive(name), self.link(name).age
        return None if age is None or age > STALE else drive.recent.latest()

    def estimates(self, name: str) -> Snapshot:
        """A drive's latest estimates, as far as they are to be believed now. Raises UnknownError."""
        drive = self.drive(name)
        return trusted(self._estimation.snapshot(name), drive.link.status, drive.control.off_words)

    def experiment_on(self, name: str) -> str | None:
        """The experiment or commissioning that has a drive, by its name; None where none has. Raises UnknownError."""
        return self._holder_among(name, self.experiments.holders | self.commissionings.holders)

    def flash_on(self, name: str) -> str | None:
        """The flash that has a drive, likewise. Raises UnknownError."""
        return self._holder_among(name, self.flashes.holders)

    def writer(self, name: str) -> Writer | None:
        """Who writes to a drive at present, besides this service's control of it. Raises UnknownError."""
        writer = self._leases.writer(name) if self.control(name).whom is None else None
        return writer or self._leases.writer(name, Part.RECORDER)

    def control(self, name: str) -> Control:
        """A drive's state and control. Raises UnknownError."""
        return self.drive(name).control

    def start_drive(self, name: str, values: Mapping[str, Any], whom: str = "") -> None:
        """Start a drive with set points for `whom`. Raises UnknownError, LimitError, ConflictError, DriveError."""
        wanted = checked(values, SET_POINTS) if values else {}
        for signal in wanted:
            if signal not in SET_POINTS:
                raise LimitError(f"a drive is started with set points ({', '.join(SET_POINTS)}), got {signal}")
        self.control(name).start(wanted, whom)
        self.drive(name).undone = ""

    def stop_drive(self, name: str, whom: str = "") -> None:
        """Stop a drive, whoever controls it. Raises UnknownError, DriveError."""
        one, names = self.control(name), self._names_of(name)
        for other in names:
            self.experiments.stop(other)
            self.commissionings.stop(other)
            self.drives[other].control.void()
        with self.flashes.stopping(*names):
            one.stop(whom)

    def begin_experiment(self, name: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Have a drive do an experiment for `whom`. Raises UnknownError, and as `Experiments.ask`."""
        self.control(name).said = ""
        status = self.experiments.ask(name, given, whom)
        self.drive(name).undone = ""
        return status

    def begin_commissioning(self, name: str, given: Mapping[str, Any], whom: str = "") -> Commissioning:
        """Have a drive commissioned for `whom`. Raises UnknownError, and as `Commissionings.ask`."""
        self.control(name).said = ""
        status = self.commissionings.ask(name, given, whom)
        self.drive(name).undone = ""
        return status

    def set_points(self, name: str) -> dict[str, float]:
        """A drive's set points, SI. Raises UnknownError, DriveError."""
        return values_of(self.drive(name).link.drive(), SET_POINTS)

    def change_window(self, name: str, change: Mapping[str, Any]) -> Window:
        """Change a drive's window while it runs. Raises UnknownError, LimitError."""
        self.drive(name)
        window = self._estimation.change_window(name, change)
        if self.history is not None:
            self.history.remember_window(name, asdict(self._configured[name]), asdict(window))
        return window

    def read_signals(self, name: str, signals: Sequence[str]) -> list[Reading]:
        """A drive's signals, all where none is named. Raises UnknownError, LimitError, DriveError."""
        return read(self.drive(name).link.drive(), signals)

    def write_signals(
        self, name: str, values: Mapping[str, Any], whom: str = "", before: dict[str, float] | None = None
    ) -> list[Reading]:
        """Write signals for `whom`, and read them back; `before` is told what they were, as far as they can be read.

        Raises as `read_signals`, and ConflictError.
        """
        wanted, one = checked(values), self.control(name)
        drive = self.drives[name].link.drive()
        holder = f"a write {next(self._writes)}" + (f" (asked for from {whom})" if whom else "")
        if one.whom is None:
            self._leases.take(name, holder, _WRITE, Part.CONTROL, momentary=True)
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
        drives = self.drives.values()
        others = [drive.link.thread for drive in drives] + [drive.control.thread for drive in drives]
        kept = [] if (one := self.history) is None else [ThreadHealth("history", one.thread.is_alive(), one.failure)]
        return [worker, *kept, *(ThreadHealth(thread.name, thread.is_alive()) for thread in others)]

    def healthy(self) -> bool:
        """All threads run and all drives stream."""
        streaming = all(drive.link.status.state is LinkState.STREAMING for drive in self.drives.values())
        return streaming and all(thread.alive and thread.failure is None for thread in self.threads())

    def _diagnosed(
        self, recording: str, given: Mapping[str, Any], cancelled: threading.Event, waits: Callable[[], None]
    ) -> Mapping[str, Any]:
        """A recording's diagnosis, as JSON; calls `waits` meanwhile. Raises BenchError."""
        job = self.diagnoses.ask(recording, given)
        while not job.state.ended:
            if cancelled.wait(_DIAGNOSED):
                with contextlib.suppress(BenchError):
                    self.diagnoses.remove(job.id)
                raise CancelledError("it was cancelled while its recording was diagnosed; the drive is stopped")
            waits()
            job = self.diagnoses.named(job.id)
        if job.state is not JobState.DONE:
            raise UnavailableError(f"the diagnosis of {recording} is {job.state}: {job.reason}")
        return json.loads(self.diagnoses.file(job, RESULT))

    def _end(self) -> None:
        begun, drives = time.monotonic(), self.drives.values()
        self._experiments_on = [name for name in self.drives if self.experiment_on(name) is not None]
        self.flashes.leave()
        self._flashes_on = [name for name in self.drives if self.flash_on(name) is not None]
        self._recorded = [one.id for one in self.recordings.known() if not one.state.ended]

        def left(of: float) -> float:
            return max(0.0, begun + of - time.monotonic())

        stops = [_begun(f"stop {name}", drive.control.end) for name, drive in self.drives.items()]
        for jobs in (self.commissionings, self.experiments, self.captures, self.recordings, self.diagnoses):
            jobs.leave()
        self._snapshots.end()
        for stop in stops:  # while there are links, by which drives and recorders are told to stop
            stop.join(left(_STOP))
        self.commissionings.join(left(_STOP))
        self.experiments.join(left(_STOP))
        self.captures.join(left(_STOP))
        if self._flashes_on:
            to_standard_error(f"a flash is under way, and is waited for, {_FLASH:g} s at most")
            self.flashes.join(_FLASH)
            begun = time.monotonic()
        closing = [_begun(f"close {name}", drive.link.end) for name, drive in self.drives.items()]
        for thread in (*stops, *closing):
            thread.join(left(_LEAVE))
        for drive in drives:
            drive.control.join(left(_LEAVE))
            drive.link.join(left(_LEAVE))
        for jobs in (self.captures, self.recordings, self.diagnoses):
            jobs.join(left(_LEAVE))
        self._snapshots.join(left(_LEAVE))
        if self.history is not None:  # when nobody tells it anything more
            self.history.end()
            self.history.join(max(left(_LEAVE), _LAST))
        self._estimation.stop()  # last: nobody waits for it longer than that

    def _left(self, name: str) -> str:
        """What became of a drive."""
        if name in self._experiments_on:
            ended = "ended, and stopped it" if self.experiment_on(name) is None else "not ended: its lease runs out"
            return f"{name}: its experiment or commissioning has {ended}"
        if name in self._flashes_on:
            latest = self.flashes.latest(name) if self.flash_on(name) is None else None
            how = "not ended: the next start tells" if latest is None else f"ended: {latest.state}"
            return f"{name}: its flash has {how}"
        return f"{name}: {self.control(name).farewell or 'left as it was, this service did not control it'}"

    def _closed(self, id_: str) -> str:
        """What became of a recording that was under way."""
        now = self.recordings.find(id_)
        if now is None or not now.state.ended:
            return f"recording {id_}: not closed yet, the next service does so"
        return f"recording {id_}: " + (f"closed, {now.rows} rows" if now.file else f"{now.state}, {now.reason}")

    def _made(self, config: DriveConfig) -> ServiceDrive:
        name, folder, recent = config.name, self.config.journals, Recent()

        def connected(drive: Drive) -> None:
            with contextlib.suppress(ConflictError):  # another bench is at work with it
                self._has_undone(name, undo(folder, drive))
            self.flashes.connected(name, drive.identity)
            self._snapshots.ask(name, "connected")

        def take(block: Block) -> None:
            status = self.drives[name].link.status
            recent.put(block)
            self.recordings.put(name, block, status)
            self._estimation.put(name, block, status.made)

        happened = partial(self._happened, name)
        link = Acquisition(name, config.url, take, connected, happened)
        control = Control(name, link, self._leases, config.limits, lambda what: Origin(folder, name, what), happened)
        return ServiceDrive(config.url, config.nominal, config.limits, link, control, recent)

    def _has_undone(self, name: str, said: str) -> None:
        """What a bench before has left in a drive is undone, a sentence; empty: there was nothing."""
        if said:
            self.drives[name].undone = said
            to_standard_error(f"drive  {name}: {said}")

    def _remembered(self, drive: DriveConfig) -> Window:
        """The window that was chosen last, unless the configuration has another one since."""
        found = None if self.history is None else self.history.window(drive.name, asdict(drive.window))
        with contextlib.suppress(LimitError):
            return drive.window if found is None else drive.window.changed(found)
        return drive.window

    def _recall(self, memory: Memory) -> None:
        """What the catalogue remembers of files, captures, experiments and parameters. Raises UnavailableError."""
        memory.chronicle.left(self._begun)
        for name in self.drives:
            self._snapshots.recall(memory.chronicle.snapshots(name, None, 1)[0])
        self.shelf.recall(memory.recordings(self.shelf.folder).all())
        self._kept.recall(memory.diagnoses(self._kept.folder).all())
        made = memory.ended.latest("capture", Captures.remembered)
        self.captures.remember(sensible(captures.of_ended, made))
        done = memory.ended.latest("experiment", Experiments.remembered)
        self.experiments.remember(sensible(experiments.of_ended, done))

    def _read_past(self) -> None:
        """What the recordings tell of captures and experiments that the catalogue does not."""
        every = self.shelf.all()
        made, done = self.captures.unknown(every), self.experiments.unknown(every)
        self.captures.remember(sensible(captures.of_recording, self._paths(made)))
        self.experiments.remember(sensible(experiments.of_recording, self._paths(done)))

    def _paths(self, recordings: Iterable[Recording]) -> Iterator[Path]:
        """Until the service is to end."""
        return (one.path for one in recordings if self._leaving is None)

    def _recordings_read(self, read: list[Row], gone: list[str]) -> None:
        self._found_files(lambda memory: memory.recordings(self.shelf.folder), read, gone)

    def _diagnoses_read(self, read: list[Row], gone: list[str]) -> None:
        self._found_files(lambda memory: memory.diagnoses(self._kept.folder), read, gone)

    def _found_files(self, of: Callable[[Memory], FoundFiles], read: list[Row], gone: list[str]) -> None:
        """Files have been read, have gone."""
        self._tell(lambda memory: (of(memory).drop(gone), of(memory).add(read)))

    def _ended(self, job: EndedJob) -> None:
        """A capture, or an experiment, has ended."""
        self._tell(lambda memory: memory.ended.add(job))

    def wrote(self, entry: Entry) -> None:
        """A write has reached what it is about, see `WriteLog`."""
        drive = unquote(found[1]) if (found := _OF_DRIVE.match(entry.path)) else ""
        self._tell(lambda memory: memory.chronicle.wrote(drive, entry.time, asdict(entry)))

    def _tell(self, write: Callable[[Memory], object]) -> None:
        """Have the catalogue remember something, where there is one."""
        if self.history is not None:
            self.history.tell(write)

    def _happened(self, drive: str, kind: str, sentence: str) -> None:
        one = Happening(drive, datetime.now(UTC), kind, sentence)
        self._tell(lambda memory: memory.chronicle.happened(one))

    def _flash_happened(self, drive: str, sentence: str) -> None:
        to_standard_error(f"drive  {drive}: {sentence}")
        self._happened(drive, "flash", sentence)

    def _lease_changed(self, change: Change) -> None:
        one = change.drive, change.part.value, change.holder, change.at
        if change.how:
            self._tell(lambda memory: memory.chronicle.gave_up(*one, change.how))
        else:
            self._tell(lambda memory: memory.chronicle.took(*one))

    def _parameters_changed(self, snapshot: ParameterSet) -> None:
        self._tell(lambda memory: memory.chronicle.add_snapshot(snapshot))

    def _points(self) -> list[Point]:
        """Of the history, this second."""
        now = time.time()
        found = [
            point_of(name, parameter, now, estimate.value, estimate.std, estimate.status)
            for name in self.drives for parameter, estimate in self.estimates(name).result.estimates.items()
        ]
        return [point for point in found if point is not None]

    def _state_words(self, name: str) -> str:
        """A drive's link and state, in words."""
        link, state = self.drives[name].link.status.state, self.drives[name].control.state
        if link is not LinkState.STREAMING or state is None:
            return f"link {link}"
        return f"{state.state}" + (f": {state.fault}" if state.fault else "")

    def _device(self, name: str) -> object:
        """What tells a drive from all others, whatever it is called here; None where it does not say."""
        identity = self.drives[name].link.status.identity
        if identity is None or not identity.serial:
            return None
        return identity.vendor_id, identity.product_code, identity.serial

    def _holder_among(self, name: str, holders: Collection[str]) -> str | None:
        self.drive(name)
        writer = self._leases.writer(name)
        return writer.holder if writer is not None and writer.holder in holders else None

    def _names_of(self, name: str) -> list[str]:
        """All names that a drive has here, by its serial number."""
        device = self._device(name)
        return [other for other in self.drives if other == name or (device and self._device(other) == device)]


def _begun(name: str, work: Callable[[], None]) -> threading.Thread:
    """A thread that does this; what fails in it is said, and holds up nothing else."""

    def guarded() -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - one drive's end must not cost the others theirs
            to_standard_error(f"{name}: the bench failed: {type(error).__name__}: {error}")

    thread = threading.Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread
