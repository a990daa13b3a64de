"""Judged: what of a fit can be told - its machine, how well it follows, and which effects get no name, and why.

What is in doubt and does not help, or what chance shows as much of, is taken away first. Knows nothing of sentences.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from estimator.arrays import Vector
from estimator.diagnosis.answer.finding import told_sizes
from estimator.diagnosis.answer.held_out import no_help, shown_held_out
from estimator.diagnosis.answer.parameters import ToldMachine, told_machine
from estimator.diagnosis.likelihood.evidence import Choice
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import UNCONFOUNDED, not_borne_out, poorly_told, unconfounded
from estimator.diagnosis.search.fitting import Fitted, without
from estimator.diagnosis.search.remainder import LIKE_RESONANCE, excess_of, restarted_from_fewer, unexplained_by
from estimator.diagnosis.search.stages import Explained
from estimator.diagnosis.trust.surrogate import Surrogates
from estimator.diagnosis.verdict import Fit, Traces, Unexplained
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows
from estimator.twin.model import residual

_NO_SIZE: Final = "what is found of it is less than its standard error"


class Judged(NamedTuple):
    """A fit that is told."""

    rows: Rows  # seen with its machine
    explained: Explained
    machine: ToldMachine
    poorly: str | None  # why the recording tells too little, where it does
    reasons: Mapping[str, Choice]  # why effects get no name
    residual: Vector  # V of each period
    fit: Fit  # on stretches that took no part in it
    pictures: Traces


def judged(rows: Rows, given: Given, there: Explained, progress: Callable[[float, str], None]) -> Judged:
    """What can be told of what explains the rows, or of what is left of it where that is in doubt."""
    while True:
        found, left, plain, resonance, again, _ = there
        rows, excess = rows.with_machine(found.model.machine), excess_of(found)
        machine = told_machine(found, plain, max(excess, 0.0) if left is not None else 0.0, given)
        poorly = poorly_told(found.search, found.choice, given.machine, list(machine.outside.values()))
        surrogates = Surrogates(found, given)
        reasons = _doubted(found, machine.unidentified, excess, resonance, surrogates.stands_out)
        faint = tuple(one for some in reasons.values() for one in some)
        progress(0.75, "simulating before and after")
        after = residual(rows, found.smooth, found.model)
        found.smooth.let_go()  # simulating works out and keeps as much again
        fit, pictures = shown_held_out(rows, found, after, plain or found.search)
        other = _undoubted(rows, found, faint, fit, given, surrogates, again) if faint else found
        if other is found:
            return Judged(rows, there, machine, poorly, reasons, after, fit, pictures)
        there = Explained(other, unexplained_by(rows, other), plain, again=True)


def _doubted(
    found: Fitted, unidentified: Sequence[str], excess: float, resonance: Unexplained | None,
    stands: Callable[[tuple[str, int], Choice, bool], bool],
) -> dict[str, Choice]:  # fmt: skip
    """Effects that get no name, by why. `stands`: one, which may be doubted, stands out from what surrogates without it
    show.
    """
    reasons = not_borne_out(found.search, found.choice, unidentified, excess, stands)
    already = [one for some in reasons.values() for one in some]
    if nothing := tuple(one for one in found.choice if one not in already and _of_no_size(found, one)):
        reasons, already = {**reasons, _NO_SIZE: nothing}, [*already, *nothing]
    losses = tuple(one for one in found.choice if one[0] in LIKE_RESONANCE and one not in already)
    return {**reasons, f"it may as well be {resonance.description}": losses} if resonance and losses else reasons


def _of_no_size(found: Fitted, one: tuple[str, int]) -> bool:
    """An effect's only size, as it would be told, is less than its standard error."""
    effect, rows = BY_NAME[one[0]], found.smooth.with_machine(found.model.machine)
    shapes = {parameter.name for parameter in effect.parameters if parameter.shape}
    sizes = [told for name, told in told_sizes(effect, rows, found, one).items() if name not in shapes]
    return len(sizes) == 1 and sizes[0].value is not None and abs(sizes[0].value) < (sizes[0].std or 0.0)


def _undoubted(
    rows: Rows, found: Fitted, faint: Choice, fit: Fit, given: Given, surrogates: Surrogates, again: bool
) -> Fitted:
    """The fit, or, where it went astray or what is in doubt does not help, one from which others may show.

    No doubt is worth telling of what surrogates without it show as much of - but where it looks like the machine's
    parameters, which are off by as much if it is there.
    """
    other = found if again else restarted_from_fewer(rows, found, given)
    if other is not found and excess_of(other) < excess_of(found):
        return other
    if no_help(found, fit):
        return without(found, [name for name, _ in faint], given)
    shares = unconfounded(found.search, found.choice)
    unlike = [one for one in faint if shares[one[0]] > UNCONFOUNDED]
    chance = [one[0] for one in unlike if surrogates.show_as_much(one, found.choice)]
    return without(found, chance, given) if chance else found
