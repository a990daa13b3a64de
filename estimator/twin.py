"""The twin: a machine with any set of effects, simulated from a recording's voltages, speed and angle.

Effects are equations for the voltage that currents imply, v(i). The twin looks for the currents that imply the recorded
voltage, u = v(i), from a measured current at each window's start, by Newton's method over all periods at once:

    J_start delta[k] + J_end delta[k+1] = u[k] - v(i)[k]        i <- i + delta        delta = 0 where a window starts

so the effects' equations stand in one place, whatever they are. Errors of sensors are effects, too: the currents are
those that would be measured. Knows nothing of how a model was found.
"""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel
from estimator.mismatch.columns import Model, base_voltage, effects_voltage, with_machine
from estimator.physics.lost_voltage import Legs, legs_of, lost_voltage
from estimator.physics.rows import Rows, Vector

Bools = NDArray[np.bool_]

WINDOW: Final = 0.1  # s
_SWEEPS: Final = 10
_CLOSE: Final = 1e-4  # of the rms current: a change of currents that ends the sweeps
_SPAN: Final = 1e-3  # of the rated current, over which slopes are taken
_ROUNDS: Final = 20  # of Newton's method in a period
_HALVINGS: Final = 8  # of a step of it that leads away
_OF_INPUTS: Final = ("D", "rotor", "duties", "six", "once", "edges at start")  # not of currents


class Slopes(NamedTuple):
    """How each period's voltage changes with the current (ohm) at its start and its end, along d and q."""

    start_d: Vector
    start_q: Vector
    end_d: Vector
    end_q: Vector


def implied_voltage(rows: Rows, model: Model) -> Vector:
    """Voltage (V) of each period that the currents imply."""
    rows = with_machine(rows, model.machine)
    return base_voltage(rows, model) + effects_voltage(rows, model)


def one_step(rows: Rows, model: Model) -> Vector:
    """Currents (A) at samples 1 to n, each from the measured one a period before and the voltage between.

    Windows of two periods predict every other sample, and those a period later the others. After a gap: the measured.
    """
    rows = with_machine(rows, model.machine)
    starts = [_starts(rows, 2, offset) for offset in (0, 1)]
    odd, even = (_solved(rows, model, start) for start in starts)
    return np.where(starts[0], even, odd)[1:]


def free_run(rows: Rows, model: Model, window: int | None = None) -> Vector:
    """Currents (A) at samples, simulated from the measured one at the start of every window (periods) and run."""
    rows = with_machine(rows, model.machine)
    window = round(WINDOW / rows.T_s) if window is None else window
    return _solved(rows, model, _starts(rows, window))


def _starts(rows: Rows, window: int, offset: int = 0) -> Bools:
    """Samples where a window starts; the first `offset` periods of a run are a window of their own."""
    place = np.arange(len(rows) + 1)
    first = np.concatenate(([True], ~rows.joined))
    place -= np.maximum.accumulate(np.where(first, place, 0))
    return first | ((place - offset) % window == 0)


def _with_currents(rows: Rows, i: Vector) -> Rows:
    return replace(rows, i=i, kept={key: rows.kept[key] for key in _OF_INPUTS if key in rows.kept})


def _slopes(rows: Rows, model: Model, v: Vector) -> Slopes:
    """How each period's voltage changes with the current at its start along d and q, and at its end, ohm.

    Every other sample is moved, so that each period has one end that is.
    """
    h = _SPAN * rows.i_rated
    start_d, start_q, end_d, end_q = (np.empty_like(v) for _ in range(4))
    for parity in (0, 1):
        for step, start, end in ((h, start_d, end_d), (1j * h, start_q, end_q)):
            i = rows.i.copy()
            i[parity::2] += step
            slope = (implied_voltage(_with_currents(rows, i), model) - v) / h
            start[parity::2], end[1 - parity :: 2] = slope[parity::2], slope[1 - parity :: 2]
    return Slopes(start_d, start_q, end_d, end_q)


def _solved(rows: Rows, model: Model, starts: Bools) -> Vector:
    """Currents that imply the recorded voltage."""
    steep = model.effects.get("inverter_voltage_error", (0.0, 0.0, 1.0))
    smooth = replace(model, effects={k: v for k, v in model.effects.items() if k != "inverter_voltage_error"})
    close = _CLOSE * float(np.sqrt(np.mean(np.abs(rows.i) ** 2)))
    legs = legs_of(rows)
    i, v = rows.i, implied_voltage(rows, smooth)
    slopes = _slopes(rows, smooth, v)
    for _ in range(_SWEEPS):
        delta = _carried(rows.u - v, slopes, starts, i, rows.rotor, legs, *map(float, steep), 0.1 * close)
        i = i + delta
        if DEBUG is not None:
            DEBUG.append((np.abs(delta), close))
        if np.max(np.abs(delta)) < close:
            break
        v = implied_voltage(_with_currents(rows, i), smooth)
    return i


DEBUG=None

@kernel
def _carried(
    left: Vector, slopes: Slopes, starts: Bools, i: Vector, rotor: Vector, legs: Legs, dead_time: float, u_drop: float,
    width: float, close: float,
) -> Vector:  # fmt: skip
    """Changes of currents (A) at samples that undo what is left of voltages (V), from none where a window starts.

    The bridge's lost voltage is no part of what is left: it is solved for in each period.
    """
    delta = np.zeros(len(left) + 1, np.complex128)
    ideal = dead_time == 0.0 and u_drop == 0.0
    for k in range(len(left)):
        if starts[k + 1]:
            continue
        v = left[k] - slopes.start_d[k] * delta[k].real - slopes.start_q[k] * delta[k].imag
        d, q = slopes.end_d[k], slopes.end_q[k]
        if ideal:
            delta[k + 1] = _solution(d, q, v)
            continue
        i_0, back = (i[k] + delta[k]) * rotor[k], legs.middle[k].conjugate()
        x, d_lost, q_lost, h = delta[k], 0j, 0j, 1e-2 * width
        lost = back * lost_voltage(legs, k, i_0, (i[k + 1] + x) * rotor[k + 1], dead_time, u_drop, width)
        off = d * x.real + q * x.imag + lost - v
        for _ in range(_ROUNDS):
            step = -_solution(d + d_lost, q + q_lost, off)
            if abs(step) < close:
                x += step
                break
            was = abs(off)
            for _ in range(_HALVINGS):
                there = x + step
                lost = back * lost_voltage(legs, k, i_0, (i[k + 1] + there) * rotor[k + 1], dead_time, u_drop, width)
                off = d * there.real + q * there.imag + lost - v
                if abs(off) < was:
                    break
                step *= 0.5
            x = there
            if abs(_solution(d, q, off)) > close:
                i_d, i_q = (i[k + 1] + x + h) * rotor[k + 1], (i[k + 1] + x + 1j * h) * rotor[k + 1]
                d_lost = (back * lost_voltage(legs, k, i_0, i_d, dead_time, u_drop, width) - lost) / h
                q_lost = (back * lost_voltage(legs, k, i_0, i_q, dead_time, u_drop, width) - lost) / h
        delta[k + 1] = x
    return delta


@kernel
def _solution(d: complex, q: complex, v: complex) -> complex:
    """x of d Re x + q Im x = v."""
    det = d.real * q.imag - d.imag * q.real
    return complex((v.real * q.imag - v.imag * q.real) / det, (d.real * v.imag - d.imag * v.real) / det)
