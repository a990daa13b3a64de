"""Estimates of a window with witnesses: one more row each, where they and the recording agree.

What the recording does not tell is the witness's, and what is told by it as uncertain as it makes that. Knows nothing
of files.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from bench.live.method import Running
from bench.live.window import Window
from estimator.arrays import Array
from estimator.diagnosis.answer.sentences import quantity, said_of_witness
from estimator.diagnosis.words import number
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.witness import CONTRADICTS, Witness, updated

Estimated = Callable[[Window], WindowEstimate]


def with_witnesses(
    running: Running, estimated: Estimated, witnesses: Mapping[str, Witness]
) -> tuple[WindowEstimate, tuple[str, ...]]:
    """What a window says with witnesses, and a sentence each. `estimated`: what it says by other settings."""
    window, found, remarks = running.window, estimated(running.window), list[str]()
    asked = {name: one for name, one in witnesses.items() if name in window.estimated}
    remarks += [f"{name} is not estimated: its witness has no part in this" for name in witnesses if name not in asked]
    untold = {name: one for name, one in asked.items() if found.estimates[name].status is Status.NOT_TOLD}
    if untold and set(window.estimated) - set(untold):
        found = _held(window, estimated, untold)
        remarks += [f"the recording does not tell {said_of_witness(name, one)}: the witness stands for it"
                    for name, one in untold.items()]  # fmt: skip
    told = {name: e for name, e in found.estimates.items() if _known(e) and name in window.estimated}
    used: dict[str, Witness] = {}
    for name, one in asked.items():
        if name not in told:
            continue
        e = told[name]
        alone = f"the recording alone says {quantity(e.value, e.unit, e.std)}"
        apart = one.apart(e.value or 0.0, e.std or 0.0)
        if apart > CONTRADICTS:
            remarks.append(f"the witness {said_of_witness(name, one)} contradicts the recording by {number(apart)} "
                           f"joint standard errors and is not used: {alone}")  # fmt: skip
        else:
            used[name] = one
            remarks.append(f"the witness {said_of_witness(name, one)} is one more row: {alone}")
    if not used:
        return found, tuple(remarks)
    return replace(found, estimates={**found.estimates, **_updated(running, told, used)}), tuple(remarks)


def _known(e: Estimate) -> bool:
    return e.status in (Status.OK, Status.DOUBTFUL) and e.value is not None and e.std is not None


def _held(window: Window, estimated: Estimated, untold: Mapping[str, Witness]) -> WindowEstimate:
    """The others by the witnesses' values, and what their errors do to them."""
    rest = tuple(name for name in window.estimated if name not in untold)
    at = {name: one.value for name, one in untold.items()}

    def by(values: Mapping[str, float]) -> WindowEstimate:
        return estimated(replace(window, estimated=rest, held={**window.held, **values}))

    found = by(at)
    estimates = dict(found.estimates)
    for name, one in untold.items():
        low, high = (by({**at, name: one.value + side * one.std}).estimates for side in (-1.0, 1.0))
        for other in rest:
            e, ends = estimates[other], (low[other].value, high[other].value)
            if _known(e) and ends[0] is not None and ends[1] is not None:
                estimates[other] = replace(e, std=math.hypot(e.std or 0.0, 0.5 * (ends[1] - ends[0])))
        estimates[name] = replace(estimates[name], reason="by its witness: the recording does not tell it")
    return replace(found, estimates=estimates)


def _updated(running: Running, told: Mapping[str, Estimate], used: Mapping[str, Witness]) -> dict[str, Estimate]:
    """Correlated as the window's normal matrix has it."""
    names = list(told)
    places = [PARAMETERS.index(name) for name in names]
    G = window_ls.sums_of(running.samples, [running.samples.length]).lag0.sum(axis=1)[0][np.ix_(places, places)]
    size = np.sqrt(np.diag(G))
    inverse: Array = np.array(np.linalg.pinv(G / np.outer(size, size), hermitian=True), np.float64)
    spread = np.sqrt(np.diag(inverse))
    std = np.array([e.std or 0.0 for e in told.values()])
    covariance: Array = inverse / np.outer(spread, spread) * np.outer(std, std)
    x, covariance = updated(
        np.array([e.value or 0.0 for e in told.values()]), covariance, [names.index(name) for name in used],
        list(used.values()),
    )  # fmt: skip
    return {
        name: replace(told[name], value=float(x[k]), std=math.sqrt(max(float(covariance[k, k]), 0.0)))
        for k, name in enumerate(names)
    }
