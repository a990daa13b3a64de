"""A drive's signals over REST and the command line: read, written, judged before anything is written, refused."""

import json
import subprocess
from collections.abc import Iterator

import httpx
import pytest

from drivers.wire.dictionary import SET_POINTS
from tests.bench.api.test_api import problem
from tests.conftest import COMMAND, JSON, RunningBench
from tests.support.served_drive import until

pytestmark = pytest.mark.live

DRIVE = "/api/drives/emulated"
SIGNALS = f"{DRIVE}/signals"


@pytest.fixture
def client(running_bench: RunningBench) -> Iterator[httpx.Client]:
    """A client of a bench whose drive streams; what the tests write is put back."""
    with httpx.Client(base_url=running_bench.url, headers=JSON, timeout=30.0) as one:
        until(lambda: one.get(DRIVE).json()["link"]["state"] == "streaming", "the stream")
        before = values(one, "i_q_ref", "i_d_step", "excitation_kind", "sine_count")
        yield one
        one.put(SIGNALS, json=before).raise_for_status()


def values(client: httpx.Client, *names: str) -> dict[str, float]:
    """Signals by name, SI."""
    told = client.get(SIGNALS, params={"names": ",".join(names)})
    return {signal["name"]: signal["value"] for signal in told.raise_for_status().json()["signals"]}


def test_all_signals_are_told_with_unit_access_and_range(client: httpx.Client) -> None:
    told = {signal["name"]: signal for signal in client.get(SIGNALS).json()["signals"]}
    assert told["T_s"]["value"] == pytest.approx(1e-4)
    assert (told["i_full"]["access"], told["i_full"]["unit"]) == ("const", "A")
    assert told["excitation_kind"]["minimum"] == 0.0
    assert told["bandwidth"]["maximum"] == 1e4
    assert len(told) > 60


def test_a_sequence_is_commanded_while_the_drive_streams_and_its_currents_follow(client: httpx.Client) -> None:
    asked = {"excitation_kind": 0, "i_d_step": 0.0, "i_q_ref": 1.5}
    answer = client.put(SIGNALS, json=asked).raise_for_status().json()["signals"]
    assert {signal["name"]: signal["value"] for signal in answer} == asked
    until(lambda: abs(values(client, "i_q_mean")["i_q_mean"] - 1.5) < 0.05, "the current")
    client.put(SIGNALS, json={"excitation_kind": 3, "i_d_step": 2.0, "sine_count": 4}).raise_for_status()
    until(lambda: abs(values(client, "i_d")["i_d"]) > 0.3, "the multisine")
    assert client.get(DRIVE).json()["writer"] is None


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({}, 'expected values by the names of signals, such as {"i_q_ref": 2.0}, got none'),
        ({"i_q_ref": 2.0, "i_q_reff": 1.0}, "no signal 'i_q_reff'; there is i_q_ref"),
        ({"i_q_ref": 2.0, "i_full": 1.0}, "0x2010:1 (i_full) cannot be written"),
        ({"i_q_ref": 2.0, "bandwidth": 1e6}, "0x2200:6 (bandwidth) takes at most 10000.0 rad/s, got 1000000.0"),
        ({"excitation_kind": 99}, "0x2300:12 (excitation_kind) takes at most 4, got 99"),
        ({"i_q_ref": 2.0, "n_p": 2.5}, "0x2200:1 (n_p) takes a whole number, got 2.5"),
        ({"i_q_ref": "2"}, "0x2300:2 (i_q_ref) takes a number, got '2'"),
        ({"i_q_ref": True}, "0x2300:2 (i_q_ref) takes a number, got true"),
        ({"i_q_ref": None}, "0x2300:2 (i_q_ref) takes a number, got null"),
        ({"capture_length": 10}, "0x2400:"),
        ({"": 1.0}, "no signal ''"),
    ],
)
def test_a_value_that_cannot_be_is_refused_before_anything_is_written(
    client: httpx.Client, given: dict[str, object], sentence: str
) -> None:
    before = values(client, "i_q_ref")
    assert problem(client.put(SIGNALS, json=given), 422).startswith(sentence)
    assert values(client, "i_q_ref") == before


@pytest.mark.parametrize(("path", "name", "instead"), [
    ("signals", "iq", "no signal 'iq'; there is i_q_ref, i_q_step"),
    ("signals", "i_q", "0x2100:4 (i_q) cannot be written; there is i_q_ref, i_q_step"),
    ("start", "iq", "no signal 'iq'; there is i_q_ref, i_q_step"),
    ("start", "i_q_reff", "no signal 'i_q_reff'; there is i_q_ref, i_d_ref, i_q_step"),
])
def test_what_can_be_written_is_named_in_place_of_what_cannot(
    client: httpx.Client, path: str, name: str, instead: str
) -> None:
    method = "PUT" if path == "signals" else "POST"
    assert problem(client.request(method, f"{DRIVE}/{path}", json={name: 2.0}), 422) == instead


@pytest.mark.parametrize("number", ["NaN", "1e999", "1" + 400 * "0"], ids=["NaN", "infinite", "endless"])
def test_a_number_that_is_none_is_refused(client: httpx.Client, number: str) -> None:
    body = f'{{"i_q_ref": {number}}}'.encode()
    assert problem(client.put(SIGNALS, content=body), 422).startswith("0x2300:2 (i_q_ref) takes a finite number, got ")


def test_what_the_drive_refuses_is_told_and_nothing_of_it_is_written(client: httpx.Client) -> None:
    before = values(client, "i_q_ref", "sine_count")
    asked = {"i_q_ref": 0.5, "sine_count": 16, "sine_frequency": 1000.0}  # harmonics that its control is too slow for
    told = problem(client.put(SIGNALS, json=asked), 409)
    assert told == (
        "the drive refused (0x6090030): outside its own range; nothing was written of i_q_ref = 0.5 A, "
        "sine_count = 16, sine_frequency = 1000 Hz"
    )
    assert values(client, "i_q_ref", "sine_count") == before


def test_set_points_go_up_to_the_machines_rated_current_and_largest_speed(client: httpx.Client) -> None:
    before = values(client, "i_q_ref")
    told = problem(client.put(SIGNALS, json={"i_q_ref": 9.0}), 422)
    assert told.startswith("set points: currents go up to 6 A, the machine's rated one unless the configuration's ")
    told = problem(client.put(SIGNALS, json={"speed_ref": 2000.0}), 422)
    assert told.startswith("set points: speeds go up to 2920 rpm, the machine's largest unless ")
    assert problem(client.put(SIGNALS, json={"watchdog_time": 0.0}), 422).endswith("takes at least 0.05 s, got 0.0")
    assert values(client, "i_q_ref") == before


def test_a_stopped_drive_takes_no_set_point_and_started_again_it_does(client: httpx.Client) -> None:
    kept = values(client, "i_q_ref", "i_d_step", "i_q_step")
    assert client.post(f"{DRIVE}/stop").raise_for_status().json()["state"] == "switch on disabled"
    assert set(values(client, *SET_POINTS).values()) == {0.0}
    told = problem(client.put(SIGNALS, json={"i_q_ref": 1.0}), 409)
    assert told.startswith("i_q_ref is a set point, and set points hold only while the drive is controlled: start it")
    assert problem(client.put(SIGNALS, json={"control_word": 15}), 409).endswith("`pmsm-bench start emulated`")
    control = client.post(f"{DRIVE}/start", json=kept).raise_for_status().json()
    assert (control["state"], control["ours"], control["fault"]) == ("operation enabled", True, None)
    assert values(client, "i_q_ref", "i_d_step", "i_q_step") == kept
    assert problem(client.post(f"{DRIVE}/reset", json=[1]), 422) == "expected a JSON object such as {}, got [1]"
    assert problem(client.post(f"{DRIVE}/reset", json={}), 409) == (
        "drive emulated is in no fault: it is operation enabled"
    )
    assert problem(client.post(f"{DRIVE}/start", json={"bandwidth": 500.0}), 422).startswith(
        "a drive is started with set points (i_d_ref, "
    )


def test_unknown_drives_and_signals_are_told(client: httpx.Client) -> None:
    assert problem(client.get("/api/drives/nobody/signals"), 404).startswith("no drive 'nobody'")
    assert problem(client.put("/api/drives/nobody/signals", json={"i_q_ref": 1.0}), 404).startswith("no drive")
    assert problem(client.get(SIGNALS, params={"names": "i_q_ref,nothing"}), 422) == (
        f"no signal 'nothing'; `pmsm-bench signals DRIVE` lists all {len(client.get(SIGNALS).json()['signals'])}"
    )


@pytest.mark.parametrize(
    ("path", "example"),
    [(SIGNALS, {"i_q_ref": 2.0}), (f"{DRIVE}/window", {"length": 2000}), (f"{DRIVE}/captures", {"length": 2000}),
     (f"{DRIVE}/experiments", {"holds": [{"speed_rpm": 1200.0, "i_d": -1.8, "i_q": 2.0, "seconds": 0.5}]})],
    ids=["signals", "window", "captures", "experiments"],
)  # fmt: skip
def test_a_body_that_is_no_object_is_refused_with_an_example_of_this_route(
    client: httpx.Client, path: str, example: dict[str, object]
) -> None:
    method = "PUT" if path in (SIGNALS, f"{DRIVE}/window") else "POST"
    shown = json.dumps(example)
    said = problem(client.request(method, path, content=b"[]"), 422)
    assert said == f"expected a JSON object such as {shown}, got []"
    assert problem(client.request(method, path, content=b"{"), 422) == (
        f"the body is not JSON, expected an object such as {shown}"
    )


def test_a_capture_waits_for_the_step_that_its_operator_makes(client: httpx.Client) -> None:
    asked = {"i_d_step": 0.0, "i_q_step": 0.0, "excitation_kind": 0, "i_q_ref": 1.0}
    client.put(SIGNALS, json=asked).raise_for_status()
    until(lambda: abs(values(client, "i_q_mean")["i_q_mean"] - 1.0) < 0.1, "the current")
    client.post(f"{DRIVE}/captures", json={"length": 1000, "trigger": "i_q > 2.0"}).raise_for_status()
    client.put(SIGNALS, json={"i_q_ref": 3.0}).raise_for_status()
    until(lambda: client.get(f"{DRIVE}/captures/latest").json()["state"] == "done", "the capture")


def command(running_bench: RunningBench, *given: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, "signals", "emulated", *given, "--service", running_bench.url],
        capture_output=True, text=True, timeout=60.0, check=False,
    )


def test_the_command_line_writes_and_reads_and_says_what_it_expected(
    client: httpx.Client, running_bench: RunningBench
) -> None:
    done = command(running_bench, "i_q_ref=1.25", "T_s", "layout_id")
    assert done.returncode == 0, done.stderr
    assert values(client, "i_q_ref") == {"i_q_ref": 1.25}
    assert [line for line in done.stdout.splitlines() if "i_q_ref" in line and "1.25" in line]
    assert [line for line in done.stdout.splitlines() if "T_s" in line and "0.0001" in line]
    layout = int(values(client, "layout_id")["layout_id"])
    assert [line for line in done.stdout.splitlines() if "layout_id" in line and f" {layout} " in line]
    for given, sentence in (
        ("i_q_ref=fast", "expected SIGNAL=NUMBER, got 'i_q_ref=fast'"),
        ("i_q_ref=nan", "'i_q_ref': expected a finite number, got nan"),
        ("i_q_reff", "no signal 'i_q_reff'; there is i_q_ref"),
    ):
        refused = command(running_bench, given)
        assert (refused.returncode, refused.stdout) == (2, "")
        assert refused.stderr.startswith(f"pmsm-bench: {sentence}"), refused.stderr
