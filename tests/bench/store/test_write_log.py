"""The logs of writes and refusals: what they hold, how they are bounded, that they hold nobody up."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from bench.store import write_log
from bench.store.write_log import Entry, WriteLog, to_standard_error


def entry(*, done: bool = True, **more: Any) -> Entry:
    return Entry("127.0.0.1", "loopback", "PUT", "/api/drives/a/signals", 200, "done", done=done, **more)


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]


def test_what_was_done_and_what_was_refused_are_told_apart_with_all_that_is_known(tmp_path: Path) -> None:
    said = list[str]()
    with WriteLog(tmp_path / "log", said.append) as log:
        log.tell(entry(body='{"i_q_ref": 2.5}', before={"i_q_ref": 2.0}, after={"i_q_ref": 2.5}))
        log.tell(Entry("10.0.0.7", "", "POST", "/api/drives/a/stop", 403, "expected no Origin"))
    (done,) = lines(tmp_path / "log/writes.jsonl")
    assert done.pop("time").endswith("+00:00")
    assert done == {
        "who": "127.0.0.1", "by": "loopback", "method": "PUT", "path": "/api/drives/a/signals", "status": 200,
        "outcome": "done", "body": '{"i_q_ref": 2.5}', "before": {"i_q_ref": 2.0}, "after": {"i_q_ref": 2.5},
    }  # fmt: skip
    (refused,) = lines(tmp_path / "log/refused.jsonl")
    assert (refused["who"], refused["status"], refused["outcome"]) == ("10.0.0.7", 403, "expected no Origin")
    assert said == [
        'PUT /api/drives/a/signals {"i_q_ref": 2.5} from 127.0.0.1 by loopback: 200 done; i_q_ref 2.0 -> 2.5',
        "POST /api/drives/a/stop from 10.0.0.7: 403 expected no Origin",
    ]


def test_a_log_goes_on_where_it_stood(tmp_path: Path) -> None:
    for _ in range(3):
        with WriteLog(tmp_path) as log:
            log.tell(entry())
    assert len(lines(tmp_path / "writes.jsonl")) == 3


def test_refusals_that_come_too_fast_are_counted_and_push_nothing_out(tmp_path: Path) -> None:
    now = 0.0
    said = list[str]()
    with WriteLog(tmp_path, said.append, lambda: now) as log:
        for _ in range(100_000):
            log.tell(entry(done=False))
        log.tell(entry())
        now = 10.0
        for _ in range(30):
            log.tell(entry(done=False))
    assert len(lines(tmp_path / "writes.jsonl")) == 1
    refused = lines(tmp_path / "refused.jsonl")
    assert len([line for line in refused if line["status"] == 200]) == 120  # 100 at once, 2 a second
    silent = [int(line["outcome"].split()[0]) for line in refused if line["status"] == 0]
    assert sum(silent) == 100_030 - 120
    assert len(said) < 160  # a hundred at once, then a few a second


def test_a_log_is_bounded_and_keeps_the_newest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write_log, "_SIZE", 4000)
    with WriteLog(tmp_path) as log:
        for k in range(1000):
            log.tell(entry(body=f"{k}"))
    files = sorted(tmp_path.glob("writes*.jsonl"))
    assert len(files) <= 8
    assert sum(file.stat().st_size for file in files) < 8 * 4500
    kept = [int(line["body"]) for file in files for line in lines(file)]
    assert sorted(kept) == list(range(1000 - len(kept), 1000))
    assert len(kept) > 100


def test_whatever_came_an_entry_is_one_line_of_ascii(tmp_path: Path) -> None:
    said = list[str]()
    evil = "\n{}\x1b[31m\r\x00\u2028\N{SNOWMAN}\udcff"
    with WriteLog(tmp_path, said.append) as log:
        log.tell(entry(body=evil, before={evil: float("nan")}, after={evil: "x" * 5000}))
    (told,) = lines(tmp_path / "writes.jsonl")
    assert told["body"] == evil
    assert len(told["after"]) == write_log.SHORT
    assert all(" " <= letter <= "~" for letter in said[0])
    assert len(said[0]) <= write_log.SHORT


def test_a_log_that_cannot_be_written_is_told_once_and_holds_nobody_up(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "writes.jsonl")
    for folder in (tmp_path / "file", tmp_path):
        said = list[str]()
        with WriteLog(folder, said.append) as log:
            for _ in range(20):
                log.tell(entry())
        assert len([line for line in said if "cannot be written" in line]) == 1
        assert len(said) == 21


def test_a_standard_error_that_nobody_reads_holds_nobody_up(capfd: pytest.CaptureFixture[str]) -> None:
    to_standard_error("heard")
    assert capfd.readouterr().err == "pmsm-bench: heard\n"
    reader, writer = os.pipe()
    kept = os.dup(2)
    try:
        os.dup2(writer, 2)
        for _ in range(1000):
            to_standard_error("x" * 500)
    finally:
        os.dup2(kept, 2)
        for end in (reader, writer, kept):
            os.close(end)
