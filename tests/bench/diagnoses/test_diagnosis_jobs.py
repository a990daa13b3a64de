"""Diagnoses by the service: one at a time in a process, queued, cancelled, refused; and over REST to their results."""

import contextlib
import json
import os
import re
import signal
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any, Self

import httpx
import jsonschema
import pyarrow
import pyarrow.parquet
import pytest

from bench.diagnoses import diagnosis_jobs
from bench.diagnoses.diagnosis_jobs import MACHINE, REPORT, RESULT, WAITING, DiagnosisJobs, JobState
from bench.diagnoses.figures.figure import schema as figures_schema
from bench.diagnoses.published import schema
from bench.diagnoses.report.page import POLICY
from bench.errors import ConflictError, LimitError, UnavailableError, UnknownError
from bench.files import captures_folder
from bench.machine_file import Nominal, load_machine, nominal_of
from bench.store.diagnoses import FOLDER
from bench.witness import from_table
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.interval import Z_95
from estimator.witness import Witness
from tests.bench.api.test_api import problem
from tests.bench.diagnoses.test_worker import alive, children
from tests.conftest import JSON, RunningBench, bench_up
from tests.support.diagnoses import EXPLAINED, NOMINAL
from tests.support.served_drive import until

pytestmark = [pytest.mark.live, pytest.mark.thorough]

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet
validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]

NOMINALS = {"spindle": NOMINAL, "bare": Nominal({"R_s": 1.0})}
WHOLE = {"R_s": 1.0, "L_d": 4e-3, "L_q": 6e-3, "psi_f": 0.1, "n_p": 4}


def recorded(folder: Path, *names: str, drive: str = "spindle") -> None:
    """Files that a diagnosis by name takes for recordings of a drive."""
    folder.mkdir(exist_ok=True)
    for name in names:
        table = pa.table({"t": [0.0]}).replace_schema_metadata({b"pmsm-bench": json.dumps({"drive": drive}).encode()})
        pq.write_table(table, folder / f"{name}.parquet")


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[DiagnosisJobs]:
    """Diagnoses by the names of recordings."""
    recorded(tmp_path, "explained", "explained2", "nothing_told", "refused", "dies", "endless", "endless2")
    jobs = DiagnosisJobs(tmp_path, NOMINALS, "tests.support.diagnoses:work")
    yield jobs
    jobs.leave()
    jobs.join(10.0)


def ended(jobs: DiagnosisJobs, id_: str) -> JobState:
    until(lambda: jobs.one(id_).state not in (JobState.QUEUED, JobState.RUNNING), "its end")
    return jobs.one(id_).state


def test_a_diagnosis_is_worked_on_in_a_process_that_is_gone_with_it(jobs: DiagnosisJobs) -> None:
    before = set(children(os.getpid()))
    asked = jobs.ask("explained", {"trust": {"R_s": 0.2}})
    assert (asked.recording, asked.drive, asked.state) == ("explained", "spindle", JobState.QUEUED)
    assert asked.request["trust"] == {"R_s": 0.2}
    assert nominal_of(asked.request["nominal"], "") == NOMINAL
    assert ended(jobs, "explained") is JobState.DONE
    done = jobs.done("explained")
    assert (done.progress, done.phase, done.reason) == (1.0, "", "")
    assert done.started is not None
    assert done.ended is not None
    assert done.asked <= done.started <= done.ended
    assert (done.verdict, done.sentence) == ("explained", EXPLAINED.sentence)
    content = json.loads(jobs.file(done, RESULT))
    assert content["sentence"] == EXPLAINED.sentence
    assert "trust {'R_s': 0.2}" in content["remarks"]
    assert EXPLAINED.sentence.split(":")[1] in jobs.file(done, REPORT).decode()
    assert "[effects.inverter_voltage_error]" in jobs.file(done, MACHINE).decode()
    assert set(children(os.getpid())) <= before
    assert jobs.ask("explained", {}).state is JobState.QUEUED  # once more
    assert ended(jobs, "explained") is JobState.DONE


def test_a_result_stays_until_another_one_is_done(jobs: DiagnosisJobs) -> None:
    jobs.ask("explained", {"trust": {"R_s": 0.2}})
    assert ended(jobs, "explained") is JobState.DONE
    first = jobs.done("explained")
    jobs.ask("endless", {})  # what comes after it waits
    assert jobs.ask("explained", {}).state is JobState.QUEUED
    assert jobs.one("explained").state is JobState.QUEUED
    assert jobs.done("explained") == first
    assert jobs.file(first, REPORT).startswith(b"<!doctype html>")
    assert b"[machine]" in jobs.file(first, MACHINE)
    assert jobs.cancel("explained").state is JobState.CANCELLED
    assert jobs.done("explained") == first
    jobs.ask("explained", {})
    jobs.cancel("endless")
    assert ended(jobs, "explained") is JobState.DONE
    assert jobs.done("explained").asked > first.asked


def test_one_is_under_way_and_the_others_wait_their_turn(jobs: DiagnosisJobs) -> None:
    before = set(children(os.getpid()))
    jobs.ask("endless", {})
    jobs.ask("explained", {})
    jobs.ask("endless2", {})
    until(lambda: jobs.one("endless").phase == "looking at the name", "the first")
    first = set(children(os.getpid())) - before
    assert (jobs.one("endless").state, jobs.one("endless").progress) == (JobState.RUNNING, 0.5)
    assert {jobs.one(name).state for name in ("explained", "endless2")} == {JobState.QUEUED}
    assert len(first) == 1
    with pytest.raises(ConflictError, match="recording endless is being diagnosed"):
        jobs.ask("endless", {})
    assert jobs.cancel("endless2").state is JobState.CANCELLED  # at once, from the queue
    assert jobs.one("endless").state is JobState.RUNNING
    assert jobs.cancel("endless").state is JobState.CANCELLED
    assert not any(map(alive, first))
    assert ended(jobs, "explained") is JobState.DONE
    for name in ("endless", "explained"):
        with pytest.raises(ConflictError, match=r"there is nothing to cancel$"):
            jobs.cancel(name)
    with pytest.raises(ConflictError, match="of endless is cancelled, there is no result"):
        jobs.done("endless")


def test_a_diagnosis_that_fails_says_why_and_stops_none_after_it(jobs: DiagnosisJobs) -> None:
    for name in ("refused", "dies", "nothing_told"):
        jobs.ask(name, {})
    assert [ended(jobs, name) for name in ("refused", "dies", "nothing_told")] == [
        JobState.FAILED, JobState.FAILED, JobState.DONE,
    ]  # fmt: skip
    assert jobs.one("refused").reason.endswith("refused.parquet: expected another name")
    assert jobs.one("dies").reason.endswith("ended before it was done (exit code 3)")
    with pytest.raises(ConflictError, match=r"is failed: .* expected another name, there is no result"):
        jobs.done("refused")
    with pytest.raises(ConflictError, match=r"has no machine\.toml: nothing could be fitted"):
        jobs.file(jobs.done("nothing_told"), MACHINE)


def test_one_under_way_is_the_latest_though_the_clock_has_been_set_back_since_others(
    jobs: DiagnosisJobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Back(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> Self:
            return super().now(tz) - timedelta(hours=1)

    before = jobs.ask("endless", {})
    jobs.cancel("endless")
    monkeypatch.setattr(diagnosis_jobs, "datetime", Back)
    again = jobs.ask("endless", {})
    assert again.asked < before.asked
    assert jobs.one("endless").id == jobs.named("latest").id == again.id
    assert jobs.cancel("endless").id == again.id


def test_so_many_may_wait_and_no_more_and_none_is_left_at_the_end(tmp_path: Path) -> None:
    names = ["endless", *(f"explained{k}" for k in range(WAITING + 1))]
    recorded(tmp_path, *names)
    jobs = DiagnosisJobs(tmp_path, NOMINALS, "tests.support.diagnoses:work")
    before = set(children(os.getpid()))
    with contextlib.ExitStack() as at_the_end:
        at_the_end.callback(jobs.join, 10.0)
        at_the_end.callback(jobs.leave)
        for name in names[:-1]:
            jobs.ask(name, {})
        with pytest.raises(UnavailableError, match=f"^{WAITING} diagnoses are waiting"):
            jobs.ask(names[-1], {})
        until(lambda: jobs.one("endless").state is JobState.RUNNING, "the first")
    assert set(children(os.getpid())) <= before
    assert {(jobs.one(name).state, jobs.one(name).reason) for name in names[:-1]} == {
        (JobState.CANCELLED, "the service has ended")
    }
    with pytest.raises(UnavailableError, match="the service is ending"):
        jobs.ask("endless", {})


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"trust": {"R": 0.2}}, "trust: expected R_s, L_d, L_q, psi_f, got 'R'"),
        ({"trust": {"R_s": "20%"}}, "trust: R_s: expected a share above 0 and at most 10 (1000 %), "
         "such as 0.2 for 20 %, got '20%'"),
        ({"trust": [1]}, "trust: expected an object, got [1]"),
        ({"nominal": ["m.toml"]}, "nominal: expected an object, got ['m.toml']"),
        ({"nominal": "m.toml"}, "nominal, a machine file's text: not TOML: "),
        ({"nominal": "[machine]\nR_s = -1\n"}, "nominal: [machine] R_s = -1: expected a finite number of ohm"),
        ({"nominal": {"machine": {"R_s": -1}}}, "nominal: [machine] R_s = -1: expected a finite number of ohm"),
        ({"nominal": {"motor": {}}}, "nominal: unknown entry 'motor', expected the tables [machine] and [drive]"),
        ({"nominal": {"machine": {}}}, "nominal machine whole, missing in [machine]: R_s, L_d, L_q, psi_f, n_p"),
        ({"other": 1}, "a diagnosis takes trust, nominal and witness, got 'other'"),
        ({"witness": "psi_f=1"}, "witness: expected an object, got 'psi_f=1'"),
        ({"witness": {"J": "1e-3+-1%"}}, "witness: no parameter 'J', expected one of R_s, L_d, L_q, psi_f"),
        ({"witness": {"psi_f": "0.12"}}, "witness: psi_f: expected a value and its error, such as psi_f="),
        ({"witness": {"psi_f": 0.12}}, 'witness psi_f: expected a text, such as "2.478e-3+-1%", got 0.12'),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused_and_nothing_is_begun(jobs: DiagnosisJobs, given: dict[str, Any], said: str) -> None:
    with pytest.raises(LimitError) as caught:
        jobs.ask("explained", given)
    assert said in str(caught.value)
    with pytest.raises(UnknownError, match="no diagnosis of a recording 'explained'"):
        jobs.one("explained")


def test_a_streams_rows_are_refused_and_are_not_the_latest(jobs: DiagnosisJobs, tmp_path: Path) -> None:
    pq.write_table(pa.table({"t": [0.0, 1e-3], "periods": [10.0, 10.0]}), tmp_path / "brought.parquet")
    with pytest.raises(LimitError) as caught:
        jobs.ask("brought", {})
    assert str(caught.value) == (
        "brought: a stream's rows cover several control periods, here 10 each: capture to diagnose"
    )
    assert jobs.ask("latest", {}).recording != "brought"


def test_the_nominal_machine_is_that_of_the_drive_unless_told(tmp_path: Path) -> None:
    recorded(tmp_path, "explained", drive="bare")
    recorded(tmp_path, "explained2", drive="elsewhere")
    jobs = DiagnosisJobs(tmp_path, NOMINALS, "tests.support.diagnoses:work")
    try:
        with pytest.raises(LimitError, match="missing in \\[machine\\]: L_d, L_q, psi_f, n_p"):
            jobs.ask("explained", {})
        with pytest.raises(LimitError, match="missing in \\[machine\\]: R_s, L_d, L_q, psi_f, n_p"):
            jobs.ask("latest", {})
        assert jobs.ask("latest", {"nominal": {"machine": WHOLE}}).recording == "explained2"
        assert ended(jobs, "latest") is JobState.DONE
    finally:
        jobs.leave()
        jobs.join(10.0)


def test_the_nominal_machine_may_be_a_machine_files_text(tmp_path: Path) -> None:
    recorded(tmp_path, "explained", drive="elsewhere")
    jobs = DiagnosisJobs(tmp_path, NOMINALS, "tests.support.diagnoses:work")
    try:
        lines = [f"{name} = {value}" for name, value in WHOLE.items()]
        asked = jobs.ask("explained", {"nominal": "\n".join(["[machine]  # by its plate", *lines])})
        assert nominal_of(asked.request["nominal"], "") == nominal_of({"machine": WHOLE}, "")
        assert ended(jobs, "explained") is JobState.DONE
    finally:
        over(jobs)


def test_witnesses_are_those_asked_for_and_of_others_the_machines(tmp_path: Path) -> None:
    recorded(tmp_path, "explained")
    known = replace(NOMINAL, witnesses={"psi_f": Witness(0.12, 1e-3), "R_s": Witness(1.0, 0.01)})
    jobs = DiagnosisJobs(tmp_path, {"spindle": known}, "tests.support.diagnoses:work")
    try:
        asked = jobs.ask("explained", {"witness": {"psi_f": "119.5mVs+-1%"}})
        assert ended(jobs, "explained") is JobState.DONE
        (said,) = (one for one in json.loads(jobs.file(jobs.done("explained"), RESULT))["remarks"] if "witness" in one)
        again = jobs.ask("explained", asked.request)
        assert again.request == asked.request
        assert ended(jobs, "explained") is JobState.DONE
    finally:
        over(jobs)
    found = from_table(asked.request["witness"], "")
    assert found["psi_f"] == pytest.approx((0.1195, 0.001195 / Z_95))
    assert found["R_s"] == pytest.approx((1.0, 0.01))
    assert said == "witnesses R_s 1, psi_f 0.1195"


@pytest.mark.parametrize("id_", ["x", "", "..", "../explained", "explained.parquet", "\0", "y" * 3000])
def test_an_unknown_recording_is_told(jobs: DiagnosisJobs, id_: str) -> None:
    with pytest.raises(UnknownError):
        jobs.ask(id_, {})
    with pytest.raises(UnknownError):
        jobs.one(id_)


# --- after their end


def all_ended(jobs: DiagnosisJobs, *names: str) -> None:
    for name in names:
        jobs.ask(name, {})
    until(lambda: all(job.state.ended for job in jobs.all()), "their ends")


def over(jobs: DiagnosisJobs) -> None:
    jobs.leave()
    jobs.join(10.0)


def test_what_has_ended_is_there_after_a_restart_several_of_one_recording_side_by_side(
    jobs: DiagnosisJobs, tmp_path: Path
) -> None:
    all_ended(jobs, "explained", "refused", "nothing_told")
    jobs.ask("explained", {"trust": {"R_s": 0.2}})
    assert ended(jobs, "explained") is JobState.DONE
    jobs.ask("endless", {})
    over(jobs)
    before = jobs.all()
    told = [(job.recording, job.state, job.reason) for job in before]
    assert told[0] == ("endless", JobState.CANCELLED, "the service has ended")
    assert [name for name, *_ in told[1:]] == ["explained", "nothing_told", "refused", "explained"]
    again = DiagnosisJobs(tmp_path, NOMINALS, "tests.support.diagnoses:work")
    again.start()
    assert again.all() == before
    second, first = (job for job in again.all() if job.recording == "explained")
    assert (again.one("explained"), again.done("explained"), again.named(first.id)) == (second, second, first)
    contents = [json.loads(again.file(job, RESULT)) for job in (first, second)]
    assert [len(content["remarks"]) for content in contents] == [1, 2]
    (tmp_path / "explained.parquet").unlink()  # what is said of it stays
    assert (again.has_recording(first), again.done("explained")) == (False, second)
    over(again)


def test_one_that_has_ended_is_deleted_and_one_under_way_is_cancelled(jobs: DiagnosisJobs) -> None:
    asked = jobs.ask("endless", {})
    cancelled = jobs.remove(asked.id)
    assert (cancelled.id, cancelled.state) == (asked.id, JobState.CANCELLED)
    assert jobs.remove(asked.id) == cancelled
    for gone in (lambda: jobs.named(asked.id), lambda: jobs.remove(asked.id), lambda: jobs.one("endless")):
        with pytest.raises(UnknownError, match="no diagnosis"):
            gone()
    with pytest.raises(UnknownError, match="got latest"):
        jobs.remove("latest")


def test_a_disk_that_does_not_take_a_diagnosis_leaves_it_in_memory_and_it_says_so(
    jobs: DiagnosisJobs, tmp_path: Path
) -> None:
    (tmp_path / FOLDER).write_text("a file where a folder is to be")
    all_ended(jobs, "explained")
    done = jobs.done("explained")
    assert done.lost == "it could not be kept on disk, and is gone when the service ends: Not a directory"
    assert jobs.file(done, REPORT).startswith(b"<!doctype html>")
    assert jobs.named(done.id) == jobs.named("latest") == done
    assert jobs.remove(done.id) == done
    assert jobs.all() == []


# --- over REST


@pytest.fixture
def recording(running_bench: RunningBench) -> Iterator[tuple[httpx.Client, str]]:
    """A client of a bench, and the address of a recording that it has made."""
    with httpx.Client(base_url=running_bench.url, headers=JSON, timeout=30.0) as client:
        drive = "/api/drives/emulated"
        until(lambda: client.get(drive).json()["link"]["state"] == "streaming", "the stream")
        made = client.post(f"{drive}/captures", json={"length": 12_000}).json()["id"]
        until(lambda: client.get(f"{drive}/captures/{made}").json()["state"] == "done", "the capture")
        address = f"/api/recordings/{made}/diagnosis"
        yield client, address
        client.delete(address)


def test_a_recording_is_diagnosed_over_rest_from_its_location_to_its_results(
    recording: tuple[httpx.Client, str], tmp_path: Path
) -> None:
    client, address = recording
    assert problem(client.get(address), 404).startswith("no diagnosis of a recording 'emulated-")
    answer = client.post(address, json={"trust": {"R_s": 0.2}})
    assert (answer.status_code, answer.headers["location"]) == (202, f"/api/diagnoses/{answer.json()['id']}")
    assert answer.json()["state"] in ("queued", "running")
    until(lambda: client.get(address).json()["state"] in ("done", "failed"), "its end")
    job = client.get(address).json()
    assert (job["state"], job["progress"], job["reason"], job["drive"]) == ("done", 1.0, "", "emulated")
    content = client.get(f"{address}/result").json()
    validate(content, schema())
    assert (job["verdict"], job["sentence"]) == (content["verdict"], content["sentence"])
    assert content["recording"]["rows"] == 12_000
    page = client.get(f"{address}/report.html")
    assert page.headers["content-type"].startswith("text/html")
    assert page.text.startswith("<!doctype html>")
    policy = page.headers["content-security-policy"]
    assert POLICY in policy
    assert "frame-ancestors 'none'" in policy
    figures = client.get(f"{address}/figures").json()
    validate(figures, figures_schema())
    assert [one["name"] for one in figures["figures"]] == re.findall('<figure id="([^"]+)"', page.text)
    machine = client.get(f"{address}/machine.toml")
    assert machine.headers["content-type"] == "application/toml"
    (tmp_path / "m.toml").write_text(machine.text, encoding="utf-8")
    assert load_machine(tmp_path / "m.toml").n_p == 4
    assert " is done, there is nothing to cancel" in problem(client.delete(address), 409)
    own = f"/api/diagnoses/{job['id']}"
    assert client.get(own).json() == job
    for end in ("/result", "/report.html", "/machine.toml"):
        assert client.get(own + end).content == client.get(address + end).content
    assert client.post(address, json=job["request"]).status_code == 202  # another one alike
    until(lambda: client.get(address).json()["state"] == "done", "its end")
    of_it = {"recording": job["recording"], "state": "done", "verdict": job["verdict"], "drive": "emulated"}
    second, first = client.get("/api/diagnoses", params=of_it).json()["diagnoses"]
    assert (first, second["request"]) == (job, job["request"])
    assert client.get(f"/api/diagnoses/{second['id']}/result").json() == content
    page = client.get("/api/diagnoses", params=of_it | {"limit": 1}).json()
    assert (page["diagnoses"], page["total"], page["next"]) == ([second], 2, f"{second['asked']}~{second['id']}")
    page = client.get("/api/diagnoses", params=of_it | {"before": page["next"]}).json()
    assert (page["diagnoses"], page["total"], page["next"]) == ([first], 1, None)
    assert client.get("/api/diagnoses", params={"text": "nowhere"}).json()["total"] == 0
    assert client.delete(f"/api/recordings/{job['recording']}").status_code == 200
    assert client.get(own).json() == job | {"recording_there": False}
    assert client.delete(own).json()["id"] == job["id"]
    assert problem(client.get(own), 404) == f"no diagnosis '{job['id']}'"


def events_of(client: httpx.Client, path: str, last: str | None = None) -> list[tuple[str, dict[str, Any]]]:
    """Id and content of all events, until the stream ends."""
    headers = {} if last is None else {"Last-Event-ID": last}
    with client.stream("GET", path, headers=headers, timeout=60.0) as response:
        lines = list(response.iter_lines())
    ids = [line.removeprefix("id: ") for line in lines if line.startswith("id: ")]
    told = [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]
    assert lines.count("event: progress") == len(ids) == len(told)
    return list(zip(ids, told, strict=True))


def test_a_diagnosis_is_followed_to_its_end_also_over_a_break(recording: tuple[httpx.Client, str]) -> None:
    client, address = recording
    path = f"{client.post(address, json={}).headers['location']}/stream"
    events = events_of(client, path)
    assert len({id_ for id_, _ in events}) == len(events)
    shares = [told["progress"] for _, told in events]
    assert shares == sorted(shares)
    assert len({told["phase"] for _, told in events}) > 2
    assert (events[-1][1]["state"], events[-1][1]) == ("done", client.get(path.removesuffix("/stream")).json())
    assert events_of(client, path) == events[-1:]
    assert events_of(client, path, events[-1][0]) == []
    assert problem(client.get("/api/diagnoses/nothing/stream"), 404)


def test_a_diagnosis_is_cancelled_over_rest_and_the_drive_streams_on(
    recording: tuple[httpx.Client, str], running_bench: RunningBench
) -> None:
    client, address = recording
    before = children(running_bench.process.pid)
    client.post(address)
    cancelled = client.delete(address)
    assert cancelled.json()["state"] == "cancelled"
    assert set(children(running_bench.process.pid)) <= set(before)
    assert "is cancelled, there is no result" in problem(client.get(f"{address}/report.html"), 409)
    assert client.get("/api/health").json()["status"] == "ok"


@pytest.mark.parametrize(
    ("body", "said"),
    [(b'{"trust": {"R_s": 0}}', "trust: R_s: expected a share above 0"),
     (b"[]", 'expected a JSON object such as {"trust": {"R_s": 0.2}}, got []'),
     (b'{"nominal": {"machine": {"n_p": 1e400}}}', "nominal: [machine] n_p: expected a whole number of pole pairs")],
    ids=str,
)  # fmt: skip
def test_a_body_that_cannot_be_is_422(recording: tuple[httpx.Client, str], body: bytes, said: str) -> None:
    client, address = recording
    assert problem(client.post(address, content=body), 422).startswith(said)
    assert client.get(address).status_code == 404


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGKILL])
def test_a_service_that_ends_in_the_middle_of_a_diagnosis_leaves_no_process(number: signal.Signals) -> None:
    folder = captures_folder()
    folder.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(dict(VirtualDrive(PAPER).record(60_000))), folder / "long.parquet")
    try:
        with bench_up() as bench:
            before = set(children(bench.process.pid))
            answer = httpx.post(f"{bench.url}/api/recordings/long/diagnosis", json={"nominal": {"machine": WHOLE}})
            assert answer.status_code == 202
            until(lambda: bool(set(children(bench.process.pid)) - before), "the process that works on it")
            (worker,) = set(children(bench.process.pid)) - before
            bench.process.send_signal(number)
            bench.process.wait(15.0)
            until(lambda: not alive(worker), "its end")
    finally:
        (folder / "long.parquet").unlink()


@pytest.mark.parametrize("id_", ["x", "..%2F..%2Fetc", "%00", "y" * 3000])
def test_an_unknown_recording_is_404(running_bench: RunningBench, id_: str) -> None:
    for method, end in (("POST", ""), ("GET", ""), ("GET", "/result"), ("GET", "/report.html"), ("DELETE", "")):
        answer = httpx.request(method, f"{running_bench.url}/api/recordings/{id_}/diagnosis{end}", headers=JSON)
        assert problem(answer, 404).startswith(("no recording ", "no diagnosis ", "nothing at "))
