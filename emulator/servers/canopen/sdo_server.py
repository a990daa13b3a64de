"""An SDO server (CiA 301, 7.2.4): expedited, segmented and block transfer, both ways. Pure: frames in, frames out.

One transfer at a time; a request that begins one ends the one before. One that is not continued in time is aborted.
Time is an argument. Knows nothing of buses, and of objects only their bytes.
"""

import binascii
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

from drivers.wire.canopen_od import Abort, sdo_address

PATIENCE: Final = 2.0  # s, for the client to go on
BLOCK: Final = 127  # segments in a block, at most
LONGEST: Final = 1 << 16  # bytes of a download, at most

_ABORT: Final = 0x80
_TOGGLE: Final = 0x10
_LAST_SEGMENT: Final = 0x01  # of a segmented transfer
_LAST_OF_BLOCKS: Final = 0x80  # of a block transfer
_SIZE, _EXPEDITED = 0x01, 0x02
_BLOCK_SIZE_TOLD, _BLOCK_CRC = 0x02, 0x04


class SdoAbortError(Exception):
    """The server refuses; `code` is the reason."""

    def __init__(self, code: int) -> None:
        super().__init__(f"SDO abort 0x{code:08X}")
        self.code = code


class Objects(Protocol):
    """What is served; both methods raise SdoAbortError."""

    def get_data(self, index: int, subindex: int) -> bytes: ...

    def set_data(self, index: int, subindex: int, data: bytes) -> None: ...


@dataclass(slots=True)
class _Transfer:
    """A transfer under way. `go_on` takes the client's next frame and gives the answers."""

    address: tuple[int, int]  # index, sub-index
    go_on: Callable[["_Transfer", bytes], list[bytes]]
    data: bytearray = field(default_factory=bytearray)
    size: int | None = None  # bytes, where the client told
    toggle: int = 0
    crc: bool = False
    at: int = 0  # bytes of an upload that the client has acknowledged
    sent: int = 0  # segments of the block under way
    block: int = BLOCK  # segments in a block, as the client wishes
    last: bool = False  # the last segment of a download has come

    @property
    def progress(self) -> object:
        """Something that changes as the transfer goes on."""
        return self.go_on, self.at, self.toggle, len(self.data)


class SdoServer:
    """The server's side of one SDO channel."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects
        self._transfer: _Transfer | None = None
        self._heard = 0.0  # s

    def request(self, frame: bytes, now: float) -> list[bytes]:
        """Answers to a frame of the client at time `now` (s); frames of other than 8 bytes are none."""
        if len(frame) != 8:
            return []
        if frame[0] == _ABORT:
            self._transfer = None
            return []
        transfer = self._transfer
        try:
            if transfer and (transfer.go_on is _block_segment or _continues(frame)):
                return self._continued(transfer, frame, now)
            self._heard = now
            return self._begun(frame)
        except SdoAbortError as refusal:
            self._transfer = None
            address = sdo_address(*transfer.address) if transfer and _continues(frame) else frame[1:4]
            return [_aborted(address, refusal.code)]

    def expire(self, now: float) -> list[bytes]:
        """Abort a transfer that was not continued in time."""
        transfer = self._transfer
        if transfer is None or now - self._heard <= PATIENCE:
            return []
        self._transfer = None
        return [_aborted(sdo_address(*transfer.address), Abort.TIME_OUT)]

    def _begun(self, frame: bytes) -> list[bytes]:
        begin = {1: self._download, 2: self._upload, 5: self._block_upload, 6: self._block_download}.get(frame[0] >> 5)
        if begin is None or _continues(frame):
            raise SdoAbortError(Abort.COMMAND)
        self._transfer = None
        index, subindex = struct.unpack_from("<HB", frame, 1)
        return begin(frame, index, subindex)

    def _continued(self, transfer: _Transfer, frame: bytes, now: float) -> list[bytes]:
        before = transfer.progress
        answers = transfer.go_on(transfer, frame)
        if transfer.progress != before:
            self._heard = now
        if transfer.go_on is _finished:
            self._transfer = None
            if transfer.last:
                self._objects.set_data(*transfer.address, bytes(transfer.data))
        return answers

    def _upload(self, frame: bytes, index: int, subindex: int) -> list[bytes]:
        data = self._read(index, subindex)
        if len(data) <= 4:
            head = 0x40 | (4 - len(data)) << 2 | _EXPEDITED | _SIZE
            return [bytes([head]) + frame[1:4] + data.ljust(4, b"\0")]
        self._transfer = _Transfer((index, subindex), _upload_segment, bytearray(data))
        return [bytes([0x40 | _SIZE]) + frame[1:4] + struct.pack("<I", len(data))]

    def _download(self, frame: bytes, index: int, subindex: int) -> list[bytes]:
        head = frame[0]
        if head & _EXPEDITED:
            size = 4 - (head >> 2 & 3) if head & _SIZE else 4
            self._objects.set_data(index, subindex, frame[4 : 4 + size])
        else:
            self._transfer = _Transfer((index, subindex), _download_segment, size=_told(frame, _SIZE))
        return [bytes([0x60]) + frame[1:4] + bytes(4)]

    def _block_upload(self, frame: bytes, index: int, subindex: int) -> list[bytes]:
        block, threshold = frame[4], frame[5]
        if not 1 <= block <= BLOCK:
            raise SdoAbortError(Abort.BLOCK_SIZE)
        data = self._read(index, subindex)
        if len(data) <= threshold:  # CiA 301: the server may change the protocol for so little
            return self._upload(frame, index, subindex)
        self._transfer = _Transfer(
            (index, subindex), _block_start, bytearray(data), crc=bool(frame[0] & _BLOCK_CRC), block=block
        )
        return [bytes([0xC0 | _BLOCK_CRC | _BLOCK_SIZE_TOLD]) + frame[1:4] + struct.pack("<I", len(data))]

    def _block_download(self, frame: bytes, index: int, subindex: int) -> list[bytes]:
        self._transfer = _Transfer(
            (index, subindex), _block_segment, size=_told(frame, _BLOCK_SIZE_TOLD), crc=bool(frame[0] & _BLOCK_CRC)
        )
        return [bytes([0xA0 | _BLOCK_CRC]) + frame[1:4] + bytes([BLOCK, 0, 0, 0])]

    def _read(self, index: int, subindex: int) -> bytes:
        data = self._objects.get_data(index, subindex)
        if not data:
            raise SdoAbortError(Abort.NO_DATA)
        return data


def _continues(frame: bytes) -> bool:
    """Whether a frame goes on with a transfer rather than begin one, by its command specifier."""
    command = frame[0] >> 5
    return command in (0, 3) or (command == 5 and frame[0] & 3 != 0) or (command == 6 and frame[0] & 1 != 0)


def _upload_segment(transfer: _Transfer, frame: bytes) -> list[bytes]:
    _expect(frame[0] >> 5 == 3)
    _check_toggle(transfer, frame)
    piece = bytes(transfer.data[transfer.at : transfer.at + 7])
    transfer.at += len(piece)
    last = transfer.at == len(transfer.data)
    head = (frame[0] & _TOGGLE) | (7 - len(piece)) << 1 | (_LAST_SEGMENT if last else 0)
    if last:
        transfer.go_on = _finished
    return [bytes([head]) + piece.ljust(7, b"\0")]


def _download_segment(transfer: _Transfer, frame: bytes) -> list[bytes]:
    _expect(frame[0] >> 5 == 0)
    _check_toggle(transfer, frame)
    _take(transfer, frame[1 : 8 - (frame[0] >> 1 & 7)])
    if frame[0] & _LAST_SEGMENT:
        _check_size(transfer)
        transfer.last, transfer.go_on = True, _finished
    return [bytes([0x20 | (frame[0] & _TOGGLE)]) + bytes(7)]


def _block_start(transfer: _Transfer, frame: bytes) -> list[bytes]:
    _expect(frame[0] == 0xA3)
    transfer.go_on = _block_acknowledged
    return _block_frames(transfer)


def _block_frames(transfer: _Transfer) -> list[bytes]:
    """The next block of an upload, from what the client has acknowledged on."""
    end = min(len(transfer.data), transfer.at + 7 * transfer.block)
    pieces = [transfer.data[k : k + 7] for k in range(transfer.at, end, 7)]
    transfer.sent = len(pieces)
    frames = [bytes([number]) + bytes(piece).ljust(7, b"\0") for number, piece in enumerate(pieces, 1)]
    if transfer.at + 7 * transfer.sent >= len(transfer.data):
        frames[-1] = bytes([frames[-1][0] | _LAST_OF_BLOCKS]) + frames[-1][1:]
    return frames


def _block_acknowledged(transfer: _Transfer, frame: bytes) -> list[bytes]:
    _expect(frame[0] == 0xA2)
    taken, block = frame[1], frame[2]
    if taken > transfer.sent:
        raise SdoAbortError(Abort.SEQUENCE)
    if not 1 <= block <= BLOCK:
        raise SdoAbortError(Abort.BLOCK_SIZE)
    transfer.at = min(transfer.at + 7 * taken, len(transfer.data))
    transfer.block = block
    if transfer.at < len(transfer.data):
        return _block_frames(transfer)
    transfer.go_on = _block_ended
    unused = -len(transfer.data) % 7
    crc = binascii.crc_hqx(transfer.data, 0) if transfer.crc else 0
    return [bytes([0xC1 | unused << 2]) + struct.pack("<H", crc) + bytes(5)]


def _block_ended(transfer: _Transfer, frame: bytes) -> list[bytes]:
    _expect(frame[0] == 0xA1)
    transfer.go_on = _finished
    return []


def _block_segment(transfer: _Transfer, frame: bytes) -> list[bytes]:
    """A segment of a block download; one out of its order is passed over, and the client told to go back."""
    number = frame[0] & 0x7F
    if number == 0:
        raise SdoAbortError(Abort.SEQUENCE)
    in_order = number == transfer.sent + 1
    if in_order:
        transfer.sent = number
        _take(transfer, frame[1:])
    last = bool(frame[0] & _LAST_OF_BLOCKS)
    if not last and number < BLOCK:
        return []
    taken, transfer.sent = transfer.sent, 0
    if last and in_order:
        transfer.go_on = _block_download_end
    return [bytes([0xA2, taken, BLOCK]) + bytes(5)]


def _block_download_end(transfer: _Transfer, frame: bytes) -> list[bytes]:
    _expect(frame[0] >> 5 == 6)
    unused = frame[0] >> 2 & 7
    if unused:
        del transfer.data[-unused:]
    _check_size(transfer)
    if transfer.crc and struct.unpack_from("<H", frame, 1)[0] != binascii.crc_hqx(transfer.data, 0):
        raise SdoAbortError(Abort.CRC)
    transfer.last, transfer.go_on = True, _finished
    return [bytes([0xA1]) + bytes(7)]


def _finished(transfer: _Transfer, frame: bytes) -> list[bytes]:
    del transfer, frame
    raise SdoAbortError(Abort.COMMAND)


def _told(frame: bytes, flag: int) -> int | None:
    """The size in bytes that the frame tells where its flag is set."""
    size = int(struct.unpack_from("<I", frame, 4)[0]) if frame[0] & flag else None
    if size is not None and size > LONGEST:
        raise SdoAbortError(Abort.MEMORY)
    return size


def _take(transfer: _Transfer, piece: bytes) -> None:
    transfer.data += piece
    if len(transfer.data) > LONGEST + 7:
        raise SdoAbortError(Abort.MEMORY)


def _check_size(transfer: _Transfer) -> None:
    if transfer.size is not None and transfer.size != len(transfer.data):
        raise SdoAbortError(Abort.LENGTH)


def _check_toggle(transfer: _Transfer, frame: bytes) -> None:
    if frame[0] & _TOGGLE != transfer.toggle:
        raise SdoAbortError(Abort.TOGGLE)
    transfer.toggle ^= _TOGGLE


def _expect(right: bool) -> None:
    if not right:
        raise SdoAbortError(Abort.COMMAND)


def _aborted(address: bytes, code: int) -> bytes:
    return bytes([_ABORT]) + address + struct.pack("<I", code)
