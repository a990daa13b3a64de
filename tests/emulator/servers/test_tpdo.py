"""When a TPDO is sent."""

import struct

import pytest

from drivers.wire import canopen_od as od
from emulator.servers.canopen.tpdo import Tpdo


def test_as_delivered_each_goes_with_rows() -> None:
    for number in range(4):
        tpdo = Tpdo.default(number, 5)
        assert tpdo.valid
        assert tpdo.on_event
        assert not tpdo.due()


@pytest.mark.parametrize("how", ["not valid", "nothing mapped"])
def test_one_that_is_not_valid_or_carries_nothing_is_not_sent(how: str) -> None:
    tpdo = Tpdo.default(0, 5)
    cob_id = tpdo.cob_id
    tpdo.set_parameter(1, struct.pack("<I", cob_id | od.NOT_VALID))
    if how == "nothing mapped":
        tpdo.set_mapping(0, b"\0")
        tpdo.set_parameter(1, struct.pack("<I", cob_id))
    tpdo.set_parameter(2, b"\1")
    assert not tpdo.valid
    assert not tpdo.due()


def test_one_of_every_third_sync_counts_them() -> None:
    tpdo = Tpdo.default(0, 5)
    tpdo.set_parameter(2, b"\3")
    assert [tpdo.due() for _ in range(7)] == [False, False, True, False, False, True, False]
