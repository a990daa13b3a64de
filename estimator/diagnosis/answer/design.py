"""Experiment: which levels of speed and current would tell what a recording leaves in doubt.

The model so far is run, on paper, at some levels within the machine's limits, with small steps around each; the same
regression as that of a diagnosis says what a recording of some of them would tell: how far two effects' signals differ
there beyond what R_s, L_d, L_q, psi_f can take up, over the recording's own noise. Levels are added one by one, each
time the one that tells most. Knows nothing of drives.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Final, cast

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.angle.angle_rounding import beat_of
from estimator.diagnosis.likelihood.columns import STRETCHES, regression
from estimator.diagnosis.likelihood.evidence import FAINT, Choice, Search
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import STANDING
from estimator.diagnosis.likelihood.noise import Noise
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS, rivals
from estimator.diagnosis.verdict import Experiment, Hold
from estimator.diagnosis.words import listed, number, rounded
from estimator.machine import PARAMETERS, Machine
from estimator.online.flux_balance import TURN
from estimator.physics.library import BY_NAME, LIBRARY
from estimator.physics.rows import Rows
from estimator.twin.model import Model, base_voltage, effects_voltage, frame_of, in_truth

DURATION: Final = 6.0  # s
FEWEST, MOST = 3, 8  # holds
STEP_SHARE: Final = 0.1  # of rated current: steps around each level
_SPEED_LEVELS: Final = (1.0, 0.5, 0.2)  # of the fastest
_ASIDE: Final = 1.7  # times the rounding that beats: less than half a count of the encoder
_I_D_LEVELS: Final = (0.0, -0.25, -0.5, 0.25)  # of rated current
_I_Q_LEVELS: Final = (0.45, 0.7, 0.2, -0.4)
_PERIODS: Final = STRETCHES * 600 // (len(_SPEED_LEVELS) * len(_I_D_LEVELS) * len(_I_Q_LEVELS))  # of each level
_STEP_PERIODS: Final = (50, 35)  # periods that steps of i_d, i_q last
_BANDWIDTH: Final = 0.1  # of a period's change of a step that is left, as a current control has it
_REACH: Final = 0.9  # of the voltage there is
_ENOUGH: Final = math.log(1e6)  # log-odds
_TELLS_MORE: Final = 1.02  # times as much that another hold has to tell
_WELL: Final = 0.1  # of a parameter's tolerance: told well
_SAME_HELD: Final = 0.15  # of rated current, of the fastest speed: within it, one level
_MOST_ODDS: Final = 1e12
_TIMED: Final = frozenset({
    "winding_resistance_drift", "winding_temperature", "magnet_flux_drift", "magnet_flux_step", "magnet_temperature",
})
"""What moves with time alone, which no level tells."""
_NO_EXPERIMENT: Final = (
    "no levels of speed and current can be chosen that would tell; see that the recording is of one machine, and of "
    "that whose data are given"
)


def experiment(
    rows: Rows, model: Model, noise: Noise, nominal: Machine, tolerance: Mapping[str, float],
    pair: tuple[str, str] | None = None,
) -> Experiment:  # fmt: skip
    """What would tell one effect of the model from a rival; without them, what would tell the machine's parameters.

    `noise`: that of the recording, see `columns`. Without holds where none can be chosen: a proposal that fails takes
    nothing away from a verdict.
    """
    try:
        return _levels_chosen(rows, model, noise, nominal, tolerance, pair)
    except (ArithmeticError, np.linalg.LinAlgError):  # of a model that is no machine's
        return Experiment(_NO_EXPERIMENT)


def _levels_chosen(
    rows: Rows, model: Model, noise: Noise, nominal: Machine, tolerance: Mapping[str, float],
    pair: tuple[str, str] | None,
) -> Experiment:  # fmt: skip
    timed = _TIMED - set(pair or ())
    model = replace(model, effects={name: sizes for name, sizes in model.effects.items() if name not in timed})
    library = [effect for effect in LIBRARY if effect.name not in timed]
    rows = rows.with_machine(model.machine)
    levels = _holdable(rows)
    allowed = [k for k, (speed, i) in enumerate(levels) if _within_reach(rows, speed, i)]
    if not allowed:
        return Experiment(_NO_EXPERIMENT)
    imagined = _imagined(rows, model, levels)
    told = Search(regression(imagined, imagined, model, Given(nominal, tolerance, 1e-5), noise, library))
    design = _Design(told, nominal, tolerance, tuple((name, -1) for name in model.effects), pair)
    here = [k for k in allowed if abs(levels[k][0] - levels[0][0]) < 1e-9]
    chosen = design.best(here)
    if len(here) < len(allowed) and not (chosen and design.satisfied(chosen)):
        chosen = design.best(allowed)
    return _experiment_of(rows, [levels[k] for k in chosen], pair, design.odds(chosen))


# --- levels


def _holdable(rows: Rows) -> list[tuple[float, complex]]:
    """Electrical speeds (rad/s), the recording's own first, and currents (A) that may be held."""
    rated = rows.i_rated
    side = math.copysign(1.0, float(np.median(rows.i.imag)) or 1.0)
    way = math.copysign(1.0, float(np.median(rows.omega_e)) or 1.0)
    fast = _fastest(rows) - _ASIDE * beat_of(rows) / rows.T_s
    return [
        (way * share * fast, complex(d, q * side) * rated)
        for share, d, q in product(_SPEED_LEVELS, _I_D_LEVELS, _I_Q_LEVELS)
    ]


def _fastest(rows: Rows) -> float:
    """The recording's highest speed, rad/s; of a motor that stands, one that asks for a third of the voltage."""
    slow, fast = (float(np.quantile(np.abs(rows.omega_e[rows.joined]), q)) for q in (0.02, 0.98))
    if fast > STANDING:
        return fast if fast - slow > _SAME_HELD * fast else float(np.median(np.abs(rows.omega_e[rows.joined])))
    m = rows.machine
    volts = float(np.median(rows.u_dc)) / math.sqrt(3.0) if rows.u_dc is not None else 10.0 * m.R_s * rows.i_rated
    return volts / (3.0 * m.psi_f)


def _within_reach(rows: Rows, omega_e: float, i: complex) -> bool:
    """The voltage suffices, where the dc link is known; else it is no more than the recording has seen."""
    m = rows.machine
    u = m.R_s * i + 1j * omega_e * (m.L_d * i.real + m.psi_f + 1j * m.L_q * i.imag)
    seen = float(np.quantile(np.abs(rows.u), 0.99))
    if rows.u_dc is None:
        return abs(u) <= 1.2 * seen
    return abs(u) <= max(_REACH * float(np.median(rows.u_dc)) / math.sqrt(3.0), seen)


def _imagined(rows: Rows, model: Model, levels: Sequence[tuple[float, complex]]) -> Rows:
    """Rows of all levels, one after the other, as the model says they are.

    Each takes the whole experiment's time, in periods that follow one another all the same.
    """
    n = _PERIODS
    shape = [_staircase(n, hold, seed) for seed, hold in enumerate(_STEP_PERIODS)]
    around = STEP_SHARE * rows.i_rated * (shape[0] + 1j * shape[1])
    i = np.concatenate([at + around for _, at in levels] + [np.zeros(1)]).astype(np.complex128)
    D = np.repeat([speed * rows.T_s for speed, _ in levels], n)
    joined = np.ones(len(D), np.bool_)
    joined[n - 1 :: n] = False
    t = np.append(np.tile(np.arange(n) * (DURATION / n), len(levels)), DURATION)
    u_dc = None if rows.u_dc is None else np.full(len(D), float(np.median(rows.u_dc)))
    made = Rows(
        model.machine, rows.T_s, rows.i_rated, t, i, np.concatenate(([0.0], np.cumsum(D))), np.exp(0.5j * D),
        np.zeros(len(D), np.complex128), joined, u_dc, None, rows.T_s * np.cumsum(np.abs(i) ** 2), (0.0, DURATION),
        steps=joined.astype(np.intp),
    )  # fmt: skip
    for _ in range(3):  # the voltage counts in the mean current, and in what a bridge loses
        truth = in_truth(made, model)
        u = base_voltage(truth, model) + effects_voltage(truth, model)
        made = made.changed(u=np.where(joined, u * frame_of(made, truth), 0.0))
    return made


def _staircase(n: int, hold: int, seed: int) -> Array:
    """Random steps between -1 and 1, as a current control follows them."""
    wanted = np.repeat(np.random.default_rng(seed).choice((-1.0, -0.5, 0.0, 0.5, 1.0), n // hold + 1), hold)[:n]
    steps = np.diff(wanted, prepend=0.0)
    left = np.exp(-_BANDWIDTH * np.arange(n))
    return wanted - np.convolve(steps, left)[:n]


# --- choice


class _Design:
    """What holds tell, by the sums of a regression over all of them."""

    def __init__(self, told: Search, nominal: Machine, tolerance: Mapping[str, float], choice: Choice,
                 pair: tuple[str, str] | None) -> None:
        self._told, self._choice = told, choice
        self._well = [_WELL * tolerance[name] * getattr(nominal, name) for name in PARAMETERS]
        self._rest = tuple(one for one in choice if pair is None or one[0] != pair[0])
        self._rivals = [one for one in told.candidates() if pair is not None and one[0] == pair[1]]
        self._one = None if pair is None else next((one for one in choice if one[0] == pair[0]), None)
        shapes = {(name, -1) for name, _ in choice} | {(c.owner, 0) for c in told.columns}
        taken = {name for name, _ in choice}
        self._all = told.places(tuple((name, seed) for name, seed in shapes if seed < 0 or name not in taken))
        self._scores: dict[tuple[int, ...], float] = {}

    def best(self, allowed: Sequence[int]) -> list[int]:
        """Holds out of these, added while they tell more."""
        chosen: list[int] = []
        while len(chosen) < min(MOST, len(allowed)):
            more = max((k for k in allowed if k not in chosen), key=lambda k: self._score([*chosen, k]))
            if len(chosen) >= FEWEST and self._score([*chosen, more]) < _TELLS_MORE * self._score(chosen):
                break
            chosen.append(more)
        return chosen

    def satisfied(self, chosen: Sequence[int]) -> bool:
        """The parameters are told well, the pair is told apart, and so is the first of it from any other rival."""
        odds = self.odds(chosen)
        sure = odds is None or odds >= math.exp(SURE_LOG_ODDS)
        return sure and min(self._asked(self._search(chosen))) > 1.0 - 1e-6

    def odds(self, chosen: Sequence[int]) -> float | None:
        """Odds against the likeliest rival to be expected; None where nothing is to be told apart."""
        if self._one is None:
            return None
        closest = [d.log_odds for d in rivals(self._search(chosen), self._choice, self._one)]
        return math.exp(min(min(closest, default=_ENOUGH), math.log(_MOST_ODDS)))

    def _search(self, chosen: Sequence[int]) -> Search:
        regression, times = self._told.regression, DURATION / (len(chosen) * _PERIODS * self._told.regression.rows.T_s)
        return Search(replace(regression, gram=times * regression.gram[list(chosen)]))

    def _score(self, chosen: Sequence[int]) -> float:
        """How much is told of what is asked, and of every other effect that may be there."""
        key = tuple(sorted(chosen))
        if key not in self._scores:
            search = self._search(key)
            self._scores[key] = float(np.mean(self._asked(search))) + float(np.mean(self._seen(search)))
        return self._scores[key]

    def _asked(self, search: Search) -> list[float]:
        """How well each parameter is told, and how well the pair is told apart: 1 is well."""
        fit = search.fit(self._choice)
        std = np.sqrt(np.diag(fit.covariance)[: len(PARAMETERS)])
        told = [min(1.0, well / max(s, 1e-300)) for well, s in zip(self._well, std.tolist(), strict=True)]
        if self._one is None:
            return told
        apart = [fit.log_evidence - search.fit((*self._rest, other)).log_evidence for other in self._rivals]
        return [*told, *len(PARAMETERS) * [min(1.0, max(0.0, min(apart, default=_ENOUGH)) / _ENOUGH)]]

    def _seen(self, search: Search) -> list[float]:
        """How well every effect's sizes are told where all effects may be there at once: 1 is to less than matters."""
        precision = search.gram[np.ix_(self._all, self._all)] + np.diag(search.weight[self._all])
        scale = 1.0 / np.sqrt(np.diag(precision))
        inverse = cast(Array, np.linalg.inv(precision * np.outer(scale, scale)))
        variance = np.diag(inverse) * scale**2
        least = FAINT * search.spread[self._all] / np.sqrt(np.maximum(variance, 1e-300))
        return np.minimum(1.0, least).tolist()


# --- words


def _experiment_of(
    rows: Rows, holds: Sequence[tuple[float, complex]], pair: tuple[str, str] | None, odds: float | None
) -> Experiment:
    rpm = 60.0 / (TURN * rows.machine.n_p)
    holds = sorted(holds, key=lambda hold: (-abs(hold[0]), hold[1].real, hold[1].imag))
    if pair is not None and _TIMED & set(pair):
        holds = [*holds, holds[0]]  # the same again, later
    seconds = DURATION / len(holds)
    run = tuple(Hold(rounded(speed * rpm), rounded(i.real), rounded(i.imag), seconds) for speed, i in holds)
    speeds, i_d, i_q = (_different(run, name) for name in ("speed_rpm", "i_d", "i_q"))
    levels = _levels_said(rows, speeds, i_d, i_q)
    each = f"each with steps of {number(STEP_SHARE * rows.i_rated, 2)} A around it"
    if pair is None:
        sentence = f"record {levels}, {each}, {DURATION:g} s in all: that would tell R_s, L_d, L_q and psi_f"
    else:
        one, other = (BY_NAME[name].title for name in pair)
        expected = math.inf if odds is None else odds
        if expected < math.exp(SURE_LOG_ODDS):
            none = (
                f"no level within {number(rows.i_rated, 2)} A and {number(_fastest(rows) * rpm, 3)} rpm is expected "
                f"to tell {one} from {other} (odds {expected:.1g})"
            )
            if (read := _read_without_current(pair)) is not None:
                return Experiment(f"{none}; with the bridge off, where no current flows, only {read} can be read")
            sentence = (
                f"{none}; record {levels}, {each}, for longer than "
                f"{DURATION:g} s"
            )
        else:
            odds_there = f"expected odds {_odds(expected)} in {DURATION:g} s"
            sentence = f"{levels}, {each}, would tell {one} from {other} ({odds_there})"
    return Experiment(sentence, speeds, i_d, i_q, DURATION, run, rounded(STEP_SHARE * rows.i_rated), odds)


def _read_without_current(pair: tuple[str, str]) -> str | None:
    """The one of two effects, by its title, that is read with the bridge off, where only one is."""
    read = [BY_NAME[name].title for name in pair if BY_NAME[name].without_current]
    return read[0] if len(read) == 1 else None


def _different(run: Sequence[Hold], name: str) -> tuple[float, ...]:
    return tuple(dict.fromkeys(getattr(hold, name) for hold in sorted(run, key=lambda hold: getattr(hold, name))))


def _levels_said(rows: Rows, speeds: Sequence[float], i_d: Sequence[float], i_q: Sequence[float]) -> str:
    """What to record, and at which speed."""
    beats = beat_of(rows) > 0.0 and rows.hall_place is None
    new = _new_levels(rows, () if beats else speeds, i_d, i_q)
    if beats:
        at = f"at {listed(number(abs(speed), 4) for speed in speeds)} rpm"
        return f"{' and '.join(new) or 'the same currents'} {at}, where encoder counts do not beat with the period"
    same = " at the same speed" if len(speeds) == 1 and not any("speed" in part for part in new) else ""
    return f"{' and '.join(new)}{same}" if new else "the same levels again"


def _new_levels(rows: Rows, speeds: Sequence[float], i_d: Sequence[float], i_q: Sequence[float]) -> list[str]:
    """What the recording has one level of, and what else it is to have."""
    rpm = 60.0 / (TURN * rows.machine.n_p)
    said: list[str] = []
    for what, unit, new, seen, reach in (
        ("speed", "rpm", speeds, rows.omega_e * rpm, _fastest(rows) * rpm),
        ("i_d level", "A", i_d, rows.i.real, rows.i_rated),
        ("i_q level", "A", i_q, rows.i.imag, rows.i_rated),
    ):
        low, high = (float(np.quantile(seen, q)) for q in (0.02, 0.98))
        beyond = [x for x in new if not low - _SAME_HELD * reach <= x <= high + _SAME_HELD * reach]
        if not beyond:
            continue
        if len(beyond) == 1 and high - low < 2.0 * _SAME_HELD * reach:
            said.append(f"a second {what} of {number(beyond[0], 2)} {unit}")
        else:
            levels = f"{what}s" if len(new) > 1 else f"a {what}"
            said.append(f"{levels} of {listed(number(x, 2) for x in new)} {unit}")
    return said


def _odds(odds: float) -> str:
    return "over 1e12" if odds >= 0.99 * _MOST_ODDS else f"{odds:.0e}".replace("e+0", "e").replace("e+", "e")
