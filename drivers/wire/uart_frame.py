"""The UART's view of the dictionary: frames of requests, replies, the stream and the recording. Pure: bytes and values.

A frame is `kind` (8 bit), `sequence` (16 bit), payload and CRC-32 (ISO-HDLC: that of Ethernet, zip; 0xCBF43926 for
"123456789"), little-endian, byte-stuffed by COBS (Cheshire and Baker, Consistent Overhead Byte Stuffing, IEEE/ACM
Trans. Networking 7, 1999, doi:10.1109/90.769765) between two bytes 0x00. As each frame has a 0x00 at either side, a
byte lost, added or changed costs one frame at most. A reply echoes the sequence number of its request; frames of the
stream that of the request that started it. Signals go by their place in `dictionary.SIGNALS`, which `layout_id` covers.
"""

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.wire.dictionary import SIGNALS, STREAM_ROW, Signal


class Kind(IntEnum):
    """What a frame is. A reply has the request's kind and bit 7."""

    IDENTIFY = 0x01  # -> IDENTITY
    READ = 0x02  # NUMBER -> NUMBER, bytes of the value
    WRITE = 0x03  # NUMBER, bytes of the value -> NUMBER
    START = 0x04  # -> STARTED; the stream follows
    STOP = 0x05  # -> nothing
    UPLOAD = 0x06  # SPAN -> pieces, each PIECE and samples; the last has none
    PING = 0x07  # -> nothing
    CONTROL = 0x08  # a control record (`drivers.wire.lease`) -> nothing
    STREAM = 0x40  # ROWS, rows
    EVENT = 0x41  # EVENT
    REFUSAL = 0x42  # REFUSAL; in place of a reply


REPLY: Final = 0x80

NUMBER: Final = struct.Struct("<H")  # of a signal
IDENTITY: Final = struct.Struct("<5I")  # vendor, product, revision, serial, layout_id; the name in ASCII follows
STARTED: Final = struct.Struct("<IH")  # tick: no row of the stream began before; stream_periods
SPAN: Final = struct.Struct("<II")  # first sample, count
PIECE: Final = struct.Struct("<HIB")  # capture_number, first sample, channels; whole samples follow
ROWS: Final = struct.Struct("<IHhh")  # tick of the first row, stream_periods, temp_winding, temp_magnet
EVENT: Final = struct.Struct("<BH")  # an event, error_code
REFUSAL: Final = struct.Struct("<HI")  # number of the signal or NO_SIGNAL, code

EVENT_RESET: Final = 1
EVENT_FAULT: Final = 2

NO_SIGNAL: Final = 0xFFFF
# Codes of refusals are those of CiA 301, 7.2.4.3.17
NO_SUCH_REQUEST: Final = 0x05040001
READ_ONLY: Final = 0x06010002
NO_SUCH_OBJECT: Final = 0x06020000
WRONG_LENGTH: Final = 0x06070010
WRONG_VALUE: Final = 0x06090030
GENERAL: Final = 0x08000000
DEVICE_STATE: Final = 0x08000022
REFUSAL_TEXTS: Final = {
    NO_SUCH_REQUEST: "no such request", READ_ONLY: "it cannot be written", NO_SUCH_OBJECT: "no such signal",
    WRONG_LENGTH: "wrong number of bytes", WRONG_VALUE: "value outside its range",
    GENERAL: "general error", DEVICE_STATE: "not in its present state",
}

PAYLOAD: Final = 1024  # bytes, at most
ROWS_PER_FRAME: Final = 12  # at most; such a frame is one COBS block
ROW_BYTES: Final = 2 * len(STREAM_ROW)
_HEAD: Final = struct.Struct("<BH")
_CRC: Final = struct.Struct("<I")
_NUMBERS: Final = {signal.name: number for number, signal in enumerate(SIGNALS)}
_SHORTEST: Final = _HEAD.size + _CRC.size  # bytes before stuffing
_LONGEST: Final = _SHORTEST + PAYLOAD + 2 + (_SHORTEST + PAYLOAD) // 254  # bytes after it


class Frame(NamedTuple):
    """A frame as it was sent."""

    kind: int
    sequence: int
    payload: bytes = b""


class Rows(NamedTuple):
    """Consecutive rows of the stream."""

    tick: int  # at the first row's start, low 32 bits
    periods: int  # control periods per row
    temperatures: tuple[int, int]  # counts, of winding and magnets
    counts: NDArray[np.int16]  # (n, len(STREAM_ROW))


@dataclass(slots=True)
class Seen:
    """What a decoder has seen of a line."""

    frames: int = 0
    frames_dropped: int = 0  # what stood between two 0x00 and was no frame
    bytes_dropped: int = 0


class Decoder:
    """Frames out of a stream of bytes, however it is split; what is no frame is dropped and counted."""

    def __init__(self) -> None:
        self.seen = Seen()
        self._rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        """The frames complete with these bytes, in order."""
        *chunks, rest = (self._rest + data).split(b"\0")
        self._rest = rest[: _LONGEST + 1]
        self.seen.bytes_dropped += len(rest) - len(self._rest)
        frames = [frame for chunk in chunks if chunk and (frame := self._frame(chunk)) is not None]
        self.seen.frames += len(frames)
        return frames

    def _frame(self, chunk: bytes) -> Frame | None:
        try:
            return unpacked(chunk)
        except ValueError:
            self.seen.frames_dropped += 1
            self.seen.bytes_dropped += len(chunk)
            return None


def packed(frame: Frame) -> bytes:
    """Bytes of a frame on the line, with a 0x00 at either side."""
    if len(frame.payload) > PAYLOAD:
        raise ValueError(f"a frame takes {PAYLOAD} bytes, got {len(frame.payload)}")
    body = _HEAD.pack(frame.kind, frame.sequence) + frame.payload
    return b"\0" + stuffed(body + _CRC.pack(zlib.crc32(body))) + b"\0"


def unpacked(chunk: bytes) -> Frame:
    """The frame between two 0x00. Raises ValueError where there is none."""
    if len(chunk) > _LONGEST:
        raise ValueError(f"a frame has at most {_LONGEST} bytes, got {len(chunk)}")
    data = unstuffed(chunk)
    if len(data) < _SHORTEST:
        raise ValueError(f"a frame has at least {_SHORTEST} bytes, got {len(data)}")
    body, (crc,) = data[: -_CRC.size], _CRC.unpack(data[-_CRC.size :])
    if zlib.crc32(body) != crc:
        raise ValueError(f"expected CRC 0x{zlib.crc32(body):08X}, got 0x{crc:08X}")
    kind, sequence = _HEAD.unpack_from(body)
    return Frame(kind, sequence, body[_HEAD.size :])


def stuffed(data: bytes) -> bytes:
    """COBS: the same data without a 0x00, by the distance to the next one in place of each."""
    out = bytearray()
    blocks = data.split(b"\0")
    for block in blocks:
        whole = len(block) // 254 * 254
        for k in range(0, whole, 254):
            out.append(255)
            out += block[k : k + 254]
        out.append(len(block) - whole + 1)
        out += block[whole:]
    if blocks[-1] and len(blocks[-1]) % 254 == 0:
        del out[-1]
    return bytes(out)


def unstuffed(data: bytes) -> bytes:
    """The data before COBS. Raises ValueError where it cannot be COBS."""
    out = bytearray()
    at, end = 0, len(data)
    while at < end:
        code = data[at]
        following = at + code
        if code == 0 or following > end:
            raise ValueError(f"COBS code {code} at byte {at} of {end}")
        out += data[at + 1 : following]
        if code < 255 and following < end:
            out.append(0)
        at = following
    return bytes(out)


def number_of(signal: Signal) -> int:
    """Number of a signal on this line."""
    return _NUMBERS[signal.name]


def signal_numbered(number: int) -> Signal | None:
    """The signal of a number, or None."""
    return SIGNALS[number] if number < len(SIGNALS) else None


def packed_rows(rows: Rows) -> bytes:
    """Payload of a frame of the stream; at most ROWS_PER_FRAME rows."""
    return ROWS.pack(rows.tick & 0xFFFF_FFFF, rows.periods, *rows.temperatures) + rows.counts.astype("<i2").tobytes()


def unpacked_rows(payload: bytes) -> Rows:
    """Rows of a frame of the stream. Raises ValueError where there are none."""
    if len(payload) <= ROWS.size or (len(payload) - ROWS.size) % ROW_BYTES:
        raise ValueError(f"a frame of the stream has {ROWS.size} bytes and {ROW_BYTES} a row, got {len(payload)}")
    tick, periods, temp_winding, temp_magnet = ROWS.unpack_from(payload)
    if periods < 1:
        raise ValueError("a row covers at least one control period, got 0")
    counts = np.frombuffer(payload, "<i2", offset=ROWS.size).reshape(-1, len(STREAM_ROW))
    return Rows(tick, periods, (temp_winding, temp_magnet), counts)
