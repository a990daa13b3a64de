"""A model of a held motor's windings, fitted to voltage pulses by their flux balance.

    integral u dt = L i + R_s integral i dt + c u_lost integral sign(i) dt + R_x integral (i - i_x) dt - b i^3 + const
    L = L_0 + L_1 cos 2 (n_p theta_m - phi) + L_2 sin 2 (n_p theta_m - phi)        tau d(i_x)/dt = i - i_x

along the direction phi that each pulse is given in, per phase, stretch by stretch of one switching state: all but tau
is linear. Two phases in series take 1/sqrt(3) of the dc link along phi and 2/sqrt(3) of a leg's loss; a phase before
two others takes 2/3, and 4/3. Sums are kept for each angle, so that leaving one out costs nothing. Knows nothing of
which terms are right.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.kernel import kernel

PulseTerms = tuple[str, ...]

LOST, RUNG, SATURATION = "lost", "rung", "saturation"
NAMES: Final = ("L_0", "L_1", "L_2", "R_s", "u_lost", "b", "R_x")
OF_TERM: Final = {LOST: "u_lost", SATURATION: "b", RUNG: "R_x"}
_TAUS: Final = np.geomspace(1e-5, 1e-3, 49)  # s
STEP_OF_TAU: Final = math.log(_TAUS[1] / _TAUS[0])
_MOST_POLE_PAIRS: Final = 40
_EDGE_ROWS: Final = 1  # rows left out at a change of state, whose moment is not known better
_NEAR_ZERO: Final = 0.05  # of the largest current: below it a current's sign is not sure
_FEWEST_STRETCH_ROWS: Final = 8  # rows of a stretch
_SINGLE: Final = 0.25  # of the largest phase current: below it a phase has none
_LEGS: Final = np.exp(2j * math.pi / 3.0 * np.arange(3))


@dataclass(frozen=True, slots=True, eq=False)
class Train:
    """A train of pulses in one direction at one angle, from zero current."""

    angle: float  # rad, mechanical
    T_s: float  # s, between rows
    state: NDArray[np.int64]  # a number for each switching state
    sign: Array  # 1, -1: the dc link drives the current forth, back; 0: shorted
    u_dc: Array  # V
    i: Array  # (rows, 3): phase currents, A, without their offsets


@dataclass(frozen=True, slots=True, eq=False)
class PulseFit:
    """Terms with their sizes, fitted to some angles."""

    terms: PulseTerms
    values: dict[str, float]
    tau: float  # s
    residual: Array  # (angles,) Vs squared, sum of squares on each less what noise adds


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """Columns of rows without a change of state, each without its mean."""

    angle: int
    direction: float  # rad
    i: Array  # (rows,) A, with its mean
    known: Array  # (rows, 5): i, integral of i, of a leg's loss, minus i^3, integral of the voltage
    over: Array  # (rows, taus): integral of i - i_x


class Pulses:
    """Trains made ready for fits."""

    def __init__(self, trains: Sequence[Train], n_p: int | None = None) -> None:
        self.angles = np.unique([train.angle for train in trains])
        self.largest = max(float(np.max(np.abs(train.i))) for train in trains)
        self.noise = _noise(trains)
        stretches = [one for train in trains for one in self._stretches(train)]
        if not stretches:
            raise ValueError("expected pulses whose current lasts over several rows of a switching state, came none")
        self.rows = np.bincount([s.angle for s in stretches], [len(s.known) for s in stretches], len(self.angles))
        self.duration = float(np.mean([len(s.known) for s in stretches])) * trains[0].T_s
        candidates = range(1, _MOST_POLE_PAIRS + 1) if n_p is None else (n_p,)
        sums = {n: self._sums(stretches, n, whole=False) for n in candidates}
        self.by_pairs = {n: float(np.sum(self._solved((), gram, 0).residual)) for n, gram in sums.items()}
        self.n_p = min(self.by_pairs, key=lambda n: self.by_pairs[n])
        self._grams = self._sums(stretches, self.n_p, whole=True)

    def fit(self, terms: PulseTerms, without: int | None = None) -> PulseFit:
        """The best sizes for all angles, or all but one; residuals of all."""
        kept = [k for k in range(len(self.angles)) if k != without]
        places = range(len(_TAUS)) if RUNG in terms else (0,)
        return min((self._solved(terms, self._grams, k, kept) for k in places),
                   key=lambda fit: float(np.sum(fit.residual[kept])))  # fmt: skip

    def rms(self, fit: PulseFit, at: Sequence[int]) -> float:
        """Error of the current (A) at some angles, its noise included."""
        beyond = float(fit.residual[list(at)].sum() / self.rows[list(at)].sum()) / fit.values["L_0"] ** 2
        return math.hypot(math.sqrt(max(beyond, 0.0)), self.noise)

    def _solved(self, terms: PulseTerms, grams: Array, place: int, kept: Sequence[int] | None = None) -> PulseFit:
        """`grams`: (angles, columns, columns), the last column that of the voltage."""
        names = [*NAMES[:4], *(OF_TERM[t] for t in (LOST, SATURATION, RUNG) if t in terms)]
        at = [NAMES.index(name) if name != "R_x" else len(NAMES) - 1 + place for name in names]
        total = grams.sum(axis=0) if kept is None else grams[list(kept)].sum(axis=0)
        while True:
            scale = 1.0 / np.sqrt(np.diag(total)[at])
            A = total[np.ix_(at, at)] * np.outer(scale, scale)
            c = scale * cast(Array, np.linalg.solve(A, scale * total[at, -1]))
            negative = [k for k in range(4, len(at)) if c[k] < 0.0]  # no loss gives energy
            if not negative:
                break
            worst = min(negative, key=lambda k: c[k] / scale[k])
            del at[worst], names[worst]
        left = grams[:, -1, -1] - 2.0 * grams[:, at, -1] @ c + np.einsum("j,ajk,k->a", c, grams[:, at][:, :, at], c)
        values = dict.fromkeys(NAMES, 0.0) | dict(zip(names, c.tolist(), strict=True))
        return PulseFit(terms, values, float(_TAUS[place]), left)

    def _sums(self, stretches: Sequence[_Stretch], n_p: int, *, whole: bool) -> Array:
        taus = len(_TAUS) if whole else 1
        grams = np.zeros((len(self.angles), len(NAMES) + taus, len(NAMES) + taus))
        for s in stretches:
            twice = 2.0 * (n_p * self.angles[s.angle] - s.direction)
            i = s.known[:, 0]
            salient = i * math.cos(twice), i * math.sin(twice)
            M = np.column_stack([i, *salient, s.known[:, 1:4], s.over[:, :taus], s.known[:, 4]])
            # What the current's noise adds to the sums, which else makes inductances small
            by_i = np.zeros(M.shape)
            by_i[:, :3] = 1.0, math.cos(twice), math.sin(twice)
            by_i[:, NAMES.index("b")] = -3.0 * s.i**2
            grams[s.angle] += M.T @ M - (1.0 - 1.0 / len(M)) * self.noise**2 * by_i.T @ by_i
        return grams

    def _stretches(self, train: Train) -> list[_Stretch]:
        direction, single = _direction(train)
        i = 2.0 / 3.0 * (train.i @ np.cos(np.angle(_LEGS) - direction))
        volts, legs = (2.0 / 3.0, 4.0 / 3.0) if single else (1.0 / math.sqrt(3.0), 2.0 / math.sqrt(3.0))
        charge = np.concatenate([[0.0], np.cumsum(0.5 * (i[1:] + i[:-1]) * train.T_s)])
        over = np.column_stack([_branch_charge(i, train.T_s, tau) for tau in _TAUS.tolist()])
        edges = np.flatnonzero(np.diff(train.state)) + 1
        found: list[_Stretch] = []
        for begin, end in zip([0, *edges.tolist()], [*edges.tolist(), len(i)], strict=True):
            first, last = begin + _EDGE_ROWS, end - _EDGE_ROWS
            flowing = first + np.flatnonzero(np.abs(i[first:last]) > _NEAR_ZERO * self.largest)
            if len(flowing) < _FEWEST_STRETCH_ROWS or np.ptp(np.sign(i[flowing])) > 0.0:
                continue
            rows = np.arange(flowing[0], flowing[-1] + 1, dtype=np.int64)
            t = (rows - rows[0]) * train.T_s
            way = float(np.sign(i[rows[0]]))
            u = train.sign[begin] * volts * float(np.mean(train.u_dc[begin:end]))
            known = np.column_stack([i[rows], charge[rows], legs * way * t, -i[rows] ** 3, u * t])
            angle = int(np.searchsorted(self.angles, train.angle))
            found.append(_Stretch(angle, direction, i[rows], _centred(known), _centred(over[rows])))
        return found


def _direction(train: Train) -> tuple[float, bool]:
    """Direction of the current's vector (rad), and whether one phase stands before two others."""
    strong = np.abs(train.i).max(axis=1) > 0.5 * np.abs(train.i).max()
    first = int(np.argmax(strong))
    mean = train.i[first : first + 3].mean(axis=0)
    toward = float(np.angle(mean @ _LEGS))
    size = np.sort(np.abs(mean))
    return round(toward / (math.pi / 6.0)) * math.pi / 6.0, bool(size[0] > _SINGLE * size[2])


def _centred(columns: Array) -> Array:
    return columns - columns.mean(axis=0)


def _noise(trains: Sequence[Train]) -> float:
    """Standard deviation of a current along its direction, by second differences within a state, A."""
    differences: list[Array] = []
    for train in trains:
        i = 2.0 / 3.0 * (train.i @ np.cos(np.angle(_LEGS) - _direction(train)[0]))
        differences.append(np.diff(i, 2)[train.state[2:] == train.state[:-2]])
    return float(np.median(np.abs(np.concatenate(differences)))) / (0.6745 * math.sqrt(6.0))


@kernel
def _branch_charge(i: Array, T_s: float, tau: float) -> Array:
    """Integral of i - i_x (As), where i_x follows i."""
    total = np.zeros(len(i))
    x, kept = i[0], math.exp(-T_s / tau)
    for k in range(len(i) - 1):
        mean = 0.5 * (i[k] + i[k + 1])
        after = mean + (x - mean) * kept
        total[k + 1] = total[k] + tau * (after - x)  # of tau d(i_x)/dt
        x = after
    return total
