"""Noise on a serial line: bytes lost, added and changed, at a seeded rate. Pure."""

import math
import random


class LineNoise:
    """Spoils about `rate` of all bytes (0 to 1), a third each lost, changed, or with another one put before it."""

    def __init__(self, rate: float, seed: int) -> None:
        if not 0.0 < rate < 1.0:
            raise ValueError(f"a rate of noise is above 0 and below 1, got {rate}")
        self.hits = 0
        self._rate = rate
        self._random = random.Random(seed)
        self._next = self._distance()

    def spoilt(self, data: bytes) -> bytes:
        """What arrives of the bytes that were sent, however they are split."""
        out, at = bytearray(), 0
        while self._next < len(data) - at:
            out += data[at : at + self._next]
            at += self._next
            out += self._hit(data[at])
            at += 1
            self._next = self._distance()
        self._next -= len(data) - at
        return bytes(out + data[at:])

    def _hit(self, byte: int) -> bytes:
        self.hits += 1
        kind, other = self._random.randrange(3), self._random.randrange(256)
        return (b"", bytes([byte ^ (other or 1)]), bytes([other, byte]))[kind]

    def _distance(self) -> int:
        """Bytes before the next one that is hit."""
        return int(math.log(1.0 - self._random.random()) / math.log(1.0 - self._rate))
