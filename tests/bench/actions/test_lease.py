"""Who writes to a drive: one at a time, until a time that is told."""

from datetime import UTC, datetime, timedelta

import pytest

from bench.actions.safety.lease import Change, Leases, Part
from bench.errors import ConflictError
from tests.support.served_drive import until

pytestmark = pytest.mark.live


def test_one_writes_and_the_other_is_told_who_and_until_when() -> None:
    leases = Leases()
    assert leases.writer("spindle") is None
    leases.take("spindle", "capture a", 30.0, Part.CONTROL)
    writer = leases.writer("spindle")
    assert writer is not None
    assert writer.holder == "capture a"
    assert timedelta(seconds=29) < writer.until - datetime.now(UTC) <= timedelta(seconds=30)
    with pytest.raises(ConflictError) as refused:
        leases.take("spindle", "capture b", 1.0, Part.CONTROL)
    assert str(refused.value) == (
        f"drive spindle takes one writer at a time, and capture a holds it until {writer.until:%H:%M:%S} UTC "
        "at the latest"
    )
    leases.release("spindle", "capture b")  # it is not its own
    assert leases.writer("spindle") == writer
    leases.release("spindle", "capture a")
    leases.take("spindle", "capture b", 1.0, Part.CONTROL)


def test_who_writes_may_do_so_for_longer_and_a_lease_that_is_not_renewed_ends_by_itself() -> None:
    leases = Leases()
    leases.take("spindle", "a", 60.0, Part.CONTROL)
    leases.take("spindle", "a", 0.05, Part.CONTROL)
    until(lambda: leases.writer("spindle") is None, "the lease to end")
    leases.take("spindle", "b", 60.0, Part.CONTROL)
    with pytest.raises(ConflictError, match="and b holds it"):
        leases.take("spindle", "a", 60.0, Part.CONTROL)


def test_who_begins_and_who_ends_is_told_but_for_a_moments() -> None:
    told: list[Change] = []
    leases = Leases(on_change=told.append)
    leases.take("spindle", "a", 60.0, *Part)
    leases.take("spindle", "a", 60.0, *Part)  # renewed
    leases.release("spindle", "a", "done")
    leases.take("spindle", "a write", 60.0, Part.CONTROL, momentary=True)
    leases.release("spindle", "a write")
    leases.take("spindle", "b", 0.0, Part.CONTROL)
    leases.take("spindle", "c", 60.0, Part.CONTROL)
    leases.release("spindle", "c")
    assert [(one.part.value, one.holder, one.how) for one in told] == [
        ("control", "a", ""), ("recorder", "a", ""), ("control", "a", "done"), ("recorder", "a", "done"),
        ("control", "b", ""), ("control", "b", "it was not renewed"), ("control", "c", ""),
        ("control", "c", "given up"),
    ]  # fmt: skip
    assert [one.at for one in told] == sorted(one.at for one in told)


def test_two_names_of_one_device_share_its_lease_and_those_of_which_nothing_is_known_do_not() -> None:
    device = {"a": 7, "b": 7, "c": 8, "d": None, "e": None}
    leases = Leases(device.get)
    leases.take("a", "capture a", 60.0, Part.CONTROL)
    with pytest.raises(ConflictError, match="drive b takes one writer at a time, and capture a holds it"):
        leases.take("b", "capture b", 60.0, Part.CONTROL)
    assert leases.writer("b") == leases.writer("a")
    for name in "cde":
        leases.take(name, f"capture {name}", 60.0, Part.CONTROL)
    leases.release("a", "capture a")
    leases.take("b", "capture b", 60.0, Part.CONTROL)


def test_a_drives_recorder_is_a_lease_of_its_own() -> None:
    leases = Leases()
    leases.take("a", "capture a", 60.0, Part.RECORDER)
    leases.take("a", "the step that it waits for", 60.0, Part.CONTROL)
    with pytest.raises(ConflictError, match="drive a takes one writer at a time, and the step that it waits for"):
        leases.take("a", "experiment b", 60.0, *Part)
    leases.release("a", "the step that it waits for")
    with pytest.raises(ConflictError, match="drive a's recorder takes one writer at a time, and capture a holds it"):
        leases.take("a", "experiment b", 60.0, *Part)
    assert leases.writer("a") is None
