"""Who may call: Host, Origin, what browsers tell of a request's origin, token and pass. By values alone."""

from pathlib import Path

import pytest
from starlette.datastructures import Headers

from bench.api.exchange.kinds import is_stop
from bench.api.guard import page_pass
from bench.api.guard.access import Access, access_to
from bench.config import Config
from bench.errors import ConfigError
from bench.service.token import Known, made, renewed

LOOPBACK = Access(8080, names=frozenset({"127.0.0.1", "bench.lan", "desk.lan:9000"}))


def status(access: Access, method: str = "PUT", **headers: str) -> int | None:
    """With which a request is refused; None where it is not."""
    given = {"host": "localhost:8080"} | {name.replace("_", "-"): value for name, value in headers.items()}
    refusal = access.refusal(method, Headers(given))
    return None if refusal is None else refusal.status


@pytest.mark.parametrize(
    "host", ["localhost:8080", "LOCALHOST:8080", "127.0.0.1:8080", "127.1.2.3:8080", "[::1]:8080", "bench.lan:8080",
             "desk.lan:9000", "localhost", "localhost:9000", "127.0.0.1:9000", "[::1]:9000"],
)  # fmt: skip
def test_any_name_of_loopback_and_those_of_the_configuration_are_the_services_own(host: str) -> None:
    assert status(LOOPBACK, host=host) is None
    assert status(LOOPBACK, host=host, origin=f"http://{host}") is None


@pytest.mark.parametrize(
    "host", ["", "evil.example:8080", "localhost.evil.example:8080",
             "127.0.0.1.evil.example:8080", "192.168.1.5:8080", "[fd00::1]:8080", "bench.lan", "bench.lan:9000",
             "localhost:8080@evil.example", "localhost:8080, evil.example", "localhost :8080", "0.0.0.0:8080",
             "desk.lan:8080", "x" * 5000],
)  # fmt: skip
@pytest.mark.parametrize("method", ["GET", "PUT"])
def test_another_host_is_421_reads_too(host: str, method: str) -> None:
    assert status(LOOPBACK, method, host=host) == 421


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "http://localhost", "http://localhost:8081", "https://localhost:8080",
               "http://127.0.0.1:8080", "http://localhost:8080.evil.example", "http://localhost:8080/", "file://"],
)  # fmt: skip
@pytest.mark.parametrize("method", ["GET", "PUT", "POST", "DELETE", "OPTIONS"])
def test_another_origin_is_403_whatever_the_method(origin: str, method: str) -> None:
    assert status(LOOPBACK, method, origin=origin) == 403


@pytest.mark.parametrize(
    ("method", "site", "mode", "dest", "refused"),
    [("GET", "cross-site", "navigate", "document", None),  # a link that is followed
     ("GET", "cross-site", "navigate", "iframe", 403), ("GET", "same-site", "no-cors", "image", 403),
     ("GET", "cross-site", "no-cors", "script", 403), ("POST", "cross-site", "navigate", "document", 403),
     ("POST", "same-site", "navigate", "document", 403), ("POST", "same-origin", "cors", "empty", None),
     ("GET", "none", "navigate", "document", None)],
)  # fmt: skip
def test_what_another_page_asks_for_is_403_but_for_a_link_to_this_one(
    method: str, site: str, mode: str, dest: str, refused: int | None
) -> None:
    told = {"sec_fetch_site": site, "sec_fetch_mode": mode, "sec_fetch_dest": dest}
    assert status(LOOPBACK, method, **told) == refused


def test_stop_is_known_by_method_and_path() -> None:
    for asked in (("POST", "/api/drives/a/stop"), ("DELETE", "/api/drives/a b/experiments/latest"),
                  ("DELETE", "/api/drives/a/captures/x")):  # fmt: skip
        assert is_stop(*asked)
    for asked in (("GET", "/api/drives/a/stop"), ("POST", "/api/drives/a/stop/"), ("POST", "/api/drives/a/b/stop"),
                  ("POST", "/api/drives/a/start"), ("DELETE", "/api/recordings/a/diagnosis")):  # fmt: skip
        assert not is_stop(*asked)


def config(tmp_path: Path, **more: object) -> Config:
    return Config((), **{"token": tmp_path / "token", "host": "0.0.0.0", **more})  # pyright: ignore[reportArgumentType]


def test_on_loopback_no_token_is_needed_and_none_is_made(tmp_path: Path) -> None:
    for host, address in (("127.0.0.1", "127.0.0.1"), ("localhost", "127.0.0.1"), ("::1", "::1")):
        access = access_to(config(tmp_path, host=host), address, 8080)
        assert access.token is None
        assert access.by(Headers({})) == "loopback"
        assert access.told() == "this machine, without a token"
    assert not (tmp_path / "token").exists()


@pytest.mark.parametrize("address", ["0.0.0.0", "::", "192.168.1.5", "fe80::1%eth0"])
def test_beyond_loopback_it_does_not_open_without_tls_unless_that_is_said(tmp_path: Path, address: str) -> None:
    with pytest.raises(ConfigError, match=r"is beyond loopback: .* or insecure = true"):
        access_to(config(tmp_path), address, 8080)
    access = access_to(config(tmp_path, insecure=True), address, 8080)
    assert access.token is not None
    assert "without TLS: the token can be read on its way" in access.told()
    assert "has the token (`pmsm-bench token`, `--config FILE`)" in access.told()


def test_beyond_loopback_addresses_are_its_own_and_foreign_names_are_not(tmp_path: Path) -> None:
    access = access_to(config(tmp_path, insecure=True, names=("bench.lan",)), "0.0.0.0", 8080)
    for host in ("192.168.1.5:8080", "[fd00::5]:8080", "localhost:8080", "bench.lan:8080"):
        assert status(access, host=host) is None
    assert status(access, host="evil.example:8080") == 421


def test_beyond_loopback_the_token_or_a_pass_by_it_is_needed_and_another_ends_both(tmp_path: Path) -> None:
    token = made(tmp_path / "token")
    now = 0.0
    access = Access(8080, token=Known(tmp_path / "token", lambda: now))

    def by(**headers: str) -> str | None:
        return access.by(Headers(headers))

    cookie, _, rest = access.cookie().partition("; ")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(rest.split("; "))
    assert token not in cookie
    assert by(authorization=f"Bearer {token}") == "token"
    assert by(cookie=f"a=b; {cookie}") == "page"
    for wrong in ("", "Bearer", "Bearer ", f"Bearer {token[:-1]}", f"Basic {token}", f"Bearer {token}x", "Bearer \xff"):
        assert by(authorization=wrong) is None
    name, _, value = cookie.partition("=")
    until, _, proof = value.partition(".")
    for forged in ("", ".", value[:-1], f"{int(until) + 1}.{proof}", f"-1.{proof}", f"{'9' * 90}.{proof}", token):
        assert by(cookie=f"{name}={forged}") is None
    renewed(tmp_path / "token")
    now = 2.0
    assert by(authorization=f"Bearer {token}") is None
    assert by(cookie=cookie) is None


def test_a_pass_ends_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    value = page_pass.given_by("p", "t" * 40, secure=True).partition(";")[0].removeprefix("p=")
    assert page_pass.holds(value, "t" * 40)
    assert not page_pass.holds(value, "u" * 40)
    monkeypatch.setattr(page_pass, "_LASTS", -1)
    assert not page_pass.holds(page_pass.given_by("p", "t" * 40, secure=True).partition(";")[0][2:], "t" * 40)


@pytest.mark.parametrize("text", [None, "", "no PEM"])
def test_a_certificate_that_is_none_is_told_in_a_sentence(tmp_path: Path, text: str | None) -> None:
    for name in ("c", "k"):
        if text is not None:
            (tmp_path / name).write_text(text, encoding="ascii")
    with pytest.raises(ConfigError, match="expected PEM files that belong together, the key without a password: "):
        access_to(config(tmp_path, certificate=tmp_path / "c", key=tmp_path / "k"), "0.0.0.0", 8080)


