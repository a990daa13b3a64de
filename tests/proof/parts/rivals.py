"""What others make of a recording: conventional estimators, a whiteness test, sparse regression, a black box.

All are fitted on every second of 48 stretches and judged on the others, by the voltage that they miss of the flux
balance averaged over ten periods, see `estimator.online.flux_balance`. Each is given what speaks for it: the filter the
true noise, sparse regression the shapes of dead time and of harmonics and its threshold by BIC, the whiteness test
rows that share no sample.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
import statsmodels.stats.diagnostic
from numpy.typing import NDArray

from bench.live import method
from bench.live.window import Window
from estimator.machine import PARAMETERS, Machine
from estimator.online import window_ls
from estimator.online.flux_balance import COLUMNS, flux_balance
from estimator.samples import Samples

diagnostic: Any = statsmodels.stats.diagnostic  # comes without types

Array = NDArray[np.float64]
Values = Mapping[str, float | None]

M: Final = 10  # periods of a row
STRETCHES: Final = 48
_LAGS: Final = 20
_BEYOND: Final = 4  # terms of a sparse model that are told
NOTHING_BEYOND: Final = "the textbook's terms alone"
_THIRD: Final = 2.0 * math.pi / 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Means over M periods."""

    balance: Array  # (n, 10), columns of `flux_balance`
    theta_e: Array  # rad, in the middle
    judged: NDArray[np.bool_]  # takes no part in fits
    follows: NDArray[np.bool_]  # the block before is there

    def column(self, name: str) -> Array:
        """A column of the balance."""
        return self.balance[:, COLUMNS.index(name)]


@dataclass(frozen=True, slots=True)
class Word:
    """What a method says."""

    says: str  # of what is concealed
    values: Values  # parameters, SI
    stds: Values
    missed: float  # V rms on what took no part


def pieces(runs: Sequence[Samples]) -> Iterator[tuple[Samples, bool]]:
    """Stretches of the recording, and whether they are for judging."""
    edges = np.linspace(0, sum(map(len, runs)), STRETCHES + 1).astype(int)
    start = 0
    for run in runs:
        for k in range(STRETCHES):
            a, b = max(edges[k] - start, 0), min(edges[k + 1] - start, len(run))
            if b - a > M:
                yield run[a:b], k % 2 == 1
        start += len(run)


def blocks_of(runs: Sequence[Samples]) -> Blocks:
    """The recording as all methods here see it."""
    parts: list[tuple[Array, Array, bool]] = []
    for piece, judged in pieces(runs):
        balance = flux_balance(piece, M)
        parts.append((balance, piece.theta_e[M // 2 :: M][: len(balance)], judged))
    return Blocks(
        np.concatenate([balance for balance, _, _ in parts]), np.concatenate([theta for _, theta, _ in parts]),
        np.concatenate([np.full(len(balance), judged) for balance, _, judged in parts]),
        np.concatenate([np.arange(len(balance)) > 0 for balance, _, _ in parts]),
    )


def left(blocks: Blocks, values: Values, nominal: Machine) -> Array:
    """Voltage (V; n x 2) that a textbook machine misses."""
    R_s, L_d, L_q, psi_f = (values.get(name) or getattr(nominal, name) for name in PARAMETERS)
    i_d, i_q, x_d, x_q, y_d, y_q, s, h, u_d, u_q = blocks.balance.T
    e_d = u_d - (R_s * (i_d - h * psi_f / L_d) + L_d * x_d - L_q * y_q)
    e_q = u_q - (R_s * i_q + L_q * x_q + L_d * y_d + psi_f * s)
    return np.column_stack((e_d, e_q))


def rms(e: Array) -> float:
    """Of both axes together."""
    return math.sqrt(float(np.mean(e**2)))


# --- conventional


def wls(runs: Sequence[Samples], blocks: Blocks, nominal: Machine) -> Word:
    """One window over all that may be fitted."""
    fitted = [piece for piece, judged in pieces(runs) if not judged]
    state = window_ls.init(max(sum(map(len, fitted)), 4 * M), M)
    for piece in fitted:
        state = window_ls.update(state, piece, joined=False)
    return _conventional(window_ls.estimate(state).estimates, blocks, nominal)


def ekf(runs: Sequence[Samples], blocks: Blocks, nominal: Machine, noise_i: float, lsb: float) -> Word:
    """The extended Kalman filter over all rows from the nominal values, psi_f held; the sensor's noise (A) is known."""
    held = {name: getattr(nominal, name) for name in PARAMETERS}
    window = Window().changed({
        "held": held, "estimated": ["R_s", "L_d", "L_q"], "method": "ekf", "ekf": {"noise_i": noise_i, "lsb": lsb},
    })  # fmt: skip
    running = method.start(window)
    for run in runs:
        method.take(running, run, joined=False)
    return _conventional(method.estimate(running).estimates, blocks, nominal)


def _conventional(estimates: Mapping[str, Any], blocks: Blocks, nominal: Machine) -> Word:
    values: Values = {name: one.value for name, one in estimates.items()}
    stds: Values = {name: one.std for name, one in estimates.items()}
    return Word("values, no word of an effect", values, stds, rms(left(blocks, values, nominal)[blocks.judged]))


def whiteness(blocks: Blocks, values: Values, nominal: Machine) -> float:
    """p of Ljung and Box's test on what the window misses: of both axes, for either. Rows share no sample."""
    e = left(blocks, values, nominal)[blocks.judged][::2]
    found = [diagnostic.acorr_ljungbox(e[:, axis], lags=[_LAGS])["lb_pvalue"].iloc[0] for axis in (0, 1)]
    return min(1.0, 2.0 * float(min(found)))


# --- learnt


def _signs(blocks: Blocks) -> NDArray[np.complex128]:
    """Signs of the phase currents on d and q, 1: the shape of dead time."""
    i_s = (blocks.column("i_d") + 1j * blocks.column("i_q")) * np.exp(1j * blocks.theta_e)
    axes = np.exp(1j * _THIRD * np.arange(3))
    signs: NDArray[np.complex128] = np.sign((i_s[:, None] * axes.conj()).real).astype(np.complex128)
    return (2.0 / 3.0) * (signs @ axes) * np.exp(-1j * blocks.theta_e)


def _terms(blocks: Blocks) -> dict[str, Array]:
    """A library of one who knows the machine: the textbook's terms, products, signs, sixth harmonics."""
    i_d, i_q, omega = (blocks.column(name) for name in ("i_d", "i_q", "s"))
    signs, size = _signs(blocks), np.hypot(i_d, i_q)
    return {
        "u_d": blocks.column("u_d"), "u_q": blocks.column("u_q"), "i_d": i_d, "i_q": i_q, "omega": omega,
        "omega i_d": omega * i_d, "omega i_q": omega * i_q, "1": np.ones_like(i_d), "sign_d": signs.real,
        "sign_q": signs.imag, "omega cos6": omega * np.cos(6.0 * blocks.theta_e),
        "omega sin6": omega * np.sin(6.0 * blocks.theta_e), "omega i_d |i|": omega * i_d * size,
        "omega i_q |i|": omega * i_q * size, "i_d |i|": i_d * size, "i_q |i|": i_q * size,
        "omega |omega| i_d": omega * np.abs(omega) * i_d, "omega |omega| i_q": omega * np.abs(omega) * i_q,
    }  # fmt: skip


def sparse(blocks: Blocks, nominal: Machine) -> Word:
    """Sparse regression of d(i)/dt (S. Brunton et al., doi 10.1073/pnas.1517384113); volts by nominal inductances."""
    ps = import_module("pysindy")
    library, fitted = _terms(blocks), ~blocks.judged
    names, columns = list(library), np.column_stack(list(library.values()))
    scale = np.sqrt(np.mean(columns[fitted] ** 2, axis=0)) + 1e-12
    found: list[dict[str, float]] = []
    missed: list[Array] = []
    thresholds: list[float] = np.geomspace(1e-4, 0.3, 25).tolist()
    warnings.filterwarnings("ignore", message="Sparsity parameter is too big")  # it need not win
    for axis, dx in enumerate((blocks.column("x_d"), blocks.column("x_q"))):
        out = rms(dx[fitted])
        best: tuple[float, Array] = (math.inf, np.zeros(len(names)))
        for threshold in thresholds:
            optimizer = ps.STLSQ(threshold=threshold, alpha=1e-9)
            optimizer.fit(columns[fitted] / scale, dx[fitted, None] / out)
            coefficients: Array = np.array(optimizer.coef_, np.float64)[0]
            e = dx[fitted] / out - columns[fitted] / scale @ coefficients
            n = len(e)
            bic = 2.0 * n * math.log(rms(e)) + int(np.count_nonzero(coefficients)) * math.log(n)
            if bic < best[0]:
                best = bic, coefficients
        physical = best[1] * out / scale
        found.append(dict(zip(names, physical.tolist(), strict=True)))
        missed.append((nominal.L_d, nominal.L_q)[axis] * (dx - columns @ physical)[blocks.judged])
    textbook = ({"u_d", "i_d", "omega i_q"}, {"u_q", "i_q", "omega i_d", "omega"})
    beyond = [
        f"{name} in di_{'dq'[axis]}/dt"
        for axis in (0, 1)
        for name, value in found[axis].items() if value and name not in textbook[axis]
    ]
    more = f" and {len(beyond) - _BEYOND} more" if len(beyond) > _BEYOND else ""
    says = f"{len(beyond)} terms beyond the textbook's: {', '.join(beyond[:_BEYOND])}{more}"
    return Word(says if beyond else NOTHING_BEYOND, _machine(*found), {}, rms(np.column_stack(missed)))


def _machine(of_d: Mapping[str, float], of_q: Mapping[str, float]) -> Values:
    by_d, by_q = of_d["u_d"], of_q["u_q"]
    if by_d <= 0.0 or by_q <= 0.0:
        return dict.fromkeys(PARAMETERS)
    return {
        "R_s": -0.5 * (of_d["i_d"] / by_d + of_q["i_q"] / by_q), "L_d": 1.0 / by_d, "L_q": 1.0 / by_q,
        "psi_f": -of_q["omega"] / by_q,
    }  # fmt: skip


def black_box(blocks: Blocks, values: Values, nominal: Machine) -> Word:
    """Boosted trees on what the window misses, by current, voltage, speed and angle, now and a block before."""
    ensemble = import_module("sklearn.ensemble")
    signs = _signs(blocks)
    now = np.column_stack([
        *(blocks.column(name) for name in ("i_d", "i_q", "u_d", "u_q", "s")), np.cos(blocks.theta_e),
        np.sin(blocks.theta_e), np.cos(6.0 * blocks.theta_e), np.sin(6.0 * blocks.theta_e), signs.real, signs.imag,
    ])  # fmt: skip
    before = np.where(blocks.follows[:, None], np.roll(now, 1, axis=0), now)[:, :5]
    features, e, fitted = np.column_stack((now, before)), left(blocks, values, nominal), ~blocks.judged
    missed = np.empty_like(e)
    for axis in (0, 1):
        trees = ensemble.HistGradientBoostingRegressor(
            learning_rate=0.05, max_iter=200, min_samples_leaf=40, l2_regularization=1.0, random_state=1,
            early_stopping=True, validation_fraction=0.2,
        )  # fmt: skip
        trees.fit(features[fitted], e[fitted, axis])
        missed[:, axis] = e[:, axis] - trees.predict(features)
    was, now_missed = rms(e[blocks.judged]), rms(missed[blocks.judged])
    learnt = 1.0 - (now_missed / was) ** 2
    says = f"{learnt:.0%} of what is missed can be learnt" if learnt > 0.02 else "nothing to be learnt"
    return Word(says, {}, {}, now_missed)
