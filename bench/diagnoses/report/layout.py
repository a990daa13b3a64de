"""Where the panels of a figure stand: in columns where there is room, else one below the other. px.

Widths of words are about those of a usual sans-serif face: a picture is made before anybody sees its letters.
"""

from dataclasses import dataclass
from typing import Final

from bench.diagnoses.figures.figure import Figure, Panel
from bench.diagnoses.report.scales import Scale
from bench.diagnoses.report.svg import Box

WIDE: Final = 680  # an A4 page between its margins
NARROW: Final = 360  # a telephone
SIDEWAYS: Final = 62.0  # between numbers along an axis
UP: Final = 24.0
TICK: Final = 4.0
EDGE: Final = 8.0  # around it all
_LETTER: Final = 6.4
_TITLE: Final = 24.0  # above a panel
_FOOT: Final = 42.0  # below one, for numbers and label
_LABEL: Final = 22.0  # left of the numbers
_BETWEEN: Final = 16.0  # panels below each other that share their numbers
_GAP: Final = 26.0  # between panels beside each other
_BESIDE: Final = 2  # panels at most
_COLOURS: Final = 66.0  # for a bar of colours and its numbers
_BAR: Final = 22.0  # from bar to bar
_MARK: Final = 16.0  # before a name


@dataclass(frozen=True, slots=True)
class Place:
    """A panel on the picture."""

    panel: Panel
    box: Box  # between its axes
    x: Scale
    y: Scale
    tells_x: bool  # its numbers, which are not those of the panel below
    tells_y: bool  # or before

    @property
    def label_at(self) -> float:
        """Left of the box, for the middle of the y axis' label."""
        return self.box.left - _numbers_of(self.panel, self.box.bottom - self.box.top) - TICK - 12.0


@dataclass(frozen=True, slots=True)
class Layout:
    """All panels, and the room around them."""

    places: tuple[Place, ...]
    height: float
    colours: Box | None  # of heatmaps, and beside it their numbers


def laid_out(figure: Figure, width: float) -> Layout:
    """The figure's panels on a picture so wide."""
    panels, high = figure.panels, _height(figure)
    columns = min(len(panels), _BESIDE) if figure.beside and width >= WIDE else 1
    share_x = columns == 1 and len({panel.x for panel in panels}) == 1
    share_y = columns > 1 and len({panel.y for panel in panels}) == 1
    before = [_before(panel, high) for panel in panels]
    lefts = [0.0 if share_y and k else max(before[k::columns]) for k in range(columns)]
    right, beyond = (_COLOURS, EDGE) if figure.z is not None else (0.0, _beyond(figure))
    wide = (width - 2 * EDGE - right - sum(lefts) - columns * beyond - (columns - 1) * _GAP) / columns
    places: list[Place] = []
    top, left = EDGE, EDGE
    for k, panel in enumerate(panels):
        row, column = divmod(k, columns)
        last = row == (len(panels) - 1) // columns
        if column == 0:
            left, top = EDGE, top + (_TITLE if panel.title else 0.0)
        left += lefts[column]
        box = Box(left, top, left + wide, top + high)
        x, y = Scale(panel.x, box.left, box.right), Scale(panel.y, box.bottom, box.top)
        places.append(Place(panel, box, x, y, last or not share_x, column == 0 or not share_y))
        left = box.right + beyond + _GAP
        if column == columns - 1 or k == len(panels) - 1:
            top = box.bottom + (_FOOT if last or not share_x else _BETWEEN)
    at = width - EDGE - _COLOURS + 2 * EDGE
    colours = Box(at, places[0].box.top, at + 10.0, places[-1].box.bottom) if figure.z is not None else None
    return Layout(tuple(places), top, colours)


def _height(figure: Figure) -> float:
    """Of a panel's box."""
    names = figure.panels[0].y.names
    if names:
        return _BAR * len(names)
    if figure.beside:
        return 222.0
    return 180.0 if len(figure.panels) == 1 else 104.0


def _before(panel: Panel, high: float) -> float:
    """Left of a panel's box, for numbers or names, and a label."""
    return _numbers_of(panel, high) + 2 * TICK + (_MARK if panel.y.names else 0.0) + (_LABEL if panel.y.label else 0.0)


def _numbers_of(panel: Panel, high: float) -> float:
    return _LETTER * max((len(tick.text) for tick in Scale(panel.y, high, 0.0).ticks(UP)), default=0)


def _beyond(figure: Figure) -> float:
    """Right of a panel's box, for the names of levels."""
    names = [trace.name for panel in figure.panels for trace in panel.traces if trace.level is not None]
    return max((_LETTER * len(name) for name in names), default=0.0) + EDGE
