"""What links do: frames lost, delayed, doubled, corrupted; a line closed for a while; resets; refusals. On any bus.

A fault is told in one word, KIND[=VALUE][@BEGIN[+LENGTH]], times in s since power-on by the drive's clock:

    lose=0.01  delay=0.01  double=0.01  corrupt=0.01    so many of all frames, 0 to 1
    lose=1@5+0.1                                        all, from 5 s on for 0.1 s
    closed@5+2                                          nothing passes either way
    reset@5                                             the drive resets
    refuse=0x2200                                       every access to objects of this index is refused

The same seed gives the same faults. Knows nothing of any transport.
"""

import math
import random
import re
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

RATES: Final = ("lose", "delay", "double", "corrupt")
DELAY: Final = 0.02  # s, of a frame that is delayed
FORMS: Final = (
    "lose=RATE, delay=RATE, double=RATE, corrupt=RATE, closed, reset or refuse=INDEX, each with @BEGIN or @BEGIN+LENGTH"
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
        if needs_value != (value is not None) or kind not in (*RATES, "closed", "reset", "refuse"):
            raise ValueError
        number = float(int(value or "0", 0)) if kind == "refuse" else float(value or "0")
        start, lasts = float(begin or "0"), float(length) if length else math.inf
    except ValueError:
        raise ValueError(f"expected a fault as {FORMS}, got {text!r}") from None
    if kind in RATES and not 0.0 <= number <= 1.0:
        raise ValueError(f"expected a rate of 0 to 1 in {text!r}, got {number:g}")
    if not (0.0 <= start < math.inf and lasts > 0.0):
        raise ValueError(f"expected times of 0 s or more in {text!r}")
    return Fault(kind, number, start, start + lasts)


class Faults:
    """Faults of one drive's links; may be asked from several threads."""

    def __init__(self, faults: Iterable[Fault] = (), seed: int = 1) -> None:
        self._faults = tuple(faults)
        self._random = random.Random(seed)
        self._lock = threading.Lock()
        self._resets = sorted(fault.begin for fault in self._faults if fault.kind == "reset")

    @property
    def none(self) -> bool:
        """There are none at all."""
        return not self._faults

    def closed(self, t: float) -> bool:
        """Nothing passes at time t (s)."""
        return any(fault.kind == "closed" and fault.at(t) for fault in self._faults)

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
            hit = {kind: self._random.random() < self._rate(kind, t) for kind in RATES}
            bit = self._random.randrange(8 * len(frame) or 1)
        if hit["lose"]:
            return []
        data = _flipped(frame, bit) if hit["corrupt"] else frame
        out = Passed(t + DELAY if hit["delay"] else t, data, not hit["corrupt"])
        return [out, out] if hit["double"] else [out]

    def _rate(self, kind: str, t: float) -> float:
        return max((fault.value for fault in self._faults if fault.kind == kind and fault.at(t)), default=0.0)


def _flipped(frame: bytes, bit: int) -> bytes:
    data = bytearray(frame)
    if data:
        data[bit // 8] ^= 1 << bit % 8
    return bytes(data)
