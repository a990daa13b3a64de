"""The score of the diagnosis on concealed suites, beside the bars it is to meet.

`python -m tests.score.score --out DIR --answers DIR [--json OUT] [--jobs N] [--only NAME ...] [--limits FILE ...]`

Recordings are diagnosed in processes that are told the recordings' folder; the answers are opened afterwards. Several
suites: several folders to --out and --answers. What the oracle says takes longer than the diagnosis: `--limits` takes
it from files of `tests.score.oracle --json`.
"""

import argparse
import json
import math
import statistics
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from emulator.conceal.populations import POPULATIONS
from tests.score.diagnosed import Said, diagnosed, named
from tests.score.oracle import answers_in, limits
from tests.score.rows import DC_LINK, DEVIATIONS, FLOOR, MACHINE, PLAIN, Row, as_json, row_of
from tests.score.truth import EFFECT, truth_of

FUNCTION: Final = "estimator.diagnosis.diagnose:diagnose"
SEEN: Final = 2.0  # of the oracle's limits: a size from which on 99 of 100 are to be seen
BINS: Final = (0.0, 1.0, 2.0, 3.0, 5.0, 10.0, math.inf)  # size over limit
_EVERY: Final = 20  # recordings, between lines of progress
_KINDS: Final = ("none", "one", "two", "three", "stranger")


Cells = list[tuple[str, ...]]
"""A table in words: its heads, then its rows."""


@dataclass(frozen=True, slots=True)
class Measure:
    """How many of how many, and the share that is asked for."""

    what: str
    hits: int
    of: int
    at_least: float | None = None
    at_most: float | None = None

    @property
    def held(self) -> bool | None:
        """None where nothing is asked, or there is nothing to judge by."""
        if not self.of or (self.at_least is None and self.at_most is None):
            return None
        share = self.hits / self.of
        return (self.at_least is None or share >= self.at_least) and (self.at_most is None or share <= self.at_most)

    @property
    def asked(self) -> str:
        """In words."""
        if self.at_least is not None:
            return "all" if self.at_least == 1.0 else f"at least {self.at_least:.0%}"
        return "" if self.at_most is None else f"at most {self.at_most:.0%}" if self.at_most else "none"

    @property
    def share(self) -> str:
        """In words."""
        return f"{self.hits / self.of:.1%}" if self.of else ""


def measures(rows: Sequence[Row]) -> list[Measure]:
    """What is asked of the diagnosis, and what stands beside it."""
    one = [row for row in rows if row.kind == "one" and row.plain]
    seen = [row for row in rows if row.kind == "one" and min(row.over_limit.values(), default=0.0) >= SEEN]
    more = [row for row in rows if row.kind in ("two", "three")]
    none, strangers = _of_kind(rows, "none"), _of_kind(rows, "stranger")
    sizes = [size for row in rows for size in row.sizes.values()]
    known = [row for row in rows if row.kind != "stranger"]
    exact = [row for row in known if row.exact]
    machines = [row for row in exact if None not in row.after.values()]
    residuals = [row.residual for row in exact if row.residual is not None]
    told = [ratio for row in rows for ratio in row.detectable.values()]
    deviations = [off for row in exact for off in row.deviations.values()]
    size_deviations = [abs(size.value - size.true) / size.std for size in sizes if size.value is not None and size.std]
    return [
        _measure(f"one effect of {PLAIN:g} limits or more: named, nothing else", _exact, one, at_least=0.98),
        _measure(f"one effect of {SEEN:g} of the oracle's limits or more: named", _named, seen, at_least=0.99),
        _measure("two or three effects: exact set", _exact, more),
        _measure(f"  of these, all {PLAIN:g} limits or more", _exact,
                 (row for row in more if row.over_limit and row.plain)),
        _measure("  of these, with a gain of the dc link", _exact, (row for row in more if DC_LINK in row.classes)),
        _measure("  of these, without one", _exact, (row for row in more if DC_LINK not in row.classes), at_least=0.98),
        _measure("  or exact but for a gain of the dc link, whose range is told and holds it",
                 lambda row: row.all_told, more),
        _measure("no effect: a false name", lambda row: bool(row.false), none, at_most=0.0),
        _measure("stranger: none of these, right region", lambda row: row.stranger == "right", strangers,
                 at_least=0.95),
        _measure("stranger: none of these, wherever", lambda row: row.stranger in ("right", "elsewhere"), strangers),
        _measure("stranger: forced into a name", lambda row: row.stranger == "forced", strangers, at_most=0.01),
        _measure("sizes within 10 % or 2 standard errors", lambda size: size.right, sizes, at_least=0.95),
        _measure("  of these, told at all", lambda size: size.value is not None, sizes),
        _measure(f"machine after within {MACHINE:.1%}, all four, exact sets", _machine_right, machines),
        _measure(f"  or each within {DEVIATIONS:g} of its standard errors", _machine_told, machines, at_least=0.99),
        _measure("  before", lambda row: all(abs(off or 0.0) <= MACHINE for off in row.before.values()), machines),
        _measure(f"intervals of these, true values within {DEVIATIONS:g} standard errors", _held, deviations),
        _measure(f"intervals of sizes, true values within {DEVIATIONS:g} standard errors", _held, size_deviations),
        _measure("held-out residual within 5 % of the floor, exact sets", lambda ratio: ratio <= FLOOR, residuals,
                 at_least=1.0),
        _measure("detection limits that are told, at most twice the oracle's", lambda ratio: ratio <= 2.0, told,
                 at_least=0.8),
        _measure("a false name, strangers aside", lambda row: bool(row.false), known),
        _measure("a false verdict", lambda row: row.false_verdict, rows),
    ]  # fmt: skip


def bars(rows: Sequence[Row]) -> Cells:
    """Measures beside their bars."""
    return [("", "bar", "is", "of"), *((m.what, m.asked, m.share, str(m.of)) for m in measures(rows))]


def times(rows: Sequence[Row]) -> str:
    """How long recordings took."""
    seconds = [row.seconds for row in rows]
    return f"time of a recording: median {statistics.median(seconds):.2f} s, longest {max(seconds):.2f} s"


def by_group(rows: Sequence[Row]) -> Cells:
    """Kinds, and classes of recordings with one effect or a stranger, a measuring chain aside.

    `verdict`: false ones; `machine`: all four right where the set is exact; `residual`: median over the floor.
    """
    cells: Cells = [("", "recordings", "exact", "missed", "false", "verdict", "sizes", "machine", "residual")]
    groups: dict[str, list[Row]] = {kind: _of_kind(rows, kind) for kind in _KINDS}
    for name in POPULATIONS:
        groups[name] = [row for row in rows if row.subjects == (name,)]
    for name, group in groups.items():
        if not group:
            continue
        exact = [row for row in group if row.exact and None not in row.after.values()]
        sizes = [size.right for row in group for size in row.sizes.values()]
        residuals = [row.residual for row in group if row.residual is not None]
        cells.append((
            name, str(len(group)), _share(row.exact for row in group), _share(bool(row.missed) for row in group),
            _share(bool(row.false) for row in group), _share(row.false_verdict for row in group), _share(sizes),
            _share(map(_machine_right, exact)), f"{statistics.median(residuals):.3f}" if residuals else "",
        ))
    return cells


def counted(rows: Sequence[Row]) -> dict[str, Counter[str]]:
    """What is said of recordings with one class or none: effects named, or the verdict in brackets, in how many."""
    groups = {name: [row for row in rows if row.subjects == ((name,) if name else ())] for name in ("", *POPULATIONS)}
    return {
        name or "none": Counter(" + ".join(sorted(row.found)) or f"({row.verdict})" for row in group)
        for name, group in groups.items() if group
    }


def confusion(rows: Sequence[Row]) -> Cells:
    """What is said of recordings with one class or none, in words."""
    return [("concealed", "said"), *(
        (name, ", ".join(
            f"{count} {'right' if what == EFFECT.get(name) else what}" for what, count in said.most_common()
        ))
        for name, said in counted(rows).items()
    )]  # fmt: skip


def by_size(rows: Sequence[Row]) -> Cells:
    """How often an effect is named, by its size over its limit and the recording's number of effects."""
    cells: Cells = [("size over limit", "effects", "named", "alone", "named")]
    for low, high in pairwise(BINS):
        hits = [
            (row.kind == "one", EFFECT[name] in row.found)
            for row in rows
            for name, ratio in row.over_limit.items()
            if name in EFFECT and low <= ratio < high
        ]
        alone = [named for single, named in hits if single]
        span = f"{low:g} to {high:g}" if high < math.inf else f"above {low:g}"
        cells.append((span, str(len(hits)), _share(named for _, named in hits), str(len(alone)), _share(alone)))
    return cells


def machines(rows: Sequence[Row]) -> Cells:
    """Errors of the machine's parameters before and after, strangers aside."""
    cells: Cells = [("", "before: median", "largest", "after: median", "95 %", "largest")]
    for name in ("R_s", "L_d", "L_q", "psi_f"):
        known = [row for row in rows if row.kind != "stranger"]
        before, after = (
            sorted(abs(off) for row in known if (off := errors(row).get(name)) is not None)
            for errors in (_before, _after)
        )
        if before and after:
            cells.append((
                name, f"{statistics.median(before):.3%}", f"{before[-1]:.1%}", f"{statistics.median(after):.3%}",
                f"{after[int(0.95 * (len(after) - 1))]:.2%}", f"{after[-1]:.1%}",
            ))
    return cells


def told_limits(rows: Sequence[Row]) -> Cells:
    """Detection limits that are told, over the oracle's."""
    cells: Cells = [("limit over the oracle", "recordings", "median", "largest")]
    for name in EFFECT:
        ratios = sorted(row.detectable[name] for row in rows if name in row.detectable)
        if ratios:
            cells.append((name, str(len(ratios)), f"{statistics.median(ratios):.2f}", f"{ratios[-1]:.1f}"))
    return cells


def aligned(cells: Cells, left: int = 1) -> str:
    """Lines of text; so many columns begin at their left. Empty without rows."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "" if len(cells) < 2 else "\n".join(
        "  ".join(f"{cell:{'<' if k < left else '>'}{widths[k]}}" for k, cell in enumerate(row)).rstrip()
        for row in cells
    )


def _before(row: Row) -> Mapping[str, float | None]:
    return row.before


def _after(row: Row) -> Mapping[str, float | None]:
    return row.after


def _exact(row: Row) -> bool:
    return row.exact


def _named(row: Row) -> bool:
    return not row.missed


def _machine_right(row: Row) -> bool:
    return all(off is not None and abs(off) <= MACHINE for off in row.after.values())


def _machine_told(row: Row) -> bool:
    """Of a parameter without a standard error nothing is claimed."""
    return all(abs(off or 0.0) <= MACHINE or _held(row.deviations.get(name, 0.0)) for name, off in row.after.items())


def _held(deviation: float) -> bool:
    return deviation <= DEVIATIONS


def _of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    return [row for row in rows if row.kind == kind]


def _share(hits: Iterable[bool]) -> str:
    counted = list(hits)
    return f"{sum(counted) / len(counted):.1%}" if counted else ""


def _measure(
    what: str, is_hit: Callable[[Any], bool], among: Iterable[Any], at_least: float | None = None,
    at_most: float | None = None,
) -> Measure:  # fmt: skip
    hits = [is_hit(each) for each in among]
    return Measure(what, sum(hits), len(hits), at_least, at_most)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.score.score", description=__doc__)
    parser.add_argument("--out", type=Path, nargs="+", required=True, metavar="DIR", help="recordings")
    parser.add_argument("--answers", type=Path, nargs="+", required=True, metavar="DIR", help="their answers")
    parser.add_argument("--json", type=Path, metavar="OUT", help="a row for each recording")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="recordings by number, kind or class")
    parser.add_argument("--limits", type=Path, nargs="+", metavar="FILE", help="what the oracle said of each folder")
    parser.add_argument("--function", default=FUNCTION, metavar="MODULE:NAME", help=f"what diagnoses ({FUNCTION})")
    options = parser.parse_args()
    for name in ("answers", "limits"):
        given = getattr(options, name)
        if given is not None and len(given) != len(options.out):
            parser.error(f"--{name} takes as many as --out, {len(options.out)}, got {len(given)}")
    return options


def scored(options: argparse.Namespace, answers: Mapping[tuple[Path, str], Mapping[str, Any]]) -> list[Row]:
    """Rows of the recordings that answers are given for."""
    said: dict[tuple[Path, str], Said] = {}
    for each, heard in diagnosed(sorted(answers), options.function, options.jobs):
        said[each] = heard
        if len(said) % _EVERY == 0 or len(said) == len(answers):
            print(f"diagnosed {len(said)} of {len(answers)}", file=sys.stderr, flush=True)
    over_limit: dict[tuple[Path, str], Mapping[str, float]] = {}
    for n, folder in enumerate(options.out):
        mine = {name: answer for (out, name), answer in answers.items() if out == folder}
        found: dict[str, dict[str, float]] = {}
        if options.limits:
            found = json.loads(options.limits[n].read_text(encoding="utf-8"))
        asked = [answer for name, answer in mine.items() if answer["classes"] and name not in found]
        if asked:
            print(f"asking the oracle about {len(asked)} recordings", file=sys.stderr, flush=True)
            found |= limits(asked, options.jobs)
        over_limit |= {(folder, name): found.get(name, {}) for name in mine}
    several = len(options.out) > 1
    return [
        row_of(f"{out.name}/{name}" if several else name, truth_of(answers[out, name]), over_limit[out, name], heard)
        for (out, name), heard in sorted(said.items(), key=_place)
    ]


def _place(item: tuple[tuple[Path, str], Said]) -> tuple[Path, str]:
    return item[0]


def wanted(options: argparse.Namespace) -> dict[tuple[Path, str], dict[str, Any]]:
    """Answers by folder and recording."""
    asked = set(options.only or ())
    return {
        (out, answer["recording"]): answer
        for out, folder in zip(options.out, options.answers, strict=True)
        for answer in answers_in(folder)
        if not asked or asked & {answer["recording"], answer["kind"], *answer["classes"]}
    }


def main() -> int:
    """Print the tables."""
    options = _options()
    answers = wanted(options)
    if not answers:
        print("score: expected recordings, found none by these names", file=sys.stderr)
        return 2
    try:
        named(options.function)
    except (ImportError, AttributeError) as error:
        print(f"score: --function takes MODULE:NAME, got {options.function}: {error}", file=sys.stderr)
        return 2
    rows = scored(options, answers)
    if options.json:
        options.json.write_text(json.dumps([as_json(row) for row in rows], indent=1) + "\n", encoding="utf-8")
    tables = (
        f"{aligned(bars(rows))}\n{times(rows)}", aligned(by_group(rows)), aligned(confusion(rows), 2),
        aligned(by_size(rows)), aligned(machines(rows)), aligned(told_limits(rows)),
    )  # fmt: skip
    print("\n\n".join(table for table in tables if table))
    return 0


if __name__ == "__main__":
    sys.exit(main())
