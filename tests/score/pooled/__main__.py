"""`python -m tests.score.pooled [--part 1/8] [--jobs N] [--keep]`: today's library beside the kept one, pair by pair.

Stopped and started again, it goes on where it was, as long as the sources of what is judged, and of what judges, are
the same. Exit code 1 where the pooled count falls by more than 5 of 1,200; 2 where a recording is another one than was
kept, or of one there is nothing to lay beside.
"""

import argparse
import hashlib
import sys
from pathlib import Path

import bench.machine_file
import bench.recordings
import emulator
import estimator
import tests.score
from emulator.kernel import source_hash
from tests.score.pooled.outcome import BASELINE, kept_outcomes, write_outcomes
from tests.score.pooled.pairwise import falls, lacking, others, pairs_of, table
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
    wanted = kept_population()[k - 1 :: n]
    judged = hashlib.sha256(f"{given.function} {_sources()}".encode()).hexdigest()[:16]
    try:
        before = kept_outcomes(BASELINE)
        if not given.keep and (left := lacking(wanted, before)):
            print(f"score: {left}; --keep makes it", file=sys.stderr)
            return 2
        now = outcomes(wanted, _DONE / f"{judged}.tsv", given.function, given.jobs)
    except OtherRecordingError as error:
        print(f"score: {error}; recordings that were looked at must stay as they are", file=sys.stderr)
        return 2
    except ValueError as error:
        print(f"score: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("score: stopped; started again, it goes on from here", file=sys.stderr)
        return 130
    if given.keep:
        kept = before | now
        write_outcomes(kept, BASELINE, ("what a kept library says: python -m tests.score.pooled --keep",))
        print(f"kept {len(now)} outcomes, {len(kept)} in all")
        return 0
    pairs = pairs_of(before, now)
    print(aligned(table(pairs)), aligned(others(pairs)), sep="\n\n")
    for title in ("gained", "lost", "changed"):
        lines = [pair.line for pair in pairs if getattr(pair, title)]
        if lines:
            print(f"\n{title}:", *lines, sep="\n  ")
    return int(falls(pairs))


def _sources() -> str:
    rooms = (estimator, emulator, bench.recordings, tests.score)
    reader = Path(bench.machine_file.__file__).read_text(encoding="utf-8")
    return " ".join([*(source_hash(Path(str(room.__file__)).parent) for room in rooms), reader])


def _part(text: str) -> tuple[int, int]:
    k, _, n = text.partition("/")
    if not (k.isdigit() and n.isdigit() and 1 <= int(k) <= int(n)):
        raise argparse.ArgumentTypeError(f"expected one such as 1/8, got {text}")
    return int(k), int(n)


if __name__ == "__main__":
    sys.exit(main())
