"""Rows that skip control periods: one row in ten, say, each the values of one control period and not means over many.

What happens between such rows is not recorded, so no flux balance joins them. Each row has an equation of its own,

    u = R_s i + L di/dt + j s psi(i)          i, di/dt in the middle of the period in which the voltage u acts

where i and di/dt are those of a polynomial through neighbouring rows, T_s/2 after the sample, and s, h as in
`flux_balance`. Rows next to a step, which no polynomial follows, are left out: levels are cut out of what moves.

* Noise of the currents is in the regressors, and a current control answers it by the voltage of the same row. So the
  rows are weighed by an instrument, the currents of rows that the polynomial does not go through, whose noise is
  another one: sum(z x') beta = sum(z u).
* What happens between rows is measured and not assumed: the standard errors are those of the sums of whole stretches of
  rows, however noise and movement in them hang together, and what a polynomial of higher degree changes is added.
* Whether currents move faster than rows come is seen by how much of a current the instrument still has.
* What is left is held against voltages that it may look like: those of a bridge's losses, of what is not constant, of
  phases that are unequal. What of it is small beside the voltage is in the standard errors.

Instrumental variables: T. Soderstrom, P. Stoica, Instrumental Variable Methods for System Identification, Springer,
1983. Standard errors by stretches: R. Ibragimov, U. Mueller, t-statistic based correlation and heterogeneity robust
inference, Journal of Business and Economic Statistics 28, 2010, doi 10.1198/jbes.2009.08046. Knows nothing of files.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Bools, Vector
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, UNITS
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.online.solve import at_held, check_held, plausible
from estimator.samples import Samples, is_integral_of_speed, turned_angle

_SLOPES: Final = (
    ((1, 1.0 / 2.0),), ((1, 2.0 / 3.0), (2, -1.0 / 12.0)), ((1, 3.0 / 4.0), (2, -3.0 / 20.0), (3, 1.0 / 60.0)),
)
"""Weights of i[k+n] - i[k-n], over T: the slope of a polynomial of degree 2, 4, 6."""
_BENDS: Final = (
    ((0, -1.0), (1, 1.0)), ((0, -5.0 / 4.0), (1, 4.0 / 3.0), (2, -1.0 / 12.0)),
    ((0, -49.0 / 36.0), (1, 3.0 / 2.0), (2, -3.0 / 20.0), (3, 1.0 / 90.0)),
)
"""Weights of i[k+n] + i[k-n], over T^2: its second derivative."""
_DEGREES: Final = len(_SLOPES)
_PIECE: Final = 1024  # rows, of which the noise is looked at together
_STEP: Final = 4.0  # standard deviations of noise, beyond which a row is next to a step
_MOST_STRETCHES: Final = 80  # of rows, that are summed apart
_FEWEST: Final = 100  # rows in use, of fewer nothing is said
_FEWEST_STRETCHES: Final = 8
_FEW_STRETCHES: Final = 16  # and up to twice as many that standard errors are of: what moves slowly is within one
_UNLIKE_L_Q: Final = 0.5  # of L_q, standard deviation of an L_d that is not told
_FORM: Final = 1e-3  # of a value, standard deviation of what a bridge's ripple and an angle's rounding do to it
_SMALL_TERM_ROUNDS: Final = 3
_PERSISTS: Final = 0.98  # of a current's variance, that the instrument has, where the current tells its inductance
_WELL_TOLD: Final = 0.25  # of a value, half its 95 % interval
_LAGS: Final = tuple(range(7, 31))  # rows, over which noise hangs together no more
_HINTED: Final = 4.0  # the same, from which on it is in the standard errors
_SURE: Final = 6.0  # standard deviations of noise, by which what is left hangs together
_MATTERS: Final = 1e-3  # of the voltage, rms: less does not
_COLUMNS: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
_OFFSET: Final = 4  # columns of an equation: R_s, L_d, L_q, psi_f, psi_f times an angle that is read low,
_LAG: Final = 5  # psi_f times the time by which a speed lags that is all there is of the angle;
_UNKNOWN: Final = 6
_H: Final = 6  # the place of h, what bows the current within a period on d and on q,
_BOWS: Final = 7
_U: Final = 9  # the voltage
_SIZE: Final = 10
_TESTS: Final = 18  # instruments that the equations have no need of: what is left of them shows by these


_Value = TypeVar("_Value", np.complex128, np.float64, np.bool_)


@dataclass(slots=True, eq=False)
class _Sums:
    """Sums of stretches of rows, for polynomials of one degree."""

    by_z: list[Array] = field(default_factory=list[Array])  # (6, 10) each: sum of z (x, h, u)'
    rows: list[int] = field(default_factory=list[int])
    squares: Array = field(default_factory=lambda: np.zeros((2, _SIZE, _SIZE)))  # by axis: of equations, and
    lagged: Array = field(default_factory=lambda: np.zeros((2, _SIZE, _SIZE)))  # of those some rows apart
    pairs: int = 0  # of those
    by_test: list[Array] = field(default_factory=list[Array])  # (18, 10) each: sum of tests (x, h, bows, u)'
    tests: Array = field(default_factory=lambda: np.zeros(_TESTS))  # sums of their squares
    currents: Array = field(default_factory=lambda: np.zeros((2, 6)))  # by axis: 1, i, z, i^2, z^2, i z

    @property
    def enough(self) -> bool:
        """Rows to say something."""
        return sum(self.rows) >= _FEWEST and len(self.rows) >= _FEWEST_STRETCHES

    @property
    def mean_i_d(self) -> float:
        """A."""
        return float(self.currents[0, 1] / max(self.currents[0, 0], 1.0))

    def add(self, by_z: Array, by_test: Array, rows: int) -> None:
        """A stretch more; many become half as many, twice as long."""
        self.by_z.append(by_z)
        self.by_test.append(by_test)
        self.rows.append(rows)
        if len(self.rows) > _MOST_STRETCHES:
            self.by_z = [a + b for a, b in zip(self.by_z[:-1:2], self.by_z[1::2], strict=True)] + self.by_z[-1:]
            both = zip(self.by_test[:-1:2], self.by_test[1::2], strict=True)
            self.by_test = [a + b for a, b in both] + self.by_test[-1:]
            self.rows = [a + b for a, b in zip(self.rows[:-1:2], self.rows[1::2], strict=True)] + self.rows[-1:]


@dataclass(slots=True, eq=False)
class SkippingState:
    """What the rows so far say; `update` changes it in place and returns it."""

    T_s: float  # s, control period
    q_only: bool = False
    waiting: list[Samples] = field(default_factory=list[Samples])  # of the run that is not summed yet
    sums: tuple[_Sums, ...] = field(default_factory=lambda: tuple(_Sums() for _ in range(_DEGREES)))
    samples: int = 0
    summed: int = 0  # of these
    gaps: int = 0
    T: float = 0.0  # s, from row to row
    by_speed: bool = True  # there is no other angle than the integral of the speed


@dataclass(frozen=True, slots=True)
class Skipping:
    """What the rows say, and whether it explains them."""

    result: WindowEstimate
    used: int  # rows, not next to a step
    degree: int  # of the polynomials; 0: none
    persistent_V: float  # rms, of what is left that hangs together over more rows than noise does, or has a form
    significance: float  # of it, in standard deviations of noise
    least_V: float  # from which it matters

    @property
    def mismatch(self) -> bool:
        """More than noise is left, and enough to matter."""
        return self.significance > _SURE and self.persistent_V > self.least_V


def init(T_s: float) -> SkippingState:
    """Nothing yet. T_s: s, control period."""
    return SkippingState(T_s)


def update(state: SkippingState, samples: Samples, *, joined: bool = True) -> SkippingState:
    """Take in rows, `samples.T` apart. `joined`: the first of them follows the last one taken in."""
    if not joined and state.samples:
        finish(state)
        state.gaps += 1
    state.q_only, state.T = samples.q_only, samples.T
    state.by_speed &= is_integral_of_speed(samples)
    state.samples += len(samples)
    state.waiting.append(samples)
    while sum(map(len, state.waiting)) >= 2 * _PIECE:
        run = _joined(state.waiting)
        _sum(state, run[: _PIECE + 2 * _DEGREES])
        state.waiting = [run[_PIECE:]]
    return state


def finish(state: SkippingState) -> SkippingState:
    """The run ends: sum what waits."""
    if state.waiting:
        _sum(state, _joined(state.waiting))
        state.waiting = []
    return state


def _joined(parts: Sequence[Samples]) -> Samples:
    """Of a run, what an equation takes."""
    one = parts[0]
    if len(parts) == 1:
        return one
    theta_e, omega_e, i_d, i_q, u_d, u_q = (
        np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS
    )
    return Samples(theta_e, omega_e, i_d, i_q, u_d, u_q, one.T_s, one.periods, q_only=one.q_only)


def _sum(state: SkippingState, run: Samples) -> None:
    """Add a piece's equations to the sums; each degree leaves out as many rows at either end."""
    if len(run) < 2 * _DEGREES:
        return
    i, u = run.i_d + 1j * run.i_q, run.u_d + 1j * run.u_q
    turned = turned_angle(run.theta_e, run.omega_e, state.T)
    theta = np.concatenate(([0.0], np.cumsum(turned)))
    steady = _steady(i, u, q_only=state.q_only)
    for degree, sums in enumerate(state.sums, 1):
        ends = degree + 1
        if len(theta) <= 2 * ends:
            continue
        good = np.ones(len(theta) - 2 * ends, np.bool_)
        for n in range(-degree, degree + 1):
            good &= _moved(steady, n, ends)
        x, z = _equations(i, u, theta, degree, state.T, state.T_s)
        far = 0.5 * (_moved(i, ends, ends) + _moved(i, -ends, ends))
        t: Array = state.T * (state.summed + np.arange(ends, len(theta) - ends, dtype=np.float64))
        tests = _tests(far, z[1, 3], _moved(run.theta_e, 0, ends), t)
        if len(theta) > _PIECE:  # each row once, whatever the degree leaves out
            good[_PIECE:] = False
            good[: _DEGREES - degree] = False
        _add(sums, x, z, tests, good, q_only=state.q_only)
    state.summed += min(len(run), _PIECE)


def _moved(column: NDArray[_Value], n: int, ends: int) -> NDArray[_Value]:
    return column[ends + n : len(column) - ends + n]


def _steady(i: Vector, u: Vector, *, q_only: bool) -> Bools:
    """Of each row, whether currents and voltages go on from it to both sides as noise and slow changes have them."""
    steady = np.zeros(len(i), np.bool_)
    steady[1:-1] = True
    for x in (i.imag, u.imag) if q_only else (i.real, i.imag, u.real, u.imag):
        bent = np.abs(x[2:] - 2.0 * x[1:-1] + x[:-2])
        moved = bent[bent > 0.0]
        if len(moved):
            steady[1:-1] &= bent <= max(_STEP * float(np.median(bent)) / 0.6744898, 2.0 * float(moved.min()))
    return steady


def _equations(i: Vector, u: Vector, theta: Array, degree: int, T: float, T_s: float) -> tuple[Array, Array]:
    """Columns (2, 10, n), by axis, see `_OFFSET`, and instruments (2, 6, n)."""
    ends, after = degree + 1, 0.5 * T_s
    here = _moved(i, 0, ends)
    slope, bend = _derivatives(i, degree, T)
    speed, acceleration = _derivatives(theta.astype(np.complex128), degree, T)
    omega: Array = speed.real + after * acceleration.real
    far, back = _moved(i, ends, ends), _moved(i, -ends, ends)
    omega_z = (_moved(theta, ends, ends) - _moved(theta, -ends, ends)) / (2.0 * ends * T)
    x = _of_currents(here + after * slope, slope + after * bend, omega, T_s)
    z = np.zeros((2, _UNKNOWN, len(omega)))
    z[:, :_LAG] = _of_currents(0.5 * (far + back), (far - back) / (2.0 * ends * T), omega_z, T_s)
    ahead, now, behind = (_moved(theta, n, ends) for n in (ends, 0, -ends))
    z[1, _LAG] = (ahead - 2.0 * now + behind) / (ends * T) ** 2
    v = _moved(u, 0, ends)
    whole = np.zeros((2, _SIZE, len(omega)))
    whole[:, :_LAG] = x
    whole[1, _LAG] = acceleration.real
    whole[0, _H] = (omega * T_s) ** 2 / 12.0
    for axis in (0, 1):
        whole[axis, _BOWS + axis] = x[axis, 1] + x[axis, 2]
    whole[0, _U], whole[1, _U] = v.real, v.imag
    return whole, z


def _tests(i: Vector, omega: Array, theta: Array, t: Array) -> Vector:
    """Voltages that what is left may look like, (18, n), of currents some rows off: a bridge's losses, resistances and
    flux linkages that are not constant, in current or in time, phases or sensors that are unequal, losses of the iron.
    """
    legs = np.exp(1j * (math.tau / 3.0) * np.arange(3))
    there, back = np.exp(1j * theta), np.exp(-1j * theta)
    lost = (legs[:, None] * np.sign((i * there * legs.conj()[:, None]).real)).sum(axis=0) * back
    turned, hum = i.conj() * back**2, there**6
    d, q = i.real.astype(np.complex128), i.imag.astype(np.complex128)
    found: Vector = np.array([
        lost, 1j * lost, i * np.abs(i), i * t, 1j * omega * t, 1j * omega * d * np.abs(d), 1j * omega * d**2,
        omega * q * np.abs(q), 1j * omega * q**2, 1j * omega * d * np.abs(q), turned, 1j * turned, omega * turned,
        1j * omega * turned, back, 1j * back, omega * hum, 1j * omega * np.abs(omega),
    ], np.complex128)  # fmt: skip
    return found


def _derivatives(x: Vector, degree: int, T: float) -> tuple[Vector, Vector]:
    """Of the polynomials through rows, at each that has enough on either side: the first and the second, per s."""
    ends = degree + 1
    first: Vector = np.zeros(len(x) - 2 * ends, np.complex128)
    second: Vector = np.zeros_like(first)
    for n, weight in _SLOPES[degree - 1]:
        first += weight / T * (_moved(x, n, ends) - _moved(x, -n, ends))
    for n, weight in _BENDS[degree - 1]:
        second += weight / T**2 * (_moved(x, n, ends) + _moved(x, -n, ends))
    return first, second


def _of_currents(i: Vector, slope: Vector, omega: Array, T_s: float) -> Array:
    """What multiplies R_s, L_d, L_q, psi_f and psi_f times an angle read low, by axis (2, 5, n): see `flux_balance`."""
    D = omega * T_s
    s, cos = 2.0 / T_s * np.sin(0.5 * D), np.cos(0.5 * D)
    mean = i * (1.0 - D**2 / 8.0) + 0.25j * D * T_s * slope
    none = np.zeros(len(omega))
    return np.array([
        [mean.real, cos * slope.real, -s * i.imag, none, s], [mean.imag, s * i.real, cos * slope.imag, s, none],
    ])  # fmt: skip


def _add(sums: _Sums, x: Array, z: Array, tests: Vector, good: Bools, *, q_only: bool) -> None:
    axes = [1] if q_only else [0, 1]
    for axis in axes:
        kept = np.where(good, x[axis], 0.0)
        sums.squares[axis] += kept @ kept.T
        for lag in _LAGS:
            sums.lagged[axis] += kept[:, :-lag] @ kept[:, lag:].T
    sums.pairs += sum(int(np.count_nonzero(good[:-lag] & good[lag:])) for lag in _LAGS)
    w: Array = np.array([tests.real, tests.imag])
    sums.tests += np.sum(w[axes][..., good] ** 2, axis=(0, 2))
    for axis, (here, there) in enumerate(((x[0, 0], z[0, 0]), (x[1, 0], z[1, 0]))):
        a, b = here[good], there[good]
        sums.currents[axis] += [len(a), a.sum(), b.sum(), a @ a, b @ b, a @ b]
    places = np.flatnonzero(good)
    parts = max(1, min(len(places) // _FEWEST_STRETCHES, 8))
    for part in np.array_split(places, parts):
        if len(part):
            by = [np.einsum("apn,aqn->pq", each[axes][..., part], x[axes][..., part]) for each in (z, w)]
            sums.add(by[0], by[1], len(part))


# --- What they say


def estimate(
    state: SkippingState, estimated: Sequence[str] = PARAMETERS, held: Mapping[str, float] | None = None
) -> Skipping:
    """What the rows say of `estimated`, the others at their `held` values (SI). The run that waits is not in it."""
    held = held or {}
    check_held(estimated, held)
    enough = [n for n, sums in enumerate(state.sums) if sums.enough]
    if not enough:
        return _nothing(state, estimated, held)
    best = 1 if 1 in enough else enough[0]
    sums = state.sums[best]
    no_i_d = state.q_only and sums.squares[1][1, 1] == 0.0
    asked = [k for k, name in enumerate(PARAMETERS) if name in estimated and not (no_i_d and name == "L_d")]
    fast = _too_fast(sums, state.T, asked)
    more = (*(() if state.q_only else (_OFFSET,)), *((_LAG,) if state.by_speed else ()))
    fits = {n: fit for n in enough if (fit := _fit(state.sums[n], state.T_s, [*asked, *more], held)) is not None}
    if best not in fits:
        return _nothing(state, estimated, held)
    fit = fits[best]
    others = [fits[n] for n in (best + 1, best - 1) if n in fits]
    apart = np.abs(others[0].beta - fit.beta) if others else np.full(_UNKNOWN, math.inf)
    left = _left(sums, fit, state.T_s)
    hidden = max((one.rms for one in left if one.significance > _HINTED), default=0.0)
    std = np.sqrt(fit.std**2 + apart**2 + (_FORM * fit.beta) ** 2 + (hidden * fit.by_volts) ** 2)
    if 1 in fast:  # what does not move is one with psi_f
        std[3] = math.hypot(std[3], _UNLIKE_L_Q * fit.beta[2] * abs(sums.mean_i_d))
    estimates: dict[str, Estimate] = {}
    for k, name in enumerate(PARAMETERS):
        if k not in asked:
            estimates[name] = at_held(name, held) if name in held else _not_asked(name)
        elif reason := fast.get(k) or _untold(k, fit.beta, std):
            estimates[name] = Estimate(name, held.get(name), None, UNITS[name], Status.NOT_TOLD, reason)
        else:
            estimates[name] = Estimate(name, float(fit.beta[k]), float(std[k]), UNITS[name], Status.OK)
    rows = sum(sums.rows)
    impossible = tuple(
        name for k, name in enumerate(PARAMETERS)
        if estimates[name].status is Status.OK and not plausible(k, float(fit.beta[k]))
    )
    equations, volts = rows if state.q_only else 2 * rows, sums.squares[:, _U, _U].sum()
    weights = np.concatenate((-fit.beta, _within(fit.beta, state.T_s)))
    residual = math.sqrt(max(float((weights @ sums.squares @ weights).sum()), 0.0) / equations)
    result = WindowEstimate(
        estimates, state.samples, state.gaps, equations, filled=True, condition=None, residual_rms=residual,
        impossible=impossible,
    )
    least = _MATTERS * math.sqrt(float(volts) / rows)
    worst = max(left, key=lambda one: min(one.significance / _SURE, one.rms / max(least, 1e-300)))
    return Skipping(result, rows, 2 * (best + 1), worst.rms, worst.significance, least)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    beta: Array  # (6,), SI
    std: Array  # (6,), 0 where held, infinite where it acts nowhere
    by_volts: Array  # (6,), 1/V: by how much a voltage may move each, rms, wherever it acts
    free: list[int]  # those that are fitted


def _fit(sums: _Sums, T_s: float, asked: Sequence[int], held: Mapping[str, float]) -> _Fit | None:
    """By instruments; None where nothing tells a parameter from the others. What acts nowhere is left out."""
    free = [k for k in asked if sums.squares[:, k, k].sum() > 0.0]
    each = np.array(sums.by_z)
    while len(each) >= 2 * _FEW_STRETCHES:
        odd = each[len(each) // 2 * 2 :]
        each = each[: len(each) // 2 * 2].reshape(-1, 2, *each.shape[1:]).sum(axis=1)
        each[-1] += odd.sum(axis=0)
    each = each[:, free]
    beta = np.array([*(held.get(name, 0.0) for name in PARAMETERS), 0.0, 0.0])
    scale = np.sqrt(np.maximum(np.abs(np.diag(each.sum(axis=0)[:, free])), 1e-300))
    whole = each[:, :, free] / scale
    gram = whole.sum(axis=0)
    if not np.linalg.cond(gram / scale[:, None]) < 1.0 / np.finfo(np.float64).eps:
        return None
    inverse: Array = np.array(np.linalg.inv(gram), np.float64)
    others = [k for k in range(_UNKNOWN) if k not in asked]
    target: Array = np.zeros(each.shape[:2])
    for _ in range(_SMALL_TERM_ROUNDS):
        target = each[:, :, _H:] @ _within(beta, T_s) - each[:, :, others] @ beta[others]
        beta[free] = inverse @ target.sum(axis=0) / scale
    off: Array = target - each[:, :, free] @ beta[free]
    std = np.full(_UNKNOWN, math.inf)
    std[others] = 0.0
    std[free] = np.sqrt(np.sum((off @ inverse.T) ** 2, axis=0)) / scale
    freedom = max(len(off) - len(free), 1)
    std *= math.sqrt(len(off) / freedom) * (1.0 + 0.25 * (Z_95**2 + 1.0) / freedom)
    by_volts = np.zeros(_UNKNOWN)
    squares: Array = sums.squares.sum(axis=0)[np.ix_(free, free)]
    size = np.sqrt(np.diag(squares))
    spread = np.diag(np.linalg.pinv(squares / np.outer(size, size), hermitian=True))
    by_volts[free] = np.sqrt(np.maximum(spread, 0.0) * sum(sums.rows)) / size
    return _Fit(beta, std, by_volts, free)


def _within(beta: Array, T_s: float) -> Array:
    """What multiplies the place of h, the bows of the current within a period, and the voltage: see `flux_balance`."""
    R_s, L_d, L_q, psi_f = np.maximum(beta[:_OFFSET], 0.0).tolist()
    of_h = R_s * psi_f / L_d if L_d > 0.0 else 0.0
    return np.array([of_h, *(-(R_s * T_s) ** 2 / (12.0 * L) if L > 0.0 else 0.0 for L in (L_d, L_q)), 1.0])


def _too_fast(sums: _Sums, T: float, asked: Sequence[int]) -> dict[int, str]:
    """Parameters whose currents move faster than rows come, or do not stand out of their noise, each with a sentence.

    Of a current's variance, the instrument, some rows off, has to have nearly all.
    """
    shares, moves = list[float](), list[float]()
    for n, a, b, aa, bb, ab in sums.currents.tolist():
        var_a, var_b, both = aa - a * a / n, bb - b * b / n, ab - a * b / n
        shares.append(both * abs(both) / (var_a * var_b) if var_a > 0.0 and var_b > 0.0 else 0.0)
        moves.append(var_a)
    larger = 1 if moves[1] >= moves[0] else 0
    found: dict[int, str] = {}
    for k, axis in ((0, larger), (1, 0), (2, 1)):
        if k in asked and shares[axis] < _PERSISTS:
            found[k] = (
                f"{PARAMETERS[k]} cannot be told here: {('i_d', 'i_q')[axis]} does not stand out of its noise, or "
                f"moves faster than rows come, every {1e3 * T:g} ms: of its variance "
                f"{min(1.0 - shares[axis], 1.0):.0%} is gone a few rows on"
            )
    return found


def _untold(k: int, beta: Array, std: Array) -> str:
    """Why a parameter is not told, a sentence; empty where it is."""
    value, half = float(beta[k]), Z_95 * float(std[k])
    if not math.isfinite(half):
        return f"{PARAMETERS[k]} cannot be told here: it acts nowhere, as in a motor that stands still"
    if value < -half:
        return f"{PARAMETERS[k]} comes out negative, {value:.3g} {UNITS[PARAMETERS[k]]}: a sign is wrong, or an axis"
    if half < _WELL_TOLD * abs(value) and value > 0.0:
        return ""
    return f"{PARAMETERS[k]} cannot be told here: no closer than {value:.3g} +- {half:.2g} {UNITS[PARAMETERS[k]]}"


class _Left(NamedTuple):
    """A part of what is left, that noise does not make."""

    rms: float  # V
    significance: float  # in standard deviations of noise


def _left(sums: _Sums, fit: _Fit, T_s: float) -> list[_Left]:
    """What is left that hangs together over more rows than noise does, on an axis, and what looks like one of `_tests`.

    Of a test, what the parameters make of it is taken off; its noise is that of stretches of rows.
    """
    weights = np.concatenate((-fit.beta, _within(fit.beta, T_s)))
    rows, pairs = max(sum(sums.rows), 1), max(sums.pairs, 1)
    power = np.maximum(weights @ sums.squares @ weights / rows, 1e-300)  # by axis, V^2
    together = np.maximum(weights @ sums.lagged @ weights / pairs, 0.0)  # an angle's rounding has either sign
    found = [
        _Left(math.sqrt(volts2), sigmas)
        for volts2, sigmas in zip(together.tolist(), (together / power * math.sqrt(pairs)).tolist(), strict=True)
    ]
    by_z, by_test = np.array(sums.by_z)[:, fit.free], np.array(sums.by_test)
    inverse: Array = np.array(np.linalg.pinv(by_z.sum(axis=0)[:, fit.free]), np.float64)
    taken: Array = by_test.sum(axis=0)[:, fit.free] @ inverse
    each: Array = by_test @ weights - (by_z @ weights) @ taken.T
    whole, spread = np.abs(each.sum(axis=0)), np.std(each, axis=0, ddof=1) * math.sqrt(len(each))
    size = np.sqrt(np.maximum(sums.tests, 1e-300) * rows)
    return found + [
        _Left(float(a), float(b)) for a, b in zip(whole / size, whole / np.maximum(spread, 1e-300), strict=True)
    ]


def _nothing(state: SkippingState, estimated: Sequence[str], held: Mapping[str, float]) -> Skipping:
    rows = max(sum(sums.rows) for sums in state.sums)
    reason = f"{rows} rows that are not next to a step are too few, or tell no parameter from another"
    estimates = {
        name: Estimate(name, None, None, UNITS[name], Status.NO_DATA, reason) if name in estimated
        else at_held(name, held)
        for name in PARAMETERS
    }
    result = WindowEstimate(
        estimates, state.samples, state.gaps, 0, filled=False, condition=None, residual_rms=None
    )
    return Skipping(result, 0, 0, 0.0, 0.0, 0.0)


def _not_asked(name: str) -> Estimate:
    return Estimate(name, None, None, UNITS[name], Status.NOT_TOLD, "not asked for: no i_d, u_d")
