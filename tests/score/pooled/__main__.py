"""`python -m tests.score.pooled [--part 1/8] [--jobs N] [--keep]`: today's library beside the kept one, pair by pair.

Stopped and started again, it goes on where it was, as long as the sources of what is judged are the same. Exit code 1
where the pooled count falls by more than 5 of 1,200.
"""

import argparse
import hashlib
import sys
from pathlib import Path

import bench.recordings
import estimator
from emulator.kernel import source_hash
from tests.score.pooled.outcome import BASELINE, kept_outcomes, write_outcomes
from tests.score.pooled.pairwise import falls, others, pairs_of, table
from tests.score.pooled.population import kept_population
from tests.score.pooled.work import OtherRecordingError, outcomes
from tests.score.score import FUNCTION, aligned

_DONE = Path("build/score")


def main() -> int:
    """Diagnose, compare, print."""
    parser = argparse.ArgumentParser("python -m tests.score.pooled", description=__doc__)
    parser.add_argument("--part", type=_part, default=(1, 1), metavar="K/N", help="every Nth recording, from the Kth")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--keep", action="store_true", help=f"keep what is said as {BASELINE.name}")
    parser.add_argument("--function", default=FUNCTION, metavar="MODULE:NAME", help=f"what diagnoses ({FUNCTION})")
    given = parser.parse_args()
    k, n = given.part
    judged = hashlib.sha256(f"{given.function} {_sources()}".encode()).hexdigest()[:16]
    try:
        now = outcomes(kept_population()[k - 1 :: n], _DONE / f"{judged}.tsv", given.function, given.jobs)
    except OtherRecordingError as error:
        print(f"score: {error}; recordings that were looked at must stay as they are", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("score: stopped; started again, it goes on from here", file=sys.stderr)
        return 130
    if given.keep:
        kept = kept_outcomes(BASELINE) | now
        write_outcomes(kept, BASELINE, ("what a kept library says: python -m tests.score.pooled --keep",))
        print(f"kept {len(now)} outcomes, {len(kept)} in all")
        return 0
    pairs = pairs_of(kept_outcomes(BASELINE), now)
    print(aligned(table(pairs)), aligned(others(pairs)), sep="\n\n")
    for title in ("gained", "lost", "changed"):
        lines = [pair.line for pair in pairs if getattr(pair, title)]
        if lines:
            print(f"\n{title}:", *lines, sep="\n  ")
    return int(falls(pairs))


def _sources() -> str:
    return " ".join(source_hash(Path(str(room.__file__)).parent) for room in (estimator, bench.recordings))


def _part(text: str) -> tuple[int, int]:
    k, _, n = text.partition("/")
    if not (k.isdigit() and n.isdigit() and 1 <= int(k) <= int(n)):
        raise argparse.ArgumentTypeError(f"expected one such as 1/8, got {text}")
    return int(k), int(n)


if __name__ == "__main__":
    sys.exit(main())
