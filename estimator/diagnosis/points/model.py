"""What a machine and its effects make of a steady point's voltages u_d and u_q.

    u_true = R i + e + V f(i)                   e = j omega_e psi(i_m)          i_m = i - e / Z_i
    Z_i = R_c (|omega_e| / (|omega_e| + omega_h) + j omega_e lag)
    R = R_s (1 + rise t + skin)                 skin = rise (x^2 + j x) / (1 + x^2),  x = omega_e / (2 pi corner)
    u = u_true exp(j omega_e delay)             all of it turned by the angle's offset

psi(i) is the reciprocal curve of `estimator.physics.saturation`. The iron's branch Z_i and the skin
effect's rung are those of `estimator.physics` in the steady state; drifts go straight from the first row to the last.
A leg that loses v sign(i_k) loses, on average over a turn, V = 4/pi v along the current vector, less where the current
is not much above zero_crossing_width (`estimator.physics.inverter_voltage_error`).

What shows in the rotor's turning only - harmonics, imbalance, sensors' offsets - averages out. A gain of the voltage
scales R_s, L_d, L_q and psi_f alike and is not seen.
"""

import math
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.points.problem import MACHINE, Key, PointSizes, Problem, Size
from estimator.diagnosis.points.table import Points, groups_of, kin_of
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS, Machine
from estimator.physics.saturation import curve_of, flux_of

VOLTAGE_ERROR: Final = "inverter_voltage_error"
TIMED: Final = ("winding_resistance_drift", "magnet_flux_drift")
_INSTRUMENTS_GOOD: Final = 1e-3  # as good as instruments, and currents sampled once a period, are
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_ANGLES, _SHARES = 0.25 * math.pi * (_NODES + 1.0), 0.25 * math.pi * _WEIGHTS  # a quarter of a turn


def points_problem(points: Points, i_rated: float) -> Problem:
    """The question that points with both voltages and both currents ask."""
    machine = rough(points)
    group, kin = groups_of(points), kin_of(points)
    n = len(points)

    def predict(sizes: PointSizes) -> Array:
        u = voltage(points, i_rated, sizes)
        return np.concatenate((u.real, u.imag))

    return Problem(
        np.concatenate((points.u.real, points.u.imag)), np.repeat([0, 1], n), np.concatenate((group, group)),
        np.concatenate((kin, kin)),
        tuple(_parameter_size(name, value) for name, value in machine.items()),
        _effects(points, i_rated, machine["R_s"]), predict, _INSTRUMENTS_GOOD, _generic(points),
    )  # fmt: skip


def _parameter_size(name: str, value: float) -> Size:
    """One of the machine's; some value where these points tell none."""
    least = PLAUSIBLE[name][0]
    return Size(MACHINE, name, UNITS[name], max(abs(value), least), starts=(value if abs(value) > least else least,))


def rough(points: Points) -> dict[str, float]:
    """R_s, L_d, L_q, psi_f by least squares, without effects."""
    omega_e, i = points.omega_e, points.i
    none = np.zeros(len(points))
    d = np.column_stack((i.real, none, -omega_e * i.imag, none))
    q = np.column_stack((i.imag, omega_e * i.real, none, omega_e))
    found = np.linalg.lstsq(np.vstack((d, q)), np.concatenate((points.u.real, points.u.imag)), rcond=None)[0]
    return dict(zip(PARAMETERS, map(float, found), strict=True))


def voltage(points: Points, i_rated: float, sizes: PointSizes) -> Vector:
    """Recorded u_d + j u_q (V) that a machine with effects makes."""

    def of(owner: str, name: str) -> float:
        return sizes.get((owner, name), 0.0)

    turn = np.exp(1j * of("angle_offset", "offset"))
    omega_e, i = points.omega_e, points.i * turn
    R_s = of(MACHINE, "R_s")
    late = _course_of_log(points)
    psi_f = of(MACHINE, "psi_f")
    machine = Machine(R_s, of(MACHINE, "L_d"), of(MACHINE, "L_q"), psi_f, 1)
    drops = (
        of("d_axis_saturation", "L_d_drop"), of("q_axis_saturation", "L_q_drop"),
        of("cross_saturation", "cross_drop"),
    )  # fmt: skip
    moved = 1j * omega_e * psi_f * of("magnet_flux_drift", "change") * late
    e = 1j * omega_e * _flux_at_points(machine, i_rated, drops, i) + moved
    conductance = of("iron_loss", "conductance")
    if conductance != 0.0:
        speed = np.maximum(np.abs(omega_e), 1e-9)
        per_volt = conductance / (speed / (speed + of("iron_loss", "omega_h")) + 1j * omega_e * of("iron_loss", "lag"))
        for _ in range(3):
            e = 1j * omega_e * _flux_at_points(machine, i_rated, drops, i - per_volt * e) + moved
    R = R_s * (1.0 + of("winding_resistance_drift", "rise") * late + _skin(omega_e, sizes))
    lost = of(VOLTAGE_ERROR, "voltage")
    u = R * i + e
    if lost != 0.0:
        u = u + lost * along(i, of(VOLTAGE_ERROR, "zero_crossing_width"))
    return u * np.exp(1j * omega_e * of("voltage_delay", "delay")) / turn


def along(i: Vector, width: float) -> Vector:
    """Fundamental of the phases' i / sqrt(i^2 + width^2), as a share of that of sign(i), along the current vector."""
    size = np.maximum(np.abs(i), 1e-12)
    phase = size[:, None] * np.sin(_ANGLES)
    return i / size * ((phase / np.hypot(phase, width)) @ (np.sin(_ANGLES) * _SHARES))


def _flux_at_points(machine: Machine, i_rated: float, drops: tuple[float, float, float], i: Vector) -> Vector:
    if not any(drops):
        return machine.psi_f + machine.L_d * i.real + 1j * machine.L_q * i.imag
    return flux_of(curve_of(machine, i_rated, drops), machine, i)


def _skin(omega_e: Array, sizes: PointSizes) -> Vector | float:
    rise, corner = sizes.get(("ac_resistance", "rise"), 0.0), sizes.get(("ac_resistance", "corner"), 0.0)
    if rise == 0.0:
        return 0.0
    x = omega_e / (2.0 * math.pi * corner)
    return rise * (x**2 + 1j * x) / (1.0 + x**2)


def _course_of_log(points: Points) -> Array:
    """0 at the first row, 1 at the last; zero where there is no time."""
    if points.t is None:
        return np.zeros(len(points))
    begin, end = float(points.t.min()), float(points.t.max())
    return (points.t - begin) / max(end - begin, 1e-12)


def _effects(points: Points, i_rated: float, R_s: float) -> dict[str, tuple[Size, ...]]:
    """Effects that these points can show, by name."""
    fastest = max(float(np.max(np.abs(points.omega_e), initial=0.0)), 1.0)
    e = max(float(np.max(np.abs(points.u), initial=0.0)), 1e-6)
    R = max(abs(R_s), 1e-6)
    corners = tuple(share * fastest / (2.0 * math.pi) for share in (0.5, 2.0))

    def size(key: Key, unit: str, typical: float, low: float, high: float, *starts: float, shape: bool = False) -> Size:
        return Size(*key, unit, typical, low, high, starts or (0.0,), shape)

    found = {
        VOLTAGE_ERROR: (
            size((VOLTAGE_ERROR, "voltage"), "V", 0.1 * R * i_rated, 0.0, e),
            size((VOLTAGE_ERROR, "zero_crossing_width"), "A", 0.02 * i_rated, 1e-3 * i_rated, 0.2 * i_rated,
                 0.004 * i_rated, 0.03 * i_rated, shape=True),
        ),
        "d_axis_saturation": (size(("d_axis_saturation", "L_d_drop"), "1", 0.15, 0.0, 0.7),),
        "q_axis_saturation": (size(("q_axis_saturation", "L_q_drop"), "1", 0.15, 0.0, 0.7),),
        "cross_saturation": (size(("cross_saturation", "cross_drop"), "1", 0.15, 0.0, 0.6),),
        "iron_loss": (
            size(("iron_loss", "conductance"), "S", 0.03 * i_rated / e, 0.0, i_rated / e),
            size(("iron_loss", "omega_h"), "rad/s", 0.5 * fastest, 0.0, 3.0 * fastest, 0.05 * fastest, 0.7 * fastest,
                 shape=True),
            size(("iron_loss", "lag"), "s", 1e-4, 0.0, 1e-3, 1e-4, shape=True),
        ),
        "ac_resistance": (
            size(("ac_resistance", "rise"), "1", 1.0, 0.0, 6.0),
            size(("ac_resistance", "corner"), "Hz", corners[1], 0.2 * corners[0], 5.0 * corners[1], *corners,
                 shape=True),
        ),
        "angle_offset": (size(("angle_offset", "offset"), "rad", math.radians(3.0), -0.6, 0.6),),
        "voltage_delay": (size(("voltage_delay", "delay"), "s", 0.05 / fastest, -0.5 / fastest, 0.5 / fastest),),
    }  # fmt: skip
    if points.t is not None:
        found["winding_resistance_drift"] = (size(("winding_resistance_drift", "rise"), "1", 0.1, -0.5, 1.0),)
        found["magnet_flux_drift"] = (size(("magnet_flux_drift", "change"), "1", 0.03, -0.3, 0.3),)
    return found


def _generic(points: Points) -> Array:
    """Second-order polynomials of speed and currents on each axis."""
    x = [points.omega_e / max(float(np.max(np.abs(points.omega_e))), 1e-12)]
    most = max(float(np.max(np.abs(points.i))), 1e-12)
    x += [points.i.real / most, points.i.imag / most]
    columns = [np.ones(len(points)), *x] + [x[a] * x[b] for a in range(3) for b in range(a, 3)]
    one = np.column_stack(columns)
    return np.block([[one, np.zeros_like(one)], [np.zeros_like(one), one]])
