"""Two libraries on the same recordings, pair by pair.

Where both say alike, nothing is learned of which is better; of the others, gained or lost is like a coin's toss if they
are as good. Q. McNemar, Note on the sampling error of the difference between correlated proportions or percentages,
Psychometrika 12, 1947, doi 10.1007/BF02295996; its exact form, by the binomial distribution.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import scipy.stats

from tests.score.pooled.outcome import Outcome
from tests.score.pooled.population import Kept
from tests.score.score import Cells

stats: Any = scipy.stats  # comes without types

GROUPS: Final = {
    "none": "no effect: no name", "one": "one effect: exact", "several": "two or three effects: exact",
    "stranger": "stranger: none of these, right region", "near": "one effect near the limit: exact",
    "poor": "poor excitation: no wrong name",
}  # fmt: skip
LOST: Final = 5.0 / 1200.0  # of all recordings, by which a count may fall: noise of the tosses


@dataclass(frozen=True, slots=True)
class Pair:
    """What was said of one recording before, and what is said now."""

    before: Outcome
    now: Outcome

    @property
    def gained(self) -> bool:
        """It was wrong, and is right."""
        return bool(self.now.right and not self.before.right)

    @property
    def lost(self) -> bool:
        """It was right, and is wrong."""
        return bool(self.before.right and not self.now.right)

    @property
    def changed(self) -> bool:
        """Another thing is said, which is as right or as wrong."""
        return not self.gained and not self.lost and self.before.said != self.now.said

    @property
    def line(self) -> str:
        """In words."""
        return f"{self.now.name} ({self.now.concealed}): {self.before.said} -> {self.now.said}"


def lacking(wanted: Sequence[Kept], before: Mapping[str, Outcome]) -> str | None:
    """Why not every recording has a kept outcome, in words; None where each has."""
    left = [one.name for one in wanted if one.name not in before or before[one.name].digest != one.digest]
    if not left:
        return None
    return f"expected a kept outcome of each of {len(wanted)} recordings, {len(left)} have none, the first is {left[0]}"


def pairs_of(before: Mapping[str, Outcome], now: Mapping[str, Outcome]) -> list[Pair]:
    """All that are said now beside what was said before. Raises ValueError where a recording is another one."""
    pairs = [Pair(before[name], now[name]) for name in sorted(now)]
    for pair in pairs:
        if pair.before.digest != pair.now.digest:
            raise ValueError(f"{pair.now.name}: its hash was {pair.before.digest}, and is {pair.now.digest}")
    return pairs


def p_of(gained: int, lost: int) -> float:
    """How often as uneven a count would come by chance."""
    return float(stats.binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0


def table(pairs: list[Pair]) -> Cells:
    """By group, and of all."""
    cells: Cells = [("", "recordings", "right before", "now", "gained", "lost", "changed", "p")]
    for group, title in (*GROUPS.items(), ("", "all")):
        some = [pair for pair in pairs if group in ("", pair.now.group)]
        if some:
            gained, lost = sum(pair.gained for pair in some), sum(pair.lost for pair in some)
            cells.append((
                title, str(len(some)), str(sum(pair.before.right for pair in some)),
                str(sum(pair.now.right for pair in some)), str(gained), str(lost),
                str(sum(pair.changed for pair in some)), f"{p_of(gained, lost):.3f}",
            ))  # fmt: skip
    return cells


def others(pairs: list[Pair]) -> Cells:
    """What else is counted: false names, sizes, the machine's parameters."""
    def both(of: str) -> tuple[str, str]:
        return str(sum(getattr(pair.before, of) for pair in pairs)), str(sum(getattr(pair.now, of) for pair in pairs))

    exact = [pair for pair in pairs if pair.before.machine in "01" and pair.now.machine in "01"]
    machines = [str(sum(int(one.machine) for one in side)) for side in
                ([pair.before for pair in exact], [pair.now for pair in exact])]  # fmt: skip
    return [
        ("", "before", "now"), ("false names", *both("false")),
        ("sizes told of effects that are there", *both("sizes")),
        ("  of these right", *both("sizes_right")),
        (f"machines within 0.5 %, of {len(exact)} exact in both", *machines),
    ]  # fmt: skip


def falls(pairs: list[Pair]) -> bool:
    """More is lost than the tosses would."""
    return sum(pair.lost for pair in pairs) - sum(pair.gained for pair in pairs) > LOST * len(pairs)
