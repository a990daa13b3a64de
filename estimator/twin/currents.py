"""The twin: a machine with any set of effects, simulated from a recording's voltages, speed and angle.

Effects are equations for the voltage that currents imply, v(i). The twin looks for the currents that imply the recorded
voltage, u = v(i), from a measured current at each window's start, by Newton's method over all periods at once:

    J_start delta[k] + J_end delta[k+1] = u[k] - v(i)[k]        i <- i + delta        delta = 0 where a window starts

so the effects' equations stand in one place, whatever they are. Errors of sensors are effects, too: the currents are
those that would be measured. Two effects are too steep or remember too long for one slope per period, and are followed
from period to period: the bridge's voltage error and the resistance that rises with frequency. Knows nothing of how a
model was found.
"""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Bools, Vector
from estimator.kernel import lean_kernel
from estimator.physics.ac_resistance import rung
from estimator.physics.bridge.legs import Legs, legs_of
from estimator.physics.bridge.lost_voltage import SHOTS, lost_after, lost_in
from estimator.physics.effect import SensorError
from estimator.physics.inverter_voltage_error import bus
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows
from estimator.twin.model import (
    Model,
    base_voltage,
    beside_bridge,
    current_error,
    effects_voltage,
    frame_of,
    in_truth,
    residual,
    with_local_course,
)
from estimator.twin.response import Memory, Response, Slopes, solved_real

WINDOW: Final = 0.1  # s
_SWEEPS: Final = 4  # with the same slopes
_TRIES: Final = 8  # sweeps with the same windows
_PARTS: Final = 10  # that a window is cut into then, where they still change currents
_LARGEST_CURRENT: Final = 10.0  # of the largest current measured, or rated: as far as a simulated one goes
_SWEEPS_END: Final = 1e-4  # of the rms current: a change of currents that ends the sweeps
_END: Final = 1e-2  # of that: a step of Newton's method that is the last, so that what currents change by can be told
_SPAN: Final = 1e-3  # of the rated current, over which slopes are taken
_SHORT_DEAD_TIME: Final = 1e-4  # of the period: the same of dead time
_LITTLE_DROP: Final = 1e-5  # of the dc link: the same of drops
_NEWTON_ROUNDS: Final = 20  # of Newton's method in a period
_WHOLE_STEPS: Final = 5  # of them with whole steps


class Lost(NamedTuple):
    """The bridge's voltage error."""

    legs: Legs
    dead_time: float  # s
    u_drop: float  # V
    spread: float  # A, of currents as they are known
    knee: float  # A, of the drop


_NO_GUESS: Final = np.zeros(0, np.complex128)


class FollowedCourse(NamedTuple):
    """What currents are followed by."""

    ideal: Model  # without the bridge's voltage error
    lost: Lost
    memory: Memory
    slopes: Slopes


def implied_voltage(rows: Rows, model: Model) -> Vector:
    """Voltage (V) of each period that the currents imply."""
    return rows.u - residual(rows, rows, model)


def one_step(rows: Rows, model: Model) -> Vector:
    """Currents (A) at samples 1 to n, each from the measured one a period before and the voltage between.

    Windows of two periods predict every other sample, and those a period later the others. After a gap: the measured.
    """
    starts = [_starts(rows, 2, offset) for offset in (0, 1)]
    odd, even = (_simulated(rows, model, start) for start in starts)
    return np.where(starts[0], even, odd)[1:]


def free_run(rows: Rows, model: Model, window: int | None = None) -> Vector:
    """Currents (A) at samples, simulated from the measured one at the start of every window (periods) and run."""
    window = round(WINDOW / rows.T_s) if window is None else window
    return _simulated(rows, model, _starts(rows, window))


def followed_currents(rows: Rows, model: Model, share: float, near: Vector | None = None) -> tuple[Vector, Vector]:
    """Currents (A) at samples that follow the model, and by a `share` a period the measured ones: with less noise.

    And the voltage (V, measured frame) that the bridge loses meanwhile, for currents that are known. Each run starts
    from the measured ones. Effects are seen at these currents, so that noise is not driven by them. `near`: currents
    that follow a model like it, from which they are found sooner.
    """
    truth = in_truth(rows, model)
    starts = _starts(rows, len(rows) + 1)
    course = _course_of_model(truth, _physics(model))
    close, limit = _current_bounds(truth)
    left = truth.u - _voltage(truth, course.ideal)
    guess = _NO_GUESS if near is None else (near - rows.i) * rows.rotor * truth.rotor.conj()
    delta, lost = _carried(left, course.slopes, starts, truth.i, truth.rotor, truth.half, course.memory, course.lost,
                           _END * close, limit, share, guess)  # fmt: skip
    return rows.i + delta * truth.rotor * rows.rotor.conj(), lost * frame_of(rows, truth)


def response_of(rows: Rows, model: Model, share: float, smooth: Rows) -> Response:
    """Around a model; `smooth`: the rows with currents that follow one like it. See `followed_currents`."""
    truth = in_truth(rows, model)
    course = _course_of_model(truth, _physics(model))
    i_s = in_truth(smooth, model).i_s
    legs, dead_time, u_drop, spread, knee = course.lost
    found = np.empty((6, len(rows)), np.complex128)
    _lost_around(
        found,
        legs,
        i_s,
        dead_time,
        u_drop,
        spread,
        knee,
        _SPAN * rows.i_rated,
        _SHORT_DEAD_TIME * rows.T_s,
        _LITTLE_DROP * bus(rows),
    )
    back = truth.middle.conj()
    return Response(
        course.slopes, (found[0], found[1]), (found[2], found[3]), (found[4] * back, found[5] * back),
        _starts(rows, len(rows) + 1), truth.rotor, truth.half, course.memory, share,
    )  # fmt: skip


@lean_kernel
def _lost_around(
    found: NDArray[np.complex128], legs: Legs, i_s: Vector, dead_time: float, u_drop: float, spread: float, knee: float,
    span: float, time: float, drop: float,
) -> None:  # fmt: skip
    """Write slopes of the lost voltage (V, stationary) by the currents at start and end, dead time and drop (6 x n)."""
    for k in range(found.shape[1]):
        i_0, i_1 = i_s[k], i_s[k + 1]
        here = lost_after(legs, k, i_0, i_1, dead_time, u_drop, knee, 0j, SHOTS)
        near = here.beside
        right = lost_after(legs, k, i_0 + span, i_1, dead_time, u_drop, knee, near, SHOTS).volts
        up = lost_after(legs, k, i_0 + 1j * span, i_1, dead_time, u_drop, knee, near, SHOTS).volts
        spread_here = lost_in(legs, k, i_0, i_1, dead_time, u_drop, spread, knee)
        later = lost_in(legs, k, i_0, i_1, dead_time + time, u_drop, spread, knee)
        more = lost_in(legs, k, i_0, i_1, dead_time, u_drop + drop, spread, knee)
        found[0, k], found[1, k] = (right - here.volts) / span, (up - here.volts) / span
        found[2, k], found[3, k] = here.by_real, here.by_imag
        found[4, k], found[5, k] = (later - spread_here) / time, (more - spread_here) / drop


def _simulated(rows: Rows, model: Model, starts: Bools) -> Vector:
    """Measured currents: those of the machine with its effects, and the errors of measurement on top."""
    rows = rows.with_machine(model.machine)
    truth = in_truth(rows, model)
    i_s = _implied_currents(truth, _physics(model), starts) * truth.rotor
    measured = i_s * rows.rotor.conj()
    for _ in range(5):  # errors are told of what is measured
        error = current_error(_with_currents(rows, measured), model)
        if isinstance(error, float):
            break
        measured = (i_s + error) * rows.rotor.conj()
    return np.where(starts, rows.i, measured)


def _physics(model: Model) -> Model:
    """The model without its errors of measurement."""
    kept = {name: sizes for name, sizes in model.effects.items() if not isinstance(BY_NAME[name], SensorError)}
    return Model(model.machine, kept, bend=model.bend)


def _starts(rows: Rows, window: int, offset: int = 0) -> Bools:
    """Samples where a window starts; the first `offset` periods of a run are a window of their own."""
    place = np.arange(len(rows) + 1)
    first = np.concatenate(([True], ~rows.joined))
    place -= np.maximum.accumulate(np.where(first, place, 0))
    return first | ((place - offset) % window == 0)


def _with_currents(rows: Rows, i: Vector) -> Rows:
    """What a bridge, and a machine that saturates, do stays that of the measured currents."""
    return rows.changed(i=i)


def _voltage(truth: Rows, model: Model) -> Vector:
    """Voltage (V) that true currents imply."""
    return base_voltage(truth, model) + effects_voltage(truth, model)


def _without(model: Model, *names: str) -> Model:
    return replace(model, effects={name: sizes for name, sizes in model.effects.items() if name not in names})


def _voltage_slopes(rows: Rows, model: Model) -> Slopes:
    """How each period's voltage changes with the current at its start along d and q, and at its end, ohm.

    Every other sample is moved, so that each period has one end that is.
    """
    v, h = _voltage(rows, model), _SPAN * rows.i_rated
    start_d, start_q, end_d, end_q = (np.empty_like(v) for _ in range(4))
    for parity in (0, 1):
        for step, start, end in ((h, start_d, end_d), (1j * h, start_q, end_q)):
            i = rows.i.copy()
            i[parity::2] += step
            slope = (_voltage(_with_currents(rows, i), model) - v) / h
            start[parity::2], end[1 - parity :: 2] = slope[parity::2], slope[1 - parity :: 2]
    return Slopes(start_d, start_q, end_d, end_q)


def _course_of_model(rows: Rows, model: Model) -> FollowedCourse:
    """Of a model without errors of measurement, around true currents."""
    ideal = _without(model, "inverter_voltage_error")
    lost = Lost(legs_of(rows), *map(float, model.effects.get("inverter_voltage_error", (0.0, 0.0, 1.0, 1.0))))
    rise, corner = model.effects.get("ac_resistance", (0.0, 1.0))
    x, share, late = rung(rows.T_s, float(corner))
    memory = Memory(float(rise) * rows.machine.R_s / x, share, late)
    return FollowedCourse(ideal, lost, memory, _voltage_slopes(rows, _without(ideal, "ac_resistance")))


def _current_bounds(rows: Rows) -> tuple[float, float]:
    """A change of currents (A) that is none, and the largest current."""
    size = np.abs(rows.i)
    return _SWEEPS_END * float(np.sqrt(np.mean(size**2))), _LARGEST_CURRENT * max(float(np.max(size)), rows.i_rated)


def _implied_currents(rows: Rows, model: Model, starts: Bools) -> Vector:
    """Currents that imply the recorded voltage; windows in which none are found are cut into shorter ones."""
    ideal, lost, memory, slopes = _course_of_model(rows, model)
    close, limit = _current_bounds(rows)
    i, first, sweep = rows.i, np.flatnonzero(starts), 0
    while True:
        left = rows.u - _voltage(_with_currents(rows, i), ideal)
        delta, gone = _carried(left, slopes, starts, i, rows.rotor, rows.half, memory, lost, _END * close, limit, 0.0,
                               _NO_GUESS)  # fmt: skip
        i, sweep = i + delta, sweep + 1
        if "inverter_voltage_error" in model.effects:
            rows = rows.changed(lost=gone)
            lost = lost._replace(legs=legs_of(beside_bridge(with_local_course(_with_currents(rows, i), model), model)))
        moving = ~(np.maximum.reduceat(np.abs(delta), first) <= close)
        if not np.any(moving):
            return i
        if sweep % _TRIES == 0:
            length = np.diff(first, append=len(i))
            if np.max(length[moving]) <= 2:
                return i
            i = np.where(np.repeat(moving, length), rows.i, i)
            starts = starts.copy()
            for part in range(1, _PARTS):
                starts[(first + length * part // _PARTS)[moving]] = True
            first = np.flatnonzero(starts)
        if sweep % _SWEEPS == 0:
            slopes = _voltage_slopes(_with_currents(rows, i), _without(ideal, "ac_resistance"))


def _carried(
    left: Vector, slopes: Slopes, starts: Bools, i: Vector, rotor: Vector, half: Vector, memory: Memory, lost: Lost,
    close: float, limit: float, forgotten: float, guess: Vector,
) -> tuple[Vector, Vector]:  # fmt: skip
    """Changes of currents (A) at samples that undo what is left of voltages (V), from none where a window starts.

    The bridge's lost voltage (V) is no part of what is left: it is solved for in each period, and comes with them. A
    share of the change is `forgotten` each period. `guess`: changes that are not far off, or none.
    """
    delta, lost_there = np.zeros(len(left) + 1, np.complex128), np.zeros(len(left), np.complex128)
    _carry(delta, lost_there, left, slopes, starts, i, rotor, half, memory, lost, close, limit, forgotten, guess)
    return delta, lost_there


@lean_kernel
def _carry(
    delta: Vector, lost_there: Vector, left: Vector, slopes: Slopes, starts: Bools, i: Vector, rotor: Vector,
    half: Vector, memory: Memory, lost: Lost, close: float, limit: float, forgotten: float, guess: Vector,
) -> None:  # fmt: skip
    """Write the same, and the voltages, which begin as zeros."""
    R, share, late = memory
    i_x = 0j
    for k in range(len(left)):
        before, after = half[k].conjugate(), half[k]
        v = left[k] - slopes.start_d[k] * delta[k].real - slopes.start_q[k] * delta[k].imag
        if not starts[k + 1]:
            v -= R * ((share - late) * before * delta[k] - share * (rotor[k] * after).conjugate() * i_x)
            d, q = slopes.end_d[k] + R * late * after, slopes.end_q[k] + 1j * R * late * after
            if lost.dead_time == 0.0 and lost.u_drop == 0.0:
                delta[k + 1] = solved_real(d, q, v)
            else:
                i_0, i_1 = (i[k] + delta[k]) * rotor[k], i[k + 1] * rotor[k + 1]
                begin = delta[k]
                if len(guess):
                    begin += guess[k + 1] / (1.0 - forgotten) - guess[k]
                delta[k + 1], lost_there[k] = _solution_with_lost(
                    d, q, v, lost, k, i_0, i_1, rotor[k + 1], begin, close
                )
            there = abs(i[k + 1] + delta[k + 1])
            if there > limit:
                delta[k + 1] = (i[k + 1] + delta[k + 1]) * (limit / there) - i[k + 1]
            delta[k + 1] *= 1.0 - forgotten
        i_0, i_1 = delta[k] * rotor[k], delta[k + 1] * rotor[k + 1]
        i_x += share * (i_0 - i_x) + late * (i_1 - i_0)


@lean_kernel
def _solution_with_lost(
    d: complex, q: complex, v: complex, lost: Lost, k: int, i_0: complex, i_1: complex, rotor: complex, x: complex,
    close: float,
) -> tuple[complex, complex]:  # fmt: skip
    """x of d Re x + q Im x + the lost voltage where a period that starts with i_0 ends with i_1 + x rotor = v; and it.

    Newton's method; steps that go on for long are halved: lost voltage changes fast where a phase current changes sign.
    """
    legs, dead_time, u_drop, _, knee = lost
    back, beside, here = legs.middle[k].conjugate(), 0j, 0j
    for n in range(_NEWTON_ROUNDS):
        end = i_1 + x * rotor
        shots = 1 if n < _WHOLE_STEPS else SHOTS
        here, by_real, by_imag, beside, settled = lost_after(
            legs, k, i_0, end, dead_time, u_drop, knee, beside, shots
        )
        d_lost, q_lost = by_real * rotor.real + by_imag * rotor.imag, by_imag * rotor.real - by_real * rotor.imag
        off = d * x.real + q * x.imag + here * back - v
        step = solved_real(d + d_lost * back, q + q_lost * back, off)
        if n >= _WHOLE_STEPS:
            step *= 0.5
        x -= step
        here += by_real * (-step * rotor).real + by_imag * (-step * rotor).imag
        if settled and abs(step) < close:
            break
    return x, here * back
