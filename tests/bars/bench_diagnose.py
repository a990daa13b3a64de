"""Speed of the diagnosis: `python -m tests.bars.bench_diagnose`, seconds on one core for 6 s and 60 s at 10 kHz.

Two concealed effects each, and a dead time, which takes longest; after start-up, with all pictures, and the most
memory the process had. Then the command's memory for ten minutes, of which it takes stretches. Ends with 1 where a bar
is missed.
"""

import os

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from emulator.conceal.recording import Choice
from emulator.conceal.suite import Suite, make
from estimator.diagnosis.diagnose import diagnose
from tests.score.diagnosed import loaded

SEED, MOTOR = 1950, "servo_4nm"
BARS = {("two", 6.0): 3.0, ("dead_time", 6.0): 3.0, ("two", 60.0): 10.0}  # what is concealed, s: s of computing
MEMORY = 1.0  # GB
LONG, MEMORY_OF_LONG = 600.0, 1.5  # s, GB


def conceal(kind: str, length: float, out: Path) -> None:
    """Make a recording of so many seconds."""
    choice = Choice(SEED, (kind,), (0.5, 1.0), (MOTOR,), length)
    make(Suite(choice, 1, out / "out", out / "answers", 1), lambda _count: None)


def seconds(kind: str, length: float, folder: Path) -> float:
    """To diagnose a recording of so many seconds, which another process makes first."""
    out = folder / f"{kind} {length:g}"
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pool.submit(conceal, kind, length, out).result()
    runs, nominal = loaded(out / "out", "0001")
    begun = time.perf_counter()
    said = diagnose(runs, nominal)
    taken = time.perf_counter() - begun
    print(f"{length:g} s: {said.verdict}, {', '.join(finding.effect for finding in said.findings)}")
    return taken


def of_long(folder: Path) -> float:
    """Memory of the command for a long recording, GB."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pool.submit(conceal, "two", LONG, folder / "long").result()
    recording = folder / "long" / "out" / "0001.parquet"
    arguments = "diagnose", recording, "--nominal", recording.with_suffix(".toml")
    begun = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "bench.cli.main", *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    said = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    print(f"{LONG:g} s: {said.splitlines()[0].rpartition(': ')[2]}, {time.perf_counter() - begun:.1f} s")
    assert os.waitstatus_to_exitcode(status) in (0, 1, 3)
    return used.ru_maxrss / 1e6


def main() -> int:
    """Print the table."""
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        for kind in ("two", "dead_time"):  # start-up: another process compiles kernels, this one loads them
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                pool.submit(seconds, kind, 1.0, Path(name) / "compiling").result()
            seconds(kind, 1.0, Path(name))
        for (kind, length), bar in BARS.items():
            taken = seconds(kind, length, Path(name))
            missed += taken > bar
            print(f"    {taken:.1f} s on one core (bar {bar:g} s){' MISSED' if taken > bar else ''}")
        of_short, of_minutes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, of_long(Path(name))
    for used, bar in ((of_short, MEMORY), (of_minutes, MEMORY_OF_LONG)):
        missed += used > bar
        print(f"memory at most {used:.2f} GB (bar {bar:g} GB){' MISSED' if used > bar else ''}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
