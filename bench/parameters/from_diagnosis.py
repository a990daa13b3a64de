"""A set from a diagnosis: the machine as it is after the effects, and what makes up for each of them.

The diagnosis is its JSON, as `bench.diagnoses.published` says and a file may have it. A verdict that leaves something
open makes every value doubtful. Knows nothing of how a diagnosis is made.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from bench.errors import ConfigError, shown
from bench.parameters.compensation import Recorded, compensations
from bench.parameters.made import DOUBTFUL, Made, Making, Size, items, name_of, number, part, parts, size_of
from bench.parameters.parameter_set import OK, ParameterSet
from bench.parameters.temperature import at_temperature
from bench.parameters.tuning import current_loop
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, UNITS

SETTLED: Final = ("explained", "no_mismatch")
NOT_TOLD: Final = "not_enough_excitation"
AMBIGUOUS: Final = "ambiguous"
_VERDICTS: Final = (*SETTLED, NOT_TOLD, AMBIGUOUS, "partly_explained", "unexplained")
_SHORTEST, _LONGEST = 1e-7, 1.0  # s, that a control period may be
_WIDE: Final = 0.05  # of a value, a standard error from which it is not told
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
    recording = part(content, "recording")
    file = Path(str(recording.get("path", ""))).name
    source = name_of(f"diagnosis of {file}" if file else "a diagnosis")
    making = Making()
    if drive is None:
        making.remark("what the drive made up for while it was recorded is not known: it is taken for nothing")
    if verdict == NOT_TOLD:
        making.remark("the recording tells too little of the machine: it gives no values")
        making.remarks += [one for one in items(content, "remarks") if isinstance(one, str)]
    else:
        left_open = _left_open(content)
        machine = _machine(making, content, source, left_open, temperatures or {})
        recorded = _recorded(content, drive or {}, machine, T_s, electrical_turn)
        if own_gains:
            _gains(making, recorded.T_s, bandwidth, source)
        _compensated(making, content, recorded, source, left_open)
        for doubt in parts(content, "ambiguous"):
            if not doubt.get("rivals", True):
                making.remark(f"it is not told whether there is {' or '.join(map(str, items(doubt, 'effects')))}")
    layout_id, serial = (whose.get(key) for key in ("layout_id", "serial"))
    given = ParameterSet(name_of(name or source), making.entries, version, layout_id, serial)
    return Made(given, tuple(making.remarks))


def _machine(
    making: Making, content: Mapping[str, Any], source: str, left_open: str, temperatures: Mapping[str, float]
) -> dict[str, float]:
    """Entries of the four parameters; those that are told, SI."""
    told, after = dict[str, float](), part(part(content, "machine"), "after")
    for parameter, signal in _CONTROL.items():
        size = size_of(part(after, parameter))
        if size is None:
            making.remark(f"{signal} is left out: {parameter} is not told")
            continue
        told[parameter] = size.value
        doubt = left_open
        if size.std is None:
            doubt = doubt or "no interval is told"
        elif size.std > _WIDE * abs(size.value):
            doubt = doubt or f"told within {Z_95 * size.std:.2g} {UNITS[parameter]} only"
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
    making: Making, content: Mapping[str, Any], recorded: Recorded, source: str, left_open: str
) -> None:
    in_doubt = {effect for doubt in parts(content, "ambiguous") for effect in items(doubt, "effects")}
    made, said = compensations(recorded)
    for one in made:
        doubt = left_open or one.doubt
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
