"""The drive's firmware: current and speed control, field weakening, excitation, protections, once a control period.

The voltage computed from the samples of period k is applied over period k + 1; by a firmware that is quick enough, over
period k itself. Knows of the machine only what its settings say, and of the world only its samples.
"""

import math
from typing import NamedTuple

from emulator.firmware.correction import Inverter, Saturation, Sensing, Tables, flux
from emulator.firmware.excitation import AT_REST, Excited, excited
from emulator.firmware.reference import Ramp, ramped
from emulator.firmware.weakening import NOT_WEAKENED, Weakening, d_first, room, weakened
from emulator.frames import nearest, turned
from emulator.kernel import kernel
from emulator.plant.inverter import corner, longest, shortened
from emulator.plant.mechanics import Profile, profile_speed
from emulator.plant.sensors import Sample, measured_current

OFF, REFERENCE, PROFILE = 0, 1, 2  # speed control: none, after the reference, after the drive's profile
NO_TRIP, TRIP_CURRENT, TRIP_HIGH_VOLTAGE, TRIP_LOW_VOLTAGE, TRIP_SPEED, TRIP_OVERSPEED = 0, 1, 2, 3, 4, 5


class Settings(NamedTuple):
    """What can be written to the drive while it runs; names and ranges as in `drivers.wire.dictionary`."""

    stream_periods: int  # control periods per stream row
    n_p: int
    control_R_s: float  # ohm
    control_L_d: float  # H
    control_L_q: float  # H
    control_psi_f: float  # Vs
    bandwidth: float  # rad/s, of the current control
    field_weakening: int  # 0 or 1
    i_d_weakening: float  # A, most that it takes
    weakening_voltage: float  # share of the inverter's reach that it holds the voltage below
    i_d_ref: float  # A
    i_q_ref: float  # A; without effect under speed control
    i_d_step: float  # A
    i_q_step: float  # A
    step_time: float  # s
    speed_control: int  # OFF, REFERENCE or PROFILE: where i_q comes from
    speed_ref: float  # rad/s, electrical, as what follows
    speed_ramp: float  # rad/s2; 0: at once
    speed_step: float  # rad/s
    speed_hold: float  # s
    excitation_kind: int  # number in `excitation.KINDS`
    sine_frequency: float  # Hz
    sine_count: int
    i_d_levels: int
    level_time: float  # s
    speed_error_trip: float  # rad/s; 0: never
    speed_error_time: float  # s
    overspeed_trip: float  # rad/s
    own_gains: int  # 0: those of the bandwidth
    k_p_d: float  # V/A
    k_i_d: float  # V/(A s)
    k_p_q: float
    k_i_q: float
    decoupling: int  # 1: cross-coupling and back-EMF are fed forward
    k_p_speed: float  # A s/rad, of the speed loop, electrical speed
    k_i_speed: float  # A/rad
    speed_filter: float  # s, time constant of the speed that it controls by
    current_limit: float  # A, longest current reference
    angle_source: int  # 0: the encoder's angle, 1: the forced one
    forced_angle: float  # rad, electrical
    forced_speed: float  # rad/s, at which that is approached
    sensing: Sensing
    inverter: Inverter
    saturation: Saturation
    tables: Tables


class Commissioning(NamedTuple):
    """What is fixed in the drive."""

    T_s: float  # s, control period
    u_dc: float  # V
    i_max: float  # A, longest current reference of all
    i_trip: float  # A, a sampled current beyond it switches the bridge off
    overvoltage_trip: float  # V, and so does a dc link above this; 0: never
    undervoltage_trip: float  # V, or below this
    profile: Profile
    overmodulates: bool  # voltages beyond the linear range are tried
    seed: int
    delay: float  # periods from the sample to the middle of the period its voltage is applied over


class FirmwareState(NamedTuple):
    """What the firmware remembers from period to period."""

    powered: bool  # the bridge is on
    trip: int  # and was switched off by this
    u_next: complex  # V, stationary frame: to be applied over the next period
    i_next: complex  # A, stationary frame: current in that period
    i_sampled: complex  # A, stationary frame: as it was sampled
    i_wanted: complex  # A, stationary frame: reference in that period
    integral: complex  # V, rotor frame: of the current control
    theta_m: float  # rad, of the sample before
    omega_e: float  # rad/s, filtered
    forced: float  # rad, electrical, where the forced angle is
    i_q_integral: float  # A, of the speed control
    ramp: Ramp  # its reference
    late: int  # periods that the speed has been too far from it
    weakening: Weakening
    excited: Excited


def switched_on(
    theta_m: float, omega_m: float, n_p: int, psi_f: float, T_s: float, powered: bool
) -> FirmwareState:
    """State at the first sample; the first voltage is the back-EMF, so that no current rushes in."""
    omega_e = n_p * omega_m
    u = turned(n_p * theta_m + 0.5 * omega_e * T_s) * (1j * omega_e * psi_f)
    ramp = Ramp(omega_e, 1, 0)
    return FirmwareState(
        powered, NO_TRIP, u, 0j, 0j, 0j, 0j, theta_m - omega_m * T_s, omega_e, 0.0, 0.0, ramp, 0, NOT_WEAKENED, AT_REST
    )


@kernel
def tripped(
    fixed: Commissioning, settings: Settings, state: FirmwareState, i: float, u_dc: float, omega_e: float
) -> int:
    """What switches the bridge off at this current (A), dc-link voltage (V), speed (rad/s): the first cause first."""
    if state.trip != NO_TRIP or not state.powered:
        return state.trip
    cause = NO_TRIP
    if i > fixed.i_trip:
        cause = TRIP_CURRENT
    elif fixed.overvoltage_trip > 0.0 and u_dc > fixed.overvoltage_trip:
        cause = TRIP_HIGH_VOLTAGE
    elif u_dc < fixed.undervoltage_trip:
        cause = TRIP_LOW_VOLTAGE
    elif state.late * fixed.T_s > settings.speed_error_time:
        cause = TRIP_SPEED
    elif abs(omega_e) > settings.overspeed_trip:
        cause = TRIP_OVERSPEED
    return cause


@kernel
def periods(time: float, T_s: float) -> int:
    """A time (s) in control periods, 1 at least."""
    return max(1, math.ceil(time / T_s - 1e-6))


@kernel
def speed_reference(
    fixed: Commissioning, settings: Settings, state: FirmwareState, omega_e: float, powered: bool, t: float
) -> Ramp:
    """The reference of this period, at time t (s); without speed control the speed there is (rad/s)."""
    if settings.speed_control == PROFILE:
        return Ramp(settings.n_p * profile_speed(fixed.profile, t), 1, 0)
    if settings.speed_control == OFF or not powered:
        return Ramp(omega_e, 1, 0)
    hold = periods(settings.speed_hold, fixed.T_s)
    return ramped(state.ramp, settings.speed_ref, settings.speed_step, settings.speed_ramp, hold, fixed.T_s)


@kernel
def forced(settings: Settings, before: float, powered: bool, T_s: float) -> float:
    """The forced angle (rad, electrical) a period later: it moves while the bridge is on, at its rate."""
    away = settings.forced_angle - before
    most = settings.forced_speed * T_s
    return settings.forced_angle if not powered or abs(away) <= most else before + math.copysign(most, away)


@kernel
def seen(settings: Settings, state: FirmwareState, sample: Sample) -> Sample:
    """A sample by the angle that the control takes."""
    if settings.angle_source == 0:
        return sample
    return Sample(sample.i_a, sample.i_b, sample.i_c, state.forced / settings.n_p)


@kernel
def speed(settings: Settings, state: FirmwareState, sample: Sample, forced_next: float, T_s: float) -> float:
    """Electrical speed (rad/s) by a sample, filtered; of a forced angle, the rate at which it moves."""
    if settings.angle_source != 0:
        return (forced_next - state.forced) / T_s
    if math.isnan(state.theta_m):
        return state.omega_e
    now = settings.n_p * nearest(sample.theta_m - state.theta_m) / T_s
    return state.omega_e + (now - state.omega_e) * T_s / (settings.speed_filter + T_s)


@kernel
def gains(settings: Settings, L_d: float, L_q: float) -> tuple[float, float, float, float]:
    """Of the current control, k_p_d, k_i_d, k_p_q, k_i_q, where the inductances are L_d and L_q (H).

    Those of the bandwidth alpha cancel the machine's pole: alpha L and alpha R_s. L. Harnefors, H.-P. Nee, "Model-based
    current control of AC machines using the internal model control method", IEEE Trans. Industry Applications, 1998.
    """
    if settings.own_gains != 0:
        return settings.k_p_d, settings.k_i_d, settings.k_p_q, settings.k_i_q
    alpha, k_i = settings.bandwidth, settings.bandwidth * settings.control_R_s
    return alpha * L_d, k_i, alpha * L_q, k_i


@kernel
def weaker(
    settings: Settings, before: Weakening, u: complex, omega_e: float, most: float, i_max: float, T_s: float
) -> Weakening:
    """Field weakening after a period that needed the voltage u (V) where there is `most` (V)."""
    L_d, psi_f = settings.control_L_d, settings.control_psi_f
    lowest = -min(settings.i_d_weakening, psi_f / L_d)  # further on, the flux would grow again
    slowest = most / (psi_f + L_d * i_max)  # below, no current needs more
    spare = settings.weakening_voltage * most - abs(u)
    return weakened(before, spare, omega_e, slowest, L_d, settings.bandwidth, lowest, T_s)


@kernel
def computed(
    fixed: Commissioning, settings: Settings, state: FirmwareState, sample: Sample, u_dc: float, t: float
) -> FirmwareState:
    """One control period: sample and dc-link voltage (V) at time t (s) taken in, the voltage of the next in `u_next`.

    With the bridge off, `u_next` is what the machine's terminals then have, near enough: the current decays, and with
    no current the back-EMF is left. The drive does not know that voltage.
    """
    T_s, i_max = fixed.T_s, min(fixed.i_max, settings.current_limit)

    theta_e = settings.n_p * sample.theta_m
    forced_next = forced(settings, state.forced, state.powered, T_s)
    omega_e = speed(settings, state, sample, forced_next, T_s)
    i = measured_current(sample) * turned(-theta_e)

    trip = tripped(fixed, settings, state, abs(i), u_dc, omega_e)
    powered = state.powered and trip == NO_TRIP

    # Excitation
    excitation, x_d, x_q = excited(
        state.excited, settings.excitation_kind, periods(settings.step_time, T_s), periods(settings.level_time, T_s),
        settings.i_d_levels, settings.sine_count, settings.sine_frequency, fixed.seed, t,
    )

    # The current that is left for i_q
    i_d_ref, i_q_most = settings.i_d_ref + settings.i_d_step * x_d, i_max
    weakening = settings.field_weakening != 0 and powered
    if weakening:
        i_d_ref += state.weakening.i_d
        i_q_most = room(i_d_ref, i_max)

    # Speed control: PI; switched on, it goes on from the current there is
    i_q_wanted, i_q_integral, late = settings.i_q_ref, settings.i_q_ref, 0
    ramp = speed_reference(fixed, settings, state, omega_e, powered, t)
    if settings.speed_control != OFF:
        error = ramp.omega_e - omega_e
        late = state.late + 1 if 0.0 < settings.speed_error_trip < abs(error) else 0
        i_q_wanted = settings.k_p_speed * error + state.i_q_integral
        i_q_integral = state.i_q_integral + settings.k_i_speed * T_s * error
        i_q_integral = min(max(i_q_integral, -i_q_most), i_q_most)
    i_ref = complex(i_d_ref, i_q_wanted + settings.i_q_step * x_q)
    if weakening:
        i_ref = d_first(i_ref, i_max)
    if not powered:
        i_ref, i_q_integral, late = 0j, 0.0, 0
    if abs(i_ref) > i_max:
        i_ref *= i_max / abs(i_ref)

    # Current control: PI, cross-coupling and back-EMF fed forward
    e = i_ref - i
    L_d, L_q = settings.control_L_d, settings.control_L_q
    psi = complex(L_d * i.real + settings.control_psi_f, L_q * i.imag)
    if settings.saturation.saturation_correction != 0:
        psi, L_d, L_q = flux(settings.saturation, settings.tables, i.real, i.imag)
    k_p_d, k_i_d, k_p_q, k_i_q = gains(settings, L_d, L_q)
    back_emf = omega_e * complex(-psi.imag, psi.real) if settings.decoupling != 0 or not powered else 0j
    u = complex(k_p_d * e.real, k_p_q * e.imag) + state.integral + back_emf
    linear = longest(u_dc)
    most = corner(u_dc) if fixed.overmodulates else linear
    u_limited = d_first(u, most) if weakening else shortened(u, most)
    # Anti-windup: the integral takes in the error that the limited voltage answers to
    short = u_limited - u
    integral = state.integral + complex(
        k_i_d * T_s * (e.real + (short.real / k_p_d if k_p_d > 0.0 else 0.0)),
        k_i_q * T_s * (e.imag + (short.imag / k_p_q if k_p_q > 0.0 else 0.0)),
    )
    if not powered:
        integral = 0j
    if abs(integral) > most:
        integral *= most / abs(integral)

    weakened_next = weaker(settings, state.weakening, u, omega_e, linear, i_max, T_s) if weakening else NOT_WEAKENED

    next_frame = turned(theta_e + fixed.delay * omega_e * T_s)
    u_next, i_next, i_wanted = u_limited * next_frame, i * next_frame, i_ref * next_frame
    theta_m = sample.theta_m if settings.angle_source == 0 else math.nan  # of the encoder, that a speed is told by
    return FirmwareState(
        powered, trip, u_next, i_next, measured_current(sample), i_wanted, integral, theta_m, omega_e, forced_next,
        i_q_integral, ramp, late, weakened_next, excitation,
    )  # fmt: skip
