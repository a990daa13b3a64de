"""The past over REST, and what a service remembers over a restart."""

import socket
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from bench.config import Config, DriveConfig
from bench.live.window import Window
from bench.service.service import Service
from bench.store.catalogue.chronicle import Chronicle, ParameterSet
from tests.bench.api.test_api import problem
from tests.conftest import JSON, RunningBench
from tests.support.served_drive import served, tcp_url, until

pytestmark = pytest.mark.live

HISTORY = "/api/drives/emulated/history"


def test_the_past_comes_with_units_and_in_its_order(running_bench: RunningBench) -> None:
    with httpx.Client(base_url=running_bench.url) as client:
        until(lambda: len(client.get(HISTORY).json()["parameters"].get("L_d", {"t": []})["t"]) > 2, "a past")
        said = client.get(HISTORY, params={"seconds": 60}).json()
        course = said["parameters"]["L_d"]
        assert (said["drive"], said["span_s"], course["unit"]) == ("emulated", 1, "H")
        assert course["t"] == sorted(set(course["t"]))
        assert {len(course[key]) for key in ("t", "value", "std", "low", "high", "status")} == {len(course["t"])}
        assert course["value"][-1] == pytest.approx(4.24e-3, rel=0.01)
        assert abs(course["t"][-1] - time.time()) < 10.0
        early = client.get(HISTORY, params={"until": "2020-01-01T00:00:00Z"}).json()
        assert early["parameters"] == {}
        for no in ("now", "0007-05-08T00:14:47Z"):
            assert "until: expected a time of 1970 or later" in problem(client.get(HISTORY, params={"until": no}), 422)
        assert problem(client.get(HISTORY, params={"seconds": 0}), 422)
        assert "no drive" in problem(client.get("/api/drives/nobody/history"), 404)


@contextmanager
def running(url: str, folder: Path, database: str, window: Window | None = None) -> Generator[Service]:
    config = Config((DriveConfig("spindle", url, window or Window()),), captures=folder, database=database)
    with Service(config) as service:
        until(lambda: service.link("spindle").rows > 0, "rows")
        yield service


def test_a_restart_remembers_the_window_and_the_past(tmp_path: Path) -> None:
    database = str(tmp_path / "catalogue.sqlite")
    with served(tcp_url()) as drive:
        with running(drive.url, tmp_path / "captures", database) as service:
            service.change_window("spindle", {"length": 1500, "method": "rls", "forgetting_factor": 0.999})
            until(lambda: service.estimates("spindle").result.samples > 1000, "samples")
            time.sleep(1.5)
        with running(drive.url, tmp_path / "captures", database) as service:
            window = service.estimates("spindle").window
            assert (window.length, window.method, window.forgetting_factor) == (1500, "rls", 0.999)
            assert service.history is not None
            memory = service.history.open()
            assert memory is not None
            _, courses = memory.history("spindle", time.time() - 60.0, time.time())
            assert courses["R_s"].t
        with running(drive.url, tmp_path / "captures", database, Window(length=700)) as service:
            assert service.estimates("spindle").window.length == 700  # the configuration is newer


def test_a_service_lives_without_its_catalogue(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with (
        served(tcp_url()) as drive,
        running(drive.url, tmp_path / "captures", str(tmp_path / "file" / "catalogue.sqlite")) as service,
    ):
        service.change_window("spindle", {"length": 900})
        assert service.estimates("spindle").window.length == 900
        (history,) = [thread for thread in service.threads() if thread.name == "history"]
        assert history.alive
        assert "the catalogue cannot be opened" in str(history.failure)
        assert not service.healthy()


def test_a_bench_is_known_by_its_host_and_port(tmp_path: Path) -> None:
    with served(tcp_url()) as drive, running(drive.url, tmp_path, str(tmp_path / "c.sqlite")) as service:
        assert service.history is not None
        assert service.history.bench == f"{socket.gethostname()}:8080"


def test_what_happens_to_a_drive_and_its_parameters_are_kept(tmp_path: Path) -> None:
    database = str(tmp_path / "catalogue.sqlite")
    with served(tcp_url(), control="lease") as drive:
        with running(drive.url, tmp_path / "captures", database) as service:
            until(lambda: len(parameters(service)) == 1, "parameters")
            drive.drive.write("bandwidth", 1500.0)
            service.start_drive("spindle", {"i_q_ref": 1.0}, "me")
            service.stop_drive("spindle", "me")
            capture = service.captures.ask("spindle", {"length": 500}).id
            until(lambda: service.captures.one("spindle", capture).state == "done", "the capture")
            until(lambda: len(parameters(service)) == 2, "parameters")
        with running(drive.url, tmp_path / "captures", database) as service:
            until(lambda: service.control("spindle").state is not None, "a look")
        with running(drive.url, tmp_path / "captures", database) as service:
            happened = chronicle(service).page("spindle", None, None, 100)[0]
            later, first = parameters(service)  # which have not changed over the restarts
    leases = [one for one in happened if one.kind == "lease"]
    assert [one.told["how"] for one in leases] == ["done", "stopped by me"]
    assert leases[0].told["holder"] == f"capture {capture}"
    assert "started from me" in leases[1].told["holder"]
    assert all(one.told["ended"] >= one.at for one in leases)
    states = [one.sentence for one in reversed(happened) if one.kind == "state"]
    assert "operation enabled" in states
    links = [one.sentence for one in happened if one.kind == "link"]
    assert len(links) >= 2  # the third may have come late
    assert all(link.startswith("there: ") for link in links)
    assert (first.why, later.why) == ("connected", f"capture {capture}")
    assert first.values["bandwidth"] != later.values["bandwidth"] == 1500.0
    assert later.values["capture_length"] == 500.0


def chronicle(service: Service) -> Chronicle:
    assert service.history is not None
    memory = service.history.open()
    assert memory is not None
    return memory.chronicle


def parameters(service: Service) -> list[ParameterSet]:
    return chronicle(service).snapshots("spindle", None, 9)[0]


def test_events_and_parameters_come_over_rest(running_bench: RunningBench) -> None:
    drive = "/api/drives/emulated"
    with httpx.Client(base_url=running_bench.url, headers=JSON) as client:
        until(lambda: bool(client.get(f"{drive}/parameters").json()["snapshots"]), "parameters")
        before = client.get(f"{drive}/signals", params={"names": "bandwidth"}).json()["signals"][0]["value"]
        assert client.put(f"{drive}/signals", json={"bandwidth": 1234.0}).status_code == 200
        asked = client.post(f"{drive}/captures", json={"length": 100}).json()["id"]
        until(lambda: client.get(f"{drive}/parameters").json()["total"] > 1, "parameters")
        client.put(f"{drive}/signals", json={"bandwidth": before})
        newest = client.get(f"{drive}/parameters", params={"limit": 1}).json()
        (one,) = newest["snapshots"]
        assert one["why"] == f"capture {asked}"
        assert {"name": "bandwidth", "unit": "rad/s", "from": before, "to": 1234.0} in one["changed"]
        (first,) = client.get(f"{drive}/parameters", params={"before": newest["next"]}).json()["snapshots"]
        assert (first["why"], first["changed"], first["values"]["bandwidth"]) == ("connected", [], before)
        none = client.get(f"{drive}/parameters", params={"before": "2009-12-11T20:35:58Z"}).json()
        assert none == {"snapshots": [], "total": 0, "next": None}
        writes = {"kind": "write", "limit": 2}
        until(lambda: client.get(f"{drive}/events", params=writes).json()["total"] > 2, "writes")
        said = client.get(f"{drive}/events", params=writes).json()
        write = said["events"][-1]["write"]
        assert (write["method"], write["path"], write["by"]) == ("POST", f"{drive}/captures", "loopback")
        assert said["events"][0]["write"]["before"] == {"bandwidth": 1234.0}
        kinds = {event["kind"] for event in client.get(f"{drive}/events").json()["events"]}
        assert {"link", "state", "write", "lease"} <= kinds
        page = client.get(f"{drive}/events", params={"before": said["next"], "kind": "write"}).json()
        assert (page["total"], page["next"]) == (1, None)
        assert "before: expected a time" in problem(client.get(f"{drive}/events", params={"before": "x"}), 422)
