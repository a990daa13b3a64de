"""The pictures of a diagnosis, in the order of its report. Knows nothing of how they are drawn."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from bench.diagnoses.figures.axes import Values, around, axis, from_zero, numbers, over, split
from bench.diagnoses.figures.figure import Axis, Figure, Panel, Role, Trace
from bench.diagnoses.figures.thinning import thinned_cloud, thinned_line
from bench.engineering import words
from estimator.diagnosis.verdict import Candidate, Diagnosis, FluxTable, Map, Scatter, Traces

PARTS: Final = ("flux-map", "over-time", "map", "stretch", "spectrum", "scatter", "candidates")
_MOST_LOG_ODDS: Final = 12.0
_ODDS_SHOWN: Final = 13.0  # with room beyond the longest bar
_LEVELS: Final = 6  # of a map, as curves
_ROOM_OF_LOG: Final = 1.2  # as a factor


def pictures(said: Diagnosis) -> tuple[Figure, ...]:
    """All figures of a diagnosis; none of what it has not."""
    return tuple(_pictures(said))


def _pictures(said: Diagnosis) -> Iterator[Figure]:
    if said.flux_map is not None:
        yield _flux_map(said.flux_map)
    if (traces := said.traces) is not None:
        of = f"means over {traces.periods} periods" if traces.periods > 1 else "values of single periods"
        yield _over_time(traces, of)
        yield from (_map(f"map-{k}", shown, of) for k, shown in enumerate(traces.maps))
        if len(traces.window_t) and (traces.window or traces.window_i):
            yield _stretch(traces, of)
        if len(traces.frequency):
            yield _spectrum(traces)
    yield from (_scatter(f"scatter-{k}", shown) for k, shown in enumerate(said.scatters))
    if said.candidates:
        yield _odds(said.candidates)


def _flux_map(told: FluxTable) -> Figure:
    """Flux linkages, each over its own axis' current at some currents of the other."""
    side = np.arange(len(told.i_q)) >= len(told.i_q) // 2  # the map is the same for either sign

    def panel(own: str, at: str, x: Values, psi: Values, others: Values) -> Panel:
        there = np.flatnonzero(np.isfinite(psi).sum(axis=0) > 1)
        there = there[:: max(1, -(-len(there) // _LEVELS))]
        levels = tuple(
            Trace(f"{round(float(others[k]), 6) + 0.0:.3g} A", "level", "line", numbers(x), numbers(psi[:, k]),
                  level=(n + 1, len(there)))
            for n, k in enumerate(there)
        )  # fmt: skip
        x_axis, y_axis = around(f"i_{own}", "A", x), around(f"psi_{own}", "Vs", psi[:, there])
        return Panel(f"at some {at}", x_axis, y_axis, levels)

    return Figure(
        "flux-map", "flux-map", "Flux linkages",
        "By the currents, where the recording has been. All numbers and their standard errors are in the JSON.",
        (panel("d", "i_q", told.i_d, told.psi_d[:, side], told.i_q[side]),
         panel("q", "i_d", told.i_q, told.psi_q.T, told.i_d)), beside=True,
    )  # fmt: skip


def _over_time(traces: Traces, of: str) -> Figure:
    """The mismatch over the recording, beside what noise leaves of the same means."""
    t, floor = traces.t, traces.floor_V
    drawn = [_line("before", traces.t, traces.before_V), _line("after", traces.t, traces.after_V)]
    told = ""
    if floor is not None and math.isfinite(floor):
        told = "; dashed, what noise alone leaves of the same"
        if len(t):
            drawn.append(_line("noise", t[[0, -1]], np.full(2, floor), "noise floor"))
    panel = Panel("", over("time", "s", t), from_zero("residual, rms", "V", drawn), tuple(drawn))
    return Figure(
        "over-time", "over-time", "The mismatch in time",
        f"Residual of the voltage, one step ahead, as {of}, d and q together: what R_s, L_d, L_q and psi_f alone "
        f"leave, and what is left with the effects found{told}.", (panel,),
    )  # fmt: skip


def _map(name: str, shown: Map, of: str) -> Figure:
    """Where the mismatch is, before and after, on one scale."""
    finite = [z[np.isfinite(z)] for z in (shown.before_V, shown.after_V)]
    most = max((float(z.max()) for z in finite if len(z)), default=1.0)
    x, y = over(*split(shown.x), shown.x_edges), over(*split(shown.y), shown.y_edges)
    edges = numbers(shown.x_edges), numbers(shown.y_edges)

    def panel(role: Role, z: Values) -> Panel:
        return Panel(role, x, y, (Trace(role, role, "heatmap", *edges, tuple(map(numbers, z))),))

    return Figure(
        "map", name, "Where it is", f"Rms of the residual, as {of}, by {shown.x} and {shown.y}.",
        (panel("before", shown.before_V), panel("after", shown.after_V)), beside=True,
        z=axis("residual, rms", "V", 0.0, most or 1.0),
    )  # fmt: skip


def _stretch(traces: Traces, of: str) -> Figure:
    """A short stretch: residual voltages, and currents beside a free run."""
    x = over("time", "s", traces.window_t)

    def panel(label: str, unit: str, roles: Sequence[Role], lines: Sequence[Values]) -> Panel:
        drawn = tuple(_line(role, traces.window_t, line) for role, line in zip(roles, lines, strict=True))
        return Panel("", x, around(label, unit, *lines), drawn)

    voltages = [panel(f"residual {name}", "V", ("before", "after"), lines) for name, lines in traces.window.items()]
    currents = [panel(name, "A", ("measured", "before", "after"), lines) for name, lines in traces.window_i.items()]
    return Figure(
        "stretch", "stretch", "A short stretch",
        f"Where the mismatch is largest: voltages one step ahead, as {of}, and currents of a free run.",
        (*voltages, *currents),
    )


def _spectrum(traces: Traces) -> Figure:
    """The residual by frequency."""
    densities = [np.where(density > 0.0, density, np.nan) for density in traces.spectrum]
    before, after = densities
    shown = np.concatenate(densities)
    least, most = (float(end(shown)) for end in (np.nanmin, np.nanmax)) if np.isfinite(shown).any() else (0.1, 1.0)
    y = replace(axis("residual", "V/√Hz", least / _ROOM_OF_LOG, most * _ROOM_OF_LOG), scale="log")
    drawn = _line("before", traces.frequency, before), _line("after", traces.frequency, after)
    return Figure(
        "spectrum", "spectrum", "By frequency",
        "Amplitude density of the residual of single periods, d and q together. White noise is a level line.",
        (Panel("", over("frequency", "Hz", traces.frequency), y, drawn),),
    )


def _scatter(name: str, shown: Scatter) -> Figure:
    """Residuals point by point."""

    def cloud(role: Role, values: Values) -> Trace:
        x, y = thinned_cloud(shown.of_x, values)
        return Trace(role, role, "markers", numbers(x), numbers(y))

    y = around(f"left out: {shown.y}", "V", shown.before_V, shown.after_V)
    clouds = cloud("before", shown.before_V), cloud("after", shown.after_V)
    return Figure(
        "scatter", name, "Point by point",
        f"What is missed of {shown.y} at points that took no part in the fit, by {shown.x}.",
        (Panel("", around(*split(shown.x), shown.of_x), y, clouds),),
    )


def _odds(candidates: Sequence[Candidate]) -> Figure:
    """Candidates by how much they help, alone and in the end; the likeliest on top."""
    rows = list(candidates)[::-1]
    y = Axis("", "", -0.5, len(rows) - 0.5, names=tuple(words(c.effect) for c in rows))
    x = Axis("odds", "", -_ODDS_SHOWN, _ODDS_SHOWN, "exponent")

    def panel(title: str, log10_odds: Sequence[float]) -> Panel:
        held = np.clip(np.array(log10_odds), -_MOST_LOG_ODDS, _MOST_LOG_ODDS)  # what is not a number stays so

        def bars(role: Role, name: str, *, chosen: bool) -> Trace:
            at = [k for k, row in enumerate(rows) if row.chosen == chosen]
            return Trace(name, role, "bars", numbers(held[at]), tuple(map(float, at)))

        both = bars("chosen", "chosen", chosen=True), bars("not_chosen", "not chosen", chosen=False)
        return Panel(title, x, y, both)

    return Figure(
        "candidates", "candidates", "What was considered",
        f"Effects by their odds, alone and in the end; those chosen are marked. What is beyond 1e{_MOST_LOG_ODDS:.0f} "
        "to 1, for or against, is drawn as that.",
        (panel("alone, against no effect", [c.log10_odds_alone for c in rows]),
         panel("for a place beside the chosen", [c.log10_odds_after for c in rows])), beside=True,
    )  # fmt: skip


def _line(role: Role, x: Values, y: Values, name: str | None = None) -> Trace:
    of_x, of_y = thinned_line(x, y)
    return Trace(name or role, role, "line", numbers(of_x), numbers(of_y))
