"""A flash over every link: done, or all as it was, whatever cuts it."""

import contextlib
import random
import threading
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from bench.errors import ConflictError, LimitError
from bench.parameters.flash import Around, End, cut, flash, parameters, planned, resume
from bench.parameters.journal import history
from bench.parameters.parameter_set import FLASHED, Entry, ParameterSet, set_of
from bench.parameters.plan import Plan, different
from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, LostError, NoReplyError
from drivers.lease import Controlled
from tests.support.served_drive import Served, served, virtual_url
from tests.support.transports import modbus_pty_url, modbus_tcp_url, serial_socket_url

pytestmark = pytest.mark.live

LINKS: dict[str, Callable[[], str]] = {
    "canopen": virtual_url, "modbus+tcp": modbus_tcp_url, "modbus+rtu": modbus_pty_url, "uart": serial_socket_url,
}
NEW = {"bandwidth": 900.0, "n_p": 3.0, "control_L_q": 5.5e-3, "dead_time": 2e-6, "k_p_speed": 0.05} | {
    f"psi_d_table_{k}": 0.1 + 1e-3 * k for k in range(1, 65)
}


def new_set(**more: Any) -> ParameterSet:
    return set_of(NEW, "another motor", "by hand", **more)


class Killed(BaseException):
    """In place of the end of this process."""


class Cutting:
    """A drive that does only so many calls, and then raises."""

    def __init__(self, drive: Drive, calls: float, error: Callable[[], BaseException]) -> None:
        self._drive, self.left, self._error = drive, calls, error

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._drive, name)
        if name not in ("read", "write", "control", "parameters"):
            return found

        def counted(*given: Any) -> Any:
            self.left -= 1
            if self.left < 0:
                raise self._error()
            return found(*given)

        return counted


class Counting:
    """A drive that counts how often all of its parameters are read, some of which times its link is lost."""

    def __init__(self, drive: Drive, lost: Collection[int] = ()) -> None:
        self._drive, self._lost, self.reads = drive, lost, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._drive, name)

    def parameters(self) -> dict[str, float]:
        self.reads += 1
        if self.reads in self._lost:
            raise LostError("the link was lost")
        return self._drive.parameters()


@pytest.fixture(params=LINKS)
def bench(request: pytest.FixtureRequest) -> Iterator[Served]:
    with served(LINKS[request.param](), control="lease") as one:
        yield one


def memory(bench: Served) -> dict[str, float]:
    """What the drive runs with after a reset, by nobody's link."""
    resets = bench.drive.resets
    bench.drive.reset()
    deadline = time.monotonic() + 5.0
    while bench.drive.resets == resets:
        assert time.monotonic() < deadline
        time.sleep(0.005)
    return bench.drive.values([signal.name for signal in FLASHED])


def test_what_is_flashed_is_there_after_a_reset_and_is_in_the_history(bench: Served, tmp_path: Path) -> None:
    steps = list[str]()
    with connect(bench.url) as drive:
        before = parameters(drive)
        to_do = planned(lambda: drive, new_set(), Around(tmp_path, "x"))
        assert len(to_do.changes) == len(NEW)
        done = flash(lambda: drive, new_set(), Around(tmp_path, "x", "somebody", tell=steps.append))
        assert (done.end, done.changed) == (End.FLASHED, len(NEW)), done.said
        assert not different(before | NEW, memory(bench))
        assert steps == ["writing 69 values", "storing", "resetting", "reading back"]
        assert not planned(lambda: drive, new_set(), Around(tmp_path, "x")).changes
        lines = history(tmp_path, drive.identity)
        assert [line["step"] for line in lines] == ["begun", "write", "store", "reset", "verify", "done"]
        assert (lines[0]["whom"], lines[0]["name"]) == ("somebody", "another motor")
        assert cut(drive.identity, tmp_path) is None
        assert operation.state(drive) is not operation.State.OPERATION_ENABLED


def test_a_drive_that_is_on_or_that_another_controls_is_not_flashed(bench: Served, tmp_path: Path) -> None:
    with connect(bench.url) as drive:
        with Controlled(drive) as held:
            with pytest.raises(DriveError, match="controls the drive"):
                flash(lambda: drive, new_set(), Around(tmp_path, "x"))
            held.start()
            with pytest.raises(ConflictError, match="the drive is on"):
                flash(lambda: drive, new_set(), Around(tmp_path, "x"))
        assert list(tmp_path.iterdir()) == []


def test_sets_for_others_doubts_and_limits_are_told_at_once_before_the_wire(bench: Served, tmp_path: Path) -> None:
    with connect(bench.url) as drive:
        for given, said in (
            (new_set(serial=5), "the set is for drive 0x00000005"), (new_set(layout_id=7), "for layout 0x00000007"),
        ):
            with pytest.raises(LimitError, match=said):
                flash(lambda: drive, given, Around(tmp_path, "x"))
        doubtful = ParameterSet("a", {
            "control_R_s": Entry(1.0, 0.9, 0.95), "control_L_d": Entry(4e-3, status="doubtful", source="estimate"),
        })
        with pytest.raises(LimitError) as told:
            flash(lambda: drive, doubtful, Around(tmp_path, "x"))
        assert str(told.value).splitlines() == [
            "control_R_s = 1 is outside its interval, 0.9 to 0.95", "control_L_d is doubtful (estimate)",
            "expected a reason why these are flashed all the same, got none",
        ]
        around = Around(tmp_path, "x", judge=lambda values, _changed: [f"current_limit {values['current_limit']:g}"])
        with pytest.raises(LimitError, match="current_limit 12"):
            flash(lambda: drive, new_set(), around)
        assert flash(lambda: drive, doubtful, Around(tmp_path, "x", override="a test")).end is End.FLASHED
        assert history(tmp_path, drive.identity)[0]["override"] == "a test"


def test_all_parameters_are_read_once_before_the_first_is_written(bench: Served, tmp_path: Path) -> None:
    with connect(bench.url) as drive:
        counting, seen = Counting(drive), list[int]()

        def tell(said: str) -> None:
            seen.append(counting.reads if said.startswith("writing") else 0)

        plans = list[Plan]()
        around = Around(tmp_path, "x", tell=tell, planned=plans.append)
        assert flash(lambda: cast(Drive, counting), new_set(), around).end is End.FLASHED
        assert (seen[0], [len(one.changes) for one in plans]) == (1, [len(NEW)])


def test_a_link_that_is_lost_after_the_reset_is_waited_for(bench: Served, tmp_path: Path) -> None:
    with connect(bench.url) as drive:
        counting = Counting(drive, lost=(3, 4))  # the read after the reset, and once more
        assert flash(lambda: cast(Drive, counting), new_set(), Around(tmp_path, "x")).end is End.FLASHED
        assert counting.reads == 5


def cut_at(folder: Path, finish: bool, stride: int) -> int:
    """Cut a flash at one call after another, by a stride, and finish it or roll it back; how many calls there are."""
    with served(virtual_url(), control="lease") as bench, connect(bench.url) as drive:
        before, calls, ends = parameters(drive), 0, set[bool]()
        while not done_by(Cutting(drive, calls, Killed), here := folder / str(calls)):
            left, now = cut(drive.identity, here), memory(bench)
            ends.add(new := not different(before | NEW, now))
            assert new or not different(before, now), calls
            if left is not None:
                with pytest.raises(ConflictError, match="has to be finished or rolled back first"):
                    flash(lambda: drive, new_set(), Around(here, "x"))
                done = resume(lambda: drive, Around(here, "x"), finish=finish)
                assert done.end is (End.FLASHED if finish else End.ROLLED_BACK), done.said
                assert not different(before | (NEW if finish else {}), memory(bench))
            assert flash(lambda: drive, set_of(before, "b", "a"), Around(folder / "b", "x")).end is End.FLASHED
            calls += stride
        assert ends == {False, True}
        return calls


def done_by(drive: Any, folder: Path) -> bool:
    """Whether a flash by this drive was done, and not cut."""
    try:
        flash(lambda: drive, new_set(), Around(folder, "x"))
    except Killed:
        return False
    return True


@pytest.mark.parametrize("finish", [False, True])
def test_cut_at_some_calls_it_is_finished_or_rolled_back(tmp_path: Path, finish: bool) -> None:
    assert cut_at(tmp_path, finish, 8) > 20


@pytest.mark.slow
@pytest.mark.parametrize("finish", [False, True])
def test_cut_at_every_call_it_is_finished_or_rolled_back(tmp_path: Path, finish: bool) -> None:
    assert cut_at(tmp_path, finish, 1) > 20


@pytest.mark.slow
def test_a_link_that_fails_at_any_call_leaves_the_values_before_or_the_new_ones(bench: Served, tmp_path: Path) -> None:
    chance = random.Random(bench.url.partition(":")[0])
    with connect(bench.url) as drive:
        before = parameters(drive)
        for k in range(12):
            failing = Cutting(drive, chance.randrange(1, 60), lambda: NoReplyError("no answer"))
            links = iter([failing] * 4)
            done = None

            def link(links: Iterator[Any] = links) -> Drive:
                return next(links, drive)

            with contextlib.suppress(NoReplyError):  # before anything was written
                done = flash(link, new_set(), Around(tmp_path / str(k), "x"))
            assert done is None or done.end in (End.FLASHED, End.ROLLED_BACK), done
            now = memory(bench)
            new = done is not None and done.end is End.FLASHED
            assert not different(before | (NEW if new else {}), now), (k, done)
            assert flash(lambda: drive, set_of(before, "b", "a"), Around(tmp_path / "b", "x")).end is End.FLASHED


@pytest.mark.slow
def test_power_that_fails_at_any_time_leaves_the_values_before_or_the_new_ones(bench: Served, tmp_path: Path) -> None:
    chance = random.Random(bench.url.partition(":")[0])
    with connect(bench.url) as drive:
        before = parameters(drive)
        for k in range(8):
            timer = threading.Timer(chance.uniform(0.0, 0.6), bench.drive.reset)
            timer.start()
            done = None
            with contextlib.suppress(DriveError):
                done = flash(lambda: drive, new_set(), Around(tmp_path / str(k), "x"))
            timer.join()
            now = memory(bench)
            new = not different(before | NEW, now)
            assert new or not different(before, now), (k, done)
            assert done is None or new == (done.end is End.FLASHED), done
            assert flash(lambda: drive, set_of(before, "b", "a"), Around(tmp_path / "b", "x")).end is End.FLASHED
