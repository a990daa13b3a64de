"""The control lease: who may move the motor, and the one record by which that client does it. Pure: bytes and values.

A drive takes set points, and is switched on, by its lease's holder alone, and only in a *control record*: one write
that it takes whole or not at all (a segmented SDO transfer, one Modbus block write, one UART request). The record
carries the holder's token, a number that the client draws and that nobody can read back. Taking the lease and renewing
it are records too; nothing else renews it, whoever reads. The lease lasts for the time in the record, at most
`watchdog_time`. When it ends - given up, not renewed, stopped by anybody - the bridge is off and all set points are
zero. While nobody holds it any client may write what is configuration; reading, and stopping by the control word, are
anybody's at any time.

    <I token  B action  B bridge  H time in ms  16s holder, ASCII>   then per value   <H index  B sub-index  B size  4s>

Values are little-endian, as in SDO, padded with zeros to four bytes. The holder's name stands for all to read in
`lease_holder_1` to `lease_holder_4`.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.wire.dictionary import Signal, signal_at

HOLDER: Final = 16  # characters of a holder's name, at most
LOCAL: Final = "local"  # the holder's name where a master inside the drive controls it
MOST_VALUES: Final = 24  # of one record: as many as a Modbus block write carries
_HEAD: Final = struct.Struct(f"<IBBH{HOLDER}s")
_VALUE: Final = struct.Struct("<HBB4s")


class Action(IntEnum):
    """What becomes of the lease."""

    TAKE = 1  # for who holds it already: renew
    RENEW = 2
    RELEASE = 3


class Bridge(IntEnum):
    """What becomes of the bridge."""

    AS_IT_IS = 0
    ON = 1  # through the states of CiA 402 to operation enabled; without effect in fault
    OFF = 2  # to switch on disabled


class End(IntEnum):
    """How the latest lease ended, as `lease_end` tells."""

    NONE = 0
    RELEASED = 1
    RAN_OUT = 2
    STOPPED = 3  # by another client

    @property
    def words(self) -> str:
        """As a sentence has it, after "control of the drive"."""
        return ("has not been had", "was given up", "was not renewed in time", "was ended by another's stop")[self]


@dataclass(frozen=True, slots=True)
class Record:
    """A control record."""

    token: int  # 32 bits, not 0
    action: Action
    bridge: Bridge = Bridge.AS_IT_IS
    seconds: float = 0.0  # without renewal after which the lease ends
    holder: str = ""  # taken with TAKE
    values: tuple[tuple[Signal, bytes], ...] = ()  # written in this order, before the bridge goes on


def packed(record: Record) -> bytes:
    """Bytes of a record. Raises ValueError where it cannot be one."""
    if not 0 < record.token < 1 << 32:
        raise ValueError(f"a token is a number of 32 bits and not 0, got {record.token}")
    if len(record.values) > MOST_VALUES:
        raise ValueError(f"a control record takes {MOST_VALUES} values, got {len(record.values)}")
    holder = record.holder.encode("ascii", "replace")[:HOLDER]
    head = _HEAD.pack(record.token, record.action, record.bridge, round(1e3 * record.seconds), holder)
    return head + b"".join(_VALUE.pack(s.index, s.subindex, len(data), data) for s, data in record.values)


def unpacked(data: bytes, known: Callable[[Signal], bool] = lambda _: True) -> Record:
    """A record from its bytes. Raises ValueError where there is none, or it is about signals that are not known."""
    rest = len(data) - _HEAD.size
    if rest < 0 or rest % _VALUE.size or rest > MOST_VALUES * _VALUE.size:
        raise ValueError(f"a control record has {_HEAD.size} bytes and {_VALUE.size} a value, got {len(data)}")
    token, action, bridge, ms, holder = _HEAD.unpack_from(data)
    if not token:
        raise ValueError("a token is not 0")
    values = tuple(_value(part, known) for part in _VALUE.iter_unpack(data[_HEAD.size :]))
    name = holder.rstrip(b"\0").decode("ascii", "replace")
    if not name.isprintable():
        raise ValueError(f"a holder's name is printable, got {name!r}")
    return Record(token, Action(action), Bridge(bridge), 1e-3 * ms, name, values)


def _value(part: tuple[int, int, int, bytes], known: Callable[[Signal], bool]) -> tuple[Signal, bytes]:
    index, subindex, size, data = part
    signal = signal_at(index, subindex)
    if signal is None or not known(signal) or signal.access != "rw":
        raise ValueError(f"0x{index:04X}:{subindex} is nothing that can be written")
    if 8 * size != signal.type.bits:
        raise ValueError(f"{signal} has {signal.type.bits // 8} bytes, got {size}")
    return signal, data[:size]


def holder_words(name: str) -> list[int]:
    """`lease_holder_1` to `lease_holder_4` for a holder's name."""
    return list(struct.unpack("<4I", name.encode("ascii", "replace")[:HOLDER].ljust(HOLDER, b"\0")))


def holder_name(words: list[int]) -> str:
    """The holder's name, from `lease_holder_1` to `lease_holder_4`; empty where there is none."""
    return struct.pack("<4I", *words).rstrip(b"\0").decode("ascii", "replace")
