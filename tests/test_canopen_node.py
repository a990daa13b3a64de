"""The node's side of the bus, frame by frame: SDO, NMT, heartbeat and PDOs by CiA 301."""

import io
import struct
from collections.abc import Iterator
from typing import Any

import can
import pytest
from canopen.objectdictionary import import_od
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.dictionary import SIGNALS
from emulator.canopen_server import CanopenNode
from emulator.scenarios import PAPER
from emulator.socketcand import BusError
from emulator.virtual_drive import VirtualDrive
from tests.served_drive import PATIENCE, until, virtual_url


class Wire:
    """A node and the bare frames between it and a tester."""

    def __init__(self) -> None:
        url = parse_can_url(virtual_url())
        self.bus = can.Bus(interface="virtual", channel=url.channel)
        self.drive = VirtualDrive(PAPER)
        self.node = CanopenNode(self.drive, url)

    def close(self) -> None:
        self.node.close()
        self.bus.shutdown()

    def send(self, cob_id: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def next(self) -> tuple[int, bytes]:
        message = self.bus.recv(PATIENCE)
        assert message is not None, "nothing came"
        return message.arbitration_id, bytes(message.data)

    def sdo(self, request: str) -> str:
        """The answer to an SDO request, both in hexadecimal."""
        self.send(0x605, bytes.fromhex(request))
        while (frame := self.next())[0] != 0x585:
            pass
        return frame[1].hex()

    def nmt(self, command: int, node: int = 5) -> None:
        self.send(0, bytes([command, node]))

    def run(self, periods: int) -> list[tuple[int, bytes]]:
        """What comes while time passes."""
        self.node.publish(self.drive.run(periods))
        frames = list[tuple[int, bytes]]()
        while (message := self.bus.recv(0.0)) is not None:
            frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def in_state(self, state: int) -> None:
        until(lambda: self.node._state == state, f"never in state {state}")


@pytest.fixture
def wire() -> Iterator[Wire]:
    bare = Wire()
    yield bare
    bare.close()


def test_a_node_boots_into_pre_operational_and_beats_ten_times_a_second(wire: Wire) -> None:
    assert wire.next() == (0x705, b"\x00")
    beats = [frame for _ in range(10) for frame in wire.run(1000)]
    assert beats == [(0x705, b"\x7f")] * 10


@pytest.mark.parametrize(("command", "state"), [(1, 5), (2, 4), (128, 127)])
@pytest.mark.parametrize("node", [0, 5])
def test_nmt_commands_to_this_node_or_all_change_its_state(wire: Wire, command: int, state: int, node: int) -> None:
    wire.nmt(command, node)
    wire.in_state(state)
    assert (0x705, bytes([state])) in wire.run(1000)


def test_nmt_commands_to_others_or_of_the_wrong_length_are_ignored(wire: Wire) -> None:
    for data in (b"\x01\x06", b"\x01", b"", b"\x01\x05\x00", b"\x07\x05"):
        wire.send(0, data)
    assert wire.sdo("4000100000000000").startswith("43001000")
    assert wire.node._state == od.STATE_PRE_OPERATIONAL


def test_the_order_to_reset_is_followed_by_the_boot_up_message(wire: Wire) -> None:
    assert wire.next() == (0x705, b"\x00")
    for command in (129, 130):
        wire.nmt(1)
        wire.in_state(od.STATE_OPERATIONAL)
        wire.nmt(command)
        assert wire.next() == (0x705, b"\x00")
        wire.in_state(od.STATE_PRE_OPERATIONAL)


def test_a_stopped_node_answers_no_sdo_until_it_is_woken(wire: Wire) -> None:
    wire.nmt(2)
    wire.in_state(od.STATE_STOPPED)
    wire.send(0x605, bytes.fromhex("4000100000000000"))
    wire.nmt(128)
    wire.in_state(od.STATE_PRE_OPERATIONAL)
    assert wire.sdo("4017100000000000") == "4b17100064000000"


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("4000100000000000", "4300100092010200"),  # device type: 402, servo
        ("4001100000000000", "4f01100000000000"),  # no error
        ("4017100000000000", "4b17100064000000"),  # heartbeat: 100 ms
        ("4018100000000000", "4f18100004000000"),
        ("4018100200000000", "431810024d534d50"),  # "PMSM"
        ("4000180100000000", "4300180185010000"),  # TPDO 1: 0x185
        ("40001a0000000000", "4f001a0004000000"),
        ("40001a0200000000", "43001a0210020021"),  # theta_e
        ("4000200200000000", "43002002a0860100"),  # T_s: 100000 ns
        ("4000200400000000", "4b0020040a000000"),
        ("4000200000000000", "4f00200004000000"),
        ("2b0020040f000000", "6000200400000000"),
        ("2b171000f4010000", "6017100000000000"),
    ],
)
def test_an_sdo_request_gets_the_answer_made_by_hand(wire: Wire, request_: str, answer: str) -> None:
    assert wire.sdo(request_) == answer


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("4000400000000000", 0x06020000),  # no such object
        ("400020ff00000000", 0x06090011),  # no such sub-index
        ("4018100500000000", 0x06090011),
        ("2300200100000000", 0x06010002),  # read only
        ("2300100000000000", 0x06010002),
        ("23001a0100000000", 0x06010002),
        ("2300200401000000", 0x06070010),  # four bytes where there are two
        ("2f17100001000000", 0x06070010),
        ("2b00200404000000", 0x06090030),  # 4 periods
        ("230023020000c07f", 0x06090030),  # not a number
        ("2300230200004841", 0x06090030),  # 12.5 A
        ("2300500001000000", 0x06020000),
        ("c000200100000000", 0x05040001),  # block download
    ],
)
def test_what_cannot_be_is_aborted_with_the_standards_code(wire: Wire, request_: str, code: int) -> None:
    answer = bytes.fromhex(wire.sdo(request_))
    assert answer[0] == 0x80
    assert answer[1:4] == bytes.fromhex(request_)[1:4]
    assert struct.unpack("<I", answer[4:])[0] == code


def test_every_object_of_the_data_sheet_can_be_read_in_its_size_and_default(wire: Wire) -> None:
    source: Any = io.StringIO(od.eds())
    source.name = "drive.eds"
    dictionary: Any = import_od(source, 5)
    for entry in dictionary.values():
        variables: list[Any] = [entry] if hasattr(entry, "data_type") else list(entry.values())
        for variable in variables:
            data = wire.node.get_data(variable.index, variable.subindex)
            assert len(variable) == 8 or 8 * len(data) == len(variable), variable.name
            if variable.default is not None:
                assert variable.decode_raw(data) == variable.default, variable.name


def test_what_the_drive_itself_holds_can_always_be_read(wire: Wire) -> None:
    for value, golden in ((2**32 + 7, "07000000"), (2**32 - 1, "ffffffff")):
        wire.drive._readable["tick"] = float(value)
        assert wire.node.get_data(0x2000, 3).hex() == golden
    wire.drive._readable["control_L_d"] = 5e-7  # a scenario's motor may be smaller than what can be written
    assert struct.unpack("<f", wire.node.get_data(0x2200, 3))[0] == pytest.approx(5e-7)


def test_rows_go_out_in_operational_alone_and_the_slow_pdo_with_every_hundredth(wire: Wire) -> None:
    wire.next()
    assert [f for f in wire.run(500) if f[0] != 0x705] == []
    wire.nmt(1)
    wire.in_state(od.STATE_OPERATIONAL)
    frames = [f for f in wire.run(2000) if f[0] != 0x705]
    ids = [cob_id for cob_id, _ in frames]
    assert [ids.count(cob_id) for cob_id in (0x185, 0x285, 0x385, 0x485)] == [200, 200, 200, 2]
    assert ids[:4] == [0x185, 0x285, 0x385, 0x485]
    ticks = [struct.unpack_from("<H", data)[0] for cob_id, data in frames if cob_id == 0x385]
    assert ticks == list(range(500, 2500, 10))
    assert {data[2:].hex() for cob_id, data in frames if cob_id == 0x485} == {"24092409"}  # 23.40 degC


def test_a_heartbeat_time_of_zero_stops_it(wire: Wire) -> None:
    wire.next()
    assert wire.sdo("2b17100000000000") == "6017100000000000"
    assert wire.run(10_000) == []


def test_no_frames_whatever_end_the_node(wire: Wire) -> None:
    @settings(deadline=None)
    @given(st.lists(st.tuples(st.sampled_from([0x605, 0x605, 0x000, 0x705]), st.binary(max_size=8)), max_size=12))
    def survives(frames: list[tuple[int, bytes]]) -> None:
        for frame in frames:
            wire.send(*frame)
        wire.nmt(od.NMT_PRE_OPERATIONAL)
        wire.send(0x605, bytes.fromhex("4018100200000000"))
        while wire.next()[1].hex() != "431810024d534d50":
            pass
        wire.run(10)

    survives()


def test_a_node_whose_bus_fails_says_so_and_closes(capfd: pytest.CaptureFixture[str]) -> None:
    wire = Wire()
    wire.node.bus.shutdown()

    def told() -> bool:
        try:
            wire.run(10)
        except BusError as error:
            return "is gone: Cannot operate on a closed bus" in str(error)
        return False

    until(told, "it says nothing")
    wire.close()
    assert capfd.readouterr().err == ""


def test_every_signal_is_answered(wire: Wire) -> None:
    for signal in SIGNALS:
        size = signal.type.bits // 8
        answer = bytes.fromhex(wire.sdo((b"\x40" + od.sdo_address(signal.index, signal.subindex) + bytes(4)).hex()))
        assert answer[0] == 0x43 | (4 - size) << 2
        assert answer[1:4] == struct.pack("<HB", signal.index, signal.subindex)
