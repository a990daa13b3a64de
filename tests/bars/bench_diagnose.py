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
from tests.proof.results import record
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


def of_long(folder: Path) -> tuple[float, float, str]:
    """Time (s) and memory (GB) of the command for a long recording, and its verdict."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pool.submit(conceal, "two", LONG, folder / "long").result()
    recording = folder / "long" / "out" / "0001.parquet"
    arguments = "diagnose", recording, "--nominal", recording.with_suffix(".toml")
    begun = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "bench.cli.main", *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    said = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    taken, verdict = time.perf_counter() - begun, said.splitlines()[0].rpartition(": ")[2]
    print(f"{LONG:g} s: {verdict}, {taken:.1f} s")
    assert os.waitstatus_to_exitcode(status) in (0, 1, 3)
    return taken, used.ru_maxrss / 1e6, verdict


def main() -> int:
    """Print the table."""
    missed, took = 0, dict[tuple[str, float], float]()
    with tempfile.TemporaryDirectory() as name:
        for kind in ("two", "dead_time"):  # start-up: another process compiles kernels, this one loads them
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                pool.submit(seconds, kind, 1.0, Path(name) / "compiling").result()
            seconds(kind, 1.0, Path(name))
        for (kind, length), bar in BARS.items():
            took[kind, length] = taken = seconds(kind, length, Path(name))
            missed += taken > bar
            print(f"    {taken:.1f} s on one core (bar {bar:g} s){' MISSED' if taken > bar else ''}")
        of_short = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        ten_minutes, of_minutes, verdict = of_long(Path(name))
    for used, bar in ((of_short, MEMORY), (of_minutes, MEMORY_OF_LONG)):
        missed += used > bar
        print(f"memory at most {used:.2f} GB (bar {bar:g} GB){' MISSED' if used > bar else ''}")
    short, minute, slow = (took[which] for which in (("two", 6.0), ("two", 60.0), ("dead_time", 6.0)))
    quick = short <= BARS["two", 6.0] and minute <= BARS["two", 60.0]
    record("diagnoses.short", f"{short:.1f} s; {minute:.1f} s; {of_short:.2f} GB", quick and of_short <= MEMORY)
    record("diagnoses.dead_time", f"{slow:.1f} s", slow <= BARS["dead_time", 6.0])
    figure = f"{ten_minutes:.0f} s, {of_minutes:.2f} GB; {verdict}"
    record("diagnoses.ten_minutes", figure, of_minutes <= MEMORY_OF_LONG)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
