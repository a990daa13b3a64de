"""A bench at a drive's state machine, over a bus: enabled from every state, and told why when it cannot be."""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive, Identity
from drivers.errors import FaultError, LostError
from drivers.wire.cia402 import OVERTEMPERATURE_MOTOR, State
from drivers.wire.dictionary import RESET_WORD
from emulator.scenario.scenarios import PAPER
from tests.support.served_drive import Served, served, until, virtual_url

pytestmark = pytest.mark.live

WORDS = {  # control words that lead from operation to a state
    State.SWITCH_ON_DISABLED: (0x00,), State.READY_TO_SWITCH_ON: (0x06,), State.SWITCHED_ON: (0x07,),
    State.OPERATION_ENABLED: (), State.QUICK_STOP_ACTIVE: (0x02,),
}


@pytest.fixture(scope="module")
def bench() -> Iterator[Served]:
    scenario = replace(PAPER, drive=replace(PAPER.drive, temperature_trip=60.0))
    with served(virtual_url(), scenario) as drive:
        yield drive


@pytest.fixture(scope="module")
def drive(bench: Served) -> Iterator[Drive]:
    with connect(bench.url) as connected:
        yield connected


@pytest.fixture(autouse=True)
def enabled(drive: Drive) -> None:
    """Each test begins in operation."""
    if operation.state(drive) is State.FAULT:
        operation.reset_fault(drive)
    operation.enable(drive)


@pytest.fixture
def hot(bench: Served, drive: Drive) -> Iterator[None]:
    """The drive is in fault: its winding is too hot."""
    bench.drive.set_temperature(70.0)
    until(lambda: operation.state(drive) is State.FAULT, "it never trips")
    yield
    bench.drive.set_temperature(30.0)
    until(lambda: bench.drive.read("temp_winding") == 30.0, "it stays hot")


@pytest.mark.parametrize("state", WORDS, ids=str)
def test_a_drive_is_enabled_from_every_state(drive: Drive, state: State) -> None:
    for word in WORDS[state]:
        drive.write("control_word", float(word))
    until(lambda: operation.state(drive) is state, f"it is not in state {state}")
    operation.enable(drive)
    assert operation.state(drive) is State.OPERATION_ENABLED


def test_a_drive_is_disabled_and_stops_quickly(drive: Drive) -> None:
    operation.quick_stop(drive)
    assert operation.state(drive) is State.QUICK_STOP_ACTIVE
    operation.disable(drive)
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    operation.disable(drive)
    operation.quick_stop(drive)
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    assert operation.fault(drive) is None


@pytest.mark.usefixtures("hot")
def test_a_drive_in_fault_is_not_enabled_and_says_why(drive: Drive) -> None:
    with pytest.raises(FaultError, match=r"the drive is in fault: motor too hot \(0x4210\)") as caught:
        operation.enable(drive)
    assert caught.value.code == OVERTEMPERATURE_MOTOR
    assert operation.fault(drive) == operation.Fault(OVERTEMPERATURE_MOTOR, "motor too hot")
    operation.disable(drive)  # its bridge is off already
    operation.quick_stop(drive)
    assert operation.state(drive) is State.FAULT


@pytest.mark.usefixtures("hot")
def test_a_fault_is_reset_once_its_cause_is_gone(bench: Served, drive: Drive) -> None:
    bench.drive.set_temperature(30.0)
    operation.reset_fault(drive)
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    assert operation.fault(drive) is None
    operation.enable(drive)


def test_parameters_are_stored_and_restored_by_the_words_of_the_standard(bench: Served, drive: Drive) -> None:
    before = drive.read("bandwidth")
    drive.write("bandwidth", 800.0)
    operation.store(drive)
    drive.write("bandwidth", 900.0)
    bench.drive.reset()
    until(lambda: bench.drive.read("bandwidth") == 800.0, "what was stored does not come back")
    operation.restore(drive)
    bench.drive.reset()
    until(lambda: bench.drive.read("bandwidth") == before, "what was delivered does not come back")


class JustUp:
    """A drive that has been up for a moment only, and whose link is lost for longer than that when it is reset."""

    def __init__(self) -> None:
        self.identity = Identity("a drive", 0, 1, 1, 1, 0, 1e-4, 20.0, 400.0, 3000.0)
        self.since, self.lost = time.monotonic() - 0.02, 0.0

    def read(self, name: str) -> float:
        assert name == "tick"
        return (time.monotonic() - self.since) / self.identity.T_s

    def write(self, name: str, value: float) -> None:
        assert (name, value) == ("reset", RESET_WORD)
        self.since = time.monotonic()
        self.lost = self.since + 0.1

    def link(self) -> Any:
        if time.monotonic() < self.lost:
            raise LostError("there is no link")
        return self


def test_a_drive_that_is_reset_soon_after_its_start_is_seen_to_have_been() -> None:
    begun, drive = time.monotonic(), JustUp()
    assert operation.reset(drive.link) is drive
    assert time.monotonic() - begun < 1.0
