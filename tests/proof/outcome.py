"""What running the proofs gave: of each its proof, or why there is none; as text and as plain values."""

import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import Any

from tests.proof.proof import Bar, Proof, Settings

Prove = Callable[[Settings], Proof]


@dataclass(frozen=True, slots=True)
class Outcome:
    """A part of the proof, run."""

    name: str
    proof: Proof | None
    failed: str  # a sentence, where there is no proof


def run(name: str, settings: Settings) -> Outcome:
    """Run a part by the name of its module; what it raises becomes a sentence."""
    try:
        prove: Prove = import_module(f"tests.proof.parts.{name}").prove
        return Outcome(name, prove(settings), "")
    except Exception as error:  # noqa: BLE001 - one part that cannot run does not keep others from it
        why = " ".join(str(error).split()) or "no reason given"
        print("".join(traceback.format_exception(error)), file=sys.stderr, flush=True)
        return Outcome(name, None, f"{name} could not run: {error.__class__.__name__}: {why}")


def word(bar: Bar) -> str:
    """How a bar came out; where nothing was asked, nothing."""
    if bar.held is None:
        return "not judged" if bar.asked else ""
    return "held" if bar.held else "MISSED"


def text(outcome: Outcome) -> str:
    """For a terminal."""
    if outcome.proof is None:
        return outcome.failed
    proof = outcome.proof
    what, asked, figure = (max((len(each) for each in column), default=0) for column in (
        [bar.what for bar in proof.bars], [bar.asked for bar in proof.bars], [bar.figure for bar in proof.bars],
    ))  # fmt: skip
    lines = [
        f"  {word(bar):11}{bar.what:{what}}  {bar.asked:>{asked}}  {bar.figure:{figure}}".rstrip() for bar in proof.bars
    ]
    missing = [f"  missing: {proof.missing}"] if proof.missing else []
    return "\n".join([f"{proof.title} ({proof.name})", *lines, *missing])


def missed(outcomes: Sequence[Outcome]) -> list[tuple[Proof, Bar]]:
    """Bars that were not held."""
    return [(each.proof, bar) for each in outcomes if each.proof for bar in each.proof.bars if bar.held is False]


def as_json(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """All but pictures."""
    return [_plain(each) for each in outcomes]


def _plain(outcome: Outcome) -> dict[str, Any]:
    proof = outcome.proof
    if proof is None:
        return {"name": outcome.name, "failed": outcome.failed}
    return {
        "name": proof.name, "title": proof.title, "said": proof.said, "missing": proof.missing,
        "bars": [asdict(bar) for bar in proof.bars], "tables": [asdict(table) for table in proof.tables],
    }
