"""The outcome of one recording: what was said of it, in a line, and whether it is right."""

from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, Final

from tests.score.diagnosed import Said
from tests.score.pooled.population import Kept
from tests.score.poor import told
from tests.score.rows import MACHINE, row_of
from tests.score.truth import EFFECT, truth_of

BASELINE: Final = Path(__file__).with_name("baseline.tsv")
_NONE: Final = "-"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was said of one recording."""

    name: str  # seed/suite/number
    digest: str  # of the recording
    group: str  # none, one, several, stranger, near, poor
    concealed: str
    verdict: str
    found: str
    right: int  # named exactly; a stranger in its place; of poor excitation, nothing that is not there
    false: int  # names that are not there
    sizes: int  # of those that are there and named
    sizes_right: int
    machine: str  # all four parameters within 0.5 %: 1 or 0, where all are told of an exact set

    @property
    def said(self) -> str:
        """In words."""
        return f"{self.verdict}: {self.found}"


def outcome_of(kept: Kept, said: Said) -> Outcome:
    """Judged as the proof judges it."""
    suite, truth = kept.name.split("/")[1], truth_of(kept.answer)
    row = row_of(kept.name, truth, kept.answer.get("over_limit", {}), said)
    group = suite if suite != "rich" else {"two": "several", "three": "several"}.get(row.kind, row.kind)
    if suite == "poor":
        there = frozenset(EFFECT.get(name, name) for name in truth.classes)
        right = told(said, there) not in ("WRONG", "defect")
    else:
        right = row.stranger == "right" if row.kind == "stranger" else row.exact
    after = list(row.after.values())
    whole = row.exact and row.kind != "stranger" and after and None not in after
    machine = str(int(all(abs(off or 0.0) <= MACHINE for off in after))) if whole else _NONE
    return Outcome(
        kept.name, kept.digest, group, "+".join(truth.classes) or _NONE, row.verdict, "+".join(row.found) or _NONE,
        int(right), len(row.false), len(row.sizes), sum(size.right for size in row.sizes.values()), machine,
    )  # fmt: skip


def line_of(one: Outcome) -> str:
    """One line of a file, without its end."""
    return "\t".join(map(str, astuple(one)))


def outcome_in(line: str) -> Outcome:
    """From a line. Raises ValueError."""
    cells, kinds = line.split("\t"), [field.type for field in fields(Outcome)]
    if len(cells) != len(kinds):
        raise ValueError(f"expected {len(kinds)} cells, got {len(cells)}")
    values: list[Any] = [int(cell) if kind is int else cell for cell, kind in zip(cells, kinds, strict=True)]
    return Outcome(*values)


def kept_outcomes(path: Path) -> dict[str, Outcome]:
    """Those of a file, by name; a last line that is cut off is left out. None where there is no file.

    Raises ValueError.
    """
    if not path.exists():
        return {}
    found: dict[str, Outcome] = {}
    for n, line in enumerate(path.read_text(encoding="utf-8").splitlines(keepends=True), 1):
        if line.endswith("\n") and not line.startswith("#"):
            try:
                one = outcome_in(line[:-1])
            except ValueError as error:
                raise ValueError(f"{path}, line {n}: {error}") from error
            found[one.name] = one
    return found


def write_outcomes(outcomes: Mapping[str, Outcome], path: Path, heads: Iterable[str] = ()) -> None:
    """All, in the order of their names, below lines that say what they are."""
    heads = [*heads, "\t".join(field.name for field in fields(Outcome))]
    lines = [*(f"# {head}" for head in heads), *(line_of(outcomes[name]) for name in sorted(outcomes))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
