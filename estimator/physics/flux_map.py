"""A free flux map: psi_d(i_d, i_q) and psi_q(i_d, i_q) of a machine that saturates as no curve of few numbers does.

Both are the slopes of one function of the currents, the coenergy w (Vs A), so that the map is reciprocal whatever the
data:

    psi_d = dw/d(i_d)        psi_q = dw/d(i_q)        d(psi_d)/d(i_q) = d(psi_q)/d(i_d)
    w = psi_f i_d + L_d i_d^2 / 2 + L_q i_q^2 / 2 + bend

The bend is a bicubic B-spline of the currents, the same for either sign of i_q. Coenergy: A. E. Fitzgerald and others,
"Electric Machinery", 6th ed., 2003, chapter 3. What pulses' ripple makes of a bent curve is left out. At a single
speed, whatever else depends on the currents alone looks like it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.machine import Machine
from estimator.physics.rows import Rows
from estimator.physics.vectors import Stiffness

MISSED: Final = 3e-5
"""Part of its energy that a map may leave, as bends within a cell."""

_MOST: Final = 24  # cells of an axis
_FLATTEST: Final = 0.02  # of the linear part's inductances: no map is followed to where it is flatter


@dataclass(frozen=True, slots=True)
class Axis:
    """Equal cells of a current."""

    low: float  # A
    step: float  # A
    cells: int

    @classmethod
    def over(cls, low: float, high: float, cell: float) -> "Axis":
        """Cells of about that size (A), two at least; wider ones where they would be too many."""
        middle, reach = 0.5 * (low + high), max(0.5 * (high - low), cell)
        cells = min(max(2, round(2.0 * reach / cell)), _MOST)
        return cls(middle - reach, 2.0 * reach / cells, cells)

    def place(self, i: Array) -> NDArray[np.intp]:
        """The cell of each current; beyond the ends the outermost."""
        cell: NDArray[np.intp] = np.floor((i - self.low) / self.step).astype(np.intp)
        return np.clip(cell, 0, self.cells - 1)

    def splines(self, i: Array, order: int) -> Array:
        """All cells + 3 cubic B-splines at currents (n, cells + 3), or their derivatives, 1/A^order."""
        return _all_splines(i, self.low, self.step, self.cells, order)

    def powers(self, order: int) -> Array:
        """Coefficients (cells + 3) that make 1, i or i^2 of the splines."""
        middle = np.linspace(self.low - self.step, self.low + self.step * (self.cells + 1), self.cells + 3)
        return (np.ones(len(middle)), middle, middle**2 - self.step**2 / 3.0)[order]


def mirrored(q: Axis) -> Array:
    """Coefficients of all splines of q (cells + 3) from those that are free: alike for either sign of the current."""
    side = q.cells + 3
    return np.eye((side + 1) // 2)[[min(m, side - 1 - m) for m in range(side)]]


def line_of(d: Axis, q: Axis) -> Array:
    """Coefficients of w for 1 Vs A, and for one H of L_d, one H of L_q, one Vs of psi_f: (4, coefficients)."""
    free = (q.cells + 4) // 2
    flat_d, flat_q = d.powers(0), q.powers(0)[:free]
    parts = (
        (flat_d, flat_q), (0.5 * d.powers(2), flat_q), (flat_d, 0.5 * q.powers(2)[:free]), (d.powers(1), flat_q)
    )  # fmt: skip
    return np.array([np.outer(*part).ravel() for part in parts])


def slopes_of(d: Axis, q: Axis, i: Vector) -> tuple[Array, Array]:
    """psi_d and psi_q (n, coefficients) of one Vs A of each coefficient."""
    D, D_1 = d.splines(i.real, 0), d.splines(i.real, 1)
    Q, Q_1 = (q.splines(i.imag, order) @ mirrored(q) for order in (0, 1))
    n = len(i)
    return np.einsum("na,nb->nab", D_1, Q).reshape(n, -1), np.einsum("na,nb->nab", D, Q_1).reshape(n, -1)


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """How far a map is from straight lines: so much of each of some smooth shapes."""

    d: Axis
    q: Axis
    basis: Array  # (coefficients, shapes): Vs A, of such size that one of each is as likely as not
    size: Array  # (shapes,)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the shapes."""
        return tuple(f"bend {k}" for k in range(len(self.size)))

    def flux(self, i: Vector) -> Vector:
        """Flux linkage (Vs) at currents (A), beside that of straight lines."""
        return self._at(i)[0]

    def inductances(self, machine: Machine, i: Vector) -> tuple[Array, Array, Array]:
        """d(psi_d)/d(i_d), d(psi_q)/d(i_q) and d(psi_d)/d(i_q) of the whole map, H."""
        _, dd, qq, dq = self._at(i)
        dd = np.maximum(dd + machine.L_d, _FLATTEST * machine.L_d)
        qq = np.maximum(qq + machine.L_q, _FLATTEST * machine.L_q)
        most = np.sqrt((1.0 - _FLATTEST) * dd * qq)
        return dd, qq, np.clip(dq, -most, most)

    def stiffness(self, machine: Machine, i: Vector) -> Stiffness:
        """d(i)/d(psi) of the whole map at currents (A)."""
        dd, qq, dq = self.inductances(machine, i)
        det = dd * qq - dq**2
        return Stiffness(0.5 * (qq + dd) / det, 0.5 * (qq - dd) / det - 1j * dq / det)

    def bent(self, rows: Rows) -> tuple[Vector, Stiffness]:
        """Flux linkages (Vs) of the whole map at samples, and their stiffness."""
        return rows.flux(rows.i) + self.flux(rows.i), self.stiffness(rows.machine, rows.i)

    def voltage(self, rows: Rows) -> Vector:
        """Added voltage, V."""
        psi, g = self.bent(rows)
        return rows.balance(psi - rows.flux(rows.i)) + rows.machine.R_s * (rows.mean_current(psi, g) - rows.i_mean)

    def voltages(self, rows: Rows) -> NDArray[np.complex128]:
        """Of one of each shape, (shapes, n): what they make of mean currents left out."""
        on_d, on_q = slopes_of(self.d, self.q, rows.i)
        psi = (on_d @ self.basis + 1j * (on_q @ self.basis)).T
        return (rows.half * psi[:, 1:] - rows.half.conj() * psi[:, :-1]) / rows.T_s

    def _at(self, i: Vector) -> tuple[Vector, Array, Array, Array]:
        w = (self.basis @ self.size).reshape(self.d.cells + 3, -1) @ mirrored(self.q).T
        d, q = self.d, self.q
        return _spline_slopes(i, np.ascontiguousarray(w), d.low, d.step, d.cells, q.low, q.step, q.cells)


@kernel
def _spline_slopes(
    i: Vector, w: Array, d_low: float, d_step: float, d_cells: int, q_low: float, q_step: float, q_cells: int
) -> tuple[Vector, Array, Array, Array]:  # fmt: skip
    """Slopes of a spline w of two currents as a vector, and its curvatures dd, qq, dq."""
    n = len(i)
    psi, dd, qq, dq = np.empty(n, np.complex128), np.empty(n), np.empty(n), np.empty(n)
    on_d, on_q = np.empty((3, 4)), np.empty((3, 4))
    for k in range(n):
        a, b = _splines(i[k].real, d_low, d_step, d_cells, on_d), _splines(i[k].imag, q_low, q_step, q_cells, on_q)
        by_d, by_q, by_dd, by_qq, by_dq = 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(4):
            for j in range(4):
                c = w[a + m, b + j]
                by_d += c * on_d[1, m] * on_q[0, j]
                by_q += c * on_d[0, m] * on_q[1, j]
                by_dd += c * on_d[2, m] * on_q[0, j]
                by_qq += c * on_d[0, m] * on_q[2, j]
                by_dq += c * on_d[1, m] * on_q[1, j]
        psi[k], dd[k], qq[k], dq[k] = complex(by_d, by_q), by_dd, by_qq, by_dq
    return psi, dd, qq, dq


@kernel
def _all_splines(i: Array, low: float, step: float, cells: int, order: int) -> Array:
    found, on = np.zeros((len(i), cells + 3)), np.empty((3, 4))
    for k in range(len(i)):
        n = _splines(i[k], low, step, cells, on)
        for m in range(4):
            found[k, n + m] = on[order, m]
    return found


@kernel
def _splines(i: float, low: float, step: float, cells: int, on: Array) -> int:
    """The cell of a current; its four splines and their derivatives go into `on` (3, 4)."""
    n = min(max(int(np.floor((i - low) / step)), 0), cells - 1)
    x = min(max((i - low) / step - n, 0.0), 1.0)  # beyond the ends it is what it is there
    y = 1.0 - x
    on[0, 0], on[0, 3] = y**3 / 6.0, x**3 / 6.0
    on[0, 1], on[0, 2] = (3.0 * x**3 - 6.0 * x**2 + 4.0) / 6.0, (3.0 * y**3 - 6.0 * y**2 + 4.0) / 6.0
    on[1, 0], on[1, 3] = -0.5 * y**2 / step, 0.5 * x**2 / step
    on[1, 1], on[1, 2] = (1.5 * x**2 - 2.0 * x) / step, (-1.5 * y**2 + 2.0 * y) / step
    on[2, 0], on[2, 1] = y / step**2, (3.0 * x - 2.0) / step**2
    on[2, 2], on[2, 3] = (3.0 * y - 2.0) / step**2, x / step**2
    return n
