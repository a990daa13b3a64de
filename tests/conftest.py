"""Real parts for tests: a running bench over an emulated drive, in processes of their own."""

import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Protocol

import httpx
import pytest
from hypothesis import HealthCheck, settings

from tests.proof.results import record
from tests.support.forked import Forked
from tests.support.real_data import REAL_DATA

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")  # tests run side by side, a core each
# A shell starts what it runs in the background with Ctrl-C ignored, nohup with a closed terminal; children inherit that
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
os.environ.pop("PMSM_BENCH_PORT", None)  # it would beat the ports that tests choose
_DATA = tempfile.TemporaryDirectory(prefix="pmsm-bench-")  # captures of tests are none of the user's
os.environ["XDG_DATA_HOME"] = _DATA.name
# How fast examples come is the machine's matter
settings.register_profile("bench", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("bench")

READY = 240.0  # s, the first start compiles
JSON = {"Content-Type": "application/json"}  # of every PUT and POST
COMMAND = [sys.executable, "-m", "bench.cli.main"]


@dataclass(frozen=True)
class RunningBench:
    """A service over one emulated drive called `emulated`."""

    url: str  # of the service
    bus: str  # of the drive
    process: "subprocess.Popen[str]"


_handed_out: set[int] = set()


def free_port() -> int:
    """A TCP port that nobody listens on, none twice, below those that the system hands to clients."""
    while True:
        port = random.randrange(20_000, 32_000)
        try:
            with socket.create_server(("127.0.0.1", port)):
                pass
        except OSError:
            continue
        if port not in _handed_out:
            _handed_out.add(port)
            return port


def bus_url(port: int) -> str:
    """Where an emulated drive can be served on a port."""
    return f"canopen://socketcand/127.0.0.1:{port}/can0/5"


def wait_for_answer(url: str, process: "subprocess.Popen[str]") -> None:
    """Return when something answers at a URL; fail when the process ends first or time is up."""
    deadline = time.monotonic() + READY
    while time.monotonic() < deadline:
        assert process.poll() is None, process.communicate()
        try:
            httpx.get(url)
        except httpx.TransportError:
            time.sleep(0.05)
        else:
            return
    raise AssertionError(f"nothing answered at {url} within {READY} s")


@contextmanager
def command(*arguments: str) -> Generator["subprocess.Popen[str]"]:
    """`pmsm-bench` with arguments as a process, ended by Ctrl-C."""
    process = Forked("bench.cli.main", *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=15.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise


@contextmanager
def bench_up(*options: str) -> Generator[RunningBench]:
    """`pmsm-bench up` on free ports."""
    port, bus = free_port(), bus_url(free_port())
    with command("up", "--port", str(port), "--at", bus, *options) as process:
        url = f"http://127.0.0.1:{port}"
        wait_for_answer(f"{url}/api/health", process)
        yield RunningBench(url, bus, process)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that wait and files that compute take turns, so that processes side by side seldom all do one of these."""
    waiting, computing = dict[Path, list[pytest.Item]](), dict[Path, list[pytest.Item]]()
    for item in items:
        (waiting if item.get_closest_marker("live") else computing).setdefault(item.path, []).append(item)
    pairs = zip_longest(waiting.values(), computing.values(), fillvalue=list[pytest.Item]())
    items[:] = [item for pair in pairs for file in pair for item in file]


@pytest.fixture(scope="module")
def running_bench() -> Iterator[RunningBench]:
    """One bench for a module's tests that only look, or put back what they change."""
    with bench_up() as bench:
        yield bench


class Figures(Protocol):
    """Takes figures for a row of RESULTS.md; in `form`, `{name}` is the most of all told, `{least_name}` the least."""

    def __call__(self, key: str, form: str, /, **values: float) -> None: ...


@pytest.fixture(scope="session")
def figure() -> Iterator[Figures]:
    """Figures of tests, recorded once all have told theirs, where RECORD is set; by one process alone."""
    told: dict[tuple[str, str], dict[str, list[float]]] = {}

    def take(key: str, form: str, /, **values: float) -> None:
        row = told.setdefault((key, form), {})
        for name, value in values.items():
            row.setdefault(name, []).append(value)

    yield take
    if "PYTEST_XDIST_WORKER" not in os.environ:
        for (key, form), row in told.items():
            least = {f"least_{name}": min(values) for name, values in row.items()}
            record(key, form.format(**least, **{name: max(values) for name, values in row.items()}))


@pytest.fixture
def shared_recordings() -> Path:
    """The folder of real recordings; skips where it is absent."""
    if not REAL_DATA.is_dir():
        pytest.skip(f"real recordings are not at {REAL_DATA}")
    return REAL_DATA


@pytest.fixture(autouse=True)
def no_leaks() -> Iterator[None]:
    """A test that leaves a thread running fails."""
    before = set(threading.enumerate())
    yield
    deadline = time.monotonic() + 2.0
    while left := [t for t in threading.enumerate() if t not in before and t.is_alive()]:
        assert time.monotonic() < deadline, f"threads left running: {[t.name for t in left]}"
        time.sleep(0.01)
