"""`python -m tests.peers`: the tables on the screen, the figures and table.json in build/peers.

Ends with status 0 whether the bar is met or missed: the tests decide that, this shows it.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.peers import figures, saturated
from tests.peers.cases import BAR, REFERENCES, SAME_VOLTAGES, Case, Course, errors, recorded
from tests.peers.speed import real_time_factors
from tests.peers.with_motulator import under_references, under_voltages
from tests.proof.results import record

OUT = Path("build") / "peers"

Compared = tuple[str, Course, Course, dict[str, float]]  # title, ours, theirs, errors in per cent


def main() -> None:
    """All of it; takes a minute or two."""
    linear = _compared(SAME_VOLTAGES, REFERENCES)
    with TemporaryDirectory() as name:
        folder = Path(name)
        saturating = _compared(saturated.same_voltages(folder), saturated.under_control(folder))
    courses = [*linear, *saturating]

    print(f"Rms of the difference to motulator over motulator's rms in %, one second; the bar is {BAR:g} %")
    print(f"  {'':<58}" + "".join(f"{name:>11}" for name in courses[0][1].signals()))
    for title, _, _, found in courses:
        verdict = "met" if max(found.values()) <= BAR else "MISSED"
        print(f"  {title:<58}" + "".join(f"{error:>11.2g}" for error in found.values()) + f"  {verdict}")

    factors = real_time_factors()
    print("\nThe same second of 10,000 control periods, one core: times real time")
    for name, factor in factors.items():
        print(f"  {name:<58}{factor:>11.3g}")
    for inverter in ("averaged", "edges"):
        ratio = factors[f"ours, {inverter}"] / factors[f"motulator, {inverter}"]
        print(f"  {f'ours over motulator, {inverter}':<58}{ratio:>11.0f}")

    _recorded(linear, saturating)
    figures.compared(OUT / "motulator.png", linear)
    figures.compared(OUT / "motulator_saturated.png", saturating)
    document = {
        "rms_per_cent": {title: found for title, _, _, found in courses}, "bar_per_cent": BAR,
        "times_real_time": factors,
    }
    (OUT / "table.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(f"\nmotulator.png, motulator_saturated.png and table.json are in {OUT}/")


def _recorded(linear: Sequence[Compared], saturating: Sequence[Compared]) -> None:
    def worst(of: Sequence[Compared]) -> list[float]:
        return [max(found.values()) for _, _, _, found in of]

    averaged, edges, control = worst(linear)
    by_map, by_map_edges, by_curve, by_curve_edges, under_control = worst(saturating)
    record("plant.motulator", f"{averaged:.1g} %, {edges:.1g} %; {control:.2g} %", max(averaged, edges, control) <= BAR)
    curve = f"{by_curve:.1g} %, {by_curve_edges:.1g} %"
    record("plant.saturated", f"{max(by_map, by_map_edges):.2g} %, {under_control:.1g} %; {curve}")


def _compared(same_voltages: Sequence[Case], references: Case) -> list[Compared]:
    found: list[Compared] = []
    for case in (*same_voltages, references):
        ours, voltages = recorded(case)
        theirs = under_references(case, len(ours.t)) if case is references else under_voltages(case, voltages)
        found.append((case.title, ours, theirs, errors(ours, theirs)))
    return found


if __name__ == "__main__":
    main()
