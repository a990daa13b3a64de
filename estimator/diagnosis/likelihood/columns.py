"""Columns: a model around its present values, and every effect that could be added to it, as one linear regression.

    y = sum over columns of coefficient * column + noise

y and the columns are whitened flux errors. Coefficients of sizes - R_s, L_d, L_q, psi_f, and the sizes of effects - are
absolute; those of shapes count from the present value. Knows nothing of what is chosen.
"""

import math
from collections.abc import Callable, Collection, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.noise import Noise, filter_of, flux_errors, noise_of, straightening, whitened
from estimator.diagnosis.likelihood.whitening import whiten_into
from estimator.machine import PARAMETERS
from estimator.physics.angle_sensing import AngleError, voltage_of_angle_error
from estimator.physics.current_sensing import CurrentError
from estimator.physics.effect import (
    Branch,
    BridgeError,
    Effect,
    Parameter,
    ResistanceChange,
    SensorError,
    Sizes,
    VoltageError,
)
from estimator.physics.library import BY_NAME, LIBRARY, of_kind
from estimator.physics.magnet_flux import change_of
from estimator.physics.mains import FREQUENCY, hum_in
from estimator.physics.rows import Rows
from estimator.physics.saturation import SATURATIONS, FluxChange, bends, voltage_together
from estimator.twin.model import (
    Model,
    behind,
    flux_changes,
    frame_of,
    in_truth,
    left_over,
    samples_in_mean,
    see_lost,
    smoothing,
    voltage_as_present,
    zero_residual,
)
from estimator.twin.response import Response, answer

STRETCHES: Final = 48
BENDS: Final = 6
"""Place of the first of a flux map's shapes among the machine's columns; they are the last."""
_STEP: Final = 0.03  # of a typical size, for differences
_SMALL_STEP: Final = 1e-3  # the same, where a little changes much
_COLUMN_CHUNK: Final = 4096  # periods at once, whose columns stay near the processor
_LONG_RECORDING: Final = 200_000  # periods, from which on what effects remember takes much room
_LEAD: Final = 1_000  # periods, of which most effects remember nothing in the end
_AHEAD: Final = 100  # periods, that effects look ahead at most
_SMALL_ANGLE: Final = 1e-4  # rad
_RUN_AWAY: Final = 1e12  # a period, over noise: what a model leaves whose currents go beyond all numbers
_OF_NOMINAL: Final = (0.3, 3.0)  # of nominal values
_ANYTHING: Final = (1e-2, 1e2)  # the same for the straight lines of a map

Follow = Callable[[Model], tuple[Rows, Vector]]
"""Rows with currents that follow a model, and the voltage (V, measured frame) that the bridge loses meanwhile."""
VoltageSlopes = dict[tuple[str, int], Vector]
"""What that voltage changes by, by owner and place of a column: volts a unit of its parameter."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One coefficient."""

    owner: str  # an effect's name, or "machine"
    parameter: str
    place: int  # in the effect's parameters
    seed: int  # of the shapes, from 0; -1 for an effect of the present model
    prior: tuple[float, float]  # mean and standard deviation of the coefficient
    offset: float  # present value, that the coefficient holds already
    bounds: tuple[float, float]
    shape: bool = False


@dataclass(slots=True, eq=False)
class Regression:
    """The regression's sums by stretch of the recording."""

    columns: tuple[Coefficient, ...]
    gram: Array  # (stretches, P + 1, P + 1); the last is y
    count: int  # of whitened numbers
    noise: tuple[float, float, float]  # Vs, Vs, A: of the d, q and zero channels
    rows: Rows
    smooth: Rows
    model: Model
    left: float  # mean of the whitened residual's square over that of noise, d and q together
    unidentified: frozenset[str]  # inductances that stay within tolerance


@dataclass(frozen=True, slots=True)
class _Step:
    """Sizes of an effect, between which a column is the change of voltage per unit."""

    effect: Effect
    to: tuple[float, ...]
    since: tuple[float, ...] | None  # None: no effect
    h: float


def regression(
    rows: Rows, smooth: Rows, model: Model, given: Given, noise: Noise | None = None,
    library: Sequence[Effect] = LIBRARY, follow: Follow | None = None, slopes: VoltageSlopes | None = None,
    response: Response | None = None,
) -> Regression:  # fmt: skip
    """Sums of all columns; of the present model alone without a library.

    `smooth` has currents with less noise, for what must not be correlated with it; `follow` says what they and the
    voltage that the bridge loses would be by another model; `slopes` of that voltage are worked out where they are not
    known. `response` says the same of small changes, for all columns at once.
    """
    rows, smooth = rows.with_machine(model.machine), smooth.with_machine(model.machine)
    truth = in_truth(smooth, model)
    if library:
        truth = see_lost(truth, model)
    library = [effect for effect in library if model.bend is None or effect.name not in SATURATIONS]
    r, zero = left_over(rows, truth, model), zero_residual(rows, smooth, model)
    smooth, truth = _humming((smooth, truth), r, model, library)
    columns = _model_coefficients(smooth, model, given, library)
    steps = _steps(truth, model, columns)
    if noise is None:
        noise = noise_of(flux_errors(r, rows, model), zero, rows, samples_in_mean(model))
    straighten = _straighten(rows, model, noise)
    coupled = not library and model.bend is None  # while sets are compared, effects are not in others' columns
    answering = _answering(columns, response)
    into_truth = frame_of(rows, truth).conj()
    by = filter_of(rows, model.machine).of_voltages(into_truth)
    lost = {} if follow is None else _lost_slopes(model, columns, follow, {} if slopes is None else slopes, answering)
    lost = {j: volts * into_truth for j, volts in lost.items()}
    lost |= {j: volts for j, volts in answering.items() if volts is not None}
    if coupled:
        lost |= {j: volts + lost.get(j, 0.0) for j, volts in _smoothed(truth, model, columns, steps).items()}
    bridges = {j for j in lost if isinstance(BY_NAME.get(columns[j].owner), BridgeError)}
    r = r * into_truth
    n, P = len(rows), len(columns)
    which, answers = np.array(list(answering), np.intp), np.zeros((P, 2), np.complex128)
    gram, state = np.zeros((STRETCHES, P + 1, P + 1)), np.zeros(P + 1, np.complex128)
    volts, white = np.empty((P + 1) * _COLUMN_CHUNK, np.complex128), np.empty((P + 1) * 2 * _COLUMN_CHUNK)
    edges = np.linspace(0, n, STRETCHES + 1).astype(int)
    for s, cut, part in _parts(truth.copy(), steps, edges):  # what it remembers goes with it
        size = (P + 1) * len(part)
        v, m = volts[:size].reshape(P + 1, len(part)), white[: 2 * size].reshape(P + 1, 2, len(part))
        _fill(part, model, columns, steps, v, bridges, coupled)
        for j, slope in lost.items():
            v[j] = slope[cut] if j in bridges else v[j] + slope[cut]
        if response is not None:
            answer(v, which, response.within(cut), answers)
        v[P] = r[cut]
        there = whiten_into(m, v, *by.over(cut), noise[:2], state)
        if straighten is not None:
            m[: len(there)] = np.einsum("xyn,cyn->cxn", straighten[:, :, cut], m[: len(there)])
        flat = m[: len(there)].reshape(len(there), 2 * len(part))
        gram[s, there[:, None], there] += _products(flat)
    _explain_nothing_beyond_numbers(gram, n)
    left = float(gram[:, P, P].sum()) / n
    if zero is not None:
        _add_zero_channel(gram, truth, columns, steps, zero / noise[2], noise[2], edges)
    # Coefficients of sizes are absolute
    offset = np.array([column.offset for column in columns])
    change = np.eye(P + 1)
    change[P, :P] = offset
    gram = change @ gram @ change.T
    count = 2 * int(rows.joined.sum()) + (0 if zero is None else n)
    return Regression(columns, gram, count, noise, rows, smooth, model, left, given.unidentified)


def _products(flat: Array) -> Array:
    """Of all columns; of a model whose currents run away they are none."""
    with np.errstate(over="ignore", invalid="ignore"):
        return flat @ flat.T


def _explain_nothing_beyond_numbers(gram: Array, n: int) -> None:
    """Sums of a model whose currents run away are those of one that explains nothing and leaves far too much."""
    if not np.isfinite(gram).all():
        gram[:] = 0.0
        gram[:, -1, -1] = _RUN_AWAY * n / STRETCHES


def _humming(some: tuple[Rows, Rows], left: Vector, model: Model, library: Sequence[Effect]) -> tuple[Rows, Rows]:
    """The rows, told the frequency at which effects of the model hum, or at which others may by what is left (V)."""
    if not any(FREQUENCY in effect.parameters for effect in library):
        return some
    both, (one, other) = ((BY_NAME[name].parameters, sizes) for name, sizes in model.effects.items()), some
    there = (size for parameters, sizes in both for p, size in zip(parameters, sizes, strict=True) if p is FREQUENCY)
    hums = next(there, None)
    if hums is None:
        hums = hum_in(left * one.middle * one.joined, one.clock[1:])
    return one.changed(hums=hums), other.changed(hums=hums)


def _straighten(rows: Rows, model: Model, noise: Noise) -> Array | None:
    """What makes whitened numbers beside a flux map's bend those of its straight lines, over noise; None without one.
    """
    if model.bend is None:
        return None
    across = np.array([[1.0, noise[1] / noise[0]], [noise[0] / noise[1], 1.0]])
    return straightening(rows, model, model.bend) * across[:, :, None]


def _parts(rows: Rows, steps: Sequence[_Step | None], edges: NDArray[np.intp]) -> Iterator[tuple[int, slice, Rows]]:
    """The rows part by part, with number of the stretch and place. Of many rows, most of what effects remember is
    worked out a stretch at a time.
    """
    long = len(rows) > _LONG_RECORDING
    there = [step for step in steps if step is not None]
    if long:
        _ = rows.speed  # which is that of both sides
        _remember(rows, [step for step in there if isinstance(step.effect, ResistanceChange)])
    else:
        _prepare(rows, there)
    first, near = 0, rows
    for s, (a, b) in enumerate(pairwise(edges.tolist())):
        if long:
            first = max(a - _LEAD, 0)
            near = rows[first : b + _AHEAD]
            _prepare(near, there)
        for begin in range(a, b, _COLUMN_CHUNK):
            end = min(begin + _COLUMN_CHUNK, b)
            yield s, slice(begin, end), near[begin - first : end - first]


def _prepare(rows: Rows, steps: Sequence[_Step]) -> None:
    """Work out once, over all rows, what effects remember and what several of them use."""
    _ = rows.D, rows.speed, rows.rotor, rows.six, rows.turn, rows.i_s, rows.i_mean
    if rows.u_dc is not None:
        _ = rows.duties, rows.moment_of_pulses
    _remember(rows, steps)


def _remember(rows: Rows, steps: Sequence[_Step]) -> None:
    for step in steps:
        for sizes in (step.to, step.since):
            if sizes is not None and step.effect.remembers is not None:
                step.effect.remembers(rows, sizes)


def _model_coefficients(rows: Rows, model: Model, given: Given, library: Sequence[Effect]) -> tuple[Coefficient, ...]:
    found: list[Coefficient] = []
    for k, name in enumerate(PARAMETERS):
        nominal, tolerance = getattr(given.machine, name), given.tolerance[name]
        share = tolerance if model.bend is None or name == "R_s" else 1.0  # straight lines are a part of a map
        low, high = _OF_NOMINAL if share < 1.0 else _ANYTHING
        if name in given.unidentified and share < 1.0:
            low, high = 1.0 - share, 1.0 + share
        prior, bounds = (nominal, share * nominal), (low * nominal, high * nominal)
        found.append(Coefficient("machine", name, k, -1, prior, getattr(model.machine, name), bounds))
    reach = max(given.angle_step, 1e-5)  # an angle is rounded or cut off
    prior = 0.0, max(0.5 * given.angle_step, 1e-6)
    found.append(Coefficient("machine", "angle", 4, -1, prior, model.angle, (-reach, reach)))
    if rows.zero is not None:
        found.append(Coefficient("machine", "zero", 5, -1, (0.0, rows.i_rated), model.zero, (-math.inf, math.inf)))
    if model.bend is not None:
        anything = (-math.inf, math.inf)
        for k, (name, size) in enumerate(zip(model.bend.names, model.bend.size.tolist(), strict=True)):
            found.append(Coefficient("machine", name, BENDS + k, -1, (0.0, 1.0), size, anything))
    for effect in library or [BY_NAME[name] for name in model.effects]:
        if effect.name in model.effects:
            found.extend(_own_columns(effect, rows, model.effects[effect.name]))
            if isinstance(effect, BridgeError) or not any(parameter.shape for parameter in effect.parameters):
                continue  # it has no other shape, or finds it
        for seed, _ in enumerate(effect.shapes(rows) if library else ()):
            for k in effect.sizes:
                parameter = effect.parameters[k]
                prior = (0.0, parameter.typical(rows))
                found.append(Coefficient(effect.name, parameter.name, k, seed, prior, 0.0, _range_of(parameter, rows)))
    return tuple(found)


def _own_columns(effect: Effect, rows: Rows, present: Sequence[float]) -> list[Coefficient]:
    """Of an effect of the model: its sizes, and steps of its shapes."""
    found: list[Coefficient] = []
    for k, parameter in enumerate(effect.parameters):
        if parameter.discrete:
            continue
        prior, (low, high) = (0.0, parameter.typical(rows)), _range_of(parameter, rows)
        if parameter.shape:
            low, high = max(low - present[k], -0.5 * abs(present[k])), min(high - present[k], abs(present[k]))
        offset = 0.0 if parameter.shape else present[k]
        found.append(Coefficient(effect.name, parameter.name, k, -1, prior, offset, (low, high), parameter.shape))
    return found


def _range_of(parameter: Parameter, rows: Rows) -> tuple[float, float]:
    return (
        -math.inf if parameter.low is None else parameter.low(rows),
        math.inf if parameter.high is None else parameter.high(rows),
    )


def _steps(rows: Rows, model: Model, columns: Sequence[Coefficient]) -> list[_Step | None]:
    """What each column is a change of; None for those of the machine."""
    return [None if column.owner == "machine" else _step_to(rows, model, column) for column in columns]


def _step_to(rows: Rows, model: Model, column: Coefficient) -> _Step:
    effect = BY_NAME[column.owner]
    parameter = effect.parameters[column.place]
    if column.seed >= 0:
        h = parameter.typical(rows)
        return _Step(effect, effect.in_order(effect.shapes(rows)[column.seed], {column.place: h}), None, h)
    at = model.effects[effect.name]
    if _is_taken_off(effect) and _change_of(effect) is None and not effect.moves:  # rows are rid of it already
        at = effect.none_at(at)
    by_share = parameter.shape and not parameter.fine
    h = 0.05 * abs(at[column.place]) if by_share else _STEP * parameter.typical(rows)
    return _Step(effect, tuple(value + h * (k == column.place) for k, value in enumerate(at)), at, h)


def _is_taken_off(effect: Effect) -> bool:
    """An error of measurement that is told of what it errs: of rows that are rid of it there is none."""
    return isinstance(effect, SensorError) and not (isinstance(effect, VoltageError) and not effect.of_recorded)


def _change_of(effect: Effect) -> Callable[[Rows, Sizes, Sizes], Array] | None:
    return effect.change if isinstance(effect, AngleError) else None


def _fill(
    rows: Rows, model: Model, columns: Sequence[Coefficient], steps: Sequence[_Step | None], v: NDArray[np.complex128],
    others: Set[int], coupled: bool,
) -> None:  # fmt: skip
    """Write the columns' voltages, but those of some others. `coupled`: with what effects make of the machine's."""
    present: dict[str, Vector] = {}
    shared, together = flux_changes(model), None
    for j, (column, step) in enumerate(zip(columns, steps, strict=True)):
        if j in others:
            continue
        if step is None:
            if column.place < BENDS:
                v[j] = 0.0 if column.parameter == "zero" else _voltage_per_unit(rows, column.parameter)
                if coupled:
                    v[j] += _coupled(rows, model, column.parameter)
            elif column.place == BENDS:
                assert model.bend is not None
                v[j : j + len(model.bend.size)] = model.bend.voltages(rows)
            continue
        effect = step.effect
        if shared and isinstance(effect, FluxChange):  # beside the others of them
            together = voltage_together(rows, shared) if together is None else together
            np.subtract(voltage_together(rows, shared | {effect.name: step.to}), together, out=v[j])
        elif step.since is None:
            v[j] = effect.voltage(rows, step.to)
        elif (change := _change_of(effect)) is not None:
            v[j] = voltage_of_angle_error(rows, change(rows, step.to, step.since))
        else:
            if effect.name not in present:
                present[effect.name] = voltage_as_present(rows, effect, step.since)
            np.subtract(effect.voltage(rows, step.to), present[effect.name], out=v[j])
        v[j] *= 1.0 / step.h


def _smoothed(
    rows: Rows, model: Model, columns: Sequence[Coefficient], steps: Sequence[_Step | None]
) -> dict[int, Vector]:  # fmt: skip
    """What columns change by where measured currents are smoothed: those of other effects, and of the magnets' flux."""
    found: dict[int, Vector] = {}
    for effect, sizes in smoothing(model):
        for j, (column, step) in enumerate(zip(columns, steps, strict=True)):
            if step is None:
                comes_late = column.parameter == "psi_f"
            else:  # what a bridge loses, and what errs, is of currents that come as late
                comes_late = column.owner != effect.name and not isinstance(step.effect, BridgeError | SensorError)
            if not comes_late:
                continue
            v = np.zeros((1, len(rows)), np.complex128)
            _fill(rows, model, [column], [step], v, set(), coupled=True)
            found[j] = behind(rows, effect, sizes, v[0])
    return found


def _answering(columns: Sequence[Coefficient], response: Response | None) -> dict[int, Vector | None]:
    """Columns of which a response says what the bridge loses in answer - of all that changes no measurement - and what
    it loses by those of its own.
    """
    found: dict[int, Vector | None] = {}
    if response is None:
        return found
    for j, column in enumerate(columns):
        if column.owner == "machine":
            if column.parameter not in ("angle", "zero"):
                found[j] = None
        elif column.seed < 0 and not column.shape and not _is_taken_off(effect := BY_NAME[column.owner]):
            found[j] = response.direct[column.place] if isinstance(effect, BridgeError) else None
    return found


def _lost_slopes(
    model: Model, columns: Sequence[Coefficient], follow: Follow, known: VoltageSlopes, otherwise: Collection[int]
) -> dict[int, Vector]:
    """What the voltage that the bridge loses changes by, a unit of a column's parameter, as the currents follow.

    Of the machine's parameters, the angle, sizes, and the bridge's shapes, where it is not known `otherwise`. These
    currents are known, so that no spread of them smooths it.
    """
    present, found = None, dict[int, Vector]()
    for j, column in enumerate(columns):
        if j in otherwise:
            continue
        h, of = _SMALL_STEP * column.prior[1], (column.owner, column.place)
        if of in known:
            found[j] = known[of]
            continue
        if column.owner == "machine":
            if column.parameter == "angle":
                h = _SMALL_ANGLE
                other = replace(model, angle=model.angle + h)
            elif column.parameter in PARAMETERS:
                machine = replace(model.machine, **{column.parameter: getattr(model.machine, column.parameter) + h})
                other = replace(model, machine=machine)
            else:
                continue
        elif column.seed < 0 and (not column.shape or _follows(column)):
            sizes = tuple(x + h * (k == column.place) for k, x in enumerate(model.effects[column.owner]))
            other = replace(model, effects={**model.effects, column.owner: sizes})
        else:
            continue
        if present is None:
            present = follow(model)[1]
        found[j] = known[of] = (follow(other)[1] - present) / h
    return found


def _follows(column: Coefficient) -> bool:
    """A shape of the bridge's that currents answer which follow a model."""
    effect = BY_NAME[column.owner]
    return isinstance(effect, BridgeError) and not effect.parameters[column.place].smooths


def _add_zero_channel(
    gram: Array, rows: Rows, columns: Sequence[Coefficient], steps: Sequence[_Step | None], y: Array, noise: float,
    edges: NDArray[np.intp],
) -> None:  # fmt: skip
    """What the mean of the phase currents adds to the sums; most columns make nothing of it."""
    found: dict[int, Array] = {}
    for j, (column, step) in enumerate(zip(columns, steps, strict=True)):
        if step is None:
            if column.parameter == "zero":
                found[j] = np.full(len(y), 1.0 / noise)
        elif isinstance(step.effect, CurrentError):
            change = step.effect.zero(rows, step.to)
            if step.since is not None:
                change = change - step.effect.zero(rows, step.since)
            found[j] = change / (step.h * noise)
    found[len(columns)] = y
    there = np.array(list(found))
    for s, (a, b) in enumerate(pairwise(edges.tolist())):
        m = np.array([x[a:b] for x in found.values()])
        gram[s, there[:, None], there] += m @ m.T


def as_parameters(rows: Rows, v: Vector) -> dict[str, float]:
    """What a voltage (V) looks like as R_s, L_d, L_q and psi_f: by least squares of its flux errors."""
    by = filter_of(rows, rows.machine)
    errors = [whitened(x, by) for x in (*(_voltage_per_unit(rows, name) for name in PARAMETERS), v)]
    *columns, y = (np.concatenate([z.real, z.imag]) for z in errors)
    found = np.linalg.lstsq(np.stack(columns, axis=1), y, rcond=None)[0]
    return dict(zip(PARAMETERS, found.tolist(), strict=True))


def _voltage_per_unit(rows: Rows, parameter: str) -> Vector:
    """Of a parameter of the machine, or of the angle."""
    if parameter == "R_s":
        return rows.i_mean
    if parameter in ("L_d", "L_q"):
        own = rows.i.real if parameter == "L_d" else rows.i - rows.i.real
        return rows.balance(own) + rows.machine.R_s * _mean_current_per_unit(rows, parameter)
    if parameter == "psi_f":
        return rows.balance(np.ones(len(rows) + 1))
    return voltage_of_angle_error(rows, _SMALL_ANGLE) / _SMALL_ANGLE


def _mean_current_per_unit(rows: Rows, parameter: str) -> Vector:
    """A/H, by which the mean current of each period goes with an inductance: pulses meet it."""
    L = getattr(rows.machine, parameter)
    other = rows.with_machine(replace(rows.machine, **{parameter: L * (1.0 + _SMALL_STEP)}))
    return (other.i_mean - rows.i_mean) / (L * _SMALL_STEP)


def _coupled(rows: Rows, model: Model, parameter: str) -> Vector:
    """What the model's effects add to the voltage per unit of a parameter of the machine, at their present sizes.

    Exact for voltages in proportion to it; flux linkages that bend are nearly so to the inductance of their axis.
    Currents beside the machine's make less flux there.
    """
    m, total = model.machine, np.zeros(len(rows), np.complex128)
    if parameter in ("L_d", "L_q"):
        more = rows.own_flux[0] - rows.flux(rows.i)
        for branch, sizes in of_kind(Branch, model.effects):
            if branch.beside is not None:
                more = more - rows.flux_of_little(branch.beside(rows, sizes))
        if bends(model.effects):
            more = more - change_of(rows, model.effects)
        along: Vector = (more.real if parameter == "L_d" else 1j * more.imag) / getattr(m, parameter)
        return rows.balance(along)
    for name, sizes in model.effects.items():
        if BY_NAME[name].in_proportion_to == parameter:
            total += BY_NAME[name].voltage(rows, sizes) / getattr(m, parameter)
    return total
