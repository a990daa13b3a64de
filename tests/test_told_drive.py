"""Told drive: what a machine file says of a drive is used where the recording allows it, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.conceal.populations import POPULATIONS
from estimator.mismatch.diagnose import diagnose
from estimator.mismatch.told_drive import believed
from tests.convention_runs import recording


@pytest.mark.parametrize("kind", ["none", *POPULATIONS])
def test_what_a_drive_has_is_believed_whatever_its_physics(kind: str) -> None:
    for number in range(1, 4):
        runs, _ = recording(kind, number, seed=31, length=1.0)
        assert believed(runs) == (runs, ()), number


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
