"""Told drive: what is told of a drive beside its recording and is contradicted by it is not used, and that is said.

A dc link that cannot give the voltages, an angle's resolution that is coarser than its steps. Knows no effect.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.mismatch.words import number
from estimator.samples import Samples

Array = NDArray[np.float64]

MOST: Final = 1.3 * 2.0 / 3.0  # of the dc link: no bridge gives as much
_OFTEN: Final = 0.001  # of the rows: more than a few wrong ones
_STILL: Final = 1e-7  # rad in a row: no step
_OFF_GRID: Final = 0.1  # of a step, by which multiples of it may be off
_MOSTLY: Final = 0.5  # of the steps
_FINER: Final = 0.1  # of a step; numbers that round its multiples are coarser


class Believed(NamedTuple):
    """Runs without what they contradict, and what that was."""

    runs: tuple[Samples, ...]
    remarks: tuple[str, ...]


def believed(runs: Sequence[Samples]) -> Believed:
    """The runs with what is told of their drive, as far as they allow it."""
    found, remarks = tuple(runs), list[str]()
    if said := _too_low(runs):
        found = tuple(replace(run, u_dc=None) for run in found)
        remarks.append(said)
    if said := _too_coarse(runs):
        found = tuple(replace(run, resolution=run.resolution._replace(theta_e=0.0)) for run in found)
        remarks.append(said)
    return Believed(found, tuple(remarks))


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


def _too_coarse(runs: Sequence[Samples]) -> str | None:
    """A resolution of the angle that is coarser than its steps, in a sentence."""
    told = runs[0].resolution.theta_e
    steps = np.abs(np.concatenate([_turned(run.theta_e) for run in runs]))
    steps = steps[steps > _STILL]
    if told <= 0.0 or len(steps) < 2:
        return None
    off = np.abs(steps / told - np.maximum(np.rint(steps / told), 1.0))
    apart = np.diff(np.unique(np.round(steps, 7)))
    if float(np.mean(off > _OFF_GRID)) < _MOSTLY or len(apart) == 0 or float(np.median(apart)) > _FINER * told:
        return None
    return (
        f"theta_e moves by less than the {number(told)} rad (electrical) that the encoder's counts and the pole pairs "
        "make: the angle's resolution is taken for unknown; expected the counts of a mechanical turn"
    )


def _turned(theta_e: Array) -> Array:
    """Angle turned in each row, rad, -pi to pi."""
    D = np.diff(theta_e)
    return D - 2.0 * np.pi * np.rint(D / (2.0 * np.pi))
