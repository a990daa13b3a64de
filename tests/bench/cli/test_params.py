"""`pmsm-bench params`: a firmware engineer's way, from a drive's values to others and back, by bus and by service."""

import contextlib
import json
import re
import subprocess
from collections.abc import Generator, Iterator
from pathlib import Path

import httpx
import pytest

from bench.actions.safety.unfinished import Noted, Origin
from drivers.connect import connect
from drivers.lease import Lease
from tests.conftest import COMMAND, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, until
from tests.support.transports import modbus_tcp_url

pytestmark = pytest.mark.live


def params(*arguments: str | Path, code: int = 0) -> str:
    done = subprocess.run(
        [*COMMAND, "params", *map(str, arguments)], capture_output=True, text=True, timeout=120.0, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == code, done
    assert "Traceback" not in done.stderr
    return done.stdout if code in (0, 1) else done.stderr


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    with emulator("--at", url := modbus_tcp_url(), "--memory", str(tmp_path / "memory"), control="lease") as process:
        ready(process)
        yield url


@contextlib.contextmanager
def serving(url: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[str]:
    """The name of a drive at the usual service."""
    port, config = free_port(), folder / "bench.toml"
    config.write_text(f'[drives.spindle]\nurl = "{url}"\n[drives.spindle.limits]\ni_max = 6.0\n', encoding="utf-8")
    monkeypatch.setenv("PMSM_BENCH_PORT", str(port))
    with command("serve", "--config", str(config)) as service:
        place = f"http://127.0.0.1:{port}/api/drives/spindle"
        wait_for_answer(place, service)
        until(lambda: httpx.get(place).json()["link"]["state"] == "streaming", "the link")
        yield "spindle"


def test_while_another_bench_is_at_work_with_a_drive_nothing_is_read_of_it(url: str, tmp_path: Path) -> None:
    with connect(url) as drive:
        at_work = Noted(Origin(tmp_path / "data" / "pmsm-bench" / "flash", "x", "a trial"), drive, Lease(), {})
        drive.close()
        assert "another bench on this machine is at work with this drive" in params("pull", url, code=2)
        at_work.close()


@pytest.fixture(params=["by its bus", "by service"])
def drive(request: pytest.FixtureRequest, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """As it is named at the command line."""
    if request.param == "by its bus":
        yield url
        return
    with serving(url, tmp_path, monkeypatch) as name:
        yield name


def test_from_the_drives_values_to_others_and_back(drive: str, tmp_path: Path) -> None:
    old, new, third = (tmp_path / f"{name}.toml" for name in ("old", "new", "third"))
    assert "written" in params("pull", drive, "--out", old)
    text = old.read_text(encoding="utf-8")
    assert 'layout_id = "0x' in text
    new.write_text(re.sub("(?m)^bandwidth = .*$", "bandwidth = 900.0", text.replace("as it is", "slower")))
    assert params("diff", new, old, code=1) == "bandwidth: 900 here, 1250 there (rad/s)\n"
    plan = json.loads(params("plan", new, drive, "--json"))
    assert [(one["signal"], one["old"], one["new"], one["bits_new"]) for one in plan["changes"]] == [
        ("bandwidth", 1250.0, 900.0, "00006144")
    ]
    assert params("flash", new, drive, code=2).endswith("expected --yes, as nobody can be asked here\n")
    assert "flashed: 1 value changed, stored, and read back after a reset" in params("flash", new, drive, "--yes")
    assert params("verify", new, drive).startswith("all 3")
    assert params("verify", old, drive, code=1) == "bandwidth: 1250 here, 900 there (rad/s)\n"
    assert "flashed" in params("rollback", drive, "--yes")
    assert params("verify", old, drive).startswith("all 3")
    third.write_text(new.read_text(encoding="utf-8").replace("bandwidth = 900.0", "bandwidth = 800.0"))
    for given in (new, third):
        params("flash", given, drive, "--yes")
    *lines, way = params("history", drive).splitlines()
    assert [line.split("'")[1] for line in lines] == ["slower", "before slower", "slower", "slower"]
    assert f"`pmsm-bench params rollback {drive} --before TIME`" in way
    time = lines[0].split()[0]
    assert "which is the beginning of 4" in params("rollback", drive, "--before", time[:10], "--yes", code=2)
    assert "flashed: 1 value changed" in params("rollback", drive, "--before", time, "--yes")
    assert params("verify", old, drive).startswith("all 3")
    assert params("resume", drive, "--finish", code=2) == "pmsm-bench: no flash of this drive was cut\n"


def test_limits_of_the_service_are_told_as_what_a_set_has_wrong(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = tmp_path / "set.toml"
    given.write_text('name = "a"\n[parameters]\ncurrent_limit = 7.0\n', encoding="utf-8")
    with serving(url, tmp_path, monkeypatch) as name:
        assert "forbidden: current_limit: currents go up to 6 A" in params("plan", given, name, code=1)
        assert "current_limit: currents go up to 6 A" in params("flash", given, name, "--yes", code=2)
        assert "no drive 'other'" in params("pull", "other", code=2)
        assert "expected a drive's name with --service" in params("pull", url, "--service", "http://x", code=2)
        assert "flashed: 1 value changed" in params("flash", given, url, "--yes")  # whose limits nobody told
        assert [one["drive"] for one in json.loads(params("history", name, "--json"))["flashes"]] == [url]
    assert "no bench service answers at" in params("pull", name, code=2)


def test_what_is_stored_outlives_the_drives_power(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    url, given = modbus_tcp_url(), tmp_path / "set.toml"
    given.write_text('name = "a"\n[parameters]\nbandwidth = 777.0\n', encoding="utf-8")
    for again in (False, True):
        with emulator("--at", url, "--memory", str(tmp_path / "memory"), control="lease") as process:
            ready(process)
            if not again:
                params("flash", given, url, "--yes")
            assert params("verify", given, url) == "all 1 values are the same\n"


def test_a_set_goes_to_other_tools_and_comes_from_one(url: str, tmp_path: Path) -> None:
    old, dcf, back = tmp_path / "old.toml", tmp_path / "drive.dcf", tmp_path / "back.toml"
    params("pull", url, "--out", old, "--name", "servo")
    assert "#define PMSM_BANDWIDTH 1250.0f" in params("export", old, "--form", "c")
    assert "/begin CHARACTERISTIC bandwidth" in params("export", old, "--form", "a2l")
    assert json.loads(params("export", old, "--form", "json"))["entries"]["n_p"]["value"] == 4.0
    params("export", old, "--form", "dcf", "--out", dcf)
    params("import", dcf, "--out", back)
    assert params("diff", back, old).startswith("all ")
    assert "bandwidth" in params("show", old)
    assert json.loads(params("show", old, "--json"))["name"] == "servo"


def test_what_cannot_be_is_one_sentence_each(drive: str, tmp_path: Path) -> None:
    given = tmp_path / "set.toml"
    given.write_text('name = "a"\n[parameters]\nbandwidth = 1.0\nspeed = 2\n', encoding="utf-8")
    said = params("flash", given, drive, "--yes", code=2)
    assert "(bandwidth) takes at least 10.0 rad/s, got 1.0" in said
    assert "no signal 'speed'" in said
    assert "cannot be read: No such file" in params("plan", tmp_path / "no.toml", drive, code=2)
    assert "expected" in params("pull", "http://x", code=2)
    given.write_text('name = "a"\n[parameters]\ncontrol_R_s = { value = 1.0, status = "doubtful" }\n')
    assert "control_R_s is doubtful" in params("plan", given, drive, code=1)
    assert "expected a reason" in params("flash", given, drive, "--yes", code=2)
    assert "flashed" in params("flash", given, drive, "--yes", "--override", "on a test bench")


def test_every_subcommand_is_listed() -> None:
    text, names = params("--help"), "pull show diff plan flash verify rollback resume history export import"
    assert all(name in text for name in names.split())
