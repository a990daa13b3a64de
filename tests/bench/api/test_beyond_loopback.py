"""A service beyond loopback: nothing without the token, over TLS; its command line, its login; what its start says."""

import os
import socket
import ssl
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from tests.bench.api.test_connections import certificate
from tests.conftest import COMMAND, JSON, READY, command, free_port
from tests.support.served_drive import until

__all__ = ["certificate"]

pytestmark = pytest.mark.live


@dataclass(frozen=True)
class Guarded:
    port: int
    token: str
    folder: Path
    certificate: Path
    said: str  # at the start

    def client(self, **headers: str) -> httpx.Client:
        context = ssl.create_default_context(cafile=self.certificate)
        return httpx.Client(base_url=f"https://localhost:{self.port}", verify=context, headers=headers, timeout=30.0)


def configured(folder: Path, port: int, *lines: str) -> Path:
    """A service over a drive that is not there."""
    path = folder / "bench.toml"
    drive = f'[drives.absent]\nurl = "canopen://socketcand/127.0.0.1:{free_port()}/can0/5"\n'
    service = ["[service]", 'host = "0.0.0.0"', f"port = {port}", 'token = "token"', 'log = "log"', *lines]
    path.write_text("\n".join([*service, drive]), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory, certificate: Path) -> Iterator[Guarded]:
    folder, port = tmp_path_factory.mktemp("guarded"), free_port()
    config = configured(
        folder, port, f'certificate = "{certificate}/certificate.pem"', f'key = "{certificate}/key.pem"'
    )
    with command("serve", "--config", str(config)) as process:
        assert process.stdout is not None
        said = ""
        while "Ctrl-C" not in said:
            line = process.stdout.readline()
            assert line, process.communicate(timeout=READY)
            said += line
        until(lambda: answers(port), "the port to be open")
        token = (folder / "token").read_text(encoding="ascii").strip()
        yield Guarded(port, token, folder, certificate / "certificate.pem", said)


def answers(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def test_the_start_says_to_whom_it_is_open(guarded: Guarded) -> None:
    open_to = f"whoever reaches port {guarded.port} and has the token (`pmsm-bench token`, `--config FILE`), over TLS"
    assert f"open   to {open_to}\n" in guarded.said
    assert f"page   https://{socket.gethostname()}:{guarded.port}/" in guarded.said
    assert guarded.token not in guarded.said


@pytest.mark.parametrize(
    "path", ["/api/drives", "/api/health", "/metrics", "/openapi.json", "/web/main.js", "/nothing"]
)
def test_nothing_is_told_without_the_token(guarded: Guarded, path: str) -> None:
    with guarded.client() as client:
        refused = client.get(path)
        assert refused.status_code == 401
        assert refused.headers["www-authenticate"] == "Bearer"
        assert refused.headers["content-type"] == "application/problem+json"
        assert client.get(path, headers={"Authorization": f"Bearer {guarded.token}x"}).status_code == 401
        assert client.get(path, headers={"Authorization": f"Bearer {guarded.token}"}).status_code in (200, 404)


def test_nothing_is_written_without_the_token_and_who_wrote_with_it_is_logged(guarded: Guarded) -> None:
    window = "/api/drives/absent/window"
    with guarded.client(**JSON) as client:
        assert client.put(window, json={"length": 700}).status_code == 401
        authorised = {"Authorization": f"Bearer {guarded.token}"}
        assert client.put(window, json={"length": 800}, headers=authorised).json()["length"] == 800
    path = guarded.folder / "log" / "writes.jsonl"
    until(lambda: path.exists() and '"by": "token"' in path.read_text(encoding="ascii"), "the write to be logged")
    assert guarded.token not in path.read_text(encoding="ascii")
    refused = (guarded.folder / "log" / "refused.jsonl").read_text(encoding="ascii")
    assert '"status": 401' in refused


def test_a_browser_logs_in_by_a_form_and_has_a_cookie_that_no_script_reads(guarded: Guarded) -> None:
    with guarded.client(Accept="text/html") as client:
        form = client.get("/")
        assert form.status_code == 401
        assert '<form method="post" action="/login">' in form.text
        assert client.post("/login", data={"token": "x" * 43}).status_code == 401
        assert client.post("/login", content=b"x" * 10_000).status_code == 401
        foreign = client.post("/login", data={"token": guarded.token}, headers={"Origin": "https://evil.example"})
        assert foreign.status_code == 403
        assert client.get("/").status_code == 401
        entered = client.post("/login", data={"token": guarded.token})
        assert (entered.status_code, entered.headers["location"]) == (303, "/")
        assert {"HttpOnly", "Secure", "SameSite=Strict"} <= set(entered.headers["set-cookie"].split("; "))
        assert "api.js" in client.get("/web/main.js").text
        assert client.put("/api/drives/absent/window", json={"length": 810}).json()["length"] == 810
        with client.stream("GET", "/api/drives/absent/stream") as events:
            assert next(events.iter_lines()) == "event: snapshot"


def test_the_documentation_says_that_a_token_is_needed(guarded: Guarded) -> None:
    with guarded.client(Authorization=f"Bearer {guarded.token}") as client:
        document = client.get("/openapi.json").json()
        assert document["security"] == [{"token": []}]
        assert all("401" in told["responses"] for path in document["paths"].values() for told in path.values())
        scheme = document["components"]["securitySchemes"]["token"]  # which the page asks for
        assert (scheme["type"], scheme["scheme"]) == ("http", "bearer")
        assert client.get("/docs").status_code == 200


def test_the_command_line_takes_the_token_from_its_variable_or_this_machines_file(
    guarded: Guarded, tmp_path: Path
) -> None:
    asked = [*COMMAND, "estimates", "absent", "--once", "--service", f"https://localhost:{guarded.port}"]
    usual = {**os.environ, "SSL_CERT_FILE": str(guarded.certificate), "XDG_DATA_HOME": str(tmp_path)}

    def said(**more: str) -> tuple[int, str]:
        done = subprocess.run(asked, capture_output=True, text=True, env=usual | more, check=False, timeout=READY)
        return done.returncode, done.stdout + done.stderr

    code, text = said()
    assert (code, "expected the token of this service" in text) == (2, True)
    assert "expected the token" not in said(PMSM_BENCH_TOKEN=guarded.token)[1]
    code, text = said(PMSM_BENCH_TOKEN="wrong")
    assert (code, "wrong" in text) == (2, False)
    assert "environment variable PMSM_BENCH_TOKEN: expected a token" in text
    (tmp_path / "pmsm-bench").mkdir()
    (tmp_path / "pmsm-bench" / "token").write_text(guarded.token, encoding="ascii")
    (tmp_path / "pmsm-bench" / "token").chmod(0o600)
    assert "expected the token" not in said()[1]


def test_without_tls_it_does_not_open(tmp_path: Path) -> None:
    config = configured(tmp_path, free_port())
    done = subprocess.run(
        [*COMMAND, "serve", "--config", str(config)], capture_output=True, text=True, check=False, timeout=READY
    )
    assert done.returncode == 2
    assert done.stderr.startswith("pmsm-bench: host 0.0.0.0 is beyond loopback: without TLS everybody on the way reads")
    assert done.stderr.count("\n") == 1
