"""What is shown, and by what: `python -m tests.proof.results [proof.json]` makes RESULTS.md of results.toml.

Commands that measure hand over their figures, which are taken where the environment's RECORD is set, as by
`make bench-plant RECORD=1`. A proof that has run before is taken by its proof.json. Knows nothing of how is measured.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from tests.proof.proof import Bar

DATA: Final = Path(__file__).with_name("results.toml")
PAGE: Final = Path(__file__).with_name("RESULTS.md")
PARTS: Final = ("sealed", "two_sensors", "absorbed", "benchmark", "real", "flux_map", "alternatives")  # of all of it
MINUTES: Final = {"proof": 60.0, "quick": 5.0}  # at most
_COMPANIONS: Final = ("- ", "... ")  # how rows begin that say nothing without the one before them
_BAR: Final = re.compile(r"\{([^{}|]+)(?:\|(\w+))?\}")
_SHARE: Final = re.compile(r"([\d.]+) ?%(?: of (\d+))?")


class Row(BaseModel, extra="forbid"):
    """A figure beside what was asked for."""

    shown: str
    figure: str
    before: list[str] = []  # of the populations before this one
    note: str = ""  # by hand, behind the figure
    bar: str | None = None
    missed: str | None = None  # where it is: by how much, in words
    command: str | None = None
    measured: str = ""  # the figure, by bars of the proof: "{sealed: no effect: a false name|count} recordings"
    by_hand: bool = False


class Results(BaseModel, extra="forbid"):
    """All of the page. `page` has a line `{table}` for each of the tables' rows, or for those that are missed."""

    seeds: list[int]  # of the populations, the latest first
    commit: str  # of the library that was proved
    page: str
    rows: dict[str, dict[str, Row]]  # by table and key

    def each(self) -> Iterator[Row]:
        """All rows."""
        return (row for rows in self.rows.values() for row in rows.values())


class Part(BaseModel):
    """A part of the proof, in proof.json."""

    name: str
    bars: list[Bar] = []


class Proved(BaseModel):
    """What is taken of proof.json."""

    seed: int
    quick: bool
    proofs: list[Part]
    seconds: dict[str, float]


Figure = tuple[str, bool | None]
"""As it is shown, and whether its bar is held; None: there is none, or it could not be judged."""


# --- data and page


def read() -> Results:
    """The rows as they are kept."""
    return Results.model_validate(tomllib.loads(DATA.read_text(encoding="utf-8")))


def written(results: Results) -> None:
    """Keep them, and make the page."""
    DATA.write_text(kept(results), encoding="utf-8")
    PAGE.write_text(page(results), encoding="utf-8")


def kept(results: Results) -> str:
    """As TOML."""
    head = f"seeds = {results.seeds}\ncommit = {json.dumps(results.commit)}\npage = '''\n{results.page}'''\n"
    return head + "".join(
        f"\n[rows.{table}.{key}]\n" + "".join(
            f"{name} = {json.dumps(value, ensure_ascii=False)}\n"
            for name, value in row.model_dump(exclude_defaults=True).items()
        )
        for table, rows in results.rows.items() for key, row in rows.items()
    )  # fmt: skip


def page(results: Results) -> str:
    """As Markdown."""
    tables, missed = dict[str, list[Row]](), dict[str, list[Row]]({"missed": []})
    for table, rows in results.rows.items():
        apart = "missed_sealed" if table == "sealed" else "missed"
        for together in _together(rows.values()):
            lost = any(row.missed is not None for row in together)
            (missed.setdefault(apart, []) if lost else tables.setdefault(table, [])).extend(together)
    text = results.page
    for name, listed in (tables | missed).items():
        text = text.replace(f"{{{name}}}\n", "".join(_lines(listed)))
    latest, before, earlier = results.seeds
    words = {"seed": latest, "before": before, "earlier": earlier, "next": latest + 1, "commit": results.commit}
    for name, word in words.items():
        text = text.replace(f"{{{name}}}", str(word))
    return text


def _together(rows: Iterable[Row]) -> list[list[Row]]:
    """Rows with their companions."""
    found: list[list[Row]] = []
    for row in rows:
        if found and row.shown.startswith(_COMPANIONS):
            found[-1].append(row)
        else:
            found.append([row])
    return found


def _lines(rows: Iterable[Row]) -> list[str]:
    lines, last = list[str](), ""
    for row in rows:
        figure = row.figure + (f" ({', '.join(row.before)})" if row.before else "") + row.note
        cells = [row.shown, figure]
        if row.bar is not None:
            lost = "" if row.missed is None else ", **missed**" + (row.missed and f", {row.missed}")
            cells.append(row.bar + lost)
        if row.command is not None:
            cells.append(("same" if row.command == last else row.command) + (", by hand" if row.by_hand else ""))
            last = row.command
        lines.append(f"| {' | '.join(cells)} |\n")
    return lines


# --- figures


def record(key: str, figure: str, held: bool | None = None) -> None:
    """Take a figure into the row of a key, "table.row", where that is asked for; `held`: None where there is no bar."""
    if os.environ.get("RECORD"):
        results = read()
        table, name = key.split(".")
        _taken(results.rows[table][name], (figure, held))
        written(results)


def _taken(row: Row, figure: Figure) -> None:
    text, held = re.sub(r"(\d)%", r"\1 %", figure[0]), figure[1]
    if row.missed and text != row.figure:
        row.missed = ""  # the words were about another figure
    if held is not None:
        row.missed = None if held else row.missed or ""
    row.figure = text
    print(f"recorded: {row.shown}: {text}" + (f"; see whether its note still holds: {row.note}" if row.note else ""))


def record_proof(file: Path) -> None:
    """Take what a proof says. Raises SystemExit where a part would be of another population than the rest."""
    told, results = Proved.model_validate_json(file.read_bytes()), read()
    whole = not told.quick and {part.name for part in told.proofs if part.bars} == set(PARTS)
    if not told.quick and not whole and told.seed != results.seeds[0]:
        raise SystemExit(f"a part of seed {told.seed} would stand beside seed {results.seeds[0]}: record a whole proof")
    bars = {} if told.quick else {f"{part.name}: {bar.what.strip()}": bar for part in told.proofs for bar in part.bars}
    if told.quick or whole:
        sort, minutes = "quick" if told.quick else "proof", sum(told.seconds.values()) / 60.0
        bars[f"{sort}: minutes"] = Bar("", "", f"{minutes:.1f} min", minutes <= MINUTES[sort])
    if whole:
        _moved(results, told.seed)
    for row in results.each():
        if row.measured and (figure := measured(row.measured, bars)):
            _taken(row, figure)
    written(results)


def measured(form: str, bars: Mapping[str, Bar]) -> Figure | None:
    """A row's figure by bars of the proof; None where one of them was not printed."""
    names = [name for name, _ in _BAR.findall(form)]
    if not all(name in bars for name in names):
        return None
    held = [bars[name].held for name in names if bars[name].held is not None]
    text = _BAR.sub(lambda found: _shown(bars[found[1]].figure, found[2]), form)
    return text, all(held) if held else None


def _shown(figure: str, how: str | None) -> str:
    """A bar's figure: as it is; "share", its first per cent; "count", how many of how many."""
    share = _SHARE.search(figure)
    if how is None or share is None:
        return figure
    return f"{share[1]} %" if how == "share" else f"{float(share[1]) * int(share[2]) / 100.0:.0f} of {share[2]}"


def _moved(results: Results, seed: int) -> None:
    """To another population: what was the latest is in brackets."""
    asked = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
    results.commit = asked.stdout.strip()
    if seed != results.seeds[0]:
        results.seeds = [seed, *results.seeds[:2]]
        for row in (row for row in results.each() if row.before):
            row.before = [_SHARE.sub(r"\1", row.figure.partition("; before")[0]), *row.before][:2]


if __name__ == "__main__":
    if len(sys.argv) > 1:
        record_proof(Path(sys.argv[1]))
    written(read())
