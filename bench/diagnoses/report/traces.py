"""What is drawn over a panel's axes: lines, markers, bars, intervals, heatmaps. Where marks are few, each tells its
numbers.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Final

from markupsafe import Markup

from bench.diagnoses.figures.figure import Axis, Numbers, Trace
from bench.diagnoses.report.layout import Place
from bench.diagnoses.report.scales import Scale
from bench.diagnoses.report.svg import px, tag, text

SHADES: Final = 16  # of a heatmap, q0 to q15
_LEVELS: Final = 6  # shades of curves, level-1 to level-6
_FEW: Final = 100  # marks that tell their numbers
_LINE: Final = 13.0  # px from one line of words to the next
_SEAM: Final = 0.3  # px
_DOT: Final = 2.6  # px
_HALF_BAR: Final = 7.0  # px
_MARK: Final = 4.5  # px, half of that in the middle of an interval


@dataclass(frozen=True, slots=True)
class _Point:
    """A point of a trace: where it is, px, and of what."""

    x: float
    y: float
    of_x: float
    of_y: float


def traced(trace: Trace, place: Place, z: Axis | None) -> Iterator[Markup]:
    """A trace's elements; `z`: of heatmaps."""
    if trace.kind == "heatmap":
        assert z is not None
        return _heatmap(trace, place, z)
    return {"line": _line, "markers": _markers, "bars": _bars, "intervals": _intervals}[trace.kind](trace, place)


def _shade(share: float | None) -> str:
    """The class of a shade, 0 the lowest, 1 the highest; none where there is nothing."""
    return "" if share is None else f"q{min(max(int(share * SHADES), 0), SHADES - 1)}"


def _points(trace: Trace, place: Place) -> Iterator[_Point | None]:
    """None where there is none."""
    for of_x, of_y in zip(trace.x, trace.y, strict=True):
        x, y = place.x.at(of_x), place.y.at(of_y)
        if x is None or y is None or of_x is None or of_y is None:
            yield None
        else:
            yield _Point(x, y, of_x, of_y)


def _line(trace: Trace, place: Place) -> Iterator[Markup]:
    points = list(_points(trace, place))
    runs = [list(filter(None, run)) for there, run in groupby(points, lambda point: point is not None) if there]
    course = "".join("M" + "L".join(f"{px(point.x)} {px(point.y)}" for point in run) for run in runs)
    name = [] if trace.level is None else [tag("title", trace.name)]
    yield tag("path", *name, class_=f"line {_looks(trace)}", d=course)


def level_names(traces: Sequence[Trace], place: Place) -> Iterator[Markup]:
    """The first and the last level by name, where their lines end; apart."""
    lines = [trace for trace in traces if trace.level is not None]
    ends = [(trace, point) for trace in dict.fromkeys(lines[:1] + lines[-1:]) for point in _last(trace, place)]
    y = [point.y for _, point in ends]
    if len(y) > 1 and (lacking := _LINE - abs(y[1] - y[0])) > 0.0:
        up = math.copysign(lacking / 2.0, y[1] - y[0])
        y = [y[0] - up, y[1] + up]
    for (trace, point), at in zip(ends, y, strict=True):
        yield text(trace.name.replace("-", "−"), point.x + 5.0, at + 4.0, f"tick {_looks(trace)}")


def _last(trace: Trace, place: Place) -> list[_Point]:
    return list(filter(None, _points(trace, place)))[-1:]


def _looks(trace: Trace) -> str:
    if trace.level is None:
        return trace.role
    k, n = trace.level
    return f"level-{1 + round((k - 1) / max(n - 1, 1) * (_LEVELS - 1))}"


def _markers(trace: Trace, place: Place) -> Iterator[Markup]:
    points = list(filter(None, _points(trace, place)))
    courses = [f"M{px(one.x)} {px(one.y - _DOT)}a{_DOT} {_DOT} 0 1 1-.1 0z" for one in points]
    if len(points) > _FEW:
        yield tag("path", class_=f"dot {trace.role}", d="".join(courses))
        return
    for one, course in zip(points, courses, strict=True):
        told = tag("title", f"{trace.name}: {place.y.told(one.of_y)} at {place.x.told(one.of_x)}")
        yield tag("path", told, class_=f"dot {trace.role}", d=course)


def _bars(trace: Trace, place: Place) -> Iterator[Markup]:
    zero = place.x.at(0.0)
    assert zero is not None
    for one in filter(None, _points(trace, place)):
        course = f"M{px(zero)} {px(one.y - _HALF_BAR)}H{px(one.x)}v{px(2 * _HALF_BAR)}H{px(zero)}z"
        told = tag("title", f"{place.y.told(one.of_y)}: {place.x.label} {place.x.told(one.of_x)}")
        yield tag("path", told, class_=f"bar {trace.role}", d=course)


def _intervals(trace: Trace, place: Place) -> Iterator[Markup]:
    """A line from end to end, or to where the picture ends, and a mark in the middle."""
    box = place.box
    for of_low, of_high, of_y in zip(trace.x[::2], trace.x[1::2], trace.y, strict=True):
        low, high, y = place.x.at(of_low), place.x.at(of_high), place.y.at(of_y)
        if low is None or high is None or y is None or of_low is None or of_high is None or of_y is None:
            continue
        middle, left, right = (low + high) / 2, max(low, box.left), min(high, box.right)
        told = tag("title", f"{place.y.told(of_y)}: {place.x.told_between(of_low, of_high)}")
        course = f"M{px(left)} {px(y)}H{px(right)}M{px(middle)} {px(y - _MARK)}v{px(2 * _MARK)}"
        yield tag("path", told, class_=f"interval {trace.role}", d=course)


def _heatmap(trace: Trace, place: Place, z: Axis) -> Iterator[Markup]:
    """Cells that have a value, all of a shade in one path, and a little over the next ones: no seams show."""
    lefts, tops = _edges(trace.x, place.x), _edges(trace.y, place.y)
    scale = Scale(z, 0.0, 1.0)
    courses = defaultdict[str, str](str)
    for row, (bottom, top) in zip(trace.z, pairwise(tops), strict=True):
        shades = [_shade(scale.at(value)) for value in row]
        start = 0
        for looks, run in groupby(shades):
            end = start + len(list(run))
            if looks:
                right, below = px(lefts[end] + _SEAM), px(bottom + _SEAM)
                courses[looks] += f"M{px(lefts[start])} {px(top)}H{right}V{below}H{px(lefts[start])}z"
            start = end
    yield from (tag("path", class_=name, d=course) for name, course in sorted(courses.items()))


def _edges(values: Numbers, scale: Scale) -> list[float]:
    return [at for at in map(scale.at, values) if at is not None]
