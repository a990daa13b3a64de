"""A drive on a CAN bus: SDO for values, TPDOs for the stream.

The bus's reader thread only puts frames into a queue; the thread that iterates `stream` assembles them, and sends the
bench's heartbeats, which feed the drive's watchdog: it is the one that acts. While it streams, it looks at the node's
serial number and at how its TPDOs are set up, an object after the other, and hears what other clients set. Knows
nothing of the libraries beneath the bus.
"""

import contextlib
import itertools
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from types import TracebackType
from typing import Self

from drivers.block import Block
from drivers.canopen.assembler import Assembler
from drivers.canopen.bus import READ_ATTEMPTS, SDO_TIMEOUT, CanopenBus
from drivers.canopen.socketcand import Frame
from drivers.drive import Identity
from drivers.errors import ConnectError, DriveError, FrameError, LostError, NoReplyError, RefusedError, ResetError
from drivers.operation import Fault
from drivers.rows import TELLABLE, Counts
from drivers.settled import REPEATABLE
from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl
from drivers.wire.cia402 import error_text
from drivers.wire.codec import FULL_SCALES, FullScales, decode, encode
from drivers.wire.dictionary import CAPTURE_CHANNELS, CAPTURE_DATA, CONTROL, layout_text, signal_named, signals_of
from drivers.wire.lease import Record, packed

SILENCE = 1.0  # s without a row after which a drive counts as lost, where the row's tick can tell so much
POLL = 0.005  # s, how often the stream looks for new frames at most
LOOK = 0.02  # s, how often it looks at all else at least
GLANCE = 0.05  # s, how often a stream looks at how the node is set up
_CONFLICTS = 3  # frames that say otherwise of the same row, of two senders
_TWO_SEQUENCES = 1.0  # s that they last, of two senders: late frames end
HEARTBEAT_MISSED_MS = 500  # ms without the bench's heartbeat that count as missed, by object 0x1016

_COB_ID_MEANT = od.NOT_VALID | 0x1FFF_FFFF  # bits of a TPDO's COB-ID that say whether and where it is sent
_ROW_LENGTH = signal_named("stream_periods")
_ROW_LENGTH_SET = od.sdo_downloaded(_ROW_LENGTH.index, _ROW_LENGTH.subindex)


class CanopenDrive:
    """CANopen client of one node. Opens the bus, checks that the node is such a drive, and reads its identity."""

    def __init__(self, url: CanUrl) -> None:
        self._frames: deque[tuple[float, Sequence[Frame]]] = deque()  # s, monotonic, when they came; TPDO and payload
        self._came = threading.Event()  # frames of the stream, or what ends it
        self._looked = 0.0  # s, monotonic, when the stream looked for them
        self._heard = 0.0  # s, monotonic, when the latest row was whole
        self._bench_node = od.BENCH_NODE if url.node_id != od.BENCH_NODE else od.BENCH_NODE - 1  # the heartbeats' node
        self._assembler: Assembler | None = None
        self._streaming = False
        self._stream_lock = threading.Lock()  # start, stop and assembly of the stream
        self._rebooted = threading.Event()
        self._changed = threading.Event()  # somebody has set the row length
        self._remapped = ""  # which TPDO somebody has set
        self._two_sequences = 0.0  # s, monotonic, since when rows come in two sequences of ticks; 0: they do not
        self._set_up = _set_up_objects(url.node_id)
        self._glances = itertools.cycle(_glanced(self._set_up))
        self._glanced = 0.0  # s, monotonic, when the latest was made
        self._full: FullScales = {}
        self._fault: Fault | None = None
        self._bus = CanopenBus(url)
        try:
            self.identity = self._identify()
            self._set_up_pdos()
            self._bus.subscribe(od.emergency_cob_id(url.node_id), self._on_emergency)
            self._note_fault(int(self.read("error_code")))
            self._be_heard()
            self._bus.check_alone()
        except BaseException as error:
            self.close()
            if isinstance(error, DriveError):
                raise ConnectError(str(error)) from None
            raise
        tpdos = {od.tpdo_cob_id(number, url.node_id): number for number in range(len(od.TPDO_LAYOUT))}
        self._bus.hear_stream(tpdos, self._queue)
        self._bus.subscribe(od.heartbeat_cob_id(url.node_id), self._on_heartbeat)
        self._bus.hear_answers(self._on_sdo_response)

    @property
    def counts(self) -> Counts:
        """Rows and gaps of the latest stream."""
        return self._assembler.counts if self._assembler else Counts()

    @property
    def note(self) -> str:
        """What the client has changed of the stream by itself: nothing."""
        return ""

    @property
    def fault(self) -> Fault | None:
        """Why the drive is in fault, as it has told by itself; None where it is not."""
        return self._fault

    def read(self, name: str) -> float:
        """Value of a signal, SI."""
        signal = signal_named(name)
        data = self._bus.read(signal.index, signal.subindex, name)
        try:
            return decode(signal, data, self._full)
        except ValueError as error:
            raise FrameError(f"{self._bus.node}: {error}") from None

    def write(self, name: str, value: float) -> None:
        """Set a signal, SI. A change of `stream_periods` restarts a running stream.

        A parameter is read back, and set again where it was not taken, when no answer comes; a command never.
        """
        signal = signal_named(name)
        if signal.access != "rw":
            raise RefusedError(f"{signal} is {signal.access}, it cannot be written", 0x06010002)
        try:
            data = encode(signal, value, self._full)
        except ValueError as error:
            raise RefusedError(str(error), 0x06090030) from None
        repeatable = signal.is_parameter or name in REPEATABLE
        put = self._bus.put if repeatable else self._bus.write
        if signal is not _ROW_LENGTH:
            put(signal.index, signal.subindex, name, data)
            return
        with self._stream_lock:  # no row is assembled before its length is known
            if self._streaming:
                self._bus.command(od.NMT_PRE_OPERATIONAL)
            try:
                put(signal.index, signal.subindex, name, data)
            finally:
                if self._streaming:
                    self._start()

    def control(self, record: Record) -> None:
        """Have a control record taken, whole or not at all."""
        self._bus.write_control(*CONTROL, "control record", packed(record))

    def parameters(self) -> dict[str, float]:
        """Every writable signal with its value, SI."""
        return {signal.name: self.read(signal.name) for signal in self.identity.signals if signal.is_parameter}

    def stream(self) -> Iterator[Block]:
        """Start the stream and yield blocks as they come; it stops when the iterator is closed.

        Raises LostError when it falls silent, the node resets, or two nodes answer as this one; FrameError when
        somebody else on the bus sets `stream_periods` or a TPDO: rows of unknown length or columns are worth nothing.
        """
        try:
            with self._stream_lock:
                self._rebooted.clear()
                self._bus.look_for_another()
                self._set_up_pdos()
                self._start()
            yield from self._blocks()
        except DriveError:
            if not self._bus.closed.is_set():
                raise
        finally:
            self._stop()

    def captured(self, offset: int, count: int) -> Iterator[bytes]:
        """The recorder's samples from `offset` on, `count` of them, in pieces whose checksum is right."""
        width = 2 * sum(self.read(f"capture_channel_{k}") > 0 for k in range(1, CAPTURE_CHANNELS + 1))
        while count > 0:
            self.write("capture_offset", float(offset))
            piece = self._bus.read_block(*CAPTURE_DATA, "recording")[: count * width]
            if (begun := int(self.read("capture_offset"))) != offset:
                raise FrameError(f"somebody else has set capture_offset of {self._bus.node} to {begun}, not {offset}")
            if not width or len(piece) < width:
                raise FrameError(f"{self._bus.node} sent {len(piece)} bytes of a recording, expected {count * width}")
            yield piece
            offset, count = offset + len(piece) // width, count - len(piece) // width

    def close(self) -> None:
        """Stop the stream and close the bus."""
        self._bus.closed.set()
        self._came.set()
        self._stop()
        self._bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _identify(self) -> Identity:
        bus = self._bus
        try:
            vendor, product, revision, serial = (
                int.from_bytes(self._asked(od.OD_IDENTITY, k, "identity"), "little") for k in (1, 2, 3, 4)
            )
            bus.look_for_another()
        except NoReplyError:
            waited = READ_ATTEMPTS * SDO_TIMEOUT
            raise ConnectError(f"no {bus.node.replace(' on ', ' answered on ')} within {waited:g} s") from None
        name = self._asked(od.OD_DEVICE_NAME, 0, "device name").decode("ascii", "replace")
        try:
            layout = int(self.read("layout_id"))
        except RefusedError:
            layout = -1
        if not signals_of(layout):
            raise ConnectError(
                f"{bus.node} ({name!r}) has another signal layout: expected {layout_text()}, got "
                + ("none" if layout < 0 else f"0x{layout:08X}")
            )
        full = self._full = {key: self.read(key) for key in FULL_SCALES}
        return Identity(name, vendor, product, revision, serial, layout, self.read("T_s"), **full)

    def _asked(self, index: int, subindex: int, what: str) -> bytes:
        """An object that every such drive has."""
        try:
            try:
                return self._bus.read(index, subindex, what)
            except FrameError:  # segment by segment, it was spoilt time and again: by blocks it takes fewer frames
                return self._bus.read_block(index, subindex, what)
        except RefusedError:
            raise ConnectError(f"{self._bus.node} is no such drive: it has no {what}") from None

    def _set_up_pdos(self) -> None:
        """Have the node stream what is expected, where it would not. Raises ConnectError when it refuses."""
        for number in range(len(od.TPDO_LAYOUT)):
            cob_id, transmission, count = (
                int.from_bytes(self._asked(index, subindex, f"TPDO {number + 1}"), "little")
                for index, subindex in ((od.OD_TPDO + number, 1), (od.OD_TPDO + number, 2),
                                        (od.OD_TPDO_MAPPING + number, 0))
            )
            mapping = tuple(
                int.from_bytes(self._asked(od.OD_TPDO_MAPPING + number, k, f"TPDO {number + 1}"), "little")
                for k in range(1, min(count, od.MAPPING_ENTRIES) + 1)
            )
            expected = self._set_up[od.OD_TPDO + number, 1]
            same_place = cob_id & _COB_ID_MEANT == expected and transmission >= od.ON_EVENT
            if same_place and mapping == od.tpdo_mapping(number):
                continue
            try:
                self._set_up_pdo(number, cob_id, expected)
            except RefusedError as error:
                raise ConnectError(
                    f"{self._bus.node} has TPDO {number + 1} under 0x{cob_id:X}, of transmission type {transmission}, "
                    f"with {od.mapping_text(mapping)}, expected 0x{expected:X}, {od.ON_EVENT} and "
                    f"{od.mapping_text(od.tpdo_mapping(number))}, and cannot be set up so: {error}"
                ) from None

    def _set_up_pdo(self, number: int, cob_id: int, expected: int) -> None:
        """As CiA 301 has it for object 0x1A00: not valid, mapped anew, valid."""
        parameters, mapping, entries = od.OD_TPDO + number, od.OD_TPDO_MAPPING + number, od.tpdo_mapping(number)
        for index, subindex, value, size in (
            (parameters, 1, cob_id | od.NOT_VALID, 4), (mapping, 0, 0, 1),
            *((mapping, k, entry, 4) for k, entry in enumerate(entries, 1)), (mapping, 0, len(entries), 1),
            (parameters, 2, od.ON_EVENT, 1), (parameters, 1, expected, 4),
        ):
            self._bus.put(index, subindex, f"TPDO {number + 1}", value.to_bytes(size, "little"))

    def _be_heard(self) -> None:
        """Have the drive listen to the bench's heartbeats, where it can: they feed its watchdog."""
        consumed = (self._bench_node << 16 | HEARTBEAT_MISSED_MS).to_bytes(4, "little")
        with contextlib.suppress(RefusedError):
            if self._bus.read(od.OD_HEARTBEAT_CONSUMER, 1, "heartbeat consumer") != consumed:
                self._bus.put(od.OD_HEARTBEAT_CONSUMER, 1, "heartbeat consumer", consumed)

    def _blocks(self) -> Iterator[Block]:
        """Blocks as they come, until the drive is closed."""
        while self._waited():
            self._bus.beat(self._bench_node)
            self._glance()
            blocks = self._drain()
            yield from blocks
            if self._rebooted.is_set():
                raise ResetError(f"{self._bus.node} has reset")
            self._bus.check()
            self._bus.check_alone()
            silent = time.monotonic() - self._heard
            if not blocks and silent > self._patience():  # after blocks, more may have come while they were dealt with
                raise LostError(
                    f"{self._bus.node} fell silent: no row for {silent:.1f} s, "
                    f"expected one every {self._row_time() * 1e3:g} ms"
                )

    def _waited(self) -> bool:
        """Wait for what comes, and until it is time for another look; whether the drive is still open."""
        self._came.wait(LOOK)
        if (early := self._looked + POLL - time.monotonic()) > 0.0:
            self._bus.closed.wait(early)
        self._came.clear()
        self._looked = time.monotonic()
        return not self._bus.closed.is_set()

    def _start(self) -> None:
        """Pre-operational, read where the tick stands, operational: the first row's place in time is known."""
        self._bus.command(od.NMT_PRE_OPERATIONAL)
        self._changed.clear()
        self._remapped, self._two_sequences = "", 0.0
        periods = int(self.read("stream_periods"))
        tick = int(self.read("tick"))
        self._frames.clear()
        after = self._assembler.end if self._assembler else None
        self._assembler = Assembler(self.identity.T_s, periods, self._full, tick, after)
        self._streaming, self._heard = True, time.monotonic()
        self._bus.command(od.NMT_START)

    def _stop(self) -> None:
        with self._stream_lock:
            if self._streaming:
                self._streaming = False
                self._frames.clear()
                with contextlib.suppress(DriveError):
                    self._bus.command(od.NMT_PRE_OPERATIONAL)

    def _drain(self) -> list[Block]:
        with self._stream_lock:
            assembler = self._assembler
            if assembler is None:
                return []
            if self._changed.is_set():
                raise FrameError(f"somebody else has set stream_periods of {self._bus.node}")
            if self._remapped:
                raise FrameError(f"somebody else has set {self._remapped} of {self._bus.node}")
            while self._frames:
                came, frames = self._frames.popleft()
                rows = assembler.counts.rows
                assembler.frames(frames)
                if assembler.counts.rows != rows:
                    self._heard = came
            self._check_sender(assembler)
            return assembler.take()

    def _check_sender(self, assembler: Assembler) -> None:
        """Raise FrameError where rows come from two senders."""
        self._two_sequences = (self._two_sequences or time.monotonic()) if assembler.two_sequences else 0.0
        if assembler.conflicts >= _CONFLICTS:
            raise FrameError(
                f"two nodes send rows as {self._bus.node}: frames say otherwise of the same row than those before"
            )
        if self._two_sequences and time.monotonic() - self._two_sequences > _TWO_SEQUENCES:
            raise FrameError(f"two nodes send rows as {self._bus.node}: they come in two sequences of ticks")

    def _glance(self) -> None:
        """Look at the next object that tells of another node, or of another client; `_on_sdo_response` hears it."""
        if time.monotonic() - self._glanced >= GLANCE:
            self._glanced = time.monotonic()
            self._bus.glance(*next(self._glances))

    def _row_time(self) -> float:
        return self.identity.T_s * (self._assembler.periods if self._assembler else 1)

    def _patience(self) -> float:
        """Silence in s after which the drive counts as lost."""
        return max(min(SILENCE, TELLABLE * self.identity.T_s), 3.0 * self._row_time())

    def _queue(self, frames: Sequence[Frame]) -> None:
        """Put frames into the queue; those of another client's stream are heard and passed over."""
        if self._streaming:
            self._frames.append((time.monotonic(), frames))
            self._came.set()

    def _on_sdo_response(self, data: bytes) -> None:
        if data[:4] == _ROW_LENGTH_SET:
            self._changed.set()
        index, subindex = int.from_bytes(data[1:3], "little"), data[3]
        number = index & 0xFF
        if index & 0xFF00 not in (od.OD_TPDO, od.OD_TPDO_MAPPING) or number >= len(od.TPDO_LAYOUT):
            return
        name = f"TPDO {number + 1} (0x{index:04X}:{subindex})"
        if data[0] == od.DOWNLOADED:
            self._remapped = self._remapped or name
        expected, size = self._set_up.get((index, subindex)), od.uploaded_size(data[0])
        if expected is None or not size:
            return
        value = int.from_bytes(data[4 : 4 + size], "little")
        meant = value & _COB_ID_MEANT if index < od.OD_TPDO_MAPPING and subindex == 1 else value
        on_event = index < od.OD_TPDO_MAPPING and subindex == 2 and meant >= od.ON_EVENT
        if meant != expected and not on_event:
            self._remapped = self._remapped or name

    def _on_heartbeat(self, data: bytes) -> None:
        if data == bytes([od.STATE_BOOT_UP]):
            self._rebooted.set()
            self._came.set()
            self._fault = None

    def _on_emergency(self, data: bytes) -> None:
        if len(data) == 8:
            self._note_fault(int.from_bytes(data[:2], "little"))

    def _note_fault(self, code: int) -> None:
        self._fault = Fault(code, error_text(code)) if code & 0xFF00 else None  # CiA 301: 0x00xx says that it is gone


def _set_up_objects(node_id: int) -> dict[tuple[int, int], int]:
    """How TPDOs are set up, by index and sub-index."""
    expected: dict[tuple[int, int], int] = {}
    for number in range(len(od.TPDO_LAYOUT)):
        entries = od.tpdo_mapping(number)
        parameters, mapping = od.OD_TPDO + number, od.OD_TPDO_MAPPING + number
        expected |= {(parameters, 1): od.tpdo_cob_id(number, node_id), (parameters, 2): od.ON_EVENT}
        expected |= {(mapping, 0): len(entries)} | {(mapping, k): entry for k, entry in enumerate(entries, 1)}
    return expected


def _glanced(set_up: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """What is looked at in turn: the serial number between any two others."""
    return [place for other in set_up for place in ((od.OD_IDENTITY, 4), other)]
