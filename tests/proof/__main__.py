"""`python -m tests.proof [--quick] [--seed N] [--only NAME ...] [--out FOLDER] [--jobs N]`: the proof, part by part.

Bars go to the screen, all of it to proof.html and proof.json in build/proof. Status 0 whether bars are held or missed,
1 where a part could not run. A seed gives the same JSON again but for the times in it. See PROTOCOL.md for which seed.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import bench
import emulator
import estimator
from emulator.kernel import source_hash
from tests.proof.outcome import Outcome, as_json, missed, run, text
from tests.proof.page import page
from tests.proof.proof import Settings
from tests.proof.results import PARTS, record_proof

SEED: Final = 2022  # of the evaluation population
QUICK_SEED: Final = 1001  # of a development population


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the parts one after the other."""
    given = _options(arguments)
    seed = given.seed if given.seed is not None else QUICK_SEED if given.quick else SEED
    settings = Settings(seed, given.quick, given.jobs, given.out)
    given.out.mkdir(parents=True, exist_ok=True)
    outcomes: list[Outcome] = []
    seconds: dict[str, float] = {}
    for name in given.only:
        begun = time.monotonic()
        outcomes.append(run(name, settings))
        seconds[name] = round(time.monotonic() - begun, 1)
        print(f"{text(outcomes[-1])}\n  {seconds[name]:.0f} s\n", flush=True)
        written(outcomes, settings, seconds)  # a proof that is cut short leaves what it has
    total = sum(seconds.values())
    count = sum(bar.held is not None for each in outcomes if each.proof for bar in each.proof.bars)
    failed = sum(each.proof is None for each in outcomes)
    print(
        f"{count} bars judged, {len(missed(outcomes))} missed; {failed} of {len(outcomes)} parts could not run; "
        f"{total / 60.0:.1f} minutes; see {given.out / 'proof.html'}"
    )
    if os.environ.get("RECORD"):
        record_proof(given.out / "proof.json")
    return 1 if failed else 0


def written(outcomes: Sequence[Outcome], settings: Settings, seconds: dict[str, float]) -> None:
    """Page and JSON."""
    sort = "in part, to show the way" if settings.quick else "in full"
    rules = "rules: tests/proof/PROTOCOL.md, log: tests/proof/LOG.md"
    about = f"Seed {settings.seed}, {sort}. Made by `python -m tests.proof`; {rules}."
    content = {
        "seed": settings.seed, "quick": settings.quick, "sources": sources(), "proofs": as_json(outcomes),
        "seconds": seconds,
    }  # fmt: skip
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    (settings.folder / "proof.json").write_text(text, encoding="utf-8")
    (settings.folder / "proof.html").write_text(page(outcomes, about), encoding="utf-8")


def sources() -> dict[str, str]:
    """Hashes of what was judged and what made it."""
    return {room.__name__: source_hash(Path(str(room.__file__)).parent) for room in (bench, estimator, emulator)}


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.proof", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a part of it, on a development seed, in minutes")
    parser.add_argument("--seed", type=int, help=f"of the population (default {SEED}, with --quick {QUICK_SEED})")
    parts = ", ".join(PARTS)
    parser.add_argument("--only", nargs="+", default=PARTS, choices=PARTS, metavar="NAME", help=parts)
    parser.add_argument("--out", type=Path, default=Path("build") / "proof", metavar="FOLDER")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parser.add_argument("--jobs", type=int, default=cores, metavar="N", help="processes (default: one per core)")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # of the processes to come: one core each
    sys.exit(main())
