"""Inertia, friction and load torque of drawn drives: `python -m tests.bars.estimator.bench_mechanics`.

Free shafts of any motor of the catalogue, which swing their speed; then the same held or swung by a dynamometer, at one
speed, and with their load behind a shaft that gives way. The magnet flux is given with an error of a standard error
that is none or 0.1 %. Seeds of the figures are not those that the estimator was made with (`--develop`). Ends with 1
where a bar is missed.
"""

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from emulator.scenario.scenarios import Scenario
from estimator.interval import Z_95
from estimator.mechanics.mechanics import Mechanics, Told, mechanics
from estimator.online.estimate import Status
from tests.estimator.mechanics import shafts

SEED: Final = 80_000
DEVELOPED: Final = 40_000
CLOSE: Final = 0.02  # of J
COVER: Final = (0.90, 0.99)
SECONDS: Final = 8.0  # of rows of ten control periods
PSI_F: Final = 1e-3  # standard error of psi_f, a share, of every other drive
LONGEST: Final = 0.2  # s, that these may take


@dataclass(slots=True)
class Count:
    """What was said of one kind of shaft."""

    status: Counter[str] = field(default_factory=Counter[str])
    within: dict[str, list[bool]] = field(default_factory=dict[str, list[bool]])  # an interval, by parameter, where ok
    J: list[float] = field(default_factory=list[float])  # its errors, shares, where ok
    wrong: list[str] = field(default_factory=list[str])  # J ok, farther off than 2 % and its interval
    took: list[float] = field(default_factory=list[float])  # s


def held(scenario: Scenario, r: np.random.Generator) -> Scenario:
    """By a dynamometer, under steps of current or none."""
    rpm = float(r.choice([0.0, 0.05, 0.2])) * shafts.rated_rpm(scenario)
    return shafts.on_dynamometer(scenario, rpm=rpm, i_q_step=float(r.choice([0.0, 0.5])))


def swung(scenario: Scenario, r: np.random.Generator) -> Scenario:
    """By a dynamometer, which takes no notice of the motor's torque."""
    rpm = 0.2 * shafts.rated_rpm(scenario)
    return shafts.on_dynamometer(scenario, rpm=rpm, swing_rpm=0.5 * rpm, i_q_step=float(r.choice([0.0, 0.5])))


def steady(scenario: Scenario, r: np.random.Generator) -> Scenario:
    """At one speed."""
    return shafts.at_one_speed(scenario, float(r.uniform(0.1, 0.3)) * shafts.rated_rpm(scenario) * math.pi / 30.0)


def soft(scenario: Scenario, r: np.random.Generator) -> Scenario:
    """With its load behind a shaft of a resonance of 10 to 200 Hz."""
    return shafts.compliant(scenario, scenario.motor.J * 10.0 ** r.uniform(-0.5, 0.7), 10.0 ** r.uniform(1.0, 2.3))


KINDS: Final[dict[str, Callable[[Scenario, np.random.Generator], Scenario]]] = {
    "free": lambda scenario, _r: scenario, "held": held, "swung": swung, "at one speed": steady, "compliant": soft,
}


def said_of(scenario: Scenario, r: np.random.Generator) -> tuple[Mechanics, float]:
    """What is said, and how long (s) that took."""
    samples, machine = shafts.rows_of(scenario, SECONDS)
    std = machine.psi_f * float(r.choice([0.0, PSI_F]))
    machine = replace(machine, psi_f=machine.psi_f + std * float(r.normal()))
    begun = time.perf_counter()
    return mechanics(samples, machine, {"psi_f": std}), time.perf_counter() - begun


def counted(kind: str, first: int, count: int) -> Count:
    """Drives of a kind."""
    found = Count()
    for seed in range(first, first + count):
        r = np.random.default_rng((seed, 1))
        scenario = KINDS[kind](shafts.drawn(seed), r)
        said, took = said_of(scenario, r)
        found.status[said.status.value] += 1
        found.took.append(took)
        truth = shafts.truth_of(scenario)
        for e in shafts.told(said):
            if e.status is not Status.OK or e.value is None or e.std is None:
                continue
            inside = abs(e.value - truth[e.name]) < Z_95 * e.std
            found.within.setdefault(e.name[:5], []).append(inside)
            if e.name == "J":
                off = e.value / truth["J"] - 1.0
                found.J.append(off)
                if not inside and abs(off) > CLOSE:
                    found.wrong.append(f"{seed}: {off:+.1%}")
    return found


def main() -> int:
    """Print the figures. 0 when every bar is met."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--develop", action="store_true", help="drives that may be looked at")
    parser.add_argument("--count", type=int, default=200, help="free shafts; of the other kinds a half")
    given = parser.parse_args()
    seed, good = DEVELOPED if given.develop else SEED, list[bool]()

    def bar(text: str, met: bool) -> None:
        good.append(met)
        print(f"  {'met' if met else 'MISSED':6} {text}")

    for k, kind in enumerate(KINDS):
        found = counted(kind, seed + 1000 * k, given.count if kind == "free" else given.count // 2)
        print(f"{kind}: {', '.join(f'{n} {status}' for status, n in found.status.most_common())}")
        worst = max(map(abs, found.J), default=0.0)
        if kind != "free":
            figure = f"{len(found.wrong)} of {len(found.J)} ok; the largest error {worst:.2%}"
            bar(f"J ok and wrong: {figure} {' '.join(found.wrong)}", not found.wrong)
            continue
        every = [inside for name in found.within for inside in found.within[name]]
        for name, inside in found.within.items():
            print(f"         {name:5} within its interval: {np.mean(inside):.1%} of {len(inside)}")
        share = float(np.mean(every))
        bar(f"J within 2 % or its interval: {len(found.J) - len(found.wrong)} of {len(found.J)}; the largest error "
            f"{worst:.2%}, the median {np.median(np.abs(found.J)):.3%}", not found.wrong)  # fmt: skip
        bar(f"95 % intervals cover: {share:.1%} of {len(every)}", COVER[0] <= share <= COVER[1])
        told = found.status[Told.OK.value] / given.count
        bar(f"told as ok: {told:.1%}", told >= 0.95)
        took = float(np.median(found.took))
        bar(f"{SECONDS:g} s of rows of 1 ms or less: {1e3 * took:.0f} ms", took < LONGEST)
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
