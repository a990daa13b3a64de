"""Excitation check: whether the currents moved enough for what was fitted to mean anything.

Noise of a current is in the columns of L_d and L_q as well as in the voltage's residual. Where it is most of what they
hold, inductances come out low, the other parameters follow, and effects that are not there make up for it. Knows
nothing of what is recorded instead.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, cast

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.angle.angle_rounding import beat_energy, hidden_energy, left_energy
from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS, Choice, Search, SetFit
from estimator.diagnosis.words import number, percent
from estimator.machine import PARAMETERS, UNITS, Machine
from estimator.physics.library import BY_NAME

LEAST_EVIDENT_SHARE: Final = 3.0  # times what is left unexplained, that an effect in doubt has to explain
WEAK: Final = 40.0  # times the energy that noise alone gives a column: below, what lies far off is not believed
_MOVES_NOISE: Final = 2.0  # times the same, of which noise itself is one: below, nothing is told
_LENT_FACTOR: Final = 12.0  # times what noise in the columns may lend an effect: below, it is not borne out
_LEAST_ALIKE: Final = 1e-3  # of that noise's energy, whatever the effect
_ROUNDED: Final = 3.0  # times what rounding of the angle may leave
UNCONFOUNDED: Final = 2e-5  # of an effect's energy, beyond what looks like the machine's parameters, that it must have
_UNCONFOUNDED_BESIDE: Final = 2e-4  # the same, where noise or an effect may have led one of these
_DISTINCT: Final = 0.5  # the same, from which on an effect does not look like them
_UNIDENTIFIED_SHARE: Final = 0.05  # the same, that parameters may look like which are not told
_LEAST_SHARE: Final = 0.1  # of what is left unexplained: less than that is not borne out
_FAINTLY: Final = 0.05  # of all that is left: the same for faint effects
_EVEN, _UNEVEN = 3.0, 10.0  # times what chance makes of an effect's size in a stretch: below it is even, above uneven
_PLAIN_LOG_ODDS: Final = 150.0  # log-odds of an even effect, from which on nothing that is left looks like it
_UNEVENLY: Final = 0.25  # of all that is left, that an uneven effect has to explain
_LENDS: Final = 6.0  # times as much that noise and the machine lend an effect that is not even, at most
_BY_CHANCE: Final = 2.0  # standard deviations of what noise leaves above itself
_SIMULATED: Final = "a simulation without it, of the same noise and rounding, shows too much of it"
_AT_AN_END: Final = "what is found of it lies at the end of what is plausible"
_NO_CHANGE: Final = "the speed hardly changes here, and only while it does would this show"
ONE_SPEED: Final = 0.05  # of a speed, by which it may change and still be one
ONE_LEVEL: Final = 0.1  # of rated current, by which currents may change and still be of one level
_LITTLE_THERE: Final = "at one speed and one level of current so little of it looks like any other disturbance"
_ALIKE_THERE: Final = "at one speed and one level of current it looks like R_s, L_d, L_q and psi_f"
STANDING: Final = 5.0  # rad/s electrical: no slower is a speed


class Rest(NamedTuple):
    """What is left above noise and above what chance makes of it, energy over noise."""

    whole: float
    unexplained: float  # beyond the angle's rounding

    def least(self, *, faint: bool) -> float:
        """What an effect has to explain beside it."""
        return max(_LEAST_SHARE * self.unexplained, _FAINTLY * self.whole if faint else 0.0, 1e-300)


class Spurious(NamedTuple):
    """What there is beside any effect: see `beside_of`."""

    over_noise: Mapping[str, float]  # by axis, of the inductance's column
    by_beat: float  # energy over noise that the angle's rounding may lend an effect where it looks like movement
    rest: Rest


def poorly_told(search: Search, choice: Choice, nominal: Machine, outside: Sequence[str]) -> str | None:
    """What shows that this recording does not tell the machine, in a sentence's part; None where it does.

    `outside` says which parameters lie outside their tolerance.
    """
    if held := held_at_bound(search, choice):
        return at_its_bound(*held, nominal)
    axis, over_noise = least_moved(search)
    if outside and over_noise < WEAK:
        return f"i_{axis} changes by only {number(math.sqrt(over_noise), 2)} times its noise; {outside[0]}"
    return None


def at_its_bound(name: str, value: float, nominal: Machine) -> str:
    """That a parameter is held at its bound, which is no estimate, in a sentence's part."""
    given = getattr(nominal, name)
    return (
        f"{name} lies at the end of the range searched, {number(value / given, 2)} times its nominal {number(given)} "
        f"{UNITS[name]}, or beyond it"
    )


def unidentified_inductances(search: Search) -> frozenset[str]:
    """Inductances of axes on which currents move less than their noise: a fit by these currents as they are, noise too.
    """
    return frozenset(f"L_{axis}" for axis, over_noise in _over_noise(search).items() if over_noise < _MOVES_NOISE)


def least_moved(search: Search) -> tuple[str, float]:
    """The axis whose current changes least, and the energy of that over what its noise alone would give it."""
    return min(_over_noise(search).items(), key=lambda item: item[1])


def held_at_bound(search: Search, choice: Choice) -> tuple[str, float] | None:
    """A parameter of the machine that a fit holds at its bound, and its value; not one that stays within tolerance."""
    fit, within = search.fit(choice), search.regression.unidentified
    for name, value, variance in zip(PARAMETERS, fit.value, fit.covariance.diagonal(), strict=False):
        if variance <= 0.0 and name not in within and (name == "R_s" or not search.bent):
            return name, float(value)
    return None


def unconfounded(search: Search, choice: Choice) -> dict[str, float]:
    """The share of each effect's energy that does not look like the machine's parameters, least first."""
    shares = {one[0]: _share_apart(search, signal_of(search, choice, one)) for one in choice}
    return dict(sorted(shares.items(), key=lambda item: item[1]))


def like_machine(search: Search, choice: Choice) -> str | None:
    """The effect that looks most like the machine's parameters, where it is too much like them for a name: but for a
    share, or but for what rounding of the angle makes.
    """
    shares = unconfounded(search, choice)
    name = next(iter(shares), None)
    if name is None or shares[name] < _UNCONFOUNDED_BESIDE:
        return name
    one = next(each for each in choice if each[0] == name)
    rounded = shares[name] < _DISTINCT and search.explained(choice, one) < _by_angle(search)
    return name if rounded else None


def not_borne_out(
    search: Search, choice: Choice, unidentified: Sequence[str], excess: float,
    stands_out: Callable[[tuple[str, int], Choice, bool], bool],
) -> dict[str, Choice]:  # fmt: skip
    """Effects that noise of the currents alone may look like, or an encoder's rounding; by why, in a sentence's part.

    What leans on an effect that is not borne out is judged without it. `unidentified` are parameters that are not told,
    `excess` is the energy over noise that is left unexplained. Bounds say so first; an effect that does not look like
    the machine may stand out nevertheless, though doubted. Others that are not plain have to stand out, too, and beside
    a doubt as if they were doubted. So has a faint one at one speed, where what turns with the rotor and any other
    disturbance of its frequency are the same; at one level of current besides, neither it nor what looks like the
    machine is borne out.
    """
    (over_noise, _, rest), by_angle = beside_of(search, excess), _by_angle(search)
    least_apart = _least_apart(search)
    at_one_level = [name for name in unidentified if name == "R_s" or name[-1] in over_noise or len(over_noise) > 1]
    alike: Choice = ()
    found: dict[str, Choice] = {}
    if len(at_one_level) > 1:
        signals = {one: signal_of(search, choice, one) for one in choice}
        alike = tuple(
            one for one, signal in signals.items() if _share_apart(search, signal) < _DISTINCT
            and (_share_like(search, signal, at_one_level) > _UNIDENTIFIED_SHARE or not stands_out(one, choice, True))
        )  # fmt: skip
    if alike:
        found[
            f"this recording does not tell {' and '.join(at_one_level)}, and at one level effects and the machine's "
            "parameters look alike"
        ] = alike
    left, plain = tuple(one for one in choice if one not in alike), set[tuple[str, int]]()
    steady = _at_one_speed(search)
    if steady and (idle := tuple(one for one in left if BY_NAME[one[0]].while_speed_changes)):
        found[_NO_CHANGE], left = idle, tuple(one for one in left if one not in idle)
    if steady and _at_one_level(search):
        doubted, left = _untold_at_one_point(search, left)
        found |= doubted
    while weak := [one for one in left if one not in plain]:
        shares = {one: _share_apart(search, signal_of(search, left, one)) for one in weak}
        worths = {
            one: {
                "noise": _over_lent(search, signal_of(search, left, one), over_noise) / _lends(search, left, one),
                "angle": search.explained(left, one) / (by_angle * _lends(search, left, one, even=_UNEVEN)),
                "rest": _over_rest(search, left, one, rest),
                "machine": shares[one] / (least_apart * _lends(search, left, one)),
            }
            for one in weak
        }
        one = min(weak, key=lambda each: min(worths[each].values()))
        if min(worths[one].values()) > 1.0:
            break
        like_noise = worths[one]["noise"] <= 1.0 and _like_untold(search, signal_of(search, left, one))
        if worths[one]["machine"] > 1.0 and not like_noise and stands_out(one, left, True):
            plain.add(one)
            continue
        cause = min(worths[one], key=lambda name: worths[one][name])
        why = _reason(search, left, one, cause)
        found[why] = (*found.get(why, ()), one)
        left = tuple(other for other in left if other != one)
    beside_doubt = bool(found)
    for one in [each for each in left if each not in plain]:
        rest = tuple(other for other in left if other != one)
        by_chance = steady and search.faint(search.fit(left), one)
        weak = by_chance or search.gain(rest, one) < _PLAIN_LOG_ODDS
        if weak and not stands_out(one, left, beside_doubt or by_chance):
            found[_SIMULATED] = (*found.get(_SIMULATED, ()), one)
            left = rest
    fit = search.fit(choice)
    for one in left:
        rest = tuple(other for other in left if other != one)
        if at_an_end(search, fit, one) or (_ends(search, fit, one) and search.gain(rest, one) < _PLAIN_LOG_ODDS):
            found[_AT_AN_END] = (*found.get(_AT_AN_END, ()), one)
            continue
        if (distance := search.distance(fit, one)) < ENTRY_LOG_ODDS:
            errors = math.sqrt(2.0 * distance)
            why = f"what is found of it lies {number(errors, 2)} standard errors from none"
            found[why] = (*found.get(why, ()), one)
    return found


def _at_one_speed(search: Search) -> bool:
    rows = search.regression.rows
    low, middle, high = np.quantile(rows.omega_e[rows.joined], (0.02, 0.5, 0.98))
    return bool(high - low < ONE_SPEED * abs(middle))


def _untold_at_one_point(search: Search, choice: Choice) -> tuple[dict[str, Choice], Choice]:
    """Effects that one speed and one level of current do not tell, by why; and the others, which may have leant.

    Those are faint ones, and those that look like the machine.
    """
    found = dict[str, Choice]()
    while True:
        fit, shares = search.fit(choice), unconfounded(search, choice)
        faint = tuple(one for one in choice if search.faint(fit, one))
        alike = tuple(one for one in choice if one not in faint and shares[one[0]] < _DISTINCT)
        for why, ones in ((_LITTLE_THERE, faint), (_ALIKE_THERE, alike)):
            if ones:
                found[why] = (*found.get(why, ()), *ones)
        if not faint and not alike:
            return found, choice
        choice = tuple(one for one in choice if one not in (*faint, *alike))


def _at_one_level(search: Search) -> bool:
    rows = search.regression.rows
    there = rows.i[:-1][rows.joined]
    spread = max(float(np.ptp(np.quantile(axis, (0.02, 0.98)))) for axis in (there.real, there.imag))
    return spread < ONE_LEVEL * rows.i_rated


def at_an_end(search: Search, fit: SetFit, one: tuple[str, int]) -> bool:
    """A size of an effect lies at the end of its plausible range, other than at none."""
    sizes = {j: fit.value[fit.places.index(j)] for j in search.sizes_of(one)}
    return any(size != 0.0 and not search.low[j] < size < search.high[j] for j, size in sizes.items())


def _ends(search: Search, fit: SetFit, one: tuple[str, int]) -> bool:
    """A shape that noise may look like at the ends of its range lies at one."""
    ends = {parameter.name for parameter in BY_NAME[one[0]].parameters if parameter.ends}
    own = [j for j in fit.places if (search.columns[j].owner, search.columns[j].seed) == one]
    shapes = {j: fit.value[fit.places.index(j)] for j in own if search.columns[j].parameter in ends}
    return any(not search.low[j] < value < search.high[j] for j, value in shapes.items())


def _reason(search: Search, choice: Choice, one: tuple[str, int], cause: str) -> str:
    """What makes an effect worth too little, in a sentence's part."""
    varies = _scatter_of(search, choice, one) > _EVEN
    uneven = ", and its size is not the same from stretch to stretch" if varies else ""
    if cause == "angle" and search.regression.rows.hall_place is not None:
        return "how the rotor moves between the edges of its Hall sensors is not known, and may look like this"
    if cause == "angle":
        beats = beat_energy(search.regression.rows) > 0.0
        by = "each period turns the rotor by nearly whole counts of its encoder, whose rounding" if beats else (
            "what is left of the rounding of its encoder's counts"
        )
        return f"{by} may look like this"
    if cause == "machine":
        return (
            "R_s, L_d, L_q and psi_f, within their tolerance, look like all but "
            f"{percent(_share_apart(search, signal_of(search, choice, one)))} of its energy here{uneven}"
        )
    if cause == "rest":
        return f"what it explains is little beside what is left of the voltage, which nothing explains{uneven}"
    axis, least = least_moved(search)
    return (
        f"i_{axis} changes by {number(math.sqrt(least), 2)} times its noise here, and noise of the currents alone "
        f"may look like this{uneven}"
    )


def attenuated(search: Search, choice: Choice) -> Array:
    """Shape (axes, 4): how far noise in the column of L_d or L_q may have moved R_s, L_d, L_q, psi_f of a fit.

    It makes the inductance low, by its share of the column's energy, and the others make up for that. What currents
    that follow the model leave of the noise is less: this is a bound. Inductances that the recording does not tell are
    as uncertain as their tolerance anyhow.
    """
    fit = search.fit(choice)
    moved: list[Array] = []
    for axis, over_noise in _over_noise(search).items():
        place = PARAMETERS.index(f"L_{axis}")
        along, variance = fit.covariance[: len(PARAMETERS), place], float(fit.covariance[place, place])
        if variance > 0.0 and f"L_{axis}" not in search.regression.unidentified:  # not held at a bound
            moved.append(along / variance * float(fit.value[place]) / max(over_noise, 1.0))
    return np.array(moved).reshape(-1, len(PARAMETERS))


def least_borne_out(search: Search, choice: Choice, one: tuple[str, int], place: int, beside: Spurious) -> float:
    """The size (of the column at `place`) from which on a faint effect beside a set is borne out."""
    unit = np.zeros(len(search.columns))
    unit[place] = 1.0
    scatter, lends = _scatter_of(search, (*choice, one), one), _lends(search, (*choice, one), one)
    if _share_apart(search, unit) < _least_apart(search) * lends:
        return math.inf
    least = beside.rest.least(faint=True)
    if scatter < _EVEN:
        least = min(least, 2.0 * _PLAIN_LOG_ODDS * scatter)
    by_noise = lends / max(_over_lent(search, unit, beside.over_noise), 1e-300)
    return math.sqrt(max(max(least, beside.by_beat) * search.variance_of(choice, one, place), by_noise))


def beside_of(search: Search, excess: float) -> Spurious:
    """What noise, the angle's rounding and what is left may lend an effect of a search.

    `excess` is the energy over noise that is left unexplained.
    """
    rows, noise = search.regression.rows, search.regression.noise
    return Spurious(_over_noise(search), _ROUNDED * beat_energy(rows) / (noise[0] * noise[1]), _rest(search, excess))


def _by_angle(search: Search) -> float:
    """Energy over noise that the angle's rounding may lend an effect."""
    rows, noise = search.regression.rows, search.regression.noise
    return max(_ROUNDED * left_energy(rows) / (noise[0] * noise[1]), 1e-300)


def _rest(search: Search, excess: float) -> Rest:
    rows, noise = search.regression.rows, search.regression.noise
    whole = max(excess - _BY_CHANCE * math.sqrt(2.0 * len(rows)), 0.0)
    return Rest(whole, max(whole - hidden_energy(rows) / (noise[0] * noise[1]), 0.0))


def _over_rest(search: Search, choice: Choice, one: tuple[str, int], rest: Rest) -> float:
    """What an effect explains over what is too little beside the rest: a part of what is unexplained.

    Of a faint one: a part of all that is left, which may look like it whatever it is, unless its size is the same from
    stretch to stretch and plain. Of one whose size is not the same by far: some times what is unexplained, and a
    quarter of all that is left.
    """
    gained, scatter = search.explained(choice, one), _scatter_of(search, choice, one)
    least = rest.least(faint=search.faint(search.fit(choice), one))
    if scatter > _UNEVEN:
        least = max(least, LEAST_EVIDENT_SHARE * rest.unexplained, _UNEVENLY * rest.whole)
    if scatter < _EVEN:
        gain = search.gain(tuple(other for other in choice if other != one), one)
        return max(gained / least, gain / _PLAIN_LOG_ODDS)
    return gained / least


def _scatter_of(search: Search, choice: Choice, one: tuple[str, int]) -> float:
    return search.scatter(search.fit(choice), one)


def _lends(search: Search, choice: Choice, one: tuple[str, int], *, even: float = 0.0) -> float:
    """How much more noise and the machine may lend an effect whose size is not the same from stretch to stretch.

    No more, where it scatters by less than `even` times what chance makes of it.
    """
    scatter = _scatter_of(search, choice, one)
    return min(scatter, _LENDS) if scatter > even else 1.0


def signal_of(search: Search, choice: Choice, one: tuple[str, int]) -> Array:
    """Coefficients of an effect's sizes in a set, zero for all others."""
    fit = search.fit(choice)
    signal = np.zeros(len(search.columns))
    for j in search.sizes_of(one):
        signal[j] = fit.value[fit.places.index(j)]
    return signal


def _over_lent(search: Search, signal: Array, over_noise: Mapping[str, float]) -> float:
    """Energy of a signal, less what the machine's parameters make of it, over what noise of the currents may lend it.

    Noise in an inductance's column makes the inductance low, by its share of the column's energy. That leaves as much
    of the column, less what other parameters make of it; and of that, the part along the signal.
    """
    alike = _shares_by_inductance(search, signal, [f"L_{axis}" for axis in over_noise])
    lent = sum(
        max(share, _LEAST_ALIKE) * len(search.regression.rows) / max(over_noise[name[-1]], 1.0)
        for name, share in alike.items()
    )
    return product_of(search, search.base, signal, signal) / (_LENT_FACTOR * lent)


def _like_untold(search: Search, signal: Array) -> bool:
    """A signal is mostly what an inductance would make whose axis' current is noise: it stands for that noise."""
    shares = _shares_by_inductance(search, signal, sorted(search.regression.unidentified))
    return any(share > _DISTINCT for share in shares.values())


def _shares_by_inductance(search: Search, signal: Array, inductances: Sequence[str]) -> dict[str, float]:
    """By inductance, the share of a signal's energy along its column, less what the other parameters make of both."""
    columns = {name: PARAMETERS.index(name) for name in inductances}
    rest = [j for j in search.base if j not in columns.values()]
    size, found = product_of(search, rest, signal, signal), dict[str, float]()
    for name, place in columns.items():
        column = np.eye(len(signal))[place]
        both = size * product_of(search, rest, column, column)
        found[name] = min(product_of(search, rest, signal, column) ** 2 / both, 1.0) if both > 0.0 else 1.0
    return found


def _share_apart(search: Search, signal: Array) -> float:
    """Share of a signal's energy that the machine's parameters do not look like."""
    whole = float(signal @ search.gram[:-1, :-1] @ signal)
    return product_of(search, _parameters(search), signal, signal) / whole if whole > 0.0 else 1.0


def _share_like(search: Search, signal: Array, names: Sequence[str]) -> float:
    """Share of a signal's energy that some of the machine's parameters look like, and all others do not."""
    others = [j for j in _parameters(search) if search.columns[j].parameter not in names]
    whole = float(signal @ search.gram[:-1, :-1] @ signal)
    return product_of(search, others, signal, signal) / whole - _share_apart(search, signal) if whole > 0.0 else 0.0


def _parameters(search: Search) -> list[int]:
    """Columns of the machine's parameters."""
    return [j for j in search.base if search.columns[j].parameter not in ("angle", "zero")]


def _least_apart(search: Search) -> float:
    """Share of an effect's energy that has to be beyond what the machine's parameters look like."""
    return _UNCONFOUNDED_BESIDE if search.regression.unidentified else UNCONFOUNDED


def product_of(search: Search, without: Sequence[int], x: Array, y: Array) -> float:
    """Of two signals over the noise, less what some columns make of them."""
    inner = search.gram[:-1, :-1]
    A = inner[np.ix_(without, without)] + np.diag(search.weight[without])
    return float(x @ inner @ y - (x @ inner[:, without]) @ cast(Array, np.linalg.solve(A, inner[without] @ y)))


def _over_noise(search: Search) -> dict[str, float]:
    """By axis, the energy of the inductance's column over what noise of the current alone would give it.

    An axis without current does not matter as long as the motor stands.
    """
    rows = search.regression.rows
    base = search.plain().covariance
    found: dict[str, float] = {}
    for axis in "dq":
        place = PARAMETERS.index(f"L_{axis}")
        energy = 1.0 / max(float(base[place, place]), 1e-300) - float(search.weight[place])
        L = getattr(rows.machine, f"L_{axis}")
        found[axis] = max(energy, 0.0) * L**2 / len(rows)
    if float(np.quantile(np.abs(rows.omega_e[rows.joined]), 0.98)) < STANDING:
        axis = max(found, key=lambda name: found[name])
        return {axis: found[axis]}
    return found
