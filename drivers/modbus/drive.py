"""A drive on a Modbus line: registers for values, the window for rows of the stream and samples of a recording.

The thread that iterates `stream` asks for the rows that are new; every answer tells which they are. That feeds the
drive's watchdog, too: no other thread asks for anything by itself. Knows nothing of frames and of the library beneath
the line.
"""

import contextlib
import math
import struct
import time
from collections import deque
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Final, Self, TypeVar

from drivers.block import Block
from drivers.drive import Identity
from drivers.errors import ConnectError, DriveError, FrameError, LostError, NoReplyError, RefusedError, ResetError
from drivers.modbus.line import ModbusLine
from drivers.modbus.turns import Turns
from drivers.rows import TELLABLE, Carried, Counts, RowBlocks, note
from drivers.settled import REPEATABLE, settle
from drivers.wire import modbus_map as registers
from drivers.wire.codec import FULL_SCALES, FullScales, decode, encode
from drivers.wire.dictionary import Signal, layout_text, signal_named, signals_of
from drivers.wire.lease import Record, packed
from drivers.wire.modbus_url import ModbusUrl

SILENCE: Final = 1.0  # s without a row after which a drive counts as lost
POLL: Final = 0.01  # s, how often the stream looks for new rows
_BURST: Final = 16  # requests, at most, between two looks at what else is to be done ...
_BURST_TIME: Final = 0.05  # s ... and no more after this
LAG: Final = 0.5  # s that a stream may be behind
CATCH_UP: Final = 0.5  # s in which it is to come up to ...
_CAUGHT_UP: Final = 0.75  # ... this share of what it was behind, or older rows are skipped
_FULL_ANSWERS: Final = 8  # in a row tell what the line carries
_SETTLING: Final = 1000  # control periods in which rows of the length before may still come
_NUMBERS: Final = 1 << 32  # of rows, and of ticks

_ROW_LENGTH: Final = signal_named("stream_periods")
T = TypeVar("T")


class ModbusDrive:
    """Modbus client of one unit. Opens the line, checks that the unit is such a drive, and reads its identity."""

    def __init__(self, url: ModbusUrl) -> None:
        self._full: FullScales = {}
        self._blocks: RowBlocks | None = None
        self._next = 0  # running number of the next row
        self._tick = 0  # from which on rows are expected
        self._ready: list[Block] = []
        self._stream_lock = Turns()  # start and assembly of the stream
        self._streaming = False
        self._carried: Carried | None = None
        self._made: deque[int] = deque(maxlen=_FULL_ANSWERS + 1)  # rows made by each of the latest, all full, answers
        self._lagging: tuple[float, int] | None = None  # s, monotonic, since when rows come late; how many were behind
        self._note = ""
        self._line = ModbusLine(url)
        try:
            self.identity = self._identify()
        except BaseException as error:
            self.close()
            if isinstance(error, DriveError):
                raise ConnectError(str(error)) from None
            raise

    @property
    def counts(self) -> Counts:
        """Rows and gaps of the latest stream."""
        return self._blocks.counts if self._blocks else Counts()

    @property
    def note(self) -> str:
        """What the client has changed of the stream by itself; empty: nothing."""
        return self._note

    def read(self, name: str) -> float:
        """Value of a signal, SI."""
        return self._read([signal_named(name)])[name]

    def write(self, name: str, value: float) -> None:
        """Set a signal, SI, and read it back. A change of `stream_periods` restarts a running stream.

        A parameter is set again where no answer comes and it reads back otherwise; a command never.
        Before `store`, all parameters are read twice: what is kept over a power cycle has been seen.
        """
        signal = signal_named(name)
        words = self._words(signal, value)
        if name == "store":
            self._look_twice()
        if signal is not _ROW_LENGTH:
            self._write(signal, words)
            return
        with self._stream_lock:  # no row is assembled before its length is known
            try:
                self._write(signal, words)
            finally:
                if self._streaming:
                    self._start()

    def control(self, record: Record) -> None:
        """Have a control record taken, whole or not at all."""
        self._line.write_repeated(registers.CONTROL, registers.registers(packed(record)))

    def parameters(self) -> dict[str, float]:
        """Every parameter with its value, SI."""
        wanted = [signal for signal in self.identity.signals if signal.is_parameter]
        found: dict[str, float] = {}
        for block in registers.blocks(wanted):
            found |= self._read(block)
        return {signal.name: found[signal.name] for signal in wanted}

    def stream(self) -> Iterator[Block]:
        """Start the stream and yield blocks as they come; it stops when the iterator is closed.

        Where the line does not carry them, older rows are skipped, and longer ones asked for (`note`).
        Raises LostError when it falls silent or the drive resets, FrameError when somebody else on the line sets
        `stream_periods`: rows of unknown length are worth nothing.
        """
        try:
            with self._stream_lock:
                self._streaming = True
                self._next = self._ask(0, rows=0).made
                self._start()
            yield from self._stream()
        except NoReplyError as error:
            raise LostError(f"{self._line.unit} fell silent: {error}") from None
        except DriveError:
            if not self._line.closed.is_set():
                raise
        finally:
            self._streaming = False

    def captured(self, offset: int, count: int) -> Iterator[bytes]:
        """The recorder's samples from `offset` on, `count` of them, piece by piece."""
        number: int | None = None
        done = 0
        while done < count:
            window = self._line.window(registers.SAMPLES, offset + done, registers.MOST_REGISTERS, "recording")
            samples = self._taken_apart(registers.Samples.of, window)
            if number not in (None, samples.number):
                raise RefusedError(f"{self._line.unit} no longer has recording {number}, it has {samples.number}", 0)
            number = samples.number
            if not window.count or not samples.counts:
                return
            wanted = min(window.count, count - done)
            done += wanted
            yield samples.counts[: 2 * samples.channels * wanted]

    def close(self) -> None:
        """Stop the stream and leave the line."""
        self._line.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _identify(self) -> Identity:
        """By reading alone: nothing is written to a device that is no such drive."""
        unit = self._line.unit
        try:
            head = registers.Head.of(self._line.read(registers.HEAD, registers.HEAD_LENGTH))
        except NoReplyError:
            after = self._line.answers_after(registers.HEAD, registers.HEAD_LENGTH)
            if after is not None and after > self._line.timeout:
                raise ConnectError(
                    f"answers of {unit} come after {after:.2f} s, expected within {self._line.timeout:g} s: "
                    f"?timeout={max(1, math.ceil(3.0 * after)):g} in its URL, before the unit, waits longer"
                ) from None
            raise ConnectError(
                f"no {unit.replace(' at ', ' answered at ').replace(' on ', ' answered on ')} "
                f"within {self._line.patience:.3g} s"
            ) from None
        except RefusedError as error:
            raise ConnectError(f"{unit} is no such drive: it has no identity where one is expected; {error}") from None
        if not signals_of(head.layout_id):
            name = f" ({head.device_name!r})" if head.device_name.isprintable() and head.device_name else ""
            raise ConnectError(
                f"{unit}{name} has another signal layout: expected {layout_text()}, got 0x{head.layout_id:08X}"
            )
        self._full = {key: self.read(key) for key in FULL_SCALES}
        return Identity(
            head.device_name, head.vendor_id, head.product_code, head.revision, head.serial, head.layout_id,
            self.read("T_s"), **self._full,
        )

    def _read(self, signals: list[Signal]) -> dict[str, float]:
        """Values of neighbours, in one request."""
        first = registers.address_of(signals[0])
        length = registers.address_of(signals[-1]) + registers.length_of(signals[-1]) - first
        what = registers.name_of(first, length)
        words = registers.registers(self._line.window(registers.REGISTERS, first, length, what).data)
        found: dict[str, float] = {}
        for signal in signals:
            at = registers.address_of(signal) - first
            data = registers.bytes_of(signal, words[at : at + registers.length_of(signal)])
            try:
                found[signal.name] = decode(signal, data, self._full)
            except ValueError as error:
                raise FrameError(f"{self._line.unit}: {error}") from None
        return found

    def _words(self, signal: Signal, value: float) -> list[int]:
        """The registers of a value to be written. Raises RefusedError."""
        if signal.access != "rw":
            where = registers.name_of(registers.address_of(signal))
            raise RefusedError(f"{where} is {signal.access}, it cannot be written", registers.ILLEGAL_ADDRESS)
        try:
            return registers.words_of(signal, encode(signal, value, self._full))
        except ValueError as error:
            raise RefusedError(str(error), registers.ILLEGAL_VALUE) from None

    def _write(self, signal: Signal, words: list[int]) -> None:
        address, back = registers.address_of(signal), list[int]()

        def write() -> None:
            back[:] = self._line.write(address, words)

        def taken() -> bool:
            window = self._line.window(registers.REGISTERS, address, len(words), registers.name_of(address))
            back[:] = registers.registers(window.data)
            return back == words

        if signal.is_parameter or signal.name in REPEATABLE:
            settle(write, taken)
        else:
            write()
        if signal.is_parameter and back != words:
            raise FrameError(
                f"{self._line.unit} took {_hex(words)} for {registers.name_of(address)}, but reads back {_hex(back)}"
            )

    def _look_twice(self) -> None:
        first, second = self.parameters(), self.parameters()
        changed = [name for name in first if first[name] != second[name]]
        if changed:
            raise FrameError(
                f"{self._line.unit} is not told to store: read twice, {', '.join(changed)} changed in between"
            )

    def _stream(self) -> Iterator[Block]:
        """Blocks as they come, until the drive is closed."""
        heard, more = time.monotonic(), False
        while not self._line.closed.is_set() and (more or not self._line.closed.wait(POLL)):
            with self._stream_lock:
                more = self._fetch()
                blocks = self._taken()
                self._lengthen()
            if blocks:
                yield from blocks
                heard = time.monotonic()  # the time that they took elsewhere is no silence of the drive's
            silent = time.monotonic() - heard
            if silent > max(SILENCE, 3.0 * self._row_time()):
                raise LostError(
                    f"{self._line.unit} fell silent: no row for {silent:.1f} s, "
                    f"expected one every {self._row_time() * 1e3:g} ms"
                )

    def _taken(self) -> list[Block]:
        """The blocks complete by now."""
        ready, self._ready = self._ready, []
        return ready + (self._blocks.take() if self._blocks else [])

    def _start(self) -> None:
        """Rows from the present tick on: those before it may be of another length."""
        now = self._read([signal_named("tick"), _ROW_LENGTH])
        self._begin(int(now["tick"]), int(now["stream_periods"]))

    def _begin(self, tick: int, periods: int) -> RowBlocks:
        """Join rows anew, of `periods` control periods each, from a tick on."""
        after = None
        if self._blocks is not None:
            after = self._blocks.end
            self._ready += self._blocks.take()
        self._tick = tick
        self._blocks = RowBlocks(self.identity.T_s, periods, self._full, tick, after)
        self._carried = Carried(periods * self.identity.T_s, self._blocks.counts, weighed=True)
        self._made.clear()
        return self._blocks

    def _fetch(self) -> bool:
        """Take in what is new, as far as a few requests reach; whether there is more."""
        begun, made = time.monotonic(), self._next
        for _ in range(_BURST):
            part = self._ask(self._next, registers.MOST_ROWS)
            made = part.made
            if _difference(part.made, self._next) < 0:
                raise ResetError(f"{self._line.unit} has reset: it counts {part.made} rows, {self._next} were heard of")
            if len(part.rows):
                self._take(part)
                self._next = (part.first + len(part.rows)) % _NUMBERS
            self._weigh(part)
            if not len(part.rows) or self._next == part.made:
                self._lagging = None
                return False
            if time.monotonic() - begun > _BURST_TIME:
                break
        self._skip(made)
        return True

    def _weigh(self, part: registers.Rows) -> None:
        """What full answers in a row carry of what the drive makes meanwhile: by its clock, whatever ours does."""
        if len(part.rows) < registers.MOST_ROWS:
            self._made.clear()
            return
        self._made.append(part.made)
        if len(self._made) > _FULL_ANSWERS and self._carried is not None:
            made = max(1, _difference(self._made[-1], self._made[0]))
            self._carried.carries(_FULL_ANSWERS * registers.MOST_ROWS / made)

    def _skip(self, made: int) -> None:
        """Go on with the newest rows where the line does not catch up: those between are lost, and counted so."""
        now, behind = time.monotonic(), _difference(made, self._next)
        if behind * self._row_time() <= LAG:
            self._lagging = None
            return
        since, was = self._lagging or (now, behind)
        if now - since > CATCH_UP:
            if behind > _CAUGHT_UP * was:
                self._next = (made - registers.MOST_ROWS) % _NUMBERS
            self._lagging = None
        else:
            self._lagging = since, was

    def _lengthen(self) -> None:
        """Ask for longer rows where many are skipped: the line does not carry them."""
        blocks, carried = self._blocks, self._carried
        if blocks is None or carried is None:
            return
        before = blocks.periods
        periods = carried.periods(blocks.counts, before)
        if periods == before:
            return
        words, made = self._words(_ROW_LENGTH, float(periods)), self._ask(0, rows=0).made
        if _difference(made, self._next) > registers.MOST_ROWS:  # what is skipped is counted in rows of its length
            self._next = (made - registers.MOST_ROWS) % _NUMBERS
        self._fetch()
        with contextlib.suppress(RefusedError, NoReplyError):  # then it goes on as it is, and tells what is lost
            self._write(_ROW_LENGTH, words)
            self._note = note(periods, before, periods * self.identity.T_s)
            self._next = self._ask(0, rows=0).made
            self._start()

    def _ask(self, first: int, rows: int) -> registers.Rows:
        length = struct.calcsize(registers.ROWS_HEAD) // 2 + rows * registers.ROW_LENGTH
        return self._taken_apart(registers.Rows.of, self._line.window(registers.ROWS, first, length, "rows"))

    def _take(self, part: registers.Rows) -> None:
        blocks, rows = self._blocks, part.rows
        assert blocks is not None
        tick = self._tick + _difference(part.tick, self._tick)  # all bits
        if not blocks.counts.rows:  # what is older than the stream is not of it
            older = -(min(0, tick - self._tick) // part.periods)
            rows, tick = rows[older:], tick + older * part.periods
        if not len(rows):
            return
        if tick < self._tick:
            raise ResetError(f"{self._line.unit} has reset: tick {part.tick} came after {self._tick}")
        if part.periods != blocks.periods:
            if blocks.counts.rows or tick > self._tick + _SETTLING:
                raise FrameError(f"somebody else has set stream_periods of {self._line.unit}")
            return
        if tick - self._tick + part.periods >= TELLABLE:
            counts, carried = blocks.counts, self._carried
            blocks = self._begin(tick, part.periods)
            blocks.counts = counts
            self._carried = carried
        blocks.temperatures = part.temperatures
        blocks.run(tick % _NUMBERS, rows)
        self._tick = tick + len(rows) * part.periods

    def _row_time(self) -> float:
        return self.identity.T_s * (self._blocks.periods if self._blocks else 1)

    def _taken_apart(self, of: Callable[[registers.Window], T], window: registers.Window) -> T:
        try:
            return of(window)
        except ValueError as error:
            raise FrameError(f"{self._line.unit} answered what cannot be: {error}") from None


def _difference(later: int, earlier: int) -> int:
    """Of two numbers of which at least one has lost all but its low 32 bits."""
    return (later - earlier + _NUMBERS // 2) % _NUMBERS - _NUMBERS // 2


def _hex(words: list[int]) -> str:
    return "0x" + registers.data_of(words).hex()
