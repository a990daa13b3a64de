"""The same drives by three sensors of phase currents and by two: what is said must not depend on it.

Of two, phase c is what the others leave, so that its noise is theirs together. Class, sizes, run and the rest of the
measuring chain are those of the drive with three.
"""

from pathlib import Path
from shutil import rmtree
from typing import Any, Final

from tests.proof.parts.sealed import Heard, heard, scored
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.score.rows import Row

_COUNT, _QUICK = 100, 2
_LENGTH: Final = 4.0  # s
_KINDS: Final = ("one", "two", "three")
_WITHIN: Final = 0.01  # of all drives, by which exact sets may differ


def prove(settings: Settings) -> Proof:
    """Make each suite, seal, diagnose, open, compare."""
    folder = settings.folder / "two_sensors"
    rmtree(folder, ignore_errors=True)
    count = _QUICK if settings.quick else _COUNT
    three, two = (_heard(folder / str(sensors), settings, count, sensors) for sensors in (3, 2))
    return proof_of(_rows(three), _rows(two), f"seed {settings.seed}")


def _heard(folder: Path, settings: Settings, count: int, sensors: int) -> Heard:
    drawn: tuple[Any, ...] = "--seed", settings.seed, "--count", count, "--length", _LENGTH, "--chain"
    asked = "--class", *_KINDS, "--current-sensors", sensors, "--workers", settings.jobs
    return heard(folder, settings.jobs, ("emulator", "conceal", *map(str, (*drawn, *asked))))


def _rows(suite: Heard) -> dict[str, Row]:
    return {row.recording: row for row in scored(suite.answers, {}, suite.said)}


def proof_of(three: dict[str, Row], two: dict[str, Row], what: str) -> Proof:
    """Exact sets of each, and where they differ. A drive that one of both cannot do as drawn is drawn anew there."""
    pairs = [(one, two[name]) for name, one in three.items() if one.classes == two[name].classes]
    gained = sum(other.exact and not one.exact for one, other in pairs)
    lost = sum(one.exact and not other.exact for one, other in pairs)
    held = abs(gained - lost) <= _WITHIN * len(pairs) if pairs else None
    exact = tuple(sum(row.exact for row in some) for some in zip(*pairs, strict=True)) if pairs else (0, 0)
    bars = (
        Bar("two current sensors against three: exact sets differ", f"at most {_WITHIN:.0%}",
            f"{abs(gained - lost) / max(len(pairs), 1):.1%} of {len(pairs)}", held),
    )  # fmt: skip
    differ = tuple(
        (one.recording, " + ".join(one.classes), _said(one), _said(other))
        for one, other in pairs if one.exact != other.exact
    )  # fmt: skip
    said = (
        f"{len(pairs)} drives of {_LENGTH:g} s, {what}, with one, two or three effects and a measuring chain drawn for "
        f"each, by three current sensors and by two: {exact[0]} and {exact[1]} exact sets; {lost} are exact by three "
        f"alone, {gained} by two alone."
    )
    tables = (Table("Exact by one of both alone", ("recording", "concealed", "by three", "by two"), differ),)
    return Proof(
        name="two_sensors", title="Two current sensors and three", said=said, bars=bars,
        tables=tables if differ else (),
    )  # fmt: skip


def _said(row: Row) -> str:
    return f"{' + '.join(row.found) or '-'} ({row.verdict})"
