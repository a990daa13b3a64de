"""What a set would change in a drive, and every reason why it may not, before anything is written.

Values are compared as they travel: what a drive would hold of a value, its 32 bits, decides.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

from bench.parameters.parameter_set import FLASHED, OK, ParameterSet, problem_of
from drivers.drive import Identity
from drivers.wire.codec import decode, encode_held
from drivers.wire.dictionary import Signal

Judge = Callable[[Mapping[str, float], Collection[str]], list[str]]
"""What limits forbid: of all values as they would be, and the names of those that would be others, a sentence each."""
_BY_NAME: Final = {signal.name: signal for signal in FLASHED}


@dataclass(frozen=True, slots=True)
class Change:
    """One value that would be another."""

    signal: Signal
    old: float  # SI
    new: float  # SI, as the set has it
    held: float  # SI, what the drive then has of it
    counts: tuple[str, str]  # bytes before and then, in hex, as they travel

    @property
    def rounding(self) -> float:
        """By how much the value that the drive holds is off the set's, SI."""
        return self.held - self.new


@dataclass(frozen=True, slots=True)
class Plan:
    """All of it. `problems` forbid it; `doubts` forbid it unless somebody says why they do not; `remarks` do not."""

    changes: tuple[Change, ...]
    same: int  # values that the drive has already
    problems: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """What is to be written, SI."""
        return {change.signal.name: change.new for change in self.changes}


def plan(
    given: ParameterSet, identity: Identity, present: Mapping[str, float], judge: Judge = lambda _values, _changed: []
) -> Plan:
    """What a set would change in a drive whose parameters are `present` (SI); `judge` tells what limits forbid."""
    if not identity.has_memory:
        return Plan((), 0, (f"layout 0x{identity.layout_id:08X} tells nothing of its memory: it cannot be flashed",))
    problems, doubts = list(given.unfit), list[str]()
    if given.serial not in (None, identity.serial):
        problems.append(f"the set is for drive 0x{given.serial:08X}, this is 0x{identity.serial:08X}")
    if given.layout_id not in (None, identity.layout_id):
        problems.append(f"the set is for layout 0x{given.layout_id:08X}, this drive has 0x{identity.layout_id:08X}")
    fit = dict[str, float]()
    for name, entry in given.entries.items():
        if problem := problem_of(name, entry.value) or ("" if name in present else f"the drive does not have {name}"):
            problems.append(problem)
        else:
            fit[name] = entry.value
        if entry.status != OK:
            doubts.append(f"{name} is {entry.status}{f' ({entry.source})' if entry.source else ''}")
        if entry.outside:
            doubts.append(f"{name} = {entry.value:g} is outside its interval, {_interval(entry.low, entry.high)}")
    changes = tuple(
        change for name, value in fit.items()
        if (change := _change(_BY_NAME[name], present[name], value)) is not None
    )  # fmt: skip
    problems += judge({**present, **fit}, [change.signal.name for change in changes])
    return Plan(changes, len(fit) - len(changes), tuple(problems), tuple(doubts))


def bits(name: str, value: float) -> bytes:
    """A parameter as it travels, also one that a drive holds and nobody could write."""
    return encode_held(_BY_NAME[name], value, {})


def different(wanted: Mapping[str, float], found: Mapping[str, float]) -> list[str]:
    """Names whose values are not the same bits, or not there."""
    return [name for name, value in wanted.items() if name not in found or bits(name, value) != bits(name, found[name])]


def _change(signal: Signal, old: float, new: float) -> Change | None:
    before, then = bits(signal.name, old), bits(signal.name, new)
    return None if before == then else Change(signal, old, new, decode(signal, then, {}), (before.hex(), then.hex()))


def _interval(low: float | None, high: float | None) -> str:
    return f"{'-' if low is None else f'{low:g}'} to {'-' if high is None else f'{high:g}'}"
