"""The population of the pooled score: what makes each recording anew, number for number, and its hash.

`python -m tests.score.pooled.population SEED...` draws it and writes `population.json.xz`: of each seed 400 recordings
of 6 s of all kinds, 100 with one effect near the oracle's limit, and 78 of poor excitation, as the proof draws them. A
recording is kept as its whole scenario: it stays the same whatever is added to what is drawn from.
"""

import argparse
import hashlib
import json
import lzma
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np

from emulator.conceal.files import answer_of, nominal_text
from emulator.conceal.populations import KINDS
from emulator.conceal.recording import Choice, Concealed, drawn
from emulator.drive.virtual_drive import Column
from emulator.scenario.motors import MOTORS
from tests.proof.parts import near_suite, poor_suite

KEPT: Final = Path(__file__).with_name("population.json.xz")
COUNTS: Final = {"rich": 400, "near": 100, "poor": 78}
_LENGTH: Final = 6.0  # s, of recordings but the poor


@dataclass(frozen=True, slots=True)
class Kept:
    """One recording: how to make it, what it conceals, which one it is."""

    name: str  # seed/suite/number
    answer: Mapping[str, Any]  # recording, kind, classes, motor, periods, scenario, and what its suite adds
    nominal: str  # the machine file of its user
    digest: str  # of columns and machine file


def digest_of(columns: Mapping[str, Column], nominal: str) -> str:
    """A hash of all columns, number for number, and of the machine file."""
    found = hashlib.sha256(nominal.encode())
    for name, column in columns.items():
        found.update(name.encode() + b"\0" + np.ascontiguousarray(column, "<f8").tobytes())
    return found.hexdigest()[:16]


def kept_population(path: Path = KEPT) -> list[Kept]:
    """All recordings."""
    with lzma.open(path, "rt", encoding="utf-8") as file:
        return [Kept(**one) for one in json.load(file)]


def draw(seed: int, suite: str, number: int) -> Kept:
    """A recording as the proof draws it. Raises ScenarioError."""
    concealed, columns, choice, added = _DRAWN[suite](seed, number)
    whole, nominal = answer_of(concealed, choice, f"{number:04}"), nominal_text(concealed)
    answer = {key: whole[key] for key in ("recording", "kind", "classes", "motor", "periods", "scenario")}
    return Kept(f"{seed}/{suite}/{number:04}", answer | dict(added), nominal, digest_of(columns, nominal))


Drawn = tuple[Concealed, Mapping[str, Column], Choice, Mapping[str, Any]]


def _rich(seed: int, number: int) -> Drawn:
    choice = Choice(seed, tuple(KINDS), (0.0, 1.0), tuple(MOTORS), _LENGTH)
    return *drawn(choice, number), choice, {}


def _near(seed: int, number: int) -> Drawn:
    choice = near_suite.near_population(seed, _LENGTH)
    there, columns, ratio = near_suite.drawn_near(choice, number)
    return there, columns, choice, {"over_limit": {there.classes[0]: ratio}}


def _poor(seed: int, number: int) -> Drawn:
    choice, run = poor_suite.case_of(seed, number)
    return *poor_suite.drawn_poor(choice, number, run), choice, {"run": run}


_DRAWN: Final = {"rich": _rich, "near": _near, "poor": _poor}


def main() -> int:
    """Draw populations and keep them."""
    parser = argparse.ArgumentParser("python -m tests.score.pooled.population", description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+", metavar="SEED", help="populations that were looked at")
    parser.add_argument("--out", type=Path, default=KEPT, metavar="FILE")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    given = parser.parse_args()
    cases = [(seed, suite, n) for seed in given.seeds for suite, count in COUNTS.items() for n in range(1, count + 1)]
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
        kept: list[Kept] = []
        for one in pool.map(_drawn, cases):
            kept.append(one)
            if len(kept) % 50 == 0:
                print(f"drawn {len(kept)} of {len(cases)}", file=sys.stderr, flush=True)
    write(kept, given.out)
    return 0


def _drawn(case: tuple[int, str, int]) -> Kept:
    return draw(*case)


def write(kept: Sequence[Kept], path: Path) -> None:
    """Keep a population."""
    text = json.dumps([{key: getattr(one, key) for key in ("name", "answer", "nominal", "digest")} for one in kept])
    path.write_bytes(lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    sys.exit(main())
