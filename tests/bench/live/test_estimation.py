"""The estimation worker: blocks of the emulated drive in, snapshots out, the window changed while it runs."""

import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from bench.errors import LimitError, UnavailableError
from bench.live import estimation
from bench.live.estimation import QUEUE, Estimation, Snapshot
from bench.live.window import Window
from bench.machine_file import Nominal
from drivers.block import Block
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.machine import PARAMETERS
from estimator.online import rls, window_ls
from estimator.online.estimate import Status
from tests.support.served_drive import until

pytestmark = pytest.mark.live

TRUTH = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
WINDOW = Window(length=600, held=TRUTH)


class Source:
    """Blocks of one emulated drive, as a client would make them."""

    def __init__(self, **motor: float) -> None:
        self.drive = VirtualDrive(replace(PAPER, motor=PAPER.motor._replace(**motor)))

    def block(self, rows: int) -> Block:
        periods = int(self.drive.read("stream_periods"))
        return self._as_block(self.drive.run(rows * periods), periods)

    def skip(self, rows: int) -> None:
        self.drive.run(rows * int(self.drive.read("stream_periods")))

    def _as_block(self, rows: StreamRows, periods: int) -> Block:
        columns = {f.name: getattr(rows, f.name) for f in fields(StreamRows) if f.name != "row_tick"}
        return Block(
            tick=rows.row_tick, **columns, T_s=self.drive.T_s, periods=periods, lost_before=0,
            i_step=0.0, u_step=0.0, temp_winding=float("nan"), temp_magnet=float("nan"),
        )


def resting(block: Block) -> Block:
    """As of a drive whose bridge is off."""
    none = np.full(len(block), np.nan)
    return replace(block, u_d=none, u_q=none)


@contextmanager
def running(**windows: Window) -> Generator[Estimation]:
    worker = Estimation(windows or {"a": WINDOW})
    worker.start()
    try:
        yield worker
    finally:
        worker.stop()


def settled(worker: Estimation, block: Block, name: str = "a") -> Snapshot:
    """The snapshot that has this block's last row in it."""
    end = (int(block.tick[-1]) + block.periods) * block.T_s
    until(lambda: worker.snapshot(name).t_drive == end, f"an estimate of drive {name} up to {end} s")
    return worker.snapshot(name)


def fed(worker: Estimation, source: Source, rows: int, name: str = "a", size: int = 100) -> Snapshot:
    """Hand over so many rows, in blocks, and wait for what they say."""
    block = None
    for start in range(0, rows, size):
        block = source.block(min(size, rows - start))
        worker.put(name, block)
    assert block is not None
    return settled(worker, block, name)


def expect_truth(snapshot: Snapshot, within: float = 0.01, **truth: float) -> None:
    for name, value in (TRUTH | truth).items():
        estimate = snapshot.result.estimates[name]
        assert estimate.value == pytest.approx(value, rel=within), (name, estimate)


def block_worker(worker: Estimation) -> threading.Event:
    """Keep the worker busy, as a slow machine would, until the event is set."""
    release, busy = threading.Event(), threading.Event()
    worker._queue.put(lambda: (busy.set(), release.wait(20.0))[0])
    assert busy.wait(5.0)
    return release


def test_the_stream_tells_all_four_parameters() -> None:
    with running() as worker:
        assert worker.snapshot("a").result.samples == 0
        assert worker.snapshot("a").age is None
        snapshot = fed(worker, Source(), 1000)
        assert (snapshot.result.samples, snapshot.result.gaps, snapshot.rows_dropped) == (600, 0, 0)
        assert snapshot.age is not None
        assert 0.0 <= snapshot.age < 5.0
        expect_truth(snapshot)


def test_a_window_that_grows_takes_back_rows_it_had_left_behind_and_one_that_shrinks_forgets_none() -> None:
    with running() as worker:
        fed(worker, Source(), 1500)
        for length in (1200, 50, 1400):
            assert worker.change_window("a", {"length": length}).length == length
            snapshot = worker.snapshot("a")
            assert (snapshot.window.length, snapshot.result.samples, snapshot.result.gaps) == (length, length, 0)
            assert snapshot.result.filled
        worker.change_window("a", {"length": 3000})
        result = worker.snapshot("a").result
        assert (result.samples, result.filled) == (1499, False)  # the last row waits for its end


def test_settings_change_on_the_samples_held_and_back_to_the_same_result() -> None:
    with running() as worker:
        before = fed(worker, Source(), 1000).result
        worker.change_window("a", {"periods_per_row": 10})
        coarse = worker.snapshot("a").result
        assert coarse.samples == 600
        assert 118 <= coarse.equations <= 120  # a row at either end may be cut by the edge
        worker.change_window("a", {"periods_per_row": 1})
        assert worker.snapshot("a").result.samples == 600
        for name, estimate in worker.snapshot("a").result.estimates.items():
            assert estimate.value == pytest.approx(before.estimates[name].value, rel=1e-9)


def test_held_values_are_used_at_once_and_shown_as_held() -> None:
    with running() as worker:
        fed(worker, Source(), 1000)
        worker.change_window("a", {"estimated": ["R_s", "L_d", "L_q"], "held": {"psi_f": 0.12}})
        expect_truth(worker.snapshot("a"))
        assert worker.snapshot("a").result.estimates["psi_f"].status is Status.HELD
        worker.change_window("a", {"estimated": ["L_d"], "held": {"psi_f": 0.2}})
        told = worker.snapshot("a").result.estimates
        assert [told[name].status for name in PARAMETERS] == [Status.HELD, Status.OK, Status.HELD, Status.HELD]
        assert told["psi_f"].value == 0.2


def test_rows_that_are_missing_are_a_gap_and_no_false_neighbours() -> None:
    source = Source()
    with running() as worker:
        fed(worker, source, 300)
        source.skip(7)
        snapshot = fed(worker, source, 250)
        assert (snapshot.result.gaps, snapshot.result.samples) == (1, 548)
        expect_truth(snapshot)
        assert fed(worker, source, 700).result.gaps == 0


def test_a_worker_that_is_behind_drops_blocks_counts_their_rows_and_is_right_afterwards() -> None:
    source = Source()
    with running() as worker:
        fed(worker, source, 100)
        release = block_worker(worker)
        began = time.monotonic()
        for _ in range(QUEUE + 40):
            worker.put("a", source.block(5))
        assert time.monotonic() - began < 5.0  # put waits for nobody
        release.set()
        until(worker._queue.empty, "the worker to catch up")
        snapshot = fed(worker, source, 200)
        assert snapshot.rows_dropped == 40 * 5
        assert snapshot.result.gaps == 1
        expect_truth(snapshot)


@pytest.mark.parametrize("method", ["wls", "rls", "ekf"])
def test_another_row_length_begins_anew(method: str) -> None:
    source = Source()
    with running(a=WINDOW.changed({"method": method})) as worker:
        fed(worker, source, 600)
        source.drive.write("stream_periods", 20.0)
        source.drive.run(40)
        snapshot = fed(worker, source, 400)
        assert (snapshot.result.samples, snapshot.result.gaps) == (399, 0)
        assert snapshot.result.filled == (method != "wls")
        expect_truth(snapshot)


def test_rows_of_before_a_reset_or_a_long_pause_are_not_gone_on_from() -> None:
    warm = Source(R_s=2.0)
    with running() as worker:
        assert fed(worker, Source(), 1000).result.samples == 600
        assert fed(worker, warm, 100).result.samples == pytest.approx(100, abs=4)  # its clock has begun anew
        warm.skip(500)
        assert fed(worker, warm, 100).result.samples == pytest.approx(200, abs=4)  # rows that were lost
        worker.put("a", resting(warm.block(900)))
        snapshot = fed(worker, warm, 100)
        assert snapshot.result.samples == pytest.approx(300, abs=4)  # off for less than a second
        worker.put("a", resting(warm.block(1100)))
        snapshot = fed(worker, warm, 100)
        assert snapshot.result.samples == pytest.approx(100, abs=4)
        expect_truth(snapshot, 0.05, R_s=2.0)
        fed(worker, warm, 600)
        warm.skip(1500)
        assert fed(worker, warm, 100).result.samples == pytest.approx(100, abs=4)


def test_drives_do_not_mix() -> None:
    one, other = Source(), Source(R_s=0.5, L_d=8e-3)
    with running(a=WINDOW, b=replace(WINDOW, length=300)) as worker:
        for _ in range(40):
            worker.put("a", one.block(25))
            worker.put("b", other.block(25))
        expect_truth(fed(worker, one, 10))
        snapshot = fed(worker, other, 10, "b")
        expect_truth(snapshot, R_s=0.5, L_d=8e-3)
        assert snapshot.result.samples == 300
        worker.change_window("b", {"length": 100})
        assert worker.snapshot("a").window.length == 600


@pytest.mark.parametrize(
    "change",
    [{"length": 3}, {"held": {"R_s": 10**400}}, {"held": {"psi_f": 1e300}}, {"estimated": ["J"]}, {"size": 1}],
)
def test_a_change_that_cannot_work_leaves_the_window_as_it_was(change: dict[str, Any]) -> None:
    with running() as worker:
        before = fed(worker, Source(), 700)
        with pytest.raises(LimitError):
            worker.change_window("a", change)
        after = worker.snapshot("a")
        assert after.window == before.window
        assert after.result.estimates == before.result.estimates
        assert worker.failure is None


def test_rows_that_are_not_numbers_poison_nothing() -> None:
    source = Source()
    with running() as worker:
        fed(worker, source, 300)
        block = source.block(100)
        block.i_q[20:23] = np.nan
        block.u_d[60] = np.inf
        worker.put("a", block)
        snapshot = fed(worker, source, 180)
        assert (snapshot.result.gaps, snapshot.result.left_out) == (2, 4)
        expect_truth(snapshot)
        assert worker.failure is None


def test_a_fault_with_one_drive_is_told_and_stops_neither_the_worker_nor_the_others() -> None:
    source = Source()
    with running(a=WINDOW, b=WINDOW) as worker:
        block = source.block(50)
        worker.put("a", replace(block, i_d=block.i_d[:3]))
        until(lambda: worker.failure is not None, "the failure to be told")
        expect_truth(fed(worker, source, 800, "b"))
        expect_truth(fed(worker, source, 800, "a"))
        assert worker.failure is None


def test_a_change_that_the_estimator_fails_on_leaves_everything_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Source()
    with running() as worker:
        before = fed(worker, source, 700)
        solve = window_ls.estimate

        def fail(*arguments: Any) -> Any:
            if arguments[1] == ("R_s",):
                raise OverflowError("too large")
            return solve(*arguments)

        monkeypatch.setattr(window_ls, "estimate", fail)
        held = {"L_d": 4e-3, "L_q": 6e-3, "psi_f": 0.1}
        with pytest.raises(OverflowError):
            worker.change_window("a", {"length": 300, "periods_per_row": 2, "estimated": ["R_s"], "held": held})
        after = fed(worker, source, 100)
        assert after.window == before.window
        assert after.result.samples == WINDOW.length
        assert worker.failure is None


def test_a_method_that_fails_at_its_start_leaves_the_one_before_at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Source()
    with running() as worker:
        before = fed(worker, source, 700)

        def fail(*_: Any) -> Any:
            raise OverflowError("too large")

        monkeypatch.setattr(rls, "estimate", fail)
        with pytest.raises(OverflowError):
            worker.change_window("a", {"method": "rls", "length": 300})
        after = fed(worker, source, 100)
        assert after.window == before.window
        assert after.result.samples == WINDOW.length
        expect_truth(after)
        assert worker.failure is None


def test_a_window_chosen_by_the_data_is_told_again_and_again() -> None:
    source = Source()
    with running(a=WINDOW.changed({"length": "auto", "longest": 2000})) as worker:
        for rows in (300, 400):
            snapshot = fed(worker, source, rows)
            expect_truth(snapshot)
            assert all(estimate.window for estimate in snapshot.result.estimates.values())
        assert (snapshot.result.samples, snapshot.result.filled) == (699, False)


def test_a_change_is_refused_in_a_sentence_where_no_worker_takes_it_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimation, "_CHANGE_TIMEOUT", 0.05)
    worker = Estimation({"a": WINDOW})
    with pytest.raises(UnavailableError, match="the estimation does not run, the window stays as it is"):
        worker.change_window("a", {"length": 700})
    worker.start()
    release = block_worker(worker)
    source = Source()
    with pytest.raises(UnavailableError, match=r"the estimation is behind: expected .* within 0\.05 s, it stays"):
        worker.change_window("a", {"length": 700})
    for _ in range(QUEUE):
        worker.put("a", source.block(1))
    with pytest.raises(UnavailableError, match="the estimation is behind"):
        worker.change_window("a", {"length": 800})
    release.set()
    until(worker._queue.empty, "the worker to catch up")
    assert fed(worker, source, 10).window == WINDOW  # what was refused is not done later
    worker.stop()
    with pytest.raises(UnavailableError, match="does not run"):
        worker.change_window("a", {"length": 700})


def test_windows_may_be_changed_from_many_threads_while_blocks_come() -> None:
    source = Source()
    with running() as worker:
        fed(worker, source, 600)

        def change(lengths: range) -> None:
            for length in lengths:
                assert worker.change_window("a", {"length": length}).length == length

        threads = [threading.Thread(target=change, args=(range(100 + k, 500 + k, 20),)) for k in range(4)]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            worker.put("a", source.block(10))
            time.sleep(0.001)
        for thread in threads:
            thread.join()
        worker.change_window("a", {"length": 600})
        expect_truth(fed(worker, source, 1000))
        assert worker.failure is None


def test_stopping_ends_the_thread_even_with_work_waiting() -> None:
    worker = Estimation({"a": WINDOW})
    worker.start()
    source = Source()
    for _ in range(100):
        worker.put("a", source.block(5))
    worker.stop()
    assert not worker.thread.is_alive()
    Estimation({"a": WINDOW}).stop()  # never started


def test_a_known_step_of_the_angle_widens_what_rests_on_the_angle() -> None:
    source = Source()
    blocks = [source.block(100) for _ in range(6)]
    told: list[Snapshot] = []
    for machine in (Nominal({}), Nominal({}, n_p=4, encoder_counts=4096)):
        worker = Estimation({"a": WINDOW}, {"a": machine})
        worker.start()
        for block in blocks:
            worker.put("a", block)
        told.append(settled(worker, blocks[-1]))
        worker.stop()
    fine, coarse = ({name: e.std or 0.0 for name, e in each.result.estimates.items()} for each in told)
    assert coarse["L_q"] > 20.0 * fine["L_q"]
    assert coarse["L_q"] < 0.05 * PAPER.motor.L_q
