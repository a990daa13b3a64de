"""Sets, plans and flashes by the running service's REST interface."""

import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from bench.parameters.parameter_set import FLASHED
from tests.conftest import JSON, RunningBench, bench_up, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url, until

pytestmark = pytest.mark.live

DRIVE = "/api/drives/emulated"
SLOWER = {"name": "slower", "version": 2, "entries": {"bandwidth": 900.0, "n_p": {"value": 4, "unit": "1"}}}
TOML = {"Content-Type": "application/toml"}


@pytest.fixture(scope="module")
def bench() -> Iterator[RunningBench]:
    with bench_up() as one:
        yield one


@pytest.fixture
def client(bench: RunningBench) -> Iterator[httpx.Client]:
    """Of a service whose drive is off, and has the values that it was delivered with."""
    with httpx.Client(base_url=bench.url, headers=JSON, timeout=30.0) as one:
        assert one.post(f"{DRIVE}/stop").is_success
        yield one


def refused(answer: httpx.Response, status: int) -> str:
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    assert answer.status_code == status, answer.text
    assert "\n" not in answer.json()["detail"]
    return answer.json()["detail"]


def ended(client: httpx.Client, answer: httpx.Response, drive: str = DRIVE) -> dict[str, Any]:
    assert answer.status_code == 202, answer.text
    place = answer.headers["location"]
    assert place == f"{drive}/flashes/{answer.json()['id']}"
    until(lambda: client.get(place).json()["state"] != "running", "the flash to end")
    return client.get(place).json()


def test_the_present_parameters_come_as_a_set_in_every_form(client: httpx.Client) -> None:
    place = f"{DRIVE}/parameters/set"
    told = client.get(place, params={"name": "servo"}).json()
    assert (told["name"], len(told["entries"])) == ("servo", len(FLASHED))
    assert told["entries"]["bandwidth"] == {
        "value": 1250.0, "unit": "rad/s", "low": None, "high": None, "status": "ok", "source": "", "note": "",
        "at_degC": None, "at_20_degC": None,
    }
    by_accept = client.get(place, headers={"Accept": "application/toml"})
    by_form = client.get(place, params={"form": "toml"})
    assert by_accept.text == by_form.text
    assert by_accept.headers["content-type"].startswith("application/toml")
    assert 'filename="emulated.toml"' in by_accept.headers["content-disposition"]
    assert tomllib.loads(by_form.text)["parameters"]["bandwidth"] == 1250.0
    expected = {"dcf": "ParameterValue=1250.0", "c": "PMSM_BANDWIDTH 1250.0f", "a2l": "CHARACTERISTIC bandwidth"}
    for form, said in expected.items():
        assert said in client.get(place, params={"form": form}).text
    assert "BASE_" in client.get(place, params={"form": "c", "type": "q31"}).text
    assert "expected float, q15" in refused(client.get(place, params={"form": "c", "type": "q7"}), 422)
    assert client.post(f"{DRIVE}/parameters/plan", json=told).json() == {
        "changes": [], "same": len(FLASHED), "problems": [], "doubts": [], "remarks": [],
    }  # fmt: skip
    plan = client.post(f"{DRIVE}/parameters/plan", content=by_form.text, headers=TOML).json()
    assert (plan["changes"], plan["same"]) == ([], len(FLASHED))


def test_a_plan_tells_changes_and_all_problems_and_doubts_at_once(client: httpx.Client) -> None:
    given = {"name": "a", "serial": 5, "entries": {
        "bandwidth": 1.0, "speed": 1.0, "n_p": 4.5, "current_limit": 7.0, "speed_ramp": 1e300,
        "k_p_speed": {"value": 0.123456789, "status": "doubtful"},
    }}  # fmt: skip
    plan = client.post(f"{DRIVE}/parameters/plan", json=given).json()
    assert [one["signal"] for one in plan["changes"]] == ["current_limit", "k_p_speed"]
    assert plan["changes"][1]["held"] == pytest.approx(0.123456789, rel=1e-7)
    assert abs(plan["changes"][1]["rounding"]) > 0.0
    assert [problem.split(" ")[0] for problem in plan["problems"]] == [
        "0x2200:6", "no", "0x2200:1", "0x2300:9", "the", "current_limit:"
    ], plan["problems"]
    assert plan["doubts"] == ["k_p_speed is doubtful"]
    answer = client.post(f"{DRIVE}/flashes", json=given)
    assert "(bandwidth) takes at least 10.0 rad/s, got 1.0; no signal 'speed'; " in refused(answer, 422)
    assert answer.json()["problems"] == plan["problems"]


@pytest.mark.parametrize(("body", "kind", "status", "said"), [
    (b"{", "application/json", 422, "the body is not JSON, expected an object such as"),
    (b"[]", "application/json", 422, "expected a JSON object such as"),
    (b'{"name": "a", "entries": {"n_p": {"value": 4}, "n_p": {"value": 5}}}', "application/json", 422,
     "expected every key once in an object, got 'n_p' more than once"),
    (b'{"name": "a", "entries": {"bandwidth": 900}, "note": ""}', "application/json", 422, "'note' is none of entries"),
    (b'{"name": "a", "entries": {}}', "application/json", 422, "expected values in entries, got none"),
    (b"name = ", "application/toml", 422, "the set: is not TOML"), (b"\xff", "application/toml", 422, "which is UTF-8"),
    (b"[parameters]\nbandwidth = 9e2", "application/toml", 422, "name: expected 1 to 60 characters"),
    (b"{}", "text/plain", 415, "application/json or application/toml"),
    (b'{"x": "' + b"a" * 70_000 + b'"}', "application/json", 413, "at most 65536 bytes"),
    (b"a = [" + b"[" * 30_000, "application/toml", 422, "is not TOML"),
    (b"[" * 30_000, "application/json", 422, "is not JSON"),
    (b'{"name": "\\ud800", "entries": {"\\ud800": 1e999}}', "application/json", 422, "name: expected"),
])  # fmt: skip
def test_what_is_no_set_is_refused(client: httpx.Client, body: bytes, kind: str, status: int, said: str) -> None:
    for path in ("parameters/plan", "flashes"):
        answer = client.post(f"{DRIVE}/{path}", content=body, headers={"Content-Type": kind})
        assert said in refused(answer, status)


def test_it_is_flashed_and_rolled_back_and_both_are_remembered(client: httpx.Client) -> None:
    events = f"{DRIVE}/events"
    assert client.post(f"{DRIVE}/start", json={}).is_success
    assert "takes one writer at a time" in refused(client.post(f"{DRIVE}/flashes", json=SLOWER), 409)
    assert client.post(f"{DRIVE}/stop").is_success
    begun = [client.post(f"{DRIVE}/flashes", json=SLOWER, headers={"Idempotency-Key": "one"}) for _ in range(2)]
    assert begun[0].content == begun[1].content
    busy = client.get(f"{DRIVE}").json()
    assert busy["control"]["in_flash"] or client.get(f"{DRIVE}/flashes/latest").json()["state"] == "flashed"
    done = ended(client, begun[0])
    assert (done["state"], done["said"]) == ("flashed", "1 value changed, stored, and read back after a reset")
    assert (done["progress"], done["phase"], done["whom"]) == (1.0, "", "127.0.0.1")
    assert [step["said"] for step in done["steps"]] == ["writing 1 value", "storing", "resetting", "reading back"]
    assert done["changed"] == [{"name": "bandwidth", "unit": "rad/s", "before": 1250.0, "after": 900.0}]
    assert client.get(f"{DRIVE}/flashes/{done['id']}").json() == done
    until(lambda: client.get(DRIVE).json()["link"]["state"] == "streaming", "the stream to come back")
    assert client.get(DRIVE).json()["stream"]["gaps"] >= 1
    (back,) = client.get(f"{DRIVE}/parameters/rollback").json()["changes"]
    assert (back["signal"], back["old"], back["new"]) == ("bandwidth", 900.0, 1250.0)
    assert ended(client, client.post(f"{DRIVE}/parameters/rollback"))["name"] == "before slower"
    told = client.get(f"{DRIVE}/flashes").json()
    assert [one["name"] for one in told["past"]] == ["before slower", "slower"]
    assert {one["state"] for one in told["past"]} == {"flashed"}
    assert (told["total"], told["cut"], len(told["flashes"])) == (2, None, 2)
    until(lambda: client.get(DRIVE).json()["link"]["state"] == "streaming", "the stream to come back")
    until(lambda: client.get(events, params={"kind": "flash"}).json()["total"] == 4, "the events")
    said = [one["sentence"] for one in client.get(events, params={"kind": "flash"}).json()["events"]]
    assert [one.partition(":")[0] for one in said[-2:]] == [
        "flash of 'slower', version 2", "flash of 'slower', version 2, asked for from 127.0.0.1"
    ]
    writes = [one["write"] for one in client.get(events, params={"kind": "write"}).json()["events"]]
    flashed = [one for one in writes if one["path"].endswith("/flashes") and one["status"] == 202]
    assert flashed[0]["before"] == {"bandwidth": 1250.0}
    assert flashed[0]["after"] == {"bandwidth": 900.0, "set": "slower, version 2"}


def test_it_goes_back_to_before_any_flash_of_the_history(client: httpx.Client) -> None:
    def streaming() -> None:
        until(lambda: client.get(DRIVE).json()["link"]["state"] == "streaming", "the stream to come back")

    streaming()
    place = f"{DRIVE}/parameters/rollback"
    for bandwidth in (900.0, 800.0):
        given = {"name": f"at {bandwidth:g}", "entries": {"bandwidth": bandwidth}}
        ended(client, client.post(f"{DRIVE}/flashes", json=given))
        streaming()
    first = client.get(f"{DRIVE}/flashes").json()["past"][1]
    assert first["name"] == "at 900"
    (back,) = client.get(place, params={"before": first["since"]}).json()["changes"]
    assert (back["signal"], back["old"], back["new"]) == ("bandwidth", 800.0, 1250.0)
    for since, status, said in (
        ("2026-01-31", 409, "such as 20"), (first["since"][:10], 409, "is the beginning of"), ("now", 422, "got 'now'"),
    ):
        assert said in refused(client.get(place, params={"before": since}), status)
        assert said in refused(client.post(place, json={"before": since}), status)
    for given, said in (
        ({"before": 5}, "before: expected null or the time of a flash"),
        ({"after": "x"}, "expected before, got 'after'"),
    ):
        assert said in refused(client.post(place, json=given), 422)
    assert "unknown query key 'after', expected before" in refused(client.get(place, params={"after": "x"}), 422)
    assert ended(client, client.post(place, json={"before": first["since"]}))["name"] == "before at 900"
    streaming()
    assert client.get(f"{DRIVE}/parameters/set").json()["entries"]["bandwidth"]["value"] == 1250.0


def test_a_reason_for_doubts_is_in_the_history(client: httpx.Client) -> None:
    given = {"name": "doubtful", "entries": {"control_R_s": {"value": 0.9664, "low": 1.0}}}
    assert "; expected a reason" in refused(client.post(f"{DRIVE}/flashes", json=given), 422)
    until(lambda: client.get(DRIVE).json()["link"]["state"] == "streaming", "the link")
    answer = client.post(f"{DRIVE}/flashes", json=given, params={"override": "a test"})
    assert ended(client, answer)["override"] == "a test"
    assert client.get(f"{DRIVE}/flashes", params={"limit": 1}).json()["past"][0]["override"] == "a test"


def test_what_was_not_cut_is_neither_finished_nor_rolled_back(client: httpx.Client) -> None:
    until(lambda: client.get(DRIVE).json()["link"]["state"] == "streaming", "the link")
    resume = f"{DRIVE}/parameters/resume"
    assert "no flash of this drive was cut" in refused(client.post(resume, json={"finish": True}), 409)
    assert "expected true or false" in refused(client.post(resume, json={}), 422)
    assert "expected" in refused(client.post(resume, json={"finish": True, "x": 1}), 422)
    assert "has no flash" in refused(client.get(f"{DRIVE}/flashes/nothing"), 404)


def test_a_service_that_is_told_to_end_waits_for_a_flash() -> None:
    with bench_up() as bench, httpx.Client(base_url=bench.url, headers=JSON, timeout=30.0) as client:
        assert client.post(f"{DRIVE}/stop").is_success
        assert client.post(f"{DRIVE}/flashes", json=SLOWER).status_code == 202
        bench.process.send_signal(signal.SIGTERM)
        out, errors = bench.process.communicate(timeout=20.0)
        assert "emulated: its flash has ended: flashed" in out
        assert "a flash is under way, and is waited for" in errors
        assert "Traceback" not in errors


@pytest.mark.parametrize("finish", [True, False])
def test_a_service_that_is_killed_in_a_flash_tells_so_at_its_next_start(tmp_path: Path, finish: bool) -> None:
    url, port, config = tcp_url(), free_port(), tmp_path / "bench.toml"
    config.write_text(
        f'[service]\nport = {port}\ncaptures = "c"\nlog = "log"\njournals = "j"\ndatabase = "c.sqlite"\n'
        f'[drives.x]\nurl = "{url}"\n', encoding="utf-8",
    )  # fmt: skip
    drive = "/api/drives/x"
    with (
        emulator("--at", url, "--memory", str(tmp_path / "memory"), control="lease") as emulated,
        httpx.Client(base_url=f"http://127.0.0.1:{port}", headers=JSON, timeout=30.0) as client,
    ):
        ready(emulated)
        with command("serve", "--config", str(config)) as service:
            wait_for_answer(f"http://127.0.0.1:{port}/api/health", service)
            until(lambda: client.get(drive).json()["link"]["state"] == "streaming", "the link")
            assert client.post(f"{drive}/flashes", json=SLOWER).status_code == 202
            service.send_signal(signal.SIGKILL)
        with command("serve", "--config", str(config)) as service:
            wait_for_answer(f"http://127.0.0.1:{port}/api/health", service)
            until(lambda: client.get(drive).json()["link"]["state"] == "streaming", "the link")
            left = client.get(drive).json()["cut_flash"]
            assert (left["name"], left["whom"]) == ("slower", "127.0.0.1")
            assert client.get(f"{drive}/flashes").json()["cut"] == left
            events = f"{drive}/events?kind=flash&limit=1"
            until(lambda: "was cut, since" in client.get(events).text, "the event")
            until(lambda: client.get(drive).json()["control"]["holder"] is None, "the lease to run out")
            assert "has to be finished or rolled back" in refused(client.post(f"{drive}/flashes", json=SLOWER), 409)
            done = ended(client, client.post(f"{drive}/parameters/resume", json={"finish": finish}), drive)
            assert (done["kind"], done["state"]) == (("finish", "flashed") if finish else ("roll back", "rolled back"))
            assert client.get(drive).json()["cut_flash"] is None
            until(lambda: client.get(drive).json()["link"]["state"] == "streaming", "the link")
            now = client.get(f"{drive}/parameters/set").json()["entries"]["bandwidth"]["value"]
            assert now == (900.0 if finish else 1250.0)
