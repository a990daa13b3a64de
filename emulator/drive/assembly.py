"""Assembly: a scenario's plant, bridge, sensors and firmware, put together for the simulation."""

from emulator.drive.simulation import Bench
from emulator.firmware.control import Commissioning
from emulator.plant.bridge import Bridge
from emulator.plant.course import course_of
from emulator.plant.dynamics import Plant
from emulator.plant.machine import Machine
from emulator.plant.magnetics import magnetics_of
from emulator.plant.mechanics import Shaft
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.flux_map import FluxMap, hessian
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.warming import courses_of
from emulator.plant.sensors import Sensors
from emulator.scenario.effects import curve_of, flux_map_of, knee_of
from emulator.scenario.scenarios import FILTERED, Scenario


def bench_of(scenario: Scenario) -> Bench:
    """All that stays while a scenario runs. Raises ScenarioError or ValueError where it cannot be."""
    drive, run, effects = scenario.drive, scenario.run, scenario.effects
    motor, plant = plant_of_scenario(scenario)
    course = course_of(motor, run.temperature_profile or ((0.0, run.temperature),))
    magnets_move = effects.demagnetisation != Demagnetisation() or bool(effects.warming.magnets)
    moves = bool(run.temperature_profile) or effects.thermal.C_w > 0.0 or magnets_move
    return Bench(
        plant=plant,
        course=course,
        thermal=effects.thermal,
        demagnetisation=effects.demagnetisation,
        warming=courses_of(effects.warming),
        telegraph=effects.telegraph,
        sensors=Sensors(
            drive.noise_i,
            drive.adc_bits,
            drive.adc_full,
            drive.encoder_counts,
            run.seed,
            effects.current_sensing,
            effects.angle_sensing,
            drive.encoder_offset,
            drive.encoder_reversed,
            effects.current_filter,
            effects.angle_signal,
            drive.current_sensors,
            effects.current_hum,
            effects.hall,
        ),
        voltage=effects.voltage_sensing,
        timing=effects.timing,
        compensation=effects.compensation,
        fixed=_commissioned(scenario),
        bridge=Bridge(
            drive.bridge == "switched",
            drive.timer_counts,
            effects.inverter,
            effects.dc_link,
            drive.u_dc,
            knee_of(effects, motor),
            1e-6 * motor.i_rated,
        ),
        sub_steps=drive.sub_steps,
        moves=moves,
        tells_filtered=drive.recorded_speed == FILTERED,
        crossed=drive.phases_crossed,
    )


def plant_of_scenario(scenario: Scenario) -> tuple[Machine, Plant]:
    """The motor, with what a flux map makes of it, and the plant at 23.4 degC."""
    run, effects = scenario.run, scenario.effects
    flux_map = flux_map_of(effects)
    motor = _mapped(scenario.motor, flux_map)
    shaft = Shaft(
        run.shaft == "dynamometer",
        scenario.profile,
        motor.J,
        motor.B,
        run.tau_L,
        effects.friction,
        effects.compliance,
    )
    magnetics = magnetics_of(
        motor, motor.psi_f, curve_of(effects, motor), effects.harmonics, effects.harmonics != Harmonics(), flux_map
    )
    return motor, Plant(
        motor,
        motor.R_s,
        magnetics,
        flux_map,
        shaft,
        effects.iron_loss,
        effects.imbalance,
        effects.skin,
        effects.turn_short,
        effects.stray,
        0j,
        effects.resonance,
        effects.current_filter.tau,
    )


def _mapped(motor: Machine, flux_map: FluxMap) -> Machine:
    """The motor with the map's inductances and magnet flux at no current."""
    if not flux_map.w.size:
        return motor
    g_d, g_q, _ = hessian(flux_map, complex(flux_map.psi_f, 0.0))
    return motor._replace(L_d=1.0 / g_d, L_q=1.0 / g_q, psi_f=flux_map.psi_f)


def _commissioned(scenario: Scenario) -> Commissioning:
    drive = scenario.drive
    return Commissioning(
        drive.T_s,
        drive.u_dc,
        drive.i_max,
        0.5 * (drive.i_max + drive.adc_full),
        float(drive.overvoltage_trip),
        float(drive.undervoltage_trip),
        scenario.profile,
        drive.overmodulation,
        scenario.run.seed,
        0.5 if scenario.effects.timing.delay < 0 else 1.5,
    )
