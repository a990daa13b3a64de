"""The library: every effect that a diagnosis can name, in a fixed order."""

from collections.abc import Mapping
from typing import Final, TypeVar

from estimator.physics import (
    ac_resistance,
    angle_latency,
    angle_offset,
    angle_sensor_error,
    angle_tracking,
    cross_saturation,
    current_averaging,
    current_filter,
    current_sampling_skew,
    current_sensor_gain,
    current_sensor_hum,
    current_sensor_offset,
    d_axis_saturation,
    dead_time_compensation,
    encoder_eccentricity,
    flux_harmonics,
    hall_displacement,
    inductance_harmonics,
    interturn_short,
    inverter_voltage_error,
    iron_loss,
    leg_voltage_offset,
    magnet_flux_drift,
    magnet_flux_step,
    magnet_temperature,
    mains_voltage,
    phase_resistance_imbalance,
    q_axis_saturation,
    symmetric_d_axis_saturation,
    voltage_delay,
    voltage_offset,
    winding_resistance_drift,
    winding_temperature,
)  # fmt: skip
from estimator.physics.effect import Effect, Sizes

LIBRARY: Final[tuple[Effect, ...]] = tuple(
    module.EFFECT
    for module in (
        inverter_voltage_error, d_axis_saturation, q_axis_saturation, cross_saturation, iron_loss,
        winding_resistance_drift, magnet_flux_drift, magnet_flux_step, flux_harmonics, inductance_harmonics,
        ac_resistance, phase_resistance_imbalance, current_sensor_offset, current_sensor_gain, angle_offset,
        encoder_eccentricity, voltage_delay, voltage_offset, leg_voltage_offset, interturn_short,
        current_sampling_skew, current_averaging, current_filter,
        angle_latency, angle_sensor_error, angle_tracking,
        winding_temperature, magnet_temperature, symmetric_d_axis_saturation,
        dead_time_compensation, current_sensor_hum, mains_voltage, hall_displacement,
    )
)

BY_NAME: Final = {effect.name: effect for effect in LIBRARY}

Kind = TypeVar("Kind", bound=Effect)


def of_kind(kind: type[Kind], effects: Mapping[str, Sizes]) -> list[tuple[Kind, Sizes]]:
    """Those of some effects, given by name, that are of a kind."""
    return [(effect, sizes) for name, sizes in effects.items() if isinstance(effect := BY_NAME[name], kind)]
