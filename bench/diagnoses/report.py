"""A diagnosis as one HTML file that needs nothing else: sentence, findings, what to do next, pictures. It prints.

Words and their order are in `report.html.jinja`. Knows nothing of files and of how the diagnosis was found.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from bench.diagnoses import report_figures as figures
from bench.diagnoses.diagnosis_request import SETTLED
from bench.engineering import number, odds, quantity, scaled, words
from bench.machine_file import Nominal
from bench.recordings.recording import Summary
from estimator.diagnosis.answer.sentences import compares
from estimator.diagnosis.verdict import Diagnosis, Quantity
from estimator.machine import PARAMETERS, UNITS

_PARTS: Final = ("flux-map", "over-time", "map", "stretch", "spectrum", "scatter", "candidates")
_COLOUR: Final = {"ink": figures.INK, "before": figures.BEFORE, "after": figures.AFTER}


@dataclass(frozen=True, slots=True)
class _Picture:
    """A picture in its part of the page."""

    part: str
    name: str
    figure: figures.Figure
    caption: str

    @property
    def height(self) -> int:
        """px."""
        return self.figure["layout"]["height"]


def report(diagnosis: Diagnosis, recording: Summary, nominal: Nominal) -> str:
    """The page."""
    drawn = list(_pictures(diagnosis))
    plotly = (resources.files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
    content = json.dumps({one.name: one.figure for one in drawn}, allow_nan=False, separators=(",", ":"))
    return _page().render(
        title=f"Diagnosis of {Path(recording.path).name}", said=diagnosis, recording=recording, nominal=nominal,
        length=_length(recording), settled=diagnosis.verdict in SETTLED, compared=compares(diagnosis),
        explained=_explained(diagnosis), units=UNITS, width=figures.WIDTH, colour=_COLOUR,
        parameters=dict.fromkeys((*PARAMETERS, *diagnosis.machine_before, *diagnosis.machine_after)),
        pictures={part: [one for one in drawn if one.part == part] for part in _PARTS},
        plotly=Markup(plotly), drawn=Markup(content.replace("<", "\\u003c")),
    )  # fmt: skip


@cache
def _page() -> Template:
    text = (resources.files("bench.diagnoses") / "report.html.jinja").read_text(encoding="utf-8")
    made: Any = Environment(autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)  # typed by half
    made.filters.update({
        "words": words, "number": number, "odds": odds, "quantity": _number_with_unit, "told": _told, "bounds": _bounds,
    })  # fmt: skip
    return made.from_string(text)


def _pictures(said: Diagnosis) -> Iterator[_Picture]:
    if said.flux_map is not None:
        yield from _drawn("flux-map", figures.flux_map(said.flux_map),
                          "By the currents, where the recording has been. All numbers and their standard errors are in "
                          "the JSON.")
    if (traces := said.traces) is not None:
        of = f"means over {traces.periods} periods" if traces.periods > 1 else "values of single periods"
        floor = "" if traces.floor_V is None else "; dashed, what noise alone leaves of the same"
        yield from _drawn("over-time", figures.over_time(traces),
                          f"Residual of the voltage, one step ahead, as {of}, d and q together: what R_s, L_d, L_q and "
                          f"psi_f alone leave, and what is left with the effects found{floor}.")
        for k, shown in enumerate(traces.maps):
            yield _Picture("map", f"map-{k}", figures.location(shown),
                           f"Rms of the residual, as {of}, by {shown.x} and {shown.y}.")
        yield from _drawn("stretch", figures.stretch(traces),
                          f"Where the mismatch is largest: voltages one step ahead, as {of}, and currents of a free "
                          "run.")
        yield from _drawn("spectrum", figures.spectrum(traces),
                          "Amplitude density of the residual of single periods, d and q together. White noise is a "
                          "level line.")
    for k, shown in enumerate(said.scatters):
        yield _Picture("scatter", f"scatter-{k}", figures.scatter(shown),
                       f"What is missed of {shown.y} at points that took no part in the fit, by {shown.x}.")
    if said.candidates:
        yield from _drawn("candidates", figures.odds(said.candidates),
                          "Effects by their odds, alone and in the end; those chosen are marked.")


def _drawn(part: str, figure: figures.Figure | None, caption: str) -> Iterator[_Picture]:
    """A part's only picture; none where there is nothing to draw."""
    if figure is not None:
        yield _Picture(part, part, figure, caption)


def _length(recording: Summary) -> str:
    period, unit = scaled(recording.T_s, "s")
    of = "steady points" if math.isnan(recording.T_s) else f"control period {recording.T_s / period:.4g} {unit}"
    return f"{recording.duration:.4g} s, {of}" if recording.duration > 0.0 else of


def _explained(said: Diagnosis) -> float | None:
    """% of the mismatch's variance."""
    return 100.0 * said.fit.explained if said.fit is not None and math.isfinite(said.fit.explained) else None


def _number_with_unit(value: float | None, unit: str, like: float | None = None) -> str:
    return quantity(value, unit, like=like)


def _told(size: Quantity | None, like: float | None = None) -> str:
    """With its standard error."""
    return "–" if size is None else quantity(size.value, size.unit, size.std, like)


def _bounds(value: float | str | Sequence[float]) -> str:
    if isinstance(value, str):
        return words(value)
    if isinstance(value, int | float):
        return f"{value:.3g}"
    return " to ".join(f"{bound:.3g}" for bound in value)
