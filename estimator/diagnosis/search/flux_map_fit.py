"""A free flux map from a recording: psi_d(i_d, i_q) and psi_q(i_d, i_q), where the library's curve does not bend so.

`estimator/physics/flux_map.py` has the map: a coenergy w that is a spline of the currents. The balance of flux linkages
over each period is linear in its coefficients and in R_s,

    u = R_s i_mean + balance of psi + what the other effects add

so one weighted least squares tells them, its noise whitened as everywhere in the diagnosis: that is where a fit begins.
The mean current needs the map's own slopes, so that it is done some times over. Third differences of the coefficients
are held down as much as stretches that took no part in the fit like best. P. H. C. Eilers, B. D. Marx, "Flexible
smoothing with B-splines and penalties", Statistical Science 11(2), 1996, doi 10.1214/ss/1038425655.

From there on the map's shapes are columns beside those of R_s, L_d, L_q and psi_f, while other effects are sought.
Standard errors know of bends within a cell what `MISSED` says of them. Knows nothing of how effects are found.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.columns import STRETCHES
from estimator.diagnosis.likelihood.evidence import FORM, Choice, Search
from estimator.diagnosis.likelihood.noise import filter_of, noise_of, whitened
from estimator.diagnosis.likelihood.whitening import Whitening, whiten
from estimator.diagnosis.verdict import FluxTable, Quantity
from estimator.machine import UNITS
from estimator.physics.flux_map import MISSED, Axis, Bend, line_of, mirrored, slopes_of
from estimator.physics.rows import Rows
from estimator.physics.saturation import SATURATIONS
from estimator.twin.model import Model, effects_voltage, in_truth, samples_in_mean

_CELL: Final = 1.0 / 7.0  # of the rated current: size of the spline's cells
_MAP_PASSES: Final = 3  # of fit and mean current
_SMOOTH: Final = tuple(10.0**-k for k in range(3, 11))  # weight of third differences, over that of the data
_LOOSE: Final = 1e-3  # as stiff as one third difference: what they do not hold down
_STRAIGHT_SHAPES: Final = 3  # shapes of straight lines: L_d, L_q, psi_f
_FREE_SHAPES: Final = 6  # shapes that third differences do not hold down: up to squares of either current
_MAP_CHUNK: Final = 2048  # periods at once
_FEWEST_IN_CELL: Final = 20  # rows in a cell, that it counts as visited
_LINE_CELLS: Final = 4  # cells, that tell a bend from a straight line
_LONG_LINE: Final = 0.6  # of the longest line's cells, that a long one has
_FAR_VALUES: Final = 10.0  # times the machine's values, that no map has at no current
_GLITCHES: Final = 1e-4  # of all currents: beyond are glitches
_TOLD_SIGMAS: Final = 3.0  # standard errors, rms over the cells, from which on a departure from straight lines is one
_LEAST_FLUX: Final = 0.01  # of the rms flux linkage that currents make: less is none that matters


class Departure(NamedTuple):
    """By how much of the rms of what currents make of it the flux linkage is not that of constants."""

    share: float
    sure: float  # rms in standard errors

    @property
    def told(self) -> bool:
        """The departure is there and matters."""
        return self.share > _LEAST_FLUX and self.sure > _TOLD_SIGMAS


@dataclass(frozen=True, slots=True, eq=False)
class FluxMap:
    """A map and how well it is told."""

    d: Axis
    q: Axis  # from as much below zero as above
    w: Array  # coefficients on (cells + 3) of d by the half of q that is free, Vs A
    bend: Array  # what of w is none of straight lines, Vs A
    covariance: Array  # of w
    visited: NDArray[np.bool_]  # (cells of d, cells of q)

    def flux(self, i: Vector) -> Vector:
        """Flux linkage (Vs) at currents (A)."""
        on_d, on_q = slopes_of(self.d, self.q, i)
        return on_d @ self.w + 1j * (on_q @ self.w)

    def std(self, i: Vector) -> tuple[Array, Array]:
        """Standard errors (Vs) of psi_d and psi_q at currents (A); NaN in cells that were not visited."""
        seen = self.seen(i)
        d, q = (self._std(on) for on in slopes_of(self.d, self.q, i))
        return np.where(seen, d, np.nan), np.where(seen, q, np.nan)

    def seen(self, i: Vector) -> NDArray[np.bool_]:
        """Whether currents (A) lie in cells that the recording visited, or their mirror images."""
        a, b = self.d.place(i.real), self.q.place(i.imag)
        inside = (i.real >= self.d.low) & (i.real <= self.d.low + self.d.step * self.d.cells)
        inside &= np.abs(i.imag) <= -self.q.low
        return inside & (self.visited[a, b] | self.visited[a, self.q.cells - 1 - b])

    def machine(self) -> dict[str, Quantity]:
        """L_d, L_q (H) and psi_f (Vs) at no current; nothing where the recording has not been there."""
        none = np.zeros(1, np.complex128)
        psi_d, _ = slopes_of(self.d, self.q, none)
        on = {"L_d": self._curved(none, "d"), "L_q": self._curved(none, "q"), "psi_f": psi_d}
        seen = bool(self.seen(none)[0])
        return {
            name: self._quantity(on[name][0], UNITS[name]) if seen else Quantity(None, None, UNITS[name]) for name in on
        }

    def departures(self) -> dict[str, Departure]:
        """How far psi is from straight lines along i_d, along i_q, and by the other axis' current.

        Along long lines of cells that the recording has visited, and from there on.
        """
        i, psi, lines = self._middles(), slopes_of(self.d, self.q, self._middles()), self._lines()
        both = self.seen(lines.d_of(i)) & self.seen(lines.q_of(i))
        on_d, on_q = slopes_of(self.d, self.q, lines.d)[0], slopes_of(self.d, self.q, lines.q)[1]
        level = np.stack([np.ones(len(lines.d)), lines.d.real], axis=1)
        slope = lines.q.imag / max(float(lines.q.imag @ lines.q.imag), 1e-300)
        off = {
            "d_axis_saturation": (on_d - level @ np.linalg.lstsq(level, on_d, rcond=None)[0], len(lines.d)),
            "q_axis_saturation": (on_q - np.outer(lines.q.imag, slope @ on_q), len(lines.q)),
            "cross_saturation": (np.concatenate(self._across(i[both])), np.count_nonzero(both)),
        }
        none = [on - slopes_of(self.d, self.q, np.zeros(1, np.complex128))[n] for n, on in enumerate(psi)]
        whole = float(np.linalg.norm(np.concatenate(none) @ self.w)) / math.sqrt(max(len(i), 1))
        if not whole > 0.0:
            return {}
        return {name: self._departure(on, whole) for name, (on, n) in off.items() if n >= _LINE_CELLS}

    def sizes(self, name: str) -> dict[str, Quantity]:
        """Of a saturation: least and most inductance along its line of `departures`; or what the other axis shifts."""
        if name == "cross_saturation":
            i, lines = self._middles(), self._lines()
            on, _ = self._across(i[self.seen(lines.d_of(i))])
            return {"psi_d_shift": self._quantity(on[int(np.argmax(np.abs(on @ self.w)))], "Vs")}
        axis, lines = name[0], self._lines()
        on = self._curved(lines.d if axis == "d" else lines.q, axis)
        value = on @ self.w
        least, most = on[int(np.argmin(value))], on[int(np.argmax(value))]
        return {f"L_{axis}_least": self._quantity(least, "H"), f"L_{axis}_most": self._quantity(most, "H")}

    def table(self) -> FluxTable:
        """At the corners of the cells and half way between."""
        i_d, i_q = (np.linspace(x.low, x.low + x.step * x.cells, 2 * x.cells + 1) for x in (self.d, self.q))
        i = np.add.outer(i_d, 1j * i_q).ravel()
        aside = [0.1 * complex(m * self.d.step, n * self.q.step) for m in (-1, 1) for n in (-1, 1)]
        seen = np.any([self.seen(i + by) for by in aside], axis=0)  # an edge belongs to the cells on both sides
        psi, std_d, std_q = self.flux(i), *(self._std(on) for on in slopes_of(self.d, self.q, i))
        parts = (np.where(seen, x, np.nan).reshape(len(i_d), len(i_q)) for x in (psi.real, psi.imag, std_d, std_q))
        return FluxTable(i_d, i_q, *parts)

    def part(self, name: str, i: Vector) -> Vector:
        """What of the flux linkage (Vs) at currents (A) is one of the three saturations.

        Along lines through no current, or through the visited cell that is nearest to it.
        """
        middles, none = self._middles(), np.zeros(1, np.complex128)
        at = none if self.seen(none)[0] else middles[[int(np.argmin(np.abs(middles)))]]
        here, psi = self.flux(at), self.flux(i)
        by_d, by_q = self.flux(_vector_at(i.real, at.imag)).real, self.flux(_vector_at(at.real, i.imag)).imag
        L_d, L_q = (float((self._curved(at, axis) @ self.w)[0]) for axis in "dq")
        return {
            "d_axis_saturation": _vector_at(by_d - here.real - L_d * (i.real - at.real), 0.0),
            "q_axis_saturation": _vector_at(0.0, by_q - here.imag - L_q * (i.imag - at.imag)),
            "cross_saturation": _vector_at(psi.real - by_d, psi.imag - by_q),
        }[name]

    def _departure(self, on: Array, whole: float) -> Departure:
        """Of some combinations of coefficients (n, coefficients), over a flux linkage (Vs)."""
        off, std = on @ self.w, self._std(on)
        errors = np.divide(off, std, out=np.zeros_like(off), where=std > 0.0)  # without i_q psi_q is none
        return Departure(float(np.sqrt(np.mean(off**2))) / whole, float(np.sqrt(np.mean(errors**2))))

    def _middles(self) -> Vector:
        a, b = np.nonzero(self.visited)
        return _vector_at(self.d.low + self.d.step * (a + 0.5), self.q.low + self.q.step * (b + 0.5))

    def _lines(self) -> "_Lines":
        """Long lines of visited cells along each axis, those nearest to no current."""
        i_d, at_d = _long(self._middles().real)
        i_q, at_q = _long(np.abs(self._middles().imag))
        along_d, along_q = _vector_at(i_d, at_q), _vector_at(at_d, i_q)
        return _Lines(along_d[self.seen(along_d)], along_q[self.seen(along_q)], at_d, at_q)

    def _across(self, i: Vector) -> tuple[Array, Array]:
        """psi_d and psi_q (n, coefficients) at currents, less those at the same current of their lines."""
        lines = self._lines()
        here, on_d, on_q = (slopes_of(self.d, self.q, at) for at in (i, lines.d_of(i), lines.q_of(i)))
        return here[0] - on_d[0], here[1] - on_q[1]

    def _curved(self, i: Vector, axis: str) -> Array:
        """d(psi)/d(i) along an axis (n, coefficients), H a coefficient."""
        d, q = (2, 0) if axis == "d" else (0, 2)
        D, Q = self.d.splines(i.real, d), self.q.splines(i.imag, q) @ mirrored(self.q)
        return np.einsum("na,nb->nab", D, Q).reshape(len(i), -1)

    def _std(self, on: Array) -> Array:
        noise = np.maximum(np.einsum("nj,jk,nk->n", on, self.covariance, on), 0.0)
        return np.sqrt(noise + FORM**2 * MISSED * (on @ self.bend) ** 2)

    def _quantity(self, on: Array, unit: str) -> Quantity:
        return Quantity(float(on @ self.w), float(self._std(on[None])[0]), unit)


class _Lines(NamedTuple):
    """Middles of cells along either axis."""

    d: Vector  # A
    q: Vector
    at_d: float  # A, i_d of the line along q
    at_q: float

    def d_of(self, i: Vector) -> Vector:
        """On the line along d, at the same i_d."""
        return _vector_at(i.real, self.at_q)

    def q_of(self, i: Vector) -> Vector:
        """On the line along q, at the same i_q."""
        return _vector_at(self.at_d, i.imag)


def _long(of: Array) -> tuple[Array, float]:
    """The different values of a coordinate, and of those that many cells have the smallest."""
    values, count = np.unique(of.round(9), return_counts=True)
    long = values[count >= _LONG_LINE * np.max(count, initial=0)]
    return values, float(min(long, key=abs, default=0.0))


def _vector_at(d: ArrayLike, q: ArrayLike) -> Vector:
    i = np.empty(np.broadcast(d, q).shape, np.complex128)
    i.real, i.imag = d, q
    return i


def map_begun(rows: Rows, model: Model) -> Model | None:
    """A map in the place of a model's saturation; its other effects stay as they are. None where it is no machine's."""
    kept = {name: sizes for name, sizes in model.effects.items() if name not in SATURATIONS}
    model = replace(model, effects=kept, bend=None)
    truth = in_truth(rows, model)
    rest, by = truth.u - effects_voltage(truth, model), filter_of(truth, model.machine)
    i, reach = truth.i, float(np.quantile(np.abs(truth.i.imag), 1.0 - _GLITCHES))
    low, high = np.quantile(i.real, [_GLITCHES, 1.0 - _GLITCHES]).tolist()
    d, q = Axis.over(low, high, _CELL * rows.i_rated), Axis.over(-reach, reach, _CELL * rows.i_rated)
    shapes, stiff = _shapes(d, q)
    samples = samples_in_mean(model)
    psi, mean, machine, bend = truth.flux(i), truth.i_mean, model.machine, None
    for n in range(_MAP_PASSES):
        noise = noise_of(whitened(rest - machine.R_s * mean - truth.balance(psi), by), None, truth, samples)
        value, precision = _map_solved(_sums(truth, d, q, shapes, mean, rest, noise, by), stiff)
        L_d, L_q, psi_f = value[:_STRAIGHT_SHAPES].tolist()
        before = model.machine
        ratios = value[-1] / before.R_s, L_d / before.L_d, L_q / before.L_q, psi_f / before.psi_f
        if not all(1.0 / _FAR_VALUES < ratio < _FAR_VALUES for ratio in ratios):
            return None
        machine = replace(machine, R_s=float(value[-1]), L_d=L_d, L_q=L_q, psi_f=psi_f)
        bend = Bend(
            d, q, shapes[:, _STRAIGHT_SHAPES:] / np.sqrt(precision), value[_STRAIGHT_SHAPES:-1] * np.sqrt(precision)
        )
        at = truth.with_machine(machine)
        psi, g = bend.bent(at)
        mean = at.i_mean if n == 0 else at.mean_current(psi, g)  # a first map may be too rough for slopes
    return replace(model, machine=machine, bend=bend)


def told_map(search: Search, choice: Choice, lent: float = 0.0) -> FluxMap:
    """The map of a fit, with its uncertainty as the residual scatters.

    `lent`: energy over noise that what has no name may have lent to each parameter.
    """
    bend, fit = search.regression.model.bend, search.fit(choice)
    assert bend is not None
    line = line_of(bend.d, bend.q)
    shapes = {"L_d": line[1], "L_q": line[2], "psi_f": line[3]}
    shapes |= {parameter: bend.basis[:, k] for k, parameter in enumerate(bend.names)}
    parameters = [search.columns[j].parameter if search.columns[j].owner == "machine" else "" for j in fit.places]
    on = np.array([shapes.get(name, np.zeros(line.shape[1])) for name in parameters]).T
    scatter = np.sqrt(search.parameter_scatter(fit) + lent)
    covariance = fit.covariance * np.outer(scatter, scatter) + search.form_covariance(choice)
    rows = search.regression.rows
    visited = _visited(bend, rows.i[1:][rows.joined])
    return FluxMap(bend.d, bend.q, on @ fit.value, bend.basis @ bend.size, on @ covariance @ on.T, visited)


def _visited(bend: Bend, i: Vector) -> NDArray[np.bool_]:
    count = np.zeros((bend.d.cells, bend.q.cells), np.intp)
    np.add.at(count, (bend.d.place(i.real), bend.q.place(i.imag)), 1)
    return count >= _FEWEST_IN_CELL


def _shapes(d: Axis, q: Axis) -> tuple[Array, Array]:
    """Shapes of w (coefficients, shapes), of unlike ones: L_d, L_q, psi_f, and bends; and how stiff each bend is.

    What third differences do not hold down, up to squares of both currents, is given a little.
    """
    free = mirrored(q)
    along_d = np.kron(np.diff(np.eye(d.cells + 3), 3, axis=0), np.eye(free.shape[1]))
    along_q = np.kron(np.eye(d.cells + 3), np.diff(free, 3, axis=0))
    stiff, shapes = np.linalg.eigh(along_d.T @ along_d + along_q.T @ along_q)
    line, flat = line_of(d, q), shapes[:, :_FREE_SHAPES]
    lines = cast(Array, np.linalg.qr(line.T)[0])
    others = cast(Array, np.linalg.svd(flat - lines @ (lines.T @ flat))[0])[:, : _FREE_SHAPES - len(line)]
    bends = np.concatenate([others, shapes[:, _FREE_SHAPES:]], axis=1)
    return np.concatenate([line[1:].T, bends], axis=1), np.maximum(stiff[len(line) :], _LOOSE)


def _sums(
    rows: Rows, d: Axis, q: Axis, shapes: Array, mean: Vector, rest: Vector, noise: tuple[float, float, float],
    by: Whitening,
) -> Array:  # fmt: skip
    """Sums of squares and products of all shapes' columns, that of R_s, and y, by stretch."""
    P = shapes.shape[1]
    gram, state = np.zeros((STRETCHES, P + 2, P + 2)), np.zeros(P + 2, np.complex128)
    for s, (a, b) in enumerate(pairwise(np.linspace(0, len(rows), STRETCHES + 1).astype(int).tolist())):
        for begin in range(a, b, _MAP_CHUNK):
            cut = slice(begin, min(begin + _MAP_CHUNK, b))
            part = rows[cut]
            on_d, on_q = slopes_of(d, q, part.i)
            psi = (on_d @ shapes + 1j * (on_q @ shapes)).T
            v = np.empty((P + 2, len(part)), np.complex128)
            v[:P] = (part.half * psi[:, 1:] - part.half.conj() * psi[:, :-1]) / part.T_s
            v[P], v[P + 1] = mean[cut], rest[cut]
            whiten(v, *by.over(cut), state)
            white = np.concatenate([v.real / noise[0], v.imag / noise[1]], axis=1)
            gram[s] += white @ white.T
    return gram


def _map_solved(grams: Array, stiff: Array) -> tuple[Array, Array]:
    """Sizes of the shapes and R_s; and the precision by which the bends are held down."""
    even, odd, both = grams[0::2].sum(axis=0), grams[1::2].sum(axis=0), grams.sum(axis=0)
    held = np.concatenate([np.zeros(_STRAIGHT_SHAPES), stiff, np.zeros(1)])
    held *= float(np.mean(np.diag(both)[_STRAIGHT_SHAPES:-2]))
    weight = min(_SMOOTH, key=lambda by: _left_of_map(even, odd, by * held) + _left_of_map(odd, even, by * held))
    return _least_by_gram(both, weight * held), weight * held[_STRAIGHT_SHAPES:-1]


def _least_by_gram(gram: Array, held: Array) -> Array:
    A = gram[:-1, :-1] + np.diag(held)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    return cast(Array, np.linalg.solve(A * np.outer(scale, scale), gram[:-1, -1] * scale)) * scale


def _left_of_map(fit: Array, judge: Array, held: Array) -> float:
    """What a fit to one part of the recording leaves of another."""
    there = np.append(_least_by_gram(fit, held), -1.0)
    return float(there @ judge @ there)
