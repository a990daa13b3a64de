"""Attacks in headless Chromium: pages of another origin, and one that has its own name lead to the service."""

import http.server
import threading
from collections.abc import Iterator

import httpx
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from tests.bench.api.test_attacks import DRIVE, log, state
from tests.browser.chromium import chromium
from tests.browser.test_page import pytestmark, run
from tests.conftest import RunningBench
from tests.support.served_drive import until

__all__ = ["pytestmark"]

JSON_AS_A_FORM = '{"holds": [{"speed_rpm": 1200, "i_d": 0, "i_q": 3, "seconds": 5}], "x": "'  # a name; the rest follows
PAGE = f"""<!doctype html><title>evil</title>
<form id="form" method="post" enctype="text/plain" action="BENCH{DRIVE}/experiments" target="_self">
<input name='{JSON_AS_A_FORM}' value='"}}'></form>
<iframe id="frame" src="BENCH/"></iframe>"""
FETCH = """
const [url, method, mode, media, body, done] = arguments;
fetch(url, {method, mode, headers: media ? {"Content-Type": media} : {}, body: body || undefined})
  .then((answer) => done(`${answer.type} ${answer.status}`), (error) => done(`refused: ${error.name}`));
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """One in which rebound.example is this machine, as a name server of an attacker would have it."""
    profile = tmp_path_factory.mktemp("chromium")
    with chromium(profile, "host-resolver-rules=MAP *.example 127.0.0.1") as chrome:
        yield chrome


@pytest.fixture(scope="module")
def evil(running_bench: RunningBench) -> Iterator[str]:
    """The address of a page of another origin."""

    class Handler(http.server.BaseHTTPRequestHandler):
        timeout = 0.5  # s; Chromium connects ahead of what it may ask for

        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(PAGE.replace("BENCH", running_bench.url).encode())

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            del format, args

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://evil.example:{server.server_address[1]}/"
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture(autouse=True)
def nothing_changes(running_bench: RunningBench) -> Iterator[None]:
    before = state(running_bench.url)
    yield
    assert state(running_bench.url) == before
    assert httpx.get(f"{running_bench.url}{DRIVE}/experiments/latest").status_code == 404


def refusals() -> list[tuple[str, int]]:
    return [(told["method"], told["status"]) for told in log("refused")]


def test_a_form_of_another_page_starts_no_experiment(browser: Chrome, evil: str) -> None:
    logged = len(refusals())
    browser.get(evil)
    run(browser, "document.getElementById('form').submit()")
    until(lambda: ("POST", 403) in refusals()[logged:], "the refusal to be logged")
    until(lambda: "expected no Origin" in browser.find_element(By.TAG_NAME, "body").text, "the refusal to be shown")


@pytest.mark.parametrize(
    ("method", "mode", "media", "body"),
    [("POST", "no-cors", "text/plain", '{"holds": [{"speed_rpm": 1200, "i_d": 0, "i_q": 3, "seconds": 5}]}'),
     ("POST", "cors", "text/plain", '{"holds": [{"speed_rpm": 1200, "i_d": 0, "i_q": 3, "seconds": 5}]}'),
     ("POST", "cors", "application/json", '{"holds": [{"speed_rpm": 1200, "i_d": 0, "i_q": 3, "seconds": 5}]}'),
     ("POST", "no-cors", "", "")],
)  # fmt: skip
def test_a_script_of_another_page_starts_no_experiment(
    browser: Chrome, evil: str, running_bench: RunningBench, method: str, mode: str, media: str, body: str
) -> None:
    logged = len(refusals())
    browser.get(evil)
    url = f"{running_bench.url}{DRIVE}/experiments"
    said = browser.execute_async_script(FETCH, url, method, mode, media, body)  # pyright: ignore[reportUnknownMemberType]
    assert said in ("opaque 0", "refused: TypeError")
    preflight = (mode, media) == ("cors", "application/json")
    until(lambda: ("OPTIONS" if preflight else method, 403) in refusals()[logged:], "the refusal to be logged")


@pytest.mark.parametrize(("method", "path"), [("PUT", "signals"), ("PUT", "window"), ("DELETE", "captures/latest")])
def test_a_script_of_another_page_is_not_even_allowed_to_ask_for_more(
    browser: Chrome, evil: str, running_bench: RunningBench, method: str, path: str
) -> None:
    logged = len(refusals())
    browser.get(evil)
    said = browser.execute_async_script(  # pyright: ignore[reportUnknownMemberType]
        FETCH, f"{running_bench.url}{DRIVE}/{path}", method, "cors", "application/json", "{}"
    )
    assert said == "refused: TypeError"
    until(lambda: ("OPTIONS", 403) in refusals()[logged:], "the refusal to be logged")


def test_the_page_is_shown_in_no_frame_of_another(browser: Chrome, evil: str) -> None:
    logged = len(refusals())
    browser.get(evil)
    until(lambda: ("GET", 403) in refusals()[logged:], "the refusal to be logged")
    browser.switch_to.frame("frame")
    assert browser.find_elements(By.ID, "link-state") == []
    assert run(browser, "return document.URL").startswith("chrome-error://")
    browser.switch_to.default_content()


def test_a_name_that_is_made_to_lead_here_reads_and_writes_nothing(
    browser: Chrome, running_bench: RunningBench
) -> None:
    logged = len(refusals())
    root = f"http://rebound.example:{httpx.URL(running_bench.url).port}"
    browser.get(f"{root}/")
    assert "expected this service's own Host" in browser.find_element(By.TAG_NAME, "body").text
    for method, path, body in (("GET", "", ""), ("PUT", "/signals", '{"i_q_ref": 5.0}'), ("POST", "/stop", "{}")):
        said = browser.execute_async_script(  # pyright: ignore[reportUnknownMemberType]
            FETCH, f"{root}{DRIVE}{path}", method, "cors", "application/json" if body else "", body
        )
        assert said == "basic 421"
    until(lambda: {("PUT", 421), ("POST", 421)} <= set(refusals()[logged:]), "the refusals to be logged")


def test_the_services_own_page_may_write(browser: Chrome, running_bench: RunningBench) -> None:
    browser.get(running_bench.url)
    length = httpx.get(f"{running_bench.url}{DRIVE}/window").json()["length"]
    said = browser.execute_async_script(  # pyright: ignore[reportUnknownMemberType]
        FETCH, f"{DRIVE}/window", "PUT", "cors", "application/json", f'{{"length": {length}}}'
    )
    assert said == "basic 200"
