"""Input check: what no diagnosis should begin with - columns that hold nothing, are cut off or contradict each other.

Every remark is a sentence that says what is wrong, what was expected and what to record instead. Where `stop` is set no
verdict is possible, and the answer is *not enough excitation* with the remarks. Knows no effect.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.angle.hall_edges import steps_of_sectors
from estimator.diagnosis.intake.answered import answered
from estimator.diagnosis.intake.causes import speed_as
from estimator.diagnosis.intake.correction import Correction
from estimator.diagnosis.intake.data_sheet import LOUD, Wrong, units
from estimator.diagnosis.intake.drive_data import MOST_OF_LINK
from estimator.diagnosis.intake.rough_fit import (
    TURNED,
    RoughFit,
    RoughStretches,
    rough_fit,
    speed_over_rate,
    stretches_of,
)
from estimator.diagnosis.intake.speed_lag import SpeedLags
from estimator.machine import PARAMETERS, Machine
from estimator.online.flux_balance import TURN
from estimator.samples import Samples, nearest_turns

FEWEST_ROWS: Final = 50  # rows
_SHORT_RUN: Final = 20  # rows of a run
_COLUMNS: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
_STANDING: Final = 0.1  # rad, electrical, in all: a rotor that stands
_IDLE: Final = 0.005  # of rated current
_LOST: Final = 0.05  # of the rows
_MOST_LOST: Final = 0.2  # of the rows, where no verdict is to be had
_TORN: Final = 0.5  # of the rows, that lie in short runs then
_CUT_OFF_SHARE: Final = 0.5  # of the rows
_CLIPPED: Final = 0.003  # of the rows
_PILED: Final = 3.0  # rows at the top over rows in the band three times as wide below it; a sine has 1
_FAR_OFTENER: Final = 8.0  # times as often as any other value
_AT_REST: Final = 0.1  # of a column's largest value: what stands nearer to zero is at rest
_LIMITS_DIFFER: Final = 0.02  # of their distance, by which two limits may differ
_RESTING_SHARE: Final = 0.5  # of the rows: a current that is the same for longer rests
_HELD_SHARE: Final = 0.05  # of the rows
_CATCHING_UP: Final = 4.0  # steps, by which an angle catches up: an encoder's moves by one or two after it stood
_SAME_FACTOR: Final = 0.015  # log
_JUMP: Final = 50  # rows that are missing at once
_GROSS: Final = 0.26  # log: 30 %
_LINE_TO_LINE: Final = math.sqrt(3.0)


class Checked(NamedTuple):
    """What is wrong with a recording."""

    remarks: tuple[str, ...]
    stop: bool  # no verdict is possible


def checked(runs: Sequence[Samples], nominal: Machine) -> Checked:
    """What is wrong with a recording before anything is fitted to it."""
    runs = [run for run in runs if len(run)]
    found = list(_unusable_columns(runs))
    if not any(wrong.stop for wrong in found):
        found += [*_excitation(runs, nominal), *_gaps(runs), *_clipped(runs), *_saturated(runs), *_held(runs)]
        stretches = stretches_of(runs)
        if stretches is not None and not any(wrong.stop for wrong in found):
            scaled = list(units(stretches, nominal))
            if any(wrong.stop for wrong in scaled):  # all else follows from it
                return Checked(tuple(wrong.sentence for wrong in scaled), stop=True)
            found += _speed(stretches, runs)
            found += [*_phase_currents(stretches, nominal.n_p), *scaled, *_two_drives(runs, nominal)]
    return Checked(tuple(wrong.sentence for wrong in found), any(wrong.stop for wrong in found))


# --- Columns


def _unusable_columns(runs: Sequence[Samples]) -> Iterator[Wrong]:
    rows = sum(map(len, runs))
    if rows < FEWEST_ROWS:
        yield Wrong(f"the recording has {rows} rows, expected at least {FEWEST_ROWS}: record a second or more", True)
        return
    longest = max(map(len, runs))
    if longest < _SHORT_RUN:
        yield Wrong(f"the longest run without a gap has {longest} rows, expected at least {_SHORT_RUN}: record every "
                    "control period, by a capture buffer where the link is too slow", True)
        return
    for name in _COLUMNS:
        bad = sum(int(np.count_nonzero(~np.isfinite(getattr(run, name)))) for run in runs)
        if bad:
            yield Wrong(f"{name} is not a number in {bad} of {rows} rows, expected one in every row: leave such rows "
                        "out, as a gap", True)
    links = [run.u_dc for run in runs if run.u_dc is not None]
    bad = sum(int(np.count_nonzero(~((u_dc > 0.0) & np.isfinite(u_dc)))) for u_dc in links)
    if bad:
        yield Wrong(f"u_dc is not above 0 V in {bad} of {rows} rows, expected the dc link's voltage in every row: "
                    "leave such rows out, as a gap, or the column", True)


def _whole(runs: Sequence[Samples], name: str) -> Array | None:
    parts = [getattr(run, name) for run in runs]
    return None if any(part is None for part in parts) else np.concatenate(parts)


def _excitation(runs: Sequence[Samples], nominal: Machine) -> Iterator[Wrong]:
    i_d, i_q, u_d, u_q = (np.concatenate([getattr(run, name) for run in runs]) for name in _COLUMNS[2:])
    for what, d, q in (("currents", i_d, i_q), ("voltages", u_d, u_q)):
        if np.ptp(d) == 0.0 and np.ptp(q) == 0.0:
            yield Wrong(f"the {what} are the same in every row, expected measured ones: check what the columns hold, "
                        "and record with steps of i_d and i_q", True)
            return
    largest = float(np.quantile(np.hypot(i_d, i_q), 0.999))
    if nominal.i_rated is not None and largest > LOUD * nominal.i_rated:
        yield Wrong(f"the currents reach {largest:.3g} A, {largest / nominal.i_rated:.2g} times the nominal i_rated: "
                    f"expected at most {LOUD:g} times; effects that grow with it are asked for over a wrong range")
    if steps_of_sectors(np.concatenate([nearest_turns(np.diff(run.theta_e), np.zeros(len(run) - 1)) for run in runs])):
        yield Wrong("theta_e moves in steps of 60 deg, as the state of Hall sensors does: expected the angle that the "
                    "drive turns voltages by; record the one that it interpolates between their edges", True)
        return
    rms = math.sqrt(float(np.mean(i_d**2 + i_q**2)))
    idle = rms < _IDLE * (nominal.i_rated or 0.0)
    turned = max(float(np.ptp(np.unwrap(run.theta_e))) for run in runs)
    if turned < _STANDING:
        stands = f"the motor stands (its angle moves by {turned:.2g} rad)"
        if idle:
            yield Wrong(f"{stands} and carries no current ({rms:.2g} A rms): nothing can be told; record it turning, "
                        "with steps of i_d and i_q", True)
        else:
            yield Wrong(f"{stands}: R_s, L_d and L_q can be told, psi_f and what grows with speed cannot; record it "
                        "at several speeds as well")
    elif idle:
        yield Wrong(f"the motor carries no current ({rms:.2g} A rms): psi_f can be told, R_s, L_d and L_q cannot; "
                    "record it with steps of i_d and i_q", True)


def _gaps(runs: Sequence[Samples]) -> Iterator[Wrong]:
    """Many short gaps; a pause is none."""
    rows = sum(map(len, runs))
    missing = [_missing(a, b) for a, b in pairwise(runs)]
    lost = sum(count for count in missing if 0.0 < count < _JUMP)
    torn = sum(len(run) for run in runs if len(run) < _SHORT_RUN)
    if lost > _MOST_LOST * (rows + lost) and torn > _TORN * rows:
        yield Wrong(f"{lost:.0f} of {rows + lost:.0f} rows are missing, in {len(runs) - 1} gaps, and {torn} of those "
                    f"left lie in runs of less than {_SHORT_RUN}: too few follow each other to tell noise from "
                    "voltages; expected every control period, record over a faster link or by a capture buffer", True)
    elif lost > _LOST * (rows + lost) or (len(runs) > 1 and rows < 2 * _SHORT_RUN * len(runs)):
        yield Wrong(f"{lost:.0f} of {rows + lost:.0f} rows are missing, in {len(runs) - 1} gaps, expected hardly any: "
                    "record over a faster link or by a capture buffer")


def _missing(a: Samples, b: Samples) -> float:
    """Rows that are missing between two runs."""
    return (b.t0 - a.t0) / a.T - len(a)


# --- Cut off


def _clipped(runs: Sequence[Samples]) -> Iterator[Wrong]:
    """Many rows at one extreme value: a plateau of a phase current, or i_d or i_q that is the very same."""
    n = sum(map(len, runs))
    for name in ("i_d", "i_q"):
        values, count = np.unique(np.concatenate([getattr(run, name) for run in runs]), return_counts=True)
        low, high = float(values[0]), float(values[-1])
        both = abs(low + high) < _LIMITS_DIFFER * (high - low)  # cut off on either side
        for end, side in ((0, -low), (-1, high)):
            usual = np.max(count[1:-1] if both else np.delete(count, end), initial=0)
            often = max(_CLIPPED * n, _FAR_OFTENER * usual) < count[end] < _RESTING_SHARE * n
            if often and side > _AT_REST * max(-low, high):
                yield Wrong(f"{name} is cut off at {values[end]:.3g} A in {count[end] / n:.1%} of the rows, expected "
                            "measured currents; these rows are used as they are: record less current, or with a larger "
                            "range")
    phases = [_whole(runs, name) for name in ("i_a", "i_b", "i_c")]
    sides = [side * phase for phase in phases if phase is not None for side in (1.0, -1.0)]
    level = max((float(np.max(side)) for side in sides), default=0.0)
    cut = 0
    for side in sides:
        near = side[side > 0.96 * level]
        band = max(0.002 * level, 1.5 * _quantum(near))
        top = int(np.count_nonzero(near > level - band))
        below = int(np.count_nonzero((near > level - 4.0 * band) & (near <= level - band)))
        if top > _PILED * max(below, 1):
            cut += top
    if cut > _CLIPPED * n:
        yield Wrong(f"the phase currents are cut off at {level:.3g} A in {min(cut / n, 1.0):.1%} of the rows, "
                    "expected within the sensors' range: record less current, or with a larger range")


def _quantum(values: Array) -> float:
    """Step between neighbouring values of a quantised column."""
    levels = np.unique(np.round(values, 9))[-20:]
    return float(np.median(np.diff(levels))) if len(levels) > 2 else 0.0


def _saturated(runs: Sequence[Samples]) -> Iterator[Wrong]:
    u_dc = _whole(runs, "u_dc")
    if u_dc is None:
        return
    u = np.concatenate([np.hypot(run.u_d, run.u_q) for run in runs])
    share = float(np.mean((u > 0.995 * u_dc / _LINE_TO_LINE) & (u < MOST_OF_LINK * u_dc)))
    if share > _CUT_OFF_SHARE:
        yield Wrong(f"the voltage is at its limit, u_dc/sqrt(3), in {share:.0%} of the rows, expected below it: what "
                    "is recorded may not be what acted; record at a lower speed or with a higher dc link")


# --- Contradictions


def _speed(stretches: RoughStretches, runs: Sequence[Samples]) -> Iterator[Wrong]:
    ratio = speed_over_rate(stretches, Correction())
    lags = SpeedLags()
    for run in runs:
        lags.take(run)
    if (lag := lags.found()) is not None and (said := lag.sentence(scale=math.isnan(ratio))):
        yield Wrong(said)
    if not math.isnan(ratio) and (ratio < 0.0 or abs(math.log(ratio)) > _SAME_FACTOR):
        yield Wrong(f"omega_e is {ratio:.4g} times the rate of change of theta_e, expected the same: electrical, in "
                    "rad and rad/s, of one sign, and the right T_s")


def _held(runs: Sequence[Samples]) -> Iterator[Wrong]:
    """An angle that stays for some rows while the motor turns, and then catches up by many steps at once."""
    moves = [np.diff(run.theta_e) for run in runs]
    sizes = np.abs(np.concatenate(moves))
    least = float(np.min(sizes[sizes > 0.0], initial=math.pi))
    step = max(least, *(run.resolution.theta_e for run in runs))
    held = sum(_caught_up(D - TURN * np.rint(D / TURN), _CATCHING_UP * step) for D in moves)
    n = sum(map(len, runs))
    if held > _HELD_SHARE * n:
        yield Wrong(f"theta_e stays the same in {held / n:.0%} of the rows, and then catches up by more than "
                    f"{_CATCHING_UP:g} of its steps at once: expected the angle of every control period")


def _caught_up(D: Array, jump: float) -> int:
    """Periods in which an angle stayed before it jumped."""
    at = np.flatnonzero(D)
    before = np.diff(at, prepend=-1) - 1
    return int(np.sum(before[np.abs(D[at]) > jump]))


def _turned_over_currents(stretches: RoughStretches, i: Vector) -> float:
    """Angle turned over that between the phase currents and i_d, i_q; NaN where there is none to be seen."""
    assert stretches.i_s is not None
    size = np.min(np.abs(i), axis=1)
    clear = size > 0.3 * float(np.sqrt(np.mean(np.abs(i) ** 2)))
    between = np.unwrap(np.angle(stretches.i_s[clear] * stretches.i[clear].conj()), axis=1)
    by_currents = between[:, -1] - between[:, 0]
    theta = np.unwrap(stretches.theta_e[clear], axis=1)
    by_angle = theta[:, -1] - theta[:, 0]
    turned = float(by_currents @ by_currents)
    if turned < TURNED**2 * max(len(by_currents), 1):
        return math.nan
    ratio = float(by_angle @ by_currents) / turned
    left = by_angle - ratio * by_currents
    return ratio if left @ left < 0.001 * (by_angle @ by_angle) else math.nan


def _phase_currents(stretches: RoughStretches, n_p: int) -> Iterator[Wrong]:
    if stretches.i_s is None:
        return
    i = stretches.i * np.exp(1j * stretches.theta_e)
    power = float(np.mean(np.abs(i) ** 2))
    ratio = complex(np.mean(stretches.i_s * i.conj())) / max(power, 1e-300)
    left = float(np.mean(np.abs(stretches.i_s - ratio * i) ** 2)) / max(power, 1e-300)
    speed = speed_as(_turned_over_currents(stretches, i), n_p, _SAME_FACTOR)
    if left > 0.1 and speed is not None and "rpm" in speed[1]:
        yield Wrong(f"the angle - theta_e, or the integral of omega_e - turns {speed[0]:.4g} times as fast as i_a, "
                    f"i_b, i_c and i_d, i_q tell: it seems to be made of a speed that is {speed[1]}, expected "
                    "electrical and in rad/s", True)
    elif left > 0.1:
        yield Wrong("i_a, i_b, i_c and the angle - theta_e, or the integral of omega_e - do not give i_d and i_q, "
                    "expected that by the amplitude-invariant transformation: check the phases' order, the angle and "
                    "the speed's unit")
    elif abs(ratio - 1.0) > 0.05:
        yield Wrong(f"i_a, i_b, i_c are {abs(ratio):.3g} times what i_d and i_q say, turned by "
                    f"{math.degrees(math.atan2(ratio.imag, ratio.real)):.0f} degrees, expected the same peak values")


def _two_drives(runs: Sequence[Samples], nominal: Machine) -> Iterator[Wrong]:
    """Two drives, or two runs, in one recording."""
    for k in _seams(runs):
        before, after = stretches_of(runs[:k]), stretches_of(runs[k:])
        if before is None or after is None:
            continue
        if any(answered(part) is not None for part in (runs[:k], runs[k:])):  # a rough fit takes it for R_s
            continue
        a, b = rough_fit(before, Correction(), nominal), rough_fit(after, Correction(), nominal)
        if _differ(a, b):
            names = ", ".join(PARAMETERS)
            values = " and ".join(", ".join(f"{value:.3g}" for value in f.value) for f in (a, b))
            yield Wrong(f"before and after {runs[k].t0:.3g} s, where the recording jumps, {names} are {values}: two "
                        "drives in one recording, expected one; give each a file of its own", True)
            return


def _seams(runs: Sequence[Samples]) -> list[int]:
    """Runs that begin after a jump: of time, or of the dc link."""
    found: list[int] = []
    for k, (a, b) in enumerate(pairwise(runs), start=1):
        missing = _missing(a, b)
        sags = a.u_dc is not None and b.u_dc is not None and abs(b.u_dc[0] / a.u_dc[-1] - 1.0) > 0.1
        if missing < -0.5 or missing > _JUMP or sags:
            found.append(k)
    return found[:3]


def _differ(a: RoughFit, b: RoughFit) -> bool:
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.log(np.maximum(a.value, 1e-12) / np.maximum(b.value, 1e-12)))
        std = np.hypot(a.std / np.abs(a.value), b.std / np.abs(b.value))
    return bool(np.sum(off - 3.0 * std > _GROSS) >= 2)
