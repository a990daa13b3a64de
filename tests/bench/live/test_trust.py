"""Which live estimates may be called ok: not those of old rows, nor those of equations that do not fit."""

import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from bench.config import Config, DriveConfig
from bench.live.acquisition import Failure, Link, LinkState
from bench.live.estimation import Snapshot
from bench.live.trust import STALE, trusted
from bench.live.watch import Explained, Mismatch
from bench.live.window import Window
from bench.service.service import Service
from estimator.online.estimate import Estimate, Status, WindowEstimate
from tests.support.served_drive import served, tcp_url, until

ESTIMATES = {
    "R_s": Estimate("R_s", 0.97, 0.01, "ohm", Status.OK),
    "L_d": Estimate("L_d", 4.2e-3, 1e-5, "H", Status.OK),
    "L_q": Estimate("L_q", None, None, "H", Status.NOT_TOLD, "L_q cannot be told here"),
    "psi_f": Estimate("psi_f", 0.12, None, "Vs", Status.HELD, "held at the given value"),
}
RESULT = WindowEstimate(ESTIMATES, 1000, 0, 2000, True, 2.0, 0.1)


def snapshot_of(age: float = 0.05) -> Snapshot:
    return Snapshot(Window(), RESULT, received=time.monotonic() - age, t_drive=12.0)


def link_of(state: LinkState = LinkState.STREAMING, age: float = 0.05, error: str = "") -> Link:
    failure = Failure(error, datetime.now(UTC)) if error else None
    return Link(state, datetime.now(UTC), last_error=failure, made=time.monotonic() - age, t_drive=12.0)


def statuses(snapshot: Snapshot) -> list[str]:
    return [estimate.status.value for estimate in snapshot.result.estimates.values()]


def test_estimates_of_new_rows_stay_as_they_are() -> None:
    said = trusted(snapshot_of(), link_of())
    assert said.stale is None
    assert said.result.estimates == ESTIMATES


@pytest.mark.parametrize(
    ("lacking", "link_age", "error", "why"),
    [
        ((), 2.0, "node 5 fell silent", "the link is lost: node 5 fell silent"),
        ((), 2.0, "the drive has reset", "the link is lost: the drive has reset"),
        (("u_d", "u_q"), 0.05, "", "no voltage is known: the bridge is off, or the drive is in fault"),
        (("omega_e",), 0.05, "", "omega_e of the drive's rows are no numbers"),
        ((), 2.0, "", "no row has come for 2.0 s, though the link stands"),
        ((), 0.05, "", "the estimation is behind the stream"),
    ],
    ids=["lost", "reset", "off", "no numbers", "silent", "behind"],
)
def test_what_was_estimated_from_old_rows_is_stale_since_then_and_says_why(
    lacking: tuple[str, ...], link_age: float, error: str, why: str
) -> None:
    link = link_of(LinkState.LOST if error else LinkState.STREAMING, link_age, error)
    said = trusted(replace(snapshot_of(2.0), lacking=lacking), link)
    assert statuses(said) == ["stale", "stale", "not_told", "held"]
    assert said.stale is not None
    assert abs(datetime.now(UTC) - said.stale.since - timedelta(seconds=2.0)) < timedelta(seconds=0.5)
    for name in ("R_s", "L_d"):
        e = said.result.estimates[name]
        assert (e.value, e.std) == (ESTIMATES[name].value, ESTIMATES[name].std)
        assert e.reason == why


def test_what_the_drive_says_of_its_state_stands_in_the_reason() -> None:
    off = replace(snapshot_of(2.0), lacking=("u_d", "u_q"))
    said = trusted(off, link_of(), "the drive is in fault 0x2310, overcurrent")
    assert said.result.estimates["R_s"].reason == "no voltage is known: the drive is in fault 0x2310, overcurrent"


def test_rows_that_are_old_when_they_come_are_old() -> None:
    now = time.monotonic()
    link = Link(LinkState.STREAMING, datetime.now(UTC), made=now - 3.25, arrivals=((now, 10),), t_drive=12.0)
    said = trusted(snapshot_of(3.25), link)
    assert said.age == pytest.approx(3.25, abs=0.2)
    assert statuses(said) == ["stale", "stale", "not_told", "held"]
    assert said.result.estimates["R_s"].reason == "the stream lags by 3.2 s"


def test_beside_an_unexplained_mismatch_nothing_is_ok() -> None:
    mismatch = Mismatch(Explained.NO, datetime.now(UTC), where="mostly on q")
    said = trusted(replace(snapshot_of(), mismatch=mismatch), link_of())
    assert statuses(said) == ["doubtful", "doubtful", "not_told", "held"]
    assert said.result.estimates["R_s"].reason == "the model does not explain the drive: mostly on q"
    old = trusted(replace(snapshot_of(2.0), mismatch=mismatch), link_of())
    assert statuses(old) == ["stale", "stale", "not_told", "held"]
    assert old.result.estimates["R_s"].reason.endswith(
        "it was doubtful: the model does not explain the drive: mostly on q"
    )


def test_beside_a_parameter_that_no_motor_has_nothing_is_ok() -> None:
    said = trusted(replace(snapshot_of(), result=replace(RESULT, impossible=("L_q",))), link_of())
    assert statuses(said) == ["doubtful", "doubtful", "not_told", "held"]
    assert said.result.estimates["L_d"].reason.startswith("L_q of the same fit come out as no motor has them")
    large = {**ESTIMATES, "L_d": replace(ESTIMATES["L_d"], value=1.5)}
    said = trusted(replace(snapshot_of(), result=replace(RESULT, estimates=large, impossible=("L_d",))), link_of())
    assert said.result.estimates["L_d"].reason.startswith("no motor has it, expected 1e-07 to 1 H")


@pytest.mark.live
def test_a_drive_whose_bridge_is_off_streams_and_has_no_estimate_that_is_ok() -> None:
    with served(tcp_url()) as drive, Service(Config((DriveConfig("a", drive.url, Window()),))) as service:

        def told() -> set[str]:
            return set(statuses(service.estimates("a")))

        until(lambda: told() == {"ok"}, "estimates")
        service.write_signals("a", {"control_word": 0})
        until(lambda: "u_d" in service.estimates("a").lacking, "the bridge to be off")
        began = time.monotonic()
        until(lambda: "ok" not in told(), "the estimates to be stale")
        assert time.monotonic() - began < STALE + 0.2
        assert service.link("a").state is LinkState.STREAMING
        e = service.estimates("a").result.estimates["R_s"]
        assert e.status is Status.STALE
        assert e.reason in (
            "no voltage is known: the drive is off (switch on disabled)",
            "no voltage is known: the bridge is off, or the drive is in fault",  # its state has not been asked for yet
        )
