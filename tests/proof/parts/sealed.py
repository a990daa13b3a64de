"""Effects concealed in simulations and sealed: what the diagnosis says of them, opened and scored afterwards.

One process makes a suite, others diagnose its recordings, this one alone holds the answers meanwhile, see `seal`.
"""

import json
import math
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import plotly.graph_objects

from emulator.conceal.populations import FAMILIES, KINDS
from tests.proof.diagnosing import said_of
from tests.proof.parts import poor_suite
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.proof.seal import SEAL, opened, publish, sealed
from tests.score.diagnosed import Said
from tests.score.oracle import limits
from tests.score.reliability import FEWEST, WITHIN, bins
from tests.score.rows import PLAIN, Row, as_json, row_of
from tests.score.score import (
    BINS,
    Cells,
    Measure,
    by_group,
    by_size,
    confusion,
    counted,
    machines,
    measures,
    told_limits,
)
from tests.score.truth import EFFECT, truth_of

go: Any = plotly.graph_objects  # comes without types

_WHOLE = 400, 100, 200, 78, 6.0  # recordings, those near the limit, healthy drives, poor ones, s of each
_QUICK = 6, 2, 2, 2, 3.0
_SUITES: Final = (*KINDS, *FAMILIES)
NEAR: Final = "near "  # before the names of recordings near the limit
HEALTHY: Final = "healthy "  # of drives without an effect
_ASKED: Final = ("one", "two", "three", *FAMILIES)  # kinds of recordings that the oracle is asked of


def prove(settings: Settings) -> Proof:
    """Make, seal, diagnose, open, score."""
    folder = settings.folder / "sealed"
    shutil.rmtree(folder, ignore_errors=True)
    count, near_count, healthy_count, poor_count, length = _QUICK if settings.quick else _WHOLE
    drawn, by = ("--seed", str(settings.seed), "--chain"), ("--jobs", str(settings.jobs))
    conceal = "emulator", "conceal", *drawn, "--length", str(length), "--workers", str(settings.jobs)
    rich = heard(folder / "rich", settings.jobs, (*conceal, "--count", str(count), "--class", *_SUITES))
    healthy = heard(folder / "healthy", settings.jobs, (*conceal, "--count", str(healthy_count), "--class", "none"))
    near = heard(folder / "near", settings.jobs, (
        "tests.proof.parts.near_suite", *drawn, "--count", str(near_count), "--length", str(length), *by
    ))  # fmt: skip
    poor = heard(folder / "poor", settings.jobs, (
        "tests.proof.parts.poor_suite", *drawn, "--count", str(poor_count), *by
    ))  # fmt: skip
    return proof_of_suites(rich, near, healthy, poor, length, settings)


@dataclass(frozen=True, slots=True)
class Heard:
    """What was said of a suite, and its answers, opened afterwards."""

    answers: list[dict[str, Any]]
    said: Mapping[str, Said]
    digest: str  # of the seal


def proof_of_suites(
    rich: Heard, near: Heard, healthy: Heard, poor: Heard, length: float, settings: Settings
) -> Proof:  # fmt: skip
    """The score of suites of `length` s (poor ones: of their own) that were diagnosed and opened."""
    folder = settings.folder / "sealed"
    over_limit = limits([answer for answer in rich.answers if answer["kind"] in _ASKED], settings.jobs)
    near_by = {answer["recording"]: answer["over_limit"] for answer in near.answers}
    rows = [
        *scored(rich.answers, over_limit, rich.said),
        *(replace(row, recording=NEAR + row.recording) for row in scored(near.answers, near_by, near.said)),
        *(replace(row, recording=HEALTHY + row.recording) for row in scored(healthy.answers, {}, healthy.said)),
    ]
    (folder / "rows.json").write_text(json.dumps([as_json(row) for row in rows], indent=1) + "\n", encoding="utf-8")
    what = (
        f"{len(rows)} recordings of {length:g} s, seed {settings.seed}, each with a measuring chain drawn for it, "
        f"{len(near.answers)} of them with one effect of half to thirty times what the oracle could see, "
        f"{len(healthy.answers)} of drives without any effect besides their chain"
    )
    return proof_of(rows, poor, what, f"{rich.digest}, {near.digest} and {healthy.digest}")


def heard(folder: Path, jobs: int, maker: Sequence[str]) -> Heard:
    """A suite made by a process of its own (a module and its arguments), sealed, diagnosed by others, opened."""
    folder.mkdir(parents=True)
    recordings, answers = folder / "recordings", folder / "answers"
    subprocess.run(
        [sys.executable, "-m", *maker, "--out", recordings, "--answers", answers],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    seal = sealed(answers, recordings)
    try:
        said = said_of(recordings, folder / "said.pickle", jobs)
        return Heard(opened(seal), said, (recordings / SEAL).read_text(encoding="ascii").strip())
    finally:  # gigabytes of recordings go, which the seed makes anew; seal and answers stay
        publish(seal, answers)
        shutil.copy(recordings / SEAL, folder / SEAL)
        shutil.rmtree(recordings)


def scored(
    answers: Sequence[Mapping[str, Any]], over_limit: Mapping[str, Mapping[str, float]], said: Mapping[str, Said]
) -> list[Row]:
    """A row for each answer."""
    return [
        row_of(name, truth_of(answer), over_limit.get(name, {}), said[name])
        for answer in answers
        for name in (answer["recording"],)
    ]


def proof_of(rows: Sequence[Row], poor: Heard, what: str, digest: str) -> Proof:
    """What the rows show, and what was said of recordings that tell little. `what`: the rows, in words."""
    exact = sum(row.exact for row in rows if row.kind != "stranger")
    known = sum(row.kind != "stranger" for row in rows)
    false = sum(bool(row.false) for row in rows if row.kind != "stranger")
    strangers = [row.stranger for row in rows if row.kind == "stranger"]
    said = (
        f"{what}; {known} of no, one, two or three effects and "
        f"{len(strangers)} of a stranger that the library does not hold. Their answers were taken off the disk and "
        f"sealed by SHA-256 {digest} before the diagnosis began, in processes that know the recordings' folder alone. "
        f"{exact} of {known} sets are exact, {false} have a false name in them; {strangers.count('right')} of "
        f"{len(strangers)} strangers have no name and the right region, {strangers.count('forced')} were forced into "
        f"a name. The oracle was asked of the recordings with one, two or three effects. "
        f"Besides, {len(poor.answers)} recordings of "
        f"{poor_suite.LENGTH:g} s at one speed and one level of current, or none, were sealed and diagnosed likewise: "
        "nothing is to be named there that is not there."
    )
    wrong = poor_suite.wrong(poor.answers, poor.said)
    never = Bar("poor excitation: a wrong name", "never", f"{len(wrong)} of {len(poor.answers)}", not wrong)
    tables = (
        _table("Exact sets, false names and strangers, by kind and by class of single effects", by_group(rows)),
        _table("What was said of no effect, of one, and of strangers", confusion(rows)),
        _table("How often an effect is named, by its size over its detection limit", by_size(rows)),
        _table("Relative error of the machine's parameters, before and after", machines(rows)),
        _table("Held-out residual over the noise floor, exact sets", residuals(rows)),
        _table("Sizes of effects, where they were named", sizes(rows)),
        _table("Detection limits that the diagnosis tells, over the oracle's", told_limits(rows)),
        _table("Odds that are told of effects, and the share of these that is there", reliability(rows)),
        _table("Misses: false names, false verdicts, effects of 3 limits or more that were not named", misses(rows)),
        poor_suite.table(poor.answers, poor.said),
        Table("Poor excitation: wrong names", ("recording", "concealed", "said"), tuple(wrong)),
    )  # fmt: skip
    return Proof(
        name="sealed", title="Sealed simulation", said=said, bars=(*_bars(rows), never),
        tables=tuple(table for table in tables if table.rows), pictures=(rate_picture(rows), matrix_picture(rows)),
    )  # fmt: skip


def _bars(rows: Sequence[Row]) -> list[Bar]:
    """Measures of all rows; the first one apart, too, for sizes of the population and those near the limit."""
    first, *others = measures(rows)
    near = [row for row in rows if row.recording.startswith(NEAR)]
    population = [row for row in rows if not row.recording.startswith((NEAR, HEALTHY))]
    apart = {"the population's own sizes": population, "half to thirty limits": near}
    parts = [replace(measures(some)[0], what=f"  of these, {what}", at_least=None) for what, some in apart.items()]
    return [*(_bar(measure) for measure in (first, *parts, *others)), _reliable(rows)]


def _reliable(rows: Sequence[Row]) -> Bar:
    """Of effects of all recordings: odds that are told beside the share that is there."""
    found = bins([each for row in rows for each in row.candidates])
    judged = [each for each in found if each.candidates >= FEWEST]
    worst = max((each.off for each in judged), default=math.nan)
    what = f"odds of effects, told over right, in bins of {FEWEST} or more"
    return Bar(what, f"within {WITHIN:g} times, 5 bins", f"{worst:.2g}, {len(judged)} bins",
               len(judged) == len(found) and worst <= WITHIN)  # fmt: skip


def reliability(rows: Sequence[Row]) -> Cells:
    """Odds that are told and right ones, bin by bin."""
    cells: Cells = [("odds told", "effects", "there", "told", "right", "off, times")]
    for each in bins([each for row in rows for each in row.candidates]):
        span = f"{10.0**each.low:g} to {10.0**each.high:g}"
        numbers = f"{each.told:.3g}", f"{each.right:.3g}", f"{each.off:.2f}"
        cells.append((span, str(each.candidates), str(each.there), *numbers))
    return cells


def _bar(measure: Measure) -> Bar:
    return Bar(measure.what, measure.asked, f"{measure.share or 'none'} of {measure.of}", measure.held)


def _table(title: str, cells: Cells) -> Table:
    return Table(title, cells[0], tuple(cells[1:]))


def residuals(rows: Sequence[Row]) -> Cells:
    """Quantiles of the residual over the floor, by kind."""
    cells: Cells = [("", "recordings", "median", "95 %", "largest", "within 5 %")]
    for kind in ("none", "one", "two", "three"):
        found = [row.residual for row in rows if row.kind == kind and row.exact and row.residual is not None]
        if found:
            median, most, largest = np.quantile(found, (0.5, 0.95, 1.0))
            within = np.mean([ratio <= 1.05 for ratio in found])
            cells.append((kind, str(len(found)), f"{median:.3f}", f"{most:.3f}", f"{largest:.3f}", f"{within:.1%}"))
    return cells


def sizes(rows: Sequence[Row]) -> Cells:
    """How well the parameters of named effects are told."""
    cells: Cells = [("effect", "parameter", "told", "right", "median error")]
    names = sorted({name for row in rows for name in row.sizes})
    for name in names:
        told = [row.sizes[name] for row in rows if name in row.sizes]
        errors = [abs(size.value / size.true - 1.0) for size in told if size.value is not None and size.true]
        effect, parameter = name.split(".")
        right = f"{sum(size.right for size in told)}"
        cells.append((effect, parameter, str(len(told)), right, f"{np.median(errors):.2%}" if errors else ""))
    return cells


def misses(rows: Sequence[Row]) -> Cells:
    """What went wrong, a line a recording."""
    cells: Cells = [("recording", "concealed", "size over limit", "said", "verdict", "sentence")]
    for row in rows:
        plain = row.kind == "one" and row.plain and bool(row.over_limit) and not row.exact
        wrong = row.stranger not in ("", "right", "missed")
        if row.false or row.false_verdict or plain or wrong:
            cells.append((
                row.recording, " + ".join(row.classes) or "none",
                ", ".join(f"{ratio:.3g}" for ratio in row.over_limit.values()), " + ".join(row.found) or "-",
                row.verdict, row.sentence.strip().splitlines()[-1] if row.sentence.strip() else "",
            ))
    return cells


# --- pictures


def rate_picture(rows: Sequence[Row]) -> Any:
    """How often a single effect is named, by its size over its limit."""
    told = [
        (ratio, EFFECT[name] in row.found, name)
        for row in rows if row.kind == "one"
        for name, ratio in row.over_limit.items() if name in EFFECT
    ]
    figure = go.Figure()
    points: list[tuple[float, float, float, int]] = []
    for low, high in pairwise((*BINS[:-1], 30.0, 100.0, math.inf)):
        hits = [named for ratio, named, _ in told if low <= ratio < high]
        if hits:
            share, n = float(np.mean(hits)), len(hits)
            middle = math.sqrt(max(low, 0.3) * (high if high < math.inf else 300.0))
            points.append((middle, share, math.sqrt(share * (1.0 - share) / n + 0.25 / n**2), n))
    if points:
        x, y, error, n = zip(*points, strict=True)
        figure.add_scatter(
            x=x, y=y, mode="lines+markers", name="share named", error_y={"array": error, "width": 3},
            text=[f"of {each}" for each in n], line={"color": "#14708c"},
        )
    figure.add_scatter(
        x=[min(max(ratio, 0.2), 400.0) for ratio, _, _ in told], y=[1.03 if named else -0.03 for _, named, _ in told],
        mode="markers", name="a recording", text=[name for _, _, name in told],
        marker={"size": 5, "color": "#8a8f98", "opacity": 0.6},
    )
    figure.add_vline(x=PLAIN, line_dash="dot", line_color="#8a8f98")
    figure.update_xaxes(type="log", title="size over the oracle's detection limit", range=[-0.8, 2.7], dtick=1)
    figure.update_yaxes(title="named", tickformat=".0%", range=[-0.08, 1.08])
    figure.update_layout(title="One effect: named, by size over its detection limit", height=380)
    return figure


def matrix_picture(rows: Sequence[Row]) -> Any:
    """What is said of recordings with one class or none, as shares of each."""
    said = counted(rows)
    columns = [name for name in dict.fromkeys(EFFECT.values()) if any(name in what for what in said.values())]
    others = [*columns, "several names", "no name"]

    def place(what: str) -> str:
        return "no name" if what.startswith("(") else what if what in columns else "several names"

    z = [
        [sum(n for what, n in group.items() if place(what) == other) / group.total() for other in others]
        for group in said.values()
    ]
    figure = go.Figure(go.Heatmap(
        z=z, x=others, y=list(said), colorscale=[[0.0, "#f7f8fa"], [0.35, "#c9cedb"], [1.0, "#262d4d"]], zmin=0.0,
        zmax=1.0, colorbar={"tickformat": ".0%", "thickness": 10}, hovertemplate="%{y}: %{x} %{z:.0%}<extra></extra>",
    ))  # fmt: skip
    figure.update_yaxes(autorange="reversed", title="concealed")
    figure.update_xaxes(tickangle=50, title="said")
    figure.update_layout(title="Confusion", height=230 + 22 * len(said), margin={"l": 160, "t": 50, "b": 170})
    return figure
