"""Files that are brought to a service: what becomes of them, by REST and the command line, and what is refused."""

import contextlib
import hashlib
import json
import pickle
import subprocess
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import scipy.io

from bench.live.window import Window
from bench.recordings.recording import open_recording
from bench.recordings.replay import replay
from bench.recordings.table import check_undamaged, notes
from estimator.machine import PARAMETERS
from estimator.online.window_ls import MAX_LENGTH
from tests.bench.api.test_api import problem
from tests.conftest import COMMAND, RunningBench
from tests.support.served_drive import until

pytestmark = pytest.mark.live

ALL = "/api/recordings"
BYTES = {"Content-Type": "application/octet-stream"}
N = 3000
CSV = "Time [ms],Iq [mA],id,ud,uq,n [rpm]\n" + "".join(
    f"{0.1 * k:.4f},{2000 + k % 7},0.1,{k % 5},10,600\n" for k in range(N) if not 1000 <= k < 1100
)
QUERY = {"name": "my run.csv", "map": "t=Time,i_q=Iq,i_d=id,u_d=ud,u_q=uq,omega_e=n", "set": "n_p=4", "title": "mine"}


@pytest.fixture
def client(running_bench: RunningBench) -> Iterator[httpx.Client]:
    """A client that brings files; what it has brought is gone afterwards."""
    with httpx.Client(base_url=running_bench.url, headers=BYTES, timeout=60.0) as one:
        before = {kept["id"] for kept in one.get(ALL).json()["recordings"]}
        yield one
        for kept in one.get(ALL).json()["recordings"]:
            if kept["id"] not in before:
                one.delete(f"{ALL}/{kept['id']}")


def test_a_csv_becomes_a_recording_in_SI(client: httpx.Client, tmp_path: Path) -> None:
    answer = client.post(ALL, params=QUERY, content=CSV)
    one = answer.json()
    assert answer.headers["location"] == f"{ALL}/my-run"
    assert (one["id"], one["kind"], one["title"], one["rows"]) == ("my-run", "file", "mine", N - 100)
    assert one["columns"] == ["t", "theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q"]
    assert client.post(ALL, params=QUERY, content=CSV).json()["id"] == "my-run-1"  # nothing is written over
    plotted = client.get(f"{ALL}/my-run/samples", params={"signals": "i_q,omega_e", "points": 5000}).json()
    assert plotted["signals"]["i_q"]["unit"] == "A"
    assert plotted["signals"]["i_q"]["mean"][:3] == pytest.approx([2.0, 2.001, 2.002])
    assert plotted["signals"]["omega_e"]["mean"][0] == pytest.approx(4 * 600 * np.pi / 30)
    assert plotted["signals"]["i_q"]["mean"].count(None) == 1  # rows that are not there
    (tmp_path / "one.parquet").write_bytes(client.get(f"{ALL}/my-run/file").content)
    check_undamaged(tmp_path / "one.parquet")
    told = notes(tmp_path / "one.parquet")["imported"]
    assert (told["name"], told["form"], told["bytes"]) == ("my run.csv", "CSV", len(CSV))
    assert told["sha256"] == hashlib.sha256(CSV.encode()).hexdigest()
    assert told["map"]["i_q"] == "Iq"
    assert any("rows lost, by the times: 100" in said for said in told["remarks"])


def hostile(name: str) -> bytes:
    """A file of somebody's who means no good, or does not know better."""
    if name.endswith(".mat"):
        return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + bytes(range(256)) * 4
    return {"a.mf4": b"MDF     4.10    " + bytes(5000), "a.pkl": pickle.dumps(np.zeros(99)), "a.csv": b"",
            "nan.csv": b"t,u_d,u_q,i_d,i_q,omega_e\n" + b"nan,nan,nan,nan,nan,nan\n" * 9}.get(name, CSV.encode())


@pytest.mark.parametrize(("query", "status", "said"), [
    ({"name": "a.mat"}, 422, "a.mat: expected "), ({"name": "a.mf4"}, 422, "a.mf4: expected a file of ASAM MDF"),
    ({"name": "a.pkl"}, 422, "a.pkl: expected CSV in UTF-8"), ({"name": "a.csv"}, 422, "expected a file's bytes"),
    ({"name": "nan.csv"}, 422, "nan.csv: "), ({"name": "plain.csv"}, 422, "plain.csv: missing columns: u_d, u_q"),
    ({"name": "../a.csv"}, 422, "name: expected that of a file, without folders, got '../a.csv'"),
    ({"name": "..\\a.csv"}, 422, "without folders"), ({"name": ".hidden"}, 422, "without folders"),
    ({"name": "x" * 201}, 422, "without folders"), ({"name": "a\n.csv"}, 422, "without folders"), ({}, 422, "name"),
    (QUERY | {"map": "t"}, 422, "map: expected NAME=COLUMN"), (QUERY | {"set": "n_p=x"}, 422, "set: expected NAME=NUM"),
    (QUERY | {"map": "colour=n"}, 422, "no quantity 'colour'"), (QUERY | {"align": "i=1"}, 422, "cannot align 'i'"),
    (QUERY | {"title": "x" * 201}, 422, "title"),
])  # fmt: skip
def test_what_cannot_be_a_recording_gets_a_sentence(
    client: httpx.Client, query: dict[str, str], status: int, said: str
) -> None:
    before = client.get(ALL).json()["total"]
    sentence = problem(client.post(ALL, params=query, content=hostile(query.get("name", ""))), status)
    assert said in sentence
    assert "unfinished" not in sentence
    assert client.get(ALL).json()["total"] == before


def test_a_form_of_another_page_cannot_bring_one(client: httpx.Client) -> None:
    for kind in ("text/plain", "application/json"):
        answer = client.post(ALL, params=QUERY, content=CSV, headers={"Content-Type": kind})
        assert "expected the header Content-Type: application/octet-stream" in problem(answer, 415)


def test_a_file_that_is_too_long_is_refused_before_it_comes(client: httpx.Client) -> None:
    with contextlib.closing(HTTPConnection(client.base_url.host, client.base_url.port, timeout=10.0)) as other:
        other.putrequest("POST", f"{ALL}?name=a.csv")
        for header in (*BYTES.items(), ("Content-Length", "5000000000")):
            other.putheader(*header)
        other.endheaders()
        answer = other.getresponse()
        said = json.loads(answer.read())["detail"]
        assert (answer.status, said) == (413, "expected a file of at most 4 GB, got more")


def estimates(path: Path, **options: Any) -> dict[str, float | None]:
    """What the rows of a recording say."""
    with open_recording(path, optional=False, **options) as reader:
        found = replay(reader, Window(length=MAX_LENGTH, periods_per_row=10)).result.estimates
    return {name: one.value for name, one in found.items()} | {f"{name}_std": one.std for name, one in found.items()}


def test_a_capture_goes_out_in_every_form_and_comes_in_again_as_it_was(client: httpx.Client, tmp_path: Path) -> None:
    json_ = {"Content-Type": "application/json"}
    until(lambda: client.get("/api/drives/emulated").json()["link"]["state"] == "streaming", "the stream")
    asked = client.post("/api/drives/emulated/captures", json={"length": 5000}, headers=json_).json()["id"]
    until(lambda: client.get(f"/api/drives/emulated/captures/{asked}").json()["state"] == "done", "the capture", 60.0)
    client.patch(f"{ALL}/{asked}", json={"title": "warm", "note": "after lunch"}, headers=json_)
    expected: dict[str, float | None] = {}
    for ending in ("parquet", "csv", "mat", "mf4"):
        out = tmp_path / f"out.{ending}"
        out.write_bytes(client.get(f"{ALL}/{asked}/file", params={"format": ending}).content)
        expected = expected or estimates(out)
        assert None not in expected.values()
        compared = PARAMETERS if ending == "csv" else tuple(expected)  # CSV tells no resolution, by which intervals are
        same = pytest.approx({name: expected[name] for name in compared}, rel=1e-6 if ending == "csv" else 1e-9)
        assert {name: estimates(out)[name] for name in compared} == same
        one = client.post(ALL, params={"name": f"again-{ending}.{ending}"}, content=out.read_bytes()).json()
        back = tmp_path / f"back.{ending}.parquet"
        back.write_bytes(client.get(f"{ALL}/{one['id']}/file").content)
        assert {name: estimates(back)[name] for name in compared} == same
        if ending in ("mat", "mf4"):
            assert (one["title"], one["note"], one["drive"]) == ("warm", "after lunch", "emulated")
        if ending != "csv":
            assert notes(back)["steps"] == notes(tmp_path / "out.parquet")["steps"]
            assert notes(back)["imported"]["notes"]["capture"] == asked


def test_a_stream_goes_out_in_every_form_and_comes_in_again_with_every_column(
    client: httpx.Client, tmp_path: Path
) -> None:
    until(lambda: client.get("/api/drives/emulated").json()["link"]["state"] == "streaming", "the stream")
    json_ = {"Content-Type": "application/json"}
    asked = client.post("/api/drives/emulated/recordings", json={"seconds": 0.5}, headers=json_).json()["id"]
    until(lambda: client.get(f"{ALL}/{asked}").json()["state"] == "done", "the recording")
    before = client.get(f"{ALL}/{asked}").json()
    assert {"temp_winding", "temp_magnet", "periods", "u_dc"} <= set(before["columns"])
    course = client.get(f"{ALL}/{asked}/samples", params={"signals": "temp_winding"}).json()["signals"]
    for ending in ("parquet", "csv", "mat", "mf4"):
        content = client.get(f"{ALL}/{asked}/file", params={"format": ending}).content
        one = client.post(ALL, params={"name": f"again.{ending}"}, content=content).json()
        assert set(one["columns"]) == set(before["columns"])
        assert (one["rows"], one["remarks"]) == (before["rows"], [])
        again = client.get(f"{ALL}/{one['id']}/samples", params={"signals": "temp_winding"}).json()["signals"]
        assert again == course


def test_columns_that_are_left_out_are_told(client: httpx.Client) -> None:
    rows = "t,u_d,u_q,i_d,i_q,omega_e,torque,temp_winding\n" + "".join(
        f"{1e-4 * k:.4f},1,2,0.1,0.2,300,5,{20 if k else ''}\n" for k in range(100)
    )
    one = client.post(ALL, params={"name": "torque.csv"}, content=rows).json()
    assert one["remarks"] == ["columns left out: torque"]
    assert (one["rows"], "temp_winding" in one["columns"]) == (100, True)  # a row without a temperature is one


@pytest.mark.thorough
def test_the_command_line_brings_one(running_bench: RunningBench, client: httpx.Client, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    t = np.linspace(0.0, 0.2999, N)
    columns = {"time_us": 1e6 * t, "Iq": np.cos(t)} | dict.fromkeys(("id", "ud", "uq", "w"), np.ones(N))
    scipy.io.savemat(path, {"log": columns})  # pyright: ignore[reportUnknownMemberType]

    def told(*arguments: str, code: int = 0) -> str:
        run = subprocess.run(
            [*COMMAND, "recordings", "import", *arguments, "--service", running_bench.url],
            capture_output=True, text=True, timeout=60.0, check=False,
        )  # fmt: skip
        assert run.returncode == code, run.stderr
        return run.stdout + run.stderr

    columns_ = ("--map", "t=time_us*1e-6,i_q=Iq,i_d=id", "--map", "u_d=ud,u_q=uq,omega_e=w", "--title", "by hand")
    assert "run: 3000 rows, 0.3 s, of " in told(str(path), *columns_)
    assert json.loads(client.get(f"{ALL}/run").text)["title"] == "by hand"
    assert "run.mat: missing columns: t, u_d" in told(str(path), code=2)
    assert "cannot be read: No such file" in told(str(tmp_path / "none.csv"), code=2)
