"""The pictures of a report, as plotly takes them. One colour for before, one for after, throughout.

Knows nothing of HTML. A figure is `{"data": [...], "layout": {...}}`; what is not finite is left out of it.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.engineering import words
from estimator.diagnosis.verdict import Candidate, FluxTable, Map, Scatter, Traces

BEFORE: Final = "#c8571b"
AFTER: Final = "#14708c"
QUIET: Final = "#8a8f98"
INK: Final = "#22262e"
_LINES: Final = "#e4e6ea"
_SHADES: Final = ("#262d4d", "#4d5678", "#14708c", "#3f9c8f", "#a87b2d", "#c8571b")  # of levels, one after the other
_MAP: Final = [[0.0, "#f7f8fa"], [0.35, "#c9cedb"], [0.7, "#6d7795"], [1.0, "#262d4d"]]
WIDTH: Final = 680  # px: an A4 page between its margins
_MOST_LOG_ODDS: Final = 12.0
_DIGITS: Final = 5
_POINTS: Final = 4000  # of a line: more than a page shows

Figure = dict[str, Any]
Values = NDArray[np.float64]


def over_time(traces: Traces) -> Figure:
    """The mismatch over the recording, beside what noise leaves of the same means."""
    data = [
        _line(traces.t, traces.before_V, "before", BEFORE, width=1.6),
        _line(traces.t, traces.after_V, "after", AFTER, width=1.6),
    ]
    if traces.floor_V is not None and math.isfinite(traces.floor_V) and len(traces.t):
        ends = traces.t[[0, -1]]
        data.append(_line(ends, np.full(2, traces.floor_V), "noise floor", INK, width=1, dash="dot"))
    return _figure(data, 250, xaxis=_axis("time, s"), yaxis=_axis("residual, V rms", rangemode="tozero"))


def scatter(shown: Scatter) -> Figure:
    """Residuals point by point."""
    marks = ((shown.before_V, "before", BEFORE, 5), (shown.after_V, "after", AFTER, 4))
    data = [
        _line(shown.of_x, values, name, colour, width=1.0)
        | {"mode": "markers", "marker": {"color": colour, "size": size}}
        for values, name, colour, size in marks
    ]
    return _figure(data, 240, xaxis=_axis(shown.x), yaxis=_axis(f"left out: {shown.y}, V", zeroline=True))


def location(shown: Map) -> Figure:
    """Where the mismatch is, before and after, on one scale."""
    most = max((float(np.nanmax(z)) for z in (shown.before_V, shown.after_V) if np.isfinite(z).any()), default=1.0)

    def heat(z: Values, place: str) -> dict[str, Any]:
        return {
            "type": "heatmap", "x": _numbers(shown.x_edges), "y": _numbers(shown.y_edges),
            "z": [_numbers(row) for row in z], "coloraxis": "coloraxis", "xaxis": f"x{place}", "yaxis": f"y{place}",
            "hovertemplate": "%{x:.4g}, %{y:.4g}: %{z:.3g} V<extra></extra>", "hoverongaps": False,
        }

    return _figure(
        [heat(shown.before_V, ""), heat(shown.after_V, "2")], 290,
        xaxis=_axis(shown.x, domain=[0.0, 0.46], showgrid=False),
        xaxis2=_axis(shown.x, domain=[0.54, 1.0], showgrid=False),
        yaxis=_axis(shown.y, showgrid=False), yaxis2=_axis("", anchor="x2", matches="y", showgrid=False),
        coloraxis={"colorscale": _MAP, "cmin": 0.0, "cmax": _rounded(most) or 1.0,
                   "colorbar": {"title": {"text": "V rms", "side": "right"}, "thickness": 10, "outlinewidth": 0}},
        annotations=[_caption("before", BEFORE, 0.23), _caption("after", AFTER, 0.77)], showlegend=False,
        margin={"l": 72, "r": 10, "t": 26, "b": 42},
    )  # fmt: skip


def flux_map(told: FluxTable) -> Figure:
    """Flux linkages, each over its own axis' current at some currents of the other."""
    side = np.arange(len(told.i_q)) >= len(told.i_q) // 2  # the map is the same for either sign
    panels = (told.i_d, told.psi_d[:, side], told.i_q[side], ""), (told.i_q, told.psi_q.T, told.i_d, "2")
    data: list[dict[str, Any]] = []
    for x, psi, others, place in panels:
        on = {"xaxis": f"x{place}", "yaxis": f"y{place}", "showlegend": False}
        at = np.flatnonzero(np.isfinite(psi).sum(axis=0) > 1)
        at = at[:: max(1, -(-len(at) // len(_SHADES)))]
        for colour, k in zip(_SHADES, at, strict=False):
            level, end = f"{round(float(others[k]), 6) + 0.0:.3g} A", np.flatnonzero(np.isfinite(psi[:, k]))[-1:]
            data.append(_line(x, psi[:, k], level, colour, width=1.6) | on)
            if k in at[[0, -1]]:
                data.append(_line(x[end], psi[end, k], level, colour, width=1.0) | on | {
                    "mode": "text", "text": [level], "textposition": "middle right", "cliponaxis": False,
                    "textfont": {"color": colour, "size": 10},
                })  # fmt: skip
    return _figure(
        data, 300, xaxis=_axis("i_d, A, at some i_q", domain=[0.0, 0.44]),
        xaxis2=_axis("i_q, A, at some i_d", domain=[0.56, 0.96]),
        yaxis=_axis("psi_d, Vs"), yaxis2=_axis("psi_q, Vs", anchor="x2"),
    )  # fmt: skip


def stretch(traces: Traces) -> Figure | None:
    """A short stretch: residual voltages, and currents beside a free run; None where there is none."""
    panels = [(name, "residual ", "V") for name in traces.window] + [(name, "", "A") for name in traces.window_i]
    if not panels or not len(traces.window_t):
        return None
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    share = 1.0 / len(panels)
    t = traces.window_t
    for place, (name, prefix, unit) in enumerate(panels):
        number = "" if place == 0 else str(place + 1)
        on = {"xaxis": "x", "yaxis": f"y{number}"}
        if name in traces.window:
            lines = list(zip(traces.window[name], ("before", "after"), (BEFORE, AFTER), strict=True))
        else:
            measured, before, after = traces.window_i[name]
            lines = [(measured, "measured", QUIET), (before, "before", BEFORE), (after, "after", AFTER)]
        for values, label, colour in lines:
            first = label not in {line["name"] for line in data}
            width = 2.6 if label == "measured" else 1.1
            data.append(_line(t, values, label, colour, width=width) | on | {"showlegend": first})
        top = 1.0 - place * share
        axes[f"yaxis{number}"] = _axis(f"{prefix}{name}, {unit}", domain=[top - share * 0.86, top], zeroline=True)
    last = "" if len(panels) == 1 else str(len(panels))
    return _figure(data, 90 + 120 * len(panels), xaxis=_axis("time, s", anchor=f"y{last}"), **axes)


def spectrum(traces: Traces) -> Figure | None:
    """The residual by frequency; None where there is none."""
    if not len(traces.frequency):
        return None
    before, after = traces.spectrum
    data = [
        _line(traces.frequency, before, "before", BEFORE, width=1.2),
        _line(traces.frequency, after, "after", AFTER, width=1.2),
    ]
    y = _axis("residual, V/√Hz", type="log", exponentformat="power", dtick=1)
    return _figure(data, 260, xaxis=_axis("frequency, Hz"), yaxis=y, margin={"l": 72, "r": 16, "t": 30, "b": 42})


def odds(candidates: Sequence[Candidate]) -> Figure:
    """Candidates by how much they help, alone and in the end; the likeliest on top."""
    rows = list(candidates)[::-1]
    names = [("<b>✓ " + words(c.effect) + "</b>") if c.chosen else words(c.effect) for c in rows]
    colours = [AFTER if c.chosen else "#c3c7ce" for c in rows]

    def bars(values: Sequence[float], place: str) -> dict[str, Any]:
        held = [max(-_MOST_LOG_ODDS, min(_MOST_LOG_ODDS, v)) if not math.isnan(v) else None for v in values]
        return {
            "type": "bar", "orientation": "h", "y": names, "x": [None if v is None else _rounded(v) for v in held],
            "marker": {"color": colours}, "xaxis": f"x{place}", "yaxis": f"y{place}",
            "hovertemplate": "%{y}: odds 10<sup>%{x:.3g}</sup><extra></extra>",
        }

    ticks = [-12, -6, 0, 6, 12]
    told = ["≤10<sup>−12</sup>", "10<sup>−6</sup>", "1", "10<sup>6</sup>", "≥10<sup>12</sup>"]

    def axis(title: str, domain: list[float]) -> dict[str, Any]:
        axis = _axis(title, domain=domain, range=[-13, 13], tickvals=ticks, ticktext=told, zeroline=True)
        return axis | {"tickfont": {"size": 11}}

    return _figure(
        [bars([c.log10_odds_alone for c in rows], ""), bars([c.log10_odds_after for c in rows], "2")],
        86 + 22 * len(rows),
        xaxis=axis("alone, against no effect", [0.0, 0.43]),
        xaxis2=axis("for a place beside the chosen", [0.57, 1.0]),
        yaxis=_axis("", showgrid=False), yaxis2=_axis("", anchor="x2", showgrid=False, showticklabels=False),
        showlegend=False, margin={"l": 196, "r": 26, "t": 8, "b": 46}, bargap=0.3,
    )


def _figure(data: list[dict[str, Any]], height: int, **layout: Any) -> Figure:
    return {
        "data": data,
        "layout": {
            "width": WIDTH, "height": height, "paper_bgcolor": "#fff", "plot_bgcolor": "#fff",
            "font": {"family": "Helvetica, Arial, sans-serif", "size": 12, "color": INK},
            "margin": {"l": 58, "r": 16, "t": 30, "b": 42}, "hovermode": "closest",
            "legend": {"orientation": "h", "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "bottom"},
        } | layout,
    }


def _axis(title: str, **more: Any) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 6}, "gridcolor": _LINES, "zeroline": False, "zerolinecolor": "#b9bec6",
        "linecolor": "#b9bec6", "showline": True, "ticks": "outside", "ticklen": 4, "tickcolor": "#b9bec6",
        "automargin": False,
    } | more


def _line(x: Values, y: Values, name: str, colour: str, *, width: float, dash: str = "solid") -> dict[str, Any]:
    step = max(1, -(-len(x) // _POINTS))
    return {
        "type": "scatter", "mode": "lines", "x": _numbers(x[::step]), "y": _numbers(y[::step]), "name": name,
        "line": {"color": colour, "width": width, "dash": dash},
    }


def _caption(text: str, colour: str, x: float) -> dict[str, Any]:
    return {
        "text": f"<b>{text}</b>", "x": x, "y": 1.0, "xref": "paper", "yref": "paper", "xanchor": "center",
        "yanchor": "bottom", "showarrow": False, "font": {"color": colour},
    }


def _numbers(values: Values) -> list[float | None]:
    return [_rounded(float(value)) for value in values]


def _rounded(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
