"""The drive's firmware: field-oriented current control, speed control and excitation, once a control period.

The voltage computed from the samples of period k is applied over period k + 1. Knows of the machine only what
its settings say, and of the world only its samples.
"""

import math
from typing import NamedTuple

from emulator.excitation import AXIS_AT_REST, Axis, fraction, stepped
from emulator.frames import nearest, turned
from emulator.inverter import limited, longest
from emulator.kernel import kernel
from emulator.mechanics import Profile, profile_speed
from emulator.sensors import Sample, measured_current

_AXIS_D, _AXIS_Q = 11, 12  # sources of random numbers
_DELAY = 1.5  # periods from the sample to the middle of the period its voltage is applied over


class Settings(NamedTuple):
    """What can be written to the drive while it runs; names and ranges as in `drivers.wire.dictionary`."""

    stream_periods: int  # control periods per stream row
    n_p: int
    control_R_s: float  # ohm
    control_L_d: float  # H
    control_L_q: float  # H
    control_psi_f: float  # Vs
    bandwidth: float  # rad/s, of the current control
    i_d_ref: float  # A
    i_q_ref: float  # A; without effect under speed control
    i_d_step: float  # A
    i_q_step: float  # A
    step_time: float  # s


class Commissioning(NamedTuple):
    """What is fixed in the drive."""

    T_s: float  # s, control period
    u_dc: float  # V
    i_max: float  # A, longest current reference
    i_trip: float  # A, a sampled current beyond it switches the bridge off
    speed_control: bool  # i_q from a speed loop that follows the profile
    profile: Profile
    k_p_speed: float  # A s/rad, proportional gain of the speed loop, electrical speed
    k_i_speed: float  # A/rad, integral gain
    T_speed: float  # s, time constant of the speed filter
    seed: int


class FirmwareState(NamedTuple):
    """What the firmware remembers from period to period."""

    powered: bool  # the bridge is on
    tripped: bool  # and was switched off by an overcurrent
    u_next: complex  # V, stationary frame: to be applied over the next period
    integral: complex  # V, rotor frame: of the current control
    theta_m: float  # rad, of the sample before
    omega_e: float  # rad/s, filtered
    i_q_integral: float  # A, of the speed control
    axis_d: Axis
    axis_q: Axis


def switched_on(
    theta_m: float, omega_m: float, n_p: int, psi_f: float, T_s: float, powered: bool
) -> FirmwareState:
    """State at the first sample; the first voltage is the back-EMF, so that no current rushes in."""
    omega_e = n_p * omega_m
    u = turned(n_p * theta_m + 0.5 * omega_e * T_s) * (1j * omega_e * psi_f)
    return FirmwareState(powered, False, u, 0j, theta_m - omega_m * T_s, omega_e, 0.0, AXIS_AT_REST, AXIS_AT_REST)


@kernel
def computed(fixed: Commissioning, settings: Settings, state: FirmwareState, sample: Sample, t: float) -> FirmwareState:
    """One control period: the sample at time t (s) taken in, the voltage of the next period in `u_next`.

    With the bridge off, `u_next` is what the machine's terminals then have, near enough: the current decays, and with
    no current the back-EMF is left. The drive does not know that voltage.
    """
    T_s, u_dc = fixed.T_s, fixed.u_dc
    R_s, L_d, L_q, psi_f = (settings.control_R_s, settings.control_L_d, settings.control_L_q, settings.control_psi_f)
    alpha = settings.bandwidth

    theta_e = settings.n_p * sample.theta_m
    raw_speed = settings.n_p * nearest(sample.theta_m - state.theta_m) / T_s
    omega_e = state.omega_e + (raw_speed - state.omega_e) * T_s / (fixed.T_speed + T_s)
    i = measured_current(sample) * turned(-theta_e)

    tripped = state.tripped or (state.powered and abs(i) > fixed.i_trip)
    powered = state.powered and not tripped

    # References
    hold = max(1, math.ceil(settings.step_time / T_s - 1e-6))
    axis_d = stepped(state.axis_d, hold, fixed.seed, _AXIS_D)
    axis_q = stepped(state.axis_q, hold, fixed.seed, _AXIS_Q)
    i_q_wanted, i_q_integral = settings.i_q_ref, 0.0
    if fixed.speed_control:
        error = settings.n_p * profile_speed(fixed.profile, t) - omega_e
        i_q_wanted = fixed.k_p_speed * error + state.i_q_integral
        i_q_integral = state.i_q_integral + fixed.k_i_speed * T_s * error
        i_q_integral = min(max(i_q_integral, -fixed.i_max), fixed.i_max)
    i_ref = complex(
        settings.i_d_ref + settings.i_d_step * fraction(axis_d),
        i_q_wanted + settings.i_q_step * fraction(axis_q),
    )
    if not powered:
        i_ref, i_q_integral = 0j, 0.0
    if abs(i_ref) > fixed.i_max:
        i_ref *= fixed.i_max / abs(i_ref)

    # Current control: PI, cross-coupling and back-EMF fed forward
    e = i_ref - i
    back_emf = omega_e * complex(-L_q * i.imag, L_d * i.real + psi_f)
    u = complex(alpha * L_d * e.real, alpha * L_q * e.imag) + state.integral + back_emf
    u_limited = limited(u, u_dc)
    # Anti-windup: the integral takes in the error that the limited voltage answers to
    short = u_limited - u
    integral = state.integral + alpha * R_s * T_s * (
        e + complex(short.real / (alpha * L_d), short.imag / (alpha * L_q))
    )
    if not powered:
        integral = 0j
    most = longest(u_dc)
    if abs(integral) > most:
        integral *= most / abs(integral)

    u_next = u_limited * turned(theta_e + _DELAY * omega_e * T_s)
    return FirmwareState(powered, tripped, u_next, integral, sample.theta_m, omega_e, i_q_integral, axis_d, axis_q)
