"""Model: a machine with effects, and what it leaves of a recording's voltage.

Effects are equations for the voltage that currents imply; of errors of measurement the rows are rid before. What is
left is that of currents and voltages as they act. Knows nothing of how a model is found.
"""

import cmath
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.machine import Machine
from estimator.physics.angle_sensing import AngleError
from estimator.physics.current_sensing import CurrentError, SkewError
from estimator.physics.effect import (
    AddedVoltage,
    Branch,
    BridgeError,
    Effect,
    ResistanceChange,
    SensorError,
    Sizes,
    VoltageError,
)
from estimator.physics.flux_map import Bend
from estimator.physics.library import BY_NAME, of_kind
from estimator.physics.magnet_flux import change_of
from estimator.physics.rows import Rows
from estimator.physics.saturation import FluxChange, bends, curvature, saturated, voltage_together

_NEAR_GAP: Final = 200  # samples on either side


@dataclass(frozen=True, slots=True)
class Model:
    """A machine with effects."""

    machine: Machine
    effects: dict[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])
    angle: float = 0.0  # rad, within the angle's resolution
    zero: float = 0.0  # A, mean of the three current channels' offsets
    bend: Bend | None = None  # of the flux linkage, in the place of effects of saturation

    @property
    def steep(self) -> bool:
        """It has an effect that changes more with a current than the noise of the current allows to see."""
        return bool(of_kind(BridgeError, self.effects))


def base_voltage(rows: Rows, model: Model) -> Vector:
    """Voltage (V) of a machine without effects, but for its flux map's bend."""
    at = rows.with_machine(model.machine)
    v = model.machine.R_s * at.i_mean + at.balance(at.flux(at.i))
    return v if model.bend is None else v + model.bend.voltage(at)


def in_truth(rows: Rows, model: Model) -> Rows:
    """The rows without the model's errors of measurement: currents and voltages as they act, the angle as it is.

    The last ones are kept with the rows: who tries a model, looks at what it leaves, and then around it, asks for the
    same again.
    """
    return rows.latest(_in_truth, model)


def _in_truth(rows: Rows, model: Model) -> Rows:
    truth = with_local_course(_without_errors(rows, model), model)
    return _as_seen(beside_bridge(truth, model), model) if model.steep else truth


def _as_seen(truth: Rows, model: Model) -> Rows:
    """The rows as effects that follow the terminals' voltage have to see them."""
    return see_lost(truth, model) if any(branch.sees_voltage for branch, _ in of_kind(Branch, model.effects)) else truth


def see_lost(truth: Rows, model: Model) -> Rows:
    """The rows with what the model's bridge loses of the voltage, which terminals do not see."""
    if truth.lost is None:
        for bridge, sizes in of_kind(BridgeError, model.effects):
            return truth.changed(lost=truth.once(bridge.voltage, sizes))
    return truth


def beside_bridge(truth: Rows, model: Model) -> Rows:
    """The rows with what a bridge has to know of the model's other effects: what voltage they add.

    But for those that make the flux linkage bend: currents go along that within a period. Of these it is what a current
    that stays takes, as the rotor turns.
    """
    bent = of_kind(FluxChange, model.effects) if bends(model.effects) else []
    besides = {effect.name for effect, _ in (*of_kind(BridgeError, model.effects), *bent)}
    others = {name: sizes for name, sizes in model.effects.items() if name not in besides}
    added = effects_voltage(truth.copy(), replace(model, effects=others))
    for effect, sizes in bent:
        if effect.emf is not None:
            v = effect.emf(truth, sizes)
            added += 0.5 * (truth.half * v[1:] + truth.half.conj() * v[:-1])
    return truth.changed(others=added)


def with_local_course(truth: Rows, model: Model) -> Rows:
    """The rows with what currents go by within a period: the straight lines that a saturating machine follows at these
    currents for a while, and what is as fast beside it.
    """
    stiffness, resistance = 0.0, 0.0
    for branch, sizes in of_kind(Branch, model.effects):
        if branch.fast_stiffness is not None:
            stiffness += branch.fast_stiffness(sizes)
        if branch.fast_resistance is not None:
            resistance += branch.fast_resistance(truth, sizes)
    truth = _drifting(_heated_rows(truth, model), model).changed(fast_stiffness=stiffness, fast_resistance=resistance)
    if model.bend is not None:
        return truth.with_local_line(*model.bend.bent(truth))
    if not bends(model.effects):
        return truth
    bent = truth.changed(curvature=curvature(truth, model.effects))
    return bent.with_local_line(*saturated(truth, model.effects))


def _heated_rows(truth: Rows, model: Model) -> Rows:
    """The rows with what effects heat a winding that warms up by, besides its current's square.

    Where samples are missing, as much over that as around them.
    """
    there = [(heats, sizes) for branch, sizes in of_kind(Branch, model.effects) if (heats := branch.heats)]
    if not there or not any(change.remembers for change, _ in of_kind(ResistanceChange, model.effects)):
        return truth
    plain = truth.copy()
    power: Array = sum((heats(plain, sizes) for heats, sizes in there), start=np.zeros(len(truth) + 1))
    added = 0.5 * (power[1:] + power[:-1]) * truth.T_s
    for k in np.flatnonzero(~truth.joined & (truth.apart != 1)):
        near = slice(max(k - _NEAR_GAP, 0), k + _NEAR_GAP + 2)
        own = float(np.sum(np.abs(truth.i[near]) ** 2))
        added[k] = (truth.heat[k + 1] - truth.heat[k]) * float(np.sum(power[near])) / max(own, 1e-300)
    return truth.changed(heat_beside=np.concatenate((np.zeros(1), np.cumsum(added))))


def _drifting(truth: Rows, model: Model) -> Rows:
    """The rows with what the winding's resistances and the magnets' flux have come to."""
    changes = [change.raises(truth, sizes) for change, sizes in of_kind(ResistanceChange, model.effects)]
    excess = sum((phases for _, phases in changes), start=0j)
    return truth.changed(
        R_s_excess=(excess.real, excess.imag),
        R_s_ratio=1.0 + sum(share for share, _ in changes),
        psi_f_ratio=1.0 + change_of(truth, model.effects) / truth.machine.psi_f,
    )


def _without_errors(rows: Rows, model: Model) -> Rows:
    rows = _unturned(rows.with_machine(model.machine), model)
    error = _current_error(rows, model)
    if isinstance(error, float):
        return rows
    return rows.with_currents((rows.i_s - error) * rows.rotor.conj())


def _unturned(rows: Rows, model: Model) -> Rows:
    """The rows by the true angle, and with the true voltage."""
    angle: Array | float = model.angle
    for effect, sizes in of_kind(SensorError, model.effects):
        if isinstance(effect, AngleError):
            angle = angle + effect.error_as_measured(rows, sizes)
        if isinstance(effect, VoltageError):
            rows = rows.changed(u=rows.u - effect.error(rows, sizes))
    i_s = rows.i_s
    if isinstance(angle, float):
        turned = cmath.exp(1j * angle)
        n_p = rows.machine.n_p
        return rows.turned(turned, theta_e=rows.theta_e - angle, i=rows.i * turned, u=rows.u * turned).knowing({
            Rows.rotor: rows.rotor * turned.conjugate(), Rows.middle: rows.middle * turned.conjugate(), Rows.i_s: i_s,
            Rows.D: rows.D, Rows.speed: rows.speed, Rows.turn: rows.turn * cmath.exp(-1j * angle / n_p),
        })  # fmt: skip
    by_half = np.exp(-0.5j * angle)
    rotor, half = rows.rotor * (by_half * by_half), rows.half * (by_half[1:] * by_half[:-1].conj())
    turned = (by_half[1:] * by_half[:-1]).conj()
    found = rows.turned(turned, theta_e=rows.theta_e - angle, half=half, i=i_s * rotor.conj(), u=rows.u * turned)
    return found.knowing({Rows.rotor: rotor, Rows.D: rows.D - np.diff(angle), Rows.i_s: i_s})


def current_error(rows: Rows, model: Model) -> Vector | float:
    """Measured less true current vector at samples, A, stationary frame."""
    return _current_error(_unturned(rows, model), model)


def _current_error(rows: Rows, model: Model) -> Vector | float:
    """Measured less true current vector at samples, A, stationary frame, of rows by the true angle."""
    there, late = of_kind(CurrentError, model.effects), of_kind(SkewError, model.effects)
    if not there:
        return 0.0
    measured = _with_slopes(rows, model) if late else rows
    found = {effect.name: effect.error(measured, sizes) for effect, sizes in there}
    for effect, sizes in late:
        i_s = rows.i_s - sum(found.values())
        true = rows.with_currents(i_s * rows.rotor.conj())
        found[effect.name] = effect.error(_on_their_way(_with_slopes(true, model), model, effect), sizes)
    return sum(found.values())


def _with_slopes(rows: Rows, model: Model) -> Rows:
    """The rows with what currents go by within a period, and what effects take from the voltage that drives them."""
    truth = with_local_course(rows, model)
    each = [effect.emf(truth, sizes) for name, sizes in model.effects.items() if (effect := BY_NAME[name]).emf]
    return truth.changed(emf=sum(each, start=0.0))


def _on_their_way(true: Rows, model: Model, effect: CurrentError) -> Rows:
    """The rows with the currents of which an error of measurement is told, where it goes by true ones."""
    if not isinstance(effect, SkewError):
        return true
    i = true.i + effect.halfway(true, model.effects[effect.name]) * true.rotor.conj()
    return _with_slopes(true.with_currents(i), model)


def frame_of(rows: Rows, truth: Rows) -> Vector:
    """What turns vectors of periods from the true frame into the measured one."""
    return truth.middle * rows.middle.conj()


def effects_voltage(truth: Rows, model: Model) -> Vector:
    """Voltage (V) that the model's effects add, but for its errors of measurement, which `in_truth` takes off.

    What the bridge loses is worked out once: of rows in this model's truth, or of a model without the bridge's effect.
    """
    total, truth = np.zeros(len(truth), np.complex128), _as_seen(truth, model)
    for effect, sizes in smoothing(model):  # one at most: forms of one cause
        in_time = {effect.name, *(bridge.name for bridge, _ in of_kind(BridgeError, model.effects))}
        rest = {name: each for name, each in model.effects.items() if name not in in_time}
        if rest:
            total += _smoothed_beside(truth, replace(model, effects=rest), effect, sizes)
        model = replace(model, effects={name: model.effects[name] for name in model.effects if name in in_time})
    for effect, sizes in of_kind(AddedVoltage, model.effects):
        total += voltage_as_present(truth, effect, sizes)
    if changes := flux_changes(model):
        total += voltage_together(truth, changes)
    return total


def smoothing(model: Model) -> list[tuple[AddedVoltage, Sizes]]:
    """Effects of the model by which measured currents are smoothed."""
    return [(effect, sizes) for effect, sizes in of_kind(AddedVoltage, model.effects) if effect.smooths is not None]


def samples_in_mean(model: Model) -> int:
    """Rows whose noise of the currents is in one value."""
    return max((effect.smooths.samples(sizes) for effect, sizes in smoothing(model) if effect.smooths), default=1)


def behind(truth: Rows, effect: AddedVoltage, sizes: Sizes, v: Vector) -> Vector:
    """What smoothing makes of a voltage (V of each period, rotor frame) that drives currents, less itself."""
    assert effect.smooths is not None
    v_s = v * truth.middle
    return truth.stationary(effect.smooths.share(sizes) * (effect.smooths.through(truth, sizes, v_s) - v_s))


def _smoothed_beside(truth: Rows, rest: Model, effect: AddedVoltage, sizes: Sizes) -> Vector:
    """What the rest of a model adds (V) to smoothed currents: it acts on those before, and its voltage is smoothed.

    What a bridge loses is not of the rest: its sign is that of currents which come as late.
    """
    assert effect.smooths is not None
    i_s = truth.i_s + effect.smooths.share(sizes) * (effect.smooths.before(truth, sizes) - truth.i_s)
    before = with_local_course(truth.with_currents(i_s * truth.rotor.conj()), rest)
    added = effects_voltage(before, rest)
    return behind(truth, effect, sizes, added) + added


def voltage_as_present(truth: Rows, effect: Effect, sizes: Sizes) -> Vector:
    """What an effect of a model adds (V) to rows in that one's truth; what the bridge loses is worked out once."""
    if not isinstance(effect, BridgeError):
        return effect.voltage(truth, sizes)
    return truth.once(effect.voltage, sizes) if truth.lost is None else truth.lost


def flux_changes(model: Model) -> dict[str, Sizes]:
    """Effects of the model whose voltages do not add up, by their names."""
    return {effect.name: sizes for effect, sizes in of_kind(FluxChange, model.effects)}


def residual(rows: Rows, smooth: Rows, model: Model) -> Vector:
    """What is left of the recorded voltage, V of each period, in the measured frame."""
    return left_over(rows, in_truth(smooth, model), model)


def left_over(rows: Rows, clean: Rows, model: Model) -> Vector:
    """What is left of the recorded voltage, V, in the measured frame; `clean`: the smooth rows in truth."""
    truth = _without_errors(rows, model)
    left = truth.u - base_voltage(truth, model) - effects_voltage(clean, model)
    return left * frame_of(rows, truth)


def zero_residual(rows: Rows, smooth: Rows, model: Model) -> Array | None:
    """What is left of the mean of the measured phase currents, A."""
    if rows.zero is None:
        return None
    left = rows.zero - model.zero
    for effect, sizes in of_kind(CurrentError, model.effects):
        left = left - effect.zero(_on_their_way(in_truth(smooth, model), model, effect), sizes)
    return left
