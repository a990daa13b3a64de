"""Mains hum of the current sensors and a voltage of that frequency: equations, and what tells one from the other."""

import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.plant.physics.current_hum import CurrentHum
from emulator.plant.physics.strangers import Stray
from estimator.arrays import Array
from estimator.physics import current_sensor_hum, mains_voltage
from estimator.physics.mains import hum_in
from estimator.physics.rows import Rows
from estimator.twin.model import Model, zero_residual
from tests.estimator.physics.equations import left_of, rows_without_noise, with_effect

HUM = CurrentHum(a=0.02, b=-0.008, c=0.011, frequency=50.02, phase=0.7)
THIRD = math.tau / 3.0


def humming(motor: str, sensors: int, hum: CurrentHum) -> Rows:
    """Rows of a drive whose channels hum, by shares of the rated current."""
    scenario = with_effect("none", motor)
    rated = scenario.motor.i_rated
    hum = hum._replace(a=hum.a * rated, b=hum.b * rated, c=hum.c * rated)
    drive, effects = replace(scenario.drive, current_sensors=sensors), scenario.effects._replace(current_hum=hum)
    return rows_without_noise(replace(scenario, drive=drive, effects=effects))


def sizes_of(rows: Rows, hum: CurrentHum, sensors: int) -> tuple[float, ...]:
    """The effect's sizes for a hum by shares of the rated current."""
    each = np.array([hum.a, hum.b, hum.c if sensors == 3 else -hum.a - hum.b]) * rows.i_rated
    phasors = each * np.exp(1j * (hum.phase + math.tau * hum.frequency * rows.span[0]))
    turns = np.exp(1j * THIRD * np.arange(3))
    forth, back, common = phasors @ turns / 3.0, (phasors.conj() @ turns) / 3.0, phasors.mean()
    return forth.real, forth.imag, back.real, back.imag, common.real, -common.imag, hum.frequency


@pytest.mark.parametrize(("motor", "sensors"), [("servo_4nm", 3), ("aalto_2k2", 2), ("lea_52k", 3)])
def test_an_equation_misses_little_of_a_hum(motor: str, sensors: int) -> None:
    rows = humming(motor, sensors, HUM)
    sizes = sizes_of(rows, HUM, sensors)
    model = Model(rows.machine, {"current_sensor_hum": sizes})
    before, after = left_of(rows, Model(rows.machine)), left_of(rows, model)
    print(f"{motor}, {sensors} sensors: {before:.3g} per mille of rated current, {after:.3g} with the effect")
    assert after < 0.03 * before
    told = current_sensor_hum.EFFECT.told
    assert told is not None
    said = told(rows, sizes)
    for k, there in zip("abc", (HUM.a, HUM.b, HUM.c if sensors == 3 else -HUM.a - HUM.b), strict=True):
        assert said[f"amplitude_{k}"][0] == pytest.approx(abs(there) * rows.i_rated)
    if sensors == 3:
        left = zero_residual(rows, rows, model)
        assert left is not None
        assert rows.zero is not None
        assert np.std(left) < 1e-3 * np.std(rows.zero)


def test_an_equation_misses_little_of_a_voltage() -> None:
    scenario = with_effect("none", "servo_4nm")
    stray = Stray(amplitude=2.0, frequency=99.95, along_alpha=0.8, along_beta=-0.6)
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(stray=stray)))
    turn = np.exp(1j * math.tau * stray.frequency * rows.span[0])
    forth, back = (complex(0.8, -0.6) * x for x in (turn, turn.conjugate()))
    sizes = (forth.real, forth.imag, back.real, back.imag, stray.frequency)
    before, after = left_of(rows, Model(rows.machine)), left_of(rows, Model(rows.machine, {"mains_voltage": sizes}))
    assert after < 0.03 * before
    told = mains_voltage.EFFECT.told
    assert told is not None
    said = told(rows, sizes)
    assert said["amplitude"][0] == pytest.approx(2.0)
    assert said["direction"][0] == pytest.approx(math.atan2(-0.6, 0.8))


@pytest.mark.parametrize("salient", [False, True])
def test_without_saliency_a_hum_is_a_voltage_of_its_frequency_and_the_machines_impedance(salient: bool) -> None:
    rows = humming("servo_4nm", 2, HUM)
    rows = rows.with_machine(replace(rows.machine, L_d=2e-3, L_q=3e-3 if salient else 2e-3))
    *sizes, f = sizes_of(rows, HUM, 2)
    omega = math.tau * f
    forth, back = complex(*sizes[:2]), complex(*sizes[2:4])
    forth *= rows.machine.R_s + 1j * omega * 2e-3
    back *= rows.machine.R_s - 1j * omega * 2e-3
    hum = current_sensor_hum.EFFECT.voltage(rows, (*sizes, f))
    volts = mains_voltage.EFFECT.voltage(rows, (forth.real, forth.imag, back.real, back.imag, f))
    off = np.linalg.norm(hum - volts) / np.linalg.norm(hum)
    assert off > 0.1 if salient else off < 1e-3


@pytest.mark.parametrize("f", [49.9, 50.03, 60.2, 99.7, 120.0])
def test_a_hum_is_found_in_a_spectrum_where_rows_are_missing(f: float) -> None:
    whole = np.arange(60_000, dtype=np.float64) * 1e-4
    t: Array = whole[(whole < 2.0) | (whole > 2.9)].astype(np.float64)
    chance = np.random.default_rng(1)
    noise = chance.standard_normal(len(t)) + 1j * chance.standard_normal(len(t))
    slow = 20.0 * np.exp(1j * math.tau * 17.0 * t)
    v = slow + noise + 0.2 * np.exp(1j * (math.tau * f * t + 0.3)) + 0.1 * np.exp(-1j * math.tau * f * t)
    assert hum_in(v, t) == pytest.approx(f, abs=0.02)
