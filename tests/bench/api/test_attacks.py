"""Attacks on a running bench by socket: each is refused, changes nothing, and is in the log."""

import json
import os
import socket
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.conftest import JSON, RunningBench
from tests.support.served_drive import until

pytestmark = pytest.mark.live

DRIVE = "/api/drives/emulated"
HOLD = b'{"holds": [{"speed_rpm": 1200, "i_d": 0, "i_q": 3, "seconds": 5}]}'
WRITES = [
    ("POST", f"{DRIVE}/experiments", HOLD), ("PUT", f"{DRIVE}/signals", b'{"i_q_ref": 5.0}'),
    ("PUT", f"{DRIVE}/window", b'{"length": 777}'), ("POST", f"{DRIVE}/captures", b""),
    ("POST", f"{DRIVE}/captures/latest/trigger", b""), ("DELETE", f"{DRIVE}/captures/latest", b""),
    ("POST", "/api/recordings/latest/diagnosis", b""),
]  # fmt: skip


def log(name: str) -> list[dict[str, Any]]:
    """The service's log of that name."""
    path = Path(os.environ["XDG_DATA_HOME"], "pmsm-bench", "log", f"{name}.jsonl")
    return [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()] if path.exists() else []


def state(url: str) -> dict[str, Any]:
    """What an attack could have changed."""
    read = list[httpx.Response]()

    def has_answered() -> bool:  # a link may be lost while other work holds the machine up
        read.append(httpx.get(f"{url}{DRIVE}/signals", params={"names": "i_q_ref,i_d_ref,watchdog_time"}, timeout=30.0))
        return read[-1].status_code == 200

    until(has_answered, "the drive to answer")
    return {
        "signals": {signal["name"]: signal["value"] for signal in read[-1].json()["signals"]},
        "window": httpx.get(f"{url}{DRIVE}/window").json(), "captures": httpx.get(f"{url}{DRIVE}/captures").json(),
        "experiment": httpx.get(f"{url}{DRIVE}/experiments/latest").status_code,
        "writer": httpx.get(f"{url}{DRIVE}").json()["writer"],
    }  # fmt: skip


def sent(bench: RunningBench, method: str, path: str, body: bytes, *headers: str) -> bytes:
    """What is answered to a request as it stands."""
    url = httpx.URL(bench.url)
    head = "\r\n".join([f"{method} {path} HTTP/1.1", *headers, f"Content-Length: {len(body)}", "Connection: close"])
    with socket.create_connection((url.host, url.port), 10.0) as one:
        one.sendall(head.encode("latin-1") + b"\r\n\r\n" + body)
        said = b""
        while part := one.recv(65536):
            said += part
    return said


@pytest.mark.parametrize(("method", "path", "body"), WRITES)
@pytest.mark.parametrize(
    ("headers", "status", "why"),
    [(("Host: rebound.example:{port}", "Content-Type: application/json"), 421, "'rebound.example:"),
     (("Host: localhost:{port}", "Content-Type: application/json", "Origin: http://evil.example"), 403, "evil.example"),
     (("Host: localhost:{port}", "Content-Type: application/json", "Origin: null"), 403, "'null'"),
     (("Host: localhost:{port}", "Content-Type: application/json", "Sec-Fetch-Site: cross-site"), 403, "'cross-site'")],
    ids=["rebound name", "another origin", "no origin of its own", "another site"],
)  # fmt: skip
def test_a_write_of_another_page_is_refused_changes_nothing_and_is_logged(
    running_bench: RunningBench, method: str, path: str, body: bytes, headers: tuple[str, ...], status: int, why: str
) -> None:
    before, logged = state(running_bench.url), len(log("refused"))
    port = httpx.URL(running_bench.url).port
    said = sent(running_bench, method, path, body, *(header.format(port=port) for header in headers))
    assert said.startswith(b"HTTP/1.1 %d " % status), said
    assert b"x-frame-options: DENY" in said
    assert state(running_bench.url) == before
    until(lambda: len(log("refused")) > logged, "the refusal to be logged")
    told = log("refused")[-1]
    assert (told["who"], told["method"], told["path"], told["status"]) == ("127.0.0.1", method, path, status)
    assert why in told["outcome"]


@pytest.mark.parametrize(("method", "path", "body"), WRITES)
@pytest.mark.parametrize("media", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary"])
def test_what_a_form_can_say_is_no_put_and_no_post(
    running_bench: RunningBench, method: str, path: str, body: bytes, media: str
) -> None:
    if method == "DELETE":
        return  # which no form can say
    before = state(running_bench.url)
    port = httpx.URL(running_bench.url).port
    said = sent(running_bench, method, path, body, f"Host: localhost:{port}", f"Content-Type: {media}")
    assert said.startswith(b"HTTP/1.1 415 ")
    assert state(running_bench.url) == before


def test_a_rebound_name_reads_nothing_either(running_bench: RunningBench) -> None:
    port = httpx.URL(running_bench.url).port
    for path in ("/", "/docs", "/openapi.json", "/api/drives", f"{DRIVE}/signals", f"{DRIVE}/stream"):
        assert sent(running_bench, "GET", path, b"", f"Host: rebound.example:{port}").startswith(b"HTTP/1.1 421 ")


def test_stop_takes_a_bare_line(running_bench: RunningBench) -> None:
    port = httpx.URL(running_bench.url).port
    for method, path in (("DELETE", f"{DRIVE}/experiments/latest"), ("POST", f"{DRIVE}/stop")):
        said = sent(running_bench, method, path, b"", f"Host: localhost:{port}")
        assert not said.startswith((b"HTTP/1.1 415", b"HTTP/1.1 403", b"HTTP/1.1 421")), said


@pytest.mark.parametrize("path", ["/", "/docs", "/api/drives", "/web/main.js", "/nothing"])
def test_every_answer_forbids_to_be_framed_and_to_be_guessed_at(running_bench: RunningBench, path: str) -> None:
    headers = httpx.get(f"{running_bench.url}{path}").headers
    assert headers["x-frame-options"] == "DENY"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "same-origin"


def test_a_write_is_logged_with_who_and_what_was_before_and_after(running_bench: RunningBench) -> None:
    off, on = "switch on disabled", "operation enabled"
    with httpx.Client(base_url=running_bench.url, headers=JSON) as client:
        client.post(f"{DRIVE}/start").raise_for_status()  # another test may have stopped it
        until(lambda: log("writes")[-1]["path"] == f"{DRIVE}/start", "the start to be logged")
        logged = len(log("writes"))
        before = client.get(f"{DRIVE}/window").json()["length"]
        client.put(f"{DRIVE}/window", json={"length": before + 11}).raise_for_status()
        client.put(f"{DRIVE}/window", json={"length": before}).raise_for_status()
        held = state(running_bench.url)["signals"]["i_q_ref"]
        client.put(f"{DRIVE}/signals", json={"i_q_ref": 1.25}).raise_for_status()
        client.put(f"{DRIVE}/signals", json={"i_q_ref": held}).raise_for_status()
        client.post(f"{DRIVE}/stop").raise_for_status()
        client.post(f"{DRIVE}/start").raise_for_status()
        assert client.put(f"{DRIVE}/window", json={"length": -1}).status_code == 422
    until(lambda: len(log("writes")) >= logged + 6, "six writes to be logged")
    told = log("writes")[logged:]
    assert [(entry["path"].removeprefix(f"{DRIVE}/"), entry["before"], entry["after"]) for entry in told] == [
        ("window", {"length": before}, {"length": before + 11}),
        ("window", {"length": before + 11}, {"length": before}),
        ("signals", {"i_q_ref": held}, {"i_q_ref": 1.25}),
        ("signals", {"i_q_ref": 1.25}, {"i_q_ref": held}),
        ("stop", {"state": on, "holder": told[-2]["before"]["holder"]}, {"state": off, "holder": None}),
        ("start", {"state": off, "holder": None}, {"state": on, "holder": told[-1]["after"]["holder"]}),
    ]
    assert told[-2]["before"]["holder"] == told[-1]["after"]["holder"]
    assert {(entry["who"], entry["by"], entry["status"]) for entry in told} == {("127.0.0.1", "loopback", 200)}
    until(lambda: log("refused")[-1]["body"] == '{"length":-1}', "the refusal to be logged")
    assert log("refused")[-1]["status"] == 422
