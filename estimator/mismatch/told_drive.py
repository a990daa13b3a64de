"""Told drive: what is told of a drive beside its recording and is contradicted by it is not used, and that is said.

A dc link that cannot give the voltages. Knows no effect.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from estimator.mismatch.words import number
from estimator.samples import Samples

MOST: Final = 1.3 * 2.0 / 3.0  # of the dc link: no bridge gives as much
_OFTEN: Final = 0.001  # of the rows: more than a few wrong ones


class Believed(NamedTuple):
    """Runs without what they contradict, and what that was."""

    runs: tuple[Samples, ...]
    remarks: tuple[str, ...]


def believed(runs: Sequence[Samples]) -> Believed:
    """The runs with what is told of their drive, as far as they allow it."""
    said = _too_low(runs)
    if said is None:
        return Believed(tuple(runs), ())
    return Believed(tuple(replace(run, u_dc=None) for run in runs), (said,))


def _too_low(runs: Sequence[Samples]) -> str | None:
    """A dc link that cannot give the voltages, in a sentence."""
    links = [run.u_dc for run in runs if run.u_dc is not None]
    if not links or len(links) < len(runs):
        return None
    u_dc, u = np.concatenate(links), np.concatenate([np.hypot(run.u_d, run.u_q) for run in runs])
    if float(np.mean(u > MOST * u_dc)) < _OFTEN:
        return None
    return (
        f"voltages of up to {number(float(np.quantile(u, 0.999)))} V are beyond what u_dc = "
        f"{number(float(np.median(u_dc)))} V can give, 2/3 of it: u_dc is not used, and no dead time can be told; "
        "expected the dc link's voltage in V"
    )
