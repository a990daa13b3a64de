"""Poor excitation: what is named of recordings at one speed and one level of current, of all motors and effects.

`python -m tests.score.poor [--jobs N] [--length S] [--seed SEED] [--run RUN ...] [--motor NAME ...]`

Nothing is to be named that is not there. What is there need not be named: it may be ambiguous, or too little told.
"""

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Final

from emulator.conceal.files import write
from emulator.conceal.populations import STRANGERS
from emulator.conceal.recording import Choice, TripError, drawn, recorded
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run
from tests.proof.results import record
from tests.score.diagnosed import Said, diagnosed
from tests.score.score import FUNCTION
from tests.score.truth import EFFECT, UNCHAINED

RUNS: Final = ("idle", "level", "both", "standstill", "ramp", "steps", "small steps")
_SPEED, _STEP, _SMALL, _CURRENT = 0.4, 0.02, 0.005, 0.4  # of rated speed and current
_STEP_TIME: Final = 5e-3  # s
SHOWN: Final = ("servo_4nm", "mini_cheetah")  # motors whose figures stand in RESULTS.md


def poor(run: str, i_rated: float, speed_rpm: float, length: float) -> tuple[Excitation, Run]:
    """Commands of a run that tells little, and its speed."""
    i, steps = _CURRENT * i_rated, {"steps": _STEP, "small steps": _SMALL}
    if run in steps:
        step = steps[run] * i_rated
        return Excitation(0.0, i, step, step, _STEP_TIME), Run(speed_rpm=_SPEED * speed_rpm)
    excitation = Excitation(-0.5 * i if run == "both" else 0.0, 0.0 if run == "idle" else i, kind="none")
    if run == "ramp":
        return excitation, Run(speed_rpm=0.1 * speed_rpm, rise_rpm=_SPEED * speed_rpm, ramp_time=length)
    return excitation, Run(speed_rpm=0.0 if run == "standstill" else _SPEED * speed_rpm)


def made(
    folder: Path, motor: str, kind: str, length: float, seed: int, runs: tuple[str, ...]
) -> Iterator[tuple[str, str, frozenset[str]]]:
    """Write a motor's recordings with one class concealed: their names, runs and effects."""
    numbers = count(1)
    while True:
        concealed, _ = drawn(Choice(seed, (kind,), (0.3, 1.0), (motor,), length), next(numbers))
        truth = frozenset(EFFECT.get(name, name) for name in concealed.classes)
        done: list[tuple[str, str, frozenset[str]]] = []
        for run in runs:
            rated = MOTORS[motor]
            excitation, turning = poor(run, rated.machine.i_rated, rated.speed_rpm, length)
            there = replace(concealed, scenario=replace(concealed.scenario, excitation=excitation, run=turning))
            try:
                columns = recorded(there.scenario, there.periods)
            except TripError:
                break
            name = f"{motor} {kind} {run}"
            write(there, columns, Choice(seed, (kind,), (0.3, 1.0), (motor,), length), name, folder, folder)
            done.append((name, run, truth))
        if len(done) == len(runs):
            yield from done
            return


def told(said: Said, truth: frozenset[str]) -> str:
    """What was said, in a word, beside what there is."""
    if said.diagnosis is None:
        return "defect" if "Traceback" in said.error else "refused"
    names = {finding.effect for finding in said.diagnosis.findings}
    return "WRONG" if names - truth else "right" if names else said.diagnosis.verdict.value


def main() -> int:
    """Make, diagnose and count; 1 where a wrong name is said."""
    parser = argparse.ArgumentParser(prog="python -m tests.score.poor", description=__doc__)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--length", type=float, default=2.0, help="s")
    parser.add_argument("--seed", type=int, default=300)
    parser.add_argument("--run", nargs="+", default=RUNS, choices=RUNS)
    parser.add_argument("--motor", nargs="+", default=tuple(MOTORS), choices=tuple(MOTORS))
    kinds = ("none", *UNCHAINED, *STRANGERS)
    parser.add_argument("--class", dest="kinds", nargs="+", default=kinds, choices=kinds)
    given = parser.parse_args()
    counts: dict[str, Counter[str]] = {run: Counter() for run in given.run}
    by_motor: dict[str, list[bool]] = {motor: [] for motor in given.motor}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        truths = {
            name: (run, truth)
            for motor in given.motor
            for kind in given.kinds
            for name, run, truth in made(folder, motor, kind, given.length, given.seed, tuple(given.run))
        }
        for (_, name), said in diagnosed([(folder, name) for name in truths], FUNCTION, given.jobs):
            run, truth = truths[name]
            word = told(said, truth)
            counts[run][word] += 1
            by_motor[name.split()[0]].append(word in ("WRONG", "defect"))
            if word in ("WRONG", "defect"):
                found = said.diagnosis.sentence if said.diagnosis else said.error
                print(f"{word}: {name}: {found}", flush=True)
    words = list(dict.fromkeys(word for each in counts.values() for word in sorted(each)))
    print(f"{'run':14}" + "".join(f"{word:>24}" for word in words))
    for run, each in counts.items():
        print(f"{run:14}" + "".join(f"{each[word]:24}" for word in words))
    wrong = sum(each["WRONG"] + each["defect"] for each in counts.values())
    print(f"a wrong name: {wrong} of {sum(each.total() for each in counts.values())} (bar: none)")
    if tuple(given.motor) == SHOWN:
        figure = " and in ".join(f"{sum(each)} of {len(each)}" for each in by_motor.values())
        record("diagnoses.poor", f"in {figure}", not wrong)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
