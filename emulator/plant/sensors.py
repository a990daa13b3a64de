"""The drive's sensors: phase currents through noise and a converter, the shaft's angle through an encoder."""

import math
from typing import NamedTuple

from emulator.frames import TURN, clarke, phases
from emulator.kernel import kernel
from emulator.noise import gauss
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.plant.physics.current_hum import CurrentHum, humming
from emulator.plant.physics.hall import NO_HALL, Hall
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, read_angle

_PHASE_A, _PHASE_B, _PHASE_C = 1, 2, 3  # sources of noise


class Sensors(NamedTuple):
    """What the sensors are."""

    noise_i: float  # A, standard deviation of the noise of each phase current
    adc_bits: int  # resolution of the current converter; 0 for an ideal one
    adc_full: float  # A, the converter spans -adc_full to +adc_full
    encoder_counts: int  # counts per mechanical turn; 0 for an ideal one
    seed: int
    current: CurrentSensing = CurrentSensing()
    angle: AngleSensing = AngleSensing()
    mounted: float = 0.0  # rad, mechanical: that the encoder reads with the magnets on phase a
    reversed: bool = False  # it counts down as the motor turns forwards
    filter: CurrentFilter = CurrentFilter()
    signal: AngleSignal = AngleSignal()
    channels: int = 3  # of current; two: phase c is what the others leave; one: a shunt in the dc link
    hum: CurrentHum = CurrentHum()
    hall: Hall = Hall()  # in an encoder's place, where there are such sensors


class Sample(NamedTuple):
    """What the drive sees at the start of a control period."""

    i_a: float  # A
    i_b: float  # A
    i_c: float  # A
    theta_m: float  # rad, mechanical


@kernel
def converted(i: float, bits: int, full: float) -> float:
    """The value (A) that a converter tells of a current: rounded to its step, clipped at its ends."""
    if bits == 0:
        return i
    half = 2.0 ** (bits - 1)
    count = math.floor(i / full * half + 0.5)
    return min(max(count, -half), half - 1.0) * (full / half)


@kernel
def sampled(
    sensors: Sensors, i_ab: complex, theta_m: float, tick: int, slope: complex = 0j, t: float = 0.0, u: complex = 0j
) -> Sample:  # fmt: skip
    """The sample of a stationary current vector (A), which changes by `slope` (A/s), and an angle (rad) at a tick.

    That is at a time t (s). u (V, stationary): by which the legs are on; a shunt in the dc link sees the first and the
    last of them.
    """
    sigma, bits, full, channels = sensors.noise_i, sensors.adc_bits, sensors.adc_full, sensors.current
    i_a, i_b, i_c = phases(i_ab)
    if slope != 0j:
        by_a, by_b, by_c = phases(slope)
        i_a, i_b, i_c = i_a + channels.skew_a * by_a, i_b + channels.skew_b * by_b, i_c + channels.skew_c * by_c
    by_a, by_b, by_c = of_shunt(phases(u)) if sensors.channels == 1 else (0.0, 0.0, 0.0)
    if sensors.channels == 1:
        i_a, i_b, i_c = (
            channels.gain_a * i_a + by_a * channels.offset_a, channels.gain_a * i_b + by_b * channels.offset_a,
            channels.gain_a * i_c + by_c * channels.offset_a,
        )  # fmt: skip
    else:
        i_a = channels.gain_a * i_a + channels.offset_a
        i_b = channels.gain_b * i_b + channels.offset_b
        i_c = channels.gain_c * i_c + channels.offset_c
    hum = sensors.hum
    if hum.a != 0.0 or hum.b != 0.0 or hum.c != 0.0:
        share = humming(hum, t)
        i_a, i_b, i_c = i_a + hum.a * share, i_b + hum.b * share, i_c + hum.c * share
    if sigma > 0.0:
        i_a += sigma * gauss(sensors.seed, _PHASE_A, tick)
        i_b += sigma * gauss(sensors.seed, _PHASE_B, tick)
        i_c += sigma * gauss(sensors.seed, _PHASE_C, tick)
    theta_m = read_angle(sensors.angle, theta_m)
    if sensors.reversed:
        theta_m = -theta_m
    theta_m += sensors.mounted
    if sensors.encoder_counts > 0 and sensors.hall.rate == NO_HALL:
        count = TURN / sensors.encoder_counts
        theta_m = math.floor(theta_m / count) * count
    i_a, i_b, i_c = converted(i_a, bits, full), converted(i_b, bits, full), converted(i_c, bits, full)
    if sensors.channels == 2:
        i_c = -i_a - i_b
    elif sensors.channels == 1:
        i_a, i_b, i_c = (
            i_a if by_a != 0.0 else -i_b - i_c, i_b if by_b != 0.0 else -i_c - i_a, i_c if by_c != 0.0 else -i_a - i_b
        )
    return Sample(i_a, i_b, i_c, theta_m)


@kernel
def of_shunt(u: tuple[float, float, float]) -> tuple[float, float, float]:
    """With what sign a shunt in the dc link carries each phase's current, by the phases' voltages (V).

    While one leg alone is on it carries that one's current, the highest; while two are, that of the third reversed; of
    the one between, 0, nothing, and it is what the others leave. T. C. Green, B. W. Williams, "Derivation of motor
    line-current waveforms from the DC-link current of an inverter", IEE Proceedings B 136(4), 1989.
    """
    u_a, u_b, u_c = u
    if u_a >= u_b:
        if u_b >= u_c:
            return 1.0, 0.0, -1.0
        return (1.0, -1.0, 0.0) if u_a >= u_c else (0.0, -1.0, 1.0)
    if u_a >= u_c:
        return 0.0, 1.0, -1.0
    return (-1.0, 1.0, 0.0) if u_b >= u_c else (-1.0, 0.0, 1.0)


Earlier = tuple[Sample, Sample, Sample]
"""Samples before one, the latest first."""


@kernel
def averaged(latest: Sample, earlier: Earlier, samples: int) -> Sample:
    """The mean of so many samples of the currents; the angle is the latest."""
    i_a, i_b, i_c = latest.i_a, latest.i_b, latest.i_c
    for n in range(samples - 1):
        i_a, i_b, i_c = i_a + earlier[n].i_a, i_b + earlier[n].i_b, i_c + earlier[n].i_c
    return Sample(i_a / samples, i_b / samples, i_c / samples, latest.theta_m)


@kernel
def measured_current(sample: Sample) -> complex:
    """Stationary current vector (A) of a sample."""
    return clarke(sample.i_a, sample.i_b, sample.i_c)
