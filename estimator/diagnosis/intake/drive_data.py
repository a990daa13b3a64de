"""Told drive: what is told of a drive beside its recording and is contradicted by it is not used, and that is said.

A dc link that cannot give the voltages; an encoder of other counts than the angle moves by. Knows no effect.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from estimator.diagnosis.angle.angle_rounding import grid_of
from estimator.diagnosis.words import number
from estimator.samples import NOT_KNOWN, Samples

MOST_OF_LINK: Final = 1.3 * 2.0 / 3.0  # of the dc link: no bridge gives as much
_OFTEN: Final = 0.001  # of the rows: more than a few wrong ones
_OFF: Final = 0.05  # of a count, and a step of the numbers, by which a movement may be off whole ones
_ROUGH: Final = 0.25  # of a count: numbers that are as coarse do not tell
_ELSEWHERE: Final = 0.15  # of the rows, whose movement is none of whole counts
_FEW_MOVING: Final = 0.02  # of the rows that move, the same, where they are
_FEWEST_MOVING: Final = 200  # rows
_MOST_AT_ONCE: Final = 64  # counts
_DIFFERENT: Final = 3  # movements, at least
_MOVEMENT_DIGITS: Final = 9  # of a movement in rad, that tell values apart


class Remarked(NamedTuple):
    """Runs without what was not to be used, and what that was, in sentences."""

    runs: tuple[Samples, ...]
    remarks: tuple[str, ...]


def believed(runs: Sequence[Samples]) -> Remarked:
    """The runs with what is told of their drive, as far as they allow it."""
    found, remarks = tuple(runs), list[str]()
    if said := _too_low(found):
        found, remarks = tuple(replace(run, u_dc=None) for run in found), [*remarks, said]
    if said := _other_counts(found):
        unknown = [run.resolution._replace(theta_e=0.0, encoder=0.0) for run in found]
        found = tuple(replace(run, resolution=so) for run, so in zip(found, unknown, strict=True))
        remarks.append(said)
    return Remarked(found, tuple(remarks))


def _too_low(runs: Sequence[Samples]) -> str | None:
    """A dc link that cannot give the voltages, in a sentence."""
    links = [run.u_dc for run in runs if run.u_dc is not None]
    if not links or len(links) < len(runs):
        return None
    u_dc, u = np.concatenate(links), np.concatenate([np.hypot(run.u_d, run.u_q) for run in runs])
    if float(np.mean(u > MOST_OF_LINK * u_dc)) < _OFTEN:
        return None
    return (
        f"voltages of up to {number(float(np.quantile(u, 0.999)))} V are beyond what u_dc = "
        f"{number(float(np.median(u_dc)))} V can give, 2/3 of it: u_dc is not used, and no dead time can be told; "
        "expected the dc link's voltage in V"
    )


def _other_counts(runs: Sequence[Samples]) -> str | None:
    """Counts by which the angle does not move, in a sentence."""
    told = runs[0].resolution if runs else NOT_KNOWN
    count, numbers = told.encoder, told.numbers
    parts = [np.diff(run.theta_e) for run in runs if run.periods == 1]
    moves = np.concatenate([np.zeros(0), *parts])
    within = _OFF * count + numbers
    moves = moves[(np.abs(moves) > within) & (np.abs(moves) < math.pi)]  # none where it begins anew
    if count == 0.0 or numbers > _ROUGH * count or len(moves) < _FEWEST_MOVING:
        return None
    values, often = np.unique(np.round(moves, _MOVEMENT_DIGITS), return_counts=True)

    def off(step: float, within: float) -> float:
        """Share of the movements that are none of whole steps."""
        elsewhere = np.abs(values - step * np.rint(values / step)) > within
        return float(np.sum(often[elsewhere])) / len(moves)

    rounded = grid_of(values)  # by numbers that hold the angle, where they are not told
    if (numbers or rounded) and off(count, within + (0.0 if numbers else rounded)) > _ELSEWHERE:
        says = "less than a count"
    else:
        coarser = next((n for n in range(_MOST_AT_ONCE, 1, -1) if off(n * count, within) < _FEW_MOVING), None)
        if coarser is None or len(np.unique(np.rint(values / (coarser * count)))) < _DIFFERENT:
            return None
        says = f"{coarser} counts at once"
    return (
        f"encoder_counts is not used: the recorded angle moves by {says}; check encoder_counts, n_p, and with how many "
        "digits theta_e is recorded"
    )
