"""Sizes near the limit.

`python -m tests.proof.parts.near_suite --seed S --count N --length L --out DIR --answers DIR2 [--chain]`

One effect in each, as `python -m emulator conceal --class one` draws it, but of a size from half to thirty times what
the oracle could see in that recording. An answer tells how many times in `over_limit`. With a measuring chain drawn for
each recording, which keeps its own sizes, that effect may be one of a chain, too.
"""

import json
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

from emulator.bounds import ScenarioError
from emulator.conceal.chance import Chance
from emulator.conceal.files import answer_of, write
from emulator.conceal.populations import merged
from emulator.conceal.recording import Choice, Concealed, TripError, drawn, recorded
from emulator.drive.virtual_drive import Column
from emulator.scenario.effects import effects_from_table
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import check
from tests.proof.parts.suite_parser import suite_parser
from tests.score.oracle import BY_SHARE, Oracle
from tests.score.truth import EFFECT, UNCHAINED

LOW, HIGH = 0.5, 30.0  # limits
_TRIES: Final = 20  # draws of a recording that the drive can do
_ONE_SIZE: Final = ("voltage_early", "voltage_late", *BY_SHARE)  # or none that is small


def make(
    seed: int, wanted: int, length: float, out: Path, answers: Path, jobs: int = 1, *, chain: bool = False
) -> None:  # fmt: skip
    """Write recordings and machines into one folder, answers into another."""
    for folder in (out, answers):
        folder.mkdir(parents=True)
    choice = near_population(seed, length, chain=chain)
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for done in [pool.submit(_one, choice, k, out, answers) for k in range(1, wanted + 1)]:
            done.result()


def near_population(seed: int, length: float, *, chain: bool = False) -> Choice:
    """What recordings of so many seconds are drawn from."""
    kinds = tuple(name for name in (EFFECT if chain else UNCHAINED) if name not in _ONE_SIZE)
    return Choice(seed, kinds, (0.0, 1.0), tuple(MOTORS), length, chain)


def _one(choice: Choice, k: int, out: Path, answers: Path) -> None:
    name = f"{k:04}"
    there, columns, ratio = drawn_near(choice, k)
    write(there, columns, choice, name, out, answers)
    answer = answer_of(there, choice, name) | {"over_limit": {there.kind: ratio}}
    (answers / f"{name}.json").write_text(json.dumps(answer, indent=2) + "\n", encoding="utf-8")


def drawn_near(choice: Choice, number: int) -> tuple[Concealed, Mapping[str, Column], float]:
    """A recording that the drive can do, its columns, and its size over the limit. Raises ScenarioError."""
    for attempt in range(_TRIES):
        try:
            return near(choice, number + 10_000 * attempt)
        except (ScenarioError, TripError):  # a size that this drive cannot have
            continue
    raise ScenarioError(f"recording {number}: none of {_TRIES} draws is one that the drive can do")


def near(choice: Choice, number: int) -> tuple[Concealed, Mapping[str, Column], float]:
    """A recording, its columns, and its size over the limit. Raises ScenarioError, TripError."""
    concealed, _ = drawn(choice, number)
    name = concealed.kind
    answer: dict[str, Any] = json.loads(json.dumps(answer_of(concealed, choice, f"{number}")))
    oracle = Oracle(answer)
    ratio = Chance(choice.seed, number, "size over limit").log_uniform(LOW, HIGH)
    size = ratio * oracle.limit(name, concealed.sizes[name])
    parts = merged([concealed.drawn.surroundings, oracle.chain(name), oracle.sections(name, size)])
    scenario = replace(concealed.scenario, effects=effects_from_table(parts, f"recording {number}: effects.", Path()))
    check(scenario)
    there = replace(concealed, scenario=scenario, sizes={**concealed.sizes, name: size})
    return there, recorded(scenario, there.periods), ratio


def main() -> int:
    """Make a suite."""
    parser = suite_parser("near_suite", __doc__)
    parser.add_argument("--length", type=float, required=True, help="s")
    parser.add_argument("--chain", action="store_true", help="a measuring chain is drawn for each")
    given = parser.parse_args()
    make(given.seed, given.count, given.length, given.out, given.answers, given.jobs, chain=given.chain)
    return 0


if __name__ == "__main__":
    sys.exit(main())
