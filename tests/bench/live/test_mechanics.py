"""The shaft, live: blocks of emulated drives in, inertia out, for a few per cent of a core."""

import time
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from bench.live import mechanics
from bench.live.estimation import Estimation, samples_of
from bench.live.mechanics import SPAN, Shafts
from bench.live.window import Window
from bench.machine_file import Nominal
from drivers.block import Block
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.scenario.scenarios import Scenario
from estimator.mechanics.mechanics import Told
from estimator.online.estimate import Estimate, Status
from estimator.samples import Samples
from tests.estimator.mechanics import shafts
from tests.support.served_drive import until

SWINGING = shafts.shaft()
GIVEN = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
NOMINAL = Nominal(GIVEN, n_p=4, encoder_counts=4096)
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)


class Source:
    """Blocks of an emulated drive."""

    def __init__(self, scenario: Scenario) -> None:
        self.drive = VirtualDrive(scenario)
        self.drive.run(3000)

    def block(self, rows: int) -> Block:
        periods = int(self.drive.read("stream_periods"))
        rows_ = self.drive.run(rows * periods)
        columns = {f.name: getattr(rows_, f.name) for f in fields(StreamRows) if f.name != "row_tick"}
        return Block(
            tick=rows_.row_tick, **columns, T_s=self.drive.T_s, periods=periods, lost_before=0, i_step=0.0, u_step=0.0,
            temp_winding=float("nan"), temp_magnet=float("nan"),
        )

    def samples(self, rows: int) -> Samples:
        return samples_of(self.block(rows), NOMINAL.theta_step)


def test_the_last_seconds_tell_the_shaft() -> None:
    source, taken = Source(SWINGING), Shafts()
    for _ in range(60):
        mechanics.take(taken, source.samples(100))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    said = taken.shaft.said
    assert said.status is Told.OK, said.sentence
    assert said.rows == 5999
    assert said.gaps == 0
    for e in said.estimates.values():
        assert abs(shafts.off_by(e, SWINGING)) < 3.5, e.name


def test_rows_beyond_the_span_are_let_go() -> None:
    source, taken = Source(SWINGING), Shafts()
    for _ in range(24):
        mechanics.take(taken, source.samples(500))
    assert sum(map(len, taken.recent)) <= SPAN / 1e-3 + 500


def test_a_gap_is_one() -> None:
    source, taken = Source(SWINGING), Shafts()
    for k in range(60):
        samples = source.samples(100)
        if k not in (20, 21, 40):
            mechanics.take(taken, samples)
    mechanics.judge(taken, {}, NOMINAL, NOW)
    assert taken.shaft.said.gaps == 2
    assert taken.shaft.said.status is Told.OK
    mechanics.judge(taken, {}, NOMINAL, NOW)
    assert taken.shaft.said.gaps == 2


def test_the_estimated_flux_goes_before_the_machine_files_with_its_error() -> None:
    source, taken = Source(SWINGING), Shafts()
    mechanics.take(taken, source.samples(6000))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    J = taken.shaft.said.estimates["J"].value
    assert J is not None
    psi_f = Estimate("psi_f", 0.126, 0.00126, "Vs", Status.OK)
    mechanics.judge(taken, {"psi_f": psi_f}, NOMINAL, NOW)
    e = taken.shaft.said.estimates["J"]
    assert e.value == pytest.approx(1.05 * J, rel=1e-3)
    assert e.std == pytest.approx(0.01 * 1.05 * J, rel=0.1)
    mechanics.judge(taken, {"psi_f": replace(psi_f, status=Status.DOUBTFUL)}, NOMINAL, NOW)
    assert taken.shaft.said.estimates["J"].value == J


@pytest.mark.parametrize(
    ("nominal", "word"), [(Nominal(GIVEN), "n_p"), (Nominal({"R_s": 1.0}, n_p=4), "psi_f"), (Nominal({}), "n_p")]
)
def test_what_torque_lacks_is_said(nominal: Nominal, word: str) -> None:
    source, taken = Source(SWINGING), Shafts()
    mechanics.take(taken, source.samples(1000))
    mechanics.judge(taken, {}, nominal, NOW)
    assert taken.shaft.said.status is Told.NO_DATA
    assert word in taken.shaft.said.sentence


def test_what_was_told_stays_as_stale_while_the_shaft_holds_a_speed() -> None:
    taken = Shafts()
    mechanics.take(taken, Source(SWINGING).samples(6000))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    told = taken.shaft.said
    taken = mechanics.anew(taken)
    mechanics.take(taken, Source(shafts.at_one_speed(SWINGING)).samples(3000))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    mechanics.judge(taken, {}, NOMINAL, NOW + timedelta(seconds=5))
    assert taken.shaft.said is told
    assert taken.shaft.since == NOW
    assert "does not accelerate" in taken.shaft.now
    taken = mechanics.anew(taken)
    mechanics.take(taken, Source(SWINGING).samples(6000))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    assert taken.shaft.since is None


def test_short_rows_are_joined_into_longer_ones_of_the_same_way() -> None:
    drive = VirtualDrive(replace(SWINGING, drive=replace(SWINGING.drive, stream_periods=1)))
    drive.run(3000)
    source = Source(SWINGING)
    source.drive = drive
    samples = source.samples(20_004)
    longer = mechanics.joined_rows(samples)
    assert pytest.approx(1e-3) == longer.T
    assert len(longer) == 2000
    assert longer.periods == 10
    taken = Shafts()
    mechanics.take(taken, samples)
    mechanics.take(taken, source.samples(40_000))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    assert taken.shaft.said.status is Told.OK, taken.shaft.said.sentence
    assert max(abs(shafts.off_by(e, SWINGING)) for e in taken.shaft.said.estimates.values()) < 3.5


def test_rows_without_voltages_are_taken() -> None:
    source, taken = Source(SWINGING), Shafts()
    samples = source.samples(6000)
    mechanics.take(taken, replace(samples, u_d=np.full(6000, np.nan), u_q=np.full(6000, np.nan)))
    mechanics.judge(taken, {}, NOMINAL, NOW)
    assert taken.shaft.said.status is Told.OK


def test_a_look_is_not_taken_again_before_its_time() -> None:
    taken = Shafts()
    mechanics.take(taken, Source(SWINGING).samples(10_000))
    began = time.monotonic()
    mechanics.judge(taken, {}, NOMINAL, NOW)
    took = time.monotonic() - began
    assert taken.due >= began + max(mechanics.OFTEN, took / mechanics.SHARE)


@pytest.mark.live
def test_the_worker_tells_the_shaft_beside_the_parameters() -> None:
    source = Source(SWINGING)
    worker = Estimation({"a": Window(length=600, held=GIVEN)}, {"a": NOMINAL})
    worker.start()
    try:
        for _ in range(60):
            worker.put("a", source.block(100))
        until(lambda: worker.snapshot("a").shaft.said.status in (Told.OK, Told.DOUBTFUL), "the shaft is told")
        e = worker.snapshot("a").shaft.said.estimates["J"]
        assert e.value == pytest.approx(SWINGING.motor.J, rel=0.02)
    finally:
        worker.stop()
    assert worker.failure is None
