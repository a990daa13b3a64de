"""Captures over REST: asked for, followed, downloaded, cancelled, triggered, refused."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.bench.api.test_api import problem
from tests.conftest import JSON, RunningBench
from tests.support.recordings import read_recording
from tests.support.served_drive import until

pytestmark = pytest.mark.live

DRIVE = "/api/drives/emulated"
CAPTURES = f"{DRIVE}/captures"
LATEST = f"{CAPTURES}/latest"


@pytest.fixture
def client(running_bench: RunningBench) -> Iterator[httpx.Client]:
    """A client of a bench whose drive streams and is nobody's."""
    with httpx.Client(base_url=running_bench.url, headers=JSON) as one:
        until(lambda: one.get(DRIVE).json()["link"]["state"] == "streaming", "the stream")
        yield one
        one.delete(LATEST)


def ended(client: httpx.Client, address: str) -> dict[str, Any]:
    """The capture when nothing more will come of it."""
    until(lambda: client.get(address).json()["state"] in ("done", "failed", "cancelled"), "its end")
    return client.get(address).json()


def test_a_capture_is_followed_from_its_location_to_its_file(client: httpx.Client, tmp_path: Path) -> None:
    answer = client.post(CAPTURES, json={"length": 4000, "pre_trigger": 0.1})
    assert answer.status_code == 202
    begun, location = answer.json(), answer.headers["location"]
    assert location == f"{CAPTURES}/{begun['id']}"
    assert (begun["drive"], begun["state"], begun["file"]) == ("emulated", "armed", None)
    assert begun["request"] == {
        "signals": ["theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q"], "length": 4000, "decimation": 1,
        "pre_trigger": 0.1, "trigger": "now", "timeout_s": 60.0,
    }
    writer = client.get(DRIVE).json()["writer"]
    assert writer["holder"] == f"capture {begun['id']} (asked for from 127.0.0.1)"
    assert problem(client.get(f"{location}/file"), 409).startswith(f"capture {begun['id']} has no recording, it is ")
    done = ended(client, location)
    assert (done["state"], done["progress"], done["samples"], done["reason"]) == ("done", 1.0, 4000, "")
    assert Path(done["file"]).name == f"{done['id']}.parquet"
    assert client.get(DRIVE).json()["writer"] is None
    assert client.get(LATEST).json() == client.get(CAPTURES).json()["captures"][0] == done
    got = client.get(f"{location}/file")
    assert got.headers["content-type"] == "application/vnd.apache.parquet"
    assert f'filename="{done["id"]}.parquet"' in got.headers["content-disposition"]
    head = client.head(f"{location}/file")
    assert (head.status_code, head.headers["content-length"]) == (200, str(len(got.content)))
    (tmp_path / "got.parquet").write_bytes(got.content)
    assert len(read_recording(tmp_path / "got.parquet").runs[0]) == 4000
    Path(done["file"]).unlink()
    said = problem(client.get(f"{location}/file"), 409)
    assert said == f"capture {done['id']} has no recording: {done['id']}.parquet is no longer there"


def test_a_second_writer_is_409_and_a_cancelled_capture_makes_room(client: httpx.Client) -> None:
    first = client.post(CAPTURES, json={"trigger": "i_q > 23"}).json()
    said = problem(client.post(CAPTURES, json={}), 409)
    holder = f"capture {first['id']} (asked for from 127.0.0.1)"
    assert said.startswith(f"drive emulated's recorder takes one writer at a time, and {holder} holds it until ")
    assert client.delete(f"{CAPTURES}/{first['id']}").json()["state"] == "cancelled"
    assert problem(client.delete(LATEST), 409) == f"capture {first['id']} is cancelled, there is nothing to cancel"
    assert client.post(CAPTURES, json={"length": 10}).status_code == 202
    assert ended(client, LATEST)["state"] == "done"


def test_a_capture_is_triggered_by_command_once(client: httpx.Client) -> None:
    client.post(CAPTURES, json={"length": 50, "trigger": "command"})
    until(lambda: "waiting for the command" in client.get(LATEST).json()["reason"], "waiting")
    assert client.post(f"{LATEST}/trigger").status_code == 200
    assert ended(client, LATEST)["state"] == "done"
    assert " is done, there is nothing to trigger" in problem(client.post(f"{LATEST}/trigger"), 409)


def test_without_a_body_a_capture_is_as_usual(client: httpx.Client) -> None:
    answer = client.post(CAPTURES)
    assert answer.status_code == 202
    assert answer.json()["request"]["length"] == 10_000
    assert ended(client, LATEST)["state"] == "done"


def test_a_trigger_that_never_comes_fails_with_a_sentence(client: httpx.Client) -> None:
    trigger = {"signal": "i_q", "level": -23.0, "edge": "falling"}
    client.post(CAPTURES, json={"trigger": trigger, "timeout_s": 0.1}).raise_for_status()
    failed = ended(client, LATEST)
    assert (failed["state"], failed["progress"]) == ("failed", 0.0)
    assert failed["reason"] == "the trigger, i_q falling through -23, has not come within 0.1 s"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b'{"signals": ["torque"]}', "signals: the recorder has theta_e, "),
        (b'{"length": 65537}', "length: expected a whole number of 1 to 65536, got 65537"),
        (b'{"trigger": "soon"}', 'trigger: expected "now", "command", "i_q > 2.0" or '),
        (b'{"timeout_s": NaN}', "timeout_s: expected a number of 0.1 to 86400, got nan"),
        (b"[]", "expected a JSON object such as "),
        (b"{", "the body is not JSON"),
    ],
    ids=repr,
)
def test_what_cannot_be_is_422_and_nothing_is_armed(client: httpx.Client, body: bytes, said: str) -> None:
    before = client.get(CAPTURES).json()
    assert problem(client.post(CAPTURES, content=body), 422).startswith(said)
    assert client.get(CAPTURES).json() == before


@pytest.mark.parametrize("id_", ["x", "..%2F..%2Fetc", "%00", "LATEST", "y" * 3000])
def test_an_unknown_capture_is_404(client: httpx.Client, id_: str) -> None:
    for method, end in (("GET", ""), ("GET", "/file"), ("POST", "/trigger"), ("DELETE", "")):
        said = problem(client.request(method, f"{CAPTURES}/{id_}{end}"), 404)
        assert said.startswith(("drive emulated has no capture ", "nothing at "))
