"""Prepared: a recording's rows and what is given of its drive, as every fit has them."""

from collections.abc import Mapping, Sequence

import numpy as np

from estimator.diagnosis.angle.angle_rounding import resolution_of, unrounded
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.thinning import settled
from estimator.machine import Machine
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples


def prepared(runs: Sequence[Samples], nominal: Machine, tolerance: Mapping[str, float]) -> tuple[Rows, Given]:
    """Rows of runs of at least 3 samples each, the angle's rounding taken out as far as the rotor's movement tells it.

    tolerance: of R_s, L_d, L_q, psi_f, as a share.
    """
    rows = rows_of(runs, nominal, nominal.i_rated or _highest_current(runs))
    rows, told = rows.changed(angle_turned=runs[0].resolution.turned), runs[0].resolution.theta_e
    resolution = resolution_of(rows, told)
    rows = settled(unrounded(rows, resolution))
    rows.prepare()
    return rows, Given(nominal, tolerance, rows.angle_step if resolution > 0.0 else 0.0)


def _highest_current(runs: Sequence[Samples]) -> float:
    """What stands for a rated current that is not known, A: a few wrong samples do not count."""
    return float(np.quantile(np.concatenate([np.hypot(run.i_d, run.i_q) for run in runs]), 0.999))
