"""A drive's clock beside ours: when a tick was, by our clock. Rows come late or in time, never early. Pure.

Crystals differ, emulated drives are held up, and a line may lag for hours: what rows alone tell is put right by asking
for the tick, whose answer is of a time between the question and itself.
"""

from typing import Final

_TICKS: Final = 1 << 32  # that a drive counts


class DriveClock:
    """Ticks are control periods since the drive's reset, of which it tells the low 32 bits; times in s, monotonic."""

    def __init__(self, T_s: float, tick: int, came: float) -> None:
        """`tick`: one that came at a time."""
        self._T_s = T_s
        self._tick = tick
        self._at = came  # when `_tick` was, at the latest

    def came(self, tick: int, now: float) -> float:
        """A row that ended at this tick has come; when that was."""
        self._at, self._tick = min(self._at + self._after(tick), now), tick
        return self._at

    def told(self, tick: int, asked: float, answered: float) -> float:
        """The drive has told its tick; when the latest row ended, after all."""
        off = self._after(tick)
        self._at = min(max(self._at, asked - off), answered - off)
        return self._at

    def _after(self, tick: int) -> float:
        """Time in s from the latest tick that came in a row to this one; < 0: it was before."""
        return self._T_s * ticks_between(self._tick, tick)


def ticks_between(one: int, other: int) -> int:
    """Ticks from one to the other, < 0: that was before, of a counter that begins anew after 2^32."""
    return (other - one + _TICKS // 2) % _TICKS - _TICKS // 2
