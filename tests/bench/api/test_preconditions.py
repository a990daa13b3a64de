"""ETags: a change of what somebody else has changed meanwhile is refused, and what is known is not sent again."""

import threading
from collections.abc import Iterator

import httpx
import pytest

from bench.api.exchange.problems import PreconditionError
from bench.api.guard.preconditions import check_match, is_known
from tests.bench.api.test_api import WINDOW, problem
from tests.conftest import JSON, RunningBench
from tests.support.served_drive import until

OF_DRIVE = "/api/drives/emulated/recordings"
live = pytest.mark.live


@pytest.fixture
def client(running_bench: RunningBench) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=running_bench.url, headers=JSON) as one:
        until(lambda: one.get("/api/drives/emulated").json()["link"]["state"] == "streaming", "the stream")
        yield one


@pytest.mark.parametrize(("said", "known"), [
    (None, False), ("", False), ("*", True), ('"a"', True), ('W/"a"', True), ('"b", "a"', True), ('"b"', False),
    ("a", False), ('"a', False), ('"A"', False),
])  # fmt: skip
def test_any_of_several_tags_is_known_weak_ones_too(said: str | None, known: bool) -> None:
    assert is_known('"a"', said) == known


@pytest.mark.parametrize("said", ["", '"b"', 'W/"a"', "a", '"a', "\xff"])
def test_a_change_needs_the_very_tag(said: str) -> None:
    check_match('"a"', None)
    check_match('"a"', "*")
    check_match('"a"', '"b", "a"')
    with pytest.raises(PreconditionError, match=r'^expected If-Match: "a", which is the state now, got '):
        check_match('"a"', said)


@live
def test_settings_that_somebody_else_has_changed_are_not_overwritten(client: httpx.Client) -> None:
    seen = client.get(WINDOW)
    tag = seen.headers["etag"]
    same = client.get(WINDOW, headers={"If-None-Match": f'"other", {tag}'})
    assert (same.status_code, same.headers["etag"], same.content) == (304, tag, b"")
    mine = client.put(WINDOW, json={"length": 777}, headers={"If-Match": tag})
    assert mine.status_code == 200
    assert mine.headers["etag"] != tag
    refused = client.put(WINDOW, json={"length": 888}, headers={"If-Match": tag})
    said = f"expected If-Match: {mine.headers['etag']}, which is the state now, got '{tag}'; nothing was changed"
    assert problem(refused, 412) == said
    assert "window length" in problem(client.put(WINDOW, json={"length": 1}, headers={"If-Match": tag}), 422)
    assert client.get(WINDOW, headers={"If-None-Match": tag}).json()["length"] == 777
    back = client.put(WINDOW, json={"length": seen.json()["length"]})  # without the header, as ever
    assert back.headers["etag"] == tag == client.get(WINDOW).headers["etag"]


@live
def test_of_several_who_change_the_same_state_at_once_one_does(client: httpx.Client) -> None:
    seen = client.get(WINDOW)
    answers = list[int]()

    def change(length: int) -> None:
        header = {"If-Match": seen.headers["etag"]}
        answers.append(client.put(WINDOW, json={"length": length}, headers=header).status_code)

    threads = [threading.Thread(target=change, args=(500 + k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answers) == [200, *5 * [412]]
    client.put(WINDOW, json={"length": seen.json()["length"]}).raise_for_status()


@live
def test_title_and_note_have_a_tag_that_rows_and_marks_leave(client: httpx.Client) -> None:
    address = client.post(OF_DRIVE, json={"title": "warm"}).headers["location"]
    tag = client.get(address).headers["etag"]
    until(lambda: client.get(address).json()["rows"] > 100, "rows")
    client.post(f"{address}/marks", json={"text": "load on"}).raise_for_status()
    changed = client.patch(address, json={"note": "after lunch"}, headers={"If-Match": tag})
    assert changed.json()["note"] == "after lunch"
    assert problem(client.patch(address, json={"note": ""}, headers={"If-Match": tag}), 412).endswith("was changed")
    one = client.get(address)
    assert (one.headers["etag"], one.json()["note"]) == (changed.headers["etag"], "after lunch")
    client.delete(address).raise_for_status()
