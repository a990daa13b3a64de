"""The q axis alone, of which u_q, i_q and a speed were recorded, in time or as steady points.

    u_q = R_s i_q + L_q di_q/dt + omega (psi_f + L_d i_d) + V f(i_q) + offset_q
    R_s (1 + rise t), psi_f (1 + change t)        omega = omega_e + lag d(omega_e)/dt

f is what a bridge loses of u_q: sign(i_k) of each leg, less near zero, where the angle is known, else on average over a
turn (`model.along`). An i_d that was not recorded is zero, that of a drive that controls it to zero. Whether a voltage
is the mean of its row or that of another instant is tried by moving it (`aligned`). Effects that act by the d axis are
not in this equation, or too small in it: they are not looked for.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.points.model import VOLTAGE_ERROR, along
from estimator.diagnosis.points.problem import MACHINE, Key, PointSizes, Problem, Size
from estimator.diagnosis.points.table import Places
from estimator.machine import PLAUSIBLE, UNITS
from estimator.online.flux_balance import TURN, flux_balance
from estimator.physics import speed_lag
from estimator.samples import Samples, is_integral_of_speed

LOOKED_FOR: Final = (
    VOLTAGE_ERROR, "winding_resistance_drift", "magnet_flux_drift", "voltage_offset", speed_lag.NAME,
)
AS_GOOD: Final = 1.32  # times what the best leaves of rows left out, mean square: such a model may be true as well
_MOST: Final = 3_000  # means over rows
_BLOCKS, _LASTING = 40, 7  # stretches of time that are left out one by one; over which what is missed may stay alike
_SHIFTS: Final = np.arange(-10, 16) / 10.0  # rows, by which the voltage may be recorded before it is applied
_WIDTHS: Final = np.array([1e-3, 1e-2, 3e-2, 0.1, 0.3])  # of the largest current, near zero
_GOOD: Final = 1e-3  # as good as currents sampled once a row are


@dataclass(frozen=True, slots=True, eq=False)
class QAxis:
    """Rows, or means over rows; columns of equal length."""

    omega_e: Array  # rad/s, electrical
    i_q: Array  # A
    u_q: Array  # V
    i_d: Array | None = None  # A; None: taken for zero
    t: Array | None = None  # s, of a log
    slope: Array | None = None  # A/s, of i_q, of rows that follow each other; so those below
    bend: Array | None = None  # rad/s^2, of omega_e
    lost: Array | None = None  # (rows, widths), f by the angle
    widths: Array | None = None  # A
    T: float = 0.0  # s, of a row
    noise: float = 0.0  # share of the slope's energy that noise of the current may be
    by_angle: bool = True  # the speed is the angle's

    def __len__(self) -> int:
        return len(self.u_q)

    def at(self, places: Places | NDArray[np.bool_]) -> "QAxis":
        """Some of them."""

        def cut(x: Array | None) -> Array | None:
            return None if x is None else x[places]

        return QAxis(
            self.omega_e[places], self.i_q[places], self.u_q[places], cut(self.i_d), cut(self.t), cut(self.slope),
            cut(self.bend), cut(self.lost), self.widths, self.T, self.noise, self.by_angle,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """The rows by the shift of the voltage that suits best; none where that does about as well."""

    q: QAxis
    shift: float  # rows, by which the voltage was recorded before it was applied; below zero: after
    plain: float | None  # rows, by which no effect is needed; None where no shift does that
    moved: Mapping[Key, float]  # SI: by how much sizes move with shifts that may be true as well


def aligned(runs: Sequence[Samples]) -> Aligned:
    """Each shift, with and without an inverter's error and an offset, by least squares.

    A shaft that is free accelerates as i_q has it, and a voltage of another instant looks as R_s and an offset do: then
    nothing but a convention tells them apart, and sizes are known to what all shifts make of them.
    """
    found: list[tuple[float, float, int, Array]] = []
    for shift in _SHIFTS.tolist():
        q = q_axis_of(runs, shift)
        assert q.slope is not None
        columns = np.column_stack((q.i_q, q.slope, q.omega_e, _lost(q, 0.02 * _most(q)), np.ones(len(q))))
        for more in (0, 3, 4):
            places = [0, 1, 2, *((more,) if more else ())]
            x = np.zeros(len(columns.T))
            x[places] = np.linalg.lstsq(columns[:, places], q.u_q, rcond=None)[0]
            found.append((float(np.mean((q.u_q - columns @ x) ** 2)), shift, more, x))
    limit = AS_GOOD * min(one[0] for one in found)
    near = [one for one in found if one[0] < limit]
    _, shift, more, x = min(near, key=lambda one: (one[1] != 0.0, one[0]))
    plain = min((one for one in near if not one[2]), default=None, key=lambda one: one[0])
    moves = np.max([np.abs(one[3] - x) for one in near if one[2] == more or not more], axis=0).tolist()
    keys = ((MACHINE, "R_s"), (MACHINE, "L_q"), (MACHINE, "psi_f"), (VOLTAGE_ERROR, "voltage"))
    moved = dict(zip(keys, moves, strict=False))
    return Aligned(q_axis_of(runs, shift), shift, None if plain is None else plain[1], moved)


def q_axis_of(runs: Sequence[Samples], shift: float = 0.0) -> QAxis:
    """Means over as many rows as make the recording a few thousand."""
    runs = [run for run in runs if len(run) > 8]
    if not runs:
        none = np.zeros(0)
        return QAxis(none, none, none, None, none, none, none)
    rows = max(1, math.ceil(sum(map(len, runs)) / _MOST))
    by_angle = not all(map(is_integral_of_speed, runs))
    widths = _WIDTHS * max(float(np.max(np.abs(run.i_q))) for run in runs)
    parts, changes = list[Array](), list[Array]()
    for run in runs:
        balance = flux_balance(run)
        i_q, x, i_d_s, s = (balance[:, place] for place in (1, 3, 4, 6))
        n = np.arange(len(s), dtype=np.float64)
        u_q = np.interp(n - shift, np.arange(len(run)), run.u_q)
        inside = slice(math.ceil(max(shift, 0.0)) + 1, len(s) - math.ceil(max(-shift, 0.0)) - 1)
        columns = [s, i_q, u_q, i_d_s, run.t0 + run.T * (n + 0.5), x, np.gradient(s, run.T)]
        if by_angle:
            columns += list(_lost_at(run.theta_e[:-1] + 0.5 * s * run.T, i_q, widths))
        parts.append(np.column_stack(columns)[inside])
        changes.append(np.diff(run.i_q, n=2) / math.sqrt(6.0))
    whole = [part[: len(part) // rows * rows].reshape(-1, rows, part.shape[1]).mean(axis=1) for part in parts]
    means: Array = np.concatenate(whole)
    s, i_q, u_q, i_d_s, t, x, bend = means.T[:7]
    T = runs[0].T
    jumps: Array = np.concatenate(changes)
    of_slope = 2.0 * float(np.mean(jumps**2)) / (rows * T) ** 2
    i_d = np.divide(i_d_s, s, out=np.zeros_like(s), where=s != 0.0) if np.any(i_d_s) else None
    return QAxis(
        s, i_q, u_q, i_d, t, x, bend, means[:, 7:] if by_angle else None, widths, T,
        min(of_slope * len(x) / max(float(x @ x), 1e-300), 1.0), by_angle,
    )  # fmt: skip


def _lost_at(theta: Array, i_q: Array, widths: Array) -> Array:
    """Of u_q, for a current of each leg that is lost by its sign, over 4/pi of that; (widths, n)."""
    lost = np.zeros((len(widths), len(theta)))
    for k in range(3):
        on_q = -np.sin(theta - k * TURN / 3.0)
        i = i_q * on_q
        lost += 2.0 / 3.0 * on_q * i / np.hypot(i, widths[:, None])
    return 0.25 * math.pi * lost


def _most(q: QAxis) -> float:
    return max(float(np.max(np.abs(q.i_q))), 1e-9)


def _lost(q: QAxis, width: float) -> Array:
    """f(i_q), by a width (A) near zero."""
    if q.lost is None or q.widths is None:
        return along(q.i_q.astype(np.complex128), width).real
    place = float(np.interp(math.log(width), np.log(q.widths), np.arange(len(q.widths))))
    low = min(int(place), len(q.widths) - 2)
    return q.lost[:, low] + (place - low) * (q.lost[:, low + 1] - q.lost[:, low])


def q_axis_problem(q: QAxis, group: Places, kin: Places) -> Problem:
    """The question that the q axis asks."""
    n, most = len(q), _most(q)
    late = np.zeros(n) if q.t is None else (q.t - q.t.min()) / max(float(np.ptp(q.t)), 1e-12)
    columns = {"R_s": q.i_q, "psi_f": q.omega_e}
    columns |= {} if q.slope is None else {"L_q": q.slope}
    columns |= {} if q.i_d is None else {"L_d": q.omega_e * q.i_d}
    rough = np.linalg.lstsq(np.column_stack(list(columns.values())), q.u_q, rcond=None)[0]
    machine = tuple(
        Size(MACHINE, name, UNITS[name], max(abs(value), PLAUSIBLE[name][0]), starts=(value,))
        for name, value in zip(columns, rough.tolist(), strict=True)
    )

    def predict(sizes: PointSizes) -> Array:
        def of(owner: str, name: str) -> float:
            return sizes.get((owner, name), 0.0)

        R_s, L_q, psi_f = (of(MACHINE, name) for name in ("R_s", "L_q", "psi_f"))
        R = R_s * (1.0 + of("winding_resistance_drift", "rise") * late)
        psi = psi_f * (1.0 + of("magnet_flux_drift", "change") * late)
        if q.i_d is not None:
            psi = psi + of(MACHINE, "L_d") * q.i_d
        u = R * q.i_q + psi * q.omega_e + of("voltage_offset", "offset_q")
        if q.slope is not None and q.bend is not None:
            u = u + L_q * q.slope + psi * of(speed_lag.NAME, "lag") * q.bend
        if (lost := of(VOLTAGE_ERROR, "voltage")) != 0.0:
            u = u + lost * _lost(q, of(VOLTAGE_ERROR, "zero_crossing_width"))
        return u

    return Problem(
        q.u_q, np.zeros(n, np.intp), group, kin, machine, _effects(q, most, abs(float(rough[0]))), predict, _GOOD,
        _generic(q),
    )  # fmt: skip


def groups_in_time(q: QAxis) -> tuple[Places, Places]:
    """Stretches of time, shorter ones and longer ones."""
    places = np.arange(len(q))
    return places * _BLOCKS // len(q), places * _LASTING // len(q)


def _effects(q: QAxis, most: float, R_s: float) -> dict[str, tuple[Size, ...]]:
    """Effects that these rows can show, by name."""
    e = max(float(np.max(np.abs(q.u_q))), 1e-6)

    def size(key: Key, unit: str, typical: float, low: float, high: float, *starts: float, shape: bool = False) -> Size:
        return Size(*key, unit, typical, low, high, starts or (0.0,), shape)

    found = {
        VOLTAGE_ERROR: (
            size((VOLTAGE_ERROR, "voltage"), "V", 0.1 * max(R_s, 1e-6) * most, 0.0, e),
            size((VOLTAGE_ERROR, "zero_crossing_width"), "A", 0.02 * most, 1e-3 * most, 0.3 * most,
                 0.01 * most, 0.06 * most, shape=True),
        ),
        "voltage_offset": (size(("voltage_offset", "offset_q"), "V", 0.01 * e, -e, e),),
    }  # fmt: skip
    if q.t is not None:
        found["winding_resistance_drift"] = (size(("winding_resistance_drift", "rise"), "1", 0.1, -0.5, 1.0),)
        found["magnet_flux_drift"] = (size(("magnet_flux_drift", "change"), "1", 0.03, -0.3, 0.3),)
    if q.slope is not None and not q.by_angle:
        found[speed_lag.NAME] = (size((speed_lag.NAME, "lag"), "s", 2e-3, -5e-3, 0.1),)
    return found


def _generic(q: QAxis) -> Array:
    """Polynomials of speed, current and what changes them."""
    w = q.omega_e / max(float(np.max(np.abs(q.omega_e))), 1e-12)
    i = q.i_q / max(float(np.max(np.abs(q.i_q))), 1e-12)
    columns = [np.ones(len(q)), w * w, w * i, i * i, w * i * i, i**3]
    return np.column_stack(columns)
