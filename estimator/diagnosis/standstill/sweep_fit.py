"""A model of a standing motor's axis, fitted to a sweep by its harmonics.

    u exp(-j k omega delay) = (R_s cos(x) + j k omega L sin(x) / x) i exp(j x) + lost_k + ...      k = 1, 3

with x = k omega T_s / 2: the flux balance of a control period, of currents at its ends; u is what the legs were told at
the dc link's voltage. What the legs lose follows from the measured currents, period by period, by the equations of
`lost_voltage`: its fundamental hides as R_s, its third harmonic does not. Beside it, as terms to choose from, at
s = j omega sin(x) / x:

    R_x sqrt(2 s / omega_1)          currents that diffuse into a conductor; R_x at 1 kHz
    R_x s / (s + omega_c)            a rung of a ladder
    L s -> L s / (1 + s / omega_c)   a resistance beside all of the inductance
    -s b (i^3)_k                     a flux that saturates

The first is that of R. L. Stoll, The Analysis of Eddy Currents, Oxford 1974. Rows are weighted by how wrong the model
is left (a share of the voltage, and of the third harmonic's, fitted) and by how wrong the currents' sum says they are.
Knows nothing of which terms are right.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import product
from typing import Final, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.standstill.tones import LEGS, ORDERS, Tone, Tones, amplitudes, harmonics, waveform
from estimator.physics.bridge.legs import legs_at_rest
from estimator.physics.bridge.lost_voltage import lost_between

SweepTerms = tuple[str, ...]
Index = NDArray[np.int64]
LOST, DIFFUSION, RUNG, BESIDE, SATURATION = "lost", "diffusion", "rung", "beside", "saturation"
SIZE_UNITS: Final = {"R_s": "ohm", "L_d": "H", "delay": "s", "u_lost": "V", "dead_time": "s", "u_drop": "V",
                "zero_crossing_width": "A", "R_x": "ohm", "corner": "Hz", "b": "H/A^2"}  # fmt: skip
TYPICAL_WIDTH, WIDEST = 0.1, 0.2  # of the largest current, of zero crossings
KILOHERTZ: Final = 2e3 * math.pi  # rad/s
_WIDTHS: Final = WIDEST * np.geomspace(0.02, 1.0, 7)
_DEAD_TIMES: Final = np.linspace(0.0, 0.06, 10)  # of a control period
_DELAYS: Final = (-1.5, 3.5)  # sampling periods
_CORNERS: Final = (1.0, 3.0)  # of the lowest and of the highest frequency
_FIT_ROUNDS: Final = 8  # of a fit and of the shares that it leaves
_MOST_STEPS: Final = 60  # of a search for shapes
_SHAPE_STEP: Final = 1e-4  # of a shape's range, for differences
_SHARE_GRIDS: Final = (np.geomspace(3e-4, 0.3, 61), np.geomspace(0.02, 1.0, 30))
_BEGIN: Final = ((0.02, 0.05), (0.02, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class SweepFit:
    """Terms with their sizes."""

    terms: SweepTerms
    values: dict[str, float]  # by UNITS
    shapes: Array  # where the search ended
    covariance: dict[tuple[str, str], float]
    error: Vector  # (tones,) V: what is left of the fundamentals
    shares: tuple[float, float]  # of the voltage, and of the third harmonic's, that the model leaves
    log_evidence: float


class Sweep:
    """A sweep made ready for fits."""

    def __init__(self, tones: Tones) -> None:
        self.tones = tones
        self._omega = tones.omega
        orders = np.arange(ORDERS + 1)
        self._order_omega = np.outer(self._omega, orders)
        # Harmonics of a duty times the dc link, from those of the duty and their conjugates
        u_dc, unit = waveform(tones.u_dc)[:, None], np.eye(ORDERS + 1, dtype=np.complex128)
        real, imaginary = amplitudes(waveform(unit) * u_dc), amplitudes(waveform(1j * unit) * u_dc) / 1j
        self._by_duty = 0.5 * (real + imaginary).transpose(0, 2, 1)
        self._mirrored = 0.5 * (real - imaginary).transpose(0, 2, 1)
        self.size = np.abs(self.applied(0.0)[:, 1])  # V, of the voltage
        self.u_dc = float(np.mean(tones.u_dc[:, 0].real))
        self._widths = _WIDTHS * tones.largest
        self._noise = np.zeros(len(self._omega))
        self._cube = amplitudes(waveform(tones.i) ** 3)
        self._thirds = (np.zeros(len(self._omega)), np.zeros(len(self._omega)))
        base = self.fit(())
        self._noise = self.size / np.abs(tones.i[:, 1]) * tones.noise  # V
        Z_3 = np.abs(base.values["R_s"] + 3j * self._omega * base.values["L_d"])
        # V: how wrong the third harmonic's row is by the currents, and how large it is
        self._thirds = Z_3 * np.hypot(tones.doubt[:, 3], tones.noise), Z_3 * np.abs(tones.i[:, 3])
        # For the ripple alone; a tenth of what the highest frequency could have, where the first fit has next to none
        self._L = max(base.values["L_d"], 0.1 * float(self.size[-1] / np.abs(tones.i[-1, 1]) / self._omega[-1]))

    @cached_property
    def _tables(self) -> tuple[Vector, Vector]:
        """What the legs lose by dead times (widths, dead times, tones, orders) and by 1 V of drops (widths, ...), V."""
        timed, dropped = list[list[Vector]](), list[Vector]()
        lossy = [Lossy(tone, self.tones, self._L) for tone in self.tones.rows]
        for width in self._widths.tolist():
            timed.append([np.stack([one.lost(float(t) * self.tones.T_s, 0.0, width) for one in lossy])
                          for t in _DEAD_TIMES])  # fmt: skip
            dropped.append(np.stack([one.lost(0.0, 1.0, width) for one in lossy]))
        return np.array(timed), np.array(dropped)

    # --- columns

    def applied(self, delay: float) -> Vector:
        """Harmonics of the voltage (V) that the legs were told, delayed (s)."""
        late = self.tones.duty * np.exp(-1j * self._order_omega * delay)
        u = np.einsum("tok,tk->to", self._by_duty, late) + np.einsum("tok,tk->to", self._mirrored, late.conj())
        return cast(Vector, u)

    def _lost(self, shapes: dict[str, float]) -> tuple[Vector, Vector]:
        """By dead time, and by a volt of drops."""
        by_dead_time, by_drop = self._tables
        width, dead = _curve(len(_WIDTHS))(shapes["width"]), _curve(len(_DEAD_TIMES))(shapes["dead"])
        timed = np.einsum("w,d,wdto->to", width, dead, by_dead_time)
        return timed, np.einsum("w,wto->to", width, by_drop)

    def _operators(self, order: int) -> tuple[Vector, Vector]:
        """Of a mean over a period, and of a change in it (1/s), on currents at samples."""
        x = 0.5 * order * self._omega * self.tones.T_s
        return np.cos(x) * np.exp(1j * x), 2j * np.sin(x) / self.tones.T_s * np.exp(1j * x)

    def _columns(self, terms: SweepTerms, shapes: dict[str, float], order: int) -> tuple[Vector, Vector]:
        """Per unit of what is linear; and what is not."""
        mean, change = self._operators(order)
        i, s = self.tones.i[:, order], change / mean
        corner = math.exp(shapes.get("corner", 0.0))
        columns, fixed = [mean * i, mean * i * (s / (1.0 + s / corner) if BESIDE in terms else s)], 0.0 * i
        if LOST in terms:
            timed, dropped = self._lost(shapes)
            fixed = timed[:, order]
            columns.append(dropped[:, order])
        if DIFFUSION in terms:
            columns.append(np.sqrt(2.0 * s / KILOHERTZ) * mean * i)
        if RUNG in terms:
            columns.append(s / (s + corner) * mean * i)
        if SATURATION in terms:
            columns.append(-change * self._cube[:, order])
        return np.column_stack(columns), fixed

    # --- fits

    def fit(self, terms: SweepTerms, chosen: Sequence[int] | None = None, near: SweepFit | None = None) -> SweepFit:
        """The best sizes for some of the tones, or all; `near`: a fit to begin at, whose weights are kept."""
        at = np.arange(len(self._omega)) if chosen is None else np.array(chosen, np.int64)
        if near is not None:
            return self._fitted(terms, self._best(terms, [near.shapes], near.shares, at), near.shares, at)
        return max((self._rounds(terms, shares, at) for shares in _BEGIN), key=lambda fit: fit.log_evidence)

    def _rounds(self, terms: SweepTerms, shares: tuple[float, float], at: Index) -> SweepFit:
        starts, found = self._starts(terms), list[SweepFit]()
        for _ in range(_FIT_ROUNDS):
            p = self._best(terms, starts, shares, at)
            starts = [p, *self._widths_beside(terms, p)]
            found.append(self._fitted(terms, p, shares, at))
            after = self._shares(terms, p, shares, at)
            if after == shares:
                break
            shares = after
        return max(found, key=lambda fit: fit.log_evidence)

    def _widths_beside(self, terms: SweepTerms, p: Array) -> list[Array]:
        """Shapes p with other widths, which other weights may prefer."""
        place = self._names(terms).index("width") if LOST in terms else None
        return [] if place is None else [
            np.where(np.arange(len(p)) == place, share * (len(_WIDTHS) - 1.0), p) for share in (0.3, 0.8)
        ]  # fmt: skip

    def _best(self, terms: SweepTerms, starts: Sequence[Array], shares: tuple[float, float], at: Index) -> Array:
        def left(p: Array) -> Array:
            M, y = self._weighted(terms, p, shares, at)
            return np.append(M @ _not_negative(M, y) - y, self._soft(terms, p))

        found = [_least(left, start, *self._bounds(terms)) for start in starts]
        return min(found, key=lambda least: least.cost).x

    def _names(self, terms: SweepTerms) -> list[str]:
        corner = ["corner"] if {RUNG, BESIDE} & set(terms) else []
        return ["delay", *(["dead", "width"] if LOST in terms else []), *corner]

    def _bounds(self, terms: SweepTerms) -> tuple[Array, Array]:
        all_bounds = {
            "delay": _DELAYS, "width": (0.0, len(_WIDTHS) - 1.0), "dead": (0.0, len(_DEAD_TIMES) - 1.0),
            "corner": (math.log(_CORNERS[0] * self._omega[0]), math.log(_CORNERS[1] * self._omega[-1])),
        }  # fmt: skip
        low, high = np.array([all_bounds[name] for name in self._names(terms)]).T
        return low, high

    def _starts(self, terms: SweepTerms) -> list[Array]:
        low, high = self._bounds(terms)
        places = {"delay": (0.4,), "dead": (0.25,), "width": (0.3, 0.8), "corner": (0.3, 0.6, 0.85)}
        shares = product(*(places[name] for name in self._names(terms)))
        return [low + np.array(share) * (high - low) for share in shares]

    def _sigma(self, shares: tuple[float, float], at: Index) -> tuple[Array, Array]:
        """How wrong the rows of the first harmonic are, and those of the third that is visible, V."""
        first = np.hypot(shares[0] * self.size[at], self._noise[at])
        wrong, size = self._thirds
        third = np.hypot(shares[1] * size[at], wrong[at])
        return first, third[self._with_third(at)]

    def _with_third(self, at: Index) -> NDArray[np.bool_]:
        return self.tones.visible[at, 3] & (self._thirds[1][at] > 0.0)

    def _rows(self, terms: SweepTerms, p: Array, at: Index) -> tuple[Vector, Vector]:
        """Equations of the first harmonic, then those of the third, V."""
        shapes = dict(zip(self._names(terms), p.tolist(), strict=True))
        u, seen = self.applied(shapes["delay"] * self.tones.T_s)[at], self._with_third(at)
        (M_1, lost_1), (M_3, lost_3) = (self._columns(terms, shapes, order) for order in (1, 3))
        y = np.concatenate([u[:, 1] - lost_1[at], u[seen, 3] - lost_3[at][seen]])
        return np.vstack([M_1[at], M_3[at][seen]]), y

    def _weighted(self, terms: SweepTerms, p: Array, shares: tuple[float, float], at: Index) -> tuple[Array, Array]:
        columns, u = self._rows(terms, p, at)
        sigma = np.concatenate(self._sigma(shares, at))
        M, y = columns / sigma[:, None], u / sigma
        return np.vstack([M.real, M.imag]), np.concatenate([y.real, y.imag])

    def _soft(self, terms: SweepTerms, p: Array) -> float:
        """How many times a typical width the zero crossings' width is."""
        width = dict(zip(self._names(terms), p.tolist(), strict=True)).get("width")
        return 0.0 if width is None else self._width(width) / (TYPICAL_WIDTH * self.tones.largest)

    def _shares(self, terms: SweepTerms, p: Array, shares: tuple[float, float], at: Index) -> tuple[float, float]:
        """The likeliest ones, with the degrees of freedom that the first harmonic's rows have left."""
        c = _not_negative(*self._weighted(terms, p, shares, at))
        M, y = self._rows(terms, p, at)
        e = np.abs(M @ c - y) ** 2
        free = len(c) + len(p)
        n, found = len(at), list[float]()
        for k, of in enumerate((e[:n] * 2 * n / max(2 * n - free, 1), e[n:])):
            def likely(share: float, k: int = k, of: Array = of) -> float:
                sigma = self._sigma((share, share), at)[k]
                return -float(np.sum(2.0 * np.log(sigma) + 0.5 * of / sigma**2))
            found.append(max(_SHARE_GRIDS[k].tolist(), key=likely))
        return found[0], found[1]

    def _fitted(self, terms: SweepTerms, p: Array, shares: tuple[float, float], at: Index) -> SweepFit:
        M, y = self._weighted(terms, p, shares, at)
        c = _not_negative(M, y)
        linear = ["R_s", "L_d", *(["u_drop"] if LOST in terms else []),
                  *(["R_x"] if {DIFFUSION, RUNG} & set(terms) else []), *(["b"] if SATURATION in terms else [])]
        shapes = dict(zip(self._names(terms), p.tolist(), strict=True))
        values = dict(zip(linear, c.tolist(), strict=True)) | {"delay": shapes["delay"] * self.tones.T_s}
        if LOST in terms:
            values["dead_time"] = shapes["dead"] * float(_DEAD_TIMES[1]) * self.tones.T_s
            values["u_lost"] = values["u_drop"] + values["dead_time"] * self.u_dc / self.tones.T_s
            values["zero_crossing_width"] = self._width(shapes["width"])
        if "corner" in shapes:
            values["corner"] = math.exp(shapes["corner"]) / (2.0 * math.pi)
        left = M @ c - y
        free = len(c) + len(p) + 2
        evidence = -2.0 * float(np.sum(np.log(np.concatenate(self._sigma(shares, at)))))
        evidence -= 0.5 * float(left @ left) + 0.5 * self._soft(terms, p) ** 2 + 0.5 * free * math.log(len(y))
        covariance = self._covariance(terms, p, shares, at, linear)
        fit = SweepFit(terms, values, p, covariance, np.zeros(0, np.complex128), shares, evidence)
        return replace(fit, error=self.errors(fit))

    def _covariance(
        self, terms: SweepTerms, p: Array, shares: tuple[float, float], at: Index, linear: Sequence[str]
    ) -> dict[tuple[str, str], float]:
        """Of all sizes, for rows as wrong as they are weighted."""
        M, y = self._weighted(terms, p, shares, at)
        c = _not_negative(M, y)

        def rows(q: Array) -> Array:
            A, b = self._weighted(terms, q, shares, at)
            return np.append(A @ c - b, self._soft(terms, q))

        J = np.hstack([np.vstack([M, np.zeros(len(c))]), _slopes(rows, p, *self._bounds(terms))])
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-12)
        inverse = cast(Array, np.linalg.pinv((J / scale).T @ (J / scale), rcond=1e-10)) / np.outer(scale, scale)
        shapes = dict(zip(self._names(terms), p.tolist(), strict=True))
        width, T_s = self._width(shapes.get("width", 0.0)), self.tones.T_s
        slope = {"delay": ("delay", T_s), "dead": ("dead_time", float(_DEAD_TIMES[1]) * T_s),
                 "width": ("zero_crossing_width", width * math.log(_WIDTHS[1] / _WIDTHS[0])),
                 "corner": ("corner", math.exp(shapes.get("corner", 0.0)) / (2.0 * math.pi))}  # fmt: skip
        told = [*linear, *(slope[name][0] for name in shapes)]
        by = np.diag([1.0] * len(linear) + [slope[name][1] for name in shapes])
        if LOST in terms:
            told.append("u_lost")
            by = np.vstack([by, by[told.index("u_drop")] + self.u_dc / T_s * by[told.index("dead_time")]])
        spread = by @ inverse @ by.T
        return {(a, b): float(spread[j, k]) for j, a in enumerate(told) for k, b in enumerate(told)}

    def _width(self, place: float) -> float:
        return float(np.interp(place, np.arange(len(self._widths)), self._widths))

    def _places(self, fit: SweepFit) -> dict[str, float]:
        return dict(zip(self._names(fit.terms), fit.shapes.tolist(), strict=True))

    # --- what a fit says

    def errors(self, fit: SweepFit) -> Vector:
        """What the model's equation leaves of the fundamentals, V."""
        return self._sizes(fit, 1) - self.applied(fit.values["delay"])[:, 1]

    def _sizes(self, fit: SweepFit, order: int) -> Vector:
        columns, fixed = self._columns(fit.terms, self._places(fit), order)
        names = [name for name in ("R_s", "L_d", "u_drop", "R_x", "b") if name in fit.values]
        return columns @ np.array([fit.values[name] for name in names]) + fixed

    def impedance(self, fit: SweepFit, order: int) -> Vector:
        """Volts per ampere of all but what the legs lose and what saturates."""
        kept = {name: fit.values[name] for name in ("R_s", "L_d", "R_x") if name in fit.values}
        terms = tuple(term for term in fit.terms if term in (DIFFUSION, RUNG, BESIDE))
        columns = self._columns(terms, self._places(fit), order)[0]
        return columns @ np.array(list(kept.values())) / self.tones.i[:, order]

    def third(self, fit: SweepFit) -> tuple[Vector, Vector, Array]:
        """Third harmonic of current as measured, as the rest of the model implies it, and the sensors' doubt, A."""
        u, Z = self.applied(fit.values["delay"])[:, 3], self.impedance(fit, 3)
        lost = self._sizes(fit, 3) - Z * self.tones.i[:, 3]
        return self.tones.i[:, 3], (u - lost) / Z, np.hypot(self.tones.doubt[:, 3], self.tones.noise)


class Lossy:
    """A tone's rows as periods of a bridge."""

    def __init__(self, tone: Tone, tones: Tones, L: float) -> None:
        self._tone, self._angle = tone, tones.angle
        i: Vector = 2.0 / 3.0 * (tone.i - tone.i.mean(axis=0)) @ LEGS
        later = tone.t + tones.T_s
        self._begin = i
        self._end: Vector = np.interp(later, tone.t, i.real) + 1j * np.interp(later, tone.t, i.imag)
        duties = tone.duties - 0.5 * (tone.duties.max(axis=1) + tone.duties.min(axis=1))[:, None] + 0.5
        self._legs = legs_at_rest(np.ascontiguousarray(tone.u_dc), np.ascontiguousarray(duties), tones.T_s, L)

    def lost(self, dead_time: float, u_drop: float, width: float) -> Vector:
        """Harmonics of what the legs lose along the axis, V."""
        volts = lost_between(self._legs, self._begin, self._end, dead_time, u_drop, width, width)
        return harmonics(self._tone, (volts * np.exp(-1j * self._angle)).real)


def _not_negative(M: Array, y: Array) -> Array:
    """The coefficients of M's columns, none of them negative, that leave least of y."""
    from scipy import optimize

    scale = np.linalg.norm(M, axis=0) + 1e-300
    return cast(Callable[..., tuple[Array, float]], optimize.nnls)(M / scale, y, maxiter=1000)[0] / scale


class _Least(Protocol):
    x: Array  # where a sum of squares is least
    cost: float  # half of it


def _least(f: Callable[[Array], Array], p: Array, low: Array, high: Array) -> _Least:
    """From p on, by the rectangular trust regions of scipy's `dogbox`, which ends on a bound where it meets one."""
    from scipy import optimize

    return cast(Callable[..., _Least], optimize.least_squares)(
        f, p, partial(_slopes, f, low=low, high=high), (low, high), "dogbox", ftol=1e-8, max_nfev=_MOST_STEPS
    )


def _slopes(f: Callable[[Array], Array], p: Array, low: Array, high: Array) -> Array:
    """Derivatives by each shape, by forward differences, or backward ones at the upper bounds."""
    from scipy import optimize

    step = _SHAPE_STEP * (high - low)
    return cast(Callable[..., Array], optimize.approx_fprime)(p, f, np.where(p + step > high, -step, step))


@cache
def _curve(count: int) -> Callable[[float], Array]:
    """Of equidistant nodes, for a smooth curve through them: E. Catmull, R. Rom, 1974; straight at the ends."""
    from scipy.interpolate import CubicHermiteSpline

    nodes = np.eye(count)
    return CubicHermiteSpline(np.arange(count), nodes, np.gradient(nodes, axis=0))
