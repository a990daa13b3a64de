"""Conventions: is what looks like missing physics a recording, or a data sheet, that follows another convention?

Every hypothesis undoes what a convention may have done to the columns and fits the machine anew, roughly. Scales leave
the flux balance as closed as it was and show by the parameters' distance to the nominal ones alone; forms show by what
the balance leaves. A cause is suspected only where the recording as it stands is beyond what physics does, and where
undoing the cause brings both in order. A shift of one row is left to the library's `voltage_delay`.
"""

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.intake.causes import (
    ANGLE_ROWS,
    AS_GIVEN,
    DELAYS,
    NO_FORM,
    NO_SCALE,
    SCALES,
    WARM,
    Cause,
    Scale,
    forms,
    nominal_causes,
    speed_as,
)
from estimator.diagnosis.intake.correction import Correction
from estimator.diagnosis.intake.phase_sensors import Fault, without_fault
from estimator.diagnosis.intake.rough_fit import (
    RoughFit,
    RoughStretches,
    angle_by_speed,
    rough_fit,
    rows_of_angle,
    speed_over_rate,
    stretches_of,
)
from estimator.diagnosis.verdict import Quantity, Rival
from estimator.diagnosis.words import listed, sentence_start
from estimator.machine import PARAMETERS, Machine
from estimator.physics.convention_error import UNIT
from estimator.samples import Samples

LEAST_LOG_ODDS: Final = 6.0  # log-odds over the recording as it stands
RIVALS: Final = 5
AS_GOOD: Final = 20.0  # odds below which another cause does equally well
PER_UNIT: Final = 2.0  # the most that voltages in per unit reach
_SPEED: Final = 4.0  # log-odds against a speed column that contradicts the angle
_SAME_SPEED: Final = 0.015  # log
_BEYOND_PHYSICS: Final = 0.26  # log: 30 % on two parameters are beyond physics
_MAGNETS: Final = 0.34  # log: 40 % on psi_f alone
_HALVED: Final = 0.5  # of what the flux balance leaves: a form's due
_BY_FAR: Final = 0.25  # of the same, where the flux balance is not closed even then
_MISREAD: Final = 0.75  # times what it is, as which a dc link may be read
_LEAVES_MORE: Final = 1.1  # of what the flux balance leaves: no cause leaves more
_CLOSED_BALANCE: Final = 0.007  # of rated current: what a closed flux balance may leave
_FACTORS_APART: Final = 0.16  # log: factors that are nearer are told apart by a closed flux balance, or not at all
_RIGHT: Final = 5.0  # log-odds that may be left between the parameters and the nominal ones
_TAIL: Final = np.exp([-2.5, -12.0, -12.0, -12.0])  # of R_s, L_d, L_q, psi_f: R_s takes in what is not modelled
_CLOSED_TAIL: Final = np.exp([-4.0, -12.0, -12.0, -12.0])  # where nothing is left to be modelled: leads and warmth
_LOWER_TAIL: Final = np.exp([-12.0] * 4)  # of an R_s that is lower then, which neither makes


@dataclass(frozen=True, slots=True, eq=False)
class Suspicion:
    """A cause that is no physics, and the recording without it."""

    cause: str
    says: str  # the same in words
    sentence: str  # and what undoing it brings
    parameters: Mapping[str, Quantity]  # as in `physics.convention_error`
    runs: tuple[Samples, ...]  # corrected
    machine: Machine  # the nominal one, with the right pole pairs
    odds: float  # against the recording as it stands
    rivals: tuple[Rival, ...]  # other causes, likeliest first
    ambiguous: tuple[str, ...]  # the cause and those that do as well, in words; empty where it is certain
    rival_effects: tuple[str, ...]  # that do as well
    scale: Scale = NO_SCALE  # a part of the cause

    def contradicted(self, found: Machine, tolerance: Mapping[str, float]) -> bool:
        """The machine that is found in the corrected recording is farther from the nominal one than as recorded."""
        expected, spread = _expected(self.machine, tolerance)
        over = np.array([getattr(found, name) for name in PARAMETERS]) / expected
        corrected, recorded = (np.sum(_cost(times, spread**2)) for times in (over, over * np.array(self.scale.by)))
        return bool(corrected > recorded)


@dataclass(frozen=True, slots=True, eq=False)
class _Hypothesis:
    form: Cause
    scale: Scale
    fit: RoughFit  # of the form alone
    over_nominal: Array  # R_s, L_d, L_q, psi_f as corrected, over the nominal ones
    cost: Array  # log-odds of those
    within: bool  # all of those are within their tolerance, R_s but for warmth, or where what is missing raises it
    speed: float  # speed column over the corrected angle's rate; NaN where that cannot be told
    score: float  # log-odds, but for a constant

    @property
    def name(self) -> str:
        return self.scale.name or self.form.name

    @property
    def says(self) -> str:
        return self.scale.says or self.form.says

    @property
    def relative_std(self) -> Array:
        """Standard errors over the parameters themselves."""
        return self.fit.std / np.maximum(np.abs(self.fit.value), 1e-12)

    @property
    def in_order(self) -> bool:
        """Whether the parameters are near the nominal ones; R_s need not be.

        Within what physics does to them is enough for what is no factor: of factors another one may be the nearer.
        """
        near = bool(np.all(np.abs(np.log(np.maximum(self.over_nominal[1:], 0.02))) < _BEYOND_PHYSICS))
        return bool(np.sum(self.cost[1:]) < _RIGHT) or (near and self.no_factor)

    @property
    def no_factor(self) -> bool:
        """Nothing is multiplied by a number of which there are others that are near."""
        c = self.form.correction
        as_large = abs(abs(c.u) - 1.0) < 1e-9 and abs(abs(c.i) - 1.0) < 1e-9 and c.per_unit == 0.0
        return self.scale is NO_SCALE and as_large and self.form.pole_pairs is None

    @property
    def correction(self) -> Correction:
        """What is undone; a delay is left to the library."""
        c = Correction() if self.form in DELAYS else self.form.correction
        s = self.scale
        return replace(c, u=c.u * s.u, i=c.i * s.i, T_s=s.T_s)


def suspected(runs: Sequence[Samples], nominal: Machine, tolerance: Mapping[str, float]) -> Suspicion | None:
    """The convention that a recording follows instead of the expected one. `tolerance`: of nominal values, shares."""
    if not runs or any(run.periods != 1 for run in runs):
        return None
    stretches = stretches_of(runs)
    if stretches is None:
        return None
    hypotheses = _hypotheses(stretches, nominal, tolerance)
    stands = max((h for h in hypotheses if not h.name or h.name == "voltage_delay"), key=lambda h: h.score)
    plain = next(h for h in hypotheses if not h.name)
    best = stands
    for some in (hypotheses, [h for h in hypotheses if h.scale is NO_SCALE]):
        likeliest = _likeliest(some)
        if _explains(likeliest, stands, plain, stretches, nominal):
            best = likeliest
            break
        if not likeliest.scale.of_machine:  # beside which no factor of the recording is to blame
            break
    speed = speed_as(best.speed, nominal.n_p, _SAME_SPEED)
    if speed is not None and speed[0] == 1.0:
        speed = None
    rows = rows_of_angle(stretches) if best is stands else 0
    if best is stands and speed is None and not rows:
        return None
    made, known = best.correction, best.scale.given
    correction = replace(made, omega=made.omega if speed is None else made.omega * speed[0], theta_shift=rows)
    n_p = best.form.pole_pairs
    alike = _as_good(best, stands, hypotheses, speed, _closed(best, stretches, nominal))
    right = {name: getattr(nominal, name) / times for name, times in zip(PARAMETERS, known, strict=True)}
    return Suspicion(
        best.name if best is not stands else ANGLE_ROWS[rows].name if rows else "speed_unit",
        "; ".join(_says(best, stands, speed, rows)), _sentence(best, stands, speed, rows),
        _undone(correction, nominal, n_p), correction.undone(runs),
        replace(nominal, n_p=n_p or nominal.n_p, **right), _log_odds_over(best, stands),
        tuple(Rival(h.name, _log_odds_over(best, h)) for h in _rivals(best, stands, hypotheses)), alike,
        ("dc_link_gain",) if _read_as(best, stands) else (), best.scale,
    )  # fmt: skip


def _likeliest(hypotheses: Sequence[_Hypothesis]) -> _Hypothesis:
    """The one that scores best; of factors, one of the machine file goes before those that do no better by far."""
    best = max(hypotheses, key=lambda h: h.score)
    if best.scale is NO_SCALE or best.scale.of_machine:
        return best
    asked = [h for h in hypotheses if h.scale.of_machine and h.within and _log_odds_over(best, h) < AS_GOOD]
    return max(asked, key=lambda h: h.score, default=best)


def of_sensor(fault: Fault, runs: Sequence[Samples], nominal: Machine) -> Suspicion:
    """A phase current's sensor, which i_d and i_q are made of, as a cause: the columns tell it by themselves."""
    scale = f"{fault.name}_scale"
    return Suspicion(
        f"{fault.name}_sensor", fault.says, f"{sentence_start(fault.says)}; i_d and i_q, which are made of it, are "
        f"corrected; {fault.remedy()}.", {scale: Quantity(fault.factor, None, UNIT[scale])},
        without_fault(runs, fault), nominal, math.exp(700.0), (), (), (),
    )  # fmt: skip


def both(sensor: Suspicion, other: Suspicion) -> Suspicion:
    """A sensor, and what is suspected of the recording that it was corrected in."""
    sentences = f"{sensor.sentence} {other.sentence}"
    if other.ambiguous:
        return replace(other, sentence=sentences)
    says, parameters = f"{sensor.says}; {other.says}", {**sensor.parameters, **other.parameters}
    return replace(other, says=says, sentence=sentences, parameters=parameters, odds=sensor.odds)


def _hypotheses(stretches: RoughStretches, nominal: Machine, tolerance: Mapping[str, float]) -> list[_Hypothesis]:
    expected, spread = _expected(nominal, tolerance)
    per_unit = float(np.max(np.abs(stretches.u))) < PER_UNIT
    known = forms(
        nominal.n_p, per_unit=per_unit and stretches.u_dc is not None, by_speed=angle_by_speed(stretches)
    )  # fmt: skip
    fits = {form: rough_fit(stretches, form.correction, nominal) for form in known}
    least = max(min(f.left for f in fits.values()), 1e-30)
    scales = (*nominal_causes(nominal.n_p), *SCALES)  # of what is alike, the machine file goes first
    if per_unit and stretches.u_dc is None:
        scales = (*scales, *_base(fits[NO_FORM], nominal))
    found: list[_Hypothesis] = []
    for form, fitted in fits.items():
        closes = -stretches.count * math.log(max(fitted.left / least, 1.0))
        ratio, closed = speed_over_rate(stretches, form.correction), _is_closed(fitted, form, stretches, nominal)
        for scale in scales if form is NO_FORM or form in DELAYS else (NO_SCALE,):
            over, cost = _against_nominal(fitted, scale, expected, spread, closed=closed)
            speed = ratio / scale.T_s
            score = closes - float(np.sum(cost)) - form.prior - scale.prior - _cost_of_speed(speed, nominal.n_p)
            within = _within(over, fitted.std / (expected * np.array(scale.by)), tolerance, closed=closed)
            found.append(_Hypothesis(form, scale, fitted, over, cost, within, speed, score))
    return found


def _expected(nominal: Machine, tolerance: Mapping[str, float]) -> tuple[Array, Array]:
    """R_s, L_d, L_q, psi_f, and their relative standard deviations."""
    expected = np.array([getattr(nominal, name) for name in PARAMETERS])
    return expected, np.array([tolerance[name] for name in PARAMETERS]) / math.sqrt(3.0)


def _within(over: Array, std: Array, tolerance: Mapping[str, float], *, closed: bool) -> bool:
    """Whether parameters over the nominal ones, with their standard errors, are within their tolerance.

    R_s but for a winding's warmth, or for all that raises it where the flux balance is not closed.
    """
    least = np.array([1.0 - tolerance[name] for name in PARAMETERS])
    most = np.array([1.0 + tolerance[name] for name in PARAMETERS])
    most[0] = max(most[0], WARM) if closed else math.inf
    return bool(np.all((over + 2.0 * std >= least) & (over - 2.0 * std <= most)))


def _against_nominal(
    fitted: RoughFit, scale: Scale, expected: Array, spread: Array, *, closed: bool
) -> tuple[Array, Array]:
    """Parameters over the nominal ones, and the log-odds that their distances cost. `closed`: a flux balance."""
    by = expected * np.array(scale.by)
    over = fitted.value / by
    variance = spread**2 + (fitted.std / by / np.maximum(np.abs(over), 0.3)) ** 2
    tail = _TAIL if not closed else _CLOSED_TAIL if over[0] > 1.0 else _LOWER_TAIL
    return over, _cost(over, variance, tail)


def _cost(over: Array, variance: Array, tail: Array = _TAIL) -> Array:
    """Log-odds that parameters cost by their distances from the nominal ones, given the variance of the logarithms."""
    off = np.log(np.maximum(over, 0.02))
    return -np.log((1.0 - tail) * np.exp(-0.5 * off**2 / variance) + tail)


def _base(fitted: RoughFit, nominal: Machine) -> tuple[Scale, ...]:
    """Per unit of a dc link that is not known: of whatever makes the machine the nominal one."""
    value = fitted.value[1:]
    if np.any(value <= 0.0):
        return ()
    base = math.exp(float(np.mean(np.log(np.array([nominal.L_d, nominal.L_q, nominal.psi_f]) / value))))
    if not 2.0 * PER_UNIT < base < 2e3:
        return ()
    says = f"the voltages are in per unit of about {base:.3g} V, expected V"
    return (Scale("voltage_per_unit", says, u=1.0 / base, prior=5.0),)


def _cost_of_speed(speed: float, n_p: int) -> float:
    if math.isnan(speed) or abs(speed - 1.0) < _SAME_SPEED:
        return 0.0
    return _SPEED if speed_as(speed, n_p, _SAME_SPEED) else 2.0 * _SPEED


def _explains(
    h: _Hypothesis, stands: _Hypothesis, plain: _Hypothesis, stretches: RoughStretches, nominal: Machine
) -> bool:  # fmt: skip
    """Whether the recording as it stands is beyond what physics does, and undoing the cause brings it in order.

    plain: as it stands without a delay, which physics that is left out may look like.
    """
    leaves_more = h.fit.left > _LEAVES_MORE * max(stands.fit.left, plain.fit.left)
    if h is stands or h.score - stands.score < LEAST_LOG_ODDS or not h.in_order or leaves_more:
        return False
    if h.fit.left < _HALVED * stands.fit.left:  # which a lagging loss may do for a shift that is none
        return h.fit.left < _BY_FAR * stands.fit.left or _closed(h, stretches, nominal)
    if np.sum(stands.fit.value[1:] < -3.0 * stands.fit.std[1:]) >= 2:  # inductances or flux below zero
        return True
    off = np.abs(np.log(np.maximum(stands.over_nominal, 0.02))) - 2.0 * stands.relative_std
    if h.scale.of_machine and not h.within:
        return False
    if off[3] > _MAGNETS or (off[3] > _BEYOND_PHYSICS and np.sum(off > _BEYOND_PHYSICS) >= 2):
        return True
    # Physics that is left out may raise R_s, L_d and L_q together, but leaves a balance that is not closed
    fewest = 1 if h.scale.of_machine else 2
    far = bool(off[3] > _BEYOND_PHYSICS or np.sum(off > _BEYOND_PHYSICS) >= fewest)
    return far and _closed(stands, stretches, nominal)


def _closed(h: _Hypothesis, stretches: RoughStretches, nominal: Machine) -> bool:
    """Whether a flux balance leaves nothing, as a current, of the rated one, or of the largest there is."""
    return _is_closed(h.fit, h.form, stretches, nominal)


def _is_closed(fitted: RoughFit, form: Cause, stretches: RoughStretches, nominal: Machine) -> bool:
    L, c = max(0.5 * (abs(fitted.value[1]) + abs(fitted.value[2])), 1e-12), form.correction
    volts = c.per_unit * float(np.mean(stretches.u_dc)) if c.per_unit and stretches.u_dc is not None else 1.0
    left = math.sqrt(fitted.left) * volts / abs(c.u) * stretches.T_s / L
    return left < _CLOSED_BALANCE * (nominal.i_rated or float(np.quantile(np.abs(stretches.i), 0.999)))


def _rivals(best: _Hypothesis, stands: _Hypothesis, hypotheses: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """Other causes, likeliest first, each once."""
    found: dict[str, _Hypothesis] = {}
    for h in sorted(hypotheses, key=lambda h: -h.score):
        if best is not stands and h.score > stands.score and h.name not in (best.name, "", "voltage_delay"):
            found.setdefault(h.name, h)
    return list(found.values())[:RIVALS]


def _as_good(
    best: _Hypothesis, stands: _Hypothesis, hypotheses: Sequence[_Hypothesis], speed: tuple[float, str] | None,
    closed: bool,
) -> tuple[str, ...]:  # fmt: skip
    """The best and what does as well, in words; none where nothing does. `closed`: the best one's flux balance is."""
    if best is stands and speed is not None:  # or it is right, and the angle is not, which missing physics may hide
        right = [h for h in hypotheses if abs(h.speed - 1.0) < _SAME_SPEED and h.score - stands.score > LEAST_LOG_ODDS]
        if right:
            return _of_speed(speed), max(right, key=lambda h: h.score).says
        if abs(math.log(max(float(stands.over_nominal[3]), 0.02))) > _MAGNETS:  # by that angle it is no machine
            return _of_speed(speed), "the angle is not the electrical one in rad"
        return ()
    found = [
        h.says for h in _rivals(best, stands, hypotheses)
        if _log_odds_over(best, h) < AS_GOOD and h.in_order and _as_far(best, h)
    ]
    if not (best is stands or closed or best.scale.of_machine):  # physics that is left out moves parameters by as much
        found += [
            h.says for h in hypotheses if _factors_apart(h, best) < _FACTORS_APART and h.says not in (*found, best.says)
        ]
    if read := _read_as(best, stands):
        found.append(f"the dc link's voltage is read as {read:.2g} times what it is")
    weaker = 1.0 - stands.over_nominal[3]
    of_psi_f = best.scale.given[:3] == AS_GIVEN[:3] and best.scale.of_machine
    if (best.scale.u == best.scale.i < 1.0 or of_psi_f) and weaker > 0.0:
        found.append(f"the magnets are {weaker:.0%} weaker than the nominal ones")
    if best.scale.u == best.scale.i != 1.0:
        found.append("psi_f of the machine file alone is off by that")
    if best.scale.of_machine:
        found.append("the machine is another one")
    return (best.says, *found) if found else ()


def _as_far(best: _Hypothesis, other: _Hypothesis) -> bool:
    """Whether another cause brings all within their tolerance, where the machine file does, by impedances as it has."""
    if not best.scale.of_machine:
        return not other.scale.of_machine
    return other.within and (not other.scale.of_machine or best.scale.given[:3] == other.scale.given[:3])


def _factors_apart(h: _Hypothesis, other: _Hypothesis) -> float:
    """How far two causes that differ by factors alone are apart, log; infinite for others."""
    one, two = h.correction, other.correction
    if h.scale.of_machine or h.form in DELAYS or (one.per_unit > 0.0) != (two.per_unit > 0.0):
        return math.inf
    if replace(one, u=two.u, i=two.i, T_s=two.T_s, per_unit=two.per_unit) != two:
        return math.inf
    u, i = one.u / two.u * (two.per_unit or 1.0) / (one.per_unit or 1.0), one.i / two.i
    if abs(cmath.phase(u)) + abs(cmath.phase(i)) > 1e-9:
        return math.inf
    return max(abs(math.log(abs(u))), abs(math.log(abs(i))), abs(math.log(one.T_s / two.T_s)))


def _read_as(best: _Hypothesis, stands: _Hypothesis) -> float | None:
    """Times what it is, as which a dc link may be read in the place of a scale of the voltages."""
    read = best.scale.u if best is not stands and best.scale.i == 1.0 else 1.0
    return read if read != 1.0 and _MISREAD < read < 1.0 / _MISREAD else None


def _log_odds_over(best: _Hypothesis, other: _Hypothesis) -> float:
    """Of what a column tells by itself, where the two are one: as good as certain."""
    return math.exp(700.0 if best is other else min(best.score - other.score, 700.0))


def _says(best: _Hypothesis, stands: _Hypothesis, speed: tuple[float, str] | None, rows: int) -> list[str]:
    """What was followed instead of what is expected."""
    parts = [] if best is stands else [best.says]
    if rows:
        parts.append(f"{ANGLE_ROWS[rows].says}, as the phase currents tell")
    if speed is not None:
        parts.append(f"{_of_speed(speed)}, as the angle's rate of change tells")
    return parts


def _of_speed(speed: tuple[float, str]) -> str:
    if speed[0] == -1.0:
        return "the speed has the wrong sign"
    return f"the speed is {speed[1]}, expected electrical and in rad/s"


def _sentence(best: _Hypothesis, stands: _Hypothesis, speed: tuple[float, str] | None, rows: int) -> str:
    parts = _says(best, stands, speed, rows)
    if best is not stands:
        before, after = math.sqrt(stands.fit.left), math.sqrt(best.fit.left)
        if best.scale.of_machine:
            return f"{sentence_start('; '.join(parts))}."
        if after < 0.7 * before:
            undone = f"once that is undone, {after / before:.2g} of what the voltages left unexplained is left"
        else:
            undone = (
                f"R_s, L_d, L_q and psi_f are {listed(f'{x:.3g}' for x in stands.over_nominal)} times the nominal "
                f"ones, and {listed(f'{x:.3g}' for x in best.over_nominal)} times once that is undone"
            )
        parts[0] = f"{parts[0]}: {undone}"
    return f"{sentence_start('; '.join(parts))}."


def _undone(correction: Correction, nominal: Machine, n_p: int | None) -> dict[str, Quantity]:
    """What the correction undoes, by the names of `physics.convention_error`."""
    found: dict[str, float] = {}
    for name, vector in (("u", correction.u), ("i", correction.i)):
        angle = cmath.phase(vector)
        straight = abs(math.remainder(angle, math.pi)) < 1e-9
        scale = abs(vector) * (-1.0 if straight and vector.real < 0.0 else 1.0)
        if abs(scale - 1.0) > 1e-9:
            found[f"{name}_scale"] = scale
        if not straight:
            found[f"{name}_angle"] = angle
    c = correction
    scales = {"T_s_scale": c.T_s, "theta_scale": 1.0 if c.whole else c.theta, "omega_scale": c.omega}
    found |= {name: value for name, value in scales.items() if value != 1.0}
    others = {
        "u_shift": c.u_shift, "theta_shift": c.theta_shift, "u_base": c.per_unit, "u_mirrored": c.u_mirrored,
        "i_mirrored": c.i_mirrored,
    }  # fmt: skip
    found |= {name: float(value) for name, value in others.items() if value}
    if n_p is not None:
        found["pole_pairs"] = float(nominal.n_p)
    return {name: Quantity(value, None, UNIT[name]) for name, value in found.items()}
