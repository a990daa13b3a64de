"""The way of the angle to the drive: a sensor with one period a pole pair, a tracking loop, a latency.

    x = (1 + gain) cos(theta_e + quadrature/2) + offset_cos + harmonics(theta_e)
    y =            sin(theta_e - quadrature/2) + offset_sin + harmonics(theta_e - pi/2)
    harmonics(x) = second cos(2 x + second_phase) + third cos(3 x + third_phase)
    theta = atan2(y, x), less what unequal amplitudes and a wrong quadrature together turn it by in the mean
    d(theta_t)/dt = omega_t + 2 damping omega_n (theta - theta_t)      d(omega_t)/dt = omega_n^2 (theta - theta_t)
    what is read at t is of t - latency

R. Hoseinnezhad, "Position sensing in brake-by-wire callipers using resolvers", IEEE Trans. Vehicular Technology 55(3),
2006, doi 10.1109/TVT.2006.874576, has such errors of resolvers; G. Ellis, "Observers in Control Systems", 2002, the
loop of second order. Unequal amplitudes and a wrong quadrature show twice an electrical turn, offsets once; a second
harmonic of the signals, as linear Hall sensors have, once and three times, a third one four times. A loop lags by
acceleration over omega_n^2, a latency in proportion to speed.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.frames import nearest
from emulator.kernel import kernel

_STEPS = 20.0  # a time constant of the loop


class AngleSignal(NamedTuple):
    """Sizes."""

    gain: Annotated[float, Bound(low=-0.3, high=0.3)] = 0.0
    quadrature: Annotated[float, Bound("rad", low=-0.3, high=0.3)] = 0.0
    offset_sin: Annotated[float, Bound(low=-0.3, high=0.3)] = 0.0
    offset_cos: Annotated[float, Bound(low=-0.3, high=0.3)] = 0.0
    bandwidth: Annotated[float, Bound("Hz", low=0.0, high=1e4)] = 0.0  # omega_n / 2 pi; 0: there is no loop
    damping: Annotated[float, Bound(low=0.1, high=3.0)] = 0.7
    latency: Annotated[float, Bound("s", low=0.0, high=1e-2)] = 0.0
    second: Annotated[float, Bound(low=0.0, high=0.3)] = 0.0  # harmonics, of the fundamental
    second_phase: Annotated[float, Bound("rad", low=-7.0, high=7.0)] = 0.0
    third: Annotated[float, Bound(low=0.0, high=0.3)] = 0.0
    third_phase: Annotated[float, Bound("rad", low=-7.0, high=7.0)] = 0.0


class Tracked(NamedTuple):
    """What is known of the shaft at a sample."""

    omega_m: float  # rad/s, as it is
    read: float  # rad, mechanical, as it comes to the loop
    error: float  # rad, by which the loop is behind
    omega: float  # rad/s, its own


@kernel
def _harmonics(signal: AngleSignal, x: float) -> float:
    second = signal.second * math.cos(2.0 * x + signal.second_phase)
    return second + signal.third * math.cos(3.0 * x + signal.third_phase)


@kernel
def sensed(signal: AngleSignal, n_p: int, theta_m: float) -> float:
    """What the sensor makes of an angle (rad, mechanical)."""
    plain = signal.gain == 0.0 and signal.quadrature == 0.0 and signal.offset_sin == 0.0 and signal.offset_cos == 0.0
    pure = signal.second == 0.0 and signal.third == 0.0
    if plain and pure:
        return theta_m
    theta_e = n_p * theta_m
    x = (1.0 + signal.gain) * math.cos(theta_e + 0.5 * signal.quadrature) + signal.offset_cos
    y = math.sin(theta_e - 0.5 * signal.quadrature) + signal.offset_sin
    if not pure:
        x += _harmonics(signal, theta_e)
        y += _harmonics(signal, theta_e - 0.5 * math.pi)
    zero = math.atan(signal.gain / (2.0 + signal.gain) * math.tan(0.5 * signal.quadrature))  # mean of what is read
    return theta_m + nearest(math.atan2(y, x) - zero - theta_e) / n_p


@kernel
def followed(signal: AngleSignal, n_p: int, theta_m: float, omega_m: float, T: float, before: Tracked) -> Tracked:
    """A sample T (s) after one, of a shaft at theta_m (rad) that turns by omega_m (rad/s)."""
    accelerates = (omega_m - before.omega_m) / T
    read = sensed(signal, n_p, theta_m - signal.latency * (omega_m - 0.5 * signal.latency * accelerates))
    if signal.bandwidth == 0.0:
        return Tracked(omega_m, read, 0.0, 0.0)
    omega_n = 2.0 * math.pi * signal.bandwidth
    slope, steps = nearest(read - before.read) / T, math.ceil(_STEPS * omega_n * T)
    h, e, omega = T / steps, before.error, before.omega
    for _ in range(steps):  # the midpoint rule
        e_half = e + 0.5 * h * (slope - omega - 2.0 * signal.damping * omega_n * e)
        omega_half = omega + 0.5 * h * omega_n * omega_n * e
        e += h * (slope - omega_half - 2.0 * signal.damping * omega_n * e_half)
        omega += h * omega_n * omega_n * e_half
    return Tracked(omega_m, read, e, omega)
