"""A machine with effects beside a recording that took no part in finding them. Knows nothing of how they were found."""

from collections.abc import Sequence
from dataclasses import dataclass

from estimator.arrays import Array, Vector
from estimator.diagnosis.angle.hall_edges import through_edges
from estimator.diagnosis.answer.quality import rms
from estimator.diagnosis.intake.prepared import prepared
from estimator.diagnosis.verdict import ErrorChange
from estimator.machine import PARAMETERS
from estimator.samples import Samples
from estimator.twin.currents import free_run
from estimator.twin.model import Model, residual


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What a model leaves of a recording, before: the machine alone, after: with its effects."""

    one_step_rms_V: ErrorChange
    free_run_rms_A: ErrorChange  # simulated from the measured current every 0.1 s
    t: Array  # s, at samples
    i: Vector  # A, free-running, with effects, rotor frame


def compared_with(runs: Sequence[Samples], model: Model) -> Comparison:
    """The model's twin beside a recording's runs. Raises ValueError where none of them has 3 samples."""
    long_enough = [run for run in through_edges(runs).runs if len(run) >= 3]
    if not long_enough:
        raise ValueError("expected a run of at least 3 samples without a gap, came none")
    rows, _ = prepared(long_enough, model.machine, dict.fromkeys(PARAMETERS, 0.0))
    steps: list[float] = []
    errors: list[float] = []
    i = rows.i
    for one in (Model(model.machine, angle=model.angle), model):
        i = free_run(rows, one)
        steps.append(rms(residual(rows, rows, one)[rows.joined]))
        errors.append(rms((i - rows.i)[1:][rows.joined]))
    return Comparison(ErrorChange(*steps), ErrorChange(*errors), rows.t, i)
