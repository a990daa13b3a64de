"""Who writes to a drive: one at a time, until a time that is told."""

from datetime import UTC, datetime, timedelta

import pytest

from bench.errors import ConflictError
from bench.lease import Lease
from tests.served_drive import until


def test_one_writes_and_the_other_is_told_who_and_until_when() -> None:
    lease = Lease("spindle")
    assert lease.writer is None
    lease.take("capture a", 30.0)
    writer = lease.writer
    assert writer is not None
    assert writer.holder == "capture a"
    assert timedelta(seconds=29) < writer.until - datetime.now(UTC) <= timedelta(seconds=30)
    with pytest.raises(ConflictError) as refused:
        lease.take("capture b", 1.0)
    assert str(refused.value) == (
        f"drive spindle takes one writer at a time, and capture a holds it until {writer.until:%H:%M:%S} UTC "
        "at the latest"
    )
    lease.release("capture b")  # it is not its own
    assert lease.writer == writer
    lease.release("capture a")
    lease.take("capture b", 1.0)


def test_who_writes_may_do_so_for_longer_and_a_lease_that_is_not_renewed_ends_by_itself() -> None:
    lease = Lease("spindle")
    lease.take("a", 60.0)
    lease.take("a", 0.05)
    until(lambda: lease.writer is None, "the lease to end")
    lease.take("b", 60.0)
    with pytest.raises(ConflictError, match="and b holds it"):
        lease.take("a", 60.0)
