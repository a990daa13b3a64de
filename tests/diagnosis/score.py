"""The score of the diagnosis on concealed suites, beside the bars it is to meet.

`python -m tests.diagnosis.score --out DIR --answers DIR [--json OUT] [--jobs N] [--only NAME ...] [--limits FILE ...]`

Recordings are diagnosed in processes that are told the recordings' folder; the answers are opened afterwards. Several
suites: several folders to --out and --answers. What the oracle says takes longer than the diagnosis: `--limits` takes
it from files of `tests.diagnosis.oracle --json`.
"""

import argparse
import json
import math
import statistics
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from emulator.conceal.populations import POPULATIONS
from tests.diagnosis.diagnosed import Said, diagnosed, named
from tests.diagnosis.oracle import answers_in, limits
from tests.diagnosis.rows import FLOOR, MACHINE, PLAIN, Row, as_json, row_of
from tests.diagnosis.truth import EFFECT, truth_of

FUNCTION: Final = "estimator.mismatch.diagnose:diagnose"
_BINS: Final = (0.0, 1.0, 2.0, 3.0, 5.0, 10.0, math.inf)  # size over limit
_EVERY: Final = 20  # recordings, between lines of progress
_KINDS: Final = ("none", "one", "two", "three", "stranger")


def bars(rows: Sequence[Row]) -> str:
    """Measures beside their bars."""
    one = [row for row in rows if row.kind == "one" and row.plain]
    more = [row for row in rows if row.kind in ("two", "three")]
    none, strangers = _of_kind(rows, "none"), _of_kind(rows, "stranger")
    sizes = [size for row in rows for size in row.sizes.values()]
    known = [row for row in rows if row.kind != "stranger"]
    exact = [row for row in known if row.exact]
    machines = [row for row in exact if None not in row.after.values()]
    residuals = [row.residual for row in exact if row.residual is not None]
    told = [ratio for row in rows for ratio in row.detectable.values()]
    lines = [
        _bar(f"one effect of {PLAIN:g} limits or more: named, nothing else", "97 %", _exact, one),
        _bar("two or three effects: exact set", "88 %", _exact, more),
        _bar(f"  of these, all {PLAIN:g} limits or more", "", _exact, (row for row in more if row.plain)),
        _bar("no effect: a false name", "<= 1 %", lambda row: bool(row.found), none),
        _bar("stranger: none of these, right region", "95 %", lambda row: row.stranger == "right", strangers),
        _bar("stranger: none of these, wherever", "", lambda row: row.stranger in ("right", "elsewhere"), strangers),
        _bar("stranger: forced into a name", "<= 2 %", lambda row: row.stranger == "forced", strangers),
        _bar("sizes within 10 % or 2 standard errors", "95 %", lambda size: size.right, sizes),
        _bar("  of these, told at all", "", lambda size: size.value is not None, sizes),
        _bar(f"machine after within {MACHINE:.1%}, all four, exact sets", "", _machine_right, machines),
        _bar("  before", "", lambda row: all(abs(off or 0.0) <= MACHINE for off in row.before.values()), machines),
        _bar("held-out residual within 5 % of the floor, exact sets", "", lambda ratio: ratio <= FLOOR, residuals),
        _bar("detection limit at most twice the oracle's", "", lambda ratio: ratio <= 2.0, told),
        _bar("a false name, strangers aside", "", lambda row: bool(row.false), known),
        _bar("a false verdict", "", lambda row: row.false_verdict, rows),
    ]  # fmt: skip
    seconds = [row.seconds for row in rows]
    lines.append(f"time of a recording: median {statistics.median(seconds):.2f} s, longest {max(seconds):.2f} s")
    return "\n".join([f"{'':66}{'bar':>8}{'is':>9}{'of':>6}", *lines])


def by_group(rows: Sequence[Row]) -> str:
    """Kinds, and classes of recordings with one effect or a stranger."""
    lines = [
        f"{'':22}{'recordings':>11}{'exact':>8}{'missed':>8}{'false':>8}{'verdict':>9}"
        f"{'sizes':>8}{'machine':>9}{'residual':>10}"
    ]
    groups: dict[str, list[Row]] = {kind: _of_kind(rows, kind) for kind in _KINDS}
    for name in POPULATIONS:
        groups[name] = [row for row in rows if row.classes == (name,)]
    for name, group in groups.items():
        if not group:
            continue
        exact = [row for row in group if row.exact and None not in row.after.values()]
        sizes = [size.right for row in group for size in row.sizes.values()]
        residuals = [row.residual for row in group if row.residual is not None]
        lines.append(
            f"{name:22}{len(group):11}{_share(row.exact for row in group):>8}"
            f"{_share(bool(row.missed) for row in group):>8}{_share(bool(row.false) for row in group):>8}"
            f"{_share(row.false_verdict for row in group):>9}{_share(sizes):>8}"
            f"{_share(map(_machine_right, exact)):>9}"
            f"{f'{statistics.median(residuals):.3f}' if residuals else '':>10}"
        )
    lines.append("verdict: false ones; machine: all four right where the set is exact; residual: median over the floor")
    return "\n".join(lines)


def confusion(rows: Sequence[Row]) -> str:
    """What is said of recordings with one class: effects named, in how many; verdicts where none is."""
    lines: list[str] = []
    for name in ("none", *POPULATIONS):
        group = [row for row in rows if row.classes == (() if name == "none" else (name,))]
        if not group:
            continue
        said = Counter(" + ".join(sorted(row.found)) or f"({row.verdict})" for row in group)
        told = ", ".join(
            f"{count} {'right' if what == EFFECT.get(name) else what}" for what, count in said.most_common()
        )
        lines.append(f"{name:22}{told}")
    return "\n".join(lines)


def by_size(rows: Sequence[Row]) -> str:
    """How often an effect is named, by its size over its limit and the recording's number of effects."""
    lines = [f"{'size over limit':22}{'effects':>8}{'named':>8}{'alone':>8}{'named':>8}"]
    for low, high in pairwise(_BINS):
        hits = [
            (row.kind == "one", EFFECT[name] in row.found)
            for row in rows
            for name, ratio in row.over_limit.items()
            if name in EFFECT and low <= ratio < high
        ]
        alone = [named for single, named in hits if single]
        span = f"{low:g} to {high:g}" if high < math.inf else f"above {low:g}"
        lines.append(
            f"{span:22}{len(hits):8}{_share(named for _, named in hits):>8}{len(alone):8}{_share(alone):>8}"
        )
    return "\n".join(lines)


def machines(rows: Sequence[Row]) -> str:
    """Errors of the machine's parameters before and after, strangers aside."""
    lines = [f"{'':10}{'before: median':>16}{'largest':>10}{'after: median':>16}{'95 %':>10}{'largest':>10}"]
    for name in ("R_s", "L_d", "L_q", "psi_f"):
        known = [row for row in rows if row.kind != "stranger"]
        before, after = (
            sorted(abs(off) for row in known if (off := errors(row).get(name)) is not None)
            for errors in (_before, _after)
        )
        if before and after:
            lines.append(
                f"{name:10}{statistics.median(before):16.3%}{before[-1]:10.1%}{statistics.median(after):16.3%}"
                f"{after[int(0.95 * (len(after) - 1))]:10.2%}{after[-1]:10.1%}"
            )
    return "\n".join(lines)


def told_limits(rows: Sequence[Row]) -> str:
    """Detection limits that are told, over the oracle's."""
    lines = [f"{'limit over the oracle':22}{'recordings':>11}{'median':>9}{'largest':>9}"]
    for name in EFFECT:
        ratios = sorted(row.detectable[name] for row in rows if name in row.detectable)
        if ratios:
            lines.append(f"{name:22}{len(ratios):11}{statistics.median(ratios):9.2f}{ratios[-1]:9.1f}")
    return "\n".join(lines) if len(lines) > 1 else ""


def _before(row: Row) -> Mapping[str, float | None]:
    return row.before


def _after(row: Row) -> Mapping[str, float | None]:
    return row.after


def _exact(row: Row) -> bool:
    return row.exact


def _machine_right(row: Row) -> bool:
    return all(off is not None and abs(off) <= MACHINE for off in row.after.values())


def _of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    return [row for row in rows if row.kind == kind]


def _share(hits: Iterable[bool]) -> str:
    counted = list(hits)
    return f"{sum(counted) / len(counted):.1%}" if counted else ""


def _bar(what: str, bar: str, is_hit: Callable[[Any], bool], among: Iterable[Any]) -> str:
    hits = [is_hit(each) for each in among]
    return f"{what:66}{bar:>8}{_share(hits):>9}{len(hits):6}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.diagnosis.score", description=__doc__)
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
    tables = (bars(rows), by_group(rows), confusion(rows), by_size(rows), machines(rows), told_limits(rows))
    print("\n\n".join(table for table in tables if table))
    return 0


if __name__ == "__main__":
    sys.exit(main())
