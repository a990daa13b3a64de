"""Processes that work for this one. Knows nothing of the work.

A worker does one job after another and tells how far it is. It computes on one core, so that a result does not
depend on how many there are; it does not hear Ctrl-C, is killed without harm to anybody else, and ends with the
process that started it, however that ends.
"""

import contextlib
import importlib
import os
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any, Final

from bench.errors import BenchError

_ONE_CORE: Final = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
_END: Final = 1.0  # s for a process that says no more to be gone
_START: Final = "import sys; sys.path[:] = {path!r}; from bench.diagnoses.worker import serve; serve({fd}, {work!r})"


@dataclass(frozen=True, slots=True)
class Progress:
    """A job is under way."""

    share: float  # 0 to 1
    phase: str


@dataclass(frozen=True, slots=True)
class Done:
    """A job has ended well."""

    result: Any


@dataclass(frozen=True, slots=True)
class Failed:
    """A job has ended otherwise."""

    why: str  # a sentence
    fault: bool = field(default=False, compare=False)  # of ours, and not the job's
    details: str = field(default="", compare=False)  # of a fault: where it happened


Heard = Progress | Done | Failed


class Worker:
    """A process at the disposal of this one; `close` kills it."""

    def __init__(self, work: str) -> None:
        """`work`: `module:function`, called there with a job and a function that hears share and phase."""
        ours, theirs = socket.socketpair()
        with theirs:
            start = _START.format(path=sys.path, fd=theirs.fileno(), work=work)
            self.process = subprocess.Popen(
                [sys.executable, "-c", start], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                env=os.environ | _ONE_CORE, pass_fds=[theirs.fileno()], start_new_session=True,
            )
        self.connection: Connection = Connection(ours.detach())

    def begin(self, job: object) -> None:
        """Hand over a job; `hear` tells what becomes of it."""
        with contextlib.suppress(OSError):  # it has ended, which is heard
            self.connection.send(job)

    def hear(self) -> Heard:
        """Wait for what the worker says next. After its end, every answer is that it has failed."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            return Failed(f"the process that worked on it ended before it was done ({self._end()})", fault=True)

    def kill(self) -> None:
        """Have the process end, from any thread; `hear` then fails."""
        self.process.kill()

    def close(self) -> None:
        """Kill the process; what it worked on is lost."""
        self.kill()
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.process.wait()
        self.connection.close()

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _end(self) -> str:
        try:
            code = self.process.wait(_END)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        return f"signal {-code}" if code < 0 else f"exit code {code}"


def each(work: str, jobs: Sequence[object], workers: int) -> Generator[tuple[int, Heard]]:
    """Do jobs on so many workers; what is heard of each, by its place, as it comes. Closing it kills the workers."""
    waiting = list(range(len(jobs)))[::-1]
    busy: dict[Connection, tuple[Worker, int]] = {}

    def next_job(worker: Worker) -> None:
        if waiting:
            place = waiting.pop()
            busy[worker.connection] = worker, place
            worker.begin(jobs[place])
        else:
            worker.close()

    try:
        for _ in range(min(workers, len(jobs))):
            next_job(Worker(work))
        while busy:
            for connection in wait(list(busy)):
                assert isinstance(connection, Connection)
                worker, place = busy[connection]
                heard = worker.hear()
                if not isinstance(heard, Progress):
                    del busy[connection]
                    if worker.process.poll() is not None:
                        worker.close()
                        worker = Worker(work) if waiting else worker
                    next_job(worker)
                yield place, heard
    finally:
        for worker, _ in busy.values():
            worker.close()


def serve(fd: int, work: str) -> None:
    """Be a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    module, _, name = work.partition(":")
    with Connection(fd) as connection:

        def say(heard: Heard) -> None:
            try:
                connection.send(heard)
            except OSError:  # nobody is there to hear it
                os._exit(1)

        def tell(share: float, phase: str) -> None:
            say(Progress(share, phase))

        while True:
            try:
                job = connection.recv()
            except EOFError:
                return
            try:
                heard = Done(getattr(importlib.import_module(module), name)(job, tell))
            except BenchError as error:
                heard = Failed(str(error))
            except Exception as error:  # noqa: BLE001 - a fault of ours ends this job alone
                why = f"the bench failed on it: {type(error).__name__}: {error}; please report this"
                heard = Failed(why, fault=True, details=traceback.format_exc())
            say(heard)


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)
