"""A diagnosis' pictures as data: what each shows, by the published schema, and no more points than are seen."""

import json
from dataclasses import replace
from typing import Any

import jsonschema
import numpy as np
import pytest

from bench.diagnoses.figures.figure import Figure, Trace, figures_text, schema
from bench.diagnoses.figures.pictures import PARTS, pictures
from bench.diagnoses.figures.thinning import COLUMNS, thinned_cloud, thinned_line
from estimator.diagnosis.verdict import Diagnosis, FluxTable, Scatter, Traces
from tests.support.diagnoses import ALL, EXPLAINED, NOTHING_TOLD

validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]


def shown(diagnosis: Diagnosis, name: str) -> Figure:
    """A figure by its name."""
    (one,) = [figure for figure in pictures(diagnosis) if figure.name == name]
    return one


def with_traces(**changes: Any) -> Diagnosis:
    assert EXPLAINED.traces is not None
    return replace(EXPLAINED, traces=replace(EXPLAINED.traces, **changes))


def explained() -> Traces:
    assert EXPLAINED.traces is not None
    return EXPLAINED.traces


def levels(figure: Figure) -> list[Trace]:
    return [trace for panel in figure.panels for trace in panel.traces]


@pytest.mark.parametrize("name", ALL)
def test_pictures_of_every_kind_of_diagnosis_follow_the_published_schema(name: str) -> None:
    told = json.loads(figures_text(pictures(ALL[name])))
    validate(told, schema())
    assert all(figure["part"] in PARTS for figure in told["figures"])
    assert len({figure["name"] for figure in told["figures"]}) == len(told["figures"])


def test_what_is_drawn_has_a_role_and_no_colour() -> None:
    figures = pictures(EXPLAINED)
    assert [figure.name for figure in figures] == [
        "over-time", "map-0", "map-1", "stretch", "spectrum", "candidates",
    ]  # fmt: skip
    assert "#" not in figures_text(figures)
    panels = shown(EXPLAINED, "stretch").panels
    assert [panel.y.label for panel in panels] == ["residual u_d", "residual u_q", "i_d", "i_q"]
    assert [trace.role for trace in panels[-1].traces] == ["measured", "before", "after"]
    assert pictures(NOTHING_TOLD) == ()


def test_maps_before_and_after_have_one_scale_and_holes_where_nothing_is() -> None:
    figure = shown(EXPLAINED, "map-0")
    before, after = levels(figure)
    assert (before.z[0][0], after.z[0][0], after.z[1][0]) == (None, None, 0.4)
    assert len(before.x) == len(before.z[0]) + 1
    assert len(before.y) == len(before.z) + 1
    assert figure.z is not None
    assert figure.z.high == pytest.approx(np.nanmax(explained().maps[0].before_V), rel=1e-4)
    assert figure.panels[0].x == figure.panels[1].x
    assert (figure.panels[0].x.label, figure.panels[0].x.unit) == ("electrical angle", "deg")


def test_odds_are_held_within_what_a_picture_shows_and_those_chosen_are_told() -> None:
    alone, final = shown(EXPLAINED, "candidates").panels
    assert alone.y.names[::-1][:2] == ("inverter voltage error", "phase resistance imbalance")
    chosen, others = alone.traces
    assert [alone.y.names[round(y)] for y in chosen.y if y is not None] == [
        "d-axis saturation", "inverter voltage error",
    ]  # fmt: skip
    assert (chosen.x, others.x[0], final.traces[1].x[0]) == ((12.0, 12.0), -12.0, None)


def test_pictures_in_time_and_place_say_over_how_many_periods_they_are_means_and_have_the_floor_of_those() -> None:
    figure = shown(EXPLAINED, "over-time")
    floor = figure.panels[0].traces[-1]
    assert (floor.role, floor.y) == ("noise", (0.38, 0.38))  # not the 0.39 V of single periods
    assert "one step ahead, as means over 10 periods, d and q together" in figure.caption
    by = shown(EXPLAINED, "map-1").caption
    assert by == "Rms of the residual, as means over 10 periods, by speed, rpm and i_q, A."
    unknown = shown(with_traces(floor_V=None, periods=1), "over-time")
    assert [trace.role for trace in unknown.panels[0].traces] == ["before", "after"]
    assert "as values of single periods" in unknown.caption


@pytest.mark.parametrize("start", [0.0, 3600.0, 1e6])
def test_a_short_stretch_of_a_long_recording_keeps_its_times_apart(start: float) -> None:
    window_t = start + 1e-4 * np.arange(len(explained().window_t))
    figure = shown(with_traces(window_t=window_t), "stretch")
    x = np.array(figure.panels[0].traces[0].x, float)
    assert np.allclose(np.diff(x), 1e-4, atol=2e-6)
    assert figure.panels[0].x.low == pytest.approx(start, abs=1e-5)


def test_a_flux_map_is_curves_at_a_few_currents_of_the_other_axis() -> None:
    i_d, i_q = np.linspace(-20.0, 0.0, 11), np.linspace(-20.0, 20.0, 21)
    psi_d, psi_q = 0.1 + 1e-3 * i_d[:, None] + 0.0 * i_q, 2e-3 * i_q + 0.0 * i_d[:, None]
    psi_d[:2, -1] = np.nan
    figure = shown(replace(EXPLAINED, flux_map=FluxTable(i_d, i_q, psi_d, psi_q, psi_d, psi_q)), "flux-map")
    curves = figure.panels[0].traces
    assert [curve.level for curve in curves] == [(k, 6) for k in range(1, 7)]
    assert (curves[0].name, curves[-1].y[0]) == ("0 A", None)
    assert pictures(replace(EXPLAINED, flux_map=FluxTable(i_d, i_q, psi_d, psi_q, psi_d, psi_q)))[0] == figure


def test_axes_have_ends_where_nothing_or_a_single_value_is() -> None:
    nothing, zeros = np.full(3, np.nan), np.zeros(3)
    for values in (nothing, zeros):
        scatter = Scatter("abs(i_q), A", "u_d", values, values, values)
        panel = shown(replace(EXPLAINED, scatters=(scatter,)), "scatter-0").panels[0]
        assert panel.x.low < panel.x.high
        assert panel.y.low < panel.y.high
        assert (panel.x.label, panel.x.unit) == ("abs(i_q)", "A")


def test_of_a_long_line_each_columns_extremes_stay_and_gaps_too() -> None:
    x = np.linspace(0.0, 1.0, 100_000)
    y = np.sin(1e5 * x)
    y[4321], y[50_000:51_000] = 7.0, np.nan
    of_x, of_y = thinned_line(x, y)
    assert len(of_x) <= 3 * COLUMNS
    assert np.nanmax(of_y) == 7.0
    assert (of_x[0], of_x[-1]) == (0.0, 1.0)
    assert np.isnan(of_y[(of_x > 0.5) & (of_x < 0.51)]).all()
    assert np.all(np.diff(of_x) > 0.0)


def test_of_a_cloud_one_point_of_each_cell_stays() -> None:
    x, y = np.random.default_rng(1).normal(size=(2, 100_000))
    y[:10] = np.nan
    of_x, of_y = thinned_cloud(x, y)
    assert len(of_x) < 20_000
    assert np.ptp(of_x) == pytest.approx(np.ptp(x[10:]), rel=0.02)
    assert np.isfinite(of_y).all()
    few_x, few_y = thinned_cloud(x[:20], y[:20])
    assert len(few_x) == len(few_y) == 10
