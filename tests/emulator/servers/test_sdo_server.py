"""The SDO server frame by frame, by CiA 301: golden bytes by hand, every refusal, and whatever comes."""

import binascii
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulator.servers.canopen.sdo_server import PATIENCE, SdoAbortError, SdoServer

TEXT = b"what a drive has to say, in more than one piece"
LONG = bytes(range(256)) * 8  # 2048 bytes: three blocks of 127 segments


class Store:
    """Objects that can all be written."""

    def __init__(self) -> None:
        self.held = {(0x2000, 1): b"\x78\x56\x34\x12", (0x2000, 2): b"\x05", (0x1008, 0): TEXT, (0x2410, 1): LONG,
                     (0x2410, 2): b""}

    def get_data(self, index: int, subindex: int) -> bytes:
        try:
            return self.held[index, subindex]
        except KeyError:
            raise SdoAbortError(0x06020000) from None

    def set_data(self, index: int, subindex: int, data: bytes) -> None:
        if (index, subindex) == (0x2000, 1):
            raise SdoAbortError(0x06010002)
        self.held[index, subindex] = data


class Client:
    """A client's end: frames in hexadecimal."""

    def __init__(self) -> None:
        self.store = Store()
        self.server = SdoServer(self.store)
        self.now = 0.0

    def ask(self, request: str) -> list[str]:
        return [frame.hex() for frame in self.server.request(bytes.fromhex(request), self.now)]

    def raw(self, request: bytes) -> list[bytes]:
        return self.server.request(request.ljust(8, b"\0"), self.now)


@pytest.fixture
def client() -> Client:
    return Client()


def abort(index_and_sub: str, code: int) -> list[str]:
    return [f"80{index_and_sub}" + struct.pack("<I", code).hex()]


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("4000200100000000", "4300200178563412"),  # four bytes, expedited
        ("4000200200000000", "4f00200205000000"),  # one byte
        ("4008100000000000", "410810002f000000"),  # 47 bytes follow in segments
        ("2f00300107000000", "6000300100000000"),
        ("2300300107060504", "6000300100000000"),
        ("2200300107060504", "6000300100000000"),  # expedited, the size not told
        ("2100300114000000", "6000300100000000"),  # 20 bytes in segments
    ],
)
def test_a_request_gets_the_answer_made_by_hand(client: Client, request_: str, answer: str) -> None:
    assert client.ask(request_) == [answer]


def test_an_upload_in_segments_alternates_its_toggle_bit_and_says_which_is_the_last(client: Client) -> None:
    assert client.ask("4008100000000000") == ["410810002f000000"]
    answers = [client.ask(("60" if k % 2 == 0 else "70") + "00" * 7)[0] for k in range(7)]
    assert answers[0] == "00" + TEXT[:7].hex()
    assert answers[1] == "10" + TEXT[7:14].hex()
    assert answers[6] == "05" + TEXT[42:].hex() + "0000"  # 0x05: two bytes unused, the last
    assert b"".join(bytes.fromhex(a)[1 : 8 - (int(a[:2], 16) >> 1 & 7)] for a in answers) == TEXT
    assert client.ask("7000000000000000") == abort("000000", 0x05040001)  # there is no more


def test_a_download_in_segments_arrives(client: Client) -> None:
    assert client.ask("210050010a000000") == ["6000500100000000"]
    assert client.ask("0001020304050607") == ["2000000000000000"]
    assert (0x5000, 1) not in client.store.held
    assert client.ask("190809 0a00000000".replace(" ", "")) == ["3000000000000000"]  # 4 unused, the last
    assert client.store.held[0x5000, 1] == bytes(range(1, 11))


@pytest.mark.parametrize(
    ("requests", "answer"),
    [
        (["4008100000000000", "7000000000000000"], abort("081000", 0x05030000)),  # the toggle bit begins at 0
        (["4008100000000000", "6000000000000000", "6000000000000000"], abort("081000", 0x05030000)),
        (["2100500114000000", "1000000000000000"], abort("005001", 0x05030000)),
        (["210050010a000000", "0f01000000000000"], abort("005001", 0x06070010)),  # 0 bytes where 10 were told
        (["21000000ffffff00"], abort("000000", 0x05040005)),  # more than it can take
        (["4000990000000000"], abort("009900", 0x06020000)),
        (["2300200101020304"], abort("002001", 0x06010002)),
        (["4010240200000000"], abort("102402", 0x08000024)),  # it is empty
        (["4010240100000000", "a300000000000000"], abort("102401", 0x05040001)),  # another protocol's command
        (["a41024017f000000", "6000000000000000"], abort("102401", 0x05040001)),
        (["a410240180000000"], abort("102401", 0x05040002)),
        (["a41024017f000000", "a300000000000000", "a280000000000000"], abort("102401", 0x05040003)),
        (["a41024017f000000", "a300000000000000", "a27f000000000000"], abort("102401", 0x05040002)),
        (["a41024027f000000"], abort("102402", 0x08000024)),
        (["c200500107000000", "0000000000000000"], abort("005001", 0x05040003)),  # segments count from 1
        (["e000000000000000"], abort("000000", 0x05040001)),
        (["0000000000000000"], abort("000000", 0x05040001)),
    ],
)
def test_what_cannot_be_is_aborted_with_the_standards_code(
    client: Client, requests: list[str], answer: list[str]
) -> None:
    *before, last = requests
    for request in before:
        client.ask(request)
    assert client.ask(last) == answer
    assert client.ask("4000200200000000") == ["4f00200205000000"]


def test_a_block_upload_goes_block_by_block_and_ends_with_its_checksum(client: Client) -> None:
    assert client.ask("a41024017f000000") == ["c610240100080000"]  # CRC, size 2048
    data, request = b"", "a300000000000000"
    for segments, last in ((127, False), (127, False), (39, True)):
        block = client.ask(request)
        assert len(block) == segments
        numbers = [int(frame[:2], 16) for frame in block]
        assert numbers[:-1] == list(range(1, segments))
        assert numbers[-1] == segments | (0x80 if last else 0)
        data += b"".join(bytes.fromhex(frame)[1:] for frame in block)
        request = f"a2{segments:02x}7f0000000000"
    crc = struct.pack("<H", binascii.crc_hqx(LONG, 0)).hex()
    assert client.ask(request) == [f"cd{crc}0000000000"]  # 3 bytes of the last segment unused
    assert data[:-3] == LONG
    assert client.ask("a100000000000000") == []


def test_a_block_whose_segments_were_lost_is_sent_again_from_there(client: Client) -> None:
    client.ask("a41024010a000000")
    assert client.ask("a300000000000000")[4] == "05" + LONG[28:35].hex()
    again = client.ask("a2040a0000000000")  # four have come
    assert again[0] == "01" + LONG[28:35].hex()
    assert len(again) == 10
    assert client.ask("a20a020000000000") == ["01" + LONG[98:105].hex(), "02" + LONG[105:112].hex()]


def test_little_data_may_be_uploaded_the_ordinary_way(client: Client) -> None:
    assert client.ask("a4002001087f0000".replace("087f", "7f08")) == ["4300200178563412"]


def blocks(data: bytes) -> list[list[bytes]]:
    """The segments of a block download."""
    pieces = [data[k : k + 7].ljust(7, b"\0") for k in range(0, len(data), 7)]
    frames = [bytes([k % 127 + 1 | (0x80 if k == len(pieces) - 1 else 0)]) + piece for k, piece in enumerate(pieces)]
    return [frames[k : k + 127] for k in range(0, len(frames), 127)]


@pytest.mark.parametrize("size", [1, 7, 8, 889, 890, 2048])
def test_a_block_download_arrives_whole(client: Client, size: int) -> None:
    data = LONG[:size]
    assert client.raw(b"\xc6\x00\x50\x01" + struct.pack("<I", size)) == [b"\xa4\x00\x50\x01\x7f\0\0\0"]
    for block in blocks(data):
        answers = [answer for frame in block for answer in client.raw(frame)]
        assert answers == [bytes([0xA2, len(block), 127, 0, 0, 0, 0, 0])]
    end = bytes([0xC1 | (-size % 7) << 2]) + struct.pack("<H", binascii.crc_hqx(data, 0))
    assert client.raw(end) == [b"\xa1" + bytes(7)]
    assert client.store.held[0x5000, 1] == data


def test_a_segment_lost_on_the_way_down_is_asked_for_again(client: Client) -> None:
    data = LONG[:70]
    (block,) = blocks(data)
    client.raw(b"\xc6\x00\x50\x01" + struct.pack("<I", 70))
    answers = [answer for frame in block[:3] + block[4:] for answer in client.raw(frame)]
    assert answers == [bytes([0xA2, 3, 127, 0, 0, 0, 0, 0])]
    again = [bytes([k | (0x80 if k == 7 else 0)]) + frame[1:] for k, frame in enumerate(block[3:], 1)]
    assert [answer for frame in again for answer in client.raw(frame)] == [bytes([0xA2, 7, 127, 0, 0, 0, 0, 0])]
    assert client.raw(b"\xc1" + struct.pack("<H", binascii.crc_hqx(data, 0))) == [b"\xa1" + bytes(7)]
    assert client.store.held[0x5000, 1] == data


@pytest.mark.parametrize(("end", "code"), [(b"\xc1\x12\x34", 0x05040004), (b"\xc5\x00\x00", 0x06070010)])
def test_a_block_download_that_is_not_right_at_its_end_changes_nothing(client: Client, end: bytes, code: int) -> None:
    client.raw(b"\xc6\x00\x50\x01" + struct.pack("<I", 7))
    client.raw(blocks(b"1234567")[0][0])
    assert [frame.hex() for frame in client.raw(end)] == abort("005001", code)
    assert (0x5000, 1) not in client.store.held


def test_a_transfer_that_is_not_continued_is_aborted_in_time(client: Client) -> None:
    client.ask("4008100000000000")
    assert client.server.expire(PATIENCE) == []
    client.now = PATIENCE
    client.ask("6000000000000000")
    assert client.server.expire(2.0 * PATIENCE) == []
    assert [frame.hex() for frame in client.server.expire(2.1 * PATIENCE)] == abort("081000", 0x05040000)
    assert client.server.expire(9.9 * PATIENCE) == []
    assert client.ask("7000000000000000") == abort("000000", 0x05040001)


def test_frames_that_are_no_progress_do_not_keep_a_transfer_alive(client: Client) -> None:
    client.raw(b"\xc6\x00\x50\x01" + struct.pack("<I", 700))
    client.now = 2.0 * PATIENCE
    assert client.ask("4000200200000000") == []  # taken for segment 64 of the block
    assert [frame.hex() for frame in client.server.expire(client.now)] == abort("005001", 0x05040000)
    assert client.ask("4000200200000000") == ["4f00200205000000"]


def test_a_client_that_aborts_or_begins_anew_ends_what_was_under_way(client: Client) -> None:
    client.ask("4008100000000000")
    assert client.ask("8008100000000405") == []
    assert client.ask("6000000000000000") == abort("000000", 0x05040001)
    client.ask("4008100000000000")
    assert client.ask("4000200200000000") == ["4f00200205000000"]
    assert client.server.expire(99.0) == []


@settings(deadline=None)
@given(st.lists(st.one_of(
    st.binary(max_size=9),
    st.tuples(st.sampled_from([0x40, 0x60, 0x70, 0xA4, 0xA3, 0xA2, 0xA1, 0xC6, 0xC1, 0x01, 0x81, 0x21, 0x00]),
              st.sampled_from([b"\x08\x10\x00", b"\x10\x24\x01", b"\x00\x50\x01", b"\x7f\x7f\x00"]),
              st.binary(min_size=4, max_size=4)).map(lambda parts: bytes([parts[0]]) + parts[1] + parts[2]),
), max_size=20))
def test_whatever_comes_the_answers_are_frames_and_the_server_goes_on(frames: list[bytes]) -> None:
    client = Client()
    for frame in frames:
        assert all(len(answer) == 8 for answer in client.server.request(frame, 0.0))
    assert client.ask("8000000000000000") == []
    assert client.ask("4000200200000000") == ["4f00200205000000"]
