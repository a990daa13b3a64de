"""CANopen over SocketCAN as an independent witness sees it, and a bus that goes down. Bytes by hand from CiA 301.

At our node are our client, frames sent by hand, and the canopen library's client. What is the same over every transport
is in test_contract. `make test-vcan` runs both where there is a vcan0.
"""

import binascii
import itertools
import re
import struct
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import pi
from typing import Any

import canopen
import pytest

from drivers.block import Block
from drivers.canopen.drive import HEARTBEAT_MISSED_MS
from drivers.connect import connect
from drivers.errors import ConnectError, LostError, RefusedError
from drivers.wire.dictionary import CHANNELS
from tests.drivers.canopen.library_client import library_client
from tests.support.served_drive import PATIENCE, first_blocks, joined, listening, until
from tests.support.transports import ServedProcess, serving, vcan_url
from tests.vcan.witness import BUS, Seen, Witness, send, witness

pytestmark = pytest.mark.vcan

URL = f"canopen://socketcan/{BUS}/5"
ROWS, ROW_TICKS = 300, 50
BEAT_ROWS = 1000 // ROW_TICKS  # in the tenth of a second between two of the node's heartbeats, by its own clock
STEP_ROWS = 500 // ROW_TICKS  # in the longest step in which the emulated drive catches up with time: 50 ms

# NMT: command and node. Boot-up and heartbeat: the state (CiA 301, 7.2.8)
PRE_OPERATIONAL, START, STOP = "000#8005", "000#0105", "000#0205"
RESET_NODE, RESET_COMMUNICATION = "000#8105", "000#8205"
BOOTED, BEAT_PRE_OPERATIONAL, BEAT_OPERATIONAL, BEAT_STOPPED = "705#00", "705#7F", "705#05", "705#04"


@dataclass(frozen=True)
class Session:
    """A session of our client with the drive: what it said and what passed."""

    seen: list[Seen]
    blocks: list[Block]
    omega_full: float

    @property
    def frames(self) -> list[str]:
        """The frames, as candump writes them."""
        return [seen.frame for seen in self.seen]

    def data(self, identifier: str) -> list[bytes]:
        """The data of every frame with an identifier."""
        return [seen.data for seen in self.seen if seen.frame.startswith(f"{identifier}#")]


@pytest.fixture(scope="module")
def log() -> Iterator[Witness]:
    """A witness from before there is a drive."""
    vcan_url()
    with witness() as seen:
        yield seen


@pytest.fixture(scope="module")
def bench(log: Witness) -> Iterator[ServedProcess]:
    with serving(URL) as served:
        yield served


@pytest.fixture(scope="module")
def session(log: Witness, bench: ServedProcess) -> Session:
    """Rest, then identity, values, a refusal, a stream; then rest again."""
    log.wait_for(BEAT_PRE_OPERATIONAL)
    with connect(bench.url) as drive:
        drive.write("i_q_ref", 1.25)
        drive.write("stream_periods", ROW_TICKS)
        with suppress(RefusedError):
            drive.write("i_q_ref", 12.5)
        blocks = first_blocks(drive, ROWS)
        omega_full = drive.identity.omega_full
    log.wait_for(BEAT_PRE_OPERATIONAL, 5, since=log.heard())
    return Session(log.frames(), blocks, omega_full)


@pytest.fixture
def by_hand(log: Witness, bench: ServedProcess) -> Witness:
    """The node without a client of ours, as it is when it has been switched on."""
    del bench
    begin = log.heard()
    send(RESET_NODE)
    log.wait_for(BOOTED, since=begin)
    return log


def test_the_first_that_a_node_sends_is_the_boot_up_message(session: Session) -> None:
    assert session.frames[0] == BOOTED
    assert session.frames.count(BOOTED) == 1


@pytest.mark.parametrize(
    ("what", "transfer"),
    [
        ("vendor", ["605#4018100100000000", "585#4318100100000000"]),
        ("product code, PMSM backwards", ["605#4018100200000000", "585#431810024D534D50"]),
        ("control period, 100000 ns", ["605#4000200200000000", "585#43002002A0860100"]),
        ("current of full scale, 24 A", ["605#4010200100000000", "585#431020010000C041"]),
        ("write 1.25 A", ["605#230023020000A03F", "585#6000230200000000"]),
        ("write 50 periods, two bytes", ["605#2B00200432000000", "585#6000200400000000"]),
        ("listen to node 127, 500 ms", ["605#23161001F4017F00", "585#6016100100000000"]),
        ("write 12.5 A, abort 0x06090030", ["605#2300230200004841", "585#8000230230000906"]),
        (
            "device name, 24 bytes in four segments",
            [
                "605#4008100000000000", "585#4108100018000000",
                "605#6000000000000000", "585#00" + b"pmsm-be".hex().upper(),
                "605#7000000000000000", "585#10" + b"nch vir".hex().upper(),
                "605#6000000000000000", "585#00" + b"tual dr".hex().upper(),
                "605#7000000000000000", "585#19" + b"ive".hex().upper() + "00000000",
            ],
        ),
    ],
)
def test_an_sdo_transfer_is_byte_by_byte_that_of_the_standard(session: Session, what: str, transfer: list[str]) -> None:
    sdo = [frame for frame in session.frames if frame.startswith(("605#", "585#"))]
    assert transfer in [sdo[k : k + len(transfer)] for k in range(len(sdo))], what


def test_a_stream_is_started_and_stopped_by_nmt(session: Session) -> None:
    commands = [frame for frame in session.frames if frame.startswith("000#")]
    assert [command for command, _ in itertools.groupby(commands)] == [PRE_OPERATIONAL, START, PRE_OPERATIONAL]
    rows = [k for k, frame in enumerate(session.frames) if frame[:4] in ("185#", "285#", "385#", "485#")]
    stopped = session.frames.index(PRE_OPERATIONAL, session.frames.index(START))
    assert session.frames.index(START) < rows[0]
    assert rows[-1] < session.frames.index(BEAT_PRE_OPERATIONAL, stopped)  # the node's own word that it has stopped


def test_every_row_that_passed_is_what_the_client_gave_out(session: Session) -> None:
    rows = dict[int, tuple[float, ...]]()
    for one, two, three in zip(session.data("185"), session.data("285"), session.data("385"), strict=True):
        tick, theta_e, i_d, i_q = struct.unpack("<HHhh", one)
        tick_2, omega_e, u_d, u_q = struct.unpack("<Hhhh", two)
        tick_3, u_dc, i_d_mean, i_q_mean = struct.unpack("<Hhhh", three)
        assert tick == tick_2 == tick_3
        A, V = 24.0 / 32768.0, 387.5 / 32768.0
        rows[tick] = (
            theta_e * 2.0 * pi / 65536.0, omega_e * session.omega_full / 32768.0, i_d * A, i_q * A, u_d * V, u_q * V,
            i_d_mean * A, i_q_mean * A, u_dc * V,
        )
    names = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")
    given = zip(*(joined(session.blocks, name) for name in names), strict=True)
    ticks = joined(session.blocks, "tick") & 0xFFFF
    assert len(ticks) >= ROWS
    passed = list(rows)
    first = passed.index(ticks[0])
    assert first <= 1  # a row that was under way at the start is not given out
    assert passed[first : first + len(ticks)] == ticks.tolist()
    for tick, values in zip(ticks.tolist(), given, strict=True):
        assert values == pytest.approx(rows[tick], rel=1e-12), tick


def test_the_slow_message_tells_the_temperatures_in_hundredths_of_a_degree(session: Session) -> None:
    assert {data[2:] for data in session.data("485")} == {struct.pack("<hh", 2340, 2340)}


def test_a_node_tells_its_state_every_tenth_of_a_second_by_its_own_clock(session: Session) -> None:
    beats = [frame for frame in session.frames if frame in (BEAT_OPERATIONAL, BEAT_PRE_OPERATIONAL)]
    assert [state for state, _ in itertools.groupby(beats)] == [
        BEAT_PRE_OPERATIONAL, BEAT_OPERATIONAL, BEAT_PRE_OPERATIONAL,
    ]
    rows, at = 0, list[int]()
    for frame in session.frames:
        rows += frame.startswith("185#")
        if frame == BEAT_OPERATIONAL:
            at.append(rows)
    assert len(at) >= (ROWS - STEP_ROWS) // BEAT_ROWS
    assert [rows - at[0] for rows in at] == [pytest.approx(k * BEAT_ROWS, abs=STEP_ROWS) for k in range(len(at))]


def test_the_bench_beats_as_an_operational_node_and_never_misses(session: Session) -> None:
    beats = [seen for seen in session.seen if seen.frame.startswith("77F#")]
    assert {seen.frame for seen in beats} == {"77F#05"}
    assert max(two.time - one.time for one, two in itertools.pairwise(beats)) < 1e-3 * HEARTBEAT_MISSED_MS


def test_the_bus_carries_nothing_else(session: Session) -> None:
    known = {"000", "185", "285", "385", "485", "585", "605", "705", "77F"}
    assert {frame.partition("#")[0] for frame in session.frames} == known


def test_a_segmented_download_is_taken_and_confirmed(by_hand: Witness) -> None:
    by_hand.ask("605#2100230204000000", "585#6000230200000000")  # i_q_ref, four bytes
    by_hand.ask("605#070000A03F000000", "585#2000000000000000")  # 1.25 A, three bytes unused, the last
    by_hand.ask("605#4000230200000000", "585#430023020000A03F")


def test_a_block_upload_is_numbered_acknowledged_and_checked(by_hand: Witness) -> None:
    by_hand.ask("605#A40810007F000000", "585#C608100018000000")  # device name, 127 segments a block; 24 bytes
    by_hand.ask(
        "605#A300000000000000",
        "585#01" + b"pmsm-be".hex().upper(), "585#02" + b"nch vir".hex().upper(), "585#03" + b"tual dr".hex().upper(),
        "585#84" + b"ive".hex().upper() + "00000000",
    )
    by_hand.ask("605#A2047F0000000000", "585#D16E190000000000")  # four bytes unused, CRC 0x196E
    send("605#A100000000000000")
    by_hand.ask("605#4018100200000000", "585#431810024D534D50")  # the end of it needs no answer


def test_a_block_download_is_acknowledged_and_checked(by_hand: Witness) -> None:
    by_hand.ask("605#C600230204000000", "585#A40023027F000000")  # i_q_ref, four bytes, with a CRC
    by_hand.ask("605#810000A03F000000", "585#A2017F0000000000")
    by_hand.ask("605#CDC2DA0000000000", "585#A100000000000000")  # three bytes unused, CRC 0xDAC2
    by_hand.ask("605#4000230200000000", "585#430023020000A03F")


def test_a_block_whose_checksum_is_wrong_is_aborted_and_nothing_is_written(by_hand: Witness) -> None:
    by_hand.ask("605#C600230204000000", "585#A40023027F000000")
    by_hand.ask("605#810000A03F000000", "585#A2017F0000000000")
    by_hand.ask("605#CDC2DB0000000000", "585#8000230204000405")  # 0x05040004
    by_hand.ask("605#4000230200000000", "585#4300230200000040")  # 2.0 A as before


def test_nmt_commands_change_the_state_that_the_next_heartbeat_tells(by_hand: Witness) -> None:
    for command, beat in ((START, BEAT_OPERATIONAL), (STOP, BEAT_STOPPED), (PRE_OPERATIONAL, BEAT_PRE_OPERATIONAL)):
        begin = by_hand.heard()
        send(command)
        by_hand.wait_for(beat, since=begin)
    begin = by_hand.heard()
    send(RESET_COMMUNICATION)
    by_hand.wait_for(BOOTED, since=begin)


def test_a_stopped_node_is_deaf_to_sdo(by_hand: Witness) -> None:
    begin = by_hand.heard()
    send(STOP)
    by_hand.wait_for(BEAT_STOPPED, since=begin)
    send("605#4018100200000000")
    by_hand.wait_for(BEAT_STOPPED, 3, since=begin)
    send(PRE_OPERATIONAL)
    by_hand.wait_for(BEAT_PRE_OPERATIONAL, since=begin)
    assert not [seen for seen in by_hand.frames(begin) if seen.frame.startswith("585#")]


def test_a_pdo_is_mapped_by_the_standards_procedure_and_sent_with_every_sync(by_hand: Witness) -> None:
    by_hand.ask("605#2300180185010080", "585#6000180100000000")  # TPDO 1: not valid
    by_hand.ask("605#2F00180201000000", "585#6000180200000000")  # with every SYNC
    by_hand.ask("605#2F001A0000000000", "585#60001A0000000000")  # no entries
    by_hand.ask("605#23001A01100B0021", "585#60001A0100000000")  # 0x2100:11, 16 bits: the winding's temperature
    by_hand.ask("605#2F001A0001000000", "585#60001A0000000000")
    by_hand.ask("605#2300180185010000", "585#6000180100000000")  # valid
    begin = by_hand.heard()
    send(START)
    by_hand.wait_for(BEAT_OPERATIONAL, since=begin)
    for _ in range(3):
        by_hand.ask("080#", "185#2409")  # 23.40 degC in hundredths
    send(PRE_OPERATIONAL)


def test_an_emergency_tells_a_fault_once_and_then_its_end(by_hand: Witness) -> None:
    by_hand.ask("605#23002306CDCC4C3E", "585#6000230600000000")  # watchdog of 0.2 s, and then silence
    begin = by_hand.heard()
    by_hand.wait_for("085#3081110000000000", since=begin)  # 0x8130; error register: generic, communication
    by_hand.ask("605#4001100000000000", "585#4F01100011000000")
    by_hand.ask("605#4003100100000000", "585#4303100130810000")  # the first in the history
    by_hand.ask("605#403F600000000000", "585#4B3F600030810000")
    by_hand.ask("605#2B40600080000000", "585#6040600000000000")  # fault reset
    by_hand.wait_for("085#0000000000000000", since=begin)
    told = [seen.frame for seen in by_hand.frames(begin)]
    assert [frame for frame in told if frame.startswith("085#")] == ["085#3081110000000000", "085#0000000000000000"]
    assert 1 <= told[: told.index("085#3081110000000000")].count(BEAT_PRE_OPERATIONAL) <= 3  # 0.2 s by its clock


@pytest.fixture
def remote(by_hand: Witness) -> Iterator[Any]:
    """The canopen library's client, which knows the node by our data sheet alone."""
    del by_hand
    with library_client(URL) as node:
        yield node


def transfers(log: Witness, since: int) -> list[str]:
    """What client and node have said to each other by SDO."""
    return [seen.frame for seen in log.frames(since) if seen.frame.startswith(("605#", "585#"))]


def test_the_librarys_client_has_values_as_they_passed(log: Witness, remote: Any) -> None:
    begin = log.heard()
    assert remote.sdo["Identity"]["Product code"].raw == 0x504D534D
    remote.sdo["References"]["i_q_ref"].raw = 1.25
    with pytest.raises(canopen.SdoAbortedError, match="0x06020000"):
        remote.sdo.upload(0x7000, 0)
    assert transfers(log, begin) == [
        "605#4018100200000000", "585#431810024D534D50",
        "605#230023020000A03F", "585#6000230200000000",
        "605#4000700000000000", "585#8000700000000206",
    ]


def test_the_librarys_client_uploads_a_block_as_it_passed(log: Witness, remote: Any) -> None:
    begin = log.heard()
    with remote.sdo.open(0x1008, 0, "rb", buffering=0, block_transfer=True) as stream:
        assert stream.readall() == b"pmsm-bench virtual drive"
    assert transfers(log, begin) == [
        "605#A40810007F000000", "585#C608100018000000", "605#A300000000000000",
        "585#01" + b"pmsm-be".hex().upper(), "585#02" + b"nch vir".hex().upper(), "585#03" + b"tual dr".hex().upper(),
        "585#84" + b"ive".hex().upper() + "00000000",
        "605#A2047F0000000000", "585#D16E190000000000", "605#A100000000000000",
    ]


def test_the_librarys_client_uploads_a_recording_of_many_blocks_as_it_passed(log: Witness, remote: Any) -> None:
    recorder = remote.sdo["Recorder"]
    recorder["capture_channel_1"].raw = CHANNELS.index("theta_e")
    recorder["capture_channel_2"].raw = CHANNELS.index("i_q")
    recorder["capture_length"].raw = 1500
    recorder["capture_command"].raw = 1
    until(lambda: recorder["capture_state"].raw == 1, "it is not armed")
    recorder["capture_command"].raw = 2
    until(lambda: recorder["capture_state"].raw == 3, "it is not done")
    begin = log.heard()
    with remote.sdo.open(0x2410, 1, "rb", buffering=0, block_transfer=True) as stream:
        recording = stream.readall()
    passed = transfers(log, begin)
    said = [frame for frame in passed if frame.startswith("605#")]
    first, *segments, last = (bytes.fromhex(frame[4:]) for frame in passed if frame.startswith("585#"))
    assert first.hex() == "c610240170170000"  # 6000 bytes
    assert [segment[0] for segment in segments] == [*(k % 127 + 1 for k in range(857)), 0x80 | 96]
    assert b"".join(segment[1:] for segment in segments)[:6000] == recording
    assert last == struct.pack("<BH5x", 0xC1 | 6 << 2, binascii.crc_hqx(recording, 0))  # six bytes unused
    acknowledged = [*["605#A27F7F0000000000"] * 6, "605#A2607F0000000000"]
    assert said == ["605#A41024017F000000", "605#A300000000000000", *acknowledged, "605#A100000000000000"]


def test_the_librarys_client_downloads_a_block_as_it_passed(log: Witness, remote: Any) -> None:
    begin = log.heard()
    with remote.sdo.open(0x2300, 2, "wb", buffering=7, size=4, block_transfer=True) as stream:
        stream.write(bytes.fromhex("0000A03F"))  # 1.25 A
    assert transfers(log, begin) == [
        "605#C600230204000000", "585#A40023027F000000",
        "605#810000A03F000000", "585#A2017F0000000000",
        "605#CDC2DA0000000000", "585#A100000000000000",
    ]
    assert remote.sdo["References"]["i_q_ref"].raw == 1.25


def test_the_librarys_client_reads_pdos_as_they_passed(log: Witness, remote: Any) -> None:
    layouts = {0x185: "<HHhh", 0x285: "<Hhhh", 0x385: "<Hhhh", 0x485: "<Hhh"}
    heard = list[tuple[int, tuple[int, ...]]]()

    def keep(pdo: Any) -> None:
        heard.append((pdo.cob_id, tuple(variable.raw for variable in pdo)))

    remote.tpdo.read()
    for number in (1, 2, 3, 4):
        remote.tpdo[number].add_callback(keep)
    remote.sdo[0x2000][4].raw = ROW_TICKS
    begin = log.heard()
    remote.nmt.state = "OPERATIONAL"
    until(lambda: len({identifier for identifier, _ in heard}) == 4 and len(heard) > 100, "no PDOs")
    remote.nmt.state = "PRE-OPERATIONAL"
    log.wait_for(BEAT_PRE_OPERATIONAL, since=begin)
    pdos = [seen for seen in log.frames(begin) if int(seen.frame[:3], 16) in layouts]
    until(lambda: len(heard) >= len(pdos), "it has not heard all")
    passed = [(identifier := int(seen.frame[:3], 16), struct.unpack(layouts[identifier], seen.data)) for seen in pdos]
    assert heard == passed
    assert {seen.frame[8:12] for seen in pdos if seen.frame.startswith("385#")} == {"6666"}  # 310 V of 387.5 V
    assert {seen.frame[8:] for seen in pdos if seen.frame.startswith("485#")} == {"24092409"}  # 23.40 degC, twice


def test_the_librarys_client_leads_the_node_by_nmt_and_hears_its_state(log: Witness, remote: Any) -> None:
    begin = log.heard()
    for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"):
        remote.nmt.state = state
        until(lambda state=state: remote.nmt.wait_for_heartbeat(PATIENCE) == state, f"never {state}")
    remote.nmt.state = "RESET COMMUNICATION"
    log.wait_for(BOOTED, since=begin)
    told = [seen.frame for seen in log.frames(begin)]
    assert [frame for frame in told if frame.startswith("000#")] == [START, STOP, PRE_OPERATIONAL, RESET_COMMUNICATION]
    beats = [frame for frame in told[: told.index(BOOTED)] if frame.startswith("705#")]
    assert [beat for beat, _ in itertools.groupby(beats)][-3:] == [BEAT_OPERATIONAL, BEAT_STOPPED, BEAT_PRE_OPERATIONAL]


def test_a_bus_that_goes_down_is_told_at_once_and_the_drive_is_had_again_when_it_is_up(
    log: Witness, bench: ServedProcess
) -> None:
    with connect(bench.url) as drive, listening(drive) as listener:
        begin = log.heard()
        link("set", BUS, "down")
        try:
            error = listener.ended()
            assert isinstance(error, LostError)
            assert f"socketcan {BUS} is gone: " in str(error)
            assert "Network is down" in str(error)
            with pytest.raises(ConnectError, match=f"socketcan {BUS} no longer takes frames: .*Network is down"):
                connect(bench.url)
        finally:
            link("set", BUS, "up")
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0
    assert bench.process.poll() is None
    assert BOOTED not in [seen.frame for seen in log.frames(begin)]  # it is the same drive, and has not been reset


def test_a_drive_whose_bus_is_removed_says_so_and_serves_it_again_when_it_is_back(bench: ServedProcess) -> None:
    errors = bench.process.stderr
    assert errors is not None
    link("del", BUS)
    try:
        said = errors.readline()
        assert re.fullmatch("pmsm-bench emulate: the CAN bus socketcan .* is gone: [^\\n]+\n", said), said
    finally:
        link("add", BUS, "type", "vcan")
        link("set", BUS, "up")
    again = f"pmsm-bench emulate: {bench.url} is served again\n"
    while (said := errors.readline()) != again:
        assert said.startswith("pmsm-bench emulate: no CAN bus socketcan "), said
    with connect(bench.url) as drive:
        assert len(first_blocks(drive, 20)) > 0


def link(*command: str) -> None:
    """`ip link` and a command."""
    subprocess.run(["busybox", "ip", "link", *command], check=True, timeout=PATIENCE)
