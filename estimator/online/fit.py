"""From the sums of windows to numbers: least squares, its second-order terms, its noise, its standard errors.

The rows are those of `flux_balance`, on the d and the q axis. Nothing of a window but its `WindowSums` is needed, so a
solution costs the same for any length, and many windows are solved at once.

The equations are linear but for small terms of the mean current (see `flux_balance`), which are iterated:

    u_d = ... - R_s psi_f/L_d h + b_d (x_d - y_q)        b = (R_s T_s)^2 / (12 L), d and q axis
    u_q = ...                   + b_q (x_q + y_d)

Current noise sits inside the regressors (errors in variables) and would read inductances low. What it adds to the
normal matrix is estimated from the residual's colour and taken out (bias-eliminating least squares; survey:
T. Soederstroem, Errors-in-variables methods in system identification, Automatica 43, 2007,
doi 10.1016/j.automatica.2006.11.025). Standard errors are of sandwich form with a residual that is coloured the way
differenced noise is: correlated between neighbouring rows, and not further. That colour is itself an estimate, and a
poor one where the two lags nearly cancel: its variance is Bartlett's (M. S. Bartlett, On the theoretical specification
and sampling properties of autocorrelated time-series, Supplement to the JRSS 8, 1946, doi 10.2307/2983611), and
standard errors are widened from the normal to Student's distribution of as many degrees of freedom (F. E.
Satterthwaite, An approximate distribution of estimates of variance components, Biometrics Bulletin 2, 1946,
doi 10.2307/3002019), so that 1.96 of them hold the truth 95 times in 100.

Errors that noise does not average away are added as if they were one constant voltage over the window: what the
equations themselves leave out (`MODEL`, measured against a simulation), the resolution of the records, where the
noise is too small to dither it, and the step of the angle's sensor. Knows nothing of streams or of words.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.interval import Z_95
from estimator.machine import PARAMETERS
from estimator.online.excitation import Excitation, condition, excitation
from estimator.online.sums import SIZE, H, U, WindowSums

NOISE_DOUBT: Final = 0.1  # the bias that current noise leaves is known to within this share of it, at best
NOISE_ECHO: Final = 10.0  # and that share grows by so much times the bias over the value
PRIOR_SHARE: Final = 0.05  # of a value that is told, at most, rests on priors
FAINT_I: Final = 1e-9  # A, and
FAINT_SPEED: Final = 1e-6  # rad/s: what is smaller is arithmetic, not a signal
MODEL: Final = 1e-6  # share of the rms voltage that the flux balance, exact to second order, may be off,
MODEL_MOVING: Final = 3e-5  # times the relative spread of speed^2, more where it changes within a row,
MODEL_TURN: Final = 8e-4  # and, times D^3, more where the rotor turns far within a control period
I_D: Final = 0.01  # of i_q, rms: standard deviation of an i_d that is not recorded and taken for zero
SHARED: Final = 50.0  # rows: a stretch's own residual counts against that of all stretches as its rows against these
_PRIOR_LEAST: Final = 1e-5  # of the voltage, that a prior leaves open: with less, arithmetic loses what is wide
_SMALL_TERM_ROUNDS: Final = 4  # of the iteration of the small terms; each gains three digits
_OPEN_COLOUR: Final = 48.0  # pairs, that tell as much as is known before: from 0 to -1/2, with a variance of 1/48
_FEWEST_FREEDOM: Final = 4.0  # of a variance: below, the correction knows no more than the error
_BATCHES: Final = 8.0  # that a reference takes at least


@dataclass(frozen=True, slots=True, eq=False)
class WindowFit:
    """Solutions of K windows for p of the parameters, the others held."""

    free: list[int]  # places of the p parameters in PARAMETERS
    beta: Array  # (K, 4), SI; told and held values; what is not told is as good as its prior
    std: Array  # (K, 4), standard errors; 0 where held
    lasting: Array  # (K, 4), of these, what more rows of the same kind would not average away
    told: NDArray[np.bool_]  # (K, 4): by the window, and to less than its own size
    weak: Array  # (K, p, p), see `Excitation`
    condition: Array  # (K,)
    residual_rms: Array  # (K,), V
    noise: Array  # (K, 2), A^2: variance of a row's mean current, d and q axis


def fit_windows(
    sums: WindowSums, estimated: Sequence[str], held: Mapping[str, float], *, noise_aware: bool = True,
    together: bool = False,
) -> WindowFit:
    """Least-squares solutions for `estimated`, the others at their `held` values (SI).

    `noise_aware` takes the energy of current noise out of the normal matrix; without it the result is plain least
    squares, and the bias is added to the standard errors instead. `together`: the windows are stretches of one stream,
    too short for each to know current noise or the colour of its residual, and share both. Windows with fewer equations
    than parameters tell nothing.

    How large the noise is, two references say, of which the larger counts: plain least squares over the rows, which
    sees every transient, and over weighted batches of rows, in which differenced noise cancels and hardly biases. It
    never rests on what the noise made of the solution.
    """
    task = _task(sums, estimated, held, noise_aware=noise_aware, together=together)
    small = np.zeros((len(sums.rows), 3))
    found = _round_solved(sums, task, small)
    for _ in range(_SMALL_TERM_ROUNDS - 1):
        small = _second_order(_known_parameters(found.beta, found.sure, task.stand_in), sums.T_s)
        if sums.q_only:
            small[:, :2] = 0.0  # h and b_d are of the d axis
        found = _round_solved(sums, task, small)

    free, beta = task.free, found.beta
    variance, constant, rss = _variance(
        sums, _axis_coefficients(found.full, small), free, found.inverse, found.sigma2, together=together
    )
    bias = _times(found.inverse, found.noise * beta[:, free])
    bias *= _share_of_bias(sums, bias, beta[:, free], found.apart) if noise_aware else 1.0
    std, lasting = np.zeros_like(beta), np.zeros_like(beta)
    lasting[:, free] = np.sqrt(constant + found.doubt**2 + bias**2)
    std[:, free] = np.sqrt(variance + lasting[:, free] ** 2)
    sure = found.sure & (Z_95 * std < np.abs(beta))
    of_h = sums.lag0[:, 0, free, H] * _doubt_of_h(sums, beta, std, sure, task.stand_in)[:, None]
    of_h = _times(found.inverse, of_h)
    std[:, free], lasting[:, free] = np.hypot(std[:, free], of_h), np.hypot(lasting[:, free], of_h)
    rows = np.maximum(sums.rows, 1.0)
    return WindowFit(
        free, beta, std, lasting, sure & (Z_95 * std < np.abs(beta)) & task.enough[:, None], found.ex.weak,
        condition(task.G), np.sqrt(rss / (sums.axes * rows)), found.sigma2 / float(sums.periods),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What is the same in every round."""

    free: list[int]
    known: Array  # (K, 4), held values, 0 for free ones
    stand_in: Array  # (4,), held values of all
    enough: NDArray[np.bool_]  # (K,), more equations than parameters
    G: Array  # (K, p, p), normal matrices of the rows,
    plain: Array  # and their inverses, as far as arithmetic goes
    calm: Array  # (K, 2, 6, 6), the sums of batches, of rows where those are few
    plain_calm: Array  # (K, p, p), inverses of their normal matrices
    noise_aware: bool
    together: bool  # windows of one stream, with one noise


@dataclass(frozen=True, slots=True, eq=False)
class _Round:
    """What comes of one round."""

    beta: Array  # (K, 4)
    full: Array  # (K, 4), the same with directions that are not told as plain least squares has them
    sure: NDArray[np.bool_]  # (K, 4), hardly rests on priors
    doubt: Array  # (K, p), standard error by priors
    inverse: Array  # (K, p, p)
    ex: Excitation
    sigma2: Array  # (K, 2), A^2, of a sampled current
    apart: Array  # (K,), what two estimates of it disagree about, as a share
    noise: Array  # (K, p), energy that it gives to each regressor


def _task(
    sums: WindowSums, estimated: Sequence[str], held: Mapping[str, float], *, noise_aware: bool, together: bool
) -> _Task:
    free = [PARAMETERS.index(name) for name in PARAMETERS if name in estimated]
    enough = sums.axes * sums.rows > len(free)
    stand_in = np.array([held.get(name, 0.0) for name in PARAMETERS])
    known = stand_in.copy()
    known[free] = 0.0
    calm = np.where((enough & (sums.batches >= _BATCHES))[:, None, None, None], sums.batch, sums.lag0)
    both_axes = (S.sum(axis=1)[:, free][:, :, free] for S in (sums.lag0, calm))
    G, G_calm = (np.where(enough[:, None, None], S, 0.0) for S in both_axes)
    return _Task(
        free, np.tile(known, (len(enough), 1)), stand_in, enough, G, _plain(G), calm, _plain(G_calm),
        noise_aware, together,
    )


def _round_solved(sums: WindowSums, task: _Task, small: Array) -> _Round:
    """A round, for given coefficients of the small terms (K, 3)."""
    free, c_0 = task.free, _axis_coefficients(task.known, small)
    rest = _times(sums.lag0, c_0).sum(axis=1)[:, free]
    by_rows, by_batches = task.known.copy(), task.known.copy()
    by_rows[:, free] = -_times(task.plain, rest)
    by_batches[:, free] = -_times(task.plain_calm, _times(task.calm, c_0).sum(axis=1)[:, free])
    one, other = (
        _current_noise(sums, reference, _axis_coefficients(reference, small)) for reference in (by_rows, by_batches)
    )
    if task.together:
        rows = np.maximum(sums.rows, 1.0)
        one, other = (np.tile(np.average(each, axis=0, weights=rows), (len(rows), 1)) for each in (one, other))
    sigma2 = np.maximum(one, other)
    noise = _regressor_noise(sums, sigma2)[:, free]
    ex = excitation(task.G, noise)
    inverse = ex.inverse if task.noise_aware else task.plain
    strong = -_times(inverse, rest)
    beta, full = task.known.copy(), task.known.copy()
    full[:, free] = strong - _times(ex.plain, rest + _times(task.G, strong))
    beta[:, free], doubt = _filled_by_prior(sums, ex, strong, full[:, free], free, task.stand_in)
    sure = np.zeros(beta.shape, dtype=np.bool_)
    sure[:, free] = doubt < PRIOR_SHARE * np.abs(beta[:, free])
    apart = (np.abs(one - other) / sigma2).max(axis=1)
    return _Round(beta, full, sure, doubt, inverse, ex, sigma2, apart, noise)


def _plain(G: Array) -> Array:
    """Inverses of normal matrices as far as arithmetic goes."""
    return excitation(G, np.zeros_like(G[:, 0])).inverse


def _filled_by_prior(
    sums: WindowSums, ex: Excitation, strong: Array, full: Array, free: list[int], stand_in: Array
) -> tuple[Array, Array]:
    """Values with the directions that are not told filled in from what is plausible, and the standard errors of that.

    In units of each column's size b = beta/scale, a direction's coordinate t follows from priors of the parameters in
    it: a held value, to within its own size; else, for an inductance, the other axis' where that is told, likewise;
    else nothing but that no parameter contributes more than all of the voltage. So what rests on priors alone is known
    to no less than its own size.
    """
    B, scale = ex.weak, ex.scale
    norm = _quotient(np.ones(scale.shape), scale)
    if not B.any():
        return strong * norm * scale, np.zeros(scale.shape)
    share = np.sum(B**2, axis=2)
    u = np.sqrt(np.sum(sums.lag0[:, :, U, U], axis=1))[:, None]
    value = np.tile(stand_in[free], (len(B), 1))
    for name, other in (("L_d", "L_q"), ("L_q", "L_d")):
        j, k = (free.index(PARAMETERS.index(n)) if PARAMETERS.index(n) in free else None for n in (name, other))
        if j is not None:
            known = np.where(share[:, k] < 0.5, full[:, k], 0.0) if k is not None else (
                np.full(len(B), stand_in[PARAMETERS.index(other)])
            )
            value[:, j] = np.where(value[:, j] > 0.0, value[:, j], np.maximum(known, 0.0))
    b, prior = strong * norm, value * norm
    deviation = np.where(value > 0.0, np.minimum(prior, u), u)
    weight = np.sqrt(share) / np.maximum(deviation, np.maximum(_PRIOR_LEAST * u, 1e-100))
    by_priors = B @ np.array(np.linalg.pinv(weight[:, :, None] * B, rcond=1e-12), np.float64)
    return (b + _times(by_priors, weight * (prior - b))) * scale, np.linalg.norm(by_priors, axis=2) * scale


def _share_of_bias(sums: WindowSums, bias: Array, value: Array, apart: Array) -> Array:
    """Share of what noise does to a value that stays doubtful when it is taken out (K, p).

    What so few rows that follow each other tell of the noise, and what two estimates of it disagree about; and the more
    it is, the more: the control answers to noise, so that what seems excited is in part its echo.
    """
    known = np.maximum(NOISE_DOUBT, 3.0 / np.sqrt(np.maximum(np.minimum(sums.rows, sums.pairs + 1.0), 1.0)))
    return np.minimum(1.0, (known + apart)[:, None] + NOISE_ECHO * _quotient(np.abs(bias), np.abs(value)))


def _times(A: Array, x: Array) -> Array:
    """A x for stacks of matrices and vectors."""
    return (A @ x[..., None])[..., 0]


def _form(c: Array, S: Array) -> Array:
    """c' S c for stacks."""
    return (c * _times(S, c)).sum(axis=-1)


def _axis_coefficients(beta: Array, small: Array) -> Array:
    """Coefficients c (K, 2, 6) of the d and the q axis, so that c' z is minus the residual of a row z."""
    c = np.empty((len(beta), 2, SIZE))
    c[:, :, :H] = beta[:, None, :]
    c[:, :, 1:3] += small[:, 1:, None]  # b_d on the d axis, b_q on the q axis
    c[:, :, H] = small[:, :1]
    c[:, :, U] = -1.0
    return c


def _known_parameters(beta: Array, told: NDArray[np.bool_], stand_in: Array) -> Array:
    """Parameters (K, 4) where told or held, else 0; the other axis' inductance stands in for one that is neither."""
    known = np.where(told, beta, stand_in)
    L_d, L_q = known[:, 1].copy(), known[:, 2].copy()
    known[:, 1], known[:, 2] = np.where(L_d > 0.0, L_d, L_q), np.where(L_q > 0.0, L_q, L_d)
    return known


def _second_order(known: Array, T_s: float) -> Array:
    """Coefficients (K, 3) of the small terms: of h in V, b_d and b_q in H; 0 where a parameter is not known."""
    R_s, L_d, L_q, psi_f = known.T
    h = -_quotient(R_s * psi_f, L_d)
    b_d, b_q = (
        np.divide((R_s * T_s) ** 2 / 12.0, L, out=np.zeros(len(L)), where=np.abs(R_s) * T_s < 3.0 * L)
        for L in (L_d, L_q)
    )
    return np.stack((h, b_d, b_q), axis=-1)


def _doubt_of_h(sums: WindowSums, beta: Array, std: Array, told: NDArray[np.bool_], stand_in: Array) -> Array:
    """Standard error of the coefficient of h, R_s psi_f/L_d, in V (K,): from its value to its largest likely one.

    What is neither told nor held is no larger than the q-axis voltage allows: R_s i_q, psi_f s, or half of it each;
    L_d is then L_q or half of it.
    """
    known, off = _known_parameters(np.abs(beta), told, stand_in), Z_95 * np.where(told, std, 0.0)
    i_q, s, u_q = np.sqrt(np.diagonal(sums.lag0[:, 1], axis1=1, axis2=2)[:, [0, 3, U]].T)
    share = np.where((known[:, 0] > 0.0) | (known[:, 3] > 0.0), 1.0, 0.5)
    R_s, psi_f = (
        np.where(known[:, j] > 0.0, known[:, j] + off[:, j], _quotient(share * u_q, by)) for j, by in ((0, i_q), (3, s))
    )
    L = np.where(known[:, 1] > 0.0, known[:, 1], np.abs(beta[:, 1:3]).max(axis=1))
    smallest = np.where(told[:, 1] | (stand_in[1] > 0.0), np.maximum(L - off[:, 1], 0.1 * L), 0.5 * L)
    return (_quotient(R_s * psi_f, smallest) - _quotient(known[:, 0] * known[:, 3], L)) / Z_95


def _quotient(a: Array, b: Array) -> Array:
    """a / b, and 0 where b is not above 0."""
    return np.divide(a, b, out=np.zeros(b.shape), where=b > 0.0)


def _current_noise(sums: WindowSums, beta: Array, c: Array) -> Array:
    """Variance of a sampled current by axis in A^2 (K, 2), by the residual that beta leaves.

    White noise of variance sigma2 in the sampled current leaves a residual whose lag-1 covariance is
    -(L sigma/T)^2, however the machine is excited. Where the window does not tell L, the flux difference x itself
    has one of -sigma2/T^2; so has a signal that steps from row to row, but not without a residual to match.

    It shows in rows that follow each other. As far as gaps leave none that do, the covariance may be anything between
    none and that of a residual all of which is current noise, half its variance: the middle of it is taken, and
    `_share_of_bias` takes it to be off by as much.
    """
    n, pairs, T = sums.rows[:, None], np.maximum(sums.pairs, 1.0)[:, None], sums.T
    n_or_1 = np.maximum(n, 1.0)
    L2 = np.maximum(beta[:, 1:3] ** 2, 1e-18)  # L_d of the d axis, L_q of the q axis
    S0, S1 = (S[:, (0, 1), (1, 2), (1, 2)] for S in (sums.lag0, sums.lag1))  # of x
    gamma0 = np.maximum(0.0, _form(c, sums.lag0)) / n_or_1
    alone = _OPEN_COLOUR * np.clip(1.0 - sums.pairs[:, None] / np.maximum(n - 1.0, 1.0), 0.0, 1.0)
    gamma1 = (0.5 * _form(c, sums.lag1) - 0.25 * alone * gamma0) / np.maximum(sums.pairs[:, None] + alone, 1.0)
    by_residual = np.minimum(np.maximum(0.0, -gamma1) / L2, S0 / (2.0 * n_or_1))
    by_signal = np.minimum(np.maximum(0.0, -S1 / (2.0 * pairs)), gamma0 / (2.0 * L2))
    return FAINT_I**2 + sums.resolution.i**2 / 12.0 + T**2 * np.maximum(by_residual, by_signal)


def _regressor_noise(sums: WindowSums, sigma2: Array) -> Array:
    """Energy that noise in the sampled currents gives to each regressor (K, 4)."""
    n, T = sums.rows[:, None], sums.T
    of_mean = sigma2 / sums.periods
    x = 2.0 * n * sigma2 / T**2 + sums.lag0[:, 1, 3, 3, None] * of_mean
    return np.stack((n[:, 0] * of_mean.sum(axis=1), x[:, 0], x[:, 1], n[:, 0] * FAINT_SPEED**2), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """Sums over the residuals of K windows, by axis (K, 2), and the counts that go with them (K, 1)."""

    squares: Array  # V^2
    neighbours: Array  # V^2, twice the products of neighbouring rows
    batch: Array  # V^2, squares of weighted sums over a batch
    rows: Array
    pairs: Array
    batches: Array
    w_w: Array
    w_next: Array

    def pooled(self) -> "Residual":
        """All windows as one."""
        return Residual(*(np.sum(getattr(self, f.name), axis=0, keepdims=True) for f in fields(self)))


def window_residual(sums: WindowSums, c: Array) -> Residual:
    """Residuals of windows, for coefficients c (K, 2, 6), so that c' z is minus the residual of a row z."""
    squares, neighbours, batch = (_form(c, S) for S in (sums.lag0, sums.lag1, sums.batch))
    counts = (sums.rows, sums.pairs, sums.batches, sums.w_w, sums.w_next)
    return Residual(np.maximum(0.0, squares), neighbours, batch, *(count[:, None] for count in counts))


@dataclass(frozen=True, slots=True, eq=False)
class Colour:
    """Colour of a residual by axis (K, 2): first-order moving average; variances of estimates in units of gamma0."""

    f: Array  # level of the spectrum at frequency zero, gamma0 + 2 gamma1, over gamma0: 0 to 2
    of_gamma0: Array  # variance of the estimate of gamma0,
    of_f: Array  # of f,
    of_both: Array  # and their covariance


def colour(r: Residual) -> Colour:
    """Two estimates of f, weighted by their precision.

    From neighbours, f = gamma0 + 2 gamma1, and from batches of rows, whose weighted residuals
    square to gamma0 (sum w_k^2 - sum w_k w_{k+1}) + f sum w_k w_{k+1}. The first is the better one for white
    residuals, the second, by far, for those that nearly cancel over a few rows.
    """
    n = np.maximum(r.rows, 1.0)
    mean_square = np.maximum(r.squares / n, 1e-300)
    by_pairs = 1.0 + r.neighbours / np.maximum(r.pairs, 1.0) / mean_square
    there = r.batches >= 1.0
    batches, w_next = np.where(there, r.batches, 1.0), np.where(there, r.w_next, 1.0)
    leak = (r.w_w - w_next) / w_next
    by_batches = np.where(there, r.batch / mean_square / w_next - leak, by_pairs)
    rho = 0.5 * (np.clip(by_batches, 0.0, 2.0) - 1.0)
    of_gamma0 = 2.0 * (1.0 + 2.0 * rho**2) / n
    of_pairs = of_gamma0 + (4.0 * (1.0 + 3.0 * rho**2) + 16.0 * rho) / n
    of_batches = 2.0 / batches * (1.0 + 2.0 * rho + leak) ** 2
    share = np.where(there, of_pairs / (of_pairs + of_batches), 0.0)
    f = np.clip((1.0 - share) * by_pairs + share * by_batches, 0.0, 2.0)
    of_both = (1.0 - share) * (of_gamma0 + 8.0 * rho / n) + share * 2.0 * f**2 / n
    return Colour(f, of_gamma0, (1.0 - share) * of_pairs, of_both)


def _variance(
    sums: WindowSums, c: Array, free: list[int], inverse: Array, sigma2: Array, *, together: bool
) -> tuple[Array, Array, Array]:
    """Sandwich variances (K, p) with residuals of first-order moving average; of constant errors; squares (K,)."""
    r = window_residual(sums, c)
    n, share = np.maximum(r.rows, 1.0), len(free) / sums.axes  # of the parameters, an axis'
    known, own = colour(r), np.maximum(n - share, 0.5)
    gamma0, freedom_of_gamma0 = r.squares / own, own
    if together:
        pool = r.pooled()
        known = colour(pool)
        common = pool.squares / np.maximum(pool.rows - share * len(n), 0.5)
        gamma0, freedom_of_gamma0 = (r.squares + SHARED * common) / (own + SHARED), own + SHARED
    outside, inside = inverse[:, None], (S[:, :, free][..., free] for S in (sums.lag0, sums.lag1))
    S0, S1 = (np.diagonal(outside @ S @ outside, axis1=2, axis2=3) for S in inside)  # (K, 2, p)
    A, B = gamma0[..., None] * (S0 - 0.5 * S1), gamma0[..., None] * 0.5 * S1
    variance = np.maximum(np.sum(A + known.f[..., None] * B, axis=1), 0.0)
    of_gamma0, of_f, of_both = (of[..., None] for of in (known.of_gamma0, known.of_f, known.of_both))
    of_variance = np.sum(of_gamma0 * A**2 + of_f * B**2 + 2.0 * of_both * A * B, axis=1)
    freedom = np.divide(2.0 * variance**2, of_variance, out=np.full_like(variance, np.inf), where=of_variance > 0.0)
    variance *= _student(np.minimum(np.maximum(freedom, _FEWEST_FREEDOM), np.maximum(freedom_of_gamma0, 1.0))) ** 2
    constant = n * _constant_errors(sums, c, r.squares / n, sigma2)
    return variance, np.sum(constant[..., None] * S0, axis=1), r.squares.sum(axis=1)


def _constant_errors(sums: WindowSums, c: Array, gamma0: Array, sigma2: Array) -> Array:
    """Variance of a voltage error that may last for the whole window, by axis in V^2 (K, 2).

    Noise of variance v dithers a resolution q: the error's mean shrinks by exp(-2 pi^2 v/q^2) (B. Widrow, I. Kollar,
    Quantization Noise, 2008, doi 10.1017/CBO9780511754661).
    """
    n = np.maximum(sums.rows, 1.0)
    u2, s2 = np.sum(sums.lag0[:, :, U, U], axis=1) / n, sums.lag0[:, 1, 3, 3] / n
    Z2 = c[:, 0, 0] ** 2 + s2 * np.max(c[:, 0, 1:3] ** 2, axis=1)  # ohm^2
    of_u, of_i = _undithered(sums.resolution.u, gamma0), _undithered(sums.resolution.i, sigma2 / sums.periods)
    model2 = MODEL**2 + (MODEL_TURN * _turn_rms(sums) ** 3) ** 2 + MODEL_MOVING**2 * spread_of_speed(sums)
    return (model2 * u2)[:, None] + of_u + Z2[:, None] * of_i + _angle_error(sums, c, s2) + _missed_current(sums, c, s2)


def _missed_current(sums: WindowSums, c: Array, s2: Array) -> Array:
    """What an i_d that is not recorded may do to u_q, in V^2 (K, 2): the current control lets i_q through to it."""
    missed = np.zeros((len(s2), 2))
    if sums.q_only:
        i_q2, none = sums.lag0[:, 1, 0, 0] / np.maximum(sums.rows, 1.0), sums.lag0[:, 1, 1, 1] == 0.0
        missed[:, 1] = np.where(none, s2 * c[:, 1, 2] ** 2 * I_D**2 * i_q2, 0.0)
    return missed


def _angle_error(sums: WindowSums, c: Array, s2: Array) -> Array:
    """What a constant error of the angle, of up to its sensor's step, does to the voltages: in V^2 (K, 2).

    The rotor frame is turned by delta: psi_d gains delta (L_d - L_q) i_q, psi_q gains delta (psi_f + (L_d - L_q) i_d).
    """
    delta2 = sums.resolution.theta_e**2 / 3.0
    i2 = sums.lag0[:, :, 0, 0] / np.maximum(sums.rows, 1.0)[:, None]  # A^2, i_d and i_q
    saliency2 = ((c[:, 0, 1] - c[:, 0, 2]) ** 2)[:, None]
    flux2 = saliency2 * i2
    flux2[:, 0] += c[:, 0, 3] ** 2
    return delta2 * s2[:, None] * flux2


def spread_of_speed(sums: WindowSums) -> Array:
    """Relative variance of the speed's square (K,), 0 to 1; from h, which grows with it."""
    h_2 = sums.lag0[:, 0, H, H] / np.maximum(sums.rows, 1.0)
    return np.clip(_quotient(h_2, (_turn_rms(sums) ** 2 / 12.0) ** 2) - 1.0, 0.0, 1.0)


def _turn_rms(sums: WindowSums) -> Array:
    """Angle D that the rotor turns in a control period, rms, in rad (K,)."""
    s = np.sqrt(sums.lag0[:, 1, 3, 3] / np.maximum(sums.rows, 1.0))
    return 2.0 * np.arcsin(np.minimum(1.0, 0.5 * sums.T_s * s))


def _undithered(step: float, noise: Array) -> Array:
    if step == 0.0:
        return np.zeros_like(noise)
    return step**2 / 12.0 * np.exp(-4.0 * np.pi**2 * noise / step**2)


def _student(freedom: Array) -> Array:
    """Quantile of Student's distribution over that of the normal, for 95 %."""
    from scipy.special import stdtrit

    return stdtrit(freedom, 0.975) / Z_95
