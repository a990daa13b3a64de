"""Thinning: blocks of a long recording's rows, spread over all of it, that tell nearly as much of what is strong.

What depends on all that came before - the time, the heat so far - is that of the whole recording; what depends on the
last milliseconds is not known at the begin of a run, or of a block. Knows no effect.
"""

from itertools import pairwise
from typing import Final

import numpy as np

from estimator.physics.rows import Rows

PARTS: Final = ((16_000, 32), (64_000, 96))  # periods, and blocks of them, that find what is strong
_WORTH_THINNING: Final = 2  # times as many, from which on it saves time
_SETTLING: Final = 100  # periods, in which the fields and filters of effects settle
_LONGER_RUN: Final = 10  # as many times longer is a run at least
_SPARE_SHARE: Final = 0.05  # of all periods
_NEXT_TO_GAP: Final = (-1, *range(1, 13))  # periods; after it a branch beside the machine settles
GOLDEN: Final = 0.6180339887498949
"""Multiples of it, less whole ones, are spread evenly."""


def settled(rows: Rows) -> Rows:
    """The rows, of which the first periods of each run are not `joined`: what came before is not known there.

    Nor those next to a gap, as many as are few of all: a voltage that acts before or after its row is not known there,
    nor what a branch beside the machine carries.
    """
    joined, gap = rows.joined.copy(), np.flatnonzero(~rows.joined & ~rows.pauses)
    for place in _NEXT_TO_GAP[: int(_SPARE_SHARE * len(rows)) // max(len(gap), 1)]:
        joined[np.clip(gap + place, 0, len(rows) - 1)] = False
    ends = [0, *(np.flatnonzero(rows.pauses) + 1).tolist(), len(rows)]
    for begin, end in pairwise(ends):
        joined[begin : begin + min(_SETTLING, (end - begin) // _LONGER_RUN)] = False
    return rows.changed(joined=joined)


def in_parts(rows: Rows) -> list[Rows]:
    """Few of the rows, more of them where there are many, and all."""
    parts = (thinned(rows, *part) for part in PARTS)
    return [*(part for part in parts if part is not rows), rows]


def thinned(rows: Rows, most: int, blocks: int) -> Rows:
    """So many periods of them, in blocks that are not `joined`; the rows themselves where they are not many more.

    The first periods of a block are not `joined` either. Each block lies elsewhere in its part of the recording, so
    that what is commanded again and again is seen all over.
    """
    n, length = len(rows), most // blocks
    if n <= _WORTH_THINNING * most:
        return rows
    part = (n - length) / (blocks - 1)
    late = np.arange(blocks) * GOLDEN % 1.0 * (1.0 - length / part)
    starts = np.rint((np.arange(blocks) + late) * part).astype(int)
    starts[-1] = n - length
    samples = (starts[:, None] + np.arange(length + 1)).ravel()
    seam = np.zeros(len(samples) - 1, np.bool_)
    seam[length :: length + 1] = True
    seam |= np.arange(len(seam)) % (length + 1) < min(_SETTLING, length // _LONGER_RUN)

    some = rows.taken(lambda whole: whole[samples] if len(whole) == n + 1 else whole[samples[:-1]])
    return some.changed(joined=some.joined & ~seam)
