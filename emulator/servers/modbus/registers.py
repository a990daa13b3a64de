"""The virtual drive's registers: a Modbus request in, its answer out. Knows nothing of lines and frames.

Standard: MODBUS Application Protocol Specification V1.1b3. What the registers are, `modbus_map` says.
"""

import struct
import threading
from collections.abc import Callable, Sequence
from typing import Final

from drivers.wire import modbus_map as registers
from drivers.wire.codec import FULL_SCALES, FullScales, decode, encode_held
from drivers.wire.dictionary import CAPTURE_CHANNELS, Signal, signal_named
from emulator.drive.control_lease import Denial, DeniedError
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.servers.modbus.row_ring import RowRing

_CHANNELS: Final = tuple(f"capture_channel_{k}" for k in range(1, CAPTURE_CHANNELS + 1))


class _RefusedError(Exception):
    """A Modbus exception."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Registers:
    """Answers requests, from any thread."""

    def __init__(self, drive: VirtualDrive, refuses: Callable[[int], bool] = lambda _: False) -> None:
        """`refuses` says whether signals of an index are refused just now, as by a drive that is busy."""
        self._drive = drive
        self._refuses = refuses
        self._full: FullScales = {name: drive.read(name) for name in FULL_SCALES}
        self._head = registers.our_head(drive.layout_id, drive.serial).words()
        self._lock = threading.Lock()  # guards what follows
        self._ring = RowRing(self._full)
        self._tick = 0
        self._request = (0, 0, 0)  # number, kind, first
        self._functions: dict[int, Callable[[bytes], bytes]] = {
            registers.READ: self._answer_read, registers.READ_INPUT: self._answer_read,
            registers.WRITE_ONE: self._answer_write_one, registers.WRITE: self._answer_write,
            registers.READ_WRITE: self._answer_read_write,
        }

    def publish(self, rows: StreamRows) -> None:
        """Keep the rows that have become complete; a drive that was reset counts them anew."""
        with self._lock:
            if self._drive.tick < self._tick:
                self._ring.clear()
            self._tick = self._drive.tick
            if len(rows):
                self._ring.add(rows, self._drive.rows_end)

    def answer(self, pdu: bytes) -> bytes:
        """The answer to a request, which may be an exception."""
        function = self._functions.get(pdu[0])
        try:
            if function is None:
                raise _RefusedError(registers.ILLEGAL_FUNCTION)
            with self._lock:
                return pdu[:1] + function(pdu[1:])
        except _RefusedError as refused:
            return bytes([pdu[0] | 0x80, refused.code])
        except struct.error:  # too short or too long for its function
            return bytes([pdu[0] | 0x80, registers.ILLEGAL_VALUE])

    def _answer_read(self, body: bytes) -> bytes:
        address, count = struct.unpack(">HH", body)
        data = registers.data_of(self._read(address, count))
        return bytes([len(data)]) + data

    def _answer_write_one(self, body: bytes) -> bytes:
        address, word = struct.unpack(">HH", body)
        self._write(address, [word])
        return body

    def _answer_write(self, body: bytes) -> bytes:
        address, count, size = struct.unpack(">HHB", body[:5])
        if not 1 <= count <= registers.MOST_WRITTEN or not size == 2 * count == len(body) - 5:
            raise _RefusedError(registers.ILLEGAL_VALUE)
        self._write(address, registers.registers(body[5:]))
        return body[:4]

    def _answer_read_write(self, body: bytes) -> bytes:
        address, count, to, written, size = struct.unpack(">HHHHB", body[:9])
        if not 1 <= written <= registers.MOST_WRITTEN_23 or not size == 2 * written == len(body) - 9:
            raise _RefusedError(registers.ILLEGAL_VALUE)
        if not 1 <= count <= registers.MOST_READ:
            raise _RefusedError(registers.ILLEGAL_VALUE)
        self._write(to, registers.registers(body[9:]))
        return self._answer_read(struct.pack(">HH", address, count))

    def _read(self, address: int, count: int) -> list[int]:
        if not 1 <= count <= registers.MOST_READ:
            raise _RefusedError(registers.ILLEGAL_VALUE)
        return self._window(count) if address == registers.WINDOW else self._plain(address, count)

    def _plain(self, address: int, count: int) -> list[int]:
        """Registers of the head, the request and the signals."""
        for start, words in ((registers.HEAD, self._head), (registers.REQUEST, self._request_words())):
            if start <= address and address + count <= start + len(words):
                return words[address - start : address - start + count]
        begin = address & ~1  # signals begin at even registers
        words: list[int] = []
        for at in range(begin, address + count, 2):
            words += self._signal_words(at)
        return words[address - begin :][:count]

    def _signal_words(self, address: int) -> list[int]:
        """Both registers of a signal."""
        signal = self._signal_at(address)
        if signal is None:
            raise _RefusedError(registers.ILLEGAL_ADDRESS)
        self._check_ready(signal)
        data = encode_held(signal, self._drive.read(signal.name), self._full)
        return [*registers.words_of(signal, data), 0][:2]

    def _write(self, address: int, words: Sequence[int]) -> None:
        if address == registers.REQUEST and len(words) == registers.REQUEST_LENGTH:
            self._request = struct.unpack(registers.REQUEST_FORMAT, registers.data_of(words))
            return
        if address == registers.CONTROL and self._drive.has_lease:
            self._asked(lambda: self._drive.control(registers.data_of(words)))
            return
        signal = self._signal_at(address)
        if signal is None or signal.access != "rw" or len(words) != registers.length_of(signal):
            raise _RefusedError(registers.ILLEGAL_ADDRESS)
        self._check_ready(signal)
        name, data = signal.name, registers.bytes_of(signal, words)
        self._asked(lambda: self._drive.request(name, decode(signal, data, self._full)))

    def _asked(self, write: Callable[[], None]) -> None:
        """A write of the drive's, its refusals as Modbus exceptions."""
        try:
            write()
        except DeniedError as denied:
            holders = denied.denial is Denial.HOLDERS_ALONE
            raise _RefusedError(registers.ILLEGAL_ADDRESS if holders else registers.DEVICE_BUSY) from None
        except ValueError:
            raise _RefusedError(registers.ILLEGAL_VALUE) from None

    def _signal_at(self, address: int) -> Signal | None:
        """The drive's signal whose first register this is, or None."""
        signal = registers.signal_at_register(address)
        return signal if signal and signal.name in self._drive.names else None

    def _check_ready(self, signal: Signal) -> None:
        if self._refuses(signal.index):
            raise _RefusedError(registers.DEVICE_BUSY)

    def _request_words(self) -> list[int]:
        return registers.registers(struct.pack(registers.REQUEST_FORMAT, *self._request))

    def _window(self, length: int) -> list[int]:
        """The answer to the request, in so many registers; those beyond it are 0."""
        number, kind, first = self._request
        room = length - registers.WINDOW_LENGTH
        kinds = {registers.REGISTERS: self._registers, registers.ROWS: self._rows, registers.SAMPLES: self._samples}
        if kind not in kinds or room < 0:
            raise _RefusedError(registers.ILLEGAL_VALUE)
        first, count, data = kinds[kind](first, room)
        if len(data) > 2 * room:
            raise _RefusedError(registers.ILLEGAL_VALUE)
        head = struct.pack(registers.WINDOW_FORMAT, number, kind, first, count)
        return registers.registers((head + data).ljust(2 * length, b"\0"))

    def _registers(self, first: int, room: int) -> tuple[int, int, bytes]:
        return first, room, registers.data_of(self._plain(first, room))

    def _rows(self, first: int, room: int) -> tuple[int, int, bytes]:
        size = struct.calcsize(registers.ROWS_HEAD) // 2
        piece = self._ring.piece(first, min(max(0, (room - size) // registers.ROW_LENGTH), registers.MOST_ROWS))
        temperatures = (self._whole(signal_named(name)) for name in ("temp_winding", "temp_magnet"))
        made, tick = self._ring.made & 0xFFFF_FFFF, piece.tick & 0xFFFF_FFFF
        head = struct.pack(registers.ROWS_HEAD, made, tick, piece.periods, *temperatures)
        return piece.first & 0xFFFF_FFFF, piece.count, head + piece.rows

    def _whole(self, signal: Signal) -> int:
        data = encode_held(signal, self._drive.read(signal.name), self._full)
        return struct.unpack(signal.type.struct_format, data)[0]

    def _samples(self, first: int, room: int) -> tuple[int, int, bytes]:
        size = struct.calcsize(registers.SAMPLES_HEAD) // 2
        channels = sum(self._drive.read(name) > 0 for name in _CHANNELS)
        data = self._drive.captured(first, (room - size) // channels) if channels and room > size else b""
        head = struct.pack(registers.SAMPLES_HEAD, int(self._drive.read("capture_number")), channels)
        return first, len(data) // (2 * channels) if channels else 0, head + registers.swapped(data)


def asks_for_rows(pdu: bytes) -> bool:
    """Whether a request is for rows of the stream, by the window."""
    at = 1 + struct.calcsize(">HHHHB")
    if pdu[0] != registers.READ_WRITE or len(pdu) != at + 2 * registers.REQUEST_LENGTH:
        return False
    return struct.unpack_from(registers.REQUEST_FORMAT, pdu, at)[1] == registers.ROWS
