"""Inertia, friction and load torque of emulated shafts, and of shafts integrated here that do what those cannot."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from estimator.interval import Z_95
from estimator.machine import Machine
from estimator.mechanics.mechanics import Mechanics, Told, mechanics, unmoved
from estimator.online.estimate import Status
from estimator.samples import Resolution, Samples
from tests.estimator.mechanics import shafts
from tests.support.samples import machine_of, recorded

MACHINE = Machine(R_s=1.0, L_d=4e-3, L_q=4e-3, psi_f=0.1, n_p=4)
K = 1.5 * MACHINE.n_p * MACHINE.psi_f  # Nm/A
J, B, T_C, TAU_L = 1e-3, 2e-3, 0.05, 0.2


def J_of(said: Mechanics) -> float | None:
    """Its moment of inertia, kg m2, where that is told."""
    return said.estimates["J"].value


def integrated(
    extra: Callable[[float, float, float], float] = lambda _t, _theta, _omega: 0.0, *, seconds: float = 8.0,
    counts: int = 0, middle: float = 0.0, swing: float = 80.0,
) -> Samples:
    """Rows of 1 ms of a shaft under speed control, with an extra drag (Nm) of time, angle and speed; Euler, 50 us."""
    h, per_row = 5e-5, 20
    theta, omega, whole = 0.0, middle, 0.0
    rows: list[tuple[float, float, float, float]] = []
    for row in range(round(seconds * 1000.0)):
        start, first, i_sum = theta, 0.0, 0.0
        for step in range(per_row):
            t = (row * per_row + step) * h
            wanted = middle + swing * min(1.0, max(-1.0, 2.0 * math.sin(2.0 * math.pi * t / 0.8)))
            whole += 0.3 * (wanted - omega) * h
            i_q = (0.06 * (wanted - omega) + whole) / K
            tau = K * i_q - TAU_L - B * omega - T_C * math.tanh(omega / 0.2) - extra(t, theta, omega)
            first, i_sum = (i_q if step == 0 else first), i_sum + i_q
            theta += h * (omega + 0.5 * h * tau / J)
            omega += h * tau / J
        rows.append((start, (theta - start) / (h * per_row), first, i_sum / per_row))
    theta_m, omega_m, i_q, i_q_mean = np.array(rows).T
    if counts:
        theta_m = np.floor(theta_m * counts / math.tau) * math.tau / counts
    zero = np.zeros(len(rows))
    return Samples(
        np.mod(MACHINE.n_p * theta_m, math.tau), MACHINE.n_p * omega_m, zero, i_q, zero, zero, 1e-4, 10, zero, i_q_mean,
        resolution=Resolution(theta_e=MACHINE.n_p * math.tau / counts if counts else 0.0),
    )


@pytest.mark.parametrize("seed", range(900, 912))
def test_every_parameter_of_a_free_shaft_is_told_within_its_interval(seed: int) -> None:
    """J within two per cent, and no error beyond 3.5 standard errors in 45 of them."""
    scenario = shafts.drawn(seed)
    said = mechanics(*shafts.rows_of(scenario, 5.0))
    assert said.status is Told.OK, said.sentence
    assert J_of(said) == pytest.approx(scenario.motor.J, rel=2e-2)
    assert max(abs(shafts.off_by(e, scenario)) for e in shafts.told(said)) < 3.5


def test_intervals_cover() -> None:
    scenarios = [shafts.drawn(seed) for seed in range(950, 974)]
    within = [
        abs(shafts.off_by(e, scenario)) < Z_95
        for scenario in scenarios for e in shafts.told(mechanics(*shafts.rows_of(scenario, 5.0)))
    ]
    assert np.mean(within) > 0.88


@pytest.mark.parametrize("counts", [0, 1000])
def test_a_coarse_encoder_biases_nothing(counts: int) -> None:
    said = mechanics(integrated(counts=counts), MACHINE)
    assert said.status is Told.OK, said.sentence
    truth = {"J": J, "B": B, "T_C": T_C, "tau_L": TAU_L}
    for name, value in truth.items():
        e = said.estimates[name]
        assert e.value is not None
        assert e.std is not None
        assert abs(e.value - value) < 3.5 * e.std, name
    assert J_of(said) == pytest.approx(J, rel=0.003)


def test_rows_of_single_periods_say_what_rows_of_ten_do() -> None:
    scenario = shafts.shaft()
    drive = VirtualDrive(scenario)
    drive.run(3000)
    said = mechanics(recorded(drive, 40_000), machine_of(scenario.motor))
    assert said.status is Told.OK, said.sentence
    assert max(abs(shafts.off_by(e, scenario)) for e in shafts.told(said)) < 3.5
    assert J_of(said) == pytest.approx(scenario.motor.J, rel=3e-3)


def test_the_error_of_psi_f_is_that_of_all_that_scale_with_it() -> None:
    samples, machine = shafts.rows_of(shafts.shaft(), 5.0)
    exact, doubtful = mechanics(samples, machine), mechanics(samples, machine, {"psi_f": 0.05 * machine.psi_f})
    assert J_of(doubtful) == J_of(exact)
    for name in ("J", "T_C", "tau_L"):
        e = doubtful.estimates[name]
        assert e.std == pytest.approx(0.05 * abs(e.value or 0.0), rel=0.05), name


@pytest.mark.parametrize(("middle", "name"), [(80.0, "tau_L + T_C"), (-80.0, "tau_L - T_C")])
def test_in_one_direction_friction_and_load_are_told_as_their_sum(middle: float, name: str) -> None:
    scenario = shafts.shaft(middle=middle, swing=50.0)
    said = mechanics(*shafts.rows_of(scenario, 5.0))
    assert said.status is Told.OK, said.sentence
    assert said.sum is not None
    assert said.sum.name == name
    assert abs(shafts.off_by(said.sum, scenario)) < 3.5
    for parameter in ("T_C", "tau_L"):
        assert said.estimates[parameter].status is Status.NOT_TOLD
        assert said.estimates[parameter].value is None
        assert "one direction" in said.estimates[parameter].reason


@pytest.mark.parametrize("counts", shafts.COUNTS)
@pytest.mark.parametrize("rpm", [0.0, 600.0])
def test_a_shaft_that_a_dynamometer_holds_does_not_accelerate(counts: int, rpm: float) -> None:
    said = mechanics(*shafts.rows_of(shafts.on_dynamometer(shafts.shaft(counts=counts), rpm=rpm), 3.0))
    assert said.status is Told.NO_ACCELERATION
    assert J_of(said) is None
    assert "does not accelerate" in said.sentence or "stands still" in said.sentence


@pytest.mark.parametrize("i_q_step", [0.0, 0.5])
def test_a_shaft_that_another_machine_swings_tells_no_inertia(i_q_step: float) -> None:
    scenario = shafts.on_dynamometer(shafts.shaft(), swing_rpm=300.0, i_q_step=i_q_step)
    said = mechanics(*shafts.rows_of(scenario, 3.0))
    assert said.status is Told.NOT_TOLD
    assert J_of(said) is None


def test_at_one_speed_nothing_is_told() -> None:
    said = mechanics(*shafts.rows_of(shafts.at_one_speed(shafts.shaft()), 3.0))
    assert said.status is Told.NO_ACCELERATION
    assert all(e.value is None for e in said.estimates.values())


@pytest.mark.parametrize("counts", shafts.COUNTS)
def test_a_look_says_of_a_speed_that_keeps_still_what_all_of_it_does(counts: int) -> None:
    swings = shafts.shaft(counts=counts)
    for scenario in (*(shafts.on_dynamometer(swings, rpm=rpm) for rpm in (0.0, 600.0)), shafts.at_one_speed(swings)):
        samples, machine = shafts.rows_of(scenario, 3.0)
        said = unmoved([samples], machine.n_p)
        assert said is not None
        assert said.status is mechanics(samples, machine).status is Told.NO_ACCELERATION
    samples, machine = shafts.rows_of(swings, 3.0)
    assert unmoved([samples], machine.n_p) is None


def test_a_compliant_shaft_is_doubted_or_its_whole_inertia_told() -> None:
    for seed, f in zip(range(980, 988), (8.0, 12.0, 16.0, 20.0, 30.0, 45.0, 70.0, 100.0), strict=True):
        scenario = shafts.compliant(shafts.drawn(seed), 2.0 * shafts.drawn(seed).motor.J, f)
        said = mechanics(*shafts.rows_of(scenario, 5.0))
        told = J_of(said)
        right = told is None or told == pytest.approx(shafts.truth_of(scenario)["J"], rel=0.02)
        assert right or said.status is not Told.OK, (seed, f, told)
    soft = shafts.compliant(shafts.shaft(counts=2**17), 2e-3, 12.0)
    assert mechanics(*shafts.rows_of(soft, 5.0)).status is Told.DOUBTFUL


def test_a_load_that_changes_is_doubted_and_the_inertia_is_told() -> None:
    said = mechanics(integrated(lambda t, _theta, _omega: 0.4 if t > 4.0 else 0.0), MACHINE)
    assert said.status is Told.DOUBTFUL
    assert said.estimates["tau_L"].status is Status.DOUBTFUL
    assert "over time" in said.estimates["tau_L"].reason
    assert said.estimates["J"].status is Status.OK
    assert J_of(said) == pytest.approx(J, rel=0.02)


def test_a_load_that_depends_on_the_angle_is_doubted_by_name() -> None:
    said = mechanics(integrated(lambda _t, theta, _omega: 0.2 * math.sin(theta), swing=20.0), MACHINE)
    assert said.estimates["tau_L"].status is Status.DOUBTFUL
    assert "angle" in said.sentence
    assert J_of(said) == pytest.approx(J, rel=0.02)


def test_a_fans_drag_is_no_viscous_friction() -> None:
    said = mechanics(integrated(lambda _t, _theta, omega: 1e-4 * omega * abs(omega)), MACHINE)
    assert said.estimates["B"].status is Status.DOUBTFUL
    assert "square" in said.estimates["B"].reason
    assert J_of(said) == pytest.approx(J, rel=0.02)


def test_nothing_is_told_across_a_gap() -> None:
    """Rows are cut out of the middle: the rest says the same. Joined as if there were no gap, it does not."""
    samples, machine = shafts.rows_of(shafts.shaft(), 6.0)
    cut = [samples[:2000], samples[2137:4000], samples[4391:]]
    whole, said = mechanics(samples, machine), mechanics(cut, machine)
    assert said.gaps == 2
    assert said.status is Told.OK, said.sentence
    assert J_of(said) == pytest.approx(J_of(whole), rel=1e-3)


def test_a_row_that_is_no_number_is_a_gap() -> None:
    samples, machine = shafts.rows_of(shafts.shaft(), 5.0)
    i_q_mean = np.array(samples.i_q_mean)
    i_q_mean[2500] = math.nan
    said = mechanics(replace(samples, i_q_mean=i_q_mean, u_d=np.full(len(samples), math.nan)), machine)
    assert said.gaps == 1
    assert said.status is Told.OK, said.sentence
    assert J_of(said) == pytest.approx(shafts.shaft().motor.J, rel=3e-3)


def test_a_shaft_that_coasts_tells_its_time_constants() -> None:
    """Without current there is no torque to compare with: nothing is told, and nothing fails."""
    samples, machine = shafts.rows_of(shafts.shaft(), 3.0)
    zero = np.zeros(len(samples))
    said = mechanics(replace(samples, i_d=zero, i_q=zero, i_d_mean=zero, i_q_mean=zero), machine)
    assert J_of(said) is None
    assert said.status is Told.NOT_TOLD


@pytest.mark.parametrize("rows", [0, 1, 5, 60])
def test_too_few_rows_are_no_data(rows: int) -> None:
    samples, machine = shafts.rows_of(shafts.shaft(), 0.1)
    said = mechanics(samples[:rows], machine)
    assert said.status is Told.NO_DATA
    assert {e.status for e in said.estimates.values()} == {Status.NO_DATA}
