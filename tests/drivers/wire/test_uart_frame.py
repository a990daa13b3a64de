"""Frames on a serial line: bytes by hand, any frame through any split, and what is left after bytes are spoilt."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wire import uart_frame as uf
from drivers.wire.dictionary import NOT_KNOWN, SIGNALS, STREAM_ROW
from drivers.wire.uart_frame import Decoder, Frame, Kind, packed, stuffed, unpacked, unstuffed

FRAMES = st.builds(Frame, st.integers(0, 255), st.integers(0, 0xFFFF), st.binary(max_size=300) | st.just(bytes(700)))


def run_of(first: int, last: int) -> bytes:
    return bytes(range(first, last + 1))


@pytest.mark.parametrize(
    ("data", "on_the_line"),  # Cheshire and Baker, and the examples known from the Wikipedia article on COBS
    [
        (b"", "01"),
        (b"\0", "01 01"),
        (b"\0\0", "01 01 01"),
        (b"\0\x11\0", "01 02 11 01"),
        (b"\x11\x22\0\x33", "03 11 22 02 33"),
        (b"\x11\x22\x33\x44", "05 11 22 33 44"),
        (b"\x11\0\0\0", "02 11 01 01 01"),
        (run_of(1, 254), "FF" + run_of(1, 254).hex()),
        (b"\0" + run_of(1, 254), "01 FF" + run_of(1, 254).hex()),
        (run_of(1, 255), "FF" + run_of(1, 254).hex() + "02 FF"),
        (run_of(2, 255) + b"\0", "FF" + run_of(2, 255).hex() + "01 01"),
        (run_of(3, 255) + b"\0\1", "FE" + run_of(3, 255).hex() + "02 01"),
    ],
)
def test_stuffing_is_that_of_the_literature(data: bytes, on_the_line: str) -> None:
    assert stuffed(data) == bytes.fromhex(on_the_line)
    assert unstuffed(bytes.fromhex(on_the_line)) == data


@given(st.binary(max_size=600) | st.integers(200, 600).map(lambda n: b"\x55" * n))
def test_any_data_survives_stuffing_without_a_zero(data: bytes) -> None:
    on_the_line = stuffed(data)
    assert 0 not in on_the_line
    assert len(on_the_line) <= len(data) + 1 + len(data) // 254
    assert unstuffed(on_the_line) == data


def crc32_by_the_book(data: bytes) -> int:
    """CRC-32/ISO-HDLC bit by bit: polynomial 0x04C11DB7 reflected, ones before, inverted after."""
    crc = 0xFFFF_FFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB8_8320 if crc & 1 else 0)
    return crc ^ 0xFFFF_FFFF


def test_the_checksum_is_crc32_iso_hdlc() -> None:
    assert crc32_by_the_book(b"123456789") == 0xCBF4_3926
    frame = Frame(0x31, 0x3332, b"456789")  # "123456789" with its head
    assert unstuffed(packed(frame)[1:-1]) == b"123456789" + (0xCBF4_3926).to_bytes(4, "little")


@pytest.mark.parametrize(
    ("frame", "on_the_line"),
    [
        (Frame(Kind.PING, 1), "00 03 07 01 05 D6 FE 15 E3 00"),
        (Frame(Kind.READ, 0x0102, b"\2\0"), "00 05 02 02 01 02 05 43 64 1F 25 00"),
        (Frame(Kind.STREAM, 1, uf.packed_rows(uf.Rows(1_000_000, 10, (2340, 2340), np.array(
            [[-0x8000, 100, -100, 0, 0, 0, 0x7FFF, NOT_KNOWN, 1]], np.int16)))),
         "00 03 40 01 04 40 42 0F 02 0A 05 24 09 24 09 03 80 64 03 9C FF 01 01 01 01 01 03 FF 7F 03 80 01"
         "05 DC 94 63 E8 00"),
    ],
)
def test_frames_are_these_bytes(frame: Frame, on_the_line: str) -> None:
    assert packed(frame) == bytes.fromhex(on_the_line)
    assert Decoder().feed(bytes.fromhex(on_the_line)) == [frame]


@given(st.lists(FRAMES, max_size=6), st.lists(st.integers(0, 4000)))
def test_any_frames_survive_any_split(frames: list[Frame], cuts: list[int]) -> None:
    data = b"".join(map(packed, frames))
    decoder = Decoder()
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    parts = [data[begin:end] for begin, end in itertools.pairwise(places)]
    assert [frame for part in parts for frame in decoder.feed(part)] == frames
    assert decoder.seen == uf.Seen(frames=len(frames))


@given(st.lists(FRAMES, min_size=1, max_size=5), st.sampled_from(["lost", "added", "changed"]), st.data())
def test_a_byte_lost_added_or_changed_costs_one_frame_at_most(
    frames: list[Frame], what: str, draw: st.DataObject
) -> None:
    data = b"".join(map(packed, frames))
    place = draw.draw(st.integers(0, len(data) - 1))
    other = draw.draw(st.integers(1, 255))
    between = {"lost": b"", "added": bytes([other - 1, data[place]]), "changed": bytes([data[place] ^ other])}[what]
    decoder = Decoder()
    found = decoder.feed(data[:place] + between + data[place + 1 :])
    ends = [0]
    for frame in frames:
        ends.append(ends[-1] + len(packed(frame)))
    hit = next(k for k in range(len(frames)) if place < ends[k + 1])
    assert found in (frames, frames[:hit] + frames[hit + 1 :])


@given(st.binary(max_size=3000))
def test_garbage_is_dropped_counted_and_no_frame(garbage: bytes) -> None:
    decoder = Decoder()
    assert decoder.feed(garbage + b"\0") == []
    assert decoder.seen.bytes_dropped == len(garbage) - garbage.count(0)
    frame = Frame(Kind.PING, 7)
    assert decoder.feed(packed(frame)) == [frame]


def test_a_line_that_never_ends_a_frame_is_not_kept() -> None:
    decoder = Decoder()
    for _ in range(100):
        assert decoder.feed(b"\x55" * 4096) == []
    assert len(decoder._rest) < 2 * uf.PAYLOAD
    frame = Frame(Kind.PING, 7)
    assert decoder.feed(packed(frame)) == [frame]
    assert decoder.seen == uf.Seen(frames=1, frames_dropped=1, bytes_dropped=100 * 4096)


@pytest.mark.parametrize(
    ("chunk", "sentence"),
    [
        (b"\x05\x01", "COBS code 5 at byte 0 of 2"),
        (b"\x02\x07", "a frame has at least 7 bytes, got 1"),
        (b"\x03\x07\x02\x05\xd6\xfe\x15\xe3", "expected CRC 0x........, got 0xE315FED6"),
        (b"\x01" * 2000, r"a frame has at most 10\d\d bytes, got 2000"),
    ],
)
def test_what_is_no_frame_is_told(chunk: bytes, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        unpacked(chunk)


def test_a_payload_that_is_too_long_is_told() -> None:
    assert unpacked(packed(Frame(1, 2, bytes(uf.PAYLOAD)))[1:-1]).payload == bytes(uf.PAYLOAD)
    with pytest.raises(ValueError, match="a frame takes 1024 bytes, got 1025"):
        packed(Frame(1, 2, bytes(uf.PAYLOAD + 1)))


@given(st.integers(0, 2**32 - 1), st.integers(1, 1000), st.lists(
    st.lists(st.integers(-0x8000, 0x7FFF), min_size=len(STREAM_ROW), max_size=len(STREAM_ROW)),
    min_size=1, max_size=uf.ROWS_PER_FRAME,
))
def test_rows_survive_and_fit_one_block(tick: int, periods: int, rows: list[list[int]]) -> None:
    payload = uf.packed_rows(uf.Rows(tick, periods, (-1, 2340), np.array(rows, np.int16)))
    back = uf.unpacked_rows(payload)
    assert (back.tick, back.periods, back.temperatures) == (tick, periods, (-1, 2340))
    assert back.counts.tolist() == rows
    assert len(packed(Frame(Kind.STREAM, 1, payload))) <= 254 + 3


@pytest.mark.parametrize(("payload", "sentence"), [
    (b"", "a frame of the stream has 10 bytes and 18 a row, got 0"), (bytes(10), "got 10"), (bytes(29), "got 29"),
    (bytes(28), "a row covers at least one control period, got 0"),
])
def test_a_frame_of_no_rows_is_told(payload: bytes, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        uf.unpacked_rows(payload)


def test_signals_go_by_their_place_in_the_dictionary() -> None:
    assert [uf.number_of(signal) for signal in SIGNALS] == list(range(len(SIGNALS)))
    assert [uf.signal_numbered(k) for k in range(len(SIGNALS))] == list(SIGNALS)
    assert uf.signal_numbered(len(SIGNALS)) is None
    assert uf.signal_numbered(uf.NO_SIGNAL) is None
