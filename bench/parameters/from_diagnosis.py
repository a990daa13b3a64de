"""A set from a diagnosis: the machine as it is after the effects, and what makes up for each of them.

The diagnosis is its JSON, as `bench.diagnoses.published` says and a file may have it, or that of several recordings
together. A verdict that leaves something open makes every value doubtful. What is not the same in all recordings is
that of one of them, and doubtful. Knows nothing of how a diagnosis is made.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from bench.errors import ConfigError, shown
from bench.parameters.compensation import Recorded, compensations
from bench.parameters.made import DOUBTFUL, Made, Making, Size, items, name_of, number, part, parts, size_of
from bench.parameters.parameter_set import OK, ParameterSet
from bench.parameters.temperature import at_temperature
from bench.parameters.tuning import current_loop
from drivers.wire.dictionary import signal_named
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, UNITS

SETTLED: Final = ("explained", "no_mismatch")
NOT_TOLD: Final = "not_enough_excitation"
AMBIGUOUS: Final = "ambiguous"
_VERDICTS: Final = (*SETTLED, NOT_TOLD, AMBIGUOUS, "partly_explained", "unexplained")
_SHORTEST, _LONGEST = 1e-7, 1.0  # s, that a control period may be
_WIDE: Final = 0.05  # of a value, a standard error from which it is not told
_OWN: Final = "convention_error"  # of a recording, not of the machine
_CONTROL: Final = {name: f"control_{name}" for name in PARAMETERS}


def set_from_diagnosis(
    content: Mapping[str, Any], drive: Mapping[str, float] | None = None, *, name: str = "", version: int = 1,
    T_s: float | None = None, own_gains: bool = False, bandwidth: float | None = None,
    electrical_turn: int | None = None, temperatures: Mapping[str, float] | None = None, **whose: int | None,
) -> Made:
    """The set, and what no compensation absorbs. Raises ConfigError where the content is no diagnosis, LimitError.

    `drive`: its parameters (SI, by signal) as they were while it was recorded; None: it made up for nothing.
    `T_s` (s): its control period, where the diagnosis does not tell; `own_gains`: gains of the current control, of a
    `bandwidth` (rad/s) or the fastest one; `electrical_turn`: see `compensation.electrical_turn`; `temperatures`
    (degC): temp_winding and temp_magnet meanwhile; `whose`: `layout_id` and `serial` of the set.
    """
    verdict = content.get("verdict")
    if verdict not in _VERDICTS:
        raise ConfigError(f"expected a diagnosis, with a verdict of {', '.join(_VERDICTS)}, got {shown(verdict)}")
    making, one = Making(), _as_one(content) if _is_together(content) else None
    if one is not None:
        content = one.content
        making.remarks += one.remarks
    doubts = dict[str, str]() if one is None else one.doubts
    file = Path(str(part(content, "recording").get("path", ""))).name if one is None else one.of
    source = name_of(f"diagnosis of {file}" if file else "a diagnosis")
    if drive is None:
        making.remark("what the drive made up for while it was recorded is not known: it is taken for nothing")
    if verdict == NOT_TOLD:
        making.remark("the recording tells too little of the machine: it gives no values")
        making.remarks += [one for one in items(content, "remarks") if isinstance(one, str)]
    else:
        left_open = _left_open(content)
        machine = _machine(making, content, source, left_open, doubts, temperatures or {})
        recorded = _recorded(content, drive or {}, machine, T_s, electrical_turn)
        if own_gains:
            _gains(making, recorded.T_s, bandwidth, source)
        _compensated(making, content, recorded, source, left_open, doubts)
        for doubt in parts(content, "ambiguous"):
            if not doubt.get("rivals", True):
                making.remark(f"it is not told whether there is {' or '.join(map(str, items(doubt, 'effects')))}")
    layout_id, serial = (whose.get(key) for key in ("layout_id", "serial"))
    given = ParameterSet(name_of(name or source), making.entries, version, layout_id, serial)
    return Made(given, tuple(making.remarks))


def _machine(
    making: Making, content: Mapping[str, Any], source: str, left_open: str, doubts: Mapping[str, str],
    temperatures: Mapping[str, float],
) -> dict[str, float]:
    """Entries of the four parameters; those that are told, SI."""
    told, after = dict[str, float](), part(part(content, "machine"), "after")
    for parameter, signal in _CONTROL.items():
        size = size_of(part(after, parameter))
        if size is None:
            making.remark(f"{signal} is left out: {parameter} is not told")
            continue
        told[parameter] = size.value
        doubt = left_open or doubts.get(parameter, "")
        if size.std is None:
            doubt = doubt or "no interval is told"
        elif size.std > _WIDE * abs(size.value):
            doubt = doubt or f"told within {Z_95 * size.std:.2g} {UNITS[parameter]} only"
        if parameter in doubts:
            making.remark(f"{signal}: {parameter} is {doubts[parameter]}")
        warm = at_temperature(parameter, size.value, temperatures, None)
        making.take(signal, size, DOUBTFUL if doubt else OK, _because(source, doubt), **warm)
    return told


def _recorded(
    content: Mapping[str, Any], drive: Mapping[str, float], machine: Mapping[str, float], T_s: float | None,
    electrical_turn: int | None,
) -> Recorded:
    recording, nominal = part(content, "recording"), part(part(content, "machine"), "nominal")
    plate = {key: value for key in ("n_p", "i_rated") if (value := number(nominal.get(key))) is not None}
    found = dict[str, dict[str, Size]]()
    for finding in parts(content, "findings"):
        if isinstance(effect := finding.get("effect"), str):
            told = part(finding, "parameters")
            found[effect] = {key: size for key in told if (size := size_of(part(told, key))) is not None}
    currents = dict[str, tuple[float, float]]()
    for axis in ("i_d", "i_q"):
        ends = [number(end) for end in items(part(recording, "currents"), axis)]
        if len(ends) == 2 and ends[0] is not None and ends[1] is not None:
            currents[axis] = ends[0], ends[1]
    period = T_s or number(recording.get("T_s")) or 0.0
    return Recorded(
        drive, plate | dict(machine), found, currents, period if _SHORTEST <= period <= _LONGEST else None,
        number(recording.get("u_dc")), part(content, "flux_map"), electrical_turn,
    )


def _gains(making: Making, T_s: float | None, bandwidth: float | None, source: str) -> None:
    """Of the current control, by rule, from the entries there are. Raises LimitError."""
    entries = making.entries
    needed = [entries.get(_CONTROL[name]) for name in ("R_s", "L_d", "L_q")]
    known = [entry for entry in needed if entry is not None]
    if len(known) < len(needed) or T_s is None:
        making.remark("gains of the current control are left out: they need R_s, L_d, L_q and the control period")
        return
    doubtful = any(entry.status != OK for entry in known)
    R_s, L_d, L_q = (entry.value for entry in known)
    sizes = {signal: Size(value) for signal, value in current_loop(R_s, L_d, L_q, T_s, bandwidth).values.items()}
    if problem := making.take_all(sizes, DOUBTFUL if doubtful else OK, f"tuned by {source}"):
        making.remark(f"gains of the current control are left out: {problem}")


def _compensated(
    making: Making, content: Mapping[str, Any], recorded: Recorded, source: str, left_open: str,
    doubts: Mapping[str, str],
) -> None:
    in_doubt = {effect for doubt in parts(content, "ambiguous") for effect in items(doubt, "effects")}
    made, said = compensations(recorded)
    for one in made:
        unlike = {effect: doubts[effect] for effect in one.effects if effect in doubts}
        doubt = left_open or one.doubt or next(iter(unlike.values()), "")
        for effect, why in unlike.items():
            signals = ", ".join(name for name in one.values if not signal_named(name).table)
            making.remark(f"{signals}: {effect} is {why}")
        if unclear := [effect for effect in one.effects if effect in in_doubt]:
            doubt = f"{' and '.join(unclear)} cannot be told from other causes"
        because = _because(f"{source}: {', '.join(one.effects)}", doubt)
        if problem := making.take_all(one.values, DOUBTFUL if doubt else OK, because, note=one.note):
            making.remark(f"{' and '.join(one.effects)} is absorbed by no compensation: {problem}")
    for sentence in said:
        making.remark(sentence)


def _left_open(content: Mapping[str, Any]) -> str:
    """What a diagnosis leaves open of what it found; empty where it is nothing.

    An effect that may be there besides takes nothing from what was found where the diagnosis says that this holds with
    it and without it.
    """
    verdict = str(content["verdict"])
    doubts = parts(content, "ambiguous")
    holds = verdict == AMBIGUOUS and bool(doubts) and all(doubt.get("machine_holds") is True for doubt in doubts)
    return "" if verdict in SETTLED or holds else verdict.replace("_", " ")


def _because(source: str, doubt: str) -> str:
    return f"{source}; {doubt}" if doubt else source


# --- several recordings


@dataclass(frozen=True, slots=True)
class _AsOne:
    """Of several recordings what they tell as one, else what the last does, as a set is made of it."""

    content: Mapping[str, Any]  # as `bench.diagnoses.published` says, so far as a set needs it
    of: str  # the recordings
    doubts: Mapping[str, str] = field(default_factory=dict[str, str])  # by parameter and effect: not of all, a clause
    remarks: tuple[str, ...] = ()  # what is not taken over, a sentence each


def _is_together(content: Mapping[str, Any]) -> bool:
    """Whether a diagnosis is of several recordings."""
    return len(items(content, "recordings")) > 1


def _as_one(content: Mapping[str, Any]) -> _AsOne:
    """What several recordings tell, as of one."""
    names = [str(one) for one in items(content, "recordings")]
    alone, doubts = parts(content, "diagnoses"), dict[str, str]()
    machine, findings = part(content, "machine"), list[Mapping[str, Any]]()
    after = dict[str, Mapping[str, Any]]()
    for name in machine:
        after[name] = part(part(machine, name), "joint")
        if part(machine, name).get("alike") is not True:
            last = _last([part(machine, name)])
            after[name], doubts[name] = _each(part(machine, name), last), _not_of_all(names, last)
    for one in parts(content, "findings"):
        numbers = part(one, "parameters")
        sizes = {key: part(part(numbers, key), "joint") for key in numbers}
        if any(part(numbers, key).get("alike") is not True for key in numbers):
            last = _last([part(numbers, key) for key in numbers])
            sizes = {key: _each(part(numbers, key), last) for key in numbers}
            doubts[str(one.get("effect"))] = _not_of_all(names, last)
        findings.append({"effect": one.get("effect"), "parameters": sizes})
    found: dict[str, Any] = {key: content.get(key) for key in ("verdict", "ambiguous", "remarks")}
    found |= {"machine": {"after": after, "nominal": _nominal(alone)}, "findings": findings}
    found["recording"] = _recording([part(one, "recording") for one in alone])
    for k, one in enumerate(alone):
        if one_map := part(one, "flux_map"):
            found["flux_map"], doubts["flux_map"] = one_map, _not_of_all(names, k)
    own = any(one.get("effect") == _OWN for diagnosis in alone for one in parts(diagnosis, "findings"))
    said = f"{_OWN} is each recording's own, and left out: a diagnosis of that recording alone gives a set with it"
    return _AsOne(found, " and ".join(names), doubts, (said,) if own else ())


def _last(numbers: Sequence[Mapping[str, Any]]) -> int:
    """The recording that tells most of these, the last of such."""
    counts = [0] * max((len(items(one, "each")) for one in numbers), default=0)
    for one in numbers:
        for k in range(len(items(one, "each"))):
            counts[k] += size_of(_each(one, k)) is not None
    return max(range(len(counts)), key=lambda k: (counts[k], k), default=0)


def _each(one: Mapping[str, Any], k: int) -> Mapping[str, Any]:
    """What a recording tells; empty for nothing."""
    each = items(one, "each")
    told = each[k] if k < len(each) else None
    return cast(Mapping[str, Any], told) if isinstance(told, Mapping) else {}


def _not_of_all(names: Sequence[str], k: int) -> str:
    return f"not the same in all recordings: this is that of {names[k] if k < len(names) else 'the last'}"


def _nominal(alone: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    return next((found for one in alone if (found := part(part(one, "machine"), "nominal"))), dict[str, Any]())


def _recording(each: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The control period of all, the dc link's voltage of the last that has one, and the currents seen in any."""
    periods = {number(one.get("T_s")) for one in each}
    found: dict[str, Any] = {"T_s": periods.pop() if len(periods) == 1 else None}
    found["u_dc"] = next((one.get("u_dc") for one in each[::-1] if number(one.get("u_dc")) is not None), None)
    currents = dict[str, list[float]]()
    for axis in ("i_d", "i_q"):
        ends = [number(end) for one in each for end in items(part(one, "currents"), axis)]
        if known := [end for end in ends if end is not None]:
            currents[axis] = [min(known), max(known)]
    return found | {"currents": currents}
