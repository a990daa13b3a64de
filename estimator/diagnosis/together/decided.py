"""Decided: which of two effects it is, where one recording cannot tell and others can.

Every recording is fitted with the one and with the other. What speaks for a set is by how much less it leaves in each,
and that L_d and L_q, which no temperature moves, and the sizes of effects are then one number in all of them. Sizes
that are not cost no more than the chance that they are alike by accident: an effect may have been switched on. How wide
a size's prior is, of which one recording may say anything, speaks for none. Knows nothing of words.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from estimator.diagnosis.together.alike import apart, one_number
from estimator.diagnosis.together.refitted import CONSTANTS, MISSED, Refitted
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS
from estimator.diagnosis.verdict import Ambiguity
from estimator.physics.effect import Sizes
from estimator.physics.library import BY_NAME


class Decision(NamedTuple):
    """What has become of a doubt."""

    effect: str  # the likelier one
    other: str
    log_odds: float
    sizes: Sizes  # of the likelier one, to begin with

    @property
    def sure(self) -> bool:
        """No doubt is left."""
        return self.log_odds > SURE_LOG_ODDS


def decided(doubt: Ambiguity, effects: Mapping[str, Sizes], fits: Sequence[Refitted]) -> Decision | None:
    """Between the two effects of a doubt, beside all others that recordings show; None where that cannot be fitted."""
    if not doubt.rivals or len(doubt.effects) != 2 or not all(name in BY_NAME for name in doubt.effects):
        return None
    sizes = {name: effects[name] if name in effects else _none_of(name, fits[0]) for name in doubt.effects}
    this, that = doubt.effects
    with_this, with_that = (
        [one.with_effects({**_without(effects, other), name: sizes[name]}) for one in fits]
        for name, other in ((this, that), (that, this))
    )
    says = sum(one.likelier_than(other) for one, other in zip(with_this, with_that, strict=True))
    says += _agree(with_this) - _agree(with_that)
    return Decision(this, that, says, sizes[this]) if says >= 0.0 else Decision(that, this, -says, sizes[that])


def _without(effects: Mapping[str, Sizes], name: str) -> dict[str, Sizes]:
    return {kept: sizes for kept, sizes in effects.items() if kept != name}


def _none_of(name: str, fit: Refitted) -> Sizes:
    """Of an effect that no recording has: none of it, at the first of its shapes."""
    effect = BY_NAME[name]
    shapes = effect.shapes(fit.found.smooth) or ((0.0,) * len(effect.parameters),)
    return effect.in_order(shapes[0])


def _agree(fits: Sequence[Refitted]) -> float:
    """Log-odds that recordings agree of what they share, against what they would if chance alone made them differ."""
    total = 0.0
    for name in CONSTANTS:
        told = [one.machine[name] for one in fits]
        spread = [(x.value, math.hypot(x.std, MISSED[name] * x.value)) for x in told if x.value is not None and x.std]
        total -= 0.5 * apart(spread)
    for name in fits[0].effects:
        each = [one.raw_sizes(name) for one in fits if name in one.effects]
        for some in zip(*each, strict=False):
            told_sizes = [(x, std) for x, std, _ in some if std > 0.0]
            total -= min(0.5 * apart(told_sizes), max(one_number([std for _, std in told_sizes], some[0][2]), 0.0))
    return total
