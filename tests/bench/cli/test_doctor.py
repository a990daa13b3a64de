"""`pmsm-bench doctor`, `--version` and `--json`: what can be said of a bench without disturbing it."""

import json
import os
import pty
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.conftest import COMMAND, bus_url, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, until
from tests.support.transports import modbus_tcp_url, serial_socket_url

pytestmark = [pytest.mark.live, pytest.mark.thorough]


def run(*arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=240.0, check=False, env=os.environ | environment
    )


@dataclass(frozen=True)
class Examined:
    code: int
    checks: dict[str, dict[str, Any]]

    def verdict(self, what: str) -> str:
        return str(self.checks[what]["verdict"])

    def said(self, what: str) -> str:
        return f"{self.checks[what]['found']}; {self.checks[what]['advice']}"


def examined(*arguments: str, **environment: str) -> Examined:
    done = run("doctor", "--json", *arguments, **environment)
    assert done.stderr == ""
    told = json.loads(done.stdout)
    assert done.returncode == (1 if told["verdict"] == "failed" else 0)
    assert all(check["advice"] or check["verdict"] == "ok" for check in told["checks"])
    return Examined(done.returncode, {check["what"]: check for check in told["checks"]})


def configured(folder: Path, port: int, *lines: str, **urls: str) -> Path:
    path = folder / f"{port}.toml"
    head = ["[service]", f"port = {port}", 'captures = "captures"', 'log = "log"', 'token = "token"', *lines]
    drives = [f'[drives.{name}]\nurl = "{url}"' for name, url in urls.items()]
    path.write_text("\n".join([*head, *drives]), encoding="utf-8")
    return path


def test_the_version_is_one_line() -> None:
    done = run("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"pmsm-bench \d+\.\d+\.\d+, Python 3\.\d+\.\d+, \S+\n", done.stdout)


def test_a_sound_bench_is_told_line_by_line(tmp_path: Path) -> None:
    url = bus_url(free_port())
    with emulator("--at", url) as drive:
        ready(drive)
        done = run("doctor", "--config", str(configured(tmp_path, free_port(), x=url)))
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert all(line.startswith(("ok  ", "warning  ")) for line in lines)
    said = {line.split(maxsplit=1)[1].partition(":")[0] for line in lines}
    assert {"versions", "packages", "kernels", "clock", "configuration", "folder of captures", "drive x"} <= said
    assert {path.name for path in tmp_path.iterdir()} == {next(tmp_path.glob("*.toml")).name}  # nothing was made


def test_a_configuration_that_cannot_be_fails_in_its_own_sentence(tmp_path: Path) -> None:
    config = tmp_path / "bench.toml"
    config.write_text(f"[service]\nport = 'web'\n[drives.x]\nurl = '{bus_url(5)}'\n", encoding="utf-8")
    said = examined("--config", str(config))
    assert said.code == 1
    assert "expected a port of 0 to 65535" in said.said("configuration")
    assert run("doctor", "--nonsense").returncode == 2


def test_a_port_is_free_or_of_another_program_which_is_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = examined("--port", str(port))
    assert said.verdict(f"port {port}") == "failed"
    assert f"({os.getpid()})" in said.said(f"port {port}")
    port = free_port()
    assert examined("--config", str(configured(tmp_path, port, x=bus_url(free_port())))).verdict(f"port {port}") == "ok"


def test_what_keeps_a_drive_from_being_reached_is_said_with_what_to_do(tmp_path: Path) -> None:
    said = examined("--config", str(configured(
        tmp_path, free_port(), gone=bus_url(free_port()), tcp=modbus_tcp_url(), line="uart:///dev/ttyUSB77",
        file=f"uart://{tmp_path}/none", can="canopen://socketcan/can77/5", unknown="canopen://nonsense/x/5",
        lo="canopen://socketcan/lo/5", named="modbus+tcp://no-such-host.invalid/1",
    )))  # fmt: skip
    expected = {
        "gone": "Connection refused; switch drive or gateway on", "tcp": "Connection refused",
        "line": "/dev/ttyUSB77: No such file or directory; serial adapters here: ", "file": "No such file",
        "can": "no interface can77; CAN interfaces here: ", "unknown": "python-can has no interface 'nonsense'",
        "lo": "lo is an interface, but not of CAN", "named": "no-such-host.invalid: ",
    }
    for name, sentence in expected.items():
        assert said.verdict(f"drive {name}") == "failed"
        assert sentence in said.said(f"drive {name}")
    assert said.code == 1


def test_a_serial_device_is_not_opened_and_who_has_it_is_named(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    device = os.ttyname(theirs)
    config = configured(tmp_path, free_port(), x=f"uart://{device}")
    try:
        assert "is open in python" in examined("--config", str(config)).said("drive x")
    finally:
        os.close(theirs)
    assert "there and permitted" in examined("--config", str(config)).said("drive x")
    os.close(ours)


def test_a_line_that_takes_one_client_is_not_asked_beside_another(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as gateway:
        port = gateway.getsockname()[1]
        config = configured(tmp_path, free_port(), x=f"modbus+tcp://127.0.0.1:{port}/1")
        with socket.create_connection(("127.0.0.1", port)), gateway.accept()[0]:
            assert "not asked a second time" in examined("--config", str(config)).said("drive x")
            gateway.setblocking(False)
            with pytest.raises(BlockingIOError):
                gateway.accept()
        assert "takes connections" in examined("--config", str(config)).said("drive x")


def test_folders_and_a_token_that_others_may_read_are_told(tmp_path: Path) -> None:
    config = configured(tmp_path, free_port(), 'host = "0.0.0.0"', "insecure = true", x=bus_url(free_port()))
    assert "the first start makes it" in examined("--config", str(config)).said("token")
    (tmp_path / "token").write_text("x" * 40, encoding="ascii")
    (tmp_path / "token").chmod(0o644)
    said = examined("--config", str(config))
    assert said.verdict("token") == "failed"
    assert "got mode 0644; chmod 600" in said.said("token")
    if os.geteuid():  # nothing is forbidden to root
        (tmp_path / "captures").mkdir(mode=0o500)
        assert "cannot be written by" in examined("--config", str(config)).said("folder of captures")


@pytest.fixture(scope="module")
def serving(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """A service over two drives: its configuration and its address."""
    port, urls = free_port(), {"can": bus_url(free_port()), "line": serial_socket_url()}
    config = configured(tmp_path_factory.mktemp("serving"), port, **urls)
    with emulator(*(part for url in urls.values() for part in ("--at", url)), control="lease") as drive:
        ready(drive)
        with command("serve", "--config", str(config)) as process:
            url = f"http://127.0.0.1:{port}"
            wait_for_answer(f"{url}/api/health", process)
            until(lambda: httpx.get(f"{url}/api/health").json()["status"] == "ok", "health")
            yield config, url


def test_a_running_service_is_asked_for_its_drives_and_not_disturbed(serving: tuple[Path, str]) -> None:
    config, url = serving
    said = examined("--config", str(config))
    port = url.rpartition(":")[2]
    assert "a bench service (0.1.0) answers" in said.said(f"port {port}")
    for name in ("can", "line"):
        assert "the running service has it: " in said.said(f"drive {name}")
    without = examined(PMSM_BENCH_PORT=port)  # no configuration: its drives all the same
    assert without.verdict("drive can") == "ok"
    other = configured(config.parent, int(port), x="uart:///dev/ttyUSB77")
    config.touch()
    assert "over canopen://" in examined("--config", str(other)).said(f"port {port}")
    configured(config.parent, int(port), **{drive["name"]: drive["url"] for drive in drives(url)})
    assert [(d["link"]["state"], d["link"]["reconnects"], d["stream"]["gaps"]) for d in drives(url)] == [
        ("streaming", 0, 0)
    ] * 2


def drives(url: str) -> list[dict[str, Any]]:
    return httpx.get(f"{url}/api/drives").json()["drives"]


@pytest.mark.slow
def test_every_table_is_one_json_document_as_well(serving: tuple[Path, str], tmp_path: Path) -> None:
    _, url = serving
    time.sleep(0.5)  # rows

    def said(*arguments: str, codes: tuple[int, ...] = (0,)) -> Any:
        done = run(*arguments)
        assert done.returncode in codes, done.stderr
        return json.loads(done.stdout)

    at = ("--service", url, "--json")
    estimates = said("estimates", "can", *at, codes=(0, 1, 3))["estimates"]
    assert {name: one["unit"] for name, one in estimates.items()} == {
        "R_s": "ohm", "L_d": "H", "L_q": "H", "psi_f": "Vs"
    }
    assert said("start", "can", "i_q_ref=1.5", *at)["state"] == "operation enabled"
    (signal,) = said("signals", "can", "i_q_ref", *at)["signals"]
    assert (signal["value"], signal["unit"]) == (1.5, "A")
    assert said("stop", "can", *at)["state"] == "switch on disabled"
    assert said("registers", "--json")[0].keys() >= {"address", "name", "unit"}
    refused = run("reset", "can", *at)
    assert (refused.returncode, refused.stdout) == (2, "")
    recording = tmp_path / "run.parquet"
    assert run("start", "can", "i_d_step=1", "i_q_step=1", "--service", url).returncode == 0
    assert run("capture", "can", "--length", "6000", "--out", str(recording), "--service", url).returncode == 0
    assert said("replay", str(recording), "--json", "-", codes=(0, 1, 3))["estimates"].keys() == estimates.keys()
    machine = tmp_path / "machine.toml"
    machine.write_text(
        "[machine]\nR_s = 0.9664\nL_d = 4.24e-3\nL_q = 6.21e-3\npsi_f = 0.12\nn_p = 4\ni_rated = 6.0\n",
        encoding="utf-8",
    )
    simulated = said("simulate", str(recording), "--machine", str(machine), "--json")
    assert simulated["one_step_rms_V"]["before"] > 0.0
    diagnosis = said("diagnose", str(recording), "--nominal", str(machine), "--json", "-", codes=(0, 1, 3))
    assert "verdict" in diagnosis
    several = run("diagnose", str(recording), str(recording), "--nominal", str(machine), "--json", "-")
    assert (several.returncode, several.stdout) == (2, "")
    assert several.stderr == "pmsm-bench: --json -: expected one recording, got 2; of several a folder takes them\n"
