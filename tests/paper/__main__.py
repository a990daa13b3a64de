"""`python -m tests.paper`: the tables on the screen, figures and table.json in build/paper.

Ends with status 0 whether bars are met or missed: the tests decide that, this shows it.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from emulator.scenario.scenarios import PAPER_RUN
from tests.paper import figures, table
from tests.paper.findings import Cells, best_of, by_rival, by_window, loud, table_1
from tests.paper.published import (
    BEST_WINDOWS,
    DOI,
    FIXED_WINDOWS,
    NAMES,
    TABLE_1,
    TEMPERATURES,
    VARYING_WINDOWS,
    Array,
    per_cent,
    without_misprint,
)
from tests.paper.runs import LAM, RIVALS, SEEDS, WHOLE_M, WINDOW_M, Estimator, Run, fixed, tracked, warming, wls
from tests.proof.results import record

OUT = Path("build") / "paper"
NOISES = {"no noise": False, "10 mA, 12 bits": True}
BARS = {"no noise": 0.02, "10 mA, 12 bits": 0.3}  # %, worst of our WLS over all cells and seeds
LOUD = 0.1  # A


def main() -> None:
    """All of it; takes about two minutes."""
    sets = {noise: table_1(SEEDS, noise=given) for noise, given in NOISES.items()}
    for noise, cells in sets.items():
        print(table.table_1(cells, SEEDS[0], noise), end="\n\n")
    print(table.worst_and_mean(sets, len(SEEDS)), end="\n\n")

    still = [fixed(TEMPERATURES[0], seed, noise=True) for seed in SEEDS]
    warm = [warming(seed, noise=True) for seed in SEEDS]
    quiet = [warming(seed, noise=False) for seed in SEEDS]
    fixed_errors = by_window(still, FIXED_WINDOWS)
    varying, rivals = by_window(warm, VARYING_WINDOWS), by_rival(warm)
    noiseless = by_window(quiet, VARYING_WINDOWS)
    long_rows = loud(SEEDS, VARYING_WINDOWS, PAPER_RUN.drive.noise_i)
    loud_rows = loud(SEEDS, VARYING_WINDOWS, LOUD)
    rms = "RMS error in % over the run's second half"
    print(table.tracking(f"Fixed parameters, 10 mA, windows in rows of 0.1 ms: {rms}", FIXED_WINDOWS, fixed_errors))
    print(table.tracking(
        f"\nVarying parameters, 10 mA, windows in rows of 0.1 ms: {rms}", VARYING_WINDOWS, varying, rivals
    ))
    for title, errors in {
        "no noise, windows in rows of 0.1 ms": noiseless, "10 mA, windows in rows of 1 ms": long_rows,
        f"{1e3 * LOUD:g} mA, windows in rows of 1 ms": loud_rows,
    }.items():
        print(table.tracking(f"\nVarying parameters, {title}: {rms}", VARYING_WINDOWS, errors))

    draw(still[0], warm[0])
    bars = [
        table.Bar(f"worst error of WLS, {noise}", float(sets[noise]["WLS"].worst.max()), BARS[noise])
        for noise in NOISES
    ]
    tracks = {
        "fixed, 10 mA": (FIXED_WINDOWS, fixed_errors), "varying, 10 mA": (VARYING_WINDOWS, varying),
        "varying, no noise": (VARYING_WINDOWS, noiseless), "varying, 10 mA, rows of 1 ms": (VARYING_WINDOWS, long_rows),
        f"varying, {1e3 * LOUD:g} mA, rows of 1 ms": (VARYING_WINDOWS, loud_rows),
    }
    write(sets, tracks, rivals, bars)
    close(sets, varying, rivals, bars)


def draw(still: Run, warm: Run) -> None:
    """Figures 2 to 8."""
    def under(run: Run, lengths: tuple[int, ...]) -> dict[str, Array]:
        return {str(length): tracked(wls(length, WINDOW_M), run) for length in lengths}

    on_still, on_warm = under(still, FIXED_WINDOWS), under(warm, VARYING_WINDOWS)
    for k, name in enumerate(NAMES):
        figures.windows(
            OUT / f"figure_{2 + k}.png", f"Figure {2 + k}: {name}, fixed parameters, 10 mA of noise", k, still,
            on_still, (0.015, 0.012, 0.008)[k],
        )
        figures.windows(
            OUT / f"figure_{5 + k}.png", f"Figure {5 + k}: {name}, varying parameters, 10 mA of noise", k, warm,
            on_warm, (0.03, 0.015, 0.012)[k],
        )
    made: dict[str, Callable[[], Estimator]] = {"WLS, window 300": lambda: wls(300, WINDOW_M)}
    made |= {name: make for name, make in RIVALS.items() if name != "RLS forgetting"}
    figures.methods(
        OUT / "figure_8.png", "Figure 8: WLS against RLS and EKF, varying parameters, 10 mA of noise", warm,
        {name: tracked(make(), warm) for name, make in made.items()}, np.array([0.08, 0.04, 0.03]),
    )


def write(
    sets: Mapping[str, Mapping[str, Cells]], tracks: Mapping[str, tuple[tuple[int, ...], Array]],
    rivals: Mapping[str, Array], bars: list[table.Bar],
) -> None:
    """table.json: all numbers."""
    document: dict[str, Any] = {
        "doi": DOI, "seeds": SEEDS, "temperatures_degC": TEMPERATURES, "parameters": NAMES,
        "row": "a control period of 0.1 ms where not said otherwise",
        "m": {"WLS": WHOLE_M, "windows": WINDOW_M}, "lam_forgetting": LAM,
        "published": {method: _cells(values) for method, values in TABLE_1.items()},
        "ours": {
            noise: {
                method: {
                    "values": found.values.tolist(), "errors_per_cent": found.errors.tolist(),
                    "worst_per_cent": found.worst.tolist(), "mean_per_cent": found.mean.tolist(),
                } for method, found in cells.items()
            } for noise, cells in sets.items()
        },
        "tracking_rms_per_cent": {
            title: {str(length): row.tolist() for length, row in zip(lengths, errors, strict=True)}
            for title, (lengths, errors) in tracks.items()
        },
        "tracking_rms_per_cent_of_others": {name: error.tolist() for name, error in rivals.items()},
        "bars": [{"what": bar.what, "per_cent": bar.got, "at_most": bar.at_most, "met": bar.met} for bar in bars],
    }
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "table.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def close(
    sets: Mapping[str, Mapping[str, Cells]], varying: Array, rivals: Mapping[str, Array], bars: list[table.Bar]
) -> None:
    """One summary, with what is missed."""
    published = without_misprint(np.abs(per_cent(TABLE_1["WLS"])))
    ahead = {noise: np.max(np.abs(cells["WLS"].errors), axis=0) < np.nan_to_num(published, nan=np.inf)
             for noise, cells in sets.items()}
    best = best_of(VARYING_WINDOWS, varying)
    print("\nSummary")
    for bar in bars:
        print(bar)
    for noise, better in ahead.items():
        others = ", ".join(f"{NAMES[k]} at {TEMPERATURES[n]:g} degC" for k, n in np.argwhere(~better))
        print(f"  {int(better.sum())} of 21 cells better than the published WLS in every seed, {noise}"
              + (f"; not {others}" if others else ""))
    print(f"  best window on the varying run: {', '.join(f'{n} {w}' for n, w in zip(NAMES, best, strict=True))}; "
          f"published {BEST_WINDOWS[0]} to {BEST_WINDOWS[1]}")
    for name, error in rivals.items():
        beaten = [n for n, a, b in zip(NAMES, error, varying.min(axis=0), strict=True) if a < b]
        print(f"  {name} follows better than the best window: {', '.join(beaten) or 'nowhere'}")
    missed = [bar.what for bar in bars if not bar.met]
    print(f"  missed: {'; '.join(missed) or 'nothing'}")
    print(f"  figures 2 to 8 and table.json are in {OUT}/")
    recorded(sets, ahead, bars)


def recorded(
    sets: Mapping[str, Mapping[str, Cells]], ahead: Mapping[str, Array], bars: list[table.Bar]
) -> None:
    """Worst errors, and at how many temperatures ours are better."""
    quiet, noisy = sets.values()
    rows = {
        "wls_noiseless": quiet["WLS"].worst, "wls": noisy["WLS"].worst, "rls": noisy["RLS"].worst,
        "ekf": noisy["EKF tuned"].worst, "published_ekf_here": noisy["EKF published"].worst,
    }
    for name, worst in rows.items():
        record(f"paper.{name}", " | ".join(f"{each:.{3 if each > 0.1 else 2}g}" for each in worst))
    *_, better = ahead.values()
    record("paper.ahead", " | ".join(str(count) for count in better.sum(axis=1)))
    record("estimates.paper", ", ".join(f"{bar.got:.1g} %" for bar in bars), all(bar.met for bar in bars))


def _cells(values: Array) -> dict[str, Any]:
    return {"values": values.tolist(), "errors_per_cent": per_cent(values).tolist()}


if __name__ == "__main__":
    main()
