"""Files that no command can use: one sentence each, in bounded time, and nothing that moves a terminal's cursor."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.cli.main import main
from bench.cli.terminal import one_line, visible
from bench.errors import ConfigError
from bench.files import json_of, read_bytes
from bench.machine_file import load_machine
from emulator.__main__ import main as emulate

MACHINE = "[machine]\nR_s = 0.95\nL_d = 4.1e-3\nL_q = 6.3e-3\npsi_f = 0.118\nn_p = 4\n"
FIRST, LAST = '{"ambiguous": [{"experiment": {"holds": [', "}]}}]}"
NOBODY = "canopen://virtual/nobody/5"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.chdir(tmp_path)
    Path("m.toml").write_text(MACHINE, encoding="utf-8")
    Path("a.csv").write_text("t,i_d\n0,1\n", encoding="utf-8")
    os.mkfifo("pipe")
    Path("loop").symlink_to("loop2")
    Path("loop2").symlink_to("loop")
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


def refused(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """The one sentence with which the console script refuses."""
    monkeypatch.setattr(sys, "argv", ["pmsm-bench", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    out, error = capsys.readouterr()
    assert (ended.value.code, out) == (2, "")
    assert error.startswith("pmsm-bench: ")
    assert error.count("\n") == 1
    assert "\x1b" not in error
    return error.removeprefix("pmsm-bench: ").rstrip("\n")


READERS = {
    "replay": ["replay", "FILE"], "replay by a machine": ["replay", "a.csv", "--nominal", "FILE"],
    "replay by a tuning": ["replay", "a.csv", "--method", "ekf", "--nominal", "m.toml", "--ekf", "FILE"],
    "diagnose by a machine": ["diagnose", "a.csv", "--nominal", "FILE"],
    "simulate": ["simulate", "FILE", "--machine", "m.toml"],
    "simulate by a machine": ["simulate", "a.csv", "--machine", "FILE"],
    "serve": ["serve", "--config", "FILE"], "experiment": ["experiment", "FILE", "--drive", NOBODY],
}  # fmt: skip
OUTPUTS = {
    "replay": ["replay", "a.csv", "--json", "FILE"], "diagnose": ["diagnose", "a.csv", "--json", "FILE"],
    "capture": ["capture", "--drive", NOBODY, "--out", "FILE"],
}  # fmt: skip


@pytest.mark.parametrize("name", ["pipe", "loop", "/dev/zero", ".", "no\x1b[2J", "x" * 300])
@pytest.mark.parametrize("reader", READERS.values(), ids=READERS.keys())
def test_what_is_no_file_is_refused_before_it_is_waited_for(
    reader: list[str], name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused([name if part == "FILE" else part for part in reader], monkeypatch, capsys)
    assert one_line(name) in said


@pytest.mark.parametrize("output", OUTPUTS.values(), ids=OUTPUTS.keys())
def test_an_output_in_a_loop_of_links_is_refused(
    output: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["loop" if part == "FILE" else part for part in output], monkeypatch, capsys)


def test_a_pipe_that_nobody_reads_is_said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("bench.cli.output._READER", 0.1)
    said = refused(["eds", "--out", "pipe"], monkeypatch, capsys)
    assert said == "cannot write pipe: nobody has read from this pipe within 0.1 s"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"ambiguous": 5}', "ambiguous: expected a list, got 5"),
        ("[" * 100_000, "got no JSON: brackets without end"),
        (FIRST + '{"speed_rpm": 1, "i_d": 0, "i_q": 0, "seconds": ' + f"{'9' * 400}{LAST}",
         "hold 1: seconds: expected a number"),
        ('{"ambiguous": [], "verdict": "\\u001b[2J"}', "got one that does not: it is "),
    ],
    ids=["a number", "brackets", "digits", "escapes"],
)  # fmt: skip
def test_a_diagnosis_that_is_none_is_refused_in_a_sentence(
    content: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("d.json").write_text(content, encoding="utf-8")
    assert said in refused(["experiment", "d.json", "--drive", NOBODY], monkeypatch, capsys)


def test_pole_pairs_that_are_no_number_are_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("points.csv").write_text("u_d,u_q,i_d,i_q,speed_rpm\n" + "1,2,3,4,500\n" * 9, encoding="utf-8")
    said = refused(["diagnose", "points.csv", "--set", "n_p=nan"], monkeypatch, capsys)
    assert "expected a whole number of pole pairs, 1 to 200, got nan" in said


@pytest.mark.parametrize("content", [f"R_s = {'9' * 400}", f"n_p = {'9' * 400}", f"a = {'[' * 5000}", "R_s = nan"])
def test_a_machine_file_with_a_value_that_cannot_be_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(f"[machine]\n{content}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"bad\.toml: "):
        load_machine(path)


@pytest.mark.parametrize(
    "content", [f"[motor]\nR_s = {'9' * 400}", f"[motor]\nn_p = {'9' * 400}", f"[drive]\nu_dc = {'9' * 400}",
                f"a = {'[' * 5000}", f"a = {'9' * 5000}"],
)  # fmt: skip
@pytest.mark.parametrize("option", ["--scenario", "--fault-script"])
def test_the_emulated_drive_refuses_what_it_cannot_be(
    content: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(content, encoding="utf-8")
    for file in (path, tmp_path / "pipe", Path("/dev/zero"), tmp_path / "no\x1b[2J"):
        assert emulate(["--at", NOBODY, option, str(file)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "\x1b" not in error


def test_a_file_is_read_up_to_a_size(tmp_path: Path) -> None:
    (tmp_path / "long").write_bytes(b"x" * 11)
    assert read_bytes(tmp_path / "long", 11) == b"x" * 11
    with pytest.raises(OSError, match="expected at most 10 bytes, it has more"):
        read_bytes(tmp_path / "long", 10)
    with pytest.raises(ValueError, match="brackets without end"):
        json_of(b"[" * 100_000)


def test_names_are_shown_as_they_are() -> None:
    assert visible("a\x1b[2J\r[/red]:smile:\u202e\udcff\n") == "a\\x1b[2J\\r[/red]:smile:\\u202e\\udcff\n"
    assert one_line("a\nb") == "a\\nb"
