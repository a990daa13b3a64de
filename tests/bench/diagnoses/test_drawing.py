"""Figures as vector pictures: numbers along axes, and marks where their numbers are."""

import re
from xml.etree import ElementTree

import pytest

from bench.diagnoses.figures.figure import Axis, Figure, Panel, Trace
from bench.diagnoses.figures.forest import forests
from bench.diagnoses.figures.pictures import pictures
from bench.diagnoses.report.drawing import drawn
from bench.diagnoses.report.layout import NARROW, WIDE, laid_out
from bench.diagnoses.report.scales import Scale
from tests.support.diagnoses import EXPLAINED
from tests.support.together import BOTH

VOLTS = Axis("u_d", "V", -4.0, 4.0)
TIME = Axis("time", "s", 0.0, 10.0)
ODDS = Axis("odds", "", -13.0, 13.0, "exponent")


def picture(trace: Trace, x: Axis = TIME, y: Axis = VOLTS, z: Axis | None = None) -> ElementTree.Element:
    """A figure of one trace as it is drawn."""
    figure = Figure("part", "name", "title", "a caption", (Panel("", x, y, (trace,)),), z=z)
    return ElementTree.fromstring(drawn(figure, WIDE, "wide"))


def of_class(root: ElementTree.Element, looks: str) -> list[ElementTree.Element]:
    return [element for element in root.iter() if element.get("class") == looks]


@pytest.mark.parametrize(
    ("axis", "texts"),
    [
        (Axis("time", "s", 0.01, 5.99), ["1", "2", "3", "4", "5"]),
        (Axis("u", "V", 0.0, 0.47), ["0", "100", "200", "300", "400"]),  # mV
        (Axis("u", "V", -2.0, 2.0), ["−2", "−1", "0", "1", "2"]),
        (Axis("angle", "deg", 0.0, 360.0), ["0", "90", "180", "270", "360"]),
        (Axis("speed", "rpm", -1500.0, 1500.0), ["−1500", "−1000", "−500", "0", "500", "1000", "1500"]),
        (Axis("u", "V/√Hz", 1e-4, 2.0, "log"), ["10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "1"]),
        (Axis("u", "V/√Hz", 0.9, 11.0, "log"), ["1", "2", "5", "10"]),
        (ODDS, ["10⁻¹²", "10⁻⁶", "1", "10⁶", "10¹²"]),
        (Axis("", "", -0.5, 1.5, names=("b", "a")), ["b", "a"]),
    ],
    ids=str,
)
def test_numbers_along_an_axis_are_round_and_few(axis: Axis, texts: list[str]) -> None:
    ticks = Scale(axis, 0.0, 300.0).ticks(50.0)
    assert [tick.text for tick in ticks] == texts
    assert all(0.0 <= tick.at <= 300.0 for tick in ticks)


@pytest.mark.parametrize(
    ("axis", "label", "value", "told"),
    [
        (Axis("u", "V", 0.0, 0.47), "u, mV", -0.2613, "−261.3 mV"),
        (Axis("frequency", "Hz", 0.0, 5e3), "frequency, kHz", 480.0, "0.48 kHz"),
        (Axis("speed", "rpm", 0.0, 3e3), "speed, rpm", 1200.0, "1200 rpm"),
        (ODDS, "odds", 4.0, "1e4"),
        (Axis("", "", -0.5, 1.5, names=("b", "a")), "", 1.0, "a"),
    ],
    ids=str,
)
def test_a_number_is_told_in_the_unit_of_its_axis(axis: Axis, label: str, value: float, told: str) -> None:
    assert Scale(axis, 0.0, 1.0).label == label
    assert Scale(axis, 0.0, 1.0).told(value) == told


def test_a_line_goes_through_its_points_and_stops_at_a_gap() -> None:
    root = picture(Trace("before", "before", "line", (0.0, 5.0, 7.0, 10.0), (0.0, 4.0, None, -4.0)))
    (line,) = of_class(root, "line before")
    (frame,) = of_class(root, "axis")
    left, top, bottom, right = re.findall(r"[\d.]+", frame.get("d", ""))[:4]
    middle = (float(top) + float(bottom)) / 2
    assert line.get("d") == f"M{left} {middle:g}L{(float(left) + float(right)) / 2:g} {top}M{right} {bottom}"


def test_few_marks_tell_their_numbers_and_many_are_one_path() -> None:
    few = of_class(picture(Trace("before", "before", "markers", (1.0, 2.0), (-2.5, None))), "dot before")
    assert [mark[0].text for mark in few] == ["before: −2.5 V at 1 s"]
    x = tuple(0.02 * k for k in range(500))
    (many,) = of_class(picture(Trace("after", "after", "markers", x, x)), "dot after")
    assert many.get("d", "").count("M") == 500
    assert not list(many)


def test_bars_reach_from_even_odds_and_those_chosen_are_marked() -> None:
    names = Axis("", "", -0.5, 1.5, names=("iron loss", "voltage delay"))
    root = picture(Trace("chosen", "chosen", "bars", (3.0,), (1.0,)), ODDS, names)
    (bar,) = of_class(root, "bar chosen")
    assert bar[0].text == "voltage delay: odds 1000"
    assert [text.text for text in of_class(root, "name end chosen")] == ["✓ voltage delay"]
    assert [text.text for text in of_class(root, "name end")] == ["iron loss"]


def test_an_interval_goes_from_end_to_end_and_no_farther_than_the_picture() -> None:
    rows = Axis("", "", -0.5, 2.5, names=("c", "b", "a"))
    ends = (2.0, 6.0, -5.0, 30.0, None, None)
    root = picture(Trace("a recording", "each", "intervals", ends, (0.0, 1.0, 2.0)), y=rows)
    inside, beyond = of_class(root, "interval each")
    (frame,) = of_class(root, "axis")
    left, _, _, right = map(float, re.findall(r"[\d.]+", frame.get("d", ""))[:4])
    begin, _, end, middle, *_ = map(float, re.findall(r"-?[\d.]+", inside.get("d", "")))
    assert [begin, end, middle] == pytest.approx([left + share * (right - left) for share in (0.2, 0.6, 0.4)], abs=0.1)
    begin, _, end, *_ = map(float, re.findall(r"-?[\d.]+", beyond.get("d", "")))
    assert (begin, end) == (left, right)
    assert [one[0].text for one in (inside, beyond)] == ["c: 4.0 ± 2.0 s", "b: 12 ± 18 s"]


def test_cells_of_a_map_have_shades_by_their_values_and_holes() -> None:
    trace = Trace("before", "before", "heatmap", (0.0, 5.0, 10.0), (-4.0, 0.0, 4.0), ((0.0, None), (1.0, 1.0)))
    root = picture(trace, z=Axis("u", "V", 0.0, 1.0))
    (low, _), (high, _) = (of_class(root, shade) for shade in ("q0", "q15"))
    assert (low.get("d", "").count("M"), high.get("d", "").count("M")) == (1, 1)


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_panels_stand_inside_the_picture_and_do_not_overlap(width: float) -> None:
    for figure in (*pictures(EXPLAINED), *forests(BOTH)):
        layout = laid_out(figure, width)
        boxes = [place.box for place in layout.places]
        for k, box in enumerate(boxes):
            assert 0.0 < box.left < box.right < width
            assert 0.0 < box.top < box.bottom < layout.height
            assert all(other.left > box.right or other.top > box.bottom for other in boxes[k + 1 :])
        columns = 2 if figure.beside and width == WIDE else 1
        assert len({box.top for box in boxes}) == -(-len(boxes) // columns)
