"""No more points than a picture shows, and none of what it shows lost.

Of a line the least and the greatest value of each column stay, with a gap where there is one; of a cloud, one point of
each cell. Knows nothing of figures.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

COLUMNS: Final = 600  # a picture is about so many px wide
_CELLS: Final = 200, 100  # of a cloud, as many as markers are told apart

Values = NDArray[np.float64]


def thinned_line(x: Values, y: Values, columns: int = COLUMNS) -> tuple[Values, Values]:
    """A line's points in their order, (n,) each: all where they are few, else at most three of each column."""
    if len(x) <= 2 * columns:
        return x, y
    kept: list[int] = []
    for part in np.array_split(np.arange(len(x)), columns):
        finite = part[np.isfinite(y[part])]
        extremes = (finite[np.argmin(y[finite])], finite[np.argmax(y[finite])]) if len(finite) else ()
        gap = part[~np.isfinite(y[part])][:1]
        kept += sorted({*map(int, extremes), *map(int, gap)})
    kept = sorted({0, *kept, len(x) - 1})
    return x[kept], y[kept]


def thinned_cloud(x: Values, y: Values) -> tuple[Values, Values]:
    """Points in their order, (n,) each: all where they are few, else one of each cell of a grid."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    x, y = x[finite], y[finite]
    if len(x) <= 2 * COLUMNS:
        return x, y
    across, up = (_cell(values, count) for values, count in zip((x, y), _CELLS, strict=True))
    kept = np.sort(np.unique(across * _CELLS[1] + up, return_index=True)[1])
    return x[kept], y[kept]


def _cell(values: Values, count: int) -> NDArray[np.int64]:
    low, width = float(values.min()), float(np.ptp(values)) or 1.0
    return np.minimum((values - low) / width * count, count - 1).astype(np.int64)
