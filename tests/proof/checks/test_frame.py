"""The proof's frame: answers under seal, parts that fail, and what is written of the others."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import plotly.graph_objects
import pytest

from emulator.conceal.files import answer_of
from emulator.conceal.recording import Choice
from emulator.conceal.suite import Suite, make
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import Machine
from estimator.samples import Samples
from tests.proof import __main__ as proof
from tests.proof import outcome
from tests.proof.diagnosing import said_of
from tests.proof.page import page
from tests.proof.parts import near_suite, real, sealed
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.proof.seal import SEAL, SealError, opened, publish
from tests.proof.seal import sealed as put_under_seal
from tests.score.diagnosed import Said
from tests.score.oracle import Oracle
from tests.score.rows import row_of
from tests.score.truth import truth_of

pytestmark = pytest.mark.thorough

SEED = 1002
MADE_UP = Proof(
    "made_up", "A made-up proof", "One bar is held & one is not.",
    (
        Bar("held", "at least 97 %", "98.0 % of 100", True), Bar("missed <", "at most 1 %", "2.0 % of 100", False),
        Bar("shown", "", "7", None), Bar("open", "all", "none of 0", None),
    ),
    (Table("A table", ("name", "figure"), (("one & all", "1"),)),),
    (plotly.graph_objects.Figure(plotly.graph_objects.Bar(x=["</script>"], y=[1.0])),),
    "the public files",
)  # fmt: skip


def made_up(_settings: Settings) -> Proof:
    """A proof that shows what can be shown."""
    return MADE_UP


def broken(settings: Settings) -> Proof:
    """A proof that cannot run."""
    raise ValueError(f"expected a sun,\n came rain by seed {settings.seed}")


def put_in(monkeypatch: pytest.MonkeyPatch, **proofs: Callable[[Settings], Proof]) -> None:
    """Have modules of these names in tests.proof."""
    for name, prove in proofs.items():
        module = ModuleType(name)
        module.__dict__["prove"] = prove
        monkeypatch.setitem(sys.modules, f"tests.proof.parts.{name}", module)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Recordings and answers, made up."""
    recordings, answers = tmp_path / "recordings", tmp_path / "answers"
    recordings.mkdir()
    answers.mkdir()
    for name, content in (("0001.json", '{"recording": "0001"}'), ("manifest.json", "{}")):
        (answers / name).write_text(content, encoding="utf-8")
    return recordings, answers


# --- the seal


def test_sealed_answers_are_on_no_disk_until_they_are_published(folders: tuple[Path, Path], tmp_path: Path) -> None:
    recordings, answers = folders
    seal = put_under_seal(answers, recordings)
    assert {path.name for path in tmp_path.rglob("*")} == {"recordings", SEAL}
    assert len((recordings / SEAL).read_text(encoding="ascii").strip()) == 64
    assert opened(seal) == [{"recording": "0001"}]
    publish(seal, answers)
    assert sorted(path.name for path in answers.iterdir()) == ["0001.json", "manifest.json"]
    assert put_under_seal(answers, recordings).answers == seal.answers


@pytest.mark.parametrize("change", [{"0001.json": b'{"recording": "0002"}'}, {"0002.json": b"{}"}, {"0001.json": b""}])
def test_a_seal_tells_a_changed_answer(folders: tuple[Path, Path], change: dict[str, bytes]) -> None:
    recordings, answers = folders
    seal = put_under_seal(answers, recordings)
    with pytest.raises(SealError, match="expected answers of the seal"):
        opened(replace(seal, answers={**seal.answers, **change}))


def test_nothing_is_no_answer(tmp_path: Path) -> None:
    (tmp_path / "answers").mkdir()
    with pytest.raises(SealError, match="came none"):
        put_under_seal(tmp_path / "answers", tmp_path)


def looking(runs: Sequence[Samples], nominal: Machine) -> Diagnosis:
    """A diagnosis that says what its process knows: arguments, and every file from two folders above its recordings."""
    assert runs
    assert nominal.n_p >= 1
    folder = next(Path(argument) for argument in _arguments_above() if Path(argument).is_dir())
    files = sorted(path.name for path in folder.parent.rglob("*") if path.is_file())
    said = json.dumps({"files": files, "arguments": [*sys.argv, *_arguments_above()]})
    return Diagnosis(Verdict.NO_MISMATCH, said, (), (), None, {}, {}, {}, None, (), (), None)


def _arguments_above() -> list[str]:
    """Of the process that started this one."""
    return Path(f"/proc/{os.getppid()}/cmdline").read_text(encoding="utf-8").split("\0")


def test_while_the_diagnosis_runs_neither_answers_nor_seed_are_in_its_reach(tmp_path: Path) -> None:
    recordings, answers = tmp_path / "recordings", tmp_path / "answers"
    make(Suite(Choice(SEED, ("none",), (0.5, 0.5), ("servo_4nm",), 0.2), 2, recordings, answers, 1), lambda _done: None)
    seal = put_under_seal(answers, recordings)
    said = said_of(recordings, tmp_path / "said.pickle", 1, "tests.proof.checks.test_frame:looking")
    assert sorted(said) == ["0001", "0002"]
    for heard in said.values():
        assert heard.diagnosis is not None, heard.error
        known = json.loads(heard.diagnosis.sentence)
        assert set(known["files"]) == {"0001.parquet", "0001.toml", "0002.parquet", "0002.toml", SEAL}
        assert not any(str(SEED) in argument.split("/")[-1] for argument in known["arguments"])
    assert [answer["seed"] for answer in opened(seal)] == [SEED, SEED]


# --- what is shown


def test_near_the_limit_the_size_is_as_many_limits_as_its_answer_says() -> None:
    choice = Choice(SEED, ("saturation_q",), (0.0, 1.0), ("servo_4nm",), 0.5)
    there, columns, ratio = near_suite.near(choice, 1)
    assert near_suite.LOW <= ratio <= near_suite.HIGH
    assert len(columns["t"]) == there.periods
    answer = json.loads(json.dumps(answer_of(there, choice, "0001")))
    assert answer["effects"]["saturation"]["L_q_drop"]["value"] > 0.0
    assert Oracle(answer).over_limit("saturation_q") == pytest.approx(ratio, rel=0.02)


def test_rows_of_a_sealed_suite_become_bars_tables_and_pictures(tmp_path: Path) -> None:
    kinds = ("none", "iron_loss", "telegraph")
    make(Suite(Choice(SEED, kinds, (0.5, 0.5), ("servo_4nm",), 0.2), 6, tmp_path / "out", tmp_path / "in", 1),
         lambda _done: None)  # fmt: skip
    answers = opened(put_under_seal(tmp_path / "in", tmp_path / "out"))
    quiet = Said(Diagnosis(Verdict.NO_MISMATCH, "Nothing.", (), (), None, {}, {}, {}, None, (), (), None), "", 0.1)
    over_limit = {answer["recording"]: dict.fromkeys(answer["classes"], 9.0) for answer in answers}
    rows = sealed.scored(answers, over_limit, {answer["recording"]: quiet for answer in answers})
    assert rows[0] == row_of("0001", truth_of(answers[0]), over_limit["0001"], quiet)
    poor = sealed.Heard(
        [answer | {"run": "idle"} for answer in answers], {answer["recording"]: quiet for answer in answers}, ""
    )
    made = sealed.proof_of(rows, poor, "Some recordings", "ab" * 32)
    bars = {bar.what: bar for bar in made.bars}
    assert {row.classes for row in rows} == {(), ("iron_loss",), ("telegraph",)}
    assert bars["no effect: a false name"].held is True
    assert bars["stranger: forced into a name"].held is True
    assert bars["stranger: none of these, right region"].held is False
    assert bars["poor excitation: a wrong name"].held is True
    missed = next(table for table in made.tables if table.title.startswith("Misses"))
    assert {row[0] for row in missed.rows} == {row.recording for row in rows if row.classes}
    assert "sealed by SHA-256 abab" in made.said
    text = page([outcome.Outcome("sealed", made, "")], "")
    assert text.count('<div id="sealed-') == 2


def test_text_page_and_json_show_what_is_held_and_what_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put_in(monkeypatch, made_up=made_up, broken=broken)
    monkeypatch.setattr(proof, "PARTS", ("made_up", "broken", "absent"))
    status = proof.main(["--seed", str(SEED), "--out", str(tmp_path), "--only", "broken", "absent", "made_up"])
    assert status == 1
    out = capsys.readouterr().out
    assert f"broken could not run: ValueError: expected a sun, came rain by seed {SEED}\n" in out
    assert "absent could not run: ModuleNotFoundError: No module named 'tests.proof.parts.absent'" in out
    assert "  MISSED     missed <" in out
    assert "  not judged open" in out
    assert "2 bars judged, 1 missed; 2 of 3 parts could not run" in out

    shown = (tmp_path / "proof.html").read_text(encoding="utf-8")
    assert '<td class="missed">MISSED</td><td>A made-up proof</td><td>missed &lt;</td>' in shown
    assert "1 of 2 bars are held" in shown
    assert "One bar is held &amp; one is not." in shown
    assert "expected a sun, came rain" in shown
    assert "the public files" in shown
    assert '"</script>"' not in shown
    assert "src=" not in shown.partition("<script>")[0]

    content = json.loads((tmp_path / "proof.json").read_text(encoding="utf-8"))
    assert [each["name"] for each in content["proofs"]] == ["broken", "absent", "made_up"]
    assert content["proofs"][2]["bars"][1] == {
        "what": "missed <", "asked": "at most 1 %", "figure": "2.0 % of 100", "held": False,
    }  # fmt: skip
    assert content["proofs"][0]["failed"].startswith("broken could not run")
    del content["seconds"]
    proof.main(["--seed", str(SEED), "--out", str(tmp_path / "again"), "--only", "broken", "absent", "made_up"])
    again = json.loads((tmp_path / "again" / "proof.json").read_text(encoding="utf-8"))
    assert again | {"seconds": {}} == content | {"seconds": {}}


def test_misses_are_results_and_no_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put_in(monkeypatch, made_up=made_up)
    monkeypatch.setattr(proof, "PARTS", ("made_up",))
    assert proof.main(["--quick", "--out", str(tmp_path), "--only", "made_up"]) == 0
    assert json.loads((tmp_path / "proof.json").read_text(encoding="utf-8"))["seed"] == proof.QUICK_SEED


def test_the_quick_proof_never_touches_the_evaluation_population() -> None:
    assert 1000 <= proof.QUICK_SEED < 2000 <= proof.SEED < 3000


def test_real_proof_without_files_says_where_they_can_be_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(real, "REAL_DATA", tmp_path)
    nothing = real.prove(Settings(SEED, True, 1, tmp_path))
    assert "mjbots/moteus at db1a762" in nothing.missing
    assert "session60.csv" in nothing.missing
    assert {bar.held for bar in nothing.bars} == {None}
    assert page([outcome.Outcome("real", nothing, "")], "").count("mjbots/moteus") == 2


def test_an_unknown_part_is_refused() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "tests.proof", "--only", "nonsense"], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 2
    assert "nonsense" in ran.stderr
