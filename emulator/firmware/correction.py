"""What the firmware makes up for: gains and offsets of its sensors, the encoder's place, lost voltage, saturation.

    i_k = gain_k (reading_k - offset_k)
    theta_m = +-(reading - table(reading)) + (offset + omega_e latency) / n_p
    u_set,k = u_k + lost(i_k)       lost: dead_time / T_s u_dc + drop, beyond a width of current; or a table
    psi = table(i_d, i_q)           bilinear; psi_d even and psi_q odd in i_q; beyond its grid as at the edge, linear

J.-W. Choi, S.-K. Sul, "Inverter output voltage synthesis using novel dead time compensation", IEEE Trans. Power
Electronics 11(2), 1996. The voltage that a drive tells is the one it wanted at the motor: without what it adds here.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.wire.dictionary import TABLE_SIDE, TABLE_SIZE
from emulator.frames import TURN, clarke, phases
from emulator.kernel import kernel
from emulator.plant.sensors import Sample

Table = NDArray[np.float64]
BY_TIMES, BY_TABLE = 1, 2  # inverter_correction
_SIDE: Final = TABLE_SIDE
_SIZE: Final = TABLE_SIZE


class Sensing(NamedTuple):
    """How readings become currents, angle and voltage; names as in `drivers.wire.dictionary`."""

    i_a_gain: float = 1.0
    i_b_gain: float = 1.0
    i_c_gain: float = 1.0
    i_a_offset: float = 0.0  # A
    i_b_offset: float = 0.0
    i_c_offset: float = 0.0
    u_dc_gain: float = 1.0
    angle_offset: float = 0.0  # rad, electrical
    angle_latency: float = 0.0  # s
    angle_reversed: int = 0
    phases_swapped: int = 0
    angle_correction: int = 0


class Inverter(NamedTuple):
    """What it adds to the voltage that it sets."""

    inverter_correction: int = 0
    dead_time: float = 0.0  # s
    inverter_width: float = 0.0  # A
    inverter_drop: float = 0.0  # V
    inverter_table_current: float = 0.0  # A


class Saturation(NamedTuple):
    """Where the tables of flux linkage are."""

    saturation_correction: int = 0
    table_i_d_min: float = 0.0  # A
    table_i_d_max: float = 0.0
    table_i_q_max: float = 0.0


class Tables(NamedTuple):
    """All of them, of 64 entries each; arrays are not changed in place."""

    psi_d_table: Table  # Vs
    psi_q_table: Table
    angle_table: Table  # rad, mechanical
    inverter_table: Table  # V


@kernel
def corrected(sensing: Sensing, angles: Table, n_p: int, sample: Sample, omega_e: float) -> Sample:
    """A sample as the machine's, at an electrical speed (rad/s), of phases and direction as the firmware has them."""
    i_a = sensing.i_a_gain * (sample.i_a - sensing.i_a_offset)
    i_b = sensing.i_b_gain * (sample.i_b - sensing.i_b_offset)
    i_c = sensing.i_c_gain * (sample.i_c - sensing.i_c_offset)
    theta_m = sample.theta_m
    if sensing.angle_correction != 0:
        theta_m -= around(angles, theta_m)
    if sensing.angle_reversed != 0:
        theta_m = -theta_m
    theta_m += (sensing.angle_offset + omega_e * sensing.angle_latency) / n_p
    if sensing.phases_swapped != 0:
        i_b, i_c = i_c, i_b
    return Sample(i_a, i_b, i_c, theta_m)


@kernel
def around(table: Table, angle: float) -> float:
    """A table's value at an angle (rad) of one turn, linear between its entries."""
    place = (angle / TURN - math.floor(angle / TURN)) * _SIZE
    k = min(int(place), _SIZE - 1)
    return table[k] + (place - k) * (table[(k + 1) % _SIZE] - table[k])


@kernel
def lost(inverter: Inverter, table: Table, i: complex, u_dc: float, T_s: float) -> complex:
    """Voltage (V, stationary) that the legs are taken to lose at a current (A, stationary) and dc link (V)."""
    if inverter.inverter_correction == 0:
        return 0j
    i_a, i_b, i_c = phases(i)
    return clarke(
        _leg(inverter, table, i_a, u_dc, T_s), _leg(inverter, table, i_b, u_dc, T_s),
        _leg(inverter, table, i_c, u_dc, T_s),
    )  # fmt: skip


@kernel
def _leg(inverter: Inverter, table: Table, i: float, u_dc: float, T_s: float) -> float:
    size = abs(i)
    if inverter.inverter_correction == BY_TABLE:
        full = inverter.inverter_table_current
        place = size / full * (_SIZE - 1) if full > 0.0 else 0.0
        k = min(int(place), _SIZE - 2)
        u = table[k] + (min(place, _SIZE - 1.0) - k) * (table[k + 1] - table[k])
    else:
        width = inverter.inverter_width
        share = min(1.0, size / width) if width > 0.0 else 1.0 if size > 0.0 else 0.0
        u = share * (inverter.dead_time / T_s * u_dc + inverter.inverter_drop)
    return math.copysign(u, i)


@kernel
def flux(saturation: Saturation, tables: Tables, i_d: float, i_q: float) -> tuple[complex, float, float]:
    """Flux linkage (Vs, rotor frame) at a current (A), and the inductances (H) along either axis there."""
    a, h_d = _cell(i_d - saturation.table_i_d_min, saturation.table_i_d_max - saturation.table_i_d_min)
    b, h_q = _cell(abs(i_q), saturation.table_i_q_max)
    psi_d, L_d, _ = _on(tables.psi_d_table, a, b, h_d, h_q)
    psi_q, _, L_q = _on(tables.psi_q_table, a, b, h_d, h_q)
    return complex(psi_d, math.copysign(psi_q, i_q)), L_d, L_q


@kernel
def _cell(x: float, span: float) -> tuple[float, float]:
    """A place among the entries of one side, and their distance (A)."""
    h = max(span, 1e-9) / (_SIDE - 1)
    return x / h, h


@kernel
def _on(table: Table, a: float, b: float, h_d: float, h_q: float) -> tuple[float, float, float]:
    """Value, and slopes along rows and columns, at a place (a, b) of the grid."""
    k, m = min(max(int(a), 0), _SIDE - 2), min(max(int(b), 0), _SIDE - 2)
    x, y, at = a - k, b - m, k * _SIDE + m
    here, right, below, across = table[at], table[at + 1], table[at + _SIDE], table[at + _SIDE + 1]
    value = (1.0 - x) * ((1.0 - y) * here + y * right) + x * ((1.0 - y) * below + y * across)
    along_d = ((1.0 - y) * (below - here) + y * (across - right)) / h_d
    along_q = ((1.0 - x) * (right - here) + x * (across - below)) / h_q
    return value, along_d, along_q
