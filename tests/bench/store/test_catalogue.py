"""The catalogue: what a bench remembers, in SQLite and in a PostgreSQL, over restarts and beside other benches."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from sqlalchemy import Engine, insert, inspect, text
from sqlalchemy.engine import make_url

from bench.cli.commands.files.verify import check_all
from bench.errors import ConfigError, UnavailableError
from bench.recordings.capture_file import write_columns
from bench.store.catalogue import migrations
from bench.store.catalogue.chronicle import Chronicle, Happening, ParameterSet
from bench.store.catalogue.database import check_address, opened
from bench.store.catalogue.ended import EndedJob, EndedJobs
from bench.store.catalogue.found import Row
from bench.store.catalogue.keeper import Keeper
from bench.store.catalogue.memory import MOST, Memory, Point, point_of
from bench.store.catalogue.tables import METADATA, POINTS
from bench.store.diagnoses import Diagnoses
from bench.store.shelf import Shelf
from tests.bench.store.test_diagnoses import HEADING as DIAGNOSED
from tests.conftest import free_port
from tests.support.databases import postgresql
from tests.support.relay import relayed
from tests.support.served_drive import until

VERSIONS = Path(migrations.__file__).with_name("versions")
NOW = int(time.time()) // 3600 * 3600  # s
NAMES = ("R_s", "L_d", "L_q", "psi_f")


@pytest.fixture(params=["sqlite", "postgresql"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    if request.param == "sqlite":
        yield str(tmp_path / "catalogue.sqlite")
        return
    with postgresql(tmp_path) as one:
        yield one


@pytest.fixture
def engine(address: str) -> Iterator[Engine]:
    one = opened(address)
    yield one
    one.dispose()


def seconds(drive: str, begin: int, count: int, value: Callable[[int], float] = lambda _: 1.0) -> list[Point]:
    return [Point(drive, name, begin + k, value(k), 0.1, "ok") for k in range(count) for name in NAMES]


def test_it_has_the_form_that_the_tables_tell(engine: Engine) -> None:
    there = inspect(engine)
    for table in METADATA.tables.values():
        columns = {one["name"]: one for one in there.get_columns(table.name)}
        assert set(columns) == set(table.columns.keys())
        for column in table.columns:
            assert columns[column.name]["nullable"] == column.nullable, column
        key = there.get_pk_constraint(table.name)["constrained_columns"]
        assert key == [column.name for column in table.primary_key]
        indexed = {tuple(one["column_names"]) for one in there.get_indexes(table.name)}
        assert indexed >= {tuple(index.columns.keys()) for index in table.indexes}
    newest = max(path.name[1:5] for path in VERSIONS.glob("v*.py"))
    with engine.connect() as connection:
        assert connection.execute(text("SELECT version_num FROM alembic_version")).scalar() == newest


CAPTURE = EndedJob(
    "capture", "spindle-20260131-120000-000", "spindle", datetime(2026, 1, 31, 12, 0, 0, 1, UTC), "failed", 0.25, 250,
    "the drive was reset \0", ("it was off",), None, {"length": 1000},
)  # fmt: skip


def test_what_files_say_comes_back_each_folder_its_own_until_it_is_rebuilt(engine: Engine, tmp_path: Path) -> None:
    write_columns(tmp_path / "a.parquet", {"t": np.array([0.0, 1e-4])}, {"capture": "a", "drive": "spindle \0"})
    write_columns(tmp_path / "b.parquet", {"t": np.array([0.0])}, {})
    memory, shelf, kept = Memory(engine, "here"), Shelf(tmp_path), Diagnoses(tmp_path)
    kept.keep(DIAGNOSED, {"result.json": b"{}"})
    recordings, diagnoses = memory.recordings(tmp_path), memory.diagnoses(tmp_path)
    recordings.add(shelf.rows())
    recordings.add(shelf.rows())
    diagnoses.add(kept.rows())
    again, again_kept = Shelf(tmp_path, unread), Diagnoses(tmp_path, unread)
    again.recall(recordings.all())
    again_kept.recall(diagnoses.all())
    assert [replace(one, drive="") for one in again.all()] == [replace(one, drive="") for one in shelf.all()]
    assert again_kept.all() == kept.all()
    assert memory.recordings(tmp_path / "other").all() == []
    recordings.drop(["a"])
    assert [row["id"] for row in recordings.all()] == ["b"]
    shelf.delete("b")
    recordings.rebuild(shelf.rows())
    assert [row["id"] for row in recordings.all()] == ["a"]


def test_verify_has_the_catalogue_say_of_the_files_what_they_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, database = tmp_path / "captures", tmp_path / "catalogue.sqlite"
    write_columns(folder / "a.parquet", {"t": np.array([0.0, 1e-4])}, {})
    assert check_all(folder, str(database), as_json=False) == 0
    assert not database.exists()  # none is made for that
    memory = Memory(opened(str(database)), "here")
    memory.recordings(folder).add([dict(row, id="b") for row in Shelf(folder).rows()])
    assert check_all(folder, str(database), as_json=False) == 0
    assert [row["id"] for row in memory.recordings(folder).all()] == ["a"]
    memory.close()
    database.write_bytes(b"something else, and long enough to be looked at" * 100)
    assert check_all(folder, str(database), as_json=False) == 0
    told = capsys.readouterr()
    assert "a.parquet: whole" in told.out
    assert "the files were read, and the catalogue cannot be opened: file is not a database" in told.err


AT = datetime(2026, 1, 31, 12, 0, 0, 1, UTC)
WROTE = {
    "who": "127.0.0.1", "by": "loopback", "method": "POST", "path": "/api/drives/spindle/stop", "status": 200,
    "outcome": "done", "body": "\0", "before": {"state": "on"}, "after": None,
}  # fmt: skip


def told(chronicle: Chronicle) -> None:
    """One of each kind, a second apart."""
    chronicle.happened(Happening("spindle", AT, "link", "lost: x"))
    chronicle.wrote("spindle", AT + timedelta(seconds=1), WROTE)
    chronicle.took("spindle", "control", "me", AT + timedelta(seconds=2))
    chronicle.happened(Happening("spindle", AT + timedelta(seconds=3), "state", "operation enabled"))
    chronicle.happened(Happening("another", AT, "link", "there"))


def test_what_happened_to_a_drive_is_one_list_the_newest_first_in_pages(engine: Engine) -> None:
    chronicle = Chronicle(engine, "here")
    told(chronicle)
    every, total = chronicle.page("spindle", None, None, 10)
    assert [one.kind for one in every] == ["state", "lease", "write", "link"]
    assert (total, every[3]) == (4, Happening("spindle", AT, "link", "lost: x"))
    assert every[2].told == WROTE | {"body": "\\0"}
    assert every[2].sentence == "POST /api/drives/spindle/stop from 127.0.0.1: 200 done"
    assert every[1].told == {"part": "control", "holder": "me", "ended": None, "how": ""}
    first, total = chronicle.page("spindle", None, None, 3)
    assert (first, total) == (every[:3], 4)
    assert chronicle.page("spindle", None, first[-1].place, 3) == (every[3:], 1)
    assert chronicle.page("spindle", None, (first[-1].at, ""), 3) == (every[3:], 1)
    for kind, count in (("state", 1), ("write", 1), ("lease", 1), ("fault", 0)):
        assert chronicle.page("spindle", kind, None, 9)[1] == count
    assert Chronicle(engine, "there").page("spindle", None, None, 9) == ([], 0)


def test_what_is_of_one_moment_comes_once_each_however_it_is_paged(engine: Engine) -> None:
    chronicle = Chronicle(engine, "here")
    for k in range(2):
        chronicle.happened(Happening("spindle", AT, "state", f"{k}"))
        chronicle.wrote("spindle", AT, WROTE)
        chronicle.took("spindle", "control", f"{k}", AT)
        chronicle.add_snapshot(ParameterSet("spindle", AT, f"{k}", "", {"R_s": k}))
    every = chronicle.page("spindle", None, None, 9)[0]
    found, place = list[Happening](), None
    while page := chronicle.page("spindle", None, place, 1)[0]:
        found += page
        place = page[-1].place
    assert [one.id for one in found] == [one.id for one in every]
    assert len({one.id for one in found}) == 6
    (newest,), total = chronicle.snapshots("spindle", None, 1)
    (oldest,), left = chronicle.snapshots("spindle", newest.place, 9)
    assert (newest.why, total, oldest.why, left) == ("1", 2, "0", 1)


def test_a_lease_ends_as_it_is_told_or_with_its_service(engine: Engine) -> None:
    chronicle = Chronicle(engine, "here")
    for k in range(3):
        chronicle.took("spindle", "control", "me", AT + timedelta(seconds=2 * k))
        if k < 2:
            chronicle.gave_up("spindle", "control", "me", AT + timedelta(seconds=2 * k + 1), f"end {k}")
    chronicle.left(AT + timedelta(seconds=1))
    last, *others = (one.told for one in chronicle.page("spindle", "lease", None, 9)[0])
    assert [(one["ended"], one["how"]) for one in others] == [
        (AT + timedelta(seconds=3), "end 1"), (AT + timedelta(seconds=1), "end 0"),
    ]  # fmt: skip
    assert (last["ended"], last["how"]) == (None, "")
    chronicle.left(AT + timedelta(seconds=9))
    (last, *_), _ = chronicle.page("spindle", "lease", None, 1)
    assert (last.told["ended"], last.told["how"].partition(" without")[0]) == (None, "the service ended")


def test_parameters_come_back_and_of_each_kind_so_many_stay(engine: Engine) -> None:
    chronicle = Chronicle(engine, "here")
    for k in range(5):
        values = {"bandwidth": 1000.0 + k, "trigger_level": None}
        chronicle.add_snapshot(ParameterSet("spindle", AT + timedelta(seconds=k), "connected", "x, serial 1", values))
    (newest, _), total = chronicle.snapshots("spindle", None, 2)
    assert (newest.values, total) == ({"bandwidth": 1004.0, "trigger_level": None}, 5)
    assert chronicle.snapshots("spindle", (AT + timedelta(seconds=1), ""), 9)[1] == 1
    told(chronicle)
    chronicle.prune(2)
    assert chronicle.snapshots("spindle", None, 9)[1] == 2
    assert chronicle.page("spindle", None, None, 9)[1] == 3  # of two events one is another drive's


def unread(read: list[Row], gone: list[str]) -> None:
    raise AssertionError(f"{read} was read, {gone} has gone")


def test_what_has_ended_comes_back_the_newest_each_kind_and_each_bench_its_own(engine: Engine) -> None:
    one, other = EndedJobs(engine, "here"), EndedJobs(engine, "there")
    for k in range(5):
        one.add(replace(CAPTURE, id=f"c{k}", asked=CAPTURE.asked + timedelta(seconds=k)))
    one.add(replace(CAPTURE, kind="experiment", state="done", file="/x.parquet", remarks=(), reason=""))
    one.add(replace(CAPTURE, id="c3", asked=CAPTURE.asked + timedelta(seconds=3), state="cancelled", reason="x"))
    found = one.latest("capture", 2)
    assert [(job.id, job.state) for job in found] == [("c3", "cancelled"), ("c4", "failed")]
    assert found[1] == replace(
        CAPTURE, id="c4", asked=CAPTURE.asked + timedelta(seconds=4), reason="the drive was reset \\0"
    )
    (experiment,) = one.latest("experiment", 9)
    assert (experiment.file, experiment.remarks) == ("/x.parquet", ())
    assert other.latest("capture", 9) == []


def test_windows_are_remembered_until_the_configuration_changes(address: str) -> None:
    first, configured = opened(address), {"length": 1000}
    memory = Memory(first, "here:8080")
    assert memory.window("spindle", configured) is None
    memory.remember_window("spindle", configured, {"length": 2000})
    memory.remember_window("spindle", configured, {"length": 3000, "held": {"psi_f": 0.1}})
    first.dispose()
    second = opened(address)
    memory = Memory(second, "here:8080")
    assert memory.window("spindle", configured) == {"length": 3000, "held": {"psi_f": 0.1}}
    assert memory.window("spindle", {"length": 500}) is None
    assert memory.window("another", configured) is None
    assert Memory(second, "there:8080").window("spindle", configured) is None
    second.dispose()


def test_seconds_come_back_as_they_were_each_bench_its_own(engine: Engine) -> None:
    one, other = Memory(engine, "here"), Memory(engine, "there")
    one.add(seconds("spindle", NOW - 100, 100, float))
    other.add(seconds("spindle", NOW - 50, 10))
    one.add(seconds("spindle", NOW - 100, 3, lambda _: 99.0))  # what is there stays
    span, courses = one.history("spindle", NOW - 100, NOW)
    assert (span, set(courses)) == (1, set(NAMES))
    assert courses["R_s"].t == tuple(range(NOW - 100, NOW))
    assert courses["R_s"].value == courses["R_s"].low == courses["R_s"].high == tuple(map(float, range(100)))
    assert set(courses["R_s"].status) == {"ok"}
    assert len(other.history("spindle", NOW - 100, NOW)[1]["R_s"].t) == 10
    assert one.history("nobody", NOW - 100, NOW)[1] == {}


def test_longer_times_are_thinned_with_their_extremes_kept(engine: Engine) -> None:
    memory = Memory(engine, "here")
    memory.add(seconds("spindle", NOW - 7200, 7200, lambda k: 5.0 if k == 3661 else -5.0 if k == 17 else 1.0))
    memory.add([Point("spindle", "R_s", NOW - 7300, 1.0, None, "held")])
    memory.condense(NOW)
    memory.condense(NOW)
    for back in (7200, 86_400, 30 * 86_400):
        _, courses = memory.history("spindle", NOW - back, NOW)
        course = courses["L_d"]
        assert len(course.t) <= MOST
        assert (min(course.low), max(course.high)) == (-5.0, 5.0)
        weighted = sum(course.value) / len(course.value)
        assert weighted == pytest.approx(1.0, abs=0.01)
    assert memory.history("spindle", NOW - 86_400, NOW)[1]["R_s"].status[0] == "held"


def test_seconds_of_more_than_a_day_ago_go_and_their_minutes_stay(engine: Engine) -> None:
    memory = Memory(engine, "here")
    memory.add(seconds("spindle", NOW - 90_000, 120))
    memory.add(seconds("spindle", NOW - 60, 60))
    memory.condense(NOW)
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT span, count(*) FROM points GROUP BY span")).all()
        spans = {span: count for span, count in rows}  # noqa: C416 - rows are no pairs to the type checker
    assert spans == {1: 240, 60: 12, 3600: 8}
    assert memory.history("spindle", NOW - 90_000, NOW - 89_000)[0] == 60


def test_a_year_is_there_within_a_second(engine: Engine) -> None:
    memory = Memory(engine, "here")
    memory.add(seconds("spindle", NOW - 86_400, 1))
    with engine.begin() as connection:
        for series in range(1, 5):
            connection.execute(insert(POINTS), [
                {"series": series, "span": span, "t": NOW - 365 * 86_400 + k * span, "value": 1.0, "std": 0.1,
                 "low": 0.9, "high": 1.1, "status": 1} for span in (60, 3600) for k in range(365 * 86_400 // span)
                if span == 3600 or k % 20 == 0
            ])  # fmt: skip
    begun = time.monotonic()
    _, courses = memory.history("spindle", NOW - 365 * 86_400, NOW)
    assert time.monotonic() - begun < 1.0
    assert {len(course.t) for course in courses.values()} <= set(range(1000, MOST + 2))


def test_only_values_that_were_told_are_remembered() -> None:
    assert point_of("x", "R_s", 1.9, 1.0, 0.1, "ok") == Point("x", "R_s", 1, 1.0, 0.1, "ok")
    assert point_of("x", "R_s", 1.0, 1.0, math.inf, "held") == Point("x", "R_s", 1, 1.0, None, "held")
    assert point_of("x", "R_s", 1.0, None, None, "not_told") is None
    assert point_of("x", "R_s", 1.0, 1.0, 0.1, "stale") is None
    assert point_of("x", "R_s", 1.0, math.nan, 0.1, "ok") is None


@pytest.mark.parametrize(("given", "said"), [
    ("mysql://user:secret@x/y", "got one of mysql"), ("://user:secret@x", "got something else"),
])  # fmt: skip
def test_other_addresses_are_refused_without_telling_a_password(given: str, said: str) -> None:
    with pytest.raises(ConfigError, match="expected a file, or postgresql://") as refused:
        check_address(given)
    assert said in str(refused.value)
    assert "secret" not in str(refused.value)


def test_a_server_that_is_not_there_is_told_without_a_password() -> None:
    with pytest.raises(UnavailableError, match="the catalogue cannot be opened: ") as refused:
        opened(f"postgresql://user:secret@127.0.0.1:{free_port()}/bench")
    assert "secret" not in str(refused.value)


def test_a_file_that_is_no_catalogue_is_told(tmp_path: Path) -> None:
    path = tmp_path / "catalogue.sqlite"
    path.write_bytes(b"something else, and long enough to be looked at" * 100)
    with pytest.raises(UnavailableError, match="the catalogue cannot be opened: file is not a database") as refused:
        opened(str(path))
    assert f"; move {path} away and start the service again: lists come back from the files" in str(refused.value)
    path.rename(tmp_path / "away")
    opened(str(path)).dispose()


def test_one_that_is_damaged_while_it_is_used_is_told(tmp_path: Path) -> None:
    path = tmp_path / "catalogue.sqlite"
    memory = Memory(opened(str(path)), "here")
    memory.add(seconds("spindle", NOW, 100))
    memory.close()
    content = bytearray(path.read_bytes())
    content[100:] = b"x" * (len(content) - 100)
    path.write_bytes(content)
    with pytest.raises(UnavailableError, match=f"malformed; move {path} away and start the service again"):
        memory.look()
    memory.close()


def test_one_that_is_gone_is_noticed_with_nothing_to_write_and_so_is_its_return(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.store.catalogue.keeper._RETRY", 0.5)
    with postgresql(tmp_path) as address, relayed(make_url(address).port or 0) as relay:
        through = make_url(address).set(port=relay.port).render_as_string(hide_password=False)
        keeper = Keeper(through, "here", lambda: [])
        keeper.start()
        until(lambda: keeper.memory is not None and keeper.failure is None, "the catalogue")
        relay.cut()
        until(lambda: keeper.failure is not None, "the failure")
        assert "the catalogue cannot be used" in str(keeper.failure)
        relay.mend()
        until(lambda: keeper.failure is None, "its return")
        keeper.end()
        keeper.join(5.0)


def test_one_that_does_not_answer_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.store.catalogue.keeper._SLOW", 0.2)
    keeper, answers = Keeper(str(tmp_path / "catalogue.sqlite"), "here", lambda: []), threading.Event()
    keeper.tell(lambda _: answers.wait(10.0))
    keeper.start()
    until(lambda: keeper.failure is not None, "the failure")
    assert "the catalogue has not answered for " in str(keeper.failure)
    answers.set()
    until(lambda: keeper.failure is None, "the answer")
    keeper.end()
    keeper.join(5.0)


def test_what_cannot_be_written_waits_until_it_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.store.catalogue.keeper._RETRY", 0.5)
    path, count = tmp_path / "folder" / "catalogue.sqlite", iter(range(1000))
    (tmp_path / "folder").write_text("a file where a folder is to be")
    keeper = Keeper(str(path), "here", lambda: seconds("spindle", NOW + next(count), 1))
    keeper.start()
    until(lambda: keeper.failure is not None, "the failure")
    assert "the catalogue cannot be opened" in str(keeper.failure)
    (tmp_path / "folder").unlink()
    until(lambda: keeper.failure is None and keeper.memory is not None, "the catalogue")
    keeper.end()
    keeper.join(5.0)
    assert keeper.memory is not None
    _, courses = keeper.memory.history("spindle", NOW, NOW + 100)
    assert courses["R_s"].t == tuple(range(NOW, NOW + len(courses["R_s"].t)))
    assert len(courses["R_s"].t) == next(count)
    assert path.stat().st_size > 0


def test_what_a_catalogue_refuses_holds_up_nothing_after_it(tmp_path: Path) -> None:
    heard: list[bool] = []
    keeper = Keeper(str(tmp_path / "catalogue.sqlite"), "here", lambda: [], lambda _: heard.append(True))
    keeper.tell(lambda memory: memory.ended.add(replace(CAPTURE, state=cast(str, None))))
    keeper.tell(lambda memory: memory.ended.add(replace(CAPTURE, request={"x": object()})))
    keeper.tell(lambda memory: memory.ended.add(CAPTURE))
    keeper.start()
    keeper.end()
    keeper.join(5.0)
    assert keeper.memory is not None
    assert [job.id for job in keeper.memory.ended.latest("capture", 9)] == [CAPTURE.id]
    assert heard == [True]
    keeper.memory.close()
