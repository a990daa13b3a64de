"""Processes that work for this one: what is heard of them, and that none is left, however it ends."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench.diagnoses.worker import Done, Failed, Heard, Progress, Worker, each
from tests.support.served_drive import until

pytestmark = pytest.mark.live

WORK = "tests.bench.diagnoses.working:work"
LINGER = """
import sys
from bench.diagnoses.worker import Worker
worker = Worker("tests.bench.diagnoses.working:work")
worker.begin("endless")
print(worker.process.pid, worker.hear().phase, flush=True)
sys.stdin.read()
"""


def alive(pid: int) -> bool:
    """Whether there is such a process."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    return False


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text(encoding="ascii").split()]


def endings(heard: list[tuple[int, Heard]]) -> dict[int, Heard]:
    return {place: one for place, one in heard if not isinstance(one, Progress)}


def test_jobs_are_done_by_as_many_processes_and_each_tells_how_far_it_is() -> None:
    heard = list(each(WORK, ["a", "b", "c", "d"], 2))
    ended = endings(heard)
    results = [one.result for _, one in sorted(ended.items()) if isinstance(one, Done)]
    assert [result[0] for result in results] == ["A", "B", "C", "D"]
    assert {result[2] for result in results} == {"1"}
    pids = {result[1] for result in results}
    assert 1 <= len(pids) <= 2
    assert os.getpid() not in pids
    assert [one for place, one in heard if place == 3] == [Progress(0.5, "at d"), ended[3]]
    assert not any(map(alive, pids))


def test_a_job_that_fails_or_takes_its_process_with_it_leaves_the_others_alone() -> None:
    ended = endings(list(each(WORK, ["refused", "dies", "a", "broken", "dies", "b"], 1)))
    assert ended[0] == Failed("expected another job")
    assert ended[1] == ended[4] == Failed("the process that worked on it ended before it was done (signal 11)")
    assert ended[3] == Failed("the bench failed on it: ZeroDivisionError: division by zero; please report this")
    for place in (2, 5):
        assert isinstance(ended[place], Done)


def test_work_that_is_not_there_is_a_failure_of_the_job() -> None:
    ((_, heard),) = each("tests.no_such_module:work", ["a"], 1)
    assert heard == Failed(
        "the bench failed on it: ModuleNotFoundError: No module named 'tests.no_such_module'; please report this"
    )


def test_what_is_under_way_is_killed_where_nobody_wants_it_any_more() -> None:
    with contextlib.closing(each(WORK, ["a", "endless", "endless"], 2)) as heard:
        first = next(one for _, one in heard if isinstance(one, Done))
        assert alive(first.result[1])
    assert not alive(first.result[1])


def test_a_worker_ends_with_a_process_that_is_killed() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", LINGER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline().split()[0])
        assert alive(pid)
        parent.kill()
        until(lambda: not alive(pid), "the end of the worker")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_worker_does_not_hear_ctrl_c_but_an_order_to_end(number: signal.Signals) -> None:
    with Worker(WORK) as worker:
        worker.begin("a")
        assert isinstance(worker.hear(), Progress)
        assert isinstance(worker.hear(), Done)
        worker.process.send_signal(number)
        worker.begin("b")
        heard = worker.hear()
        assert heard == (Progress(0.5, "at b") if number == signal.SIGINT else Failed(
            "the process that worked on it ended before it was done (signal 15)"
        ))
