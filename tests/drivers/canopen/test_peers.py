"""Peers not written here: the canopen library's client at our node by our data sheet, and our client at its node."""

import struct
import threading
from collections.abc import Iterator
from typing import Any

import canopen
import numpy as np
import pytest
from canopen.objectdictionary import ODRecord, ODVariable

from drivers.canopen.bus import CanopenBus
from drivers.connect import connect
from drivers.errors import ConnectError
from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.dictionary import CHANNELS, signal_named
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from emulator.servers.canopen.sdo_server import SdoAbortError
from emulator.servers.canopen.server import CanopenNode
from tests.drivers.canopen.library_client import data_sheet, library_client
from tests.support.served_drive import PATIENCE, Served, first_blocks, served, until, virtual_url

pytestmark = pytest.mark.live


@pytest.fixture(scope="module")
def bench() -> Iterator[Served]:
    with served(virtual_url()) as drive:
        yield drive


@pytest.fixture
def remote(bench: Served) -> Iterator[Any]:
    """The library's own client at our node, which knows it by our data sheet alone."""
    with library_client(bench.url) as node:
        yield node


def test_it_reads_and_writes_by_the_names_of_our_data_sheet(remote: Any, bench: Served) -> None:
    assert remote.sdo["Device type"].raw == 0x00020192
    assert remote.sdo["Identity"]["Product code"].raw == 0x504D534D
    assert remote.sdo["Device name"].raw == "pmsm-bench virtual drive"  # in segments
    assert remote.sdo["Drive"]["T_s"].raw == 100_000
    assert remote.sdo["Control"]["control_R_s"].raw == pytest.approx(0.9664)
    remote.sdo["References"]["i_q_ref"].raw = 1.5
    assert bench.drive.read("i_q_ref") == 1.5
    remote.sdo["References"]["i_q_ref"].raw = 2.0
    with pytest.raises(canopen.SdoAbortedError, match="0x06010002"):
        remote.sdo.download(0x2000, 1, b"\0\0\0\0")
    with pytest.raises(canopen.SdoAbortedError, match="0x06020000"):
        remote.sdo.upload(0x7000, 0)


def test_it_walks_the_state_machine_by_the_words_of_cia_402(remote: Any) -> None:
    for word, state in ((0x00, 0x40), (0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)):
        remote.sdo["control_word"].raw = word
        until(lambda state=state: remote.sdo["status_word"].raw == state, f"never in state 0x{state:02X}")


def test_it_uploads_a_recording_by_blocks_with_a_checksum(remote: Any, bench: Served) -> None:
    recorder = remote.sdo["Recorder"]
    recorder["capture_channel_1"].raw = CHANNELS.index("theta_e")
    recorder["capture_channel_2"].raw = CHANNELS.index("i_q")
    recorder["capture_length"].raw = 1500
    recorder["capture_command"].raw = 1
    until(lambda: recorder["capture_state"].raw == 1, "it is not armed")
    recorder["capture_command"].raw = 2
    until(lambda: recorder["capture_state"].raw == 3, "it is not done")
    with remote.sdo.open(0x2410, 1, "rb", buffering=0, block_transfer=True) as stream:
        by_block = stream.readall()
    assert len(by_block) == 6000
    assert by_block == bench.drive.captured(0, 1500)
    assert remote.sdo.upload(0x2410, 1) == by_block  # and in segments
    assert np.ptp(np.frombuffer(by_block, "<i2")[1::2]) > 100


def test_it_downloads_by_blocks_and_in_segments(remote: Any, bench: Served) -> None:
    signal = signal_named("bandwidth")
    for value, options in ((800.0, {"block_transfer": True}), (900.0, {"force_segment": True})):
        with remote.sdo.open(signal.index, signal.subindex, "wb", buffering=7, size=4, **options) as stream:
            stream.write(struct.pack("<f", value))
        assert bench.drive.read("bandwidth") == value
    remote.sdo["Control"]["bandwidth"].raw = 1250.0


def test_it_reads_our_pdos_as_their_mapping_says(remote: Any) -> None:
    remote.tpdo.read()
    names = [[variable.name for variable in remote.tpdo[k]] for k in (1, 2, 3, 4)]
    assert [[name.split(".")[1] for name in pdo] for pdo in names] == [
        [signal.name for signal in layout] for layout in od.TPDO_LAYOUT
    ]
    remote.nmt.state = "OPERATIONAL"
    try:
        assert remote.tpdo[1].wait_for_reception(PATIENCE) is not None
        ticks = {remote.tpdo[k]["Stream.row_tick"].raw for k in (1, 2, 3)}
        assert max(ticks) - min(ticks) < 5000
        assert remote.tpdo[3].wait_for_reception(PATIENCE) is not None
        assert remote.tpdo[3]["Stream.u_dc"].raw == round(310.0 / 387.5 * 32768)
    finally:
        remote.nmt.state = "PRE-OPERATIONAL"


def test_it_sees_the_states_of_nmt_in_our_heartbeats_and_our_boot_up(remote: Any) -> None:
    for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"):
        remote.nmt.state = state
        until(lambda state=state: remote.nmt.wait_for_heartbeat(PATIENCE) == state, f"never {state}")
    boot = threading.Event()

    def heard(state: int) -> None:
        if state == od.STATE_BOOT_UP:
            boot.set()

    remote.nmt.add_heartbeat_callback(heard)
    remote.nmt.send_command(0x82)
    assert boot.wait(PATIENCE)


def test_it_maps_our_pdo_anew_and_has_it_with_every_second_sync(remote: Any, bench: Served) -> None:
    remote.tpdo.read()
    pdo = remote.tpdo[4]
    pdo.clear()
    for name in ("row_tick", "temp_winding"):
        pdo.add_variable("Stream", name)
    pdo.add_variable("status_word")
    pdo.trans_type = 2
    pdo.save()
    heard = list[bytes]()

    def keep(message: Any) -> None:
        heard.append(bytes(message.data))

    pdo.add_callback(keep)
    remote.nmt.state = "OPERATIONAL"
    until(lambda: bench.server._state == od.STATE_OPERATIONAL, "it is not operational")
    try:
        for number in range(1, 7):
            remote.network.sync.transmit()
            until(lambda number=number: len(heard) == number // 2, f"{len(heard)} after {number} SYNCs")
        assert {data[2:] for data in heard} == {struct.pack("<hH", 2340, 0x27)}
    finally:
        remote.nmt.send_command(0x82)
    until(lambda: remote.sdo[0x1A03][0].raw == 3, "communication as delivered")
    assert remote.sdo[0x1A03][2].raw == 0x2100_0B_10


def test_it_hears_of_a_fault_and_its_end_and_reads_the_history(remote: Any, bench: Served) -> None:
    told = list[Any]()
    remote.emcy.add_callback(told.append)
    bench.drive.write("watchdog_time", 0.01)
    until(lambda: len(told) == 1, "no emergency message")
    assert (told[0].code, told[0].register) == (0x8130, 0x11)
    bench.drive.write("watchdog_time", 0.0)
    assert remote.sdo["Error register"].raw == 0x11
    assert remote.sdo["Pre-defined error field"][0].raw == 1
    assert remote.sdo["Pre-defined error field"][1].raw == 0x8130
    remote.sdo["Pre-defined error field"][0].raw = 0
    assert remote.sdo["Pre-defined error field"][0].raw == 0
    for word in (0x80, 0x06, 0x0F):
        remote.sdo["control_word"].raw = word
    until(lambda: len(told) == 2, "no message that it is over")
    assert (told[1].code, told[1].register) == (0x0000, 0x00)
    assert remote.sdo["Error register"].raw == 0


# Our client at the library's own node


@pytest.fixture
def other() -> Iterator[tuple[str, Any]]:
    """A bus with a network of the library on it."""
    url = virtual_url()
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(interface="virtual", channel=parse_can_url(url).channel)
    yield url, network
    network.disconnect()


def plain_node() -> Any:
    """What every CANopen device has, and nothing else."""
    dictionary = canopen.ObjectDictionary()
    record: Any = ODRecord("Identity", 0x1018)
    for subindex in range(5):
        record.add_member(ODVariable("", 0x1018, subindex))
        record[subindex].data_type = 0x07
        record[subindex].default = subindex
    dictionary.add_object(record)
    return canopen.LocalNode(5, dictionary)


def drive_like_node(**changed: int) -> Any:
    """The library's node by our data sheet, with some objects of another value."""
    node: Any = canopen.LocalNode(5, data_sheet())
    node.sdo["Drive"]["layout_id"].raw = changed.get("layout", VirtualDrive(PAPER).read("layout_id"))
    for name in ("i_full", "u_full", "omega_full"):
        node.sdo["Full scales"][name].raw = 1.0
    node.sdo["Drive"]["T_s"].raw = 100_000
    node.sdo["Identity"]["Serial number"].raw = 7
    node.sdo["error_code"].raw = 0
    for name, value in changed.items():
        if name != "layout":
            index, subindex = (int(part, 16) for part in name.lstrip("x").split("_"))
            node.sdo[index][subindex].raw = value
    return node


def test_our_client_says_that_a_node_is_no_such_drive(other: tuple[str, Any]) -> None:
    url, network = other
    network.add_node(plain_node())
    with pytest.raises(ConnectError, match=r"node 5 on virtual \w+ is no such drive: it has no device name"):
        connect(url)


def test_our_client_writes_nothing_to_a_node_of_another_layout(other: tuple[str, Any]) -> None:
    url, network = other
    node = network.add_node(drive_like_node(layout=1, x1800_1=0x1A5))
    sentence = r"'pmsm-bench virtual drive'\) has another signal layout: expected 0x\w+, 0x\w+ or 0x\w+, got 0x00000001"
    with pytest.raises(ConnectError, match=sentence):
        connect(url)
    assert node.sdo[0x1800][1].raw == 0x1A5


@pytest.mark.parametrize(
    "changed",
    [{"x1800_1": 0x1A5}, {"x1802_1": 0x8000_0385}, {"x1801_2": 1}, {"x1A01_0": 2}, {"x1A00_4": 0x60410010},
     {"x1A03_1": 0x20FF0110}],
    ids=lambda changed: next(iter(changed)),
)
def test_our_client_sets_up_a_stream_that_is_another(other: tuple[str, Any], changed: dict[str, int]) -> None:
    url, network = other
    node = network.add_node(drive_like_node(**changed))
    with connect(url):
        pass
    for number, cob_id in enumerate((0x185, 0x285, 0x385, 0x485)):
        assert (node.sdo[0x1800 + number][1].raw, node.sdo[0x1800 + number][2].raw) == (cob_id, 254)
        mapping = tuple(node.sdo[0x1A00 + number][k].raw for k in range(1, node.sdo[0x1A00 + number][0].raw + 1))
        assert mapping == od.tpdo_mapping(number)


class Stubborn(CanopenNode):
    """A node whose mapping is fixed, and another."""

    def set_data(self, index: int, subindex: int, data: bytes) -> None:
        if index >= 0x1A00 and index < 0x1B00:
            raise SdoAbortError(od.Abort.READ_ONLY)
        super().set_data(index, subindex, data)


def test_our_client_says_what_cannot_be_set_up() -> None:
    url = virtual_url()
    with Stubborn(VirtualDrive(PAPER), parse_can_url(url)) as node:
        node._objects.communication.tpdos[1].count = 2
        with pytest.raises(ConnectError, match=(
            r"node 5 on virtual \w+ has TPDO 2 under 0x285, of transmission type 254, with row_tick omega_e, expected "
            r"0x285, 254 and row_tick omega_e u_d u_q, and cannot be set up so: "
            r"node 5 .* answered SDO abort 0x06010002 to 0x1A01:0"
        )):
            connect(url)


def test_our_client_streams_from_a_node_that_was_mapped_otherwise(bench: Served) -> None:
    tpdo = bench.server._objects.communication.tpdos[0]
    tpdo.entries[2], tpdo.transmission = tpdo.entries[3], 7
    with connect(bench.url) as drive:
        assert len(first_blocks(drive, 20)) > 0
    assert (tpdo.mapping[3][3], tpdo.transmission) == (0x21, od.ON_EVENT)


def test_our_client_reads_a_node_of_the_library_that_is_such_a_drive(other: tuple[str, Any]) -> None:
    url, network = other
    node = network.add_node(drive_like_node())
    with connect(url) as drive:
        assert (drive.identity.serial, drive.identity.u_full) == (7, 1.0)
        drive.write("i_q_ref", 2.5)
        assert node.sdo["References"]["i_q_ref"].raw == 2.5
        assert node.sdo[0x1016][1].raw == 127 << 16 | 500  # and has it listen to the bench's heartbeats


class Shelf(CanopenNode):
    """A node that has something long to be written."""

    held = b""

    def set_data(self, index: int, subindex: int, data: bytes) -> None:
        if (index, subindex) == (0x5000, 1):
            self.held = data
        else:
            super().set_data(index, subindex, data)


@pytest.mark.parametrize("size", [5, 889, 5000])
def test_our_client_downloads_what_is_long_by_blocks(size: int) -> None:
    url, data = parse_can_url(virtual_url()), (bytes(range(251)) * 20)[:size]
    with Shelf(VirtualDrive(PAPER), url) as node:
        bus = CanopenBus(url)
        try:
            bus.write(0x5000, 1, "something long", data)
        finally:
            bus.close()
        assert node.held == data
