"""Recordings over REST and the command line: begun, marked, stopped, listed, downloaded, deleted, refused."""

import json
import os
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from bench.api.exchange.answers import page_of
from bench.api.exchange.kinds import BYTES
from bench.recordings.capture_file import write_columns
from bench.recordings.table import notes
from tests.bench.api.test_api import problem
from tests.conftest import COMMAND, JSON, RunningBench
from tests.support.recordings import read_recording
from tests.support.served_drive import until

pytestmark = pytest.mark.live

OF_DRIVE = "/api/drives/emulated/recordings"
ALL = "/api/recordings"
AT = datetime(2026, 1, 31, 12, tzinfo=UTC)
ITEMS = [(AT, "a"), (AT, "b"), (AT + timedelta(seconds=1), "c"), (AT, "d")]  # when, and which


@pytest.fixture
def client(running_bench: RunningBench) -> Iterator[httpx.Client]:
    """A client of a bench whose drive streams, and is not recorded."""
    with httpx.Client(base_url=running_bench.url, headers=JSON) as one:
        until(lambda: one.get("/api/drives/emulated").json()["link"]["state"] == "streaming", "the stream")
        yield one
        if (under_way := one.get(OF_DRIVE).json()["recording"]) is not None:
            one.delete(f"{ALL}/{under_way['id']}")


def begun(client: httpx.Client, **given: Any) -> str:
    answer = client.post(OF_DRIVE, json=given)
    assert answer.status_code == 202
    assert answer.headers["location"] == f"{ALL}/{answer.json()['id']}"
    return answer.headers["location"]


def rows(client: httpx.Client, address: str, count: int) -> None:
    until(lambda: client.get(address).json()["rows"] >= count, "rows")


def done(client: httpx.Client, address: str) -> dict[str, Any]:
    until(lambda: client.get(address).json()["state"] == "done", "its end")
    return client.get(address).json()


def test_a_recording_from_its_begin_to_its_end(client: httpx.Client, tmp_path: Path) -> None:
    room = client.get(OF_DRIVE).json()
    assert room["recording"] is None
    assert room["days"] == pytest.approx(room["free_bytes"] / 2.0 / room["bytes_per_day"])
    address = begun(client, title="warm", note="after lunch")
    id_ = address.split("/")[-1]
    assert problem(client.post(OF_DRIVE, json={}), 409) == f"drive emulated is recorded already: {id_}"
    rows(client, address, 200)
    assert client.get(OF_DRIVE).json()["recording"]["state"] == "recording"
    marked = client.post(f"{address}/marks", json={"text": "load on"})
    assert [mark["text"] for mark in marked.json()["marks"]] == ["load on"]
    assert "is under way" in problem(client.get(f"{address}/file"), 409)
    assert "is under way" in problem(client.get(f"{address}/samples"), 409)
    assert client.patch(address, json={"title": "cold"}).json()["title"] == "cold"
    assert client.post(f"{address}/stop").json()["id"] == id_
    one = done(client, address)
    assert (one["title"], one["note"], one["kind"], one["drive"]) == ("cold", "after lunch", "stream", "emulated")
    assert one["reason"] == "stopped by 127.0.0.1"
    assert one["whole"]
    content = client.get(f"{address}/file").content
    (tmp_path / "one.parquet").write_bytes(content)
    assert read_recording(tmp_path / "one.parquet").summary.rows == one["rows"]
    text = client.get(f"{address}/file", params={"format": "csv"})
    assert text.headers["content-type"].startswith("text/csv")
    (tmp_path / "one.csv").write_bytes(text.content)
    for ending in ("mat", "mf4"):
        answer = client.get(f"{address}/file", params={"format": ending}, timeout=60.0)
        assert answer.headers["content-length"] == str(len(answer.content))
        (tmp_path / f"one.{ending}").write_bytes(answer.content)
        assert notes(tmp_path / f"one.{ending}")["title"] == "cold"
        (other,) = read_recording(tmp_path / f"one.{ending}").runs
        assert (other.i_q == read_recording(tmp_path / "one.parquet").runs[0].i_q).all()
    (same,), (run,) = read_recording(tmp_path / "one.csv").runs, read_recording(tmp_path / "one.parquet").runs
    assert (same.i_q == run.i_q).all()
    plotted = client.get(f"{address}/samples", params={"signals": "i_q,u_d", "until": 0.1, "points": 20}).json()
    assert (plotted["rows"], plotted["thinned"], len(plotted["t"])) == (101, True, 20)
    assert plotted["signals"]["u_d"]["unit"] == "V"
    assert max(plotted["signals"]["i_q"]["high"]) == run.i_q[:101].max()
    assert client.get(f"{address}/samples").json()["rows"] == one["rows"]
    later = client.post(f"{address}/marks", json={"text": "knocks", "t": 0.05}).json()
    assert [mark["text"] for mark in later["marks"]] == ["knocks", "load on"]
    assert "there is nothing to stop" in problem(client.post(f"{address}/stop"), 409)
    assert client.delete(address).json()["id"] == id_
    assert problem(client.get(address), 404) == f"no recording '{id_}'"


def test_one_under_way_is_the_latest_though_the_clock_has_been_set_back_since_others(
    running_bench: RunningBench, client: httpx.Client, tmp_path: Path
) -> None:
    path = tmp_path / "ahead.parquet"
    columns = np.sin(np.arange(600.0)).reshape(6, 100)
    columns[0] = 1e-4 * np.arange(100)
    write_columns(path, dict(zip(("t", "u_d", "u_q", "i_d", "i_q", "omega_e"), columns, strict=True)), {
        "begun": "2099-01-31T12:00:00+00:00", "capture": "ahead", "drive": "emulated",
    })  # fmt: skip
    brought = client.post(f"{ALL}?name=ahead.parquet", content=path.read_bytes(), headers={"Content-Type": BYTES})
    assert brought.json()["begun"].startswith("2099"), brought.text
    latest, at = f"{ALL}/latest", ("--service", running_bench.url)
    try:
        address = begun(client)
        rows(client, latest, 10)
        assert address.endswith(client.get(latest).json()["id"])
        assert client.post(f"{latest}/marks", json={"text": "here"}).status_code == 200
        run = subprocess.run([*COMMAND, "recordings", "mark", "latest", "there", *at], timeout=60.0, check=False)
        assert run.returncode == 0
        assert client.post(f"{latest}/stop").status_code == 200
        assert [mark["text"] for mark in done(client, address)["marks"]] == ["here", "there"]
        assert client.get(latest).json()["id"] == brought.json()["id"]
        run = subprocess.run(
            [*COMMAND, "recordings", "stop", *at], capture_output=True, text=True, timeout=60.0, check=False
        )
        assert "no recording is under way" in run.stderr
    finally:
        client.delete(brought.headers["location"])


def test_the_list_is_filtered_and_comes_in_pages(client: httpx.Client) -> None:
    addresses = [begun(client, title=title, seconds=0.05) for title in ("one",)]
    done(client, addresses[0])
    for title in ("two", "three"):
        addresses.append(begun(client, title=title, seconds=0.05))
        done(client, addresses[-1])
    found = client.get(ALL, params={"drive": "emulated", "kind": "stream", "limit": 2}).json()
    assert [one["title"] for one in found["recordings"]] == ["three", "two"]
    more = client.get(ALL, params={"kind": "stream", "before": found["next"]}).json()
    assert more["recordings"][0]["title"] == "one"
    assert [one["title"] for one in client.get(ALL, params={"text": "TWO"}).json()["recordings"]] == ["two"]
    assert client.get(ALL, params={"drive": "nobody"}).json() == {"recordings": [], "total": 0, "next": None}
    assert "before: expected a time of 1970 or later" in problem(client.get(ALL, params={"before": "0.5"}), 422)
    begin = found["recordings"][1]["begun"].replace("Z", "+00:00")
    for said in (begin, begin.replace("+", "%2B"), begin.replace("+", " ")):  # as it may come in a query
        assert client.get(f"{ALL}?kind=stream&before={said}").json()["recordings"][0]["title"] == "one"
    for address in addresses:
        client.delete(address)


@pytest.mark.parametrize(("method", "path", "body", "status", "said"), [
    ("POST", OF_DRIVE, {"trigger": "i_a>1"}, 422, "trigger: the stream has"),
    ("POST", "/api/drives/nobody/recordings", {}, 404, "no drive"),
    ("GET", f"{ALL}/nobody", None, 404, "no recording"), ("DELETE", f"{ALL}/nobody", None, 404, "no recording"),
    ("PATCH", f"{ALL}/nobody", {"title": "x"}, 404, "no recording"),
    ("PATCH", f"{ALL}/nobody", {"name": "x"}, 422, "expected title or note, got"),
    ("POST", f"{ALL}/nobody/marks", {"text": 3}, 422, "text: expected a text"),
    ("POST", f"{ALL}/nobody/stop", {}, 404, "no recording"),
    ("GET", f"{ALL}/nobody/samples", None, 404, "no recording"),
])  # fmt: skip
def test_what_cannot_be_is_refused(
    client: httpx.Client, method: str, path: str, body: Any, status: int, said: str
) -> None:
    assert said in problem(client.request(method, path, json=body), status)


@pytest.mark.thorough
def test_the_command_line_does_all_of_it(running_bench: RunningBench, client: httpx.Client, tmp_path: Path) -> None:
    def told(*arguments: str, code: int = 0) -> str:
        run = subprocess.run(
            [*COMMAND, "recordings", *arguments], capture_output=True, text=True, timeout=60.0, check=False,
            env=os.environ | {"COLUMNS": "200"},
        )
        assert run.returncode == code, run.stderr
        return run.stdout + run.stderr

    at = ("--service", running_bench.url)
    said = told("start", "emulated", "--title", "by hand", *at)
    id_ = said.split(":")[0]
    assert "at most 3.5 GB a day, room for " in said
    rows(client, f"{ALL}/{id_}", 300)
    assert "load on" in told("mark", "latest", "load on", *at)
    assert f"{id_}: done, " in told("stop", *at)
    (line,) = (line for line in told("list", *at).splitlines() if line.startswith(id_))
    assert line.split()[1].startswith("20")
    assert "stream" in line.split()
    assert line.split()[-2:] == ["by", "hand"]
    listed = json.loads(told("list", "--json", "--kind", "stream", *at))
    assert listed["recordings"][0]["id"] == id_
    shown = told("show", id_, *at)
    assert "no gap" in shown
    assert "load on" in shown
    assert "by foot" in told("annotate", id_, "--title", "by foot", *at)
    for name in ("one.parquet", "one.csv", "one.mat"):
        told("export", id_, "--out", str(tmp_path / name), *at)
    there = tmp_path / "one.csv"
    assert f"--out: {there} exists already" in told("export", id_, "--out", str(there), *at, code=2)
    told("export", id_, "--out", str(tmp_path / "one.dat"), "--format", "mf4", *at)
    assert (tmp_path / "one.dat").read_bytes().startswith(b"MDF ")
    assert "--format: expected one of" in told(
        "export", id_, "--out", str(tmp_path / "two.dat"), "--format", "xls", *at, code=2
    )
    assert len(read_recording(tmp_path / "one.csv").runs) == len(read_recording(tmp_path / "one.parquet").runs) == 1
    assert "expected a name that ends with" in told("export", id_, "--out", str(tmp_path / "one.txt"), *at, code=2)
    assert "one.parquet: whole" in told("verify", str(tmp_path))
    content = bytearray((tmp_path / "one.parquet").read_bytes())
    content[500] ^= 1
    (tmp_path / "one.parquet").write_bytes(content)
    assert "another checksum" in told("verify", str(tmp_path), code=1)
    assert "deleted" in told("delete", id_, "--yes", *at)
    assert "no recording" in told("show", id_, *at, code=2)


@pytest.mark.parametrize("limit", [1, 2, 3, 4])
def test_a_page_has_as_many_as_were_asked_for_also_of_one_moment(limit: int) -> None:
    found, before = list[str](), None
    for left in range(len(ITEMS), 0, -limit):
        page, total, before = page_of(ITEMS, lambda one: one, before, limit)
        assert (len(page), total) == (min(limit, left), left)
        found += [id_ for _, id_ in page]
    assert (found, before) == (["c", "d", "b", "a"], None)


def test_the_next_page_is_told_without_what_a_query_would_change() -> None:
    assert page_of(ITEMS, lambda one: one, None, 2)[2] == "2026-01-31T12:00:00Z~d"
