"""Modbus frames at the drive's end: bytes to requests, answers to bytes. Pure; knows nothing of registers.

Standards: MODBUS over Serial Line V1.02 (RTU), MODBUS Messaging on TCP/IP V1.0b.
"""

import struct
from dataclasses import dataclass, field
from typing import Final, Protocol

_MOST_PDU: Final = 253  # bytes
_MBAP: Final = ">HHHB"  # transaction, protocol 0, bytes that follow, unit
_MBAP_SIZE: Final = 7

# Length of a request with unit and CRC, by function code: fixed, or told by the count of bytes at this place
_FIXED: Final = {1: 8, 2: 8, 3: 8, 4: 8, 5: 8, 6: 8, 7: 4, 8: 8, 11: 4, 12: 4, 17: 4, 22: 10, 24: 6, 43: 7}
_COUNTED: Final = {15: 6, 16: 6, 20: 2, 21: 2, 23: 10}


@dataclass(frozen=True, slots=True)
class Request:
    """One request: function code and what follows it."""

    transaction: int  # TCP alone
    unit: int
    pdu: bytes


class Framing(Protocol):
    """What a line's bytes are to its server; one for each line."""

    def received(self, data: bytes) -> list[Request]:
        """Requests that are complete by now. Raises ValueError when the line cannot be Modbus."""
        ...

    def silence(self) -> list[Request]:
        """Requests that the end of the bytes, for a while, has completed."""
        ...

    def answer(self, request: Request, pdu: bytes) -> bytes:
        """The bytes of an answer."""
        ...


@dataclass(slots=True)
class TcpFraming:
    """Frames with a header that tells their length."""

    _bytes: bytearray = field(default_factory=bytearray)

    def received(self, data: bytes) -> list[Request]:
        self._bytes += data
        requests: list[Request] = []
        while len(self._bytes) >= _MBAP_SIZE:
            transaction, protocol, follows, unit = struct.unpack_from(_MBAP, self._bytes)
            if protocol or not 2 <= follows <= _MOST_PDU + 1:
                raise ValueError(f"expected a Modbus header, got {self._bytes[:_MBAP_SIZE].hex(' ')}")
            end = _MBAP_SIZE - 1 + follows
            if len(self._bytes) < end:
                break
            requests.append(Request(transaction, unit, bytes(self._bytes[_MBAP_SIZE:end])))
            del self._bytes[:end]
        return requests

    def silence(self) -> list[Request]:
        return []

    def answer(self, request: Request, pdu: bytes) -> bytes:
        return struct.pack(_MBAP, request.transaction, 0, len(pdu) + 1, request.unit) + pdu


@dataclass(slots=True)
class RtuFraming:
    """Frames between silences. One that is complete by its own length and checksum is not waited for."""

    _bytes: bytearray = field(default_factory=bytearray)

    def received(self, data: bytes) -> list[Request]:
        self._bytes += data
        requests: list[Request] = []
        while (length := _request_length(self._bytes)) and len(self._bytes) >= length:
            frame = bytes(self._bytes[:length])
            if crc16(frame):
                break  # what it is, the silence after it tells
            requests.append(Request(0, frame[0], frame[1:-2]))
            del self._bytes[:length]
        return requests

    def silence(self) -> list[Request]:
        """A whole frame of a function that is not known has no length but this; anything else is dropped."""
        frame = bytes(self._bytes)
        self._bytes.clear()
        if not 4 <= len(frame) <= _MOST_PDU + 3 or crc16(frame):
            return []
        return [Request(0, frame[0], frame[1:-2])]

    def answer(self, request: Request, pdu: bytes) -> bytes:
        frame = bytes([request.unit]) + pdu
        return frame + struct.pack("<H", crc16(frame))


def crc16(data: bytes) -> int:
    """Checksum of the serial line; that of a frame with its own, low byte first, is 0."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _CRC[(crc ^ byte) & 0xFF]
    return crc


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC: Final = tuple(map(_crc_of, range(256)))


def _request_length(data: bytearray) -> int:
    """Bytes of the frame that begins here; 0 while that cannot be told."""
    if len(data) < 2:
        return 0
    at = _COUNTED.get(data[1])
    if at is None:
        return _FIXED.get(data[1], 0)
    return at + 1 + data[at] + 2 if len(data) > at else 0
