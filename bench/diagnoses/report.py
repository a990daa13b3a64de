"""A diagnosis as one HTML file that needs nothing else: sentence, findings, what to do next, pictures. It prints.

Knows nothing of files and of how the diagnosis was found.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Final

from bench.diagnoses import report_figures as figures
from bench.diagnoses.diagnosis_request import SETTLED
from bench.engineering import number, odds, quantity, scaled, words
from bench.machine_file import Nominal
from bench.recordings.recording import Summary
from estimator.diagnosis.answer.sentences import compares
from estimator.diagnosis.verdict import Ambiguity, Before, Diagnosis, Experiment, Finding, Fit, Place, Quantity, Range
from estimator.machine import PARAMETERS, UNITS

_STYLE: Final = f"""
@page {{ size: A4; margin: 14mm; }}
* {{ box-sizing: border-box; }}
html {{ background: #fff; -webkit-print-color-adjust: exact; print-color-adjust: exact; }}
body {{ width: {figures.WIDTH}px; margin: 28px auto 60px; color: {figures.INK};
  font: 14px/1.45 Helvetica, Arial, sans-serif; overflow-wrap: anywhere; }}
h1 {{ font-size: 20px; margin: 0 0 2px; }}
h2 {{ font-size: 15.5px; margin: 30px 0 6px; border-bottom: 1px solid #d5d8de; padding-bottom: 3px;
  break-after: avoid; }}
h3 {{ font-size: 14px; margin: 14px 0 2px; break-after: avoid; }}
p {{ margin: 6px 0; }}
.muted, figcaption {{ color: #636a75; font-size: 12.5px; }}
.verdict {{ display: inline-block; margin: 12px 0 0; padding: 3px 10px; border-radius: 4px; font-weight: 700;
  color: #fff; background: {figures.BEFORE}; }}
.verdict.settled {{ background: {figures.AFTER}; }}
.sentence {{ font-size: 17px; line-height: 1.4; margin: 10px 0 14px; }}
table {{ border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; margin: 6px 0; }}
th {{ text-align: left; font-weight: 600; color: #636a75; font-size: 12.5px; }}
th, td {{ padding: 4px 12px 4px 0; border-bottom: 1px solid #e4e6ea; vertical-align: top; }}
tr, figure, .keep {{ break-inside: avoid; }}
.whole {{ white-space: nowrap; }}
td.n, th.n {{ text-align: right; white-space: nowrap; }}
td.name {{ white-space: nowrap; }}
.before {{ color: {figures.BEFORE}; }}
.after {{ color: {figures.AFTER}; }}
figure {{ margin: 8px 0 0; }}
figcaption {{ margin: 2px 0 0; }}
ul {{ margin: 6px 0; padding-left: 20px; }}
@media print {{ body {{ margin: 0; }} h2 {{ margin-top: 22px; }} }}
"""
_DRAW: Final = """
for (const [id, figure] of Object.entries(JSON.parse(document.getElementById("figures").textContent)))
  Plotly.newPlot(id, figure.data, figure.layout, {displayModeBar: false});
"""


def report(diagnosis: Diagnosis, recording: Summary, nominal: Nominal) -> str:
    """The page."""
    pictures: dict[str, figures.Figure] = {}
    body = "".join(_sections(diagnosis, recording, nominal, pictures))
    title = f"Diagnosis of {Path(recording.path).name}"
    plotly = (resources.files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
    drawn = json.dumps(pictures, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body><header><h1>{escape(title)}</h1>"
        f"{_about(recording)}</header>\n{body}\n<script>{plotly}</script>\n"
        f'<script type="application/json" id="figures">{drawn}</script>\n<script>{_DRAW}</script></body></html>\n'
    )


def _about(recording: Summary) -> str:
    period, unit = scaled(recording.T_s, "s")
    of = "steady points" if math.isnan(recording.T_s) else f"control period {recording.T_s / period:.4g} {unit}"
    length = f"{recording.duration:.4g} s, " if recording.duration > 0.0 else ""
    return (
        f'<p class="muted">{escape(recording.path)}: {recording.used} of {recording.rows} rows used, {length}{of}</p>'
    )


def _sections(
    said: Diagnosis, recording: Summary, nominal: Nominal, pictures: dict[str, figures.Figure]
) -> Iterator[str]:
    def picture(name: str, figure: figures.Figure | None, caption: str) -> str:
        if figure is None:
            return ""
        pictures[name] = figure
        style = f"width:{figures.WIDTH}px;height:{figure['layout']['height']}px"
        return f'<figure><div id="{name}" style="{style}"></div><figcaption>{escape(caption)}</figcaption></figure>'

    settled = " settled" if said.verdict in SETTLED else ""
    yield f'<div class="verdict{settled}">{escape(words(said.verdict))}</div>'
    yield f'<p class="sentence">{escape(said.sentence)}</p>'
    if said.fit is not None:
        yield _fit(said.fit, compared=compares(said))
    if said.findings:
        yield _section("What was left out", _findings(said.findings))
    if said.flux_map is not None:
        yield _section("Flux linkages", picture(
            "flux-map", figures.flux_map(said.flux_map),
            "By the currents, where the recording has been. All numbers and their standard errors are in the JSON.",
        ))
    if said.unexplained is not None:
        left = said.unexplained
        told = f"{escape(left.description)}: {quantity(left.rms_V, 'V')} rms"
        yield _section("What is unexplained", f"<p>{told}.</p><p>{_where(left.where)}</p>")
    if said.ambiguous:
        yield _section("What cannot be told, and what would tell", "".join(map(_ambiguity, said.ambiguous)))
    if said.experiment is not None and all(doubt.experiment != said.experiment for doubt in said.ambiguous):
        yield _section("What to record instead", f"<p>{_experiment(said.experiment)}</p>")
    if said.remarks:
        yield _section("Remarks on the recording", _list(said.remarks))
    if (traces := said.traces) is not None:
        of = _means(traces.periods)
        yield _section("The mismatch in time", picture(
            "over-time", figures.over_time(traces),
            f"Residual of the voltage, one step ahead, as {of}, d and q together: what R_s, L_d, L_q and psi_f alone "
            "leave, and what is left with the effects found"
            f"{'' if traces.floor_V is None else '; dotted, what noise alone leaves of the same'}.",
        ))
        if traces.maps:
            maps = [
                picture(f"map-{k}", figures.location(shown),
                        f"Rms of the residual, as {of}, by {shown.x} and {shown.y}.")
                for k, shown in enumerate(traces.maps)
            ]
            yield _section("Where it is", "".join(maps))
        yield _section("A short stretch", picture(
            "stretch", figures.stretch(traces),
            f"Where the mismatch is largest: voltages one step ahead, as {of}, and currents of a free run.",
        ))
        yield _section("By frequency", picture(
            "spectrum", figures.spectrum(traces),
            "Amplitude density of the residual of single periods, d and q together. White noise is a level line.",
        ))
    yield _section("Point by point", "".join(
        picture(f"scatter-{k}", figures.scatter(shown), f"What is missed of {shown.y} at points that took no part in "
                f"the fit, by {shown.x}.") for k, shown in enumerate(said.scatters)
    ))
    if said.candidates:
        yield _section("What was considered", picture(
            "candidates", figures.odds(said.candidates),
            "Effects by their odds, alone and in the end; those chosen are marked.",
        ))
    if said.machine_before or said.machine_after:
        yield _section("Parameters", _parameters(said, nominal))
    if said.detectable:
        yield _section("What would have been seen", _detectable(said.detectable))
    yield _section("The recording", _sources(recording))


def _means(periods: int) -> str:
    return f"means over {periods} periods" if periods > 1 else "values of single periods"


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>\n" if body else ""


def _fit(fit: Fit, *, compared: bool) -> str:
    """How well it follows; `compared`: before and after are of two models."""

    def row(what: str, before: str, after: str, floor: str = "") -> str:
        first = before if compared else "–"
        cells = f'<td class="n before">{first}</td><td class="n after">{after}</td><td class="n">{floor}</td>'
        return f"<tr><td>{what}</td>{cells}</tr>"

    def both(what: str, value: Before, unit: str) -> str:
        cells = [quantity(v, unit, like=value.before) for v in (value.before, value.after, value.noise_floor)]
        return row(what, cells[0], cells[1], cells[2] if value.noise_floor is not None else "")

    loo = fit.leave_one_out
    whiteness = number(fit.whiteness.before), number(fit.whiteness.after)
    held_out = "stretches that took no part in the fit" if fit.held_out else "the rows it was fitted on"
    if loo is not None:
        held_out = f"rows that took no part in the fit: one {loo.left_out} at a time, {loo.groups} in all"
    explained = "the voltages and currents are the recording's once its convention is undone"
    if compared:
        share = number(100 * fit.explained if math.isfinite(fit.explained) else None)
        explained = f"{share} % of the mismatch's variance is explained"
    return (
        '<table class="keep"><tr><th>Residual, rms</th><th class="n">before</th><th class="n">after</th>'
        '<th class="n">noise floor</th></tr>'
        + both("voltage, one step ahead" if loo is None else "voltage", fit.one_step_rms_V, "V")
        + (both("current, free run", fit.free_run_rms_A, "A") if loo is None else "")
        + (row("its power at low frequencies (white: 1)", *whiteness) if loo is None else "")
        + ("" if loo is None else "".join(
            row(f"with {escape(words(name))}", "", quantity(rms, loo.unit)) for name, rms in loo.alternatives.items()
        ))
        + f'</table><p class="muted">Judged on {held_out}; {explained}.</p>'
    )


def _findings(findings: Sequence[Finding]) -> str:
    rows = "".join(
        f"<tr><td><strong>{escape(words(finding.effect))}</strong></td><td>{_sizes(finding.parameters)}</td>"
        f"<td>{_where(finding.where)}</td><td>{_rivals(finding)}</td></tr>"
        for finding in findings
    )
    return (
        '<table><tr><th style="width:20%">Effect</th><th style="width:30%">Size ± standard error</th>'
        f'<th style="width:30%">Where it acts</th><th>Odds against rivals</th></tr>{rows}</table>'
    )


def _sizes(parameters: Mapping[str, Quantity]) -> str:
    return "<br>".join(
        f'{escape(words(name))} <span class="whole">{_quantity(size)}</span>' for name, size in parameters.items()
    )


def _rivals(finding: Finding) -> str:
    rivals = "".join(f"<br>{escape(words(rival.effect))} {odds(rival.odds)}" for rival in finding.rivals[:3])
    return f"next {odds(finding.odds_against_next)}<span class=\"muted\">{rivals}</span>"


def _where(place: Place) -> str:
    region = ", ".join(f"{words(name)} {_bounds(value)}" for name, value in place.region.items())
    if place.energy_share == place.samples_share == 1.0:  # everywhere, as the sentence says
        return escape(place.sentence)
    shares = (
        f"{number(100 * place.energy_share, digits=2)} % of the mismatch's energy in "
        f"{number(100 * place.samples_share, digits=2)} % of the rows"
    )
    return f'{escape(place.sentence)}<br><span class="muted">{escape(region)}{": " if region else ""}{shares}</span>'


def _bounds(value: float | str | Sequence[float]) -> str:
    if isinstance(value, str):
        return words(value)
    if isinstance(value, int | float):
        return f"{value:.3g}"
    return " to ".join(f"{bound:.3g}" for bound in value)


def _ambiguity(ambiguity: Ambiguity) -> str:
    effects = (" or " if ambiguity.rivals else " and ").join(words(effect) for effect in ambiguity.effects)
    return (
        f'<div class="keep"><h3>{escape(effects[:1].upper() + effects[1:])}?</h3><p>{escape(ambiguity.reason)}</p>'
        f"<p><strong>To tell:</strong> {_experiment(ambiguity.experiment)}</p></div>"
    )


def _experiment(experiment: Experiment) -> str:
    settings = {
        "speed": (experiment.speeds_rpm, "rpm"), "i_d": (experiment.i_d, "A"), "i_q": (experiment.i_q, "A"),
        "for": ((experiment.duration,) if experiment.duration else (), "s"),
    }  # fmt: skip
    said = "; ".join(
        f"{name} {', '.join(f'{value:.4g}' for value in values)} {unit}"
        for name, (values, unit) in settings.items() if values
    )
    return f'{escape(experiment.sentence)}<br><span class="muted">{escape(said)}</span>'


def _parameters(said: Diagnosis, nominal: Nominal) -> str:
    names = dict.fromkeys((*PARAMETERS, *said.machine_before, *said.machine_after))
    rows = ""
    for name in names:
        given = nominal.given.get(name)
        done = "<br>".join(
            f"{_signed(f.absorbed_as[name], UNITS.get(name, ''), given)} by {escape(words(f.effect))}"
            for f in said.findings if name in f.absorbed_as
        )
        rows += (
            f'<tr><td class="name">{escape(name)}</td><td class="n">{quantity(given, UNITS.get(name, ""))}</td>'
            f'<td class="n before">{_quantity(said.machine_before.get(name), given)}</td>'
            f'<td class="n after">{_quantity(said.machine_after.get(name), given)}</td><td>{done}</td></tr>'
        )
    return (
        '<table class="keep"><tr><th></th><th class="n">nominal</th><th class="n">before ± s. e.</th>'
        f'<th class="n">after ± s. e.</th><th>what was read into it</th></tr>{rows}</table>'
        f"{_scales(said.scales)}"
    )


def _scales(scales: Mapping[str, Range]) -> str:
    """What no recording tells."""
    if not scales:
        return ""
    each = " or ".join(f"all {what} as {x.least:.3f} to {x.most:.3f}" for what, x in scales.items())
    return (
        '<p class="muted">These rest on what the drive reads. By the nominal values it may read '
        f"{each} times what they are: no recording tells, and the parameters are off by that. R_s by a meter would.</p>"
    )


def _detectable(detectable: Mapping[str, Quantity]) -> str:
    rows = "".join(
        f'<tr><td>{escape(words(effect))}</td><td class="n">{_quantity(size)}</td></tr>'
        for effect, size in detectable.items()
    )
    return (
        '<p class="muted">The smallest size of each effect that this recording would have shown at 99 % power.</p>'
        f"<table>{rows}</table>"
    )


def _sources(recording: Summary) -> str:
    return f'<p class="muted">{escape("; ".join(f"{name}: {told}" for name, told in recording.sources.items()))}</p>'


def _list(items: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>"


def _quantity(size: Quantity | None, like: float | None = None) -> str:
    return "–" if size is None else escape(quantity(size.value, size.unit, size.std, like))


def _signed(value: float, unit: str, like: float | None) -> str:
    return ("+" if value > 0 else "") + quantity(value, unit, like=like)
