"""A bench at a drive's state machine, over a bus: enabled from every state, and told why when it cannot be."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import FaultError
from drivers.wire.cia402 import OVERTEMPERATURE_MOTOR, State
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
