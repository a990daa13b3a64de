"""Arrays, by what is in them; shapes stand where they are used."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers."""
Vector = NDArray[np.complex128]
"""Complex space vectors, one a sample or a period."""
Vectors = NDArray[np.complex128]
"""Several of those, one a row."""
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]


def stretches(there: Bools) -> list[tuple[int, int]]:
    """Begin and end of each stretch that is there."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], there, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
