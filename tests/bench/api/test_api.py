"""The REST interface of a running bench: every route, every refusal, the live stream, the page's files."""

import json
import threading
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.conftest import JSON, RunningBench
from tests.support.served_drive import until

pytestmark = pytest.mark.live

KEYS = "length, periods_per_row, estimated, held, method, longest, forgetting_factor or ekf"
DRIVE = "/api/drives/emulated"
WINDOW = f"{DRIVE}/window"
ROUTES = (
    "", "/estimates", "/window", "/stream", "/signals", "/signals/recent", "/captures", "/captures/latest",
    "/captures/latest/file",
)
PROBLEM = "application/problem+json"


class Patient(httpx.HTTPTransport):
    """Asks again when the service says so: these tests are more requests than it takes for longer."""

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        while (response := super().handle_request(request)).status_code == 503 and "Retry-After" in response.headers:
            response.close()
            time.sleep(float(response.headers["Retry-After"]))
        return response


@pytest.fixture(scope="module")
def connection(running_bench: RunningBench) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=running_bench.url, headers=JSON, transport=Patient()) as client:
        yield client


@pytest.fixture
def client(connection: httpx.Client) -> Iterator[httpx.Client]:
    """A client of a bench whose drive streams; the window is put back afterwards."""
    until(lambda: connection.get(f"{DRIVE}/estimates").json()["status"] == "ok", "estimates")
    before = connection.get(WINDOW).json()
    yield connection
    connection.put(WINDOW, json={key: before[key] for key in before if key != "limits"}).raise_for_status()


def problem(response: httpx.Response, status: int) -> str:
    """The sentence of a problem document."""
    content = response.json()
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == PROBLEM
    assert set(content) == {"type", "title", "status", "detail"}
    assert content["status"] == status
    assert "\n" not in content["detail"]
    assert len(content["detail"]) < 300
    return content["detail"]


def test_drives_are_listed_and_told_one_by_one(client: httpx.Client) -> None:
    (listed,) = client.get("/api/drives").json()["drives"]
    told = client.get(DRIVE).json()
    for drive in (listed, told):
        assert set(drive) == {
            "name", "url", "identity", "link", "stream", "latest", "limits", "writer", "control", "cut_flash",
        }
        assert drive["name"] == "emulated"
        assert drive["url"].startswith("canopen://socketcand/127.0.0.1:")
        assert drive["identity"]["T_s"] == pytest.approx(1e-4)
        assert drive["link"]["state"] == "streaming"
        assert set(drive["link"]) == {"state", "since", "reconnects", "last_error"}
        assert drive["stream"]["nominal_rate_hz"] == pytest.approx(1000.0)
        assert drive["stream"]["gaps"] == drive["stream"]["rows_lost"] == 0
        assert drive["stream"]["age_s"] < 1.0
        assert drive["stream"]["t_drive_s"] * 1000.0 >= drive["stream"]["rows"]
    assert told["stream"]["rows"] >= listed["stream"]["rows"] > 0


def test_estimates_carry_all_that_says_how_far_to_trust_them(client: httpx.Client) -> None:
    told = client.get(f"{DRIVE}/estimates").json()
    assert list(told["estimates"]) == ["R_s", "L_d", "L_q", "psi_f"]
    for estimate in told["estimates"].values():
        assert set(estimate) == {"value", "std", "unit", "status", "since", "reason", "window"}
        assert (estimate["status"], estimate["window"]) == ("ok", None)
        assert 0.0 < estimate["std"] < 0.01 * estimate["value"]
    assert [estimate["unit"] for estimate in told["estimates"].values()] == ["ohm", "H", "H", "Vs"]
    assert (told["drive"], told["status"], told["samples"]) == ("emulated", "ok", told["window"]["length"])
    assert (told["method"], told["combinations"]) == ("wls", [])
    assert told["gaps"] == told["rows_dropped"] == 0
    assert 0 <= told["left_out"] < 2000  # rows of the time before the drive was started, whose voltage is not known
    assert told["age_s"] < 1.0
    assert told["condition"] > 1.0
    assert told["residual_rms_V"] > 0.0


def test_the_window_says_what_its_settings_may_be(client: httpx.Client) -> None:
    client.put(WINDOW, json={"length": 400, "periods_per_row": 5}).raise_for_status()
    assert client.get(WINDOW).json()["limits"] == {
        "length": {"minimum": 20, "maximum": 1_000_000}, "longest": {"minimum": 20, "maximum": 1_000_000},
        "periods_per_row": {"minimum": 1, "maximum": 100}, "forgetting_factor": {"minimum": 0.99, "maximum": 1.0},
    }


def test_a_put_takes_effect_at_once_and_keeps_the_samples(client: httpx.Client) -> None:
    until(lambda: client.get(DRIVE).json()["stream"]["rows"] > 2100, "rows")
    for change, samples in (({"length": 300}, 300), ({"length": 2000}, 2000), ({"periods_per_row": 4}, 2000)):
        answer = client.put(WINDOW, json=change)
        assert answer.status_code == 200
        assert answer.json() == client.get(WINDOW).json()
        told = client.get(f"{DRIVE}/estimates").json()
        assert (told["samples"], told["status"], told["gaps"]) == (samples, "ok", 0)
        assert told["window"] == answer.json()
    answer = client.put(WINDOW, json={"estimated": ["R_s", "L_q"], "held": {"psi_f": 0.119}}).json()
    assert answer["estimated"] == ["R_s", "L_q"]
    estimates = client.get(f"{DRIVE}/estimates").json()["estimates"]
    assert [estimate["status"] for estimate in estimates.values()] == ["ok", "held", "ok", "held"]
    assert estimates["psi_f"]["value"] == 0.119
    assert estimates["psi_f"]["std"] is None


TRUTH = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
OFF = {"R_s": 0.9, "L_d": 4.4e-3, "L_q": 6.0e-3}  # start values


@pytest.mark.parametrize(
    ("change", "within", "samples"),
    [
        ({"method": "rls"}, 0.01, 1000),
        ({"method": "rls", "forgetting_factor": 0.999, "periods_per_row": 2}, 0.01, 1000),
        ({"method": "ekf", "held": OFF}, 0.02, 1000),
        ({"method": "ekf", "held": {"R_s": 0.9}, "estimated": ["R_s", "L_q"], "ekf": {"omega_e": 502.7}}, 0.02, 1000),
    ],
    ids=["rls", "rls that forgets", "ekf", "ekf of two"],
)
def test_each_method_tells_the_motor_with_its_intervals_and_going_back_loses_no_sample(
    client: httpx.Client, change: dict[str, Any], within: float, samples: int
) -> None:
    until(lambda: client.get(DRIVE).json()["stream"]["rows"] > 2100, "rows")
    settings = client.put(WINDOW, json=change).raise_for_status().json()
    assert {key: settings[key] for key in change if key not in ("held", "ekf")} == {
        key: change[key] for key in change if key not in ("held", "ekf")
    }

    def told() -> dict[str, Any]:
        return client.get(f"{DRIVE}/estimates").json()

    assert told()["samples"] < 1000  # it began with the next sample
    until(lambda: told()["samples"] > samples, "enough rows")
    content = told()
    assert content["method"] == change["method"]
    filter_holds = change["method"] == "ekf"
    for name, estimate in content["estimates"].items():
        if name not in settings["estimated"] or (filter_holds and name == "psi_f"):
            assert (estimate["status"], estimate["value"]) == ("held", settings["held"][name])
            continue
        assert estimate["status"] == "ok"
        assert estimate["value"] == pytest.approx(TRUTH[name], rel=within)
        assert 0.0 < estimate["std"] < within * TRUTH[name]
        assert estimate["window"] is None
    if filter_holds and "psi_f" in settings["estimated"]:
        assert content["estimates"]["psi_f"]["reason"] == "the Kalman filter holds it at the given value"
    client.put(WINDOW, json={"method": "wls", "length": 2000}).raise_for_status()
    assert (told()["samples"], told()["gaps"]) == (2000, 0)
    until(lambda: told()["status"] == "ok", "rows that are not old")  # where this machine was held up meanwhile


def test_a_window_chosen_by_the_data_says_how_long_it_is_for_each_parameter(client: httpx.Client) -> None:
    until(lambda: client.get(DRIVE).json()["stream"]["rows"] > 2100, "rows")
    settings = client.put(WINDOW, json={"length": "auto", "longest": 2000}).raise_for_status().json()
    assert (settings["length"], settings["longest"]) == ("auto", 2000)
    told = client.get(f"{DRIVE}/estimates").json()
    assert (told["samples"], told["status"]) == (2000, "ok")
    for name, estimate in told["estimates"].items():
        assert estimate["status"] == "ok"
        assert estimate["value"] == pytest.approx(TRUTH[name], rel=0.01)
        assert 16 <= estimate["window"] <= 2000
    assert client.put(WINDOW, json={"longest": 500}).json()["longest"] == 500
    assert client.get(f"{DRIVE}/estimates").json()["samples"] == 500


@pytest.mark.parametrize("method", ["rls", "ekf"])
def test_a_change_that_is_refused_leaves_the_method_running(client: httpx.Client, method: str) -> None:
    before = client.put(WINDOW, json={"method": method}).json()
    until(lambda: client.get(f"{DRIVE}/estimates").json()["samples"] > 200, "rows")
    for body in ({"method": "kalman"}, {"forgetting_factor": 2}, {"ekf": {"doubt": 9}, "method": "wls"}, {"longest": 1},
                 {"length": 2}, {"method": "ekf", "estimated": ["psi_f"]}):
        problem(client.put(WINDOW, json=body), 422)
    assert client.get(WINDOW).json() == before
    assert client.get(f"{DRIVE}/estimates").json()["samples"] > 200  # it has not begun anew


@pytest.mark.parametrize("said", [None, "", "text/plain", "application/x-www-form-urlencoded", "application/jsonp"])
@pytest.mark.parametrize(
    ("method", "path"), [("PUT", WINDOW), ("PUT", f"{DRIVE}/signals"), ("POST", f"{DRIVE}/captures/latest/trigger")]
)
def test_a_write_that_does_not_say_that_it_is_json_is_415(
    running_bench: RunningBench, method: str, path: str, said: str | None
) -> None:
    before = httpx.get(f"{running_bench.url}{WINDOW}").json()
    headers = {} if said is None else {"Content-Type": said}
    answer = httpx.request(method, f"{running_bench.url}{path}", content=b'{"length": 777}', headers=headers)
    sentence = problem(answer, 415)
    expected = "the header Content-Type: application/json, as of every PUT and POST but those that stop"
    assert sentence.startswith(f"expected {expected}, got ")
    assert httpx.get(f"{running_bench.url}{WINDOW}").json() == before


def test_what_json_is_said_with_does_not_matter(client: httpx.Client) -> None:
    headers = {"Content-Type": "Application/JSON; charset=utf-8"}
    assert client.put(WINDOW, content=b'{"length": 777}', headers=headers).json()["length"] == 777


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("name", ["spindle", "EMULATED", "%2e%2e", "a b", "x" * 5000])
def test_an_unknown_drive_is_404_on_every_route(client: httpx.Client, route: str, name: str) -> None:
    assert "no drive " in problem(client.get(f"/api/drives/{name}{route}"), 404)


@pytest.mark.parametrize("body", [b'{"length": 500}', b"{", b""])
@pytest.mark.parametrize(("method", "route"), [("PUT", "window"), ("POST", "captures")])
def test_an_unknown_drive_is_404_whatever_the_body(
    client: httpx.Client, method: str, route: str, body: bytes
) -> None:
    assert problem(client.request(method, f"/api/drives/spindle/{route}", content=body), 404) == (
        "no drive 'spindle'; the drives are emulated"
    )


@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "/api/drives"), ("DELETE", WINDOW), ("PATCH", WINDOW), ("PUT", DRIVE), ("POST", f"{DRIVE}/stream"),
     ("PUT", "/api/health"), ("POST", "/docs")],
)
def test_another_method_is_405(client: httpx.Client, method: str, path: str) -> None:
    answer = client.request(method, path)
    assert problem(answer, 405) == f"{path} does not take {method}; see /docs"
    assert answer.headers["Allow"]


def test_nothing_is_404(client: httpx.Client) -> None:
    assert problem(client.get("/api/nothing"), 404) == "nothing at /api/nothing; see /docs"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"", "the body is not JSON"),
        (b"{", "the body is not JSON"),
        (b"\xff\xfe", "the body is not JSON"),
        (b'{"length": 1' + b"0" * 5000 + b"}", "the body is not JSON"),
        (b"[" * 60_000, "the body is not JSON"),
        (b"[]", 'expected a JSON object such as {"length": 2000}, got []'),
        (b"null", 'expected a JSON object such as {"length": 2000}, got null'),
        (b"5", 'expected a JSON object such as {"length": 2000}, got 5'),
        (b'{"junk": 1}', f"expected {KEYS}, got 'junk'"),
        (b'{"length": 3}', "window length must be 4 "),
        (b'{"length": 2000000}', "window length must be 4 "),
        (b'{"length": 1' + b"0" * 400 + b"}", "length: expected a whole number of at most 18 digits, got 1000"),
        (b'{"length": NaN}', 'length: expected a whole number or "auto", got nan'),
        (b'{"length": "500"}', 'length: expected a whole number or "auto", got \'500\''),
        (b'{"length": null}', 'length: expected a whole number or "auto", got null'),
        (b'{"length": {"a": [[[[]]]]}}', 'length: expected a whole number or "auto", got {\'a\': [[[[]]]]}'),
        (b'{"periods_per_row": 0}', "periods per row must be 1 to 1000, got 0"),
        (b'{"estimated": []}', "estimated: expected at least one of R_s, L_d, L_q, psi_f, got none"),
        (b'{"estimated": ["J"]}', "estimated: expected R_s, L_d, L_q, psi_f, got 'J'"),
        (b'{"estimated": ' + b"[" * 400 + b"]" * 400 + b"}", "estimated: expected R_s, L_d, L_q, psi_f, got [[[["),
        (b'{"held": {"R_s": 0}}', "held R_s: expected a number of ohm above zero, got 0"),
        (b'{"held": {"R_s": -1}}', "held R_s: expected a number of ohm above zero, got -1"),
        (b'{"held": {"R_s": NaN}}', "held R_s: expected a number of ohm above zero, got nan"),
        (b'{"held": {"R_s": 1e999}}', "held R_s: expected a number of ohm above zero, got inf"),
        (b'{"held": {"R_s": 1' + b"0" * 400 + b"}}", "held R_s: expected a number of ohm above zero, got 1000"),
        (b'{"held": [0.9]}', "held: expected values of R_s, L_d, L_q, psi_f, got [0.9]"),
        (b'{"' + b"x" * 9000 + b'": 1}', f"expected {KEYS}, got 'xxxx"),
    ],
    ids=lambda value: repr(value)[:40],
)
def test_a_body_that_cannot_be_is_422_and_changes_nothing(client: httpx.Client, body: bytes, said: str) -> None:
    before = client.get(WINDOW).json()
    assert problem(client.put(WINDOW, content=body, headers={"Content-Type": "application/json"}), 422).startswith(said)
    assert client.get(WINDOW).json() == before
    assert client.get("/api/health").json()["status"] == "ok"


def test_a_body_without_end_is_refused_before_it_is_read(client: httpx.Client) -> None:
    endless = (b" " * 4096 for _ in range(1 << 14))
    assert problem(client.put(WINDOW, content=endless), 413) == "expected a body of at most 65536 bytes, got more"


def events(url: str, count: int) -> tuple[list[dict[str, Any]], float]:
    """The first events of a live stream, and how long they took after the first."""
    snapshots = list[dict[str, Any]]()
    began = 0.0
    with httpx.Client(base_url=url) as client, client.stream("GET", f"{DRIVE}/stream") as response:
        assert response.status_code == 200
        assert response.headers["content-type"].startswith("text/event-stream")
        for line in response.iter_lines():
            if line.startswith("event:"):
                assert line == "event: snapshot"
            if line.startswith("data:"):
                began = began or time.monotonic()
                snapshots.append(json.loads(line.removeprefix("data:")))
            if len(snapshots) == count:
                break
    return snapshots, time.monotonic() - began


def test_two_clients_get_ten_snapshots_a_second_each(client: httpx.Client, running_bench: RunningBench) -> None:
    results = list[tuple[list[dict[str, Any]], float]]()
    threads = [threading.Thread(target=lambda: results.append(events(running_bench.url, 16))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(15.0)
    assert len(results) == 2
    for snapshots, took in results:
        assert 1.2 < took < 3.0  # 15 periods of 0.1 s
        rows = [snapshot["drive"]["stream"]["rows"] for snapshot in snapshots]
        assert rows == sorted(set(rows))
        times = [snapshot["estimates"]["t_drive_s"] for snapshot in snapshots]
        assert times == sorted(times)  # estimates wait where rows come faster than they are taken
        assert times[-1] - times[0] > 0.8
        assert set(snapshots[0]["drive"]) == set(client.get(DRIVE).json())
        assert set(snapshots[0]["estimates"]) == set(client.get(f"{DRIVE}/estimates").json())


def test_the_latest_values_are_what_the_drive_does(client: httpx.Client) -> None:
    told = client.get(DRIVE).json()
    assert told["latest"]["speed_rpm"] == pytest.approx(1200.0, rel=1e-3)
    assert told["latest"]["omega_e"] == pytest.approx(502.65, rel=1e-3)
    assert told["latest"]["u_dc"] == pytest.approx(310.0, rel=0.01)
    assert abs(told["latest"]["i_q"] - 2.0) < 3.5
    assert told["limits"] == {"i_max": 6.0, "speed_max_rpm": 2920.0, "n_p": 4}


def test_signals_of_the_last_seconds_go_on_where_they_were_asked_for(client: httpx.Client) -> None:
    first = client.get(f"{DRIVE}/signals/recent").json()
    i_q = first["signals"]["i_q"]
    assert first["bin_s"] == 0.02
    assert i_q["unit"] == "A"
    assert len(i_q["low"]) == len(i_q["high"]) > 10
    assert all(low <= high for low, high in zip(i_q["low"], i_q["high"], strict=True) if low is not None)
    time.sleep(0.2)
    more = client.get(f"{DRIVE}/signals/recent", params={"since": first["last"]}).json()
    assert more["first"] == first["last"]
    assert 5 <= len(more["signals"]["u_d"]["low"]) < 200
    assert "since" in problem(client.get(f"{DRIVE}/signals/recent", params={"since": "yesterday"}), 422)


def rows_of(url: str, wanted: int, last: str | None = None) -> list[dict[str, Any]]:
    """The first events of rows, each with its id."""
    found: list[dict[str, Any]] = []
    headers = {} if last is None else {"Last-Event-ID": last}
    with httpx.Client(base_url=url) as client, client.stream(
        "GET", f"{DRIVE}/stream", params={"rows": True}, headers=headers
    ) as response:
        event: dict[str, str] = {}
        for line in response.iter_lines():
            key, _, value = line.partition(": ")
            event |= {key: value}
            if not line and event.get("event") == "rows":
                found.append({"id": event["id"]} | json.loads(event["data"]))
            if len(found) == wanted:
                break
            event = event if line else {}
    return found


def test_every_event_has_an_id_from_which_rows_go_on(client: httpx.Client, running_bench: RunningBench) -> None:
    for rows in (False, True):
        lines = list[str]()
        with client.stream("GET", f"{DRIVE}/stream", params={"rows": rows}) as response:
            for line in response.iter_lines():
                lines.append(line)
                if lines.count("") == 6:
                    break
        ids = [line.removeprefix("id: ") for line in lines if line.startswith("id: ")]
        assert len(ids) == 6
        assert rows_of(running_bench.url, 1, ids[-1])[0]["first"] == ids[-1]


def test_rows_in_the_stream_miss_no_bin_also_over_a_break(client: httpx.Client, running_bench: RunningBench) -> None:
    before = rows_of(running_bench.url, 3)
    time.sleep(0.5)
    after = rows_of(running_bench.url, 2, before[-1]["id"])
    assert len(before[0]["signals"]["i_d"]["low"]) > 10  # all that is kept
    for earlier, later in zip((*before, after[0]), (*before[1:], *after), strict=False):
        assert later["first"] == earlier["last"] == earlier["id"]
    assert len(after[0]["signals"]["i_d"]["low"]) >= 20  # of the half second, too


def test_health_tells_every_thread_and_link(client: httpx.Client) -> None:
    health = client.get("/api/health").json()
    assert health["status"] == "ok"
    assert health["uptime_s"] > 0.0
    threads = ["estimation", "history", "pump emulated", "control emulated"]
    assert [thread["name"] for thread in health["threads"]] == threads
    assert all(thread["alive"] and thread["failure"] is None for thread in health["threads"])
    assert health["links"]["emulated"]["state"] == "streaming"


@pytest.mark.parametrize(
    ("path", "kind"),
    [("/", "text/html"), ("/web/main.js", "text/javascript"), ("/web/style.css", "text/css"),
     ("/favicon.ico", "image/svg+xml"), ("/assets/plotly.min.js", "text/javascript"), ("/docs", "text/html"),
     ("/assets/swagger-ui-bundle.js", "text/javascript"), ("/assets/swagger-ui.css", "text/css")],
)
def test_files_of_the_page_are_served_to_get_and_head(client: httpx.Client, path: str, kind: str) -> None:
    got, head = client.get(path), client.head(path)
    assert got.status_code == head.status_code == 200
    assert got.headers["content-type"].startswith(kind)
    assert got.headers["content-length"] == head.headers["content-length"] == str(len(got.content))
    assert head.content == b""


@pytest.mark.parametrize(
    "path",
    ["/web/../pyproject.toml", "/web/%2e%2e/pyproject.toml", "/web/..%2fpyproject.toml",
     "/web/%2e%2e%2f%2e%2e/etc/passwd", "/web//etc/passwd", "/web/..%5cpyproject.toml", "/web/%00", "/web/absent.js",
     "/web/"],
)
def test_nothing_outside_the_pages_folder_is_served(client: httpx.Client, path: str) -> None:
    as_it_is = {"target": path.encode()}  # dots and all
    assert problem(client.send(client.build_request("GET", "/", extensions=as_it_is)), 404)


def test_small_answers_come_within_milliseconds(client: httpx.Client) -> None:
    def took() -> float:
        began = time.monotonic()
        client.put(WINDOW, json={"length": 500}).raise_for_status()
        return time.monotonic() - began

    assert sorted(took() for _ in range(15))[7] < 0.03


@pytest.mark.parametrize(("path", "known"), [
    ("/api/drives", "none"), ("/api/drives/emulated/stream", "rows"), ("/api/drives/emulated/signals", "names"),
    ("/api/recordings", "drive, kind, text, before, limit"), ("/api/health", "none"),
])
def test_a_query_key_that_a_route_does_not_take_is_refused(client: httpx.Client, path: str, known: str) -> None:
    said = problem(client.get(path, params={"colour": "red"}), 422)
    assert said == f"unknown query key 'colour', expected {known}"


def test_the_page_itself_may_be_asked_for_with_any_query(client: httpx.Client) -> None:
    assert client.get("/", params={"colour": "red"}).status_code == 200
