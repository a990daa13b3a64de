"""Told drive: what a machine file says of a drive is used where the recording allows it, and only there."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from emulator.conceal.populations import POPULATIONS
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.drive_data import believed
from estimator.samples import Resolution, Samples
from tests.estimator.diagnosis.convention_runs import recording


@pytest.mark.parametrize("kind", ["none", *POPULATIONS])
def test_what_a_drive_has_is_believed_whatever_its_physics(kind: str) -> None:
    for number in range(1, 4):
        runs, _ = recording(kind, number, seed=31, length=1.0)
        assert believed(runs) == (runs, ()), number


def of_counts(runs: Sequence[Samples], count: float, told: float) -> tuple[Samples, ...]:
    """With an angle that moves by counts (rad), and others that are told."""
    so = Resolution(theta_e=told, encoder=told)
    return tuple(replace(run, theta_e=count * np.floor(run.theta_e / count), resolution=so) for run in runs)


@pytest.mark.parametrize("count", [2e-4, 2e-3, 2e-2])
def test_an_encoder_of_other_counts_than_the_angle_moves_by_is_not_believed(count: float) -> None:
    for number in (1, 3, 5):
        runs, _ = recording("none", number)
        right = of_counts(runs, count, count)
        assert believed(right) == (right, ())
        for told, says in ((4.0, "by less than a count"), (0.25, "by 4 counts at once")):
            left, (said,) = believed(of_counts(runs, count, told * count))
            assert f"encoder_counts is not used: the recorded angle moves {says}; check" in said
            assert all(run.resolution.encoder == run.resolution.theta_e == 0.0 for run in left)


def test_counts_that_are_held_in_rounded_numbers_are_believed() -> None:
    for decimals, count in ((4, 2.5e-4), (3, 2.5e-3)):
        for number in (1, 3, 5):
            runs, _ = recording("none", number)
            held = [replace(run, theta_e=np.round(run.theta_e, decimals)) for run in of_counts(runs, count, count)]
            assert believed(held).remarks == ()


def test_a_dc_link_that_cannot_give_the_voltages_is_not_used() -> None:
    for number in (1, 3, 5):
        runs, _ = recording("none", number)
        high = max(float(np.quantile(np.hypot(run.u_d, run.u_q), 0.99)) for run in runs)
        left, (said,) = believed([replace(run, u_dc=np.full(len(run), 0.9 * high)) for run in runs])
        assert "can give, 2/3 of it: u_dc is not used" in said
        assert all(run.u_dc is None for run in left)


def test_a_diagnosis_without_the_dc_link_says_so_and_promises_no_dead_time() -> None:
    runs, nominal = recording("none", 3, length=1.0)
    said = diagnose([replace(run, u_dc=np.full(len(run), 2.0)) for run in runs], nominal)
    assert any("u_dc = 2.00 V can give" in remark for remark in said.remarks)
    assert said.detectable["inverter_voltage_error"].unit == "V"
