"""A step of the magnets' flux is found between samples, by the recordings of an emulated drive."""

import math

import pytest

from emulator.conceal.recording import Choice, drawn
from estimator.diagnosis.search.flux_step import with_step_in_place
from estimator.twin.model import Model
from tests.support.samples import machine_of, rows_of_columns

TURN = 2.0 * math.pi


@pytest.mark.parametrize("motor", ["beckhoff_am8141", "servo_4nm", "hbl48zl400"])
@pytest.mark.parametrize("off", [0.0, -60.0, 60.0])
def test_the_moment_and_the_duration_of_a_step_are_found(motor: str, off: float) -> None:
    """From as many periods off and half the duration."""
    concealed, c = drawn(Choice(9, ("demagnetisation",), (0.4, 1.0), (motor,), 3.0), 1)
    true, drive, step = concealed.scenario.motor, concealed.scenario.drive, concealed.scenario.effects.demagnetisation
    machine = machine_of(true)
    rows = rows_of_columns(c, machine, drive.T_s)
    middle = step.time + 0.5 * step.duration
    begin = (middle + off * drive.T_s - rows.span[0]) / rows.span[1]
    angle = -0.5 * TURN * true.n_p / drive.encoder_counts  # mean rounding
    model = with_step_in_place(
        rows, rows, Model(machine, {"magnet_flux_step": (-step.share, begin, 0.5 * step.duration)}, angle)
    )  # fmt: skip
    change, time, duration = model.effects["magnet_flux_step"]
    assert change == -step.share
    assert rows.span[0] + time * rows.span[1] == pytest.approx(middle, abs=0.5 * drive.T_s)
    assert duration == pytest.approx(step.duration, abs=drive.T_s)
