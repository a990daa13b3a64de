"""The node's side of the bus, frame by frame: SDO, NMT, heartbeat and PDOs by CiA 301."""

import io
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import can
import pytest
from canopen.objectdictionary import import_od
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.dictionary import CAPTURE_DATA, CONTROL, WATCHDOG_LAYOUT, signals_of
from emulator.drive.virtual_drive import VirtualDrive
from emulator.errors import BusError
from emulator.scenario.scenarios import PAPER, Scenario
from emulator.servers.canopen.objects import NodeObjects
from emulator.servers.canopen.server import CanopenNode
from tests.support.served_drive import PATIENCE, until, virtual_url

pytestmark = pytest.mark.live


class Wire:
    """A node and the bare frames between it and a tester."""

    def __init__(self, scenario: Scenario = PAPER) -> None:
        url = parse_can_url(virtual_url())
        self.bus = can.Bus(interface="virtual", channel=url.channel)
        self.drive = VirtualDrive(scenario)
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

    def operate(self) -> None:
        """Operational; rows that begin from now on are sent."""
        self.nmt(1)
        self.in_state(od.STATE_OPERATIONAL)
        assert self.run(0) == []

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


@pytest.mark.parametrize(
    ("limits", "emergency", "register"),
    [
        ({"overvoltage_trip": 300.0}, "1032050000000000", "4f01100005000000"),
        ({"undervoltage_trip": 320.0}, "2032050000000000", "4f01100005000000"),
        ({"speed_error_trip": 10.0, "speed_error_time": 1e-3}, "0084210000000000", "4f01100021000000"),
    ],
    ids=["overvoltage", "undervoltage", "following error"],
)
def test_a_protection_is_told_by_an_emergency_an_error_register_and_an_error_code(
    limits: dict[str, float], emergency: str, register: str
) -> None:
    wire = Wire(replace(PAPER, drive=replace(PAPER.drive, **limits)))
    try:
        assert wire.next() == (0x705, b"\x00")
        wire.drive.write("speed_control", 1.0)  # at 0 rad/s, on a dynamometer that turns
        assert wire.run(300) == [(0x085, bytes.fromhex(emergency))]
        assert wire.sdo("4001100000000000") == register
        assert wire.sdo("403f600000000000") == "4b3f6000" + emergency[:4] + "0000"
        assert wire.run(50) == []  # told once
    finally:
        wire.close()


def test_heartbeats_keep_their_pace_in_whatever_steps_time_passes(wire: Wire) -> None:
    wire.next()
    beats = [wire.drive.elapsed for _ in range(1031) if wire.run(97)]  # 10.0007 s
    assert len(beats) == 100
    assert all(0.0 <= at - 0.1 * (k + 1) < 97e-4 for k, at in enumerate(beats))


def test_a_drive_that_was_held_up_beats_once_and_not_for_all_that_it_missed(wire: Wire) -> None:
    wire.next()
    assert wire.run(3500) == [(0x705, b"\x7f")]
    assert [len(wire.run(100)) for _ in range(10)] == [0, 0, 0, 0, 1, 0, 0, 0, 0, 0]


def test_a_new_heartbeat_time_counts_from_when_it_is_set(wire: Wire) -> None:
    wire.next()
    wire.run(900)
    assert wire.sdo("2b17100032000000") == "6017100000000000"  # 50 ms
    wire.run(0)
    assert [len(wire.run(100)) for _ in range(10)] == [0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


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
        if command == 129:
            wire.in_state(od.STATE_BOOT_UP)
            assert wire.run(1000)[0] == (0x705, b"\x00")  # the drive as a whole has reset
            assert wire.drive.tick == 1000
        else:
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
        ("40001a0500000000", "43001a0500000000"),
        ("4010100000000000", "4f10100001000000"),
        ("4010100100000000", "4310100101000000"),  # stores on command
        ("4011100100000000", "4311100101000000"),
        ("2310100173617665", "6010100100000000"),  # "save"
        ("231110016c6f6164", "6011100100000000"),  # "load"
        ("4003100000000000", "4f03100000000000"),
        ("4005100000000000", "4305100080000000"),
        ("4014100000000000", "4314100085000000"),
        ("4016100100000000", "4316100100000000"),
        ("23161001e8037f00", "6016100100000000"),
        ("4041600000000000", "4b41600027000000"),  # operation enabled
        ("2b40600000000000", "6040600000000000"),
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
        ("400c100000000000", 0x06020000),  # no node guarding: neither guard time
        ("2b0c1000e8030000", 0x06020000),
        ("400d100000000000", 0x06020000),  # nor life time factor
        ("2f0d100003000000", 0x06020000),
        ("400020ff00000000", 0x06090011),  # no such sub-index
        ("4018100500000000", 0x06090011),
        ("2300200100000000", 0x06010002),  # read only
        ("2300100000000000", 0x06010002),
        ("23001a0102002160", 0x08000022),  # the mapping of a TPDO that is valid
        ("2f001a0000000000", 0x08000022),
        ("2300200401000000", 0x06070010),  # four bytes where there are two
        ("2f17100001000000", 0x06070010),
        ("2b00200403000000", 0x06090030),  # 3 periods: more frames than 1 Mbit/s carries
        ("230023020000c07f", 0x06090030),  # not a number
        ("2300230200004841", 0x06090030),  # 12.5 A
        ("2300500001000000", 0x06020000),
        ("e000200100000000", 0x05040001),  # no such command
        ("6000000000000000", 0x05040001),  # a segment of nothing
        ("a000200100000000", 0x05040002),  # a block of no segments
        ("2310100100000000", 0x08000020),  # not the word to store
        ("4003100100000000", 0x08000024),  # no error so far
        ("2f03100001000000", 0x06090030),
        ("4004180000000000", 0x06020000),  # four TPDOs
        ("4041600100000000", 0x06090011),
    ],
)
def test_what_cannot_be_is_aborted_with_the_standards_code(wire: Wire, request_: str, code: int) -> None:
    answer = bytes.fromhex(wire.sdo(request_))
    assert answer[0] == 0x80
    assert answer[1:4] == bytes.fromhex(request_)[1:4]
    assert struct.unpack("<I", answer[4:])[0] == code


NO_DATA = {CAPTURE_DATA, CONTROL, *((0x1003, k) for k in range(1, 9))}  # of a drive that nothing has happened to


def test_every_object_of_the_data_sheet_can_be_read_in_its_size_and_default() -> None:
    objects = NodeObjects(VirtualDrive(PAPER, on_links=True), 5)
    source: Any = io.StringIO(od.eds())
    source.name = "drive.eds"
    dictionary: Any = import_od(source, 5)
    for entry in dictionary.values():
        variables: list[Any] = [entry] if hasattr(entry, "data_type") else list(entry.values())
        for variable in variables:
            if (variable.index, variable.subindex) in NO_DATA:
                continue
            data = objects.get_data(variable.index, variable.subindex)
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
    wire.operate()
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


IDENTITY_ASKED = bytes.fromhex("4018100200000000")
OBJECTS = [
    (0x1800, 1), (0x1800, 2), (0x1A00, 0), (0x1A00, 1), (0x1003, 0), (0x1016, 1), (0x1017, 0), (0x6040, 0),
    (0x2400, 15),
    *((s.index, s.subindex) for s in signals_of(WATCHDOG_LAYOUT) if s.is_parameter),
]


def written(address: tuple[int, int], value: bytes) -> bytes:
    """An SDO request that writes."""
    return b"\x22" + od.sdo_address(*address) + value


def test_no_frames_whatever_end_the_node(wire: Wire) -> None:
    @settings(deadline=None)
    @given(st.lists(st.one_of(
        st.tuples(st.sampled_from([0x605, 0x000, 0x705, 0x77F, 0x080]), st.binary(max_size=8)),
        st.tuples(st.just(0x000), st.sampled_from([bytes([command, 5]) for command in (1, 2, 128, 129, 130)])),
        st.tuples(st.just(0x605), st.builds(written, st.sampled_from(OBJECTS), st.binary(min_size=4, max_size=4))),
    ), max_size=20))
    def survives(frames: list[tuple[int, bytes]]) -> None:
        for cob_id, data in frames:
            wire.node._network.notify(cob_id, bytearray(data), 0.0)  # in this thread, where an exception is seen
        wire.run(10)  # what was told to reset has reset
        for cob_id, data in ((0x000, b"\x80\x05"), (0x605, b"\x80" + bytes(7)), (0x605, IDENTITY_ASKED)):
            wire.node._network.notify(cob_id, bytearray(data), 0.0)
        while wire.next()[1].hex() != "431810024d534d50":
            pass

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
    for signal in signals_of(WATCHDOG_LAYOUT):
        size = signal.type.bits // 8
        answer = bytes.fromhex(wire.sdo((b"\x40" + od.sdo_address(signal.index, signal.subindex) + bytes(4)).hex()))
        assert answer[0] == 0x43 | (4 - size) << 2
        assert answer[1:4] == struct.pack("<HB", signal.index, signal.subindex)


# TPDOs by CiA 301: how a mapping is changed, and what is refused on the way

INVALID, VALID = "23001801850100 80".replace(" ", ""), "2300180185010000"


def test_a_mapping_is_changed_by_the_standards_procedure(wire: Wire) -> None:
    for request in (
        INVALID, "2f001a0000000000", "23001a0110004160", "23001a0210010021", "23001a0320030020", "2f001a0003000000",
        VALID,
    ):
        assert wire.sdo(request) == "60" + request[2:8] + "00000000", request
    wire.operate()
    first = next(data for cob_id, data in wire.run(20) if cob_id == 0x185)
    assert first == struct.pack("<HHI", 0x27, 0, 20)  # status word, the row's tick, the tick now


@pytest.mark.parametrize(
    ("requests", "code"),
    [
        (["2f001a0000000000"], 0x08000022),  # still valid
        ([INVALID, "23001a0110004160"], 0x08000022),  # entries are still counted
        ([INVALID, "2f001a0000000000", "23001a0110010050"], 0x06040041),  # no such object
        ([INVALID, "2f001a0000000000", "23001a0120030022"], 0x06040041),  # a parameter
        ([INVALID, "2f001a0000000000", "23001a0108010021"], 0x06040041),  # another size
        ([INVALID, "2f001a0000000000", "23001a0420030020", "2f001a0004000000"], 0x06040042),  # 80 bits
        ([INVALID, "2f001a0000000000", "2f001a0005000000"], 0x06040041),  # an entry that is none
        ([INVALID, "2f001a0000000000", "2f001a0009000000"], 0x06090030),
        ([INVALID, "2f001a0000000000", "2b001a0001000000"], 0x06070010),
        (["2300180186010000"], 0x08000022),  # another identifier while valid
        ([INVALID, "2300180105060000"], 0x06090030),  # that of an SDO
        ([INVALID, "2300180100000000"], 0x06090030),  # that of NMT
        ([INVALID, "23001801850100a0"], 0x06090030),  # of 29 bits
        (["2f00180200000000"], 0x06090030),  # synchronous but acyclic
        (["2f001802fc000000"], 0x06090030),  # on remote frames
        (["2f00180005000000"], 0x06010002),
        (["4000180300000000"], 0x06090011),
        (["40001a0900000000"], 0x06090011),
    ],
)
def test_a_mapping_that_cannot_be_is_refused(wire: Wire, requests: list[str], code: int) -> None:
    *before, last = requests
    for request in before:
        assert wire.sdo(request)[:2] == "60"
    answer = bytes.fromhex(wire.sdo(last))
    assert (answer[0], struct.unpack_from("<I", answer, 4)[0]) == (0x80, code)


def test_a_synchronous_pdo_goes_with_every_so_manieth_sync_and_is_of_one_moment(wire: Wire) -> None:
    wire.sdo("2f00180203000000")
    wire.sdo("2f01180201000000")
    wire.operate()
    frames = wire.run(100)
    assert {cob_id for cob_id, _ in frames} == {0x385, 0x485}  # the others do not go with rows any more
    for number in range(1, 7):
        wire.send(0x80, b"")
        cob_id, second = wire.next()
        if number % 3 == 0:
            assert cob_id == 0x185
            first, (cob_id, second) = second, wire.next()
            assert first[:2] == second[:2] == struct.pack("<H", 90)  # the latest row
        assert cob_id == 0x285


def test_sync_moves_nothing_before_operational(wire: Wire) -> None:
    wire.next()
    wire.sdo("2f00180201000000")
    wire.send(0x80, b"")
    assert wire.sdo("4000180200000000") == "4f00180201000000"
    wire.operate()
    wire.send(0x80, b"\x01")  # with a counter
    assert wire.next()[0] == 0x185


# Errors, the bench's heartbeat, resets


def test_a_fault_is_told_once_kept_in_the_history_and_its_end_told_too(wire: Wire) -> None:
    wire.next()
    wire.drive.write("watchdog_time", 0.01)
    frames = [frame for _ in range(5) for frame in wire.run(90)]
    assert frames == [(0x085, bytes.fromhex("3081110000000000"))]
    assert wire.sdo("4001100000000000") == "4f01100011000000"
    assert wire.sdo("4003100000000000") == "4f03100001000000"
    assert wire.sdo("4003100100000000") == "4303100130810000"
    wire.sdo("2b40600080000000")
    assert (0x085, bytes(8)) in wire.run(10)
    assert wire.sdo("4003100100000000") == "4303100130810000"
    assert wire.sdo("2f03100000000000") == "6003100000000000"
    assert wire.sdo("4003100100000000") == "8003100124000008"


def test_a_heartbeat_of_the_node_that_is_consumed_feeds_the_watchdog_and_no_other_does(wire: Wire) -> None:
    assert wire.sdo("23161001e8037f00") == "6016100100000000"
    wire.drive.write("watchdog_time", 0.05)
    heard = list[int]()
    hear = wire.drive.hear
    wire.drive.hear = lambda: (heard.append(wire.drive.tick), hear())[1]
    for k in range(10):
        wire.send(0x77F, b"\x05")
        until(lambda k=k: len(heard) == k + 1, "it is not heard")
        wire.run(400)
    assert wire.drive.read("status_word") == 0x27
    for cob_id, data in ((0x77E, b"\x05"), (0x77F, b""), (0x705, b"\x05")):
        wire.send(cob_id, data)
    wire.run(600)
    assert (wire.drive.read("status_word"), wire.drive.read("error_code")) == (0x08, 0x8130)
    assert len(heard) == 10


def test_resetting_communication_leaves_the_drive_alone_and_restores_how_it_communicates(wire: Wire) -> None:
    wire.run(500)
    wire.sdo("2b171000c8000000")
    wire.sdo("2310100173617665")  # store
    wire.sdo("2b171000f4010000")
    wire.sdo(INVALID)
    wire.nmt(130)
    until(lambda: wire.sdo("4000180100000000") == "4300180185010000", "the TPDO is not as stored")
    assert wire.sdo("4017100000000000") == "4b171000c8000000"
    wire.sdo("231110016c6f6164")  # restore
    assert wire.sdo("4017100000000000") == "4b171000c8000000"
    wire.nmt(130)
    until(lambda: wire.sdo("4017100000000000") == "4b17100064000000", "it is not as delivered")
    assert (wire.drive.tick, wire.drive.resets) == (500, 0)


def test_a_drive_that_is_reset_over_another_link_boots_on_the_bus(wire: Wire) -> None:
    wire.next()
    wire.operate()
    wire.run(100)
    wire.drive.reset()
    assert wire.run(100)[0] == (0x705, b"\x00")
    assert wire.node._state == od.STATE_PRE_OPERATIONAL


def test_node_guarding_and_29_bit_identifiers_are_not_answered(wire: Wire) -> None:
    wire.next()
    for cob_id in (0x705, 0x185, 0x605):
        wire.bus.send(can.Message(arbitration_id=cob_id, is_remote_frame=True, dlc=1, is_extended_id=False))
    read = bytes.fromhex("4018100200000000")
    wire.bus.send(can.Message(arbitration_id=0x605, data=read, is_extended_id=True))
    wire.send(0x605, bytes.fromhex("4000100000000000"))
    assert wire.next() == (0x585, bytes.fromhex("4300100092010200"))


def test_a_transfer_that_is_left_is_aborted_by_the_node(wire: Wire) -> None:
    assert wire.sdo("4008100000000000")[:2] == "41"
    frames = wire.run(30_000)
    assert (0x585, bytes.fromhex("8008100000000405")) in frames
