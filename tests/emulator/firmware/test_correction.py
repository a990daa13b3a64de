"""What the firmware makes up for: a drive with an effect and its correction does as a drive without the effect."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.wire.dictionary import TABLE_SIDE, TABLE_SIZE
from emulator.drive.virtual_drive import VirtualDrive
from emulator.frames import TURN
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation, saturation_curve
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, Run, Scenario

N_P = PAPER.motor.n_p
GAIN_A, OFFSET_B = 1.06, 0.2
IDEAL = replace(PAPER, drive=replace(PAPER.drive, noise_i=0.0, adc_bits=0))
SWITCHED = replace(IDEAL, drive=replace(IDEAL.drive, bridge="switched", timer_counts=0))


def table(name: str, values: NDArray[np.float64]) -> dict[str, float]:
    return {f"{name}_{k}": float(value) for k, value in enumerate(values, start=1)}


def course(
    scenario: Scenario, effects: dict[str, Any], settings: dict[str, float], **drive: Any
) -> NDArray[np.complex128]:
    """What the machine then does: true flux linkage and angle, every 10 periods of 0.2 s."""
    given = replace(
        scenario, effects=NONE._replace(**effects), settings=settings, drive=replace(scenario.drive, **drive)
    )
    virtual, seen = VirtualDrive(given), list[complex]()
    for _ in range(200):
        virtual.run(10)
        seen.append(virtual.plant.psi)
    return np.array(seen)


def once(angle: float) -> float:
    """An eccentric encoder's error."""
    return 0.05 * math.sin(angle + 0.4)


def reads(count: int) -> NDArray[np.float64]:
    """That error by what such an encoder reads, over a turn of readings."""
    angles = np.arange(count) * TURN / count
    for _ in range(20):
        angles = np.arange(count) * TURN / count - np.array([once(angle) for angle in angles])
    return np.array([once(angle) for angle in angles])


CASES: dict[str, tuple[Scenario, dict[str, Any], dict[str, float], float]] = {
    "current gain": (
        IDEAL, {"current_sensing": CurrentSensing(gain_a=GAIN_A)}, {"i_a_gain": 1.0 / GAIN_A}, 0.01,
    ),
    "current offset": (IDEAL, {"current_sensing": CurrentSensing(offset_b=OFFSET_B)}, {"i_b_offset": OFFSET_B}, 0.01),
    "angle offset": (IDEAL, {"angle_sensing": AngleSensing(offset=0.05)}, {"angle_offset": -0.05 * N_P}, 0.01),
    "eccentric encoder": (
        IDEAL, {"angle_sensing": AngleSensing(once=0.05, once_phase=0.4)},
        {"angle_correction": 1.0, **table("angle_table", reads(TABLE_SIZE))}, 0.05,
    ),
    "dc-link gain": (IDEAL, {"voltage_sensing": VoltageSensing(gain=1.1)}, {"u_dc_gain": 1.0 / 1.1}, 0.01),
    "dead time": (
        SWITCHED, {"inverter": Inverter(dead_time=3e-6)},
        {"inverter_correction": 1.0, "dead_time": 3e-6, "inverter_width": 0.1}, 0.35,
    ),
    "dead time, by a table": (
        SWITCHED, {"inverter": Inverter(dead_time=3e-6)},
        {"inverter_correction": 2.0, "inverter_table_current": 6.3,
         **table("inverter_table", np.minimum(1.0, np.arange(TABLE_SIZE) * 1.0) * 3e-6 / 1e-4 * 310.0)}, 0.35,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_drive_that_makes_up_for_an_effect_does_as_one_without_it(case: str) -> None:
    scenario, effects, settings, left = CASES[case]
    without = course(scenario, {}, {})
    bare = np.abs(course(scenario, effects, {}) - without).mean()
    made_up = np.abs(course(scenario, effects, settings) - without).mean()
    assert bare > 1e-5  # Vs
    assert made_up < left * bare


@pytest.mark.parametrize("crossed", [False, True])
@pytest.mark.parametrize("reversed_", [False, True])
def test_phases_and_encoder_may_be_connected_in_any_way(crossed: bool, reversed_: bool) -> None:
    mounted = 0.7
    turns = -1.0 if reversed_ else 1.0  # what is added after the firmware has turned the direction round
    settings = {
        "phases_swapped": float(crossed), "angle_reversed": float(reversed_),
        "angle_offset": math.remainder(-turns * mounted * N_P, TURN), "n_p": float(N_P),
    }
    as_ordered = course(IDEAL, {}, {})
    found = course(
        IDEAL, {}, settings, phases_crossed=crossed, encoder_reversed=reversed_, encoder_offset=mounted
    )
    assert found == pytest.approx(as_ordered, abs=1e-6)


def step_of(settings: dict[str, float], axis: str = "q", periods: int = 400, **scenario: Any) -> NDArray[np.complex128]:
    """Both currents after a step of one reference to 3 A."""
    still = replace(IDEAL.excitation, i_d_ref=0.0, i_q_ref=0.0, i_d_step=0.0, i_q_step=0.0)
    drive = VirtualDrive(replace(IDEAL, settings=settings, **{"excitation": still, **scenario}))
    drive.record(500)
    drive.write(f"i_{axis}_ref", 3.0)
    recording = drive.record(periods)
    return recording["i_d"] + 1j * recording["i_q"]


def rise(i: NDArray[np.float64]) -> int:
    """Control periods until a step is at 90 %."""
    return int(np.argmax(i >= 2.7))


def test_the_gains_of_the_bandwidth_written_out_do_the_same() -> None:
    motor, alpha = PAPER.motor, PAPER.drive.bandwidth
    own = {
        "own_gains": 1.0, "k_p_d": alpha * motor.L_d, "k_p_q": alpha * motor.L_q, "k_i_d": alpha * motor.R_s,
        "k_i_q": alpha * motor.R_s,
    }
    assert step_of(own) == pytest.approx(step_of({}), abs=1e-12)
    faster = step_of(own | {"k_p_q": 2.0 * own["k_p_q"]})
    assert rise(faster.imag) < 0.7 * rise(step_of({}).imag)


def test_without_decoupling_one_axis_disturbs_the_other() -> None:
    assert np.ptp(step_of({}).real) < 0.35 * np.ptp(step_of({"decoupling": 0.0}).real)


def test_no_reference_is_longer_than_the_current_limit() -> None:
    assert step_of({"current_limit": 2.0})[-1].imag == pytest.approx(2.0, abs=0.02)


def test_a_speed_loop_of_other_gains_is_slower() -> None:
    run = Run(shaft="free", speed_rpm=300.0, speed_control=True, speed_reference="ramp")
    excitation = replace(IDEAL.excitation, i_d_step=0.0, i_q_step=0.0, i_q_ref=0.0, speed_ref=200.0, speed_ramp=0.0)

    def reached(settings: dict[str, float]) -> float:
        drive = VirtualDrive(replace(IDEAL, run=run, excitation=excitation, settings=settings))
        speeds = drive.record(1500)["omega_e"]
        return float(np.argmax(speeds >= 190.0))

    assert reached({"k_p_speed": 0.01, "k_i_speed": 0.05}) > 1.5 * reached({}) > 0.0


def test_flux_linkages_of_tables_are_those_of_a_saturated_machine() -> None:
    saturation = Saturation(0.15, 0.3, 0.05)
    effects = NONE._replace(saturation=saturation)
    motor = PAPER.motor
    psi_d, psi_q, side = np.zeros(TABLE_SIZE), np.zeros(TABLE_SIZE), np.linspace(-9.0, 9.0, TABLE_SIDE)
    curve = saturation_curve(saturation, motor.L_d, motor.L_q, motor.psi_f, motor.i_rated)
    for k, i_d in enumerate(side):
        for m, i_q in enumerate(np.linspace(0.0, 9.0, TABLE_SIDE)):
            psi = flux_at(motor, curve, complex(i_d, i_q))
            psi_d[k * TABLE_SIDE + m], psi_q[k * TABLE_SIDE + m] = psi.real, psi.imag
    tables = {
        "saturation_correction": 1.0, "table_i_d_min": -9.0, "table_i_d_max": 9.0, "table_i_q_max": 9.0,
        **table("psi_d_table", psi_d), **table("psi_q_table", psi_q),
    }
    held = replace(IDEAL.excitation, i_d_ref=-2.0, i_q_ref=5.0, i_d_step=0.0, i_q_step=0.0)

    def left_to_the_integral(settings: dict[str, float]) -> float:
        """Voltage (V) beyond R_s i that the integral has to make up for."""
        drive = VirtualDrive(replace(IDEAL, settings=settings, effects=effects, excitation=held))
        drive.run(3000)
        return abs(drive._state.firmware.integral - motor.R_s * complex(-2.0, 5.0))

    assert left_to_the_integral(tables) < 0.1 * left_to_the_integral({})


def flux_at(motor: Any, curve: Any, i: complex) -> complex:
    """Flux linkage (Vs) of a saturating machine at a current, by Newton's way, from the formula of the effect."""
    a_d, a_q, c, _ = curve
    psi_0 = motor.psi_f
    g_d, g_q = 1.0 / motor.L_d - 3.0 * a_d * psi_0**2, 1.0 / motor.L_q - c * psi_0**2
    i_f = g_d * psi_0 + a_d * psi_0**3
    x = np.array([motor.psi_f + motor.L_d * i.real, motor.L_q * i.imag])
    for _ in range(50):
        d, q = x
        error = np.array([
            (g_d + a_d * d * d + c * q * q) * d - i_f - i.real, (g_q + a_q * q * q + c * d * d) * q - i.imag
        ])
        slope = np.array([
            [g_d + 3.0 * a_d * d * d + c * q * q, 2.0 * c * d * q],
            [2.0 * c * d * q, g_q + 3.0 * a_q * q * q + c * d * d],
        ])
        x = x - np.linalg.solve(slope, error)
    return complex(*x)


@pytest.mark.parametrize("i_max", [10.65, 7.1, 8.3])
def test_a_limit_may_be_written_as_it_is_read(i_max: float) -> None:
    virtual = VirtualDrive(replace(IDEAL, drive=replace(IDEAL.drive, i_max=i_max)))
    read = float(np.float32(virtual.read("current_limit")))
    virtual.write("current_limit", read)
    with pytest.raises(ValueError, match="takes at most"):
        virtual.write("current_limit", 1.01 * read)
