"""`pmsm-bench diagnose`: what it says, writes and refuses, for one recording and for many."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pyarrow
import pyarrow.parquet
import pytest

from bench.diagnoses.published import schema
from bench.machine_file import load_machine
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from tests.bench.cli.test_replay import pmsm_bench
from tests.bench.diagnoses.test_worker import alive, children
from tests.conftest import COMMAND
from tests.support.diagnoses import EXPLAINED

pytestmark = pytest.mark.thorough

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet
validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]

MACHINE = """[machine]
R_s = 0.97
L_d = 4.2e-3
L_q = 6.3e-3
psi_f = 0.118
n_p = 4
[drive]
T_s = 1e-4
"""
BY_NAME = [sys.executable, "-c", "import bench.cli.commands.files.diagnose as d\n"
           "d.WORK = 'tests.support.diagnoses:work'\nfrom bench.cli.main import main; main()"]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to be in, with a machine file, where diagnoses go by the names of files."""
    monkeypatch.setattr("bench.cli.commands.files.diagnose.WORK", "tests.support.diagnoses:work")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "m.toml").write_text(MACHINE, encoding="utf-8")
    return tmp_path


def test_a_recording_of_the_emulated_drive_is_diagnosed_to_the_same_bytes_every_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = [*COMMAND, "diagnose", "run.parquet", "--nominal", "m.toml"]
    pq.write_table(pa.table(dict(VirtualDrive(PAPER).record(20_000))), "run.parquet")
    Path("m.toml").write_text(MACHINE, encoding="utf-8")
    said = set[tuple[int, str, str]]()
    for k in range(2):
        done = subprocess.run(
            [*command, "--json", f"{k}.json", "--report", f"{k}.html"],
            capture_output=True, text=True, timeout=120, check=False,
        )
        compiled = "pmsm-bench: compiling, once: most of a minute\n"  # by whoever is the first
        assert not k or compiled not in done.stderr
        said.add((done.returncode, done.stdout, done.stderr.replace(compiled, "")))
    ((code, text, error),) = said
    assert error == ""
    content = json.loads(Path("0.json").read_text(encoding="utf-8"))
    validate(content, schema())
    codes = {"no_mismatch": 0, "explained": 0, "unexplained": 1, "partly_explained": 1}
    assert code == codes.get(content["verdict"], 3)
    assert content["sentence"] in text
    for ending in ("json", "html"):
        assert Path(f"0.{ending}").read_bytes() == Path(f"1.{ending}").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "0.html", "0.json", "1.html", "1.json", "m.toml", "run.parquet",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "code"),
    [("explained", 0), ("no_mismatch", 0), ("ambiguous", 3), ("unexplained", 1), ("nothing_told", 3), ("refused", 2),
     ("broken", 70), ("dies", 70)],
)  # fmt: skip
def test_the_exit_code_is_the_verdict(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, code: int
) -> None:
    assert pmsm_bench("diagnose", f"{name}.csv", "--nominal", "m.toml", monkeypatch=monkeypatch) == code
    said = capsys.readouterr()
    assert said.err.count("\n") == (code in (2, 70))
    assert code not in (2, 70) or said.err.startswith(f"pmsm-bench: {name}.csv: ")
    if name == "broken":
        details = Path(said.err.rpartition(" the details are in ")[2].strip())
        assert "in work" in details.read_text(encoding="utf-8")
        details.unlink()


def test_a_named_effect_fails_where_that_is_asked_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, code in (("explained", 1), ("no_mismatch", 0), ("ambiguous", 3), ("unexplained", 1)):
        options = ("--nominal", "m.toml", "--fail-on", "explained")
        assert pmsm_bench("diagnose", f"{name}.csv", *options, monkeypatch=monkeypatch) == code
    capsys.readouterr()
    options = ("--nominal", "m.toml", "--fail-on", "rain")
    assert pmsm_bench("diagnose", "explained.csv", *options, monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == "pmsm-bench: --fail-on: expected unexplained or explained, got 'rain'\n"


@pytest.mark.parametrize(
    ("names", "code"),
    [(["no_mismatch", "ambiguous"], 3), (["ambiguous", "unexplained"], 1), (["unexplained", "refused"], 2),
     (["refused", "dies"], 70)],
)  # fmt: skip
def test_of_several_files_the_worst_counts(
    folder: Path, monkeypatch: pytest.MonkeyPatch, names: list[str], code: int
) -> None:
    files = [f"{name}.csv" for name in names]
    assert pmsm_bench("diagnose", *files, "--nominal", "m.toml", monkeypatch=monkeypatch) == code


def test_it_says_sentence_findings_and_figures_before_and_after(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--nominal", "m.toml", "--trust", "R_s=20%,L_d=0.05")
    assert pmsm_bench("diagnose", "explained.csv", *options, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"explained.csv: explained\n{EXPLAINED.sentence}\n")
    rows = [" ".join(line.replace("│", " ").split()) for line in said.splitlines()]
    for row in (
        "inverter voltage error dead time 2.000 ± 0.059 us over 1e12 where a phase current changes sign",
        "d-axis saturation L_d drop 12.00 ± 0.78 % 250 at high i_d", "u, one step 2.69 V 0.400 V 0.390 V",
        "i, free run 310 mA 12.0 mA", "R_s 2430 ± 39 mohm 966.80 ± 0.78 mohm",
        "errors on stretches that took no part in the fit",
        "the currents' converter clips at 24 A in 12 rows", "trust {'R_s': 0.2, 'L_d': 0.05}",
    ):
        assert row in rows, said
    pmsm_bench("diagnose", "ambiguous.csv", "--nominal", "m.toml", monkeypatch=monkeypatch)
    said = capsys.readouterr().out
    assert "iron loss or winding resistance drift? they are collinear to 0.99 here" in said
    assert said.count("record 500 and 2000 rpm at the same currents") == 1


def test_what_the_sentence_says_is_not_said_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pmsm_bench("diagnose", "doubtful.csv", "--nominal", "m.toml", monkeypatch=monkeypatch) == 3
    said = capsys.readouterr().out
    assert "Cannot tell iron loss from drift of the winding's resistance: they are collinear to 0.99 here" in said
    for once in ("they are collinear", "ecord 500 and 2000 rpm at the same currents"):
        assert said.count(once) == 1, said


def test_a_convention_alone_has_no_figures_before_it_was_undone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pmsm_bench("diagnose", "convention.csv", "--nominal", "m.toml", monkeypatch=monkeypatch) == 0
    rows = [" ".join(line.replace("│", " ").split()) for line in capsys.readouterr().out.splitlines()]
    assert "u, one step – 16.5 V 16.4 V" in rows
    assert "i, free run – 12.0 mA" in rows


def test_many_recordings_are_many_diagnoses_told_in_their_order_and_a_bad_one_stops_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "suite").mkdir()
    names = ["explained1", "refused", "no_mismatch", "dies", "explained2", "nothing_told", "lacks"]
    for name in names[:-1]:
        (folder / "suite" / f"{name}.toml").write_text(MACHINE, encoding="utf-8")
    files = [f"suite/{name}.csv.gz" for name in names]
    outputs = ("--json", "js", "--report", "r-{stem}.html", "--machine", "machines/")
    for jobs, nominal in (("1", "suite/{stem}.toml"), ("3", "suite")):
        options = ("--nominal", nominal, "--jobs", jobs, "--force", *outputs)
        assert pmsm_bench("diagnose", *files, *options, monkeypatch=monkeypatch) == 70
        said = capsys.readouterr()
        assert [line.partition(":")[0] for line in said.out.splitlines() if line.startswith("suite/")] == [
            f"suite/{name}.csv.gz" for name in ("explained1", "no_mismatch", "explained2", "nothing_told")
        ]
        assert said.out.splitlines()[-1] == (
            "7 recordings: 3 refused, 2 explained, 1 no mismatch, 1 not enough excitation"
        )
        assert "no machine file: nothing could be fitted" in said.out
        refused, died, lacks = said.err.splitlines()
        assert refused == "pmsm-bench: suite/refused.csv.gz: expected another name"
        assert died.startswith("pmsm-bench: suite/dies.csv.gz: the process that worked on it ended before it was done")
        assert lacks.startswith("pmsm-bench: suite/lacks.csv.gz: suite/lacks.toml: cannot be read: No such file")
    assert sorted(path.name for path in (folder / "js").iterdir()) == [
        "explained1.json", "explained2.json", "no_mismatch.json", "nothing_told.json",
    ]  # fmt: skip
    assert sorted(path.name for path in (folder / "machines").iterdir()) == [
        "explained1.toml", "explained2.toml", "no_mismatch.toml",
    ]  # fmt: skip
    assert len(list(folder.glob("r-*.html"))) == 4
    assert load_machine(folder / "machines" / "explained2.toml").effects["d_axis_saturation"]["L_d_drop"] == 0.12
    validate(json.loads((folder / "js" / "explained1.json").read_text(encoding="utf-8")), schema())


def test_what_is_there_is_written_over_by_force_only(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "out.json").write_text("mine", encoding="utf-8")
    options = ("explained.csv", "--nominal", "m.toml", "--json", "out.json")
    assert pmsm_bench("diagnose", *options, monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == "pmsm-bench: --json: out.json exists already, expected a new file\n"
    assert (folder / "out.json").read_text(encoding="utf-8") == "mine"
    assert pmsm_bench("diagnose", *options, "--force", monkeypatch=monkeypatch) == 0
    assert json.loads((folder / "out.json").read_text(encoding="utf-8"))["verdict"] == "explained"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.csv", "--nominal", "absent.toml"], "absent.toml: cannot be read: No such file or directory"),
        (["a.csv", "--nominal", "m.toml", "--trust", "R_s=20"], "trust: R_s: expected per cent, such as 20%"),
        (["a.csv", "--nominal", "m.toml", "--jobs", "0"], "--jobs: expected at least 1, got 0"),
        (["a.csv", "--nominal", "m.toml", "--map", "u_q"], "--map: expected NAME=COLUMN[,...], got 'u_q'"),
        (["a.csv", "--nominal", "m.toml", "--json", "a.csv"], "a.csv: expected a file of its own, this is a recording"),
        (["a.csv", "--nominal", "m.toml", "--machine", "m.toml", "--force"], "m.toml: expected a file of its own, "),
        (["a.csv", "--nominal", "m.toml", "--json", "o", "--report", "o"], "o: expected a file of its own, this is an"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--json", "o.json"], "need a folder or a name with {stem}, got"),
        (["a.csv", "b/a.csv", "--nominal", "m.toml", "--json", "o"], "own, this is another output"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--json", "m.toml/x"], "cannot be written: Not a directory"),
        (["a.csv", "--format", "x"], "--format: expected one of auto, "),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_sentence_before_any_work(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert pmsm_bench("diagnose", *arguments, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith("pmsm-bench: ")
    assert error.count("\n") == 1
    assert said in error


def test_an_output_that_cannot_be_written_is_told_and_stops_no_other(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ("explained.csv", "no_mismatch.csv", "--nominal", "m.toml", "--json", "{stem}/o.json")
    (folder / "explained").mkdir()
    assert pmsm_bench("diagnose", *files, monkeypatch=monkeypatch) == 2
    said = capsys.readouterr()
    assert said.err == "pmsm-bench: no_mismatch.csv: no_mismatch/o.json: cannot be written: No such file or directory\n"
    assert (folder / "explained" / "o.json").is_file()


@pytest.mark.parametrize(
    ("out", "why"),
    [("absent/x", "No such file or directory"), ("x" * 300, "File name too long"), ("m.toml/x", "Not a directory")],
    ids=["no folder", "a long name", "no folder but a file"],
)
def test_an_output_that_cannot_be_written_is_told_before_the_recording_is_worked_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], out: str, why: str
) -> None:
    options = ("--nominal", "m.toml", "--json", out)
    assert pmsm_bench("diagnose", "endless.csv", *options, monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == f"pmsm-bench: endless.csv: {out}: cannot be written: {why}\n"


@pytest.mark.parametrize(
    ("name", "out", "said"),
    [("explained", "/dev/full", "/dev/full: cannot be written: No space left on device"),
     ("homeless", "out/x.json", "out/x.json: cannot be written: No such file or directory"),
     ("overtaken", "out.json", "out.json exists already, expected a new file")],
    ids=["disk full", "folder gone", "name taken"],
)  # fmt: skip
def test_a_verdict_is_told_also_where_its_output_cannot_be_written_after_all(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, out: str, said: str
) -> None:
    (folder / "out").mkdir()
    options = ("--nominal", "m.toml", "--json", out, "--report", "r.html")
    assert pmsm_bench("diagnose", f"{name}.csv", *options, monkeypatch=monkeypatch) == 2
    shown = capsys.readouterr()
    assert shown.out.startswith(f"{name}.csv: explained\n{EXPLAINED.sentence}\n")
    assert shown.err == f"pmsm-bench: {name}.csv: {said}\n"
    assert (folder / "r.html").is_file()
    assert not list(folder.rglob("*.unfinished"))
    if name == "overtaken":
        assert (folder / "out.json").read_text(encoding="utf-8") == "mine"


def test_of_several_recordings_it_is_told_how_many_lack_their_files(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "full").symlink_to("/dev/full")
    files = ("explained.csv", "full.csv", "--nominal", "m.toml", "--json", "{stem}")
    assert pmsm_bench("diagnose", *files, monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().out.splitlines()[-1] == (
        "2 recordings: 2 explained; outputs of 1 cannot be written"
    )


@pytest.mark.parametrize("out", ["out", "out.json", "new/"])
def test_an_output_of_one_recording_may_be_a_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch, out: str
) -> None:
    if out != "new/":
        (folder / out).mkdir()
    options = ("--nominal", "m.toml", "--json", out)
    assert pmsm_bench("diagnose", "explained.csv", *options, monkeypatch=monkeypatch) == 0
    assert [path.name for path in (folder / out).iterdir()] == ["explained.json"]


def test_a_name_as_long_as_the_file_system_takes_is_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ("--nominal", "m.toml", "--json", "x" * 255)
    assert pmsm_bench("diagnose", "explained.csv", *options, monkeypatch=monkeypatch) == 0
    assert (folder / ("x" * 255)).is_file()


def test_a_link_that_leads_nowhere_is_taken_and_an_empty_file_is_not(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "out.json").symlink_to("elsewhere.json")
    options = ("explained.csv", "--nominal", "m.toml", "--json")
    assert pmsm_bench("diagnose", *options, "out.json", monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == "pmsm-bench: --json: out.json exists already, expected a new file\n"
    assert not (folder / "elsewhere.json").exists()
    (folder / "empty.json").touch()
    assert pmsm_bench("diagnose", *options, "empty.json", monkeypatch=monkeypatch) == 0
    assert (folder / "empty.json").stat().st_size > 0


def test_a_machine_file_whose_name_is_too_long_is_refused_in_a_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pmsm_bench("diagnose", "explained.csv", "--nominal", "x" * 300, monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == f"pmsm-bench: {'x' * 300}: cannot be read: File name too long\n"


def test_on_a_terminal_a_bar_is_below_what_is_said_and_gone_at_the_end(folder: Path) -> None:
    leader, follower = os.openpty()
    arguments = ["explained.csv", "refused.csv", "no_mismatch.csv", "--nominal", "m.toml", "--jobs", "1"]
    with subprocess.Popen(
        [*BY_NAME, "diagnose", *arguments], stdin=follower, stdout=follower, stderr=follower,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TERM": "xterm"},
    ) as process:
        os.close(follower)
        shown = b""
        with contextlib.suppress(OSError):  # the terminal's other end is closed
            while part := os.read(leader, 65536):
                shown += part
    os.close(leader)
    assert process.returncode == 2
    lines = [line.rpartition("\x1b[2K")[2] for line in shown.decode().split("\r\n")]
    assert "0/3" in shown.decode()
    for line in ("explained.csv: explained", "pmsm-bench: refused.csv: expected another name"):
        assert line in lines
    assert lines[-2] == "3 recordings: 1 explained, 1 refused, 1 no mismatch"


def test_ctrl_c_ends_it_with_its_processes_and_leaves_whole_files(folder: Path) -> None:
    with subprocess.Popen(
        [*BY_NAME, "diagnose", "explained.csv", "endless1.csv", "endless2.csv", "--nominal", "m.toml", "--jobs", "2",
         "--json", "out"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "explained.csv: explained\n"
        workers = children(process.pid)
        assert workers
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=10)
    assert (process.returncode, error) == (130, "")
    assert not any(map(alive, workers))
    assert [path.name for path in (folder / "out").iterdir()] == ["explained.json"]
