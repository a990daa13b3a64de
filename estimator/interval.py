"""How sure a value is, as people are told it: by an interval, where JSON and files have the standard error.

±, wherever it stands beside a value, is the half width of a 95 % interval: `Z_95` standard errors. Knows nothing of
how these are found, and nothing of words.
"""

from typing import Final

Z_95: Final = 1.96  # standard errors on either side of a normally distributed value that hold the truth 95 times in 100


def half_width(std: float | None) -> float | None:
    """Of a 95 % interval, in the unit of the standard error; None where that is not known."""
    return None if std is None else Z_95 * std
