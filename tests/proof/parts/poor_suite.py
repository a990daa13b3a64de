"""`python -m tests.proof.parts.poor_suite --seed S --count N --out DIR --answers DIR2 [--chain]`: recordings that tell
little.

As `python -m emulator conceal` makes them, but at one speed and one level of current, or at none, see
`tests.score.poor`. Classes, runs and motors go round, so that a part of the suite has a bit of everything.
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
from emulator.conceal.files import answer_of, write
from emulator.conceal.populations import STRANGERS
from emulator.conceal.recording import Choice, Concealed, TripError, drawn, recorded
from emulator.drive.virtual_drive import Column
from emulator.scenario.motors import MOTORS
from tests.proof.parts.suite_parser import suite_parser
from tests.proof.proof import Table
from tests.score.diagnosed import Said
from tests.score.poor import RUNS, poor, told
from tests.score.truth import EFFECT, UNCHAINED

LENGTH: Final = 2.0  # s
_KINDS: Final = ("none", *UNCHAINED, *STRANGERS)
_WINDOW: Final = (0.3, 1.0)  # of each class's range
_STRIDE: Final = 5  # motors, from one recording to the next
_TRIES: Final = 20  # draws of a recording that the drive can do


def make(seed: int, count: int, out: Path, answers: Path, jobs: int = 1, *, chain: bool = False) -> None:
    """Write recordings and machines into one folder, answers into another."""
    for folder in (out, answers):
        folder.mkdir(parents=True)
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for done in [pool.submit(_one, seed, k, out, answers, chain) for k in range(1, count + 1)]:
            done.result()


def _one(seed: int, number: int, out: Path, answers: Path, chain: bool) -> None:
    name = f"{number:04}"
    choice, run = case_of(seed, number, chain=chain)
    there, columns = drawn_poor(choice, number, run)
    write(there, columns, choice, name, out, answers)
    answer = answer_of(there, choice, name) | {"run": run}
    (answers / f"{name}.json").write_text(json.dumps(answer, indent=2) + "\n", encoding="utf-8")


def case_of(seed: int, number: int, *, chain: bool = False) -> tuple[Choice, str]:
    """What a recording is drawn from, and its run; with a measuring chain drawn for each."""
    k, motors = number - 1, tuple(MOTORS)
    kind, run = _KINDS[k % len(_KINDS)], RUNS[(k + k // len(_KINDS)) % len(RUNS)]
    return Choice(seed, (kind,), _WINDOW, (motors[_STRIDE * k % len(motors)],), LENGTH, chain), run


def drawn_poor(choice: Choice, number: int, run: str) -> tuple[Concealed, Mapping[str, Column]]:
    """A recording that the drive can do, and its columns. Raises ScenarioError."""
    rated = MOTORS[choice.motors[0]]
    for attempt in range(_TRIES):
        concealed, _ = drawn(choice, number + 10_000 * attempt)
        excitation, turning = poor(run, rated.machine.i_rated, rated.speed_rpm, choice.length)
        there = replace(concealed, scenario=replace(concealed.scenario, excitation=excitation, run=turning))
        try:
            return there, recorded(there.scenario, there.periods)
        except TripError:
            continue
    raise ScenarioError(f"recording {number}: none of {_TRIES} draws of {choice.kinds[0]} is one that the drive can do")


def table(answers: list[dict[str, Any]], said: Mapping[str, Said]) -> Table:
    """What was said, by run."""
    words = {answer["recording"]: _word(answer, said) for answer in answers}
    heads = list(dict.fromkeys(words.values()))
    rows: list[tuple[str, ...]] = []
    for run in RUNS:
        heard = [words[answer["recording"]] for answer in answers if answer["run"] == run]
        rows.append((run, str(len(heard)), *(str(heard.count(head)) for head in heads)))
    return Table("Poor excitation: what was said, by run", ("run", "recordings", *heads), tuple(rows))


def wrong(answers: list[dict[str, Any]], said: Mapping[str, Said]) -> list[tuple[str, ...]]:
    """Recordings of which something was named that is not there, or that met a defect."""
    return [
        (answer["recording"], f"{' + '.join(answer['classes']) or 'none'} ({answer['motor']}, {answer['run']})",
         heard.diagnosis.sentence if heard.diagnosis else heard.error.strip().splitlines()[-1])
        for answer in answers
        for heard in (said[answer["recording"]],)
        if _word(answer, said) in ("WRONG", "defect")
    ]  # fmt: skip


def _word(answer: Mapping[str, Any], said: Mapping[str, Said]) -> str:
    truth = frozenset(EFFECT.get(name, name) for name in answer["classes"])
    return told(said[answer["recording"]], truth).replace("_", " ")


def main() -> int:
    """Make a suite."""
    parser = suite_parser("poor_suite", __doc__)
    parser.add_argument("--chain", action="store_true", help="a measuring chain is drawn for each")
    given = parser.parse_args()
    make(given.seed, given.count, given.out, given.answers, given.jobs, chain=given.chain)
    return 0


if __name__ == "__main__":
    sys.exit(main())
