"""A diagnosis as one HTML file that needs nothing else: sentence, findings, what to do next, pictures. It prints.

Words and their order are in `page.html.jinja`, looks in `page.css`. Knows nothing of files and of how the diagnosis was
found.
"""

import math
from collections.abc import Sequence
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from bench.diagnoses.diagnosis_request import SETTLED
from bench.diagnoses.figures.figure import Figure
from bench.diagnoses.figures.pictures import PARTS
from bench.diagnoses.report.drawing import drawn, legend
from bench.diagnoses.report.layout import NARROW, WIDE
from bench.engineering import number, odds, quantity, scaled, words
from bench.machine_file import Nominal
from bench.recordings.recording import Summary
from estimator.diagnosis.answer.sentences import compares
from estimator.diagnosis.together.said import Shared
from estimator.diagnosis.verdict import Diagnosis, Quantity
from estimator.machine import PARAMETERS, UNITS

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'"
"""What the page may do, as a Content-Security-Policy: look as it looks, and nothing else."""


def report(diagnosis: Diagnosis, recording: Summary, nominal: Nominal, figures: Sequence[Figure]) -> str:
    """The page; `figures` are those of the diagnosis."""
    return template("page.html.jinja").render(
        title=f"Diagnosis of {Path(recording.path).name}", said=diagnosis, recording=recording, nominal=nominal,
        length=length_of(recording), settled=diagnosis.verdict in SETTLED, compared=compares(diagnosis),
        explained=_explained(diagnosis), units=UNITS, policy=POLICY, style=Markup(style()),
        parameters=dict.fromkeys((*PARAMETERS, *diagnosis.machine_before, *diagnosis.machine_after)),
        pictures={part: [one for one in figures if one.part == part] for part in PARTS},
    )  # fmt: skip


def style() -> str:
    """How a report looks: CSS."""
    return _file("page.css")


def _file(name: str) -> str:
    return (resources.files("bench.diagnoses.report") / name).read_text(encoding="utf-8")


@cache
def template(name: str) -> Template:
    """The words of a report, of this folder, with numbers as an engineer reads them."""
    made: Any = Environment(autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)  # typed by half
    made.filters.update({
        "words": words, "number": number, "odds": odds, "quantity": _number_with_unit, "told": _told, "bounds": _bounds,
        "legend": legend, "largest": _largest, "wide": partial(drawn, width=WIDE, looks="wide"),
        "narrow": partial(drawn, width=NARROW, looks="narrow"),
    })  # fmt: skip
    return made.from_string(_file(name))


def length_of(recording: Summary) -> str:
    """How long it is, and its control period, in words."""
    period, unit = scaled(recording.T_s, "s")
    of = "steady points" if math.isnan(recording.T_s) else f"control period {recording.T_s / period:.4g} {unit}"
    return f"{recording.duration:.4g} s, {of}" if recording.duration > 0.0 else of


def _explained(said: Diagnosis) -> float | None:
    """% of the mismatch's variance."""
    return 100.0 * said.fit.explained if said.fit is not None and math.isfinite(said.fit.explained) else None


def _number_with_unit(value: float | None, unit: str, like: float | None = None) -> str:
    return quantity(value, unit, like=like)


def _told(size: Quantity | None, like: float | None = None) -> str:
    """With half its 95 % interval."""
    return "–" if size is None else quantity(size.value, size.unit, size.std, like)


def _largest(number: Shared) -> float | None:
    """Of what recordings tell: all are told in its unit."""
    return max((abs(one.value) for one in number.each if one is not None and one.value is not None), default=None)


def _bounds(value: float | str | Sequence[float]) -> str:
    if isinstance(value, str):
        return words(value)
    if isinstance(value, int | float):
        return f"{value:.3g}"
    return " to ".join(f"{bound:.3g}" for bound in value)
