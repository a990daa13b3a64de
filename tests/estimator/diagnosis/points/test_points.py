"""Steady points of the emulated drive: what is in them is named and sized, what is not is not.

The points are means of short runs of the plant, by equations that the estimator does not share.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.sensing import AngleSensing
from emulator.plant.physics.skin import Skin
from estimator.diagnosis.points.diagnose import diagnose_points
from estimator.diagnosis.points.no_load import NoLoad
from estimator.diagnosis.points.no_load_diagnosis import diagnose_no_load
from estimator.diagnosis.points.table import FEWEST_POINTS, Points, steady
from estimator.diagnosis.verdict import Diagnosis, Verdict
from tests.emulator.plant.physics.effect_runs import SALIENT
from tests.estimator.diagnosis.points.steady_points import operating_points, steady_points, without_load

pytestmark = pytest.mark.slow

DROP = Inverter(u_transistor=1.0, u_diode=1.0)
# 6 V of dead time hold small currents at zero, which turns what is lost off the current's way
CLAMPED = {"dead time": {"L_d": 0.05, "L_q": 0.05}}
FUNDAMENTAL = 4.0 / math.pi  # of a square wave of 1


def diagnosed(points: Points) -> Diagnosis:
    return diagnose_points(points, n_p=SALIENT.n_p, i_rated=SALIENT.i_rated)


def names(diagnosis: Diagnosis) -> set[str]:
    return {finding.effect for finding in diagnosis.findings}


def noisy(points: Points, volts: float, seed: int) -> Points:
    """With the noise of instruments."""
    draw = np.random.default_rng(seed).normal
    n = len(points)
    return replace(points, u=points.u + volts * (draw(size=n) + 1j * draw(size=n)))


@pytest.fixture(scope="module")
def plain() -> Points:
    """Of a motor without effects."""
    return steady_points(operating_points())


@pytest.fixture(scope="module")
def dropping() -> Points:
    """Of an inverter whose switches and diodes drop 1 V."""
    return steady_points(operating_points(), inverter=DROP)


CASES: dict[str, tuple[dict[str, Any], dict[str, dict[str, tuple[float, float]]]]] = {
    "dead time": (
        {"inverter": Inverter(dead_time=2e-6)},
        {"inverter_voltage_error": {"voltage": (FUNDAMENTAL * 2e-6 / 1e-4 * 310.0, 0.1)}},
    ),
    "drops": ({"inverter": DROP}, {"inverter_voltage_error": {"voltage": (FUNDAMENTAL, 0.1)}}),
    "saturation": (
        {"saturation": Saturation(L_q_drop=0.25)}, {"q_axis_saturation": {"L_q_drop": (0.25, 0.02)}},
    ),
    "cross": ({"saturation": Saturation(cross_drop=0.15)}, {"cross_saturation": {"cross_drop": (0.15, 0.02)}}),
    "iron": (
        {"iron_loss": IronLoss(R_c=100.0, omega_h=300.0)},
        {"iron_loss": {"R_c": (100.0, 0.05), "omega_h": (300.0, 0.1)}},
    ),
    "skin": ({"skin": Skin(1.0, 100.0)}, {"ac_resistance": {"rise": (2.0, 0.05), "corner": (100.0, 0.05)}}),
    "angle": (
        {"angle_sensing": AngleSensing(offset=0.02)}, {"angle_offset": {"offset": (0.02 * SALIENT.n_p, 0.02)}},
    ),
    "drops and saturation": (
        {"inverter": DROP, "saturation": Saturation(L_q_drop=0.2)},
        {"inverter_voltage_error": {"voltage": (FUNDAMENTAL, 0.1)}, "q_axis_saturation": {"L_q_drop": (0.2, 0.1)}},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_an_effect_of_the_plant_is_named_and_sized_and_no_other(case: str) -> None:
    effects, expected = CASES[case]
    said = diagnosed(steady_points(operating_points(), **effects))
    assert names(said) == set(expected), said.sentence
    for finding in said.findings:
        for name, (size, share) in expected[finding.effect].items():
            found = finding.parameters[name]
            assert found.value is not None and found.std is not None
            assert abs(found.value - size) <= max(share * size, 2.0 * found.std), (name, found)
    for name, tolerance in (("R_s", 0.02), ("L_d", 0.02), ("L_q", 0.03), ("psi_f", 0.005)):
        found, true = said.machine_after[name], getattr(SALIENT, name)
        assert found.value is not None and found.std is not None
        share = CLAMPED.get(case, {}).get(name, tolerance)
        assert abs(found.value - true) <= max(share * true, 2.0 * found.std), (name, found)


def test_without_an_effect_nothing_is_named_and_what_would_have_shown_is_told(plain: Points) -> None:
    said = diagnosed(plain)
    assert said.verdict is Verdict.NO_MISMATCH and not said.findings
    assert "it would have shown the inverter's voltage error from" in said.sentence
    assert set(said.detectable) >= {"inverter_voltage_error", "q_axis_saturation", "iron_loss", "ac_resistance"}
    assert said.machine_after["psi_f"].value == pytest.approx(SALIENT.psi_f, rel=1e-3)


@pytest.mark.parametrize("volts", [0.02, 0.2, 1.0])
def test_noise_is_never_given_a_name(plain: Points, volts: float) -> None:
    for seed in range(3):
        for part in (plain, plain.at(np.arange(0, len(plain), 4)), plain.at(np.arange(15, 30))):
            said = diagnosed(noisy(part, volts, seed))
            assert not said.findings, said.sentence


def test_what_is_named_with_noise_is_within_its_interval(dropping: Points) -> None:
    for seed in range(4):
        said = diagnosed(noisy(dropping, 0.1, seed))
        assert names(said) == {"inverter_voltage_error"}
        found = said.findings[0].parameters["voltage"]
        assert found.value is not None and found.std is not None
        assert abs(found.value - FUNDAMENTAL) < 2.0 * found.std
        assert found.std < 0.15 * FUNDAMENTAL
        assert said.findings[0].absorbed_as["R_s"] > 0.0  # it hid as resistance


def test_an_error_too_faint_for_the_noise_is_no_finding_but_a_doubt_or_nothing(dropping: Points) -> None:
    verdicts = {diagnosed(noisy(dropping, 1.5, seed)).verdict for seed in range(4)}
    assert verdicts <= {Verdict.AMBIGUOUS, Verdict.NO_MISMATCH, Verdict.NOT_ENOUGH_EXCITATION}


def test_iron_loss_and_a_late_voltage_are_not_told_apart_where_noise_hides_their_difference() -> None:
    points = noisy(steady_points(operating_points(), iron_loss=IronLoss(R_c=400.0)), 0.1, 1)
    said = diagnosed(points)
    assert said.verdict is Verdict.AMBIGUOUS and not said.findings
    (doubt,) = said.ambiguous
    assert set(doubt.effects) == {"iron_loss", "voltage_delay"}
    assert "collinear" in doubt.reason
    assert doubt.experiment.holds and "would tell" in doubt.experiment.sentence


@pytest.mark.parametrize(("delay", "way"), [(1.5e-4, "later"), (-1.5e-4, "earlier")])
def test_a_voltage_that_acts_at_another_time_is_named_in_seconds(plain: Points, delay: float, way: str) -> None:
    said = diagnosed(replace(plain, u=plain.u * np.exp(1j * plain.omega_e * delay)))
    (finding,) = said.findings
    assert finding.effect == "voltage_delay"
    found = finding.parameters["delay"]
    assert found.unit == "s"
    assert found.value == pytest.approx(delay, rel=0.02)
    assert f"the voltage acts {way} than its row says" in said.sentence


def test_two_effects_that_each_take_the_others_place_come_to_an_end() -> None:
    omega, i_d, i_q = (x.ravel() for x in np.meshgrid([100.0, 300.0, 600.0, 900.0], [-4.0, -2.0, 0.0, 2.0],
                                                      [-5.0, -2.0, 1.0, 3.0, 6.0]))  # fmt: skip
    noise = np.random.default_rng(0).normal(0.0, 0.01, (2, len(omega)))
    u = 0.5 * (i_d + 1j * i_q) + omega * (-1.6e-3 * i_q + 1j * (1.6e-3 * i_d + 0.074)) + noise[0] + 1j * noise[1]
    said = diagnose_points(Points(omega, i_d + 1j * i_q, u * np.exp(-0.05j)), n_p=4, i_rated=None)
    assert said.verdict is Verdict.AMBIGUOUS
    assert {"iron_loss", "angle_offset"} in [set(doubt.effects) for doubt in said.ambiguous]


def test_points_without_levels_of_i_d_do_not_pretend_to_know_l_d(plain: Points) -> None:
    said = diagnosed(plain.at(np.flatnonzero(np.abs(plain.i.real) < 0.1)))
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert "these points do not tell L_d" in said.remarks
    few = diagnosed(plain.at(np.arange(FEWEST_POINTS - 1)))
    assert few.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert f"expected at least {FEWEST_POINTS} steady points" in few.sentence


def swapped(points: Points) -> Points:
    """With the sign of u_q the other way."""
    return replace(points, u=points.u - 2j * points.u.imag)


def generator(points: Points) -> Points:
    return replace(points, i=-points.i)


def backwards(points: Points) -> Points:
    return replace(points, omega_e=-points.omega_e)


@pytest.mark.parametrize("turned", [swapped, generator, backwards])
def test_points_of_another_convention_get_no_name(dropping: Points, turned: Callable[[Points], Points]) -> None:
    said = diagnosed(turned(dropping))
    assert not said.findings and said.verdict is Verdict.UNEXPLAINED
    assert "come out negative: expected peak dq quantities in the motor's sign convention" in said.sentence


def test_at_standstill_a_resistance_and_a_voltage_error_are_told_and_no_inductance() -> None:
    levels = (*range(-6, 0), -0.5, 0.5, *range(1, 7))
    said = diagnosed(steady_points([(0.0, complex(i_d)) for i_d in levels], inverter=DROP))
    assert names(said) == {"inverter_voltage_error"}
    found = said.findings[0].parameters["voltage"]
    assert found.value == pytest.approx(4.0 / 3.0, rel=0.05)  # along phase a, by Clarke of 1, -1 and -1
    assert any(remark.startswith("at standstill what an inverter loses") for remark in said.remarks)
    assert "these points do not tell L_d, L_q, psi_f" in said.remarks
    assert said.machine_after["R_s"].value == pytest.approx(SALIENT.R_s, rel=0.02)


def test_of_a_log_only_steady_rows_are_used(plain: Points) -> None:
    n = len(plain)
    rows = np.repeat(np.arange(n), 6)  # every point held for six rows, with a step between
    stopped, nothing = np.zeros(50), np.zeros(50, np.complex128)
    log = Points(
        np.concatenate((plain.omega_e[rows], stopped)), np.concatenate((plain.i[rows], nothing)),
        np.concatenate((plain.u[rows], nothing)), 0.5 * np.arange(6.0 * n + 50.0),
    )  # fmt: skip
    kept = steady(log)
    assert len(kept.points) <= 4 * n  # the rows beside a step are none
    assert all(k % 6 not in (0, 5) for k in kept.places if 6 <= k < 6 * n - 6 and rows[k] != rows[k - 1])
    assert any("the drive stands without current: 50" in remark for remark in kept.remarks)
    said = diagnosed(log)
    assert not said.findings
    assert any("drift of the magnets' flux is not told from none" in remark for remark in said.remarks)


def test_a_drift_of_the_flux_over_a_log_is_named_and_sized() -> None:
    where = operating_points((40.0, 80.0), [(0.0, 1.0), (-2.0, 4.0), (-4.0, -1.0), (2.0, -4.0)] * 6)
    order: list[int] = np.random.default_rng(2).permutation(len(where)).tolist()
    share = np.linspace(0.0, -0.04, len(where))
    parts = [
        steady_points([where[k]], SALIENT._replace(psi_f=SALIENT.psi_f * (1.0 + share[row])))
        for row, k in enumerate(order)
    ]
    rows = np.arange(len(parts))
    omega_e, i, u = (np.concatenate([getattr(part, name) for part in parts])[rows] for name in ("omega_e", "i", "u"))
    said = diagnosed(Points(omega_e, i, u, np.arange(float(len(rows)))))
    assert "rows jump from one to the next" in said.remarks[0]
    assert names(said) == {"magnet_flux_drift"}, said.sentence
    found = said.findings[0].parameters["change"]
    assert found.value == pytest.approx(-0.04, rel=0.1)


# --- without load, i_q not known


def test_without_load_the_voltage_error_is_told_from_what_upstream_fits_freely() -> None:
    said = diagnose_no_load(without_load(0.8, inverter=DROP))
    assert said.verdict is Verdict.EXPLAINED and names(said) == {"inverter_voltage_error"}
    found = said.findings[0].parameters["voltage"]
    assert found.value == pytest.approx(FUNDAMENTAL, rel=0.1)
    assert said.fit is not None and said.fit.leave_one_out is not None
    assert said.fit.leave_one_out.after < 0.5 * said.fit.leave_one_out.before
    assert said.machine_after["psi_f"].value == pytest.approx(SALIENT.psi_f, rel=0.003)


@pytest.mark.parametrize("effects", [
    {}, {"saturation": Saturation(0.04, 0.25, 0.1)}, {"iron_loss": IronLoss(R_c=400.0)}, {"skin": Skin(1.0, 100.0)},
    {"angle_sensing": AngleSensing(offset=0.02)},
])  # fmt: skip
def test_without_load_nothing_is_named_that_is_not_there(effects: dict[str, Any]) -> None:
    points = without_load(**effects)
    for seed, volts in enumerate((0.0, 0.01, 0.05, 0.2)):
        draw = np.random.default_rng(seed).normal(size=len(points.y))
        said = diagnose_no_load(replace(points, y=points.y + volts * draw))
        assert not said.findings, said.sentence


def test_too_few_levels_without_load_are_refused_a_verdict() -> None:
    speeds, levels = np.tile([100.0, 200.0, 300.0], 2), np.repeat([0.0, -1.0], 3)
    for few in (NoLoad(speeds, 0.01 * speeds, levels, 0.1), NoLoad(0.0 * speeds + 100.0, 0.01 * speeds, levels, 0.1)):
        said = diagnose_no_load(few)
        assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
        assert "expected at least 3 levels of i_d with at least 3 speeds each" in said.sentence


def test_a_level_with_one_speed_is_left_out() -> None:
    points = without_load(0.8, inverter=DROP)
    more = NoLoad(np.append(points.omega_e, 100.0), np.append(points.y, 99.0), np.append(points.i_d, 1.0), points.R_s)
    said = diagnose_no_load(more)
    assert names(said) == {"inverter_voltage_error"}
    assert "points left out at levels with fewer than 3 speeds: 1" in said.remarks
