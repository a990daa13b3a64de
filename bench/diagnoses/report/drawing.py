"""A figure as a vector picture, SVG whose looks are a stylesheet's. Knows nothing of colours, pages and diagnoses."""

from collections.abc import Iterator

from markupsafe import Markup

from bench.diagnoses.figures.figure import Figure, Trace
from bench.diagnoses.report.layout import SIDEWAYS, TICK, UP, Place, laid_out
from bench.diagnoses.report.scales import Scale, Tick
from bench.diagnoses.report.svg import Box, px, tag, text, upwards
from bench.diagnoses.report.traces import SHADES, level_names, traced


def drawn(figure: Figure, width: float, looks: str) -> Markup:
    """The picture, so many px wide; its class is its looks."""
    layout = laid_out(figure, width)
    parts = [part for place in layout.places for part in _panel(place, figure)]
    if figure.z is not None and layout.colours is not None:
        parts += _colours(Scale(figure.z, layout.colours.bottom, layout.colours.top), layout.colours)
    return tag(
        "svg", *parts, class_=looks, viewBox=f"0 0 {px(width)} {px(layout.height)}", role="img",
        aria_label=figure.caption,
    )  # fmt: skip


def legend(figure: Figure) -> list[Trace]:
    """A trace of each role that no title and no word in the picture names."""
    named = dict[str, Trace]()
    for trace in (trace for panel in figure.panels for trace in panel.traces):
        if trace.kind != "heatmap" and trace.level is None:
            named.setdefault(trace.role, trace)
    return list(named.values())


def _panel(place: Place, figure: Figure) -> Iterator[Markup]:
    if figure.z is None:
        yield from _grid(place)
    for trace in place.panel.traces:
        yield from traced(trace, place, figure.z)
    yield from level_names(place.panel.traces, place)
    yield from _axes(place)
    if place.panel.title:
        role = place.panel.traces[0].role if figure.z is not None else ""
        yield text(place.panel.title, place.box.middle[0], place.box.top - 9.0, f"title middle {role}".rstrip())


def _grid(place: Place) -> Iterator[Markup]:
    """Lines at the numbers along the axes, and where a sign changes."""
    box = place.box
    upright = "".join(f"M{px(tick.at)} {px(box.top)}V{px(box.bottom)}" for tick in place.x.ticks(SIDEWAYS))
    level = "".join(f"M{px(box.left)} {px(tick.at)}H{px(box.right)}" for tick in _levels(place))
    yield tag("path", class_="grid", d=upright + level)
    if (x := place.x.zero) is not None and place.panel.x.scale == "exponent":
        yield tag("path", class_="zero", d=f"M{px(x)} {px(box.top)}V{px(box.bottom)}")
    if (y := place.y.zero) is not None:
        yield tag("path", class_="zero", d=f"M{px(box.left)} {px(y)}H{px(box.right)}")


def _axes(place: Place) -> Iterator[Markup]:
    """Left and bottom, with their numbers and labels."""
    box, across = place.box, place.x.ticks(SIDEWAYS)
    frame = f"M{px(box.left)} {px(box.top)}V{px(box.bottom)}H{px(box.right)}"
    down = "".join(f"M{px(tick.at)} {px(box.bottom)}v{px(TICK)}" for tick in across)
    aside = "".join(f"M{px(box.left)} {px(tick.at)}h{px(-TICK)}" for tick in _levels(place))
    yield tag("path", class_="axis", d=frame + down + aside)
    if place.tells_x:
        for tick in across:
            yield text(tick.text, tick.at, box.bottom + 17.0, "tick middle")
        yield text(place.x.label, box.middle[0], box.bottom + 34.0, "label middle")
    if place.tells_y:
        yield from _names(place) if place.panel.y.names else _numbers(place)


def _numbers(place: Place) -> Iterator[Markup]:
    for tick in place.y.ticks(UP):
        yield text(tick.text, place.box.left - 2 * TICK, tick.at + 4.0, "tick end")
    yield upwards(place.y.label, place.label_at, place.box.middle[1], "label")


def _names(place: Place) -> Iterator[Markup]:
    """Of bars; those chosen are marked."""
    chosen = {y for trace in place.panel.traces if trace.role == "chosen" for y in trace.y}
    for k, tick in enumerate(place.y.ticks(UP)):
        said, looks = (f"✓ {tick.text}", "name end chosen") if k in chosen else (tick.text, "name end")
        yield text(said, place.box.left - 2 * TICK, tick.at + 4.0, looks)


def _levels(place: Place) -> list[Tick]:
    """Numbers along the y axis; names have no lines."""
    return [] if place.panel.y.names else place.y.ticks(UP)


def _colours(scale: Scale, box: Box) -> Iterator[Markup]:
    """What the shades of a heatmap stand for."""
    high = (box.bottom - box.top) / SHADES
    for k in range(SHADES):
        top = box.bottom - (k + 1) * high
        course = f"M{px(box.left)} {px(top)}H{px(box.right)}V{px(top + high)}H{px(box.left)}z"
        yield tag("path", class_=f"q{k}", d=course)
    for tick in scale.ticks(UP):
        yield text(tick.text, box.right + TICK, tick.at + 4.0, "tick")
    yield upwards(scale.label, box.right + 46.0, box.middle[1], "label")
