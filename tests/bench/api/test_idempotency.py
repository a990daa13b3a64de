"""Jobs asked for again with the same Idempotency-Key: begun once, whatever is lost on the way of an answer."""

import asyncio
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest
from starlette.types import Receive, Scope, Send

from bench.api.exchange.problems import problem as refusal
from bench.api.guard.idempotency import HEADER, Idempotency
from bench.store.write_log import WriteLog
from tests.bench.api.test_api import problem
from tests.conftest import JSON, RunningBench
from tests.support.served_drive import until

OF_DRIVE = "/api/drives/emulated"
CAPTURES = f"{OF_DRIVE}/captures"
RECORDINGS = f"{OF_DRIVE}/recordings"
live = pytest.mark.live


@dataclass
class Jobs:
    """An application that begins a job at each request, and goes on once it may."""

    begun: int = 0
    refuses: int = 0  # so many before it begins one, with this status
    status: int = 409
    may: asyncio.Event = field(default_factory=asyncio.Event)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = (await receive())["body"]
        await self.may.wait()
        if self.refuses:
            self.refuses -= 1
            await refusal(self.status, "not now")(scope, receive, send)
            return
        self.begun += 1
        answer = json.dumps({"id": self.begun, "asked": body.decode()}).encode()
        headers = [(b"location", f"/job/{self.begun}".encode()), (b"content-type", b"application/json")]
        await send({"type": "http.response.start", "status": 202, "headers": headers})
        await send({"type": "http.response.body", "body": answer})


class Asked:
    """A client of an application with the middleware around it, which nothing is told of."""

    def __init__(self, jobs: Jobs, folder: Path) -> None:
        self.now = 0.0
        jobs.may.set()
        app = Idempotency(jobs, WriteLog(folder), lambda: self.now)
        self._client = httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost")

    async def post(self, key: str | None, path: str = CAPTURES, body: str = "{}") -> httpx.Response:
        return await self._client.post(path, content=body, headers={} if key is None else {HEADER: key})


def test_the_same_key_with_the_same_body_is_answered_for_an_hour(tmp_path: Path) -> None:
    async def run() -> None:
        jobs = Jobs()
        asked = Asked(jobs, tmp_path)
        first = await asked.post("one")
        asked.now = 3599.0
        again = await asked.post("one")
        assert (again.status_code, again.content, again.headers) == (202, first.content, first.headers)
        assert again.headers["location"] == "/job/1"
        assert (await asked.post("two")).json()["id"] == 2
        assert (await asked.post(None)).json()["id"] == 3
        asked.now = 3601.0
        assert (await asked.post("one")).json()["id"] == 4

    asyncio.run(run())


def test_a_key_of_another_request_or_none_that_can_be_is_refused(tmp_path: Path) -> None:
    async def run() -> None:
        jobs = Jobs()
        asked = Asked(jobs, tmp_path)
        await asked.post("one")
        for path, body in ((CAPTURES, '{"length": 5000}'), (RECORDINGS, "{}")):
            said = problem(await asked.post("one", path, body), 422)
            assert said.startswith("expected an Idempotency-Key of its own, got that of another request")
        for key in ("", "x" * 256, "a\tb"):
            assert "of 1 to 255 printable" in problem(await asked.post(key), 422)
        await asked.post("x" * 255)
        assert jobs.begun == 2
        await asked.post("one", f"{OF_DRIVE}/start")  # which is no job, and does not heed it
        assert jobs.begun == 3

    asyncio.run(run())


def test_of_those_that_come_at_once_one_begins_a_job_and_all_are_answered(tmp_path: Path) -> None:
    async def run() -> None:
        jobs = Jobs()
        asked = Asked(jobs, tmp_path)
        jobs.may.clear()
        waiting = [asyncio.create_task(asked.post("one")) for _ in range(5)]
        await asyncio.sleep(0)
        jobs.may.set()
        answers = [await one for one in waiting]
        assert {answer.json()["id"] for answer in answers} == {1}
        assert jobs.begun == 1

    asyncio.run(run())


@pytest.mark.parametrize(("status", "begun"), [(409, 1), (503, 1), (500, 0)])
def test_a_refusal_may_be_tried_again_but_not_what_may_have_been_done(tmp_path: Path, status: int, begun: int) -> None:
    async def run() -> None:
        jobs = Jobs(refuses=1, status=status)
        asked = Asked(jobs, tmp_path)
        assert (await asked.post("one")).status_code == status
        await asked.post("one")
        assert jobs.begun == begun

    asyncio.run(run())


def test_of_many_keys_the_oldest_are_forgotten(tmp_path: Path) -> None:
    async def run() -> None:
        jobs = Jobs()
        asked = Asked(jobs, tmp_path)
        for k in range(1001):
            await asked.post(str(k))
        assert (await asked.post("1000")).json()["id"] == 1001
        assert (await asked.post("0")).json()["id"] == 1002
        long = " " * 60_000
        for k in range(150):
            await asked.post(f"long {k}", body=f"{long}{{}}")
        assert (await asked.post("long 149", body=f"{long}{{}}")).json()["id"] == 1152
        assert (await asked.post("long 0", body=f"{long}{{}}")).json()["id"] == 1153

    asyncio.run(run())


@pytest.fixture
def client(running_bench: RunningBench) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=running_bench.url, headers=JSON, timeout=30.0) as one:
        until(lambda: one.get(OF_DRIVE).json()["link"]["state"] == "streaming", "the stream")
        yield one


@live
def test_recordings_and_captures_of_a_bench_are_begun_once(client: httpx.Client) -> None:
    for path, body in ((RECORDINGS, {"title": "warm"}), (CAPTURES, {"length": 100, "trigger": "command"})):
        first = client.post(path, json=body, headers={HEADER: f"key of {path}"})
        assert first.status_code == 202
        again = client.post(path, json=body, headers={HEADER: f"key of {path}"})
        assert (again.status_code, again.content) == (202, first.content)
        assert again.headers["location"] == first.headers["location"]
        assert len(again.headers.get_list("content-security-policy", split_commas=False)) == 1
        assert "of its own" in problem(client.post(path, json={}, headers={HEADER: f"key of {path}"}), 422)
        assert client.post(path, json=body, headers={HEADER: "another"}).status_code in (409, 422)
        client.delete(first.headers["location"]).raise_for_status()


@live
def test_the_document_has_the_header_at_the_routes_that_heed_it(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    heeding = {
        (method, path) for path, methods in paths.items() for method, told in methods.items()
        if any(parameter["name"] == HEADER for parameter in told.get("parameters", []))
    }
    jobs = {"/api/drives/{name}/captures", "/api/drives/{name}/recordings", "/api/drives/{name}/experiments",
            "/api/drives/{name}/commissionings", "/api/drives/{name}/flashes", "/api/drives/{name}/parameters/rollback",
            "/api/drives/{name}/parameters/resume", "/api/recordings/{id}/diagnosis"}  # fmt: skip
    assert heeding == {("post", path) for path in jobs}
