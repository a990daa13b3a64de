"""Doubts: no estimate is ok that comes of equations that do not fit. Its numbers stay; its status and reason say so."""

from collections.abc import Mapping
from dataclasses import replace

from estimator.machine import PLAUSIBLE
from estimator.online.estimate import Estimate, Status, WindowEstimate


def doubted(result: WindowEstimate, mismatch: str, of: Mapping[str, str] | None = None) -> dict[str, Estimate]:
    """Estimates, of which none is ok that comes of equations that do not fit.

    `mismatch`: a sentence where constant parameters do not explain the rows, else empty. `of`: the same of single
    parameters.
    """
    own = of or {}
    return {
        name: _doubted(e, result.impossible, mismatch, own.get(name, "")) for name, e in result.estimates.items()
    }


def _doubted(e: Estimate, impossible: tuple[str, ...], mismatch: str, own: str) -> Estimate:
    if e.status is not Status.OK:
        return e
    reasons = [reason for reason in (_impossible(e, impossible), own, mismatch) if reason]
    return replace(e, status=Status.DOUBTFUL, reason="; ".join(reasons)) if reasons else e


def _impossible(e: Estimate, impossible: tuple[str, ...]) -> str:
    if e.name in impossible:
        low, high = PLAUSIBLE[e.name]
        return f"no motor has it, expected {low:g} to {high:g} {e.unit}: a unit is wrong, or the equations do not fit"
    if impossible:
        return f"{', '.join(impossible)} of the same fit come out as no motor has them: the equations do not fit"
    return ""
