"""Experiments on a drive over a bus: what is held and recorded, what is refused, and that the drive is stopped."""

import math
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.actions import experiment
from bench.actions.drive_jobs import Link, sensible
from bench.actions.experiment import Hold, Plan, Progress, Recorded, Tell, check_motor, experiment_of
from bench.actions.experiment_part import ExperimentPart
from bench.actions.experiments import Experiments, of_ended, of_recording
from bench.actions.experiments import State as State_
from bench.actions.safety.lease import Leases
from bench.actions.safety.limits import Limits
from bench.actions.safety.under_control import CancelledError
from bench.actions.safety.unfinished import Origin
from bench.errors import ConflictError, LimitError, UnavailableError
from bench.machine_file import Nominal
from bench.store.catalogue.ended import EndedJob
from bench.store.shelf import Shelf
from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, FaultError, RefusedError
from drivers.wire.cia402 import State
from drivers.wire.dictionary import SET_POINTS
from drivers.wire.lease import Bridge, Record
from emulator.scenario.scenarios import PAPER, Excitation, Run
from tests.support.recordings import read_recording
from tests.support.served_drive import Served, served, tcp_url, until, virtual_url

pytestmark = pytest.mark.live

Told = dict[str, Any]
HOLDS = (Hold(1200.0, 0.0, 1.0, 0.2), Hold(1200.0, -1.5, 1.0, 0.2), Hold(1200.0, -1.5, -2.0, 0.2))
PLAN = Plan(HOLDS, 0.3)
SETTINGS = (*SET_POINTS, "excitation_kind", "step_time", "watchdog_time", "overspeed_trip", "speed_control")
left: list[int] = []  # notes that each experiment left
FREE = replace(
    PAPER,
    run=Run(shaft="free", speed_rpm=600.0, speed_control=True, speed_reference="ramp", tau_L=0.5),
    excitation=Excitation(speed_ref=600.0 * 4 * math.tau / 60.0, speed_ramp=2000.0, kind="none"),
)


@pytest.fixture(scope="module")
def bench() -> Iterator[Served]:
    with served(virtual_url(), control="lease") as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[Drive]:
    with connect(bench.url) as connected:
        yield connected
    assert bench.running.is_set()


def run(
    drive: Drive, plan: Plan, tell: Tell = lambda _: None, cancelled: threading.Event | None = None,
    part: ExperimentPart | None = None,
) -> Recorded:  # fmt: skip
    """An experiment without limits but the drive's; what is to be undone is noted in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        origin = Origin(Path(folder), "x", "an experiment")
        try:
            return experiment.run(drive, plan, tell, cancelled, part, limits=Limits(), origin=origin)
        finally:
            left.append(len(list(origin.folder.iterdir())))


def settings(drive: Drive) -> dict[str, float]:
    return {name: drive.read(name) for name in SETTINGS}


def stopped(drive: Drive) -> bool:
    return operation.state(drive) in (State.SWITCH_ON_DISABLED, State.FAULT)


def test_levels_are_held_recorded_in_every_period_and_the_drive_is_stopped(drive: Drive, tmp_path: Path) -> None:
    before, told = settings(drive), list[Progress]()
    part = experiment.begin(tmp_path / "run.parquet", PLAN, drive, {"drive": "x", "url": "y"})
    recorded = run(drive, PLAN, told.append, part=part)
    assert stopped(drive)
    assert settings(drive) == before
    assert recorded.samples == 6000
    assert recorded.remarks == ()
    assert {"holding 1200 rpm, i_d = 0 A, i_q = 1 A", "holding 1200 rpm, i_d = -1.5 A, i_q = -2 A"} <= {
        far.phase for far in told
    }
    assert all(0.0 <= far.share <= 1.0 for far in told)
    path, said = part.settled()
    assert (path, said) == (tmp_path / "run.parquet", "the first 6000 of 6000 samples are kept")
    assert path is not None
    assert list(tmp_path.iterdir()) == [path]
    (whole,) = read_recording(path).runs
    assert len(whole) == 6000
    assert whole.u_dc is not None
    for hold, part in zip(HOLDS, (slice(500, 1500), slice(3000, 3800), slice(5200, 6000)), strict=True):
        assert np.mean(whole.i_d[part]) == pytest.approx(hold.i_d, abs=0.2)
        assert np.mean(whole.i_q[part]) == pytest.approx(hold.i_q, abs=0.2)
        assert 0.1 < np.std(whole.i_d[part]) < 0.4  # the steps
    assert np.median(whole.omega_e) == pytest.approx(1200.0 * 4 * math.tau / 60.0, rel=1e-3)


def test_without_room_for_the_recording_nothing_moves(
    drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.files._BESIDES", 10**18)
    with pytest.raises(UnavailableError, match=r"^the experiment cannot be kept on disk: expected .* MB for 6000 "):
        experiment.begin(tmp_path / "run.parquet", PLAN, drive, {})
    assert list(tmp_path.iterdir()) == []


def test_a_drive_that_controls_its_speed_is_taken_to_each_speed(tmp_path: Path) -> None:
    plan = Plan((Hold(600.0, 0.0, 1.0, 0.2), Hold(300.0, -1.5, 1.0, 0.2)), 0.3)
    with served(tcp_url(), FREE, control="lease") as bench, connect(bench.url) as drive:
        recorded = run(drive, plan)
        assert stopped(drive)
        assert drive.read("speed_ref") == 0.0
    assert recorded.remarks == (
        "the drive controls its speed: i_q follows from the load, not from the experiment",
    )
    first, second = recorded.captures
    for part, rpm in ((first, 600.0), (second, 300.0)):
        assert np.median(part.columns["omega_e"]) == pytest.approx(rpm * 4 * math.tau / 60.0, rel=0.1)
    assert np.mean(second.columns["i_d"]) == pytest.approx(-1.5, abs=0.2)


def test_a_speed_that_the_load_machine_sets_is_recorded_as_it_is_and_told(drive: Drive) -> None:
    recorded = run(drive, Plan((Hold(600.0, 0.0, 1.0, 0.05),)))
    (remark,) = recorded.remarks
    assert remark.startswith("600 rpm was wanted and 1200 rpm recorded: the load machine sets the speed")


@pytest.mark.parametrize(
    ("hold", "said"),
    [
        (Hold(1200.0, 0.0, 40.0, 0.1), "hold 1: the drive takes currents up to "),
        (Hold(1e5, 0.0, 1.0, 0.1), "hold 1: the drive's speeds go to "),
        (Hold(4000.0, 0.0, 5.0, 0.1), "hold 1: 4000 rpm with i_d = 0 A, i_q = 5 A asks for "),
    ],
)
def test_what_is_beyond_the_drives_limits_is_refused_before_anything_changes(
    drive: Drive, hold: Hold, said: str
) -> None:
    before = settings(drive)
    with pytest.raises(LimitError, match=said.replace(".", r"\.")):
        run(drive, Plan((hold,)))
    assert stopped(drive)
    assert settings(drive) == before


def test_what_the_drive_itself_refuses_never_flows(bench: Served, drive: Drive) -> None:
    before = settings(drive)
    with pytest.raises(RefusedError):  # more than its current limit, less than its trip
        run(drive, Plan((Hold(1200.0, 0.0, 1.0, 0.1), Hold(1200.0, 0.0, 12.5, 0.1))))
    assert stopped(drive)
    assert settings(drive) == before
    assert abs(bench.drive.read("i_q")) < 6.0


def test_cancelled_it_stops_the_drive(drive: Drive) -> None:
    before, cancelled = settings(drive), threading.Event()

    def tell(far: Progress) -> None:
        if far.phase.startswith("holding"):
            cancelled.set()

    with pytest.raises(CancelledError):
        run(drive, PLAN, tell, cancelled)
    assert stopped(drive)
    assert settings(drive) == before


def test_a_fault_ends_it_and_says_which() -> None:
    scenario = replace(PAPER, drive=replace(PAPER.drive, temperature_trip=60.0))
    with served(virtual_url(), scenario, control="lease") as bench, connect(bench.url) as drive:

        def tell(far: Progress) -> None:
            if far.phase.startswith("holding"):
                bench.drive.set_temperature(70.0)

        with pytest.raises(FaultError, match="the drive went off during the experiment: motor too hot"):
            run(drive, Plan((Hold(1200.0, 0.0, 1.0, 1.0),)), tell)
        assert stopped(drive)
        with pytest.raises(FaultError, match="reset it first"):
            run(drive, PLAN)


def test_a_bench_that_is_gone_leaves_a_drive_that_goes_off_by_itself() -> None:
    with served(tcp_url(), control="lease") as bench:
        drive = connect(bench.url)

        def tell(far: Progress) -> None:
            if far.phase.startswith("holding"):
                drive.close()

        with pytest.raises(DriveError, match="could not be told to stop"):
            run(drive, Plan((Hold(1200.0, 0.0, 1.0, 5.0),)), tell)
        until(lambda: int(bench.drive.read("error_code")) == 0x8130, "the watchdog does not act")


MEANT: Told = {"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.3e-3, "psi_f": 0.118, "n_p": 4, "i_rated": 6.0}


@pytest.mark.parametrize(
    ("name", "meant", "said"),
    [("psi_f", 0.0052, "psi_f = 0.0052 Vs, x's file has 0.118 Vs: "), ("n_p", 7, "n_p = 7 pole pairs, x's file has 4 "),
     ("i_rated", 20.0, "i_rated = 20 A, x's file has 6 A"), ("L_q", 0.05, "L_q = 0.05 H, x's file has 0.0063 H")],
)  # fmt: skip
def test_what_is_meant_for_another_motor_is_refused_with_both_values(name: str, meant: float, said: str) -> None:
    plan = Plan.of({"holds": [asdict(HOLDS[0])], "machine": MEANT | {name: meant}})
    with pytest.raises(LimitError, match="the diagnosis is of a motor with ") as refused:
        check_motor(plan, MEANT, "x's file")
    assert said in str(refused.value)
    check_motor(plan, {other: value for other, value in MEANT.items() if other != name}, "x's file")  # not known


def test_one_motor_by_two_data_sheets_is_the_same_and_a_plan_for_none_is_for_any() -> None:
    other = {"R_s": 1.4, "L_d": 3.5e-3, "L_q": 8e-3, "psi_f": 0.13, "n_p": 4, "i_rated": 5.0}
    check_motor(Plan(HOLDS, 0.3, other), MEANT, "x")
    check_motor(Plan(HOLDS, 0.3), MEANT, "x")


@dataclass
class Known:
    """A drive as the bench has it."""

    url: str
    link: Link
    nominal: Nominal = field(default_factory=lambda: Nominal({}))
    limits: Limits = field(default_factory=Limits)


class Nothing:
    """A link that is not asked."""

    def drive(self) -> Drive:
        raise AssertionError


def test_a_drives_machine_file_is_asked_before_the_drive_is(tmp_path: Path) -> None:
    drives = {"x": Known("", Nothing(), Nominal({"psi_f": 0.118}))}
    experiments = Experiments(tmp_path, tmp_path / "control", drives, Leases(lambda _: None))
    with pytest.raises(LimitError, match=r"drive x's machine file has 0\.118 Vs"):
        experiments.ask("x", {"holds": [asdict(HOLDS[0])], "machine": {"psi_f": 0.0052}})


def test_a_drive_that_controls_another_motor_refuses_before_anything_changes(drive: Drive) -> None:
    with pytest.raises(LimitError, match=r"psi_f = 0\.0052 Vs, the drive's current control has 0\.12 Vs"):
        run(drive, Plan(HOLDS, 0.3, MEANT | {"psi_f": 0.0052}))
    assert stopped(drive)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "levels that a drive can hold, got none"),
        ({"holds": [], "sentence": "look it up"}, "got none: look it up"),
        ({"holds": [1]}, "hold 1: expected speed_rpm, i_d, i_q and seconds, got 1"),
        ({"holds": [{"speed_rpm": 1.0}]}, "hold 1: expected speed_rpm, i_d, i_q and seconds, got 'speed_rpm'"),
        ({"holds": [{"speed_rpm": 1, "i_d": "x", "i_q": 0, "seconds": 1}]}, "hold 1: i_d"),
        ({"holds": [{"speed_rpm": 1, "i_d": 0, "i_q": 0, "seconds": 0}]}, "hold 1: seconds"),
        ({"holds": [{"speed_rpm": 1, "i_d": 0, "i_q": 0, "seconds": 1}], "step": -1}, "step"),
        ({"holds": [asdict(HOLDS[0])], "machine": 3}, "machine: expected an object of R_s, L_d, L_q, "),
        ({"holds": [asdict(HOLDS[0])], "machine": {"R": 1}}, "psi_f, n_p, i_rated, got 'R'"),
        ({"holds": [asdict(HOLDS[0])], "machine": {"R_s": "1"}}, "machine: R_s: expected a number"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(LimitError) as refused:
        Plan.of(given)
    assert said in str(refused.value)


def test_the_experiment_is_the_ambiguity_asked_for_or_the_first_that_a_drive_can_do() -> None:
    holds = [{"speed_rpm": 1.0, "i_d": 0.0, "i_q": 0.0, "seconds": 1.0}]
    none: Told = {"sentence": "measure u_dc", "holds": []}
    first: Told = {"sentence": "one", "holds": holds}
    second, instead = first | {"sentence": "two"}, first | {"sentence": "instead"}
    doubts = [{"experiment": none}, {"experiment": first}, {"experiment": second}]
    diagnosis: Told = {"verdict": "ambiguous", "ambiguous": doubts, "experiment": instead}
    assert experiment_of(diagnosis) == first
    assert experiment_of(diagnosis, 3) == second
    assert experiment_of({"ambiguous": [], "experiment": instead}) == instead
    assert experiment_of(diagnosis | {"machine": {"nominal": MEANT, "after": {}}}) == first | {"machine": MEANT}
    assert experiment_of(diagnosis | {"machine": {"after": {}}}) == first
    refusals: list[tuple[Told, int | None, str]] = [
        (diagnosis, 4, "an ambiguity from 1 to 3, which the diagnosis has, got 4"),
        (diagnosis | {"ambiguous": [], "experiment": None}, None, "asks for an experiment, got one that does not"),
        (diagnosis | {"ambiguous": doubts[:1], "experiment": None}, None, "no drive can do what the diagnosis asks"),
    ]
    for content, number, said in refusals:
        with pytest.raises(LimitError, match=said):
            experiment_of(content, number)


def test_one_that_was_stopped_before_it_began_never_switches_on(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    cancelled, bridges, plain = threading.Event(), list[Bridge](), drive.control
    cancelled.set()

    def control(record: Record) -> None:
        bridges.append(record.bridge)
        plain(record)

    monkeypatch.setattr(drive, "control", control)
    with pytest.raises(CancelledError):
        run(drive, PLAN, cancelled=cancelled)
    assert Bridge.ON not in bridges


def test_a_stop_while_one_is_being_asked_for_voids_it(bench: Served, drive: Drive, tmp_path: Path) -> None:
    class Stopping:
        """A link, by which a stop comes while the drive is asked."""

        def drive(self) -> Drive:
            experiments.stop("x")
            return drive

    experiments = Experiments(tmp_path, tmp_path / "control", {"x": Known(bench.url, Stopping())}, Leases())
    with pytest.raises(ConflictError, match="drive x was stopped meanwhile: ask again where that is meant"):
        experiments.ask("x", {"holds": [asdict(hold) for hold in HOLDS], "step": 0.3})
    assert experiments.all("x") == []
    assert list(tmp_path.iterdir()) == []


def test_one_that_has_ended_is_known_again_as_it_was_by_what_is_remembered_and_by_its_recording(
    bench: Served, tmp_path: Path
) -> None:
    told: list[EndedJob] = []
    with connect(bench.url) as connected:
        drives = {"x": Known(bench.url, Connected(connected))}
        first = Experiments(tmp_path, tmp_path / "control", drives, Leases(), told.append)
        asked = first.ask("x", {"holds": [asdict(hold) for hold in HOLDS], "step": 0.3, "machine": {"n_p": 4}})
        until(lambda: first.one("x", asked.id).state is not State_.RUNNING, "its end")
        done = first.one("x", asked.id)
    assert done.state is State_.DONE
    (recording,) = Shelf(tmp_path).all()
    again = Experiments(tmp_path, tmp_path / "control", drives, Leases())
    assert again.unknown([recording]) == [recording]
    again.remember(sensible(of_recording, [recording.path, tmp_path / "none"]))
    assert again.all("x") == [done]
    assert again.unknown([recording]) == []
    again.remember(sensible(of_ended, told))
    assert again.all("x") == [of_ended(told[0])] == [done]
    strange = replace(told[0], id="x-experiment-0", request={})
    again.remember(sensible(of_ended, [strange]))
    assert again.all("x") == [done]


@dataclass
class Connected:
    """A link to a drive that is there."""

    to: Drive

    def drive(self) -> Drive:
        return self.to
