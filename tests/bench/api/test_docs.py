"""The reference at /docs and the OpenAPI document it is made from, as a running bench serves them."""

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import fields
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, cast

import httpx
import jsonschema
import pytest

from bench.actions.capture_request import Request
from bench.api.capture_models import CaptureModel, CapturesModel
from bench.api.diagnosis_models import DiagnosisJobModel
from bench.api.docs import example
from bench.api.experiments import ExperimentRunModel
from bench.api.models import DriveModel, EstimatesModel, HealthModel, SnapshotModel, WindowModel
from bench.diagnoses.diagnosis_request import checked_trust, schema
from bench.live.window import Window
from bench.machine_file import nominal_of
from bench.recordings.recording import read_recording
from tests.conftest import READY, RunningBench, bench_up
from tests.support.served_drive import until

pytestmark = pytest.mark.live

validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]
ROUTES = {
    ("get", "/api/drives"), ("get", "/api/drives/{name}"), ("get", "/api/drives/{name}/estimates"),
    ("get", "/api/drives/{name}/window"), ("put", "/api/drives/{name}/window"), ("get", "/api/drives/{name}/stream"),
    ("get", "/api/health"), ("get", "/api/drives/{name}/captures"), ("post", "/api/drives/{name}/captures"),
    ("get", "/api/drives/{name}/captures/{id}"), ("get", "/api/drives/{name}/captures/{id}/file"),
    ("get", "/api/drives/{name}/signals"), ("put", "/api/drives/{name}/signals"),
    ("post", "/api/drives/{name}/captures/{id}/trigger"), ("delete", "/api/drives/{name}/captures/{id}"),
    ("get", "/api/drives/{name}/experiments"), ("post", "/api/drives/{name}/experiments"),
    ("get", "/api/drives/{name}/experiments/{id}"),
    ("get", "/api/drives/{name}/experiments/{id}/file"), ("delete", "/api/drives/{name}/experiments/{id}"),
    *(("post", f"/api/drives/{{name}}/{what}") for what in ("start", "stop", "reset")),
    ("post", "/api/recordings/{id}/diagnosis"), ("get", "/api/recordings/{id}/diagnosis"),
    ("get", "/api/recordings/{id}/diagnosis/result"), ("get", "/api/recordings/{id}/diagnosis/report.html"),
    ("get", "/api/recordings/{id}/diagnosis/machine.toml"), ("delete", "/api/recordings/{id}/diagnosis"),
}
ANY = ("400", "403", "408", "421", "431", "500", "503")  # of every route
CAPTURES = "/api/drives/emulated/captures"
EXPERIMENTS = "/api/drives/emulated/experiments"
DIAGNOSIS = "/api/recordings/latest/diagnosis"


class Page(HTMLParser):
    """What a page refers to, what it names, and whether its tags are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses = list[str]()
        self.names = set[str]()
        self.tags = list[str]()
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.addresses += [given[key] or "" for key in ("href", "src", "action") if key in given]
        self.names |= {given["id"] or ""} if "id" in given else set()
        if tag not in ("meta", "link"):
            self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.tags.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def document(running_bench: RunningBench) -> dict[str, Any]:
    return httpx.get(f"{running_bench.url}/openapi.json").json()


@pytest.fixture(scope="module")
def page(running_bench: RunningBench) -> Page:
    response = httpx.get(f"{running_bench.url}/docs")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/html")
    assert not re.search(r"@import|url\(|<script", response.text)
    return Page(response.text)


def references(part: object) -> Iterator[str]:
    """Every $ref in a document."""
    if isinstance(part, dict):
        for key, value in cast(dict[str, object], part).items():
            if key == "$ref":
                yield str(value)
            yield from references(value)
    elif isinstance(part, list):
        for item in cast(list[object], part):
            yield from references(item)


def test_the_document_has_every_route_and_refers_to_nothing_that_is_not_there(document: dict[str, Any]) -> None:
    assert document["openapi"].startswith("3.")
    paths = document["paths"]
    operations = {(method, path): told for path, methods in paths.items() for method, told in methods.items()}
    assert set(operations) == ROUTES
    assert len({told["operationId"] for told in operations.values()}) == len(operations)
    for (method, path), told in operations.items():
        assert set(told["responses"]) >= {"202" if told["operationId"].startswith("ask_") else "200", *ANY}
        assert "default" not in told["responses"]
        assert ("415" in told["responses"]) == (method in ("put", "post"))
        assert ("404" in told["responses"]) == ("{" in path)
        of_path = [parameter["name"] for parameter in told.get("parameters", []) if parameter["in"] == "path"]
        assert of_path == re.findall(r"{(\w+)}", path)
    shapes = document["components"]["schemas"]
    assert {f"#/components/schemas/{name}" for name in shapes} >= set(references(document))
    assert "HTTPValidationError" not in shapes  # refusals are problem documents


def test_refusals_and_bodies_are_described(document: dict[str, Any]) -> None:
    change = document["paths"]["/api/drives/{name}/window"]["put"]
    assert set(change["responses"]) == {"200", "404", "413", "415", "422", "502", *ANY}
    assert "application/problem+json" in change["responses"]["422"]["content"]
    shape = document["components"]["schemas"]["WindowChangeModel"]
    assert set(shape["properties"]) == {field.name for field in fields(Window)}
    for body in shape["examples"]:
        Window().changed(body)
    asked = document["paths"]["/api/drives/{name}/captures"]["post"]
    assert set(asked["responses"]) == {"202", "404", "409", "413", "415", "422", "502", *ANY}
    shape = document["components"]["schemas"]["CaptureRequestModel"]
    assert set(shape["properties"]) == {field.name for field in fields(Request)}
    for body in shape["examples"]:
        Request.of(body)
    assert Request.of({name: field["examples"][0] for name, field in shape["properties"].items()})


@pytest.mark.parametrize(
    "model",
    [DriveModel, EstimatesModel, WindowModel, SnapshotModel, HealthModel, CaptureModel, CapturesModel,
     DiagnosisJobModel, ExperimentRunModel],
)
def test_examples_are_of_the_shape_they_explain(document: dict[str, Any], model: Any) -> None:
    shapes = document["components"]["schemas"]
    made = example(shapes[model.__name__], shapes)
    assert model.model_validate_json(json.dumps(made))
    assert '"minimum": 0,' not in json.dumps(made)  # a field's own example comes before its shape's


def test_the_example_of_a_diagnosis_is_one_by_the_published_schema(document: dict[str, Any]) -> None:
    shapes = document["components"]["schemas"]
    validate(example(shapes["DiagnosisModel"], shapes), schema())
    for body in shapes["DiagnosisRequestModel"]["examples"]:
        checked_trust(body.get("trust", {}))
        assert "nominal" not in body or nominal_of(body["nominal"], "nominal").machine is not None


def test_the_page_needs_no_address_but_the_services_own(page: Page) -> None:
    assert page.tags == []
    assert page.addresses
    for address in page.addresses:
        assert address.startswith(("#", "/")), address
        assert not address.startswith("//"), address
        assert not address.startswith("#") or address[1:] in page.names


def test_the_page_shows_every_route_and_every_shape(page: Page, document: dict[str, Any]) -> None:
    for method, path in ROUTES:
        told = document["paths"][path][method]
        assert path in page.text
        assert told["description"] in page.text
    for name, shape in document["components"]["schemas"].items():
        assert f"shape-{name}" in page.names
        for field, told in shape["properties"].items():
            assert field in page.text
            assert told.get("description", "") in page.text


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_the_commands_of_the_page_work_as_they_stand(tmp_path: Path) -> None:
    with bench_up() as bench:  # of its own: an experiment stops the drive
        run_all(Page(httpx.get(f"{bench.url}/docs").text), bench, tmp_path)


def run_all(page: Page, running_bench: RunningBench, tmp_path: Path) -> None:
    """Every command of the page."""
    commands = re.findall(r"^\s*(?:Try it)?(curl .*?)(?:Answers|$)", page.text.replace("curl", "\ncurl"), re.MULTILINE)
    assert len(commands) == len(ROUTES)
    for command in commands:
        arguments = shlex.split(command)
        endless, ended = "-N" in arguments, arguments[1:3] == ["-X", "DELETE"] or "/trigger" in command
        ended |= "/reset" in command  # of no fault
        for kind in (CAPTURES, EXPERIMENTS):
            if f"{kind}/latest" in command:
                until(lambda kind=kind: httpx.get(f"{running_bench.url}{kind}/latest").json()["state"] == "done", kind)
        if re.search("/recordings/latest/diagnosis/|DELETE.*/diagnosis", command):
            diagnosis = f"{running_bench.url}{DIAGNOSIS}"
            until(lambda diagnosis=diagnosis: httpx.get(diagnosis).json()["state"] == "done", "the diagnosis", READY)
        arguments += ["--max-time", "0.5"] if endless else []
        arguments += ["--silent", "--fail-with-body"]
        done = subprocess.run(arguments, capture_output=True, text=True, timeout=10, check=False, cwd=tmp_path)
        assert done.returncode == (28 if endless else 22 if ended else 0), done  # 28: cut; 22: refused
        if ended:
            detail = json.loads(done.stdout)["detail"]
            assert " is done, there is nothing to " in detail or " is in no fault: " in detail
        elif "-o" not in arguments:
            assert done.stdout.startswith("event: snapshot" if endless else "{")
    assert len(read_recording(tmp_path / "capture.parquet").runs[0]) == 5000
    assert len(read_recording(tmp_path / "experiment.parquet").runs[0]) == 5000
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!doctype html>")


def test_names_of_hosts_are_no_part_of_the_page(running_bench: RunningBench) -> None:
    answer = httpx.get(f"{running_bench.url}/docs", headers={"Host": "x<script>alert(1)</script>"})
    assert answer.status_code == 421
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["x-content-type-options"] == "nosniff"
