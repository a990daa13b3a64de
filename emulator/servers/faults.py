"""What links do: frames lost, delayed, doubled, corrupted; lines that end; resets; refusals. On any bus.

A fault is told in one word, KIND[=VALUE][@BEGIN[+LENGTH]], times in s since power-on by the drive's clock:

    lose=0.01  double=0.01  corrupt=0.01    so many of all frames, 0 to 1
    delay=0.01  late=0.01                   ... come 20 ms later; 0.5 s later, when nobody waits for them any more
    noise=0.0001                            so many of all bytes are lost, changed, or have another put before them
    lose=1@5+0.1                            all, from 5 s on for 0.1 s
    closed@5+2                              nothing passes either way
    unplugged@5+2                           the port, the line, the end on the bus is gone, and then there again
    busoff@5+2                              CAN: the node leaves the bus, and comes back pre-operational
    reset@5                                 the drive resets, as when its power fails: what it is storing is cut
    refuse=0x2200                           every access to objects of this index is refused

A script is a file of such words, a line each; what follows a '#' is a comment. The same seed gives the same faults.
Knows nothing of any transport.
"""

import math
import random
import re
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from emulator.input_file import read_text

RATES: Final = ("lose", "delay", "late", "double", "corrupt", "noise")
SPANS: Final = ("closed", "unplugged", "busoff", "reset")
INDICES: Final = range(0x1000, 0xA000)  # of objects that a drive can have (CiA 301, table 40)
DELAY: Final = 0.02  # s, of a frame that is delayed
LATE: Final = 0.5  # s, of one that is late: clients wait 0.3 s
FORMS: Final = (
    f"{', '.join(f'{kind}=RATE' for kind in RATES)}, {', '.join(SPANS)} or refuse=INDEX, "
    "each with @BEGIN or @BEGIN+LENGTH, reset with @BEGIN alone"
)
_SPEC: Final = re.compile(r"(\w+)(?:=([^@]+))?(?:@([^+]+)(?:\+(.+))?)?")


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault; `value` is a rate, or an index."""

    kind: str
    value: float = 0.0
    begin: float = 0.0  # s
    end: float = math.inf  # s

    def at(self, t: float) -> bool:
        """It happens at time t (s)."""
        return self.begin <= t < self.end


class Passed(NamedTuple):
    """A frame as it comes out of the line."""

    at: float  # s
    data: bytes
    intact: bool  # a checksum on the way says so


def parse_fault(text: str) -> Fault:
    """The fault that a word tells. Raises ValueError, in a sentence."""
    match = _SPEC.fullmatch(text)
    kind, value, begin, length = match.groups() if match else ("", None, None, None)
    needs_value = kind in (*RATES, "refuse")
    try:
        if needs_value != (value is not None) or kind not in (*RATES, *SPANS, "refuse"):
            raise ValueError
        number = float(int(value or "0", 0)) if kind == "refuse" else float(value or "0")
        start, lasts = float(begin or "0"), float(length) if length else math.inf
    except ValueError:
        raise ValueError(f"expected a fault as {FORMS}, got {text!r}") from None
    if kind in RATES and not 0.0 <= number <= 1.0:
        raise ValueError(f"expected a rate of 0 to 1 in {text!r}, got {number:g}")
    if kind == "refuse" and number not in INDICES:
        raise ValueError(f"expected an index of 0x{INDICES[0]:X} to 0x{INDICES[-1]:X} in {text!r}, got {value}")
    if kind == "reset" and length:
        raise ValueError(f"a reset takes no time: expected reset@BEGIN, got {text!r}")
    if not (0.0 <= start < math.inf and lasts > 0.0):
        raise ValueError(f"expected times of 0 s or more in {text!r}")
    return Fault(kind, number, start, start + lasts)


def script(path: Path) -> list[Fault]:
    """The faults of a file. Raises ValueError, in a sentence with file and line."""
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeError) as error:
        raise ValueError(f"cannot read the faults in {path}: {getattr(error, 'strerror', None) or error}") from None
    faults = list[Fault]()
    for number, line in enumerate(lines, 1):
        if word := line.partition("#")[0].strip():
            try:
                faults.append(parse_fault(word))
            except ValueError as error:
                raise ValueError(f"{path}, line {number}: {error}") from None
    return faults


class Faults:
    """Faults of one drive's links; may be asked from several threads."""

    def __init__(self, faults: Iterable[Fault] = (), seed: int = 1) -> None:
        self._faults = tuple(faults)
        self._random = random.Random(seed)
        self._lock = threading.Lock()
        self._resets = sorted(fault.begin for fault in self._faults if fault.kind == "reset")

    def check_links(self, can: bool) -> None:
        """Raise ValueError, in a sentence, where a fault is of CAN alone and there is no CAN link."""
        if not can and any(fault.kind == "busoff" for fault in self._faults):
            raise ValueError("expected a CAN link (--at canopen://...) for busoff, there is none")

    @property
    def none(self) -> bool:
        """There are none at all."""
        return not self._faults

    def closed(self, t: float) -> bool:
        """Nothing passes at time t (s)."""
        return self._happens("closed", t)

    def unplugged(self, t: float) -> bool:
        """There is no line at time t (s)."""
        return self._happens("unplugged", t)

    def bus_off(self, t: float) -> bool:
        """A CAN node is off its bus at time t (s)."""
        return self._happens("busoff", t)

    def refuses(self, index: int, t: float) -> bool:
        """Accesses to an object are refused at time t (s)."""
        return any(fault.kind == "refuse" and fault.value == index and fault.at(t) for fault in self._faults)

    def reset_due(self, t: float) -> bool:
        """The drive is to reset by time t (s); told once for each reset."""
        due = bool(self._resets) and self._resets[0] <= t
        if due:
            self._resets.pop(0)
        return due

    def passed(self, frame: bytes, t: float) -> list[Passed]:
        """What becomes of a frame that goes into the line at time t (s)."""
        if not self._faults:
            return [Passed(t, frame, True)]
        if self.closed(t):
            return []
        with self._lock:
            hit = {kind: self._random.random() < self._rate(kind, t) for kind in RATES if kind != "noise"}
            data = self._flipped(frame) if hit["corrupt"] else frame
            data = self._noised(data, self._rate("noise", t))
        if hit["lose"]:
            return []
        out = Passed(t + hit["delay"] * DELAY + hit["late"] * LATE, data, data == frame)
        return [out, out] if hit["double"] else [out]

    def _happens(self, kind: str, t: float) -> bool:
        return any(fault.kind == kind and fault.at(t) for fault in self._faults)

    def _rate(self, kind: str, t: float) -> float:
        return max((fault.value for fault in self._faults if fault.kind == kind and fault.at(t)), default=0.0)

    def _flipped(self, frame: bytes) -> bytes:
        """The frame with one bit changed."""
        data = bytearray(frame)
        if data:
            bit = self._random.randrange(8 * len(data))
            data[bit // 8] ^= 1 << bit % 8
        return bytes(data)

    def _noised(self, frame: bytes, rate: float) -> bytes:
        """The frame with each byte hit at this rate: lost, changed, or with another one put before it."""
        if not rate:
            return frame
        out = bytearray()
        for byte in frame:
            if self._random.random() >= rate:
                out.append(byte)
                continue
            kind, other = self._random.randrange(3), self._random.randrange(256)
            out += (b"", bytes([byte ^ (other or 1)]), bytes([other, byte]))[kind]
        return bytes(out)
