"""The interactive page at /docs and the OpenAPI document it is made from, as a running bench serves them."""

import io
import json
import re
from collections.abc import Iterator
from dataclasses import fields
from typing import Any, cast

import httpx
import jsonschema
import pyarrow.parquet
import pytest
from pydantic import TypeAdapter

from bench.actions.capture_request import Request
from bench.api.exchange.kinds import BYTES
from bench.api.experiments import ExperimentRunModel
from bench.api.models.captures import CaptureModel, CapturesModel
from bench.api.models.diagnoses import DiagnosisJobModel
from bench.api.models.drives import DriveModel, EstimatesModel, HealthModel, SnapshotModel, WindowModel
from bench.diagnoses.diagnosis_request import checked_trust
from bench.diagnoses.figures.figure import schema as figures_schema
from bench.diagnoses.published import schema
from bench.errors import LimitError
from bench.live.window import Window
from bench.machine_file import nominal_of
from bench.service.signals import checked
from bench.witness import from_table
from tests.conftest import JSON, READY, RunningBench, bench_up
from tests.support.openapi import example, requests
from tests.support.served_drive import until

pytestmark = pytest.mark.live

pq: Any = pyarrow.parquet  # comes without types
validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]
ROUTES = {
    ("get", "/api/drives"), ("get", "/api/drives/{name}"), ("get", "/api/drives/{name}/estimates"),
    ("get", "/api/drives/{name}/window"), ("put", "/api/drives/{name}/window"), ("get", "/api/drives/{name}/stream"),
    ("get", "/metrics"), ("get", "/api/health"),
    ("get", "/api/drives/{name}/captures"), ("post", "/api/drives/{name}/captures"),
    ("get", "/api/drives/{name}/captures/{id}"), ("get", "/api/drives/{name}/captures/{id}/file"),
    ("get", "/api/drives/{name}/signals"), ("get", "/api/drives/{name}/signals/recent"),
    ("put", "/api/drives/{name}/signals"),
    ("post", "/api/drives/{name}/captures/{id}/trigger"), ("delete", "/api/drives/{name}/captures/{id}"),
    ("get", "/api/drives/{name}/experiments"), ("post", "/api/drives/{name}/experiments"),
    ("get", "/api/drives/{name}/experiments/{id}"),
    ("get", "/api/drives/{name}/experiments/{id}/file"), ("delete", "/api/drives/{name}/experiments/{id}"),
    ("get", "/api/drives/{name}/parameters/set"), ("post", "/api/drives/{name}/parameters/plan"),
    *((method, "/api/drives/{name}/flashes") for method in ("get", "post")),
    *((method, "/api/drives/{name}/parameters/rollback") for method in ("get", "post")),
    ("post", "/api/drives/{name}/parameters/resume"), ("get", "/api/drives/{name}/flashes/{id}"),
    *((method, "/api/drives/{name}/commissionings") for method in ("get", "post")),
    *((method, "/api/drives/{name}/commissionings/{id}") for method in ("get", "delete")),
    ("get", "/api/drives/{name}/commissionings/{id}/report.html"),
    *(("post", f"/api/drives/{{name}}/{what}") for what in ("start", "stop", "reset")),
    *(("get", f"/api/drives/{{name}}/{what}") for what in ("history", "events", "parameters")),
    ("get", "/api/drives/{name}/recordings"),
    ("post", "/api/drives/{name}/recordings"), ("get", "/api/recordings"), ("get", "/api/recordings/{id}"),
    ("patch", "/api/recordings/{id}"), ("delete", "/api/recordings/{id}"), ("get", "/api/recordings/{id}/file"),
    ("get", "/api/recordings/{id}/samples"), ("post", "/api/recordings"),
    ("post", "/api/recordings/{id}/stop"), ("post", "/api/recordings/{id}/marks"),
    ("post", "/api/recordings/{id}/diagnosis"), ("get", "/api/recordings/{id}/diagnosis"),
    ("get", "/api/recordings/{id}/diagnosis/result"), ("get", "/api/recordings/{id}/diagnosis/report.html"),
    ("get", "/api/recordings/{id}/diagnosis/machine.toml"), ("delete", "/api/recordings/{id}/diagnosis"),
    ("get", "/api/diagnoses"), ("get", "/api/diagnoses/{id}"), ("delete", "/api/diagnoses/{id}"),
    *(("get", f"/api/diagnoses/{{id}}/{what}") for what in ("result", "figures", "report.html", "machine.toml")),
    ("get", "/api/diagnoses/{id}/stream"), ("get", "/api/recordings/{id}/diagnosis/figures"),
}
ANY = ("400", "403", "408", "421", "422", "431", "500", "503")  # of every route
CAPTURES = "/api/drives/emulated/captures"
EXPERIMENTS = "/api/drives/emulated/experiments"
RECORDING = "/api/recordings/latest"
DIAGNOSIS = "/api/recordings/latest/diagnosis"


@pytest.fixture(scope="module")
def document(running_bench: RunningBench) -> dict[str, Any]:
    return httpx.get(f"{running_bench.url}/openapi.json").json()


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
        assert ("415" in told["responses"]) == (method in ("put", "post", "patch"))
        assert ("404" in told["responses"]) == ("{" in path)
        of_path = [parameter["name"] for parameter in told.get("parameters", []) if parameter["in"] == "path"]
        assert of_path == re.findall(r"{(\w+)}", path)
    shapes = document["components"]["schemas"]
    assert {f"#/components/schemas/{name}" for name in shapes} >= set(references(document))
    assert "HTTPValidationError" not in shapes  # refusals are problem documents


def leaves(shapes: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Properties of all shapes that are no shapes themselves: where, the property, those beside it."""
    for model, shape in shapes.items():
        beside = shape.get("properties", {})
        yield from ((f"{model}.{name}", field, beside) for name, field in beside.items() if kinds(field))


def held(field: dict[str, Any]) -> list[dict[str, Any]]:
    """What a property holds: one of several, items, values by name."""
    inner = [*field.get("anyOf", ()), *field.get("properties", {}).values()]
    return inner + [field[key] for key in ("items", "additionalProperties") if isinstance(field.get(key), dict)]


def kinds(field: dict[str, Any]) -> set[str]:
    """JSON's types of the values in a property, whatever holds them; none of other shapes."""
    return {field.get("type", "null")}.union(*map(kinds, held(field))) - {"array", "object", "null"}


def has_example(field: dict[str, Any]) -> bool:
    """An example, or the only values that it takes, of the property or of what it holds."""
    return any(key in field for key in ("examples", "enum", "const", "default")) or any(map(has_example, held(field)))


OBVIOUS = {  # names of properties that say what they are
    "alive", "at", "asked", "chosen", "description", "device_name", "drive", "effect", "effects", "groups", "holder",
    "id", "method", "name", "note", "parameters", "path", "product_code", "reason", "revision", "rms_V", "rows",
    "sentence", "serial", "text", "time", "title", "type", "unit", "vendor_id", "version",
}  # fmt: skip
UNIT_IN_NAME = re.compile(r"_(s|V|A|hz|rpm)$|bytes|odds|^days$")
UNIT = re.compile(
    r"\b(s|V|A|Vs|ohm|H|Hz|Nm|rad|rad/s|rad/s2|rpm|degC|SI|shares?|ratio|unit|weight|deviations?)\b|0 to 1"
)  # or what says that it has none


def test_every_property_has_an_example_a_meaning_and_its_unit(document: dict[str, Any]) -> None:
    wanting = list[str]()
    for where, field, beside in leaves(document["components"]["schemas"]):
        name, said = where.partition(".")[2], field.get("description", "")
        if not has_example(field):
            wanting.append(f"{where}: an example")
        if not said and name not in OBVIOUS and "enum" not in field:
            wanting.append(f"{where}: a description")
        has_unit = "unit" in beside or UNIT_IN_NAME.search(name) or UNIT.search(said)
        if "number" in kinds(field) and not has_unit:
            wanting.append(f"{where}: a unit, got {said!r}")
    assert wanting == []


def test_refusals_and_bodies_are_described(document: dict[str, Any]) -> None:
    change = document["paths"]["/api/drives/{name}/window"]["put"]
    assert set(change["responses"]) == {"200", "404", "412", "413", "415", "422", "502", *ANY}
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
    shapes = document["components"]["schemas"]
    assert Request.of({name: example(field, shapes) for name, field in shape["properties"].items()})


def test_signals_that_may_be_written_are_described_with_what_they_take(document: dict[str, Any]) -> None:
    described = document["components"]["schemas"]["SignalValuesModel"]["properties"]
    assert "i_q_ref" in described
    assert "capture_length" not in described  # which captures write
    for name, shape in described.items():
        assert checked({name: shape.get("minimum", 0)})
        for end, beyond in (("minimum", -1), ("maximum", 1)):
            if end in shape:
                with pytest.raises(LimitError, match=rf"\({name}\) takes at"):
                    checked({name: shape[end] + beyond})


@pytest.mark.parametrize(
    "model",
    [DriveModel, EstimatesModel, WindowModel, SnapshotModel, HealthModel, CaptureModel, CapturesModel,
     DiagnosisJobModel, ExperimentRunModel],
)
def test_examples_are_of_the_shape_they_explain(document: dict[str, Any], model: Any) -> None:
    shapes = document["components"]["schemas"]
    made = example(shapes[model.__name__], shapes)
    assert TypeAdapter(model).validate_json(json.dumps(made))
    assert '"minimum": 0,' not in json.dumps(made)  # a field's own example comes before its shape's


def test_the_example_of_a_diagnosis_is_one_by_the_published_schema(document: dict[str, Any]) -> None:
    shapes = document["components"]["schemas"]
    validate(example(shapes["DiagnosisModel"], shapes), schema())
    validate(example(shapes["FiguresModel"], shapes), figures_schema())
    for body in shapes["DiagnosisRequestModel"]["examples"]:
        checked_trust(body.get("trust", {}))
        assert set(from_table(body.get("witness", {}), "")) == set(body.get("witness", {}))
        assert "nominal" not in body or nominal_of(body["nominal"], "nominal").machine is not None


def test_the_page_needs_no_address_but_the_services_own(running_bench: RunningBench) -> None:
    response = httpx.get(f"{running_bench.url}/docs")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/html")
    addresses = re.findall(r"(?:src|href|url)[=:] *['\"]([^'\"]+)", response.text)
    assert {"/assets/swagger-ui-bundle.js", "/assets/swagger-ui.css", "/openapi.json"} <= set(addresses)
    for address in addresses:
        assert address.startswith("/"), address
        assert not address.startswith("//"), address
        assert httpx.get(f"{running_bench.url}{address}").status_code == 200


@pytest.mark.slow
def test_the_examples_of_the_document_work_as_they_stand() -> None:
    with bench_up() as bench, httpx.Client(base_url=bench.url, headers=JSON, timeout=10.0) as client:
        # Of its own: an experiment stops the drive
        document = client.get("/openapi.json").json()
        asked = list(requests(document, "emulated"))
        assert len(asked) == len(ROUTES)
        for method, path, body in asked:
            answered(client, method, path, body)
        for kind in (CAPTURES, EXPERIMENTS):
            file = io.BytesIO(client.get(f"{kind}/latest/file").content)
            assert pq.read_table(file).num_rows == 5000
        assert client.get(f"{DIAGNOSIS}/report.html").text.startswith("<!doctype html>")


def answered(client: httpx.Client, method: str, path: str, body: str | None) -> None:
    """One request, once what it asks of is done."""
    for kind in (CAPTURES, EXPERIMENTS):
        if f"{kind}/latest" in path:
            until(lambda kind=kind: client.get(f"{kind}/latest").json()["state"] == "done", kind)
    if re.search("/emulated/(flashes|parameters/|recordings)", path):  # with a link, which a flash's reset ends
        until(lambda: idle(client), "the flash")
    if path in (f"{RECORDING}/marks", f"{RECORDING}/file", f"{RECORDING}/samples"):
        until(lambda: client.get(RECORDING).json()["state"] == "done", "the recording")
    if path == f"{RECORDING}/stop":
        until(lambda: client.get(RECORDING).json()["rows"] > 200, "rows")
    if re.search("/recordings/latest/diagnosis/|/diagnoses/latest", path) or (
        method == "delete" and path.endswith("/diagnosis")
    ):
        until(lambda: client.get(DIAGNOSIS).json()["state"] == "done", "the diagnosis", READY)
    if (method, path) == ("post", "/api/recordings"):  # whose example would be a recording
        answer = client.post(path, params={"name": "x.csv"}, content=b"t\n1\n2\n", headers={"Content-Type": BYTES})
        assert "missing columns: u_d" in answer.json()["detail"]
        return
    if path.endswith("/stream"):
        with client.stream(method, path) as events:
            assert next(events.iter_lines()) == f"event: {'progress' if 'diagnoses' in path else 'snapshot'}"
        return
    answer = client.request(method, path, content=body)
    of_commissioning = "/commissionings/" in path  # which takes its time: it can be cancelled, and has no report
    ended = method == "delete" and not of_commissioning
    if of_commissioning and path.endswith("/report.html"):
        assert "expected the id of an identification that is done" in answer.json()["detail"]
    elif ended or path.endswith(("/trigger", "/reset", "/resume")):  # of what is done, of no fault, not cut
        said = " is done, there is nothing to | is in no fault: |^expected the id of|^no flash of this drive was cut"
        assert re.search(said, answer.json()["detail"])
    else:
        assert answer.status_code in (200, 202), answer.text


def idle(client: httpx.Client) -> bool:
    """No flash is under way, and the link is there."""
    drive = client.get("/api/drives/emulated").json()
    return not drive["control"]["in_flash"] and drive["link"]["state"] == "streaming"


def test_names_of_hosts_are_no_part_of_the_page(running_bench: RunningBench) -> None:
    answer = httpx.get(f"{running_bench.url}/docs", headers={"Host": "x<script>alert(1)</script>"})
    assert answer.status_code == 421
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["x-content-type-options"] == "nosniff"
