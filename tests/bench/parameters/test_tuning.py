"""Gains by rule, tried on the emulated drive: what they promise is what comes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.errors import LimitError
from bench.parameters.tuning import current_loop, speed_loop
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, Run

IDEAL = replace(PAPER, drive=replace(PAPER.drive, noise_i=0.0, adc_bits=0))
M, T_S = PAPER.motor, PAPER.drive.T_s


def current_step(settings: dict[str, float]) -> NDArray[np.float64]:
    still = replace(IDEAL.excitation, i_d_ref=0.0, i_q_ref=0.0, i_d_step=0.0, i_q_step=0.0)
    drive = VirtualDrive(replace(IDEAL, settings=settings, excitation=still))
    drive.record(500)
    drive.write("i_q_ref", 2.0)
    return drive.record(200)["i_q"] / 2.0


def test_the_fastest_current_loop_overshoots_as_the_magnitude_optimum_does() -> None:
    tuned = current_loop(M.R_s, M.L_d, M.L_q, T_S)
    i = current_step(dict(tuned.values))
    assert 1.02 < i.max() < 1.08
    assert abs(i[100:] - 1.0).max() < 0.005


@pytest.mark.parametrize("bandwidth", [300.0, 600.0, 1200.0])
def test_a_slower_one_has_the_bandwidth_that_was_asked_for(bandwidth: float) -> None:
    i = current_step(dict(current_loop(M.R_s, M.L_d, M.L_q, T_S, bandwidth).values))
    at = int(np.argmax(i >= 1.0 - math.exp(-1.0))) * T_S
    assert at == pytest.approx(1.0 / bandwidth + 1.5 * T_S, abs=2.0 * T_S)
    assert i.max() < 1.01


def test_the_speed_loop_crosses_over_where_it_is_to() -> None:
    J = 2e-3
    current = current_loop(M.R_s, M.L_d, M.L_q, T_S, 1250.0)
    delays = 1.0 / 1250.0 + PAPER.drive.speed_filter + 0.5 * T_S
    tuned = speed_loop(J, M.psi_f, M.n_p, delays)
    run = Run(shaft="free", speed_rpm=300.0, speed_control=True, speed_reference="ramp")
    start = 300.0 * math.tau / 60.0 * M.n_p
    excitation = replace(IDEAL.excitation, i_d_step=0.0, i_q_step=0.0, i_q_ref=0.0, speed_ref=start, speed_ramp=0.0)
    settings = {**current.values, **tuned.values}
    drive = VirtualDrive(replace(
        IDEAL, motor=M._replace(J=J), run=run, excitation=excitation, settings=settings,
        drive=replace(IDEAL.drive, i_max=50.0, adc_full=75.0),
    ))
    drive.record(2000)
    drive.write("speed_ref", start + 10.0)
    speed = (drive.record(2000)["omega_e"] - start) / 10.0
    assert 1.3 < speed.max() < 1.55  # 43 % by the book, without a filter before it
    assert abs(speed[-200:] - 1.0).max() < 0.01
    assert math.degrees(tuned.phase_margin) == pytest.approx(36.9, abs=0.1)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(LimitError, match=r"expected at most 3333 rad/s with a control period of 0\.0001 s, got 5000"):
        current_loop(1.0, 1e-3, 1e-3, 1e-4, 5000.0)
    with pytest.raises(LimitError, match="the loop would ring"):
        speed_loop(1e-3, 0.1, 4, 1e-3, a=1.0)
    with pytest.raises(LimitError, match="expected inertia"):
        speed_loop(0.0, 0.1, 4, 1e-3)
