"""A commissioning as one HTML file that needs nothing else. Knows nothing of how it was done.

What it is made of are the results of its jobs, as `results` has them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import resources
from typing import Any, Final

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from bench.diagnoses.diagnosis_request import SETTLED
from bench.diagnoses.figures.figure import Axis, Figure, Panel, Role, Trace
from bench.diagnoses.report.drawing import drawn, legend
from bench.diagnoses.report.layout import NARROW, WIDE
from bench.diagnoses.report.page import POLICY, style
from bench.engineering import quantity, scaled, words
from bench.parameters.parameter_set import FLASHED, OK, ParameterSet, of_toml
from drivers.wire.dictionary import TABLE_SIZE
from estimator.machine import PARAMETERS

NAMES: Final = {"speed": "speed", "d": "current, d axis", "q": "current, q axis"}
_HIGHEST: Final = 1.3  # of the step, that a picture shows


def report(
    drive: str, when: str, identified: Mapping[str, Any], verified: Mapping[str, Any] | None = None,
    first: Mapping[str, Any] | None = None,
) -> str:  # fmt: skip
    """The page of a drive's commissioning; `when`: a sentence of when, and whether it was flashed."""
    told, responses = identified["diagnosis"], dict[Role, Mapping[str, Any]]({"before": identified["responses"]})
    if verified is not None:
        responses["after"] = verified["responses"]
    responses["promised"] = (verified or identified).get("promises", {})  # older ones have none
    again = "tried again" if verified is not None and verified.get("lacks") else "after"
    called = {"after": again, "promised": f"promised, {'before' if verified is None else again}"}
    return _template().render(
        title=f"Commissioning of {drive}", when=when, verdict=words(str(told["verdict"])), sentence=told["sentence"],
        settled=told["verdict"] in SETTLED, first=first, machine=identified["machine"], shaft=identified["shaft"],
        parameters=PARAMETERS, before=identified["loops"], after=[] if verified is None else verified["loops"],
        names=NAMES, remarks=identified["remarks"], sets=_sets(identified, first), policy=POLICY,
        style=Markup(style()), again=again,
        figures=[one for name in NAMES if (one := _figure(name, responses, called)) is not None],
    )  # fmt: skip


def _figure(name: str, responses: Mapping[Role, Mapping[str, Any]], called: Mapping[str, str]) -> Figure | None:
    """A loop's mean steps."""
    there = dict[Role, Any]({role: told[name] for role, told in responses.items() if name in told})
    if not there:
        return None
    longest = max(one["t"][-1] for one in there.values())
    by, unit = scaled(longest, "s")
    x = Axis("time from the step", unit, -0.1 * longest / by, longest / by)
    traces = list[Trace]()
    for role, one in there.items():
        points = [(t / by, y) for t, y in zip(one["t"], one["y"], strict=True) if t / by >= x.low]
        name_of = called.get(role, role)
        traces.append(Trace(name_of, role, "line", tuple(t for t, _ in points), tuple(y for _, y in points)))
    y = Axis("share of the step", "", -0.1, max(_HIGHEST, *(max(one["y"]) for one in there.values())))
    caption = f"The mean step of the {NAMES[name]}."
    return Figure("loops", f"step-{name}", "The loops", caption, (Panel(NAMES[name], x, y, tuple(traces)),))


@dataclass(frozen=True, slots=True)
class _Set:
    """A set as a table, each row its signal, value before and in the set, interval and what it is from."""

    title: str
    whose: str
    rows: Sequence[tuple[str, str, str, str, str]]


def _sets(identified: Mapping[str, Any], first: Mapping[str, Any] | None) -> list[_Set]:
    """What a first start proposed, and what the identification did."""
    told = ([] if first is None else [first]) + [identified]
    return [_set(of_toml(one["set"], "the set"), one.get("present", {})) for one in told if one["set"]]


def _set(given: ParameterSet, present: Mapping[str, float]) -> _Set:
    rows = list[tuple[str, str, str, str, str]]()
    for signal in FLASHED:
        entry = given.entries.get(signal.name)
        if entry is None or (signal.table and not signal.name.endswith("_1")):
            continue
        unit = "" if signal.unit == "1" else f" {signal.unit}"
        source = "; ".join(filter(None, ("" if entry.status == OK else entry.status, entry.source, entry.note)))
        if signal.table:
            rows.append((signal.name.removesuffix("_1"), "", f"{TABLE_SIZE} entries", "", source))
            continue
        interval = "" if entry.low is None or entry.high is None else f"{entry.low:.6g} to {entry.high:.6g}"
        before = f"{present[signal.name]:.9g}{unit}" if signal.name in present else ""
        rows.append((signal.name, before, f"{entry.value:.9g}{unit}", interval, source))
    whose = [] if given.serial is None else [f"serial number 0x{given.serial:08X}"]
    whose += [] if given.layout_id is None else [f"layout 0x{given.layout_id:08X}"]
    title = f"{given.name}, version {given.version}"
    return _Set(title, f"Of the drive with {' and '.join(whose)}." if whose else "Of any drive.", rows)


def share(value: float | None) -> str:
    """Of a step."""
    return "–" if value is None or not math.isfinite(value) else f"{100.0 * value:.1f} %"


def time(value: float | None) -> str:
    """That a loop takes to settle; None: it does not."""
    return "not yet" if value is None else quantity(value, "s")


@cache
def _template() -> Template:
    made: Any = Environment(autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)  # typed by half
    made.filters.update({
        "words": words, "quantity": quantity, "share": share, "time": time, "legend": legend,
        "wide": partial(drawn, width=WIDE, looks="wide"), "narrow": partial(drawn, width=NARROW, looks="narrow"),
    })  # fmt: skip
    text = (resources.files("bench.commissioning") / "report.html.jinja").read_text(encoding="utf-8")
    return made.from_string(text)
