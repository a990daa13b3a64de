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
from tests.bench.api.test_api import problem
from tests.conftest import RunningBench
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
        assert "until: expected a time such as" in problem(client.get(HISTORY, params={"until": "now"}), 422)
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
