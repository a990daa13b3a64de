"""The Modbus server against bytes made by hand from the standard, against mbpoll, and against noise."""

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.wire.dictionary import WATCHDOG_LAYOUT
from drivers.wire.modbus_url import parse_modbus_url
from emulator.drive.virtual_drive import VirtualDrive
from emulator.errors import BusError
from emulator.scenario.scenarios import PAPER
from emulator.servers.faults import Faults, parse_fault
from emulator.servers.modbus.frames import RtuFraming, TcpFraming, crc16
from emulator.servers.modbus.registers import Registers
from emulator.servers.modbus.row_ring import CAPACITY, RowRing
from emulator.servers.modbus.server import ModbusServer
from tests.support.served_drive import Served, served, until
from tests.support.served_modbus import ALL_URLS, Disturbed, line_to, path_of, pty_url, tcp_url

pytestmark = pytest.mark.live

LAYOUT = WATCHDOG_LAYOUT.to_bytes(4, "big").hex(" ")

# Function code and data of requests and answers, by hand from the Application Protocol Specification V1.1b3
TALKS = {
    "read holding registers: the layout": ("03 00 00 00 02", f"03 04 {LAYOUT}"),
    "read input registers: the product": ("04 00 04 00 02", "04 04 50 4d 53 4d"),
    "read the device's name": ("03 00 0a 00 04", "03 08 70 6d 73 6d 2d 62 65 6e"),
    "read a float, high word first": ("03 11 02 00 02", "03 04 41 c0 00 00"),
    "read a 16-bit value and its spare register": ("03 10 08 00 02", "03 04 00 0a 00 00"),
    "read the low word of a float alone": ("03 11 03 00 01", "03 02 00 00"),
    "write a single register": ("06 10 08 00 14", "06 10 08 00 14"),
    "write a float": ("10 40 04 00 02 04 3f a0 00 00", "10 40 04 00 02"),
    "write and read in one": ("17 40 04 00 02 40 04 00 02 04 3f 00 00 00", "17 04 3f 00 00 00"),
    "ask the window for registers": (
        "17 02 00 00 07 01 00 00 04 08 00 2a 00 01 00 00 11 02", "17 0e 00 2a 00 01 00 00 11 02 00 02 41 c0 00 00"),
    "a function that there is not": ("41 00 00", "c1 01"),
    "coils, of which there are none": ("01 00 00 00 08", "81 01"),
    "a register that there is not": ("03 0f 00 00 01", "83 02"),
    "registers beyond the last": ("03 ff ff 00 02", "83 02"),
    "across the end of a record": ("03 11 06 00 03", "83 02"),
    "no register": ("03 00 00 00 00", "83 03"),
    "too many registers": ("03 00 00 00 7e", "83 03"),
    "to write what is only read": ("06 20 06 00 01", "86 02"),
    "to write half a float": ("06 40 04 00 01", "86 02"),
    "to write two signals at once": ("10 40 04 00 04 08 00 00 00 00 00 00 00 00", "90 02"),
    "to write a value out of range": ("06 10 08 00 00", "86 03"),
    "to write no number": ("10 40 04 00 02 04 7f c0 00 00", "90 03"),
    "to write more than the drive's current limit": ("10 40 04 00 02 04 41 48 00 00", "90 03"),
    "fewer bytes than told": ("10 40 04 00 02 05 3f a0 00 00 00", "90 03"),
    "the window of no kind": ("17 02 00 00 07 01 00 00 04 08 00 2a 00 09 00 00 00 00", "97 03"),
    "rows in too small a window": ("17 02 00 00 06 01 00 00 04 08 00 2a 00 02 00 00 00 00", "97 03"),
}


def checksum(data: bytes) -> bytes:
    """CRC of the serial line bit by bit, as in MODBUS over Serial Line V1.02, 6.2.2; low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc, carry = crc >> 1, crc & 1
            crc ^= 0xA001 * carry
    return bytes([crc & 0xFF, crc >> 8])


def tcp_frame(pdu: str, transaction: int = 0x1234, unit: int = 1) -> str:
    data = bytes.fromhex(pdu)
    return (transaction.to_bytes(2, "big") + b"\0\0" + (len(data) + 1).to_bytes(2, "big") + bytes([unit]) + data).hex()


def rtu_frame(pdu: str, unit: int = 1) -> str:
    data = bytes([unit]) + bytes.fromhex(pdu)
    return (data + checksum(data)).hex()


@pytest.fixture(scope="module", params=ALL_URLS)
def bench(request: pytest.FixtureRequest) -> Iterator[Served]:
    with served(ALL_URLS[request.param](), running=False) as drive:
        yield drive


def framed(bench: Served, pdu: str) -> str:
    return tcp_frame(pdu) if bench.url.startswith("modbus+tcp") else rtu_frame(pdu)


@pytest.mark.parametrize(("request_", "answer"), TALKS.values(), ids=TALKS)
def test_an_answer_is_what_the_standard_says(bench: Served, request_: str, answer: str) -> None:
    with line_to(bench.url) as line:
        line.ask(framed(bench, request_), framed(bench, answer))
        line.ask(framed(bench, "06 10 08 00 0a"), framed(bench, "06 10 08 00 0a"))


@pytest.mark.parametrize(
    "frame", ["02 07 41 12", "01 03 00 00 00 0a c5 cd", "01 03 00 00 00 01 84 0a", "01 83 02 c0 f1"]
)
def test_the_checksum_is_the_standards(frame: str) -> None:
    data = bytes.fromhex(frame)
    assert crc16(data[:-2]).to_bytes(2, "little") == checksum(data[:-2]) == data[-2:]
    assert crc16(data) == 0


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_the_checksum_is_that_of_the_bits(data: bytes) -> None:
    assert crc16(data).to_bytes(2, "little") == checksum(data)


def test_rtu_bytes_by_hand() -> None:
    with served(pty_url(), running=False) as bench, line_to(bench.url) as line:
        line.ask("01 03 00 00 00 7e c5 ea", "01 83 03 01 31")
        line.ask("01 03 0f 00 00 01 87 1e", "01 83 02 c0 f1")


def test_other_units_and_broadcasts_are_passed_over_in_silence(bench: Served) -> None:
    over_tcp = bench.url.startswith("modbus+tcp")
    with line_to(bench.url) as line:
        for unit in (0, 2, 247):
            pdu = "06 10 08 00 63"
            line.send(bytes.fromhex(tcp_frame(pdu, unit=unit) if over_tcp else rtu_frame(pdu, unit)))
        line.ask(framed(bench, "03 10 08 00 01"), framed(bench, "03 02 00 0a"))
        assert line.receive(1, 0.05) == b""


def test_requests_may_come_together_and_in_pieces(bench: Served) -> None:
    one, other = bytes.fromhex(framed(bench, "03 00 04 00 02")), bytes.fromhex(framed(bench, "03 11 02 00 02"))
    expected = bytes.fromhex(framed(bench, "03 04 50 4d 53 4d") + framed(bench, "03 04 41 c0 00 00"))
    with line_to(bench.url) as line:
        line.send(one + other)
        assert line.receive(len(expected)) == expected
    framing = TcpFraming() if bench.url.startswith("modbus+tcp") else RtuFraming()
    for k in range(len(one) - 1):
        assert framing.received(one[k : k + 1]) == []
    (request,) = framing.received(one[-1:])
    assert (request.unit, request.pdu.hex(" ")) == (1, "03 00 04 00 02")


def test_bytes_that_are_no_header_end_a_tcp_connection_and_no_other() -> None:
    with served(tcp_url(), running=False) as bench, line_to(bench.url) as good, line_to(bench.url) as bad:
        for noise in (b"GET / HTTP/1.1\r\n\r\n", bytes.fromhex("0001 0001 0006 01 03 0000 0001")):
            bad.send(noise)
            assert bad.receive(1) == b""
            good.ask(tcp_frame("03 00 04 00 02"), tcp_frame("03 04 50 4d 53 4d"))
            break


def test_a_frame_of_a_wrong_checksum_is_passed_over_and_the_next_is_answered() -> None:
    with served(pty_url(), running=False) as bench, line_to(bench.url) as line:
        line.send(bytes.fromhex("01 03 00 00 00 02 00 00"))
        assert line.receive(1, 0.1) == b""  # the silence that ends it
        line.ask(rtu_frame("03 00 04 00 02"), rtu_frame("03 04 50 4d 53 4d"))


@given(pieces=st.lists(st.binary(max_size=300), max_size=8), quiet=st.lists(st.booleans(), min_size=8, max_size=8))
@settings(deadline=None)
def test_no_bytes_break_a_framing(pieces: list[bytes], quiet: list[bool]) -> None:
    tcp, rtu = TcpFraming(), RtuFraming()
    for piece, silent in zip(pieces, quiet, strict=False):
        assert all(request.pdu for request in [*rtu.received(piece), *(rtu.silence() if silent else [])])
        try:
            tcp.received(piece)
        except ValueError as error:
            assert "expected a Modbus header, got" in str(error)
            tcp = TcpFraming()


@pytest.fixture(scope="module")
def drive() -> VirtualDrive:
    drive = VirtualDrive(PAPER)
    drive.run(100)
    return drive


def written(address: int, count: int, data: bytes) -> bytes:
    """What follows the first address of a request that reads so many registers and writes some."""
    head = count.to_bytes(2, "big") + address.to_bytes(2, "big")
    return head + bytes([0, len(data) // 2, len(data)]) + data


functions = st.sampled_from([3, 4, 6, 16, 23]) | st.integers(0, 255)
addresses = st.sampled_from([0, 0x100, 0x200, 0x1002, 0x2004, 0x4004, 0x5002, 0x8400, 0x9102]) | st.integers(0, 0xFFFF)


@given(
    function=functions, address=addresses,
    more=st.binary(max_size=40) | st.builds(written, addresses, st.integers(0, 130), st.binary(max_size=12)),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_request_has_an_answer_or_an_exception(
    drive: VirtualDrive, function: int, address: int, more: bytes
) -> None:
    registers = Registers(drive)
    answer = registers.answer(bytes([function]) + address.to_bytes(2, "big") + more)
    assert answer[0] in (function, function | 0x80)
    assert 2 <= len(answer) <= 253
    if answer[0] & 0x80:
        assert len(answer) == 2
        assert answer[1] in (1, 2, 3)
    drive.run(1)


@given(st.lists(st.binary(min_size=1, max_size=300), max_size=5))
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_no_bytes_on_a_line_end_the_service(bench: Served, pieces: list[bytes]) -> None:
    with line_to(bench.url) as line:
        for piece in pieces:
            try:
                line.send(piece)
            except OSError:  # it has hung up
                break
        line.receive(1, 0.05)
    with line_to(bench.url) as line:
        line.receive(4096, 0.05)  # answers, where noise was a request
        line.ask(framed(bench, "03 00 04 00 02"), framed(bench, "03 04 50 4d 53 4d"))


def test_any_valid_request_keeps_the_watchdog_content(bench: Served) -> None:
    assert bench.drive.read("error_code") == 0
    bench.drive.write("watchdog_time", 0.05)
    with line_to(bench.url) as line:
        for _ in range(10):
            bench.step(400)
            line.ask(framed(bench, "03 00 04 00 02"), framed(bench, "03 04 50 4d 53 4d"))
    assert bench.drive.read("error_code") == 0
    for _ in range(10):
        bench.step(400)
    assert bench.drive.read("error_code") == 0x8130
    bench.drive.write("watchdog_time", 0.0)
    bench.drive.write("control_word", 0x80)
    bench.step(1)


def test_a_drive_that_is_busy_says_so(bench: Served) -> None:
    bench.server.faults = Faults([parse_fault("refuse=0x2300")])
    try:
        with line_to(bench.url) as line:
            line.ask(framed(bench, "03 40 04 00 02"), framed(bench, "83 06"))
            line.ask(framed(bench, "10 40 04 00 02 04 00 00 00 00"), framed(bench, "90 06"))
            line.ask(framed(bench, "03 00 04 00 02"), framed(bench, "03 04 50 4d 53 4d"))
    finally:
        bench.server.faults = Faults()


def test_a_line_may_lose_and_double_answers(bench: Served) -> None:
    answer = bytes.fromhex(framed(bench, "03 04 50 4d 53 4d"))
    try:
        with line_to(bench.url) as line:
            bench.server.faults = Disturbed(left=1, copies=2, skip=1)
            line.send(bytes.fromhex(framed(bench, "03 00 04 00 02")))
            assert line.receive(2 * len(answer)) == 2 * answer
            bench.server.faults = Faults([parse_fault("lose=1")])
            line.send(bytes.fromhex(framed(bench, "03 00 04 00 02")))
            assert line.receive(1, 0.1) == b""
    finally:
        bench.server.faults = Faults()


def test_a_serial_line_is_a_link_that_goes_with_its_server() -> None:
    url = pty_url()
    with served(url, running=False):
        assert path_of(url).is_symlink()
        with pytest.raises(BusError, match=r"cannot serve a serial line at .*: File exists"):
            path = path_of(url).with_suffix(".file")
            path.touch()
            try:
                ModbusServer(VirtualDrive(PAPER), parse_modbus_url(f"modbus+rtu://{path}/1"))
            finally:
                path.unlink()
    assert not path_of(url).is_symlink()


def test_a_link_left_behind_is_replaced() -> None:
    url = pty_url()
    path_of(url).symlink_to("/dev/pts/99999")
    with served(url, running=False) as bench, line_to(bench.url) as line:
        line.ask(rtu_frame("03 00 04 00 02"), rtu_frame("03 04 50 4d 53 4d"))
    assert not path_of(url).is_symlink()


def test_a_port_in_use_and_a_place_that_cannot_be_are_sentences() -> None:
    drive = VirtualDrive(PAPER)
    taken = pytest.raises(BusError, match=r"cannot serve Modbus at 127.0.0.1:\d+: Address already in use")
    with served(tcp_url(), running=False) as bench, taken:
        ModbusServer(drive, parse_modbus_url(bench.url))
    with pytest.raises(BusError, match="cannot serve a serial line at /nowhere/line: No such file"):
        ModbusServer(drive, parse_modbus_url("modbus+rtu:///nowhere/line/1"))
    with pytest.raises(ValueError, match="expected the path of a serial line, or socket://HOST:PORT, to serve"):
        ModbusServer(drive, parse_modbus_url("modbus+rtu://loop://1:1/1"))


def test_a_ring_gives_the_latest_rows_by_number_as_far_as_they_join() -> None:
    drive = VirtualDrive(PAPER)
    ring = RowRing({name: drive.read(name) for name in ("i_full", "u_full", "omega_full")})
    assert ring.piece(0, 12).count == 0
    ring.add(drive.run(95), drive.rows_end)
    assert (ring.made, drive.rows_end) == (9, 90)
    pieces = [ring.piece(7, 12), ring.piece(9, 12), ring.piece(50, 1)]
    assert [(p.first, p.tick, p.periods, p.count) for p in pieces] == [(7, 70, 10, 2), (9, 0, 0, 0), (9, 0, 0, 0)]
    drive.write("stream_periods", 1.0)
    ring.add(drive.run(CAPACITY + 500), drive.rows_end)
    oldest = ring.piece(0, 3)
    assert (oldest.first, oldest.tick, oldest.periods) == (ring.made - CAPACITY, 90 + oldest.first, 1)
    assert ring.piece(9, 0).count == 0
    drive.write("stream_periods", 5.0)
    changed = ring.made
    ring.add(drive.run(23), drive.rows_end)
    assert (ring.piece(changed - 2, 12).count, ring.piece(changed, 12).count) == (2, 4)


MBPOLL = shutil.which("mbpoll")
MBPOLL_BAUDRATE = 115200  # bit/s


def mbpoll(url: str, *arguments: str, values: tuple[str, ...] = ()) -> dict[int, str]:
    """What Debian's mbpoll reads, by address; or nothing, of what it writes."""
    if MBPOLL is None:
        pytest.skip("mbpoll is not installed (Debian: mbpoll)")
    place = url.removeprefix("modbus+tcp://").removesuffix("/1")
    host, _, port = place.partition(":")
    where = ["-m", "tcp", "-p", port, host]
    if not port.isdigit():
        where = ["-m", "rtu", "-b", str(MBPOLL_BAUDRATE), "-P", "none", str(path_of(url))]
    done = subprocess.run(
        [MBPOLL, "-0", "-1", "-q", "-a", "1", *arguments, *where, *values],
        capture_output=True, text=True, timeout=10.0, check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return {int(at): value for at, value in re.findall(r"^\[(\d+)\]:\s+(\S+)", done.stdout, re.MULTILINE)}


@pytest.mark.parametrize("make_url", [tcp_url, lambda: pty_url(baudrate=MBPOLL_BAUDRATE)], ids=["tcp", "pty"])
def test_mbpoll_reads_and_writes_the_drive(make_url: Callable[[], str]) -> None:
    with served(make_url(), running=False) as bench:
        assert mbpoll(bench.url, "-r", "4", "-c", "2", "-t", "4:hex") == {4: "0x504D", 5: "0x534D"}
        assert mbpoll(bench.url, "-r", "0", "-c", "1", "-t", "4:int", "-B") == {0: str(_signed(WATCHDOG_LAYOUT))}
        assert mbpoll(bench.url, "-r", str(0x1102), "-c", "2", "-t", "4:float", "-B") == {0x1102: "24", 0x1104: "387.5"}
        assert mbpoll(bench.url, "-r", str(0x2014), "-c", "1", "-t", "3") == {0x2014: "26214"}  # 310 / 387.5
        mbpoll(bench.url, "-r", str(0x1008), "-t", "4", values=("50",))
        mbpoll(bench.url, "-r", str(0x4004), "-t", "4:float", "-B", values=("1.25",))
        until(lambda: bench.drive.read("i_q_ref") == 1.25, "not written")
        assert bench.drive.read("stream_periods") == 50.0


def _signed(value: int) -> int:
    return value - (1 << 32) if value >> 31 else value
