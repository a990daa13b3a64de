"""`pmsm-bench capture`: by the running service, or by a drive's bus without one."""

from collections.abc import Callable, Generator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final

from rich.progress import MofNCompleteColumn, TimeElapsedColumn

from bench.actions.capture import Run, State, Status, new_status
from bench.actions.capture_request import COMMAND, Request
from bench.cli.output import awaited, check_recording
from bench.cli.rest import Job, rest_at
from bench.cli.terminal import Terminal, bar
from bench.errors import BenchError, ConfigError
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError

_TIMEOUT: Final = 10.0  # s for one answer
_console: Final = Terminal(soft_wrap=True)


def by_service(name: str, service: str | None, given: Mapping[str, Any], out: Path | None) -> None:
    """Have the service capture, and download the recording. Raises BenchError."""
    check_recording(_named(out, "capture"))
    request = Request.of(given)
    with rest_at(service, _TIMEOUT) as rest:
        job = Job(rest, name, "captures", dict(given))
        _remark(job.said["remark"])
        path = _named(out, job.id)
        with _bar(request.length) as show:
            job.follow(
                lambda said: show(said["state"], said["samples"], said["reason"]),
                lambda why: show("waiting", 0, why),
            )
        _check_end(job.said["state"], job.said["reason"], job.said["file"])
        written = job.fetch(path, "the recording, as capture")
    _tell(path, written, request, off=bool(job.said["remark"]))


def directly(url: str, given: Mapping[str, Any], out: Path | None) -> None:
    """Capture over a drive's bus. Raises BenchError, DriveError."""
    check_recording(_named(out, "capture"))
    status = new_status("drive", Request.of(given))
    if status.request.trigger == COMMAND:
        raise ConfigError("--trigger command: without a service nobody can give it, expected now or a level as i_q>2.0")
    path = _named(out, status.id)
    with closing(_Link(url)) as link, _bar(status.request.length) as show:

        def changed(status: Status) -> None:
            if not status.state.ended:
                show(status.state, status.samples, status.reason)

        run = Run(status, url, link, path, changed)
        if run.part.exists():
            raise ConfigError(f"{run.part} is of a capture that was interrupted; remove it, or choose another --out")
        run.arm()
        _remark(run.status.remark)
        awaited(run.finish, run.cancel)
    _check_end(run.status.state, run.status.reason, run.status.file)
    _tell(path, run.status.file or path, status.request, off=bool(run.status.remark))


class _Link:
    """A drive by its URL, connected anew where it was lost."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._drive: Drive | None = None

    def drive(self) -> Drive:
        """The drive, connected. Raises DriveError."""
        if self._drive is not None:
            try:
                self._drive.read("tick")
            except DriveError:
                self.close()
        if self._drive is None:
            self._drive = connect(self._url)
        return self._drive

    def close(self) -> None:
        """Leave the bus."""
        if self._drive is not None:
            self._drive.close()
            self._drive = None


Show = Callable[[str, int, str], None]
"""Shows a state, samples, and what it waits for."""


@contextmanager
def _bar(length: int) -> Generator[Show]:
    with bar("", length, MofNCompleteColumn(), TimeElapsedColumn()) as update:
        yield lambda state, samples, reason: update(
            completed=samples, description=f"{state}: {reason}" if reason else str(state)
        )


def _named(out: Path | None, id_: str) -> Path:
    return Path(f"{id_}.parquet") if out is None else out


def _remark(said: str) -> None:
    if said:
        Terminal(stderr=True).print(f"pmsm-bench: {said}", soft_wrap=True)


def _check_end(state: str, reason: str, file: object) -> None:
    if state == State.DONE:
        return
    said = "failed" if state == State.FAILED else f"was {state}"
    raise BenchError(f"the capture {said}" + (f": {reason}" if reason else "") + (f" in {file}" if file else ""))


def _tell(path: Path, written: Path, request: Request, *, off: bool) -> None:
    """Where the recording is; nothing can be estimated of a drive that was `off`.

    Raises ConfigError where it is not where it was to be.
    """
    if written != path:
        raise ConfigError(f"--out: {path} has been made by another meanwhile; the recording is whole, in {written}")
    said = f"{written}: {request.length} samples"
    if request.replayable and not off:
        said += f"; estimates: pmsm-bench replay {written}"
    _console.print(said)
