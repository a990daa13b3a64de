"""Exchange: other sets of effects for one that is found step by step, where equations bend.

A search adds what explains most where the equations are lines, at shapes to begin with. Beyond their bend one effect
may explain what two do there: a loss that lags looks like a resistance that rises with frequency and an offset of the
voltage. And what another explains may be this one's at a shape in between. And an angle that is off and saturations
make up for each other: none of them alone leads to the set. Knows nothing of verdicts.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS, MOST_EFFECTS, Choice, Search, is_freer, one_cause
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import at_an_end, unconfounded
from estimator.diagnosis.likelihood.thinning import in_parts
from estimator.diagnosis.search.fitting import Fitted, closely, exchanged, fitted, of_model, with_more, without
from estimator.diagnosis.search.remainder import ROUNDED, TRADES, by_chance, excess_of, hidden_of, leaves_some
from estimator.physics.angle_sensing import AngleError
from estimator.physics.library import BY_NAME, LIBRARY
from estimator.physics.rows import Rows
from estimator.twin.model import zero_residual

_WORTH_MORE: Final = 2.0  # times what several effects leave: more, and the one is not worth what others may add to it
_AS_MUCH: Final = 0.75  # of what several effects explain, that one has to explain before its equation bends
_ALL_BUT: Final = 0.1  # of what one effect explains, that another may explain less at a shape to begin with
_BEYOND_BENT: Final = 0.5  # the same of two that bend and look like the machine's parameters
_ALIKE: Final = 2  # pole pairs: an encoder's second order is one of an electrical turn
_BENDING: Final = tuple(effect.name for effect in LIBRARY if effect.bends)
"""Effects that make up for each other, and for the machine's parameters."""


def all_saturations_at_once(rows: Rows, found: Fitted, given: Given) -> Fitted:
    """The fit, or one that begins with all saturations and an angle's offset at once, and leaves less.

    It is asked for where more than noise is left, or a parameter of the machine is beyond its tolerance. Where an
    effect is not needed then, others may show that it had stood for.
    """
    if not (_leaves_more(found) or _has_beyond(found, given)):
        return found
    other = with_more(found, _not_there_yet(found), given)
    if excess_of(other) >= excess_of(found) or len(other.choice) > MOST_EFFECTS:
        return found
    other = closely(other, given)
    by_rounding = excess_of(found) - excess_of(other) < hidden_of(found)
    if by_rounding and _has_beyond(other, given) and not _has_beyond(found, given):
        return found
    if set(found.model.effects) <= set(other.model.effects):
        return other
    return min(other, fitted(rows, given, begin=other.model), key=excess_of)


def _not_there_yet(found: Fitted) -> list[str]:
    """Effects that bend, of the forms of one that which is there, or the first."""
    names = dict.fromkeys(found.model.effects)
    for name in _BENDING:
        if name not in names and not any(one_cause((name, 0), (other, 0)) for other in names):
            names[name] = None
    return [name for name in names if name not in found.model.effects]


def begun_without_freer(rows: Rows, found: Fitted, given: Given) -> Fitted:
    """The fit, or one that begins without the freer forms of it, where more than noise is left, and leaves less.

    A course of six shares takes the place of a drift and a step at once, and hides either.
    """
    freer = {name for name, _ in found.choice if is_freer(name)}
    if not freer or not _leaves_more(found):
        return found
    begin = fitted(rows, given, library=[effect for effect in LIBRARY if effect.name not in freer])
    if excess_of(begin) >= excess_of(found):
        return found
    return min(fitted(rows, given, begin=begin.model), found, key=excess_of)


def with_undone(rows: Rows, found: Fitted, given: Given) -> Fitted:
    """The fit, or one with what an effect of it is there to undo, which leaves less: alone neither leads to both.

    It is asked for where more than noise is left.
    """
    choice = found.choice
    for name in dict.fromkeys(BY_NAME[name].undoes for name, _ in choice):
        seeds = [one for one in found.search.candidates() if one[0] == name and one not in choice]
        if not seeds or name in found.model.effects or not _leaves_more(found):
            continue
        one = max(seeds, key=lambda each: found.search.fit((*choice, each)).log_evidence)
        begin = exchanged(found, [], one, given)
        if name in begin.model.effects and excess_of(begin) < excess_of(found) - 2.0 * ENTRY_LOG_ODDS:
            found = min(fitted(rows, given, begin=begin.model), begin, key=excess_of)
    return found


def without_idle(found: Fitted, given: Given) -> Fitted:
    """The fit without effects that bend and whose place the machine's parameters take: without them no more is left.

    Where the equations are lines they do explain, but only around a machine that has made room for them.
    """
    for name in [name for name, _ in found.choice if BY_NAME[name].bends]:
        other = without(found, [name], given)
        if excess_of(other) <= excess_of(found):
            found = other
    return found


def _leaves_more(found: Fitted) -> bool:
    """Than noise, and than rounding of the angle."""
    return leaves_some(found) and excess_of(found) > hidden_of(found)


def _has_beyond(found: Fitted, given: Given) -> bool:
    return not all(given.within(name, getattr(found.model.machine, name)) for name in given.told)


class Exchanged(NamedTuple):
    """What exchanges have led to."""

    found: Fitted
    at_best: Mapping[tuple[str, str], float]  # log-odds of an effect over another at that one's best shapes


def replaced_by_one(rows: Rows, found: Fitted, given: Given) -> Exchanged:
    """The fit, or one that leaves less with no more effects, or as much with fewer: others may show where one stands in
    for several. What a freer form of a cause hid comes to light beside a simpler one, and has to bring its due.

    What explains no more than rounding of the angle may leave stands for nothing, and nothing is tried in its place. Of
    two effects that bend and look like the machine's parameters, what rounding of the angle may leave and equations
    may miss is lent to the first; then the one is taken whose machine is as its data sheet says.
    """
    here, at_best, as_told = excess_of(found), dict[tuple[str, str], float](), list[Fitted]()
    hidden, trading = hidden_of(found), _trading(found)
    less, lent = 2.0 * ENTRY_LOG_ODDS + ROUNDED * hidden, hidden + found.search.discrepancy(found.choice)
    above_noise = here > hidden + by_chance(rows)
    instead, forms = _instead(found.search, found.choice, trading), list[tuple[Choice, tuple[str, int]]]()
    if above_noise or _has_beyond(found, given):
        forms = _in_other_forms(found)
    if rows.machine.n_p <= _ALIKE or above_noise:
        forms += _other_angles(found)
    told = {one for one in found.choice if found.search.explained(found.choice, one) > hidden}
    instead, forms = ([each for each in some if told.intersection(each[0])] for some in (instead, forms))
    few, of_sum = (_by_few_rows(rows, found, given), _left_of_sum(found, found)) if instead or forms else (found, 0.0)
    for dropped, one in (*instead, *forms):
        if few is not found and (worse := _clearly_worse(few, dropped, one, given)) > 0.0:
            if len(dropped) == 1 and one[0] != dropped[0][0]:
                at_best[dropped[0][0], one[0]] = 0.5 * max(worse * len(rows) / len(few.rows) - lent, 0.0)
            continue
        begin = exchanged(found, [name for name, _ in dropped], one, given)
        if one[0] not in begin.model.effects:
            continue
        there = excess_of(begin)
        if len(dropped) == 1 and len(begin.choice) == len(found.choice):
            more, both = there - here, dropped[0][0] in trading and one[0] in _trading(begin)
            both |= (dropped, one) in forms
            if both and -less < more < lent and _has_beyond(found, given) and not _has_beyond(begin, given):
                as_told.append(begin)
            if one[0] != dropped[0][0]:  # what may be lent makes nothing likelier than it is
                more = max(more - lent, 0.0) if both and more > 0.0 else more
                at_best[dropped[0][0], one[0]] = 0.5 * (more + _left_of_sum(begin, found) - of_sum)
        due = max(found.search.due_of_freer(found.choice, each, one) for each in dropped)
        if there > (_WORTH_MORE * here if len(dropped) > 1 else here + due if due else here - less):
            continue
        other = min(fitted(rows, given, begin=begin.model), begin, key=excess_of)
        fewer = len(found.choice) - len(other.choice)
        if (fewer >= 0 or due) and excess_of(other) < here + due + 2.0 * ENTRY_LOG_ODDS * fewer:
            return Exchanged(other, {})
    return Exchanged(min(as_told, key=excess_of), {}) if as_told else Exchanged(found, at_best)


def _by_few_rows(rows: Rows, found: Fitted, given: Given) -> Fitted:
    """The fit by few of the rows; itself where they are not many more."""
    part = in_parts(rows)[0]
    return found if part is rows else of_model(part, found.model, given, LIBRARY)


def _clearly_worse(few: Fitted, dropped: Choice, one: tuple[str, int], given: Given) -> float:
    """Chi square by which few of the rows leave clearly more with one in the place of others; 0 where they may not."""
    other, here = exchanged(few, [name for name, _ in dropped], one, given), excess_of(few)
    if one[0] not in other.model.effects:
        return 0.0
    most = _WORTH_MORE * max(here, by_chance(few.rows)) if len(dropped) > 1 else here
    due = max(few.search.due_of_freer(few.choice, each, one) for each in dropped)
    worse = excess_of(other) - most
    return worse if worse > due + 2.0 * ENTRY_LOG_ODDS + hidden_of(few) else 0.0


def _left_of_sum(other: Fitted, found: Fitted) -> float:
    """Chi square that a fit leaves of the sum of three currents, over a fit's noise; none where it is not known."""
    left = zero_residual(other.rows, other.smooth.with_machine(other.model.machine), other.model)
    return 0.0 if left is None else float(left @ left) / found.noise[2] ** 2


def _trading(found: Fitted) -> list[str]:
    """Effects of a fit that bend and look like the machine's parameters."""
    shares = unconfounded(found.search, found.choice)
    return [name for name, share in shares.items() if name in _BENDING and share < TRADES]


def _instead(search: Search, choice: Choice, trading: Sequence[str]) -> list[tuple[Choice, tuple[str, int]]]:
    """Effects of a set, and the one, at its likeliest shapes, that may stand in their place. `trading`: those that bend
    and look like the machine's parameters.

    In the place of several, one that they are confused with; in that of one alone, one whose equation bends; in that of
    one at the end of what is plausible, itself at other shapes.
    """
    full, found = search.fit(choice).chi2, list[tuple[Choice, tuple[str, int]]]()
    present, candidates = {name for name, _ in choice}, search.candidates()
    for name in dict.fromkeys(name for name, _ in candidates if name not in present):
        alike = tuple(one for one in choice if name in _confused(one[0]) or one[0] in _confused(name))
        tried = [(alike, 1.0 - _AS_MUCH)] * (len(alike) > 1)
        worth = {one: _BEYOND_BENT if one[0] in trading and name in _BENDING else _ALL_BUT for one in choice}
        tried += [((one,), most) for one, most in worth.items()] * _is_bending(name)
        for dropped, most in tried:
            rest = tuple(one for one in choice if one not in dropped)
            left = {one: search.fit((*rest, one)).chi2 for one in candidates if one[0] == name}
            one = min(left, key=lambda each: left[each])
            if left[one] - full < most * (search.fit(rest).chi2 - full):
                found.append((dropped, one))
    for one in (each for each in choice if at_an_end(search, search.fit(choice), each)):
        rest = tuple(other for other in choice if other != one)
        seeds = [other for other in candidates if other[0] == one[0] and other != one]
        if seeds:
            found.append(((one,), max(seeds, key=lambda other: search.fit((*rest, other)).log_evidence)))
    return found


def _in_other_forms(found: Fitted) -> list[tuple[Choice, tuple[str, int]]]:
    """Effects of a fit that have distinct forms, each in another: rows that one form has cleaned hide the others."""
    rows, tried = found.search.regression.smooth, list[tuple[Choice, tuple[str, int]]]()
    for name, seed in found.search.candidates():
        effect = BY_NAME[name]
        if seed < 0 or not any(p.discrete for p in effect.parameters):
            continue
        form = effect.shapes(rows)[seed]
        for one in found.choice:
            sizes = found.model.effects[one[0]]
            present = tuple(x for x, p in zip(sizes, BY_NAME[one[0]].parameters, strict=True) if p.shape)
            if (name == one[0] and form != present) or one_cause(one, (name, seed)):
                tried.append(((one,), (name, seed)))
    return tried


def _other_angles(found: Fitted) -> list[tuple[Choice, tuple[str, int]]]:
    """Errors of the angle that look like one of a fit, in its place: they turn all voltages, and are no lines."""
    present = [one for one in found.choice if isinstance(BY_NAME[one[0]], AngleError)]
    others = [
        other for other in found.search.candidates()
        if isinstance(BY_NAME[other[0]], AngleError) and other[0] not in found.model.effects
    ]  # fmt: skip
    return [
        ((one,), other) for one in present for other in others
        if one[0] in _confused(other[0]) or other[0] in _confused(one[0])
    ]


def _is_bending(name: str) -> bool:
    """By shapes that move in small steps, or as one of those that make up for each other."""
    return name in _BENDING or BY_NAME[name].moves


def _confused(name: str) -> tuple[str, ...]:
    return BY_NAME[name].confused_with
