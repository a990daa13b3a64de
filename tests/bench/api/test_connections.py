"""Connections of the HTTP server: how many, and how long each may take. A real server, an application of the test's."""

import asyncio
import contextlib
import json
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send

from bench.api.guard.connections import Connections, Limits
from tests.support.served_drive import until

pytestmark = pytest.mark.thorough

SHORT = Limits(open=8, head=0.4, body=0.4, handshake=0.4, taking=0.4)
GET = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
PATIENCE = 10.0  # s


async def app(scope: Scope, receive: Receive, send: Send) -> None:
    """Answers with the length of the body; at /much with more than fits between two sockets."""
    length = 0
    while True:
        message = await receive()
        length += len(message.get("body", b""))
        if message["type"] == "http.disconnect":
            return
        if not message.get("more_body"):
            break
    body = b"x" * (64 << 20) if scope["path"] == "/much" else str(length).encode()
    headers = [(b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})


@dataclass(frozen=True)
class Running:
    port: int
    connections: Connections


@contextlib.contextmanager
def running(limits: Limits = SHORT, tls: ssl.SSLContext | None = None) -> Generator[Running]:
    connections = Connections(limits, tls)
    config = uvicorn.Config(
        app, http=cast(Any, connections.protocol), ws="none", lifespan="off", log_level="critical",
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listener])))
        thread.start()
        try:
            until(lambda: server.started, "the server to start")
            yield Running(port, connections)
        finally:
            server.should_exit = True
            thread.join(PATIENCE)


def connected(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), PATIENCE)


def heard(one: socket.socket) -> bytes:
    """All that is said until the other side closes."""
    said = b""
    with contextlib.suppress(ConnectionResetError):
        while part := one.recv(65536):
            said += part
    return said


def said_until(one: socket.socket, end: bytes) -> bytes:
    """All that is said, up to an end."""
    said = b""
    while not said.endswith(end):
        part = one.recv(65536)
        assert part, said
        said += part
    return said


def took(work: Callable[[], object]) -> float:
    began = time.monotonic()
    work()
    return time.monotonic() - began


def problem(said: bytes) -> dict[str, Any]:
    head, _, body = said.partition(b"\r\n\r\n")
    assert b"Content-Type: application/problem+json" in head
    return json.loads(body)


def test_who_comes_with_a_request_is_let_in_however_many_come_without() -> None:
    with running(replace(SHORT, head=60.0)) as server, contextlib.ExitStack() as stack:
        idle = [stack.enter_context(connected(server.port)) for _ in range(30)]
        with connected(server.port) as one:
            one.sendall(GET)
            assert one.recv(100).startswith(b"HTTP/1.1 200 OK")
        surplus = [heard(each) for each in idle[:20]]  # those that have waited longest
        for said in surplus:
            assert said.startswith(b"HTTP/1.1 503 Service Unavailable\r\n")
            assert b"\r\nRetry-After: 1\r\n" in said
            assert problem(said)["detail"] == "the service has 8 connections at most, and this one waited longest"
        assert len(server.connections) <= 8


def test_connections_that_say_nothing_are_closed_and_forgotten() -> None:
    with running() as server, connected(server.port) as fresh, connected(server.port) as used:
        used.sendall(GET)
        said_until(used, b"\r\n\r\n0")
        assert took(lambda: heard(fresh)) < 5.0
        assert heard(used) == b""
        until(lambda: len(server.connections) == 0, "all to be forgotten")


@pytest.mark.parametrize("after_an_answer", [False, True])
def test_a_head_that_comes_letter_by_letter_is_given_up(after_an_answer: bool) -> None:
    with running() as server, connected(server.port) as one:
        if after_an_answer:
            one.sendall(GET)
            said_until(one, b"\r\n\r\n0")
        one.settimeout(0.05)
        said = b""
        for letter in GET[:-4] + b"\r\nX: " + b"x" * 200:
            with contextlib.suppress(OSError):
                one.sendall(bytes([letter]))
                said += one.recv(1000)
            if said:
                break
        assert said.startswith(b"HTTP/1.1 408 Request Timeout")
        assert problem(said)["detail"] == "expected the rest of a request within 0.4 s, got a part of it"


def test_a_body_that_does_not_come_is_given_up() -> None:
    with running() as server, connected(server.port) as one:
        one.sendall(b"PUT / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\nabc")
        said = heard(one)
        assert said.startswith(b"HTTP/1.1 408 Request Timeout")
        until(lambda: len(server.connections) == 0, "it to be forgotten")


def test_an_answer_that_nobody_takes_is_given_up() -> None:
    with running() as server, connected(server.port) as one:
        one.sendall(b"GET /much HTTP/1.1\r\nHost: x\r\n\r\n")
        assert one.recv(15) == b"HTTP/1.1 200 OK"
        until(lambda: len(server.connections) == 0, "it to be forgotten")


@pytest.mark.parametrize(
    ("text", "status"),
    [(b"\x16\x03\x01 nonsense\r\n\r\n", 400), (b"GET / HTTP/1.1\r\n\r\n", 400),
     (b"GET / HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n", 400), (b"GET / HTTP/1.1\r\nX: " + b"x" * 100_000, 431)],
)  # fmt: skip
def test_what_is_no_request_is_answered_with_a_problem_document(text: bytes, status: int) -> None:
    with running() as server, connected(server.port) as one:
        with contextlib.suppress(ConnectionError):
            one.sendall(text)
        told = problem(heard(one))
        assert told["status"] == status
        assert told["detail"].startswith("Invalid HTTP request: ")


def test_requests_one_after_the_other_and_at_once_are_answered_in_their_order() -> None:
    with running() as server, connected(server.port) as one:
        for length in range(20):
            one.sendall(b"PUT / HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % length + b"x" * length)
        answers = said_until(one, b"\r\n\r\n19").split(b"HTTP/1.1 200 OK")[1:]
        assert [int(answer.partition(b"\r\n\r\n")[2]) for answer in answers] == list(range(20))


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A certificate and its key in one file."""
    folder = tmp_path_factory.mktemp("tls")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
         "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1",
         "-keyout", folder / "key.pem", "-out", folder / "certificate.pem"], check=True, capture_output=True,
    )  # fmt: skip
    return folder


def test_connections_are_counted_before_tls_and_its_handshake_is_given_up_when_it_does_not_come(
    certificate: Path,
) -> None:
    server_side = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server_side.load_cert_chain(certificate / "certificate.pem", certificate / "key.pem")
    client_side = ssl.create_default_context(cafile=certificate / "certificate.pem")
    with running(SHORT, server_side) as server, contextlib.ExitStack() as stack:
        idle = [stack.enter_context(connected(server.port)) for _ in range(30)]
        until(lambda: len(server.connections) == 8, "the surplus to be closed")
        plain = stack.enter_context(connected(server.port))
        plain.sendall(GET)
        assert b"200 OK" not in heard(plain)
        raw = stack.enter_context(connected(server.port))
        one = stack.enter_context(client_side.wrap_socket(raw, server_hostname="localhost"))
        one.sendall(GET)
        assert one.recv(1000).startswith(b"HTTP/1.1 200 OK")
        for each in idle:
            assert heard(each) == b""
        until(lambda: len(server.connections) == 0, "all to be forgotten")
