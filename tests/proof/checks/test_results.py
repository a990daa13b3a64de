"""RESULTS.md is what its rows make; every row has a source; what is recorded stands where it belongs."""

import json
import re
from pathlib import Path

import pytest

from tests.proof import results
from tests.proof.parts import real, sealed
from tests.proof.proof import Bar, Settings
from tests.proof.results import Row

TESTS = Path(__file__).parents[2]
KEYS = re.compile(r'(?:record|figure)\(\s*"(\w+\.\w+)"')
ASSERTED = ("`pytest ", "`make slow`", "`make test-vcan`")
SEALED = {"name": "sealed", "bars": [
    {"what": "no effect: a false name", "asked": "at most 1%", "figure": "2.5% of 80", "held": False},
    {"what": "stranger: none of these, right region", "asked": "at least 95%", "figure": "97.5% of 80", "held": True},
]}  # fmt: skip


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The page, to be written to elsewhere."""
    monkeypatch.setenv("RECORD", "1")
    (tmp_path / "data").write_bytes(results.DATA.read_bytes())
    monkeypatch.setattr(results, "DATA", tmp_path / "data")
    monkeypatch.setattr(results, "PAGE", tmp_path / "page")
    return tmp_path / "page"


def proved(folder: Path, seed: int, *parts: str) -> Path:
    """proof.json, with bars of the sealed part alone."""
    proofs = [SEALED, *({"name": part, "bars": [SEALED["bars"][0]]} for part in parts)]
    file = folder / "proof.json"
    file.write_text(json.dumps({"seed": seed, "quick": False, "proofs": proofs, "seconds": {"sealed": 1200.0}}))
    return file


def section(page: Path, title: str) -> str:
    return page.read_text(encoding="utf-8").partition(f"## {title}\n")[2].partition("\n## ")[0]


def row(key: str) -> Row:
    table, name = key.split(".")
    return results.read().rows[table][name]


def test_the_page_is_what_the_rows_make_byte_for_byte() -> None:
    kept = results.read()
    assert results.PAGE.read_bytes() == results.page(kept).encode()
    assert results.DATA.read_bytes() == results.kept(kept).encode()


def test_every_row_is_recorded_by_a_command_or_asserted_by_tests_or_marked_as_entered_by_hand() -> None:
    files = [file for file in TESTS.rglob("*.py") if file != Path(__file__)]
    recorded = {key for file in files for key in KEYS.findall(file.read_text(encoding="utf-8"))}
    rows = {f"{table}.{name}": row for table, rows in results.read().rows.items() for name, row in rows.items()}
    assert recorded <= set(rows)
    others = {key: row for key, row in rows.items() if key not in recorded and not row.measured and not row.by_hand}
    assert not [key for key, row in others.items() if row.command and not row.command.startswith(ASSERTED)]
    assert {key.split(".")[0] for key, row in others.items() if not row.command} == {"paper"}


def test_bars_that_rows_are_measured_by_are_printed_by_the_proof(tmp_path: Path) -> None:
    printed = {
        "sealed": [bar.what.strip() for bar in sealed.proof_of([], sealed.Heard([], {}, ""), "", "").bars],
        "real": [bar.what for bar in real.prove(Settings(1, True, 1, tmp_path)).bars],
    }
    for row in results.read().each():
        for part, what in re.findall(r"\{(\w+): ([^{}|]+)", row.measured):
            if part in results.PARTS:
                known = printed.get(part) or [(TESTS / "proof" / "parts" / f"{part}.py").read_text(encoding="utf-8")]
                assert any(what in each for each in known), what


def test_nothing_is_recorded_unless_it_is_asked_for(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RECORD")
    results.record("plant.speed", "1; 2; 3; 4", held=False)
    assert not copied.exists()


def test_a_bar_that_is_missed_moves_to_the_missed_ones_with_what_says_nothing_alone(copied: Path) -> None:
    results.record("service.stale", "2.50 s at most", held=False)
    results.record("estimates.auto_still", "1.2%", held=False)
    missed = section(copied, "Missed bars")
    assert "| 2.50 s at most | 1 s, **missed** | `make bench-stale` |" in missed
    assert "| ... over that of the largest window where nothing moves, 1 s; 60 s | 1.2 % |" in missed
    assert "| window chosen by the data" in missed
    assert "bench-stale" not in section(copied, "Service, links and captures")
    results.record("service.stale", "0.50 s at most", held=True)
    assert "| 0.50 s at most | 1 s | `make bench-stale` |" in section(copied, "Service, links and captures")


def test_a_whole_proof_of_another_population_moves_the_page_to_it(copied: Path, tmp_path: Path) -> None:
    parts = results.PARTS[1:]
    latest, before, _ = results.read().seeds
    with pytest.raises(SystemExit, match=f"a part of seed {latest + 1} would stand beside seed {latest}"):
        results.record_proof(proved(tmp_path, latest + 1))
    results.record_proof(proved(tmp_path, latest + 1, *parts))
    told = section(copied, "Missed bars")
    assert results.read().seeds == [latest + 1, latest, before]
    assert "| no effect: a false name | 2 of 80 (0 of 83, 0 of 78) | 1 %, **missed** |" in told
    assert f"--seed {latest + 1}`" in section(copied, "The proof")
    assert row("sealed.strangers").figure == "97.5 % of 80"
    assert row("sealed.strangers").before == ["100", "99.0"]
    assert row("parts.minutes").missed is None
    assert row("sealed.verdicts").figure == "27 of 500"  # its bar was not printed
    results.record_proof(proved(tmp_path, latest + 1, *parts))
    assert row("sealed.strangers").before == ["100", "99.0"]


def test_figures_of_the_proof_are_shares_counts_or_as_they_are() -> None:
    bars = {"a: b": Bar("b", "", "41.3% of 373", True), "a: c": Bar("c", "", "none of 0", None)}
    assert results.measured("{a: b|share}, {a: b|count}; {a: c|count}", bars) == ("41.3 %, 154 of 373; none of 0", True)
    assert results.measured("{a: d}", bars) is None
