"""The watch over a stream: since when, and where, the model does not explain the drive - from windows to REST."""

import json
import subprocess
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from bench.config import Config, DriveConfig
from bench.live import watch
from bench.live.watch import MOST, Explained, Mismatch, Watch
from bench.live.window import Window
from bench.service.service import Service
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import Effects
from emulator.scenario.scenarios import PAPER, Scenario
from emulator.scenario.text import text_of
from tests.conftest import COMMAND, bench_up
from tests.estimator.diagnosis.test_watch import estimates_of, paper
from tests.support.samples import streamed
from tests.support.served_drive import served, tcp_url, until

pytestmark = [pytest.mark.live, pytest.mark.thorough]

START = datetime(2026, 1, 31, 12, 0, 0, tzinfo=UTC)
HELD = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
WINDOW = Window(length=1000, held=HELD)
STEP = Effects(demagnetisation=Demagnetisation(0.03, 3.5))  # s
DEAD_TIME = paper(Effects(inverter=Inverter(dead_time=1e-6)))


def watched(
    drive: VirtualDrive, said: Watch, seconds: int, *, rows: int = 1000, nominal: dict[str, float] | None = None,
) -> list[Mismatch]:
    """What is said after each second of the drive's stream; the clock shows drive's seconds after `START`."""
    told: list[Mismatch] = []
    for _ in range(seconds):
        samples = streamed(drive, rows)
        watch.take(said, samples, WINDOW)
        now = START + timedelta(seconds=samples.t0 + samples.T * rows)
        watch.judge(said, WINDOW, estimates_of(samples, **HELD), nominal or {}, now)
        told.append(said.said)
    return told


def seconds(moment: datetime | None) -> float:
    assert moment is not None
    return (moment - START).total_seconds()


def test_a_whole_model_is_explained_from_its_first_window_on() -> None:
    assert Mismatch().status is Explained.NOT_TOLD
    told = watched(VirtualDrive(PAPER), Watch(), 6)
    assert [said.status for said in told] == [Explained.YES] * 6
    for said in told:
        assert (said.since, said.until, said.where, said.reason) == (None, None, "", "")
        assert said.ratio == pytest.approx(1.0, abs=0.3)
        assert said.rms_V is not None
        assert said.least_V is not None
        assert said.rms_V < said.least_V


def test_an_effect_is_told_since_the_first_window_and_by_the_second() -> None:
    told = watched(VirtualDrive(DEAD_TIME), Watch(), 4)
    assert [said.status for said in told] == [Explained.NOT_TOLD, *[Explained.NO] * 3]
    assert [seconds(said.since) for said in told[1:]] == pytest.approx([1.0] * 3, abs=0.01)
    assert all(said.until is None and " on " in f" {said.where}" for said in told[1:])


def test_one_window_that_is_not_explained_is_no_episode() -> None:
    told = watched(VirtualDrive(replace(PAPER, effects=STEP)), Watch(), 6)
    assert [said.status for said in told] == [Explained.YES] * 6
    assert max(said.significance or 0.0 for said in told) > 100.0  # it was seen


def test_a_step_is_told_near_its_time_and_ends_when_it_has_left_the_window() -> None:
    drive, said = VirtualDrive(replace(PAPER, effects=STEP)), Watch()
    told = [watched(drive, said, 1, rows=250)[-1] for _ in range(24)]
    unexplained = [k for k, each in enumerate(told) if each.status is Explained.NO]
    assert unexplained == list(range(unexplained[0], unexplained[-1] + 1))
    assert seconds(told[unexplained[0]].since) == pytest.approx(3.5, abs=0.3)
    last = told[-1]
    assert (last.status, last.since) == (Explained.YES, told[unexplained[0]].since)
    assert seconds(last.until) == pytest.approx(4.5, abs=0.5)
    assert last.where.startswith("mostly on q")


def test_a_parameter_that_another_machine_has_is_told_though_nothing_is_left_of_the_voltages() -> None:
    hot = VirtualDrive(PAPER)
    hot.set_temperature(80.0)  # a warm winding is no other machine
    assert watched(hot, Watch(), 3, nominal=HELD)[-1].status is Explained.YES
    told = watched(VirtualDrive(PAPER), Watch(), 3, nominal=HELD | {"R_s": 0.5, "L_q": 6.9e-3})
    assert [said.status for said in told] == [Explained.NOT_TOLD, Explained.NO, Explained.NO]
    assert told[-1].where.startswith("R_s reads 0.96")
    assert told[-1].where.endswith(" ohm, nominal 0.500 ohm")
    both = watched(VirtualDrive(DEAD_TIME), Watch(), 2, nominal=HELD)[-1].where
    assert " on " in f" {both}"
    assert "; R_s reads 2." in both


def test_windows_that_say_nothing_neither_begin_an_episode_nor_end_it() -> None:
    for scenario, status in ((PAPER, Explained.YES), (DEAD_TIME, Explained.NO)):
        drive, said = VirtualDrive(scenario), Watch()
        before = watched(drive, said, 3)[-1]
        drive.write("excitation_kind", 0.0)
        drive.write("i_q_ref", 0.0)
        after = watched(drive, said, 4)[-1]
        assert (after.status, after.since) == (status, before.since)
    steady = VirtualDrive(paper(kind="none"))
    streamed(steady, 100)  # its currents rise
    told = watched(steady, Watch(), 3)[-1]
    assert (told.status, told.reason) == (
        Explained.NOT_TOLD, "currents and speed are constant, and any parameters would explain that"
    )


def test_rows_without_numbers_are_gaps_and_a_bridge_that_goes_off_and_on_is_no_episode() -> None:
    drive, said = VirtualDrive(PAPER), Watch()
    watched(drive, said, 2)
    drive.write("control_word", 0x00)
    off = watched(drive, said, 3)  # its voltages are not known
    for word in (0x06, 0x07, 0x0F):
        drive.write("control_word", word)
        drive.run(10)
    on = watched(drive, said, 3)
    assert [each.status for each in (*off, *on)] == [Explained.YES] * 6
    assert (on[-1].since, on[-1].reason) == (None, "")


def test_what_is_missing_between_two_rows_makes_no_neighbours_of_them() -> None:
    for spoilt in (False, True):
        drive, said = VirtualDrive(PAPER), Watch()
        told: list[Mismatch] = []
        for _ in range(12):
            samples = streamed(drive, 333)
            if spoilt:
                samples.u_q[-7:] = np.nan
            else:
                samples = samples[:-7]
            watch.take(said, samples, WINDOW)
            watch.judge(said, WINDOW, estimates_of(samples, **HELD), {}, START)
            told.append(said.said)
        assert [each.status for each in told[1:]] == [Explained.YES] * 11
        assert max(each.significance or 0.0 for each in told) < 5.0


def test_no_more_rows_are_kept_than_are_judged() -> None:
    said, drive = Watch(), VirtualDrive(PAPER)
    for length, most in ((1000, 1000), (10 * MOST, MOST)):
        for _ in range(30):
            watch.take(said, streamed(drive, 1000), Window(length=length))
        assert most <= said.rows <= most + 1000


@contextmanager
def serving(scenario: Scenario, window: Window = WINDOW) -> Generator[tuple[Service, Any]]:
    """A service over a drive on a real socket, faster than time."""
    with served(tcp_url(), scenario) as drive, Service(Config((DriveConfig("a", drive.url, window),))) as service:
        yield service, drive


def said_by(service: Service) -> Mismatch:
    return service.estimates("a").mismatch


def awaited(service: Service, wanted: Callable[[Mismatch], bool], what: str) -> Mismatch:
    until(lambda: wanted(said_by(service)), what)
    return said_by(service)


def test_the_service_tells_a_drive_with_an_effect_from_one_without() -> None:
    with serving(PAPER) as (service, _):
        assert awaited(service, lambda said: said.status is Explained.YES, "the drive to be explained").since is None
    began = datetime.now(UTC)
    with serving(DEAD_TIME) as (service, _):
        said = awaited(service, lambda said: said.status is Explained.NO, "the mismatch to be told")
        assert said.since is not None
        assert began < said.since < datetime.now(UTC)
        assert service.healthy()


def test_the_service_dates_a_step_and_says_that_it_is_over() -> None:
    scenario = paper(Effects(demagnetisation=Demagnetisation(0.03, 12.0)))
    with serving(scenario, Window(length=4000)) as (service, drive):
        awaited(service, lambda said: said.status is Explained.YES, "the drive to be explained")
        until(lambda: drive.drive.elapsed > 12.0, "the step")
        stepped = datetime.now(UTC)
        said = awaited(service, lambda said: said.status is Explained.NO, "the step to be told")
        assert said.since is not None
        assert abs(said.since - stepped) < timedelta(seconds=4)
        over = awaited(service, lambda said: said.status is Explained.YES, "the step to be over")
        assert (over.since, over.where != "") == (said.since, True)
        assert over.until is not None
        assert over.until > said.since


def test_a_wrong_held_value_is_told_and_the_right_one_ends_it() -> None:
    with serving(PAPER) as (service, _):
        awaited(service, lambda said: said.status is Explained.YES, "the drive to be explained")
        service.change_window("a", {"estimated": ["R_s", "L_d", "L_q"], "held": {"psi_f": 0.118}})
        awaited(service, lambda said: said.status is Explained.NO, "the wrong value to be told")
        service.change_window("a", {"held": {"psi_f": 0.12}})
        assert awaited(service, lambda said: said.status is Explained.YES, "the right value to do").until is not None


@pytest.mark.parametrize("change", [{"method": "rls"}, {"method": "ekf"}, {"length": "auto", "longest": 3000}])
def test_every_method_has_its_rows_judged(change: dict[str, Any]) -> None:
    for scenario, status in ((PAPER, Explained.YES), (DEAD_TIME, Explained.NO)):
        with serving(scenario, WINDOW.changed(change)) as (service, _):
            awaited(service, lambda said, status=status: said.status is status, f"{status} with {change}")


def test_rest_and_the_command_line_say_since_when_and_where(tmp_path: Path) -> None:
    scenario = tmp_path / "dead_time.toml"
    scenario.write_text(text_of(DEAD_TIME), encoding="utf-8")
    with bench_up("--scenario", str(scenario)) as bench, httpx.Client(base_url=bench.url) as client:
        told: dict[str, Any] = {}

        def unexplained() -> bool:
            told.update(client.get("/api/drives/emulated/estimates").json())
            return told["mismatch"]["status"] == "unexplained"

        until(unexplained, "the mismatch to be told")
        said = told["mismatch"]
        assert set(said) == {
            "status", "since", "until", "where", "reason", "significance", "ratio", "rms_V", "least_V"
        }
        assert datetime.fromisoformat(said["since"]) < datetime.now(UTC)
        assert (said["until"], said["reason"]) == (None, "")
        assert said["rms_V"] > said["least_V"]
        with client.stream("GET", "/api/drives/emulated/stream") as events:
            line = next(line for line in events.iter_lines() if line.startswith("data: "))
        assert json.loads(line.removeprefix("data: "))["estimates"]["mismatch"]["since"] == said["since"]
        done = subprocess.run(
            [*COMMAND, "estimates", "emulated", "--once", "--service", bench.url],
            capture_output=True, text=True, timeout=60, check=False,
        )
        assert (done.returncode, done.stderr) == (1, "")  # its estimates are doubtful
        clock = datetime.fromisoformat(said["since"]).astimezone().strftime("%H:%M:%S")
        words = " ".join(done.stdout.split())
        assert f"the model has not explained the drive since {clock}: " in words
        assert "pmsm-bench capture emulated" in words
