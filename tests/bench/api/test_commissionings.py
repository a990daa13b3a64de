"""Commissionings by the running service's REST interface: asked for, refused, stopped, and kept over its end."""

import json
import math
import signal
import subprocess
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from bench.api.exchange.kinds import is_stop
from drivers.connect import connect
from drivers.wire.dictionary import AT_REST
from emulator.scenario.text import text_of
from tests.bench.commissioning.unknown import is_off, unknown, watched
from tests.conftest import JSON, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url, until

pytestmark = pytest.mark.live

PLACE = "/api/drives/x/commissionings"
FIRST = {"kind": "first_start", "current": 3.0}
Told = dict[str, Any]


@dataclass(frozen=True)
class Bench:
    """An emulated drive of a process of its own, and the configuration of a service over it."""

    url: str  # of the drive
    root: str  # of the service
    config: Path

    def watched(self) -> dict[str, float]:
        """What has to be as before, as the drive says itself."""
        with connect(self.url) as drive:
            return watched(drive)

    def is_off(self) -> bool:
        """The drive is off, and nobody's."""
        with connect(self.url) as drive:
            return is_off(drive)


@contextmanager
def benched(folder: Path) -> Generator[Bench]:
    port, url = free_port(), tcp_url()
    (folder / "unknown.toml").write_text(text_of(unknown()), encoding="utf-8")
    (folder / "bench.toml").write_text(
        f'[service]\nport = {port}\ncaptures = "c"\nlog = "log"\njournals = "j"\ndatabase = "c.sqlite"\n'
        f'[drives.x]\nurl = "{url}"\n[drives.x.limits]\ni_max = 6.0\nspeed_max_rpm = 1500.0\n', encoding="utf-8",
    )  # fmt: skip
    with emulator("--at", url, "--scenario", str(folder / "unknown.toml"), control="lease") as process:
        ready(process)
        yield Bench(url, f"http://127.0.0.1:{port}", folder / "bench.toml")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with benched(tmp_path_factory.mktemp("bench")) as one:
        yield one


@contextmanager
def serving(bench: Bench) -> Generator[tuple[httpx.Client, "subprocess.Popen[str]"]]:
    """A service, connected, and its process."""
    with (
        command("serve", "--config", str(bench.config)) as process,
        httpx.Client(base_url=bench.root, headers=JSON, timeout=30.0) as client,
    ):
        wait_for_answer(f"{bench.root}/api/health", process)
        until(lambda: client.get("/api/drives/x").json()["link"]["state"] == "streaming", "the link")
        yield client, process


@pytest.fixture(scope="module")
def service(bench: Bench) -> Iterator[httpx.Client]:
    with serving(bench) as (client, _):
        yield client


@pytest.fixture
def client(bench: Bench, service: httpx.Client) -> Iterator[httpx.Client]:
    """Whatever is asked for, the drive is left as it was."""
    before = bench.watched()
    yield service
    assert not any(before[name] for name in AT_REST)
    assert bench.is_off()
    assert bench.watched() == before


def refused(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    assert "\n" not in answer.json()["detail"]
    return answer.json()["detail"]


def latest(client: httpx.Client) -> Told:
    return client.get(f"{PLACE}/latest").json()


def moving(client: httpx.Client) -> Told:
    """Ask for a first start, and wait until the motor has current."""
    answer = client.post(PLACE, json=FIRST)
    assert answer.status_code == 202, answer.text
    begun(client)
    return answer.json()


def begun(client: httpx.Client) -> None:
    """Return when the motor has current."""

    def aligning() -> bool:
        now = latest(client)
        assert now["state"] == "running", now
        return now["phase"].startswith("aligning the rotor by ")

    until(aligning, "it does not begin")


def ended(client: httpx.Client, id_: str) -> Told:
    until(lambda: client.get(f"{PLACE}/{id_}").json()["state"] != "running", "its end")
    return client.get(f"{PLACE}/{id_}").json()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "kind"),
        ({"kind": "learn"}, "kind: expected first_start, identify or verify"),
        ({"kind": 3}, "kind: expected"),
        ({"kind": "first_start", "forwards": "motor"}, "forwards: expected encoder or phases"),
        ({"kind": "first_start", "current": 0}, "current: expected a number of 0.001 to 10000, got 0"),
        ({"kind": "first_start", "current": "3"}, "current: expected a number of"),
        ({"kind": "first_start", "current": True}, "current: expected a number of"),
        ({"kind": "first_start", "current": 6.1}, "current: currents go up to 6 A, the machine's rated one unless"),
        ({"kind": "identify", "bandwidth": 9.0}, "bandwidth: expected a number of 10 to 10000"),
        ({"kind": "identify", "bandwidth": 4000.0}, "bandwidth: expected at most 3333 rad/s with a control period of"),
        ({"kind": "verify", "of": 1}, "of"),
        ({"kind": "identify", "speed": 1}, "speed"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence_and_nothing_moves(
    client: httpx.Client, given: Told, said: str
) -> None:
    before = client.get(PLACE).json()
    assert said in refused(client.post(PLACE, json=given), 422)
    assert client.get(PLACE).json() == before
    assert client.get("/api/drives/x").json()["control"]["whom"] is None


def test_what_is_no_object_or_not_there_is_refused(client: httpx.Client) -> None:
    assert "expected a JSON object" in refused(client.post(PLACE, content=b"[]"), 422)
    assert "not JSON" in refused(client.post(PLACE, content=b"{"), 422)
    assert "no drive 'y'" in refused(client.post(PLACE.replace("/x/", "/y/"), json=FIRST), 404)
    assert "has no commissioning nothing" in refused(client.get(f"{PLACE}/nothing"), 404).replace("'", "")
    refused(client.delete(f"{PLACE}/nothing"), 404)
    for of in ("latest", "x-identify-1", "a" * 200):
        assert "has no identification" in refused(client.post(PLACE, json={"kind": "verify", "of": of}), 404)


def test_one_at_a_time_has_the_lease_and_ends_where_it_is_deleted(client: httpx.Client, bench: Bench) -> None:
    answer = client.post(PLACE, json=FIRST)
    told = answer.json()
    assert (answer.status_code, answer.headers["location"]) == (202, f"{PLACE}/{told['id']}")
    assert (told["state"], told["drive"], told["result"], told["file"]) == ("running", "x", {}, None)
    assert told["request"] == {
        "kind": "first_start", "forwards": "encoder", "current": 3.0, "bandwidth": None, "of": "latest",
        "follows": None,
    }  # fmt: skip
    begun(client)
    now = latest(client)
    assert now["phase"] == now["steps"][-1]["said"]
    control = client.get("/api/drives/x").json()["control"]
    assert control["whom"] == f"commissioning {told['id']} (asked for from 127.0.0.1)"
    assert (control["ours"], control["in_experiment"]) == (True, True)
    refused(client.post("/api/drives/x/start", json={}), 409)
    held = {"holds": [{"speed_rpm": 0.0, "i_d": 0.0, "i_q": 0.0, "seconds": 0.1}]}
    refused(client.post("/api/drives/x/experiments", json=held), 409)
    assert f"commissioning {told['id']}" in refused(client.post(PLACE, json=FIRST), 409)
    assert f"commissioning {told['id']}" in refused(
        client.put("/api/drives/x/signals", json={"i_q_ref": 0.0}), 409
    )  # fmt: skip
    slower = {"name": "slower", "entries": {"bandwidth": {"value": 900.0}}}
    for asked in (
        client.post("/api/drives/x/parameters/plan", json=slower), client.get("/api/drives/x/parameters/set"),
        client.get("/api/drives/x/parameters/rollback"),
    ):
        assert "has changed settings of the drive for as long" in refused(asked, 409)
    cancelled = client.delete(f"{PLACE}/{told['id']}")
    assert cancelled.status_code == 200, cancelled.text
    assert cancelled.json()["state"] == "cancelled"
    assert cancelled.json()["reason"] == "the first start was cancelled; the drive is stopped"
    assert bench.is_off()
    control = client.get("/api/drives/x").json()["control"]
    assert (control["whom"], control["in_experiment"]) == (None, False)
    refused(client.delete(f"{PLACE}/{told['id']}"), 409)


def test_a_stop_in_the_middle_is_answered_at_once_and_ends_it(client: httpx.Client, bench: Bench) -> None:
    told = moving(client)
    stopped = client.post("/api/drives/x/stop")
    assert stopped.is_success, stopped.text
    assert stopped.elapsed.total_seconds() < 2.0
    done = ended(client, told["id"])
    assert done["state"] == "cancelled"
    assert "\n" not in done["reason"]
    assert bench.is_off()


def test_what_goes_on_with_another_does_not_where_the_drive_was_stopped_since(client: httpx.Client) -> None:
    first = moving(client)
    client.delete(f"{PLACE}/latest").raise_for_status()
    client.post("/api/drives/x/stop", json={}).raise_for_status()
    asked = {"kind": "identify", "follows": first["id"]}
    assert f"was stopped since {first['id']}" in refused(client.post(PLACE, json=asked), 409)
    assert "has no commissioning 'nope'" in refused(client.post(PLACE, json=asked | {"follows": "nope"}), 404)


def test_the_present_parameters_are_not_told_while_a_trial_has_changed_some(client: httpx.Client) -> None:
    moving(client)
    assert "has changed settings" in refused(client.get("/api/drives/x/parameters/set"), 409)
    client.delete(f"{PLACE}/latest").raise_for_status()
    client.get("/api/drives/x/parameters/set").raise_for_status()


def test_the_same_key_begins_it_once(client: httpx.Client) -> None:
    answers = [client.post(PLACE, json=FIRST, headers={"Idempotency-Key": "first"}) for _ in range(2)]
    assert answers[0].status_code == 202
    assert answers[0].content == answers[1].content
    client.delete(f"{PLACE}/latest").raise_for_status()
    assert is_stop("DELETE", f"{PLACE}/latest")  # which is let through where others are put off


def test_what_became_of_it_is_known_to_the_next_service_also_where_one_is_killed(tmp_path: Path) -> None:
    with benched(tmp_path) as bench:
        before = bench.watched()
        with serving(bench) as (client, process):
            asked = moving(client)
            client.delete(f"{PLACE}/latest").raise_for_status()
            kept = ended(client, asked["id"])
            assert Path(kept["file"]).parent == tmp_path / "c" / "commissionings"
            moving(client)
            process.send_signal(signal.SIGKILL)
            process.wait(10.0)
        with serving(bench) as (client, _):
            assert client.get(f"{PLACE}/{asked['id']}").json() == kept
            until(lambda: client.get("/api/drives/x").json()["control"]["undone"] != "", "the drive to be as before")
            undone = client.get("/api/drives/x").json()["control"]["undone"]
            assert undone.startswith("a bench ended without notice in commissioning x-first-start-"), undone
            assert bench.is_off()
            assert bench.watched() == before
            moving(client)  # and the service ends meanwhile
        assert bench.is_off()
        assert bench.watched() == before


def test_an_identification_has_a_report_with_its_first_start_and_its_verification(tmp_path: Path) -> None:
    loop = {"name": "speed", "overshoot": 0.18, "settling": None, "tracking": 0.009, "promised_overshoot": 0.17,
            "promised_settling": 0.046, "promised_tracking": 0.0088, "sentence": ""}  # fmt: skip
    kinds = "first-start", "identify", "verify", "cancelled"
    first, found, checked, cancelled = (f"x-{kind}-20260131-120000-000" for kind in kinds)
    machine = {name: {"value": value, "std": 0.0, "unit": ""} for name, value in (
        ("R_s", 0.9664), ("L_d", 4.24e-3), ("L_q", 6.21e-3), ("psi_f", 0.12),
    )}  # fmt: skip
    results: dict[str, tuple[Told, Told]] = {
        first: ({"kind": "first_start"}, {"said": "4 pole pairs", "set": ""}),
        found: ({"kind": "identify", "follows": first}, {
            "machine": {"n_p": 4, **machine}, "shaft": None, "loops": [loop], "responses": {}, "set": "",
            "remarks": ["none of B"], "diagnosis": {"verdict": "explained", "sentence": "All is told."},
        }),
        checked: ({"kind": "verify"}, {"of": found, "loops": [loop], "responses": {}}),
        cancelled: ({"kind": "identify"}, {}),
    }  # fmt: skip
    with benched(tmp_path) as bench:
        (tmp_path / "c" / "commissionings").mkdir(parents=True)
        for k, (id_, (request, result)) in enumerate(results.items()):
            (tmp_path / "c" / "commissionings" / f"{id_}.json").write_text(json.dumps({
                "id": id_, "drive": "x", "asked": f"2026-01-31T12:00:0{k}+00:00", "request": request,
                "state": "cancelled" if id_ == cancelled else "done", "phase": "", "reason": "", "result": result,
            }), encoding="utf-8")  # fmt: skip
        with serving(bench) as (client, _):
            pages = [client.get(f"{PLACE}/{id_}/report.html") for id_ in (found, checked)]
            assert pages[0].headers["content-type"].startswith("text/html")
            assert pages[0].text == pages[1].text
            for said in ("All is told.", "4 pole pairs.", "none of B", "again at 2026-01-31 12:00 UTC", ">after<"):
                assert said in pages[0].text
            assert "expected the id of an identification that is done" in refused(
                client.get(f"{PLACE}/{first}/report.html"), 409
            )
            refused(client.get(f"{PLACE}/nothing/report.html"), 404)
            refused(client.get(f"{PLACE}/{cancelled}/report.html"), 409)
            asked = client.post(PLACE, json={"kind": "verify"})  # of the latest that tells a machine
            assert asked.status_code == 202, asked.text
            client.delete(f"{PLACE}/latest").raise_for_status()
            assert client.get(f"{PLACE}/{found}").json()["steps"] == []  # as one of before has none


@pytest.mark.thorough
def test_a_shaft_that_does_not_move_is_given_up_soon_and_said_why(client: httpx.Client, bench: Bench) -> None:
    begun_at = time.monotonic()
    asked = client.post(PLACE, json={"kind": "identify"}).json()
    done = ended(client, asked["id"])
    assert done["state"] == "failed", done
    assert "wrong pole pairs or a wrong angle do that as well: a first start tells" in done["reason"]
    assert done["steps"][0]["said"].startswith("bringing the shaft to")
    assert time.monotonic() - begun_at < 12.0
    assert bench.is_off()


@pytest.mark.thorough
def test_a_first_start_proposes_a_set_that_can_be_flashed(client: httpx.Client) -> None:
    done = ended(client, moving(client)["id"])
    assert done["state"] == "done", done
    result = done["result"]
    assert result["n_p"] == 4
    assert result["said"].startswith("4 pole pairs; the encoder counts with the field")
    assert result["values"]["n_p"] == 4.0
    plan = client.post("/api/drives/x/parameters/plan", content=result["set"],
                       headers={"Content-Type": "application/toml"}).json()  # fmt: skip
    changed = {change["signal"]: change["new"] for change in plan["changes"]}
    assert changed == {
        "n_p": 4.0, "angle_offset": pytest.approx(result["angle_offset"]),
        "overspeed_trip": pytest.approx(1.1 * 1500.0 * math.tau / 60.0 * 4),  # that of two pole pairs would be refused
    }  # fmt: skip
    assert (plan["problems"], plan["doubts"]) == ([], [])
    assert client.get(PLACE).json()["commissionings"][0] == done
