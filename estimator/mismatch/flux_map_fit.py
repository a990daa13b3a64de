"""A free flux map from a recording: psi_d(i_d, i_q) and psi_q(i_d, i_q), where the library's curve does not bend so.

Both are the slopes of one function of the currents, the coenergy w, so that the map is reciprocal whatever the data:

    psi_d = dw/d(i_d)        psi_q = dw/d(i_q)        d(psi_d)/d(i_q) = d(psi_q)/d(i_d)

w (Vs A) is a bicubic B-spline of the currents, the same for either sign of i_q. The balance of flux linkages over each
period is linear in its coefficients and in R_s,

    u = R_s i_mean + balance of psi + what the other effects add

so one weighted least squares over the whole recording tells them, its noise whitened as everywhere in the diagnosis.
The mean current needs the map's own slopes, so that it is done some times over. Third differences of the coefficients
are held down as much as stretches that took no part in the fit like best. P. H. C. Eilers, B. D. Marx, "Flexible
smoothing with B-splines and penalties", Statistical Science 11(2), 1996, doi 10.1214/ss/1038425655; coenergy:
A. E. Fitzgerald and others, "Electric Machinery", 6th ed., 2003, chapter 3.

What pulses' ripple makes of a bent curve is left out, and standard errors do not know of bends within a cell. Knows
nothing of how effects are found.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.mismatch.columns import (
    STRETCHES,
    Array,
    Model,
    effects_voltage,
    filter_pole,
    in_truth,
    noise_of,
    whitened,
)  # fmt: skip
from estimator.mismatch.verdict import Quantity
from estimator.mismatch.whitening import whiten
from estimator.physics.rows import Real, Rows, Stiffness, Vector
from estimator.physics.saturation import EFFECTS

_CELL: Final = 0.25  # of the rated current: size of the spline's cells
_PASSES: Final = 3  # of fit and mean current
_SMOOTH: Final = tuple(10.0**-k for k in range(3, 11))  # weight of third differences, over that of the data
_RIDGE: Final = 1e-13  # the same of the coefficients themselves, of which w needs no level
_PART: Final = 2048  # periods at once
_FEWEST: Final = 20  # rows in a cell, that it counts as visited


@dataclass(frozen=True, slots=True)
class Axis:
    """Equal cells of a current."""

    low: float  # A
    step: float  # A
    cells: int

    @classmethod
    def over(cls, low: float, high: float, cell: float) -> "Axis":
        """Cells of about that size (A)."""
        cells = max(2, round((high - low) / cell))
        return cls(low, (high - low) / cells, cells)

    def place(self, i: Real) -> NDArray[np.intp]:
        """The cell of each current; beyond the ends the outermost goes on."""
        cell: NDArray[np.intp] = np.floor((i - self.low) / self.step).astype(np.intp)
        return np.clip(cell, 0, self.cells - 1)

    def splines(self, i: Real, order: int) -> Array:
        """All cells + 3 cubic B-splines at currents (n, cells + 3), or their derivatives, 1/A^order."""
        n = self.place(i)
        x = (i - self.low) / self.step - n
        y = 1.0 - x
        parts = (
            (y**3 / 6.0, (3.0 * x**3 - 6.0 * x**2 + 4.0) / 6.0, (3.0 * y**3 - 6.0 * y**2 + 4.0) / 6.0, x**3 / 6.0),
            (-0.5 * y**2, 1.5 * x**2 - 2.0 * x, -1.5 * y**2 + 2.0 * y, 0.5 * x**2),
            (y, 3.0 * x - 2.0, 3.0 * y - 2.0, x),
        )[order]
        found = np.zeros((len(i), self.cells + 3))
        for k, part in enumerate(parts):
            found[np.arange(len(i)), n + k] = part / self.step**order
        return found


@dataclass(frozen=True, slots=True, eq=False)
class FluxMap:
    """A map and how well it is told."""

    d: Axis
    q: Axis
    w: Array  # coefficients on (cells + 3) of d by the half of q that is free, Vs A
    covariance: Array  # of w
    visited: NDArray[np.bool_]  # (cells of d, cells of q)
    R_s: Quantity

    def flux(self, i: Vector) -> Vector:
        """Flux linkage (Vs) at currents (A)."""
        on_d, on_q = self._slopes(i)
        return on_d @ self.w + 1j * (on_q @ self.w)

    def std(self, i: Vector) -> tuple[Real, Real]:
        """Standard errors (Vs) of psi_d and psi_q at currents (A); NaN in cells that were not visited."""
        seen = self.seen(i)
        d, q = (np.sqrt(np.einsum("nj,jk,nk->n", on, self.covariance, on)) for on in self._slopes(i))
        return np.where(seen, d, np.nan), np.where(seen, q, np.nan)

    def seen(self, i: Vector) -> NDArray[np.bool_]:
        """Whether currents (A) lie in cells that the recording visited, or their mirror images."""
        a, b = self.d.place(i.real), self.q.place(i.imag)
        inside = (i.real >= self.d.low) & (i.real <= self.d.low + self.d.step * self.d.cells)
        inside &= np.abs(i.imag) <= -self.q.low
        return inside & (self.visited[a, b] | self.visited[a, self.q.cells - 1 - b])

    def stiffness(self, i: Vector) -> Stiffness:
        """d(i)/d(psi) at currents (A)."""
        D = [self.d.splines(i.real, order) for order in range(3)]
        Q = [self.q.splines(i.imag, order) @ _mirrored(self.q) for order in range(3)]
        w = self.w.reshape(D[0].shape[1], -1)
        dd, qq, dq = (np.einsum("na,ab,nb->n", D[m], w, Q[n]) for m, n in ((2, 0), (0, 2), (1, 1)))
        det = dd * qq - dq**2
        return Stiffness(0.5 * (qq + dd) / det, 0.5 * (qq - dd) / det - 1j * dq / det)

    def departures(self) -> dict[str, float]:
        """By how much psi is not that of constants, over its rms: along i_d, along i_q, and by the other axis' current.

        In the middles of visited cells.
        """
        a, b = np.nonzero(self.visited)
        i = np.empty(len(a), np.complex128)
        i.real, i.imag = self.d.low + self.d.step * (a + 0.5), self.q.low + self.q.step * (b + 0.5)
        psi, by_d, by_q = self.flux(i), self.flux(0.5 * (i + i.conj())).real, self.flux(0.5 * (i - i.conj())).imag
        off = {
            "d_axis_saturation": by_d - np.polyval(np.polyfit(i.real, by_d, 1), i.real),
            "q_axis_saturation": by_q - i.imag * float(by_q @ i.imag) / float(i.imag @ i.imag),
            "cross_saturation": np.abs(psi - by_d - 1j * by_q),
        }
        whole = float(np.sqrt(np.mean(np.abs(psi) ** 2)))
        return {name: float(np.sqrt(np.mean(part**2))) / whole for name, part in off.items()}

    def _slopes(self, i: Vector) -> tuple[Array, Array]:
        return _slopes_of(self.d, self.q, i)


def fitted_map(rows: Rows, model: Model) -> FluxMap:
    """The map in the place of a model's saturation; its other effects stay as they are."""
    kept = {name: sizes for name, sizes in model.effects.items() if name not in EFFECTS}
    others = Model(model.machine, kept, model.angle, model.zero)
    truth = in_truth(rows, others)
    rest = truth.u - effects_voltage(truth, others)
    i, reach = truth.i, float(np.max(np.abs(truth.i.imag)))
    d = Axis.over(float(np.min(i.real)), float(np.max(i.real)), _CELL * rows.i_rated)
    q = Axis.over(-reach, reach, _CELL * rows.i_rated)
    rho, count = filter_pole(model.machine, rows.T_s), 2 * int(rows.joined.sum())
    R_s, psi, mean, found = model.machine.R_s, truth.flux(i), truth.i_mean, None
    for _ in range(_PASSES):
        left = whitened(rest - R_s * mean - truth.balance(psi), truth, rho)
        noise = noise_of(left, None, truth)[:2]
        value, covariance = _solved(_sums(truth, d, q, mean, rest, noise, rho), d, q, count)
        R_s = float(value[-1])
        told = Quantity(R_s, float(np.sqrt(covariance[-1, -1])), "ohm")
        found = FluxMap(d, q, value[:-1], covariance[:-1, :-1], _visited(d, q, i), told)
        psi = found.flux(i)
        mean = truth.mean_current(psi, found.stiffness(i))
    assert found is not None
    return found


def _visited(d: Axis, q: Axis, i: Vector) -> NDArray[np.bool_]:
    count = np.zeros((d.cells, q.cells), np.intp)
    np.add.at(count, (d.place(i.real), q.place(i.imag)), 1)
    return count >= _FEWEST


def _mirrored(q: Axis) -> Array:
    """Coefficients of all splines of q from those that are free."""
    side = q.cells + 3
    return np.eye((side + 1) // 2)[[min(m, side - 1 - m) for m in range(side)]]


def _slopes_of(d: Axis, q: Axis, i: Vector) -> tuple[Array, Array]:
    """psi_d and psi_q (n, coefficients) of one Vs A of each coefficient."""
    D, D_1 = d.splines(i.real, 0), d.splines(i.real, 1)
    Q, Q_1 = (q.splines(i.imag, order) @ _mirrored(q) for order in (0, 1))
    n = len(i)
    return np.einsum("na,nb->nab", D_1, Q).reshape(n, -1), np.einsum("na,nb->nab", D, Q_1).reshape(n, -1)


def _sums(
    rows: Rows, d: Axis, q: Axis, mean: Vector, rest: Vector, noise: tuple[float, float], rho: float
) -> Array:  # fmt: skip
    """Sums of squares and products of all coefficients' columns, that of R_s, and y, by stretch."""
    P = (d.cells + 3) * ((q.cells + 4) // 2)
    gram, state = np.zeros((STRETCHES, P + 2, P + 2)), np.zeros(P + 2, np.complex128)
    for s, (a, b) in enumerate(pairwise(np.linspace(0, len(rows), STRETCHES + 1).astype(int).tolist())):
        for begin in range(a, b, _PART):
            cut = slice(begin, min(begin + _PART, b))
            part = rows[cut]
            on_d, on_q = _slopes_of(d, q, part.i)
            psi = (on_d + 1j * on_q).T
            v = np.empty((P + 2, len(part)), np.complex128)
            v[:P] = (part.half * psi[:, 1:] - part.half.conj() * psi[:, :-1]) / part.T_s
            v[P], v[P + 1] = mean[cut], rest[cut]
            whiten(v, part.half, part.joined, part.T_s, rho, state)
            white = np.concatenate([v.real / noise[0], v.imag / noise[1]], axis=1)
            gram[s] += white @ white.T
    return gram


def _solved(grams: Array, d: Axis, q: Axis, count: int) -> tuple[Array, Array]:
    """Coefficients and R_s, and their covariance: by what is left of so many numbers as by white noise, and by how that
    scatters from stretch to stretch.
    """
    even, odd, both = grams[0::2].sum(axis=0), grams[1::2].sum(axis=0), grams.sum(axis=0)
    bends = _bends(d, q, both)
    weight = min(_SMOOTH, key=lambda by: _left(even, odd, by * bends) + _left(odd, even, by * bends))
    value, inverse = _least(both, weight * bends)
    score = grams[:, :-1, -1] - grams[:, :-1, :-1] @ value
    along = (score - score.mean(axis=0)) @ inverse
    return value, inverse * max(1.0, _left(both, both, weight * bends) / count) + along.T @ along


def _least(gram: Array, bends: Array) -> tuple[Array, Array]:
    A = gram[:-1, :-1] + bends
    scale = 1.0 / np.sqrt(np.diag(A))
    inverse = cast(Array, np.linalg.inv(A * np.outer(scale, scale))) * np.outer(scale, scale)
    return inverse @ gram[:-1, -1], inverse


def _left(fit: Array, judge: Array, bends: Array) -> float:
    """What a fit to one part of the recording leaves of another."""
    value, _ = _least(fit, bends)
    there = np.append(value, -1.0)
    return float(there @ judge @ there)


def _bends(d: Axis, q: Axis, gram: Array) -> Array:
    """Third differences along either axis, and a little of the coefficients, in the scale of the data."""
    free = _mirrored(q)
    along_d = np.kron(np.diff(np.eye(d.cells + 3), 3, axis=0), np.eye(free.shape[1]))
    along_q = np.kron(np.eye(d.cells + 3), np.diff(free, 3, axis=0))
    P = along_d.shape[1]
    bends = np.zeros((P + 1, P + 1))
    bends[:P, :P] = along_d.T @ along_d + along_q.T @ along_q + (_RIDGE / _SMOOTH[-1]) * np.eye(P)
    return bends * float(np.trace(gram[:P, :P])) / P
