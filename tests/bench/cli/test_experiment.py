"""`pmsm-bench experiment`: a recording that cannot tell, what it asks for done on an emulated drive, the answer."""

import json
import signal
import subprocess
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from drivers import operation
from drivers.connect import connect
from drivers.wire.cia402 import State
from tests.conftest import COMMAND, command, free_port, wait_for_answer
from tests.support.recordings import read_recording
from tests.support.served_drive import emulator, ready, tcp_url, until

pytestmark = [pytest.mark.live, pytest.mark.thorough]

MACHINE = """[machine]
R_s = 0.95
L_d = 4.1e-3
L_q = 6.3e-3
psi_f = 0.118
n_p = 4
i_rated = 6.0
[drive]
T_s = 1e-4
u_dc = 310.0
"""
HELD = """[motor]
R_s = 0.9664
L_d = 4.24e-3
L_q = 6.21e-3
psi_f = 0.12
n_p = 4
i_rated = 6.0
[drive]
bridge = "{bridge}"
[run]
speed_rpm = 1200.0
[excitation]
i_q_ref = 3.0
kind = "none"
{effect}
"""
DONE: dict[str, Any] = {"holds": [{"speed_rpm": 1200.0, "i_d": 0.0, "i_q": 1.0, "seconds": 0.5}], "step": 0.3}
LONG: dict[str, Any] = {"holds": [{"speed_rpm": 1200.0, "i_d": 0.0, "i_q": 1.0, "seconds": 30.0}], "step": 0.3}


@contextmanager
def drive_with(effect: str, folder: Path, bridge: str = "averaged") -> Generator[str]:
    """The URL of an emulated drive, of a process of its own, that holds one level of current."""
    (folder / "held.toml").write_text(HELD.format(bridge=bridge, effect=effect), encoding="utf-8")
    (folder / "m.toml").write_text(MACHINE, encoding="utf-8")
    url = tcp_url()
    with emulator("--at", url, "--scenario", f"{folder}/held.toml") as process:
        ready(process)
        yield url


def said(folder: Path, *arguments: str, codes: tuple[int, ...] = (0,)) -> str:
    """What the command prints."""
    done = subprocess.run(
        [*COMMAND, *arguments], cwd=folder, capture_output=True, text=True, timeout=180, check=False
    )
    assert done.returncode in codes, done
    return done.stdout + done.stderr


def told(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def stopped(url: str) -> bool:
    with connect(url) as drive:
        return operation.state(drive) is State.SWITCH_ON_DISABLED


def written(folder: Path, plan: dict[str, Any]) -> str:
    """A diagnosis that asks for an experiment."""
    instead: dict[str, Any] = {"sentence": "record a level", "speeds_rpm": [], "duration": 1.0, "odds": None}
    content: dict[str, Any] = {"verdict": "not_enough_excitation", "ambiguous": [], "experiment": instead | plan}
    (folder / "d.json").write_text(json.dumps(content), encoding="utf-8")
    return "d.json"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "name"),
    [
        pytest.param("[effects.inverter]\ndead_time = 2e-6", "inverter_voltage_error", id="dead time"),
        pytest.param("[effects.iron_loss]\nR_c = 60.0", "iron_loss", id="iron loss"),
        pytest.param("[effects.angle_sensing]\noffset = 0.02", "angle_offset", id="angle"),
        pytest.param("[effects.saturation]\nL_q_drop = 0.3", "q_axis_saturation", id="saturation"),
    ],
)
def test_what_one_level_cannot_tell_the_experiment_does(effect: str, name: str, tmp_path: Path) -> None:
    with drive_with(effect, tmp_path, bridge="switched") as url:
        said(tmp_path, "capture", "--drive", url, "--length", "20000", "--out", "poor.parquet")
        said(tmp_path, "diagnose", "poor.parquet", "--nominal", "m.toml", "--json", "poor.json", codes=(3,))
        first = told(tmp_path / "poor.json")
        assert first["findings"] == []
        assert first["verdict"] in ("ambiguous", "not_enough_excitation")
        text = said(tmp_path, "experiment", "poor.json", "--drive", url, "--out", "rich.parquet")
        assert "  1: " in text
        assert "rich.parquet: 60000 samples; the drive is stopped; next: pmsm-bench diagnose rich.parquet" in text
        assert stopped(url)
    said(tmp_path, "diagnose", "rich.parquet", "--nominal", "m.toml", "--json", "rich.json", codes=(0, 1, 3))
    rich = told(tmp_path / "rich.json")
    if name == "angle_offset":  # at one speed a latency is the same
        (doubt,) = rich["ambiguous"]
        assert set(doubt["effects"]) == {name, "angle_latency"}
        assert "a second speed" in doubt["experiment"]["sentence"]
        return
    assert [finding["effect"] for finding in rich["findings"]] == [name]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with drive_with("", tmp_path_factory.mktemp("drive")) as at:
        yield at


def test_ctrl_c_stops_the_drive_and_leaves_no_file(url: str, tmp_path: Path) -> None:
    asked = written(tmp_path, LONG)
    process = subprocess.Popen(
        [*COMMAND, "experiment", asked, "--drive", url], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    with connect(url) as drive:

        def begun() -> bool:
            assert process.poll() is None, process.communicate()[1].decode()
            return drive.read("i_q_step") == pytest.approx(0.3) and operation.state(drive) is State.OPERATION_ENABLED

        until(begun, "it does not begin")
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=30.0)
    assert (process.returncode, error) == (130, b"")
    assert stopped(url)
    assert [path.name for path in tmp_path.iterdir()] == ["d.json"]


@pytest.mark.parametrize(
    ("content", "options", "error"),
    [
        ("no", (), "d.json: expected a diagnosis as `pmsm-bench diagnose --json` writes it, got no JSON"),
        ("[]", (), "d.json: expected a diagnosis as `pmsm-bench diagnose --json` writes it, got other JSON"),
        ('{"verdict": "explained", "ambiguous": []}', (), "got one that does not: it is explained"),
        ('{"ambiguous": [{"experiment": {"holds": []}}]}', ("--ambiguity", "2"), "an ambiguity from 1 to 1"),
        ("", ("--out", "x.csv"), "--out: expected a file name that ends in .parquet, got 'x.csv'"),
        ("", ("spindle",), "expected a drive's name, or its URL by --drive, got both"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(
    content: str, options: tuple[str, ...], error: str, tmp_path: Path
) -> None:
    (tmp_path / "d.json").write_text(content, encoding="utf-8")
    text = said(tmp_path, "experiment", "d.json", *options, "--drive", "canopen://virtual/nobody/5", codes=(2,))
    assert error in text
    assert text.count("\n") == 1


def test_the_service_does_it_under_the_drives_lease_and_hands_out_the_recording(url: str, tmp_path: Path) -> None:
    port = free_port()
    (tmp_path / "bench.toml").write_text(
        f'[service]\nport = {port}\ncaptures = "captures"\n[drives.emulated]\nurl = "{url}"\n', encoding="utf-8"
    )
    root = f"http://127.0.0.1:{port}/api"
    routes = f"{root}/drives/emulated/experiments"

    def control() -> dict[str, Any]:
        return httpx.get(f"{root}/drives/emulated").json()["control"]

    with command("serve", "--config", f"{tmp_path}/bench.toml") as process:
        wait_for_answer(f"{root}/health", process)
        until(lambda: httpx.get(f"{root}/health").json()["status"] == "ok", "the drive to stream")
        service = ("--service", f"http://127.0.0.1:{port}")
        text = said(tmp_path, "experiment", written(tmp_path, DONE), "emulated", *service, "--out", "got.parquet")
        assert "got.parquet: 5000 samples; the drive is stopped" in text
        done = httpx.get(f"{routes}/latest").json()
        assert (done["state"], done["samples"], done["progress"]) == ("done", 5000, 1.0)
        assert Path(done["file"]).read_bytes() == (tmp_path / "got.parquet").read_bytes()
        asked = httpx.post(f"{root}/recordings/{done['id']}/diagnosis", json={})
        assert asked.status_code == 422  # it knows the recording; no machine is configured
        running = httpx.post(routes, json=LONG)
        assert running.status_code == 202
        refused = httpx.put(f"{root}/drives/emulated/signals", json={"i_q_ref": 0.0})
        assert refused.status_code == 409
        assert f"experiment {running.json()['id']}" in refused.json()["detail"]
        assert httpx.post(routes, json=DONE).status_code == 409
        until(lambda: "holding" in httpx.get(f"{routes}/latest").json()["phase"], "it does not begin")
        assert (control()["ours"], control()["in_experiment"], control()["said"]) == (True, True, "")
        assert control()["whom"] == f"experiment {running.json()['id']} (asked for from 127.0.0.1)"
        assert httpx.get(f"{routes}/latest/file").status_code == 409
        assert httpx.delete(f"{routes}/latest").json()["state"] == "cancelled"
        assert stopped(url)
        assert httpx.delete(f"{routes}/latest").status_code == 409
        assert (control()["ours"], control()["in_experiment"], control()["whom"]) == (False, False, None)
        beyond = httpx.post(routes, json={"holds": [DONE["holds"][0] | {"i_q": 99.0}]})
        assert (beyond.status_code, "overcurrent trip" in beyond.json()["detail"]) == (422, True)
        another = httpx.post(routes, json=DONE | {"machine": {"psi_f": 0.0052}})
        assert another.status_code == 422
        assert "psi_f = 0.0052 Vs, the drive's current control has 0.12 Vs" in another.json()["detail"]
        assert httpx.put(f"{root}/drives/emulated/signals", json={"i_q_ref": 0.0}).status_code == 200
        assert httpx.get(f"{routes}/nothing").status_code == 404
        whole = httpx.post(routes, json={"verdict": "ambiguous", "ambiguous": [{"experiment": LONG}]})
        assert (whole.status_code, whole.json()["holds"]) == (202, LONG["holds"])
        until(lambda: "holding" in httpx.get(f"{routes}/latest").json()["phase"], "it does not begin")
    assert stopped(url)  # the service has ended


def held(*levels: tuple[float, float]) -> dict[str, Any]:
    """Levels at speeds (rpm) for times (s): each speed is a recording of the drive's."""
    return {"holds": [{"speed_rpm": rpm, "i_d": 0.0, "i_q": 1.0, "seconds": s} for rpm, s in levels], "step": 0.3}


@pytest.mark.parametrize(
    ("plan", "killed_in", "ends"),
    [
        (held((1200.0, 0.5), (600.0, 30.0)), "holding 600 rpm",
         ("failed", 5000, "the service ended while it ran; the first 5000 of 305000 samples are kept")),
        (held((1200.0, 6.0)), "uploading", ("done", 60_000, "")),
    ],
    ids=["holding", "uploading"],
)
def test_what_a_killed_service_had_of_an_experiment_is_a_recording_at_the_next_start(
    tmp_path: Path, plan: dict[str, Any], killed_in: str, ends: tuple[str, int, str]
) -> None:
    with drive_with("", tmp_path) as url:
        _kill_and_start_again(url, tmp_path, plan, killed_in, ends)


def _kill_and_start_again(
    url: str, tmp_path: Path, plan: dict[str, Any], killed_in: str, ends: tuple[str, int, str]
) -> None:
    port = free_port()
    config = tmp_path / "bench.toml"
    config.write_text(
        f'[service]\nport = {port}\ncaptures = "captures"\n[drives.emulated]\nurl = "{url}"\n', encoding="utf-8"
    )
    root = f"http://127.0.0.1:{port}/api"
    routes = f"{root}/drives/emulated/experiments"

    def streaming() -> bool:
        return httpx.get(f"{root}/health").json()["status"] == "ok"

    with command("serve", "--config", str(config)) as process:
        wait_for_answer(f"{root}/health", process)
        until(streaming, "the drive to stream")
        id_ = httpx.post(routes, json=plan).json()["id"]

        def begun() -> bool:
            latest = httpx.get(f"{routes}/latest").json()
            assert latest["state"] == "running", latest
            return latest["phase"].startswith(killed_in)

        until(begun, killed_in)
        process.kill()
        process.communicate()
    assert [path.name for path in (tmp_path / "captures").iterdir()] == [f"{id_}.experiment"]
    with command("serve", "--config", str(config)) as process:
        wait_for_answer(f"{root}/health", process)
        until(lambda: httpx.get(f"{routes}/{id_}").json()["state"] != "running", "its end")
        (told_of,) = httpx.get(routes).json()["experiments"]
        assert (told_of["id"], told_of["state"], told_of["samples"], told_of["reason"]) == (id_, *ends)
        (file,) = (tmp_path / "captures").iterdir()
        assert str(file) == told_of["file"]
    recording = read_recording(file)
    assert sum(map(len, recording.runs)) == ends[1]
    partial = ("the recording is partial: 5000 of 305000 rows",) if ends[0] == "failed" else ()
    assert recording.summary.remarks() == partial


def test_a_full_disk_stops_the_drive_and_loses_nothing_that_was_uploaded(url: str, tmp_path: Path) -> None:
    asked = written(tmp_path, DONE)
    done = subprocess.run(
        ["prlimit", "--fsize=30000", *COMMAND, "experiment", asked, "--drive", url, "--out", "got.parquet"],
        cwd=tmp_path, capture_output=True, text=True, timeout=180, check=False,
    )
    assert done.returncode == 2, done
    assert "pmsm-bench: got.parquet: cannot be written: File too large; " in done.stderr
    assert done.stderr.count("\n") == 1
    assert stopped(url)
    (file,) = (path for path in tmp_path.iterdir() if path.name.startswith("got"))
    assert file.name in ("got.experiment", "got.partial.parquet")
    assert file.name in done.stderr
    if file.suffix == ".experiment":  # at the next start there is room
        text = said(tmp_path, "experiment", asked, "--drive", url, "--out", "got.parquet")
        assert "an earlier experiment to got.parquet was interrupted: the first " in text
        file = tmp_path / "got.partial.parquet"
        assert len(read_recording(tmp_path / "got.parquet").runs[0]) == 5000
    assert 0 < len(read_recording(file).runs[0]) < 5000
