"""The experiments of all drives: asked for, watched, cancelled; what a service before this one left of them.

One at a time per drive, under the drive's lease. Recordings go to the folder of the captures. Knows nothing of HTTP.
"""

import contextlib
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from bench.actions import experiment
from bench.actions.drive_jobs import ended_words, id_at
from bench.actions.experiment import Plan, Progress, experiment_of
from bench.actions.experiment_part import SUFFIX, ExperimentPart
from bench.actions.moving_jobs import MovingJobs, Run, State
from bench.actions.safety.lease import Part
from bench.actions.safety.under_control import CancelledError
from bench.actions.safety.unfinished import Origin
from bench.errors import BenchError
from bench.recordings.table import notes
from bench.store.catalogue.ended import EndedJob
from drivers import capture
from drivers.errors import DriveError, GoneError

_RENEWED: Final = 30.0  # s that the lease is taken for, anew with every step ahead
_LINK: Final = 20.0  # s that a link is waited for, to take up what a drive still has
_RETRY: Final = 0.2  # s
_KILLED: Final = "the service ended while it ran"


@dataclass(frozen=True, slots=True)
class Status:
    """An experiment at one moment."""

    id: str
    drive: str
    plan: Plan
    asked: datetime
    state: State = State.RUNNING
    phase: str = ""  # what is being done, in words
    progress: float = 0.0  # 0 to 1
    reason: str = ""  # why it failed
    remarks: tuple[str, ...] = ()  # what was held otherwise than planned
    samples: int = 0
    file: Path | None = None


class Experiments(MovingJobs[Status]):
    """Everything about experiments, until `leave`."""

    kind, remembered = "experiment", 50

    def ask(self, drive: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Have a drive do an experiment. Raises LimitError, ConflictError, UnavailableError, DriveError."""
        stops = self._stops[drive]
        given = experiment_of(given) if "ambiguous" in given else given  # of a whole diagnosis
        plan, asked = Plan.of(given), datetime.now(UTC)
        experiment.check_motor(plan, self._drives[drive].nominal.told, f"drive {drive}'s machine file")
        self._check_folder()
        link = self._drives[drive].link.drive()  # from here on it is known which device that is
        id_ = id_at(f"{drive}-experiment", asked)
        status = Status(id_, drive, plan, asked)
        run = Run(f"experiment {id_}" + (f" (asked for from {whom})" if whom else ""))
        self._leases.take(drive, run.holder, _RENEWED, *Part)
        with contextlib.ExitStack() as otherwise:
            otherwise.callback(self._leases.release, drive, run.holder)
            experiment.check(link, plan, self._drives[drive].limits)
            origin = {"drive": drive, "url": self._drives[drive].url, "asked": asked.isoformat()}
            part = experiment.begin(self._folder / f"{id_}.parquet", plan, link, origin)
            otherwise.callback(part.remove)
            self._begin(status, run, lambda: self._done(status, part, run), stops)
            otherwise.pop_all()
        return status

    def start(self) -> None:
        """Finish what a service before this one has left, as far as it can be; say what cannot."""
        self._take_up(SUFFIX, self._go_on, lambda id_, drive, why: Status(
            id_, drive, Plan(()), datetime.now(UTC), State.FAILED, reason=why
        ), "-experiment")  # fmt: skip

    def _begin(
        self, status: Status, run: Run, work: Callable[[], dict[str, Any]], stops: int | None = None
    ) -> None:
        """Have a thread work at an experiment; what it returns is how it ended. `stops`: so many were there before."""

        def guarded() -> None:
            try:
                ended = work()
            except Exception as error:  # noqa: BLE001 - a fault of ours must not leave an experiment without an end
                why = f"the bench failed on this experiment: {type(error).__name__}: {error}"
                ended = {"state": State.FAILED, "reason": why}
            self._leases.release(status.drive, run.holder, ended_words(ended["state"], ended["reason"]))
            with self._lock:  # who waits for its end finds it told
                self._end(status.id, phase="", **ended)
                self._on_end(as_ended(self._known[status.id]))

        self._put_unless_stopped(status, run, guarded, stops)

    def _done(self, status: Status, part: ExperimentPart, run: Run) -> dict[str, Any]:
        """Do all of it; how it went."""

        def tell(far: Progress) -> None:
            self._leases.take(status.drive, run.holder, _RENEWED, *Part)
            self._change(status.id, phase=far.phase, progress=far.share)

        state = State.FAILED
        try:
            noted = Origin(self._notes, status.drive, run.holder)
            experiment.run(
                self._drives[status.drive].link.drive(), status.plan, tell, run.cancelled, part,
                limits=self._drives[status.drive].limits, origin=noted,
            )  # fmt: skip
            why = ""
        except CancelledError as error:
            state, why = State.CANCELLED, str(error)
            if not self._ending:
                part.remove()
                return {"state": state, "reason": why}
        except (BenchError, DriveError) as error:
            why = str(error)
            if run.cancelled.is_set() and not self._ending:  # a stop, which has ended its control as well
                part.remove()
                return {"state": State.CANCELLED, "reason": f"the experiment was stopped ({why})"}
        except OSError as error:
            why = f"the recording cannot be kept on disk: {error.strerror or error}"
        except Exception as error:  # noqa: BLE001 - as in `_begin`, and nothing that was recorded is lost
            why = f"the bench failed on this experiment: {type(error).__name__}: {error}"
        return self._ended(part, state, why)

    def _ended(self, part: ExperimentPart, state: State, why: str) -> dict[str, Any]:
        """What there is becomes a recording; `why` it came no further, where it did not."""
        samples, remarks, complete = part.samples, part.remarks, part.complete
        file, kept = part.settled()
        if complete and file is not None:
            state, why = State.DONE, ""
        else:
            why = "; ".join(filter(None, (why, kept if samples else "")))
        share = {"progress": 1.0} if state is State.DONE else {}
        return {"state": state, "reason": why, "file": file, "samples": samples, "remarks": remarks, **share}

    def _go_on(self, path: Path) -> None:
        """Take up what an experiment has left, unless it is of another service, or drive; see `Captures`."""
        part = ExperimentPart.found(path)
        if part is None:
            return
        with contextlib.ExitStack() as otherwise:
            otherwise.callback(part.close)
            origin, name = part.heading.origin, part.heading.origin["drive"]
            if name not in self._drives or self._drives[name].url != origin["url"]:
                return
            asked = datetime.fromisoformat(origin["asked"])
            status = Status(path.stem, name, Plan.of(part.heading.plan), asked, phase="taken up again")
            run = Run(f"experiment {status.id}")
            self._leases.take(name, run.holder, _RENEWED, Part.RECORDER)
            self._begin(status, run, lambda: self._taken_up(status, part, run))
            otherwise.pop_all()

    def _taken_up(self, status: Status, part: ExperimentPart, run: Run) -> dict[str, Any]:
        """Upload what the drive still has of the newest group, which moves nothing; write what there is."""
        last = part.groups[-1] if part.groups else None
        if last is not None and last.done < last.count:
            rest = replace(last, data=bytearray(last.data))

            def uploaded(done: int) -> None:
                part.keep(rest.data, done * 2 * len(rest.setup.channels))
                self._leases.take(status.drive, run.holder, _RENEWED, Part.RECORDER)
                self._change(status.id, phase=f"uploading {done} of {rest.count} samples")
                if run.cancelled.is_set():
                    raise CancelledError("the experiment was cancelled")

            deadline = time.monotonic() + _LINK
            while time.monotonic() < deadline and not run.cancelled.is_set():
                try:
                    capture.upload(self._drives[status.drive].link.drive(), rest, uploaded)
                    break
                except (GoneError, CancelledError, OSError):
                    break
                except DriveError:  # not connected yet, or no longer
                    run.cancelled.wait(_RETRY)
        if self._ending:
            part.close()
            return {"state": State.FAILED, "reason": f"{_KILLED}; what there is of it is taken up at the next start"}
        return self._ended(part, State.FAILED, _KILLED)


def as_json(status: Status) -> dict[str, Any]:
    """An experiment as plain values."""
    told = asdict(status)
    plan, file = told.pop("plan"), told.pop("file")
    return {**told, **plan, "file": None if file is None else str(file)}


def as_ended(status: Status) -> EndedJob:
    """An experiment that has ended, as it is remembered."""
    return EndedJob(
        "experiment", status.id, status.drive, status.asked, status.state.value, status.progress, status.samples,
        status.reason, status.remarks, None if status.file is None else str(status.file), _plan(asdict(status.plan)),
    )  # fmt: skip


def of_ended(job: EndedJob) -> Status:
    """An experiment as it was remembered. Raises LimitError where it makes no sense any more."""
    return Status(
        job.id, job.drive, Plan.of(job.request), job.asked, State(job.state), "", job.progress, job.reason,
        job.remarks, job.samples, None if job.file is None else Path(job.file),
    )  # fmt: skip


def of_recording(path: Path) -> Status:
    """What a recording tells of the experiment that made it.

    Raises RecordingError, LimitError, ValueError, LookupError.
    """
    told = notes(path)
    asked, drive = datetime.fromisoformat(told["asked"]), str(told["drive"])
    samples, expected = int(told["samples"]), int(told["expected"])
    whole = samples >= expected
    return Status(
        id_at(f"{drive}-experiment", asked), drive, Plan.of(told["experiment"]), asked,
        State.DONE if whole else State.FAILED, "", min(1.0, samples / expected),
        "" if whole else f"the first {samples} of {expected} samples are kept",
        tuple(map(str, told["remarks"])), samples, path,
    )  # fmt: skip


def _plan(plan: Mapping[str, Any]) -> dict[str, Any]:
    """As `Plan.of` takes it, which expects a list."""
    return {**plan, "holds": list(plan["holds"])}
