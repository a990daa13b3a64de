"""What becomes of a user's error beside missing physics: `python -m tests.bars.score_conventions [SEED]`, a table.

Every error of `test_convention.py` is made to recordings of 2 s, two of each effect. *Undone*: named, and nothing as
likely; *ambiguous*: named with others that do as well; *left*: nothing is suspected, the diagnosis goes on as recorded;
*wrong*: another cause, or some without it. Ends with 1 where one is wrong, or suspected where no error was made.
"""

import os

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

import sys
from collections import Counter

from emulator.conceal.populations import POPULATIONS, STRANGERS
from estimator.diagnosis.intake.causes import SCALES, forms
from estimator.diagnosis.intake.convention import suspected
from tests.estimator.diagnosis.convention_runs import Recorded, made, recording
from tests.estimator.diagnosis.intake.test_convention import FOUND, TOLERANCE
from tests.proof.results import record

SEED = 36
EACH = 2
BECOMES = ("undone", "ambiguous", "left", "wrong")


def becomes(name: str, recorded: Recorded) -> str:
    """What becomes of an error."""
    error, cause, _ = FOUND[name]
    suspicion = suspected(*made(error, recorded), TOLERANCE)
    if suspicion is None:
        return "left"
    if not suspicion.ambiguous:
        return "undone" if suspicion.cause == cause else "wrong"
    words = {each.name: each.says for each in (*SCALES, *forms(recorded[1].n_p, per_unit=True))}
    return "ambiguous" if suspicion.cause == cause or words.get(cause) in suspicion.ambiguous else "wrong"


def main() -> int:
    """Print the table."""
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else SEED
    found = {name: Counter[str]() for name in FOUND}
    taken, recordings = 0, 0
    for kind in POPULATIONS:
        if kind in STRANGERS:
            continue
        for number in range(1, EACH + 1):
            recorded = recording(kind, number, seed)
            recordings += 1
            taken += suspected(*recorded, TOLERANCE) is not None
            for name, counts in found.items():
                what = becomes(name, recorded)
                counts[what] += 1
                if what == "wrong":
                    print(f"{kind} {number}, {name}: another cause")
    print(f"{'':46}" + "".join(f"{what:>11}" for what in BECOMES))
    for name, counts in found.items():
        print(f"{name:46}" + "".join(f"{counts[what]:11d}" for what in BECOMES))
    whole = sum(found.values(), Counter[str]())
    shares = ", ".join(f"{what} {whole[what] / whole.total():.1%}" for what in BECOMES)
    print(f"of {whole.total()}: {shares}; as recorded, {taken} of {recordings} were taken for a convention")
    if seed == SEED:
        undone, ambiguous, left = (f"{whole[what] / whole.total():.1%}" for what in BECOMES[:3])
        record("diagnoses.conventions_beside", f"{undone}; {ambiguous}; {left}; {whole['wrong']} of {whole.total()}; "
               f"{taken} of {recordings}")  # fmt: skip
    return 1 if whole["wrong"] or taken else 0


if __name__ == "__main__":
    sys.exit(main())
