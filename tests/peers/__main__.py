"""`python -m tests.peers`: the tables on the screen, the figure and table.json in build/peers.

Ends with status 0 whether the bar is met or missed: the tests decide that, this shows it.
"""

import json
from pathlib import Path

from tests.peers import figures
from tests.peers.cases import BAR, SAME_VOLTAGES, Course, errors, recorded
from tests.peers.cases import REFERENCES as SAME_REFERENCES
from tests.peers.speed import real_time_factors
from tests.peers.with_motulator import under_references, under_voltages

OUT = Path("build") / "peers"


def main() -> None:
    """All of it; takes a minute or two."""
    courses: list[tuple[str, Course, Course, dict[str, float]]] = []
    for case in SAME_VOLTAGES:
        ours, voltages = recorded(case)
        theirs = under_voltages(case, voltages)
        courses.append((case.title, ours, theirs, errors(ours, theirs)))
    ours, _ = recorded(SAME_REFERENCES)
    theirs = under_references(SAME_REFERENCES, len(ours.t))
    courses.append((SAME_REFERENCES.title, ours, theirs, errors(ours, theirs)))

    print(f"Rms of the difference to motulator over motulator's rms in %, one second; the bar is {BAR:g} %")
    print(f"  {'':<50}" + "".join(f"{name:>11}" for name in courses[0][1].signals()))
    for title, _, _, found in courses:
        verdict = "met" if max(found.values()) <= BAR else "MISSED"
        print(f"  {title:<50}" + "".join(f"{error:>11.2g}" for error in found.values()) + f"  {verdict}")

    factors = real_time_factors()
    print("\nThe same second of 10,000 control periods, one core: times real time")
    for name, factor in factors.items():
        print(f"  {name:<50}{factor:>11.3g}")
    for inverter in ("averaged", "edges"):
        ratio = factors[f"ours, {inverter}"] / factors[f"motulator, {inverter}"]
        print(f"  {f'ours over motulator, {inverter}':<50}{ratio:>11.0f}")

    figures.compared(OUT / "motulator.png", courses)
    document = {
        "rms_per_cent": {title: found for title, _, _, found in courses}, "bar_per_cent": BAR,
        "times_real_time": factors,
    }
    (OUT / "table.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(f"\nmotulator.png and table.json are in {OUT}/")


if __name__ == "__main__":
    main()
