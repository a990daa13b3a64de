"""Two benches on one machine, over drives of their own, with one folder of captures: neither disturbs the other."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pyarrow.parquet as pq
import pytest

from bench.recordings.table import notes
from drivers import operation
from drivers.connect import connect
from drivers.wire.cia402 import State
from tests.conftest import COMMAND, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url, until

pytestmark = [pytest.mark.live, pytest.mark.slow]


@dataclass(frozen=True)
class Bench:
    """A service over one drive."""

    port: int
    process: "subprocess.Popen[str]"
    name: str

    def ask(self, method: str, path: str = "", body: object = None, drive: str = "") -> httpx.Response:
        url = f"http://127.0.0.1:{self.port}/api/drives/{drive or self.name}{path}"
        return httpx.request(method, url, json=body or {}, timeout=30.0)

    def told(self) -> Any:
        return self.ask("GET").json()

    def capture(self, length: int) -> str:
        """The id of a capture that has begun."""
        return self.ask("POST", "/captures", {"length": length}).raise_for_status().json()["id"]

    def captured(self, id_: str) -> dict[str, Any]:
        """What became of a capture."""
        ended = ("done", "failed", "cancelled")
        until(lambda: self.ask("GET", f"/captures/{id_}").json()["state"] in ended, "it to end")
        return self.ask("GET", f"/captures/{id_}").json()


@contextlib.contextmanager
def up(*options: str) -> Generator[tuple[Bench, str]]:
    """`pmsm-bench up` at a port, and where it says that its drive is."""
    port = free_port()
    with command("up", "--port", str(port), *options) as process:
        wait_for_answer(f"http://127.0.0.1:{port}/api/health", process)
        assert process.stdout is not None
        yield Bench(port, process, "emulated"), process.stdout.readline().split()[-1]


@contextlib.contextmanager
def serving(folder: Path, url: str, port: int) -> Generator[Bench]:
    """A service over a drive called x, with its captures in a folder."""
    config = folder / f"{port}.toml"
    lines = ["[service]", f"port = {port}", 'captures = "captures"', 'log = "log"', "[drives.x]", f'url = "{url}"']
    config.write_text("\n".join(lines), encoding="utf-8")
    with command("serve", "--config", str(config)) as process:
        wait_for_answer(f"http://127.0.0.1:{port}/api/health", process)
        bench = Bench(port, process, "x")
        until(lambda: bench.told()["control"]["state"] is not None, "a link")
        yield bench


def test_two_are_up_side_by_side_each_with_a_drive_of_its_own() -> None:
    with up() as (one, bus), up() as (other, other_bus), httpx.Client() as client:
        assert (bus, other_bus) == (one.told()["url"], other.told()["url"])
        assert bus != other_bus
        for bench in (one, other):
            until(lambda bench=bench: bench.ask("GET", "/estimates").json()["status"] == "ok", "estimates")
        ids = [bench.capture(20_000) for bench in (one, other)]  # under way at the same time
        said = [bench.captured(id_) for bench, id_ in zip((one, other), ids, strict=True)]
        assert [capture["state"] for capture in said] == ["done", "done"]
        assert [notes(Path(capture["file"]))["url"] for capture in said] == [bus, other_bus]
        listed = client.get(f"http://127.0.0.1:{other.port}/api/recordings").json()["recordings"]
        assert [next(each["url"] for each in listed if each["id"] == id_) for id_ in ids] == [bus, other_bus]
        table = subprocess.run(
            [*COMMAND, "recordings", "list", "--service", f"http://127.0.0.1:{other.port}"],
            capture_output=True, text=True, timeout=60.0, check=True, env=os.environ | {"COLUMNS": "200"},
        ).stdout
        assert bus in table
        assert other_bus in table
        one.process.send_signal(signal.SIGKILL)
        one.process.wait()
        time.sleep(1.0)
        assert other.told()["control"]["ours"]
        assert client.get(f"http://127.0.0.1:{other.port}/api/health").json()["status"] == "ok"
        with up() as (third, _):
            assert third.told()["control"]["undone"] == ""
            assert other.told()["control"]["ours"]


def test_where_the_usual_port_of_its_drive_is_taken_another_one_is() -> None:
    with up() as (_, bus):
        port = int(bus.split("/")[3].rpartition(":")[2])
        service = port - 29536 + 8080
        with command("up", "--port", str(service + 1)) as process:
            wait_for_answer(f"http://127.0.0.1:{service + 1}/api/health", process)
            assert process.stdout is not None
            assert process.stdout.readline().endswith(f"127.0.0.1:{port + 1}/can0/5\n")
    with emulator("--at", f"canopen://socketcand/127.0.0.1:{port}/can0/5") as taken:
        ready(taken)
        with command("up", "--port", str(service)) as process:
            wait_for_answer(f"http://127.0.0.1:{service}/api/health", process)
            assert process.stdout is not None
            assert f":{port}/" not in process.stdout.readline()


def test_what_a_killed_bench_left_is_not_taken_up_by_one_over_another_drive(tmp_path: Path) -> None:
    urls, ports = (tcp_url(), tcp_url()), (free_port(), free_port())
    with emulator("--at", urls[0], control="lease") as one, emulator("--at", urls[1], control="lease") as other:
        ready(one)
        ready(other)
        with serving(tmp_path, urls[0], ports[0]) as bench:
            until(lambda: bench.ask("POST", "/start", {"i_q_ref": 1.0}).is_success, "a start")
            id_ = bench.capture(60_000)
            until(lambda: bench.ask("GET", f"/captures/{id_}").json()["state"] == "uploading", "an upload")
            bench.process.send_signal(signal.SIGKILL)
            bench.process.wait()
        with serving(tmp_path, urls[1], ports[1]) as second:
            assert second.told()["control"]["undone"] == ""
            assert second.ask("GET", "/captures").json()["captures"] == []
            assert second.captured(second.capture(1000))["state"] == "done"
            assert (tmp_path / "captures" / f"{id_}.part").exists()
            with serving(tmp_path, urls[0], ports[0]) as again:
                until(lambda: bool(again.told()["control"]["undone"]), "what it says of what it undid")
                said = again.captured(id_)
                assert (said["state"], said["samples"]) == ("done", 60_000)
                assert pq.read_metadata(said["file"]).num_rows == 60_000
            assert second.told()["control"]["undone"] == ""


def test_a_second_bench_over_the_same_drive_only_watches_and_leaves_captures_under_way_alone(tmp_path: Path) -> None:
    url = tcp_url()
    with emulator("--at", url, control="lease") as drive:
        ready(drive)
        with serving(tmp_path, url, free_port()) as one:
            until(lambda: one.ask("POST", "/start", {"i_q_ref": 1.0}).is_success, "a start")
            id_ = one.capture(60_000)
            with serving(tmp_path, url, free_port()) as two:
                refused = two.ask("POST", "/start", {"i_q_ref": 2.0})
                assert refused.status_code == 409
                assert "controls the drive" in refused.json()["detail"]
                assert two.ask("GET", "/captures").json()["captures"] == []
                assert one.captured(id_)["state"] == "done"
            assert one.told()["control"]["ours"]
        with connect(url) as seen:
            assert operation.state(seen) is not State.OPERATION_ENABLED
