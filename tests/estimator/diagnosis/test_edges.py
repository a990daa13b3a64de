"""Recordings at the edge of what can be diagnosed: an answer in order, whatever is missing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.likelihood.identifiability import at_its_bound
from estimator.diagnosis.likelihood.noise import noise_of
from estimator.diagnosis.verdict import Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.physics.rows import rows_of
from estimator.samples import Samples
from tests.estimator.diagnosis.convention_runs import recording


@pytest.fixture(scope="module")
def healthy() -> tuple[Samples, Machine]:
    """A drive without effects."""
    (run, *_), nominal = recording("none", 1, length=1.0)
    return run, nominal


def test_a_phase_that_is_what_the_others_leave_is_no_third_sensor(healthy: tuple[Samples, Machine]) -> None:
    run, nominal = healthy
    assert run.i_a is not None
    assert run.i_b is not None
    rated = nominal.i_rated or 1.0
    assert rows_of([run], nominal, rated).zero is not None
    computed = replace(run, i_c=np.round(-run.i_a - run.i_b, 5))
    assert rows_of([computed], nominal, rated).zero is None


def test_all_may_be_trusted_by_a_hundred_per_cent(healthy: tuple[Samples, Machine]) -> None:
    run, nominal = healthy
    said = diagnose([run], nominal, trust=dict.fromkeys(PARAMETERS, 1.0))
    assert said.findings == ()
    assert said.detectable["dc_link_gain"].value == math.inf


def test_without_a_dc_link_no_dead_time_is_promised(healthy: tuple[Samples, Machine]) -> None:
    run, nominal = healthy
    told = diagnose([replace(run, u_dc=None)], nominal).detectable["inverter_voltage_error"]
    assert told.unit == "V"  # of drops, which look like it
    assert told.value is not None
    assert told.value < 10.0


def test_runs_too_short_to_be_judged_by_are_told_before_anything_is_fitted(healthy: tuple[Samples, Machine]) -> None:
    run, nominal = healthy
    pieces = [run[0:30], *(run[k : k + 12] for k in range(30, len(run) - 12, 14))]
    said = diagnose(pieces, nominal)
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert "expected stretches of at least 16 periods without a gap" in said.sentence


def test_a_current_that_does_not_move_at_all_has_some_noise(healthy: tuple[Samples, Machine]) -> None:
    run, nominal = healthy
    rows = rows_of([run], nominal, nominal.i_rated or 1.0)
    assert min(noise_of(np.zeros(len(rows), np.complex128), np.zeros(len(rows) + 1), rows)) > 0.0


def test_a_parameter_at_the_end_of_its_range_is_not_told_as_an_estimate(healthy: tuple[Samples, Machine]) -> None:
    nominal = replace(healthy[1], R_s=6.3)
    assert at_its_bound("R_s", 0.3 * 6.3, nominal) == (
        "R_s lies at the end of the range searched, 0.30 times its nominal 6.30 ohm, or beyond it"
    )


@pytest.mark.slow
def test_of_a_parameter_beyond_its_range_the_diagnosis_says_so(healthy: tuple[Samples, Machine]) -> None:
    scarcely = replace(healthy[1], R_s=healthy[1].R_s * 4.0)
    assert any("R_s lies at the end" in said for said in diagnose([healthy[0]], scarcely).remarks)
