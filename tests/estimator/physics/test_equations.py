"""Each effect's equation beside the edge-accurate drive that has it, without any noise: what it misses of it."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.conceal.populations import KINDS
from emulator.conceal.recording import Choice, drawn
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.saturation import Saturation
from emulator.scenario.motors import MOTORS as ALL_MOTORS
from estimator.diagnosis.likelihood.thinning import settled
from estimator.physics.library import BY_NAME
from estimator.twin.model import Model
from tests.estimator.physics.equations import SECONDS, fitted_to, left_of, rows_without_noise, with_effect
from tests.score.truth import EFFECT
from tests.support.samples import machine_of, rows_of_columns

MOTORS = ("servo_4nm", "mini_cheetah")  # whose current settles in 29 and in 3 control periods
MISSED = {  # per mille of rated current; 0.1 where not told
    "dead_time": 1.0, "drops": 2.5, "flux_harmonics": 0.3, "inductance_harmonics": 0.4, "current_skew": 0.15,
    "imbalance": 0.2, "angle_signals": 3.0, "signal_harmonics": 1.5, "hall_displaced": 1.0,
}  # fmt: skip
CLASSES = sorted(set(EFFECT) - {
    "dc_link_gain", "demagnetisation", "winding_heat",
    "winding_warmed", "magnets_warmed",  # by a course: see test_temperature_course
    "over_compensated", "under_compensated",  # a dead time and what makes up for it: see test_dead_time_compensation
})  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize("kind", ["none", *CLASSES])
def test_an_equation_misses_little_of_its_effect(kind: str, motor: str) -> None:
    scenario = with_effect(kind, motor, SECONDS) if kind == "magnet_heat" else with_effect(kind, motor)
    rows = rows_without_noise(scenario)
    before, after, *_ = fitted_to(rows, [] if kind == "none" else [EFFECT[kind]])
    print(f"{motor} {kind}: {before:.3g} per mille of rated current, {after:.3g} with the effect")
    assert after < MISSED.get(kind, 0.1)
    assert kind == "none" or before > 10.0 * after


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second", "motor", "most"), [
    ("saturation", "iron_loss", "servo_4nm", 0.2), ("saturation", "turn_short", "servo_4nm", 0.2),
    ("harmonics", "iron_loss", "servo_4nm", 0.2), ("harmonics", "turn_short", "servo_4nm", 0.2),
    ("saturation", "iron_loss", "baldor_ecs101m", 1.0),
])  # fmt: skip
def test_a_current_beside_the_machines_acts_on_inductances_that_change(
    first: str, second: str, motor: str, most: float
) -> None:
    """Of losses and shorts: what they take from the current makes flux along the bent curve, and not at its slope."""
    kinds = {"saturation": "saturation_q", "harmonics": "inductance_harmonics"}[first], second
    one, other = (with_effect(kind, motor).effects for kind in kinds)
    scenario = with_effect("none", motor)
    sections = {first: getattr(one, first), second: getattr(other, second)}
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(**sections)))
    before, after, *_ = fitted_to(rows, [EFFECT[kind] for kind in kinds])
    print(f"{first} and {second}, {motor}: {before:.3g} per mille of rated current, {after:.3g} with both")
    assert after < most
    assert before > 50.0 * after


def test_a_dead_time_is_followed_to_the_voltage_limit() -> None:
    """A leg that stays at a rail has no edge, and a pulse shorter than two dead times is of two periods."""
    scenario = with_effect("dead_time", "baldor_ecs101m")
    drive = replace(scenario.drive, noise_i=0.0, adc_bits=0, encoder_counts=0)
    c = VirtualDrive(replace(scenario, drive=drive)).record(5_000)
    machine = machine_of(scenario.motor)
    rows = settled(rows_of_columns(c, machine, drive.T_s))
    at_limit = np.count_nonzero(np.abs(rows.duties - 0.5) == 0.5) / len(rows)
    sizes = (scenario.effects.inverter.dead_time, 0.0, 1e-4 * rows.i_rated, 0.01 * rows.i_rated)
    left = left_of(rows, Model(machine, {"inverter_voltage_error": sizes}))
    print(f"{left:.3g} per mille of rated current, {100.0 * at_limit:.2g} % of periods with a leg at a rail")
    assert at_limit > 0.003
    assert left < 0.2  # 1 where legs at a rail lose a dead time, too
    assert left_of(rows, Model(machine)) > 100.0


@pytest.mark.slow
def test_a_light_rotor_changes_its_speed_within_a_period() -> None:
    """By 1.4 rad/s, electrical, where current and inertia are those of an outrunner without load."""
    scenario = drawn(Choice(2005, KINDS, (0.0, 1.0), tuple(ALL_MOTORS), 6.0), 227)[0].scenario
    assert scenario.run.shaft == "free"
    rows = rows_without_noise(scenario)
    left = left_of(rows, Model(rows.machine))
    print(f"{left:.2g} per mille of rated current")
    assert left < 0.01  # 0.03 with one speed for the whole period


@pytest.mark.slow
@pytest.mark.parametrize("motor", MOTORS)
def test_saturations_act_together_as_one_curve_does(motor: str) -> None:
    scenario = with_effect("none", motor)
    drops = Saturation(L_q_drop=0.25, cross_drop=0.2)
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(saturation=drops)))
    both = Model(rows.machine, {"q_axis_saturation": (0.25,), "cross_saturation": (0.2,)})
    without = left_of(rows, Model(rows.machine))
    print(f"{motor}: {without:.3g} per mille of rated current, {left_of(rows, both):.3g} with both")
    assert left_of(rows, both) < 0.1
    assert without > 5.0


@pytest.mark.slow
def test_a_harmonic_of_the_inductances_acts_on_the_saturated_machine() -> None:
    """What bends and what turns share one flux linkage: their voltages do not add up."""
    scenario = with_effect("inductance_harmonics", "servo_4nm")
    inverse_6 = scenario.effects.harmonics.inductance
    bent = scenario.effects._replace(saturation=Saturation(L_q_drop=0.3))
    rows = rows_without_noise(replace(scenario, effects=bent))
    both = {"q_axis_saturation": (0.3,), "inductance_harmonics": (inverse_6,)}
    together = left_of(rows, Model(rows.machine, both))
    added = rows.u - sum(BY_NAME[name].voltage(rows, sizes) for name, sizes in both.items())
    by_adding = left_of(rows.changed(u=added), Model(rows.machine))
    print(f"{by_adding:.3g} per mille of rated current where voltages are added, {together:.3g} together")
    assert together < MISSED["inductance_harmonics"]
    assert by_adding > 5.0 * together


@pytest.mark.slow
def test_magnets_that_lose_flux_move_where_a_machine_saturates() -> None:
    """Inductances rise with it."""
    scenario = with_effect("none", "servo_4nm")
    drops, step = Saturation(L_d_drop=0.1, cross_drop=0.2), Demagnetisation(share=0.05, time=0.9, duration=0.002)
    rows = rows_without_noise(
        replace(scenario, effects=scenario.effects._replace(saturation=drops, demagnetisation=step))
    )
    saturations = {"d_axis_saturation": (0.1,), "cross_saturation": (0.2,)}
    lost = {"magnet_flux_step": (-0.05, 0.901 / SECONDS, 0.002)}
    together = left_of(rows, Model(rows.machine, saturations | lost))
    added = rows.changed(u=rows.u - BY_NAME["magnet_flux_step"].voltage(rows, lost["magnet_flux_step"]))
    by_adding = left_of(added, Model(rows.machine, saturations))
    print(f"{by_adding:.3g} per mille of rated current where voltages are added, {together:.3g} together")
    assert together < 0.2
    assert by_adding > 20.0 * together


@pytest.mark.slow
@pytest.mark.parametrize(("section", "first", "second", "most"), [
    ("imbalance", "imbalance", "winding_heat", 0.05), ("turn_short", "turn_short", "winding_heat", 0.05),
    ("turn_short", "turn_short", "imbalance", 0.05), ("turn_short", "turn_short", "current_skew", 0.05),
    ("skin", "skin", "winding_heat", 0.05), ("harmonics", "flux_harmonics", "magnet_heat", 0.4),
    ("current_sensing", "current_skew", "flux_harmonics", 0.05),
    ("current_sensing", "current_skew", "inductance_harmonics", 0.05),
    ("current_sensing", "current_skew", "angle_offset", 0.05), ("current_sensing", "current_skew", "skin", 0.05),
])  # fmt: skip
def test_effects_act_on_each_other(section: str, first: str, second: str, most: float) -> None:
    """Resistances warm up, by what shorts and rungs lose too; a short's is that of its phase; harmonics fall with the
    magnets; a late channel sees what drives the current.
    """
    one, scenario = with_effect(first, "servo_4nm").effects, with_effect(second, "servo_4nm", SECONDS)
    rows = rows_without_noise(
        replace(scenario, effects=scenario.effects._replace(**{section: getattr(one, section)}))
    )
    before, after, *_ = fitted_to(rows, [EFFECT[first], EFFECT[second]])
    print(f"{first} and {second}: {before:.3g} per mille of rated current, {after:.3g} with both")
    assert after < most
    assert before > 10.0 * after


@pytest.mark.slow
@pytest.mark.parametrize("motor", ["emrax_208_hv", "servo_4nm", "hbl48zl400"])
def test_a_dead_time_and_drops_of_one_inverter_are_told_apart(motor: str) -> None:
    """Each bends the course of a current near zero, by which the other acts; and each passes zero in its own width."""
    scenario, drops = with_effect("dead_time", motor), with_effect("drops", motor).effects.inverter
    inverter = drops._replace(dead_time=0.3 * scenario.effects.inverter.dead_time)
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(inverter=inverter)))
    before, after, missed, model = fitted_to(rows, ["inverter_voltage_error"])
    dead_time, u_drop, _, knee = model.effects["inverter_voltage_error"]
    mean_drop = 0.5 * (drops.u_transistor + drops.u_diode)
    print(
        f"{motor}: {before:.3g} per mille of rated current, {after:.3g} with both, {missed:.1e} missed; "
        f"dead time {dead_time / inverter.dead_time:.3f} and drops {u_drop / mean_drop:.3f} of what they are"
    )
    assert missed < 2e-5
    assert dead_time == pytest.approx(inverter.dead_time, rel=0.02)
    assert u_drop == pytest.approx(mean_drop, rel=0.02)
    assert knee == pytest.approx(0.01 * rows.i_rated, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "drops", "size"), [
    ("q_axis_saturation", Saturation(L_q_drop=0.3), 0.3), ("cross_saturation", Saturation(cross_drop=0.2), 0.2),
])  # fmt: skip
def test_a_dead_time_acts_on_the_saturated_machine(name: str, drops: Saturation, size: float) -> None:
    """Ripple and clamping go by the inductances at the period's currents, not by those at no current."""
    scenario = with_effect("dead_time", "servo_4nm")
    inverter = scenario.effects.inverter
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(saturation=drops)))
    sizes = (inverter.dead_time, 0.0, 3e-4 * rows.i_rated, 0.01 * rows.i_rated)
    both = Model(rows.machine, {name: (size,), "inverter_voltage_error": sizes})
    without = left_of(rows, Model(rows.machine, {name: (size,)}))
    print(f"{name}: {without:.3g} per mille of rated current, {left_of(rows, both):.3g} with the dead time")
    assert left_of(rows, both) < 0.02 * without


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "motor", "most"), [
    ("iron_loss", "servo_4nm", 6.0), ("skin", "servo_4nm", 1.0), ("skin", "mini_cheetah", 4.0),
    ("flux_harmonics", "servo_4nm", 0.4), ("flux_harmonics", "emrax_208_hv", 0.3),
])  # fmt: skip
def test_a_dead_time_acts_on_currents_that_other_effects_change_within_a_period(
    kind: str, motor: str, most: float
) -> None:
    scenario = with_effect(kind, motor)
    inverter = with_effect("dead_time", motor).effects.inverter
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(inverter=inverter)))
    before, after, *_ = fitted_to(rows, ["inverter_voltage_error", EFFECT[kind]], starts=3)
    print(f"dead time and {kind}, {motor}: {before:.3g} per mille of rated current, {after:.3g} with both")
    assert after < most
    assert before > 100.0 * after
