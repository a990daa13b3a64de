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
from estimator.physics import phase_resistance_imbalance, winding_resistance_drift
from estimator.physics.effect import Sizes, Together
from estimator.physics.flux_map import Bend
from estimator.physics.library import BY_NAME, LIBRARY
from estimator.physics.magnet_flux import change_of
from estimator.physics.rows import Rows
from estimator.physics.saturation import bends, curvature, saturated

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
        return any(BY_NAME[name].steep for name in self.effects)


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
    return see_lost(truth, model) if any(BY_NAME[name].sees_voltage for name in model.effects) else truth


def see_lost(truth: Rows, model: Model) -> Rows:
    """The rows with what the model's bridge loses of the voltage, which terminals do not see."""
    if truth.lost is None:
        for name, sizes in model.effects.items():
            if BY_NAME[name].steep:
                return truth.changed(lost=truth.once(BY_NAME[name].voltage, sizes))
    return truth


def beside_bridge(truth: Rows, model: Model) -> Rows:
    """The rows with what a bridge has to know of the model's other effects: what voltage they add.

    But for those that make the flux linkage bend: currents go along that within a period. Of these it is what a current
    that stays takes, as the rotor turns.
    """
    bent = bends(model.effects)
    others = {
        name: sizes for name, sizes in model.effects.items()
        if not BY_NAME[name].steep and not (bent and BY_NAME[name].together)
    }  # fmt: skip
    added = effects_voltage(truth.copy(), replace(model, effects=others))
    for name, sizes in model.effects.items():
        effect = BY_NAME[name]
        if name not in others and effect.emf is not None:
            v = effect.emf(truth, sizes)
            added += 0.5 * (truth.half * v[1:] + truth.half.conj() * v[:-1])
    return truth.changed(others=added)


def with_local_course(truth: Rows, model: Model) -> Rows:
    """The rows with what currents go by within a period: the straight lines that a saturating machine follows at these
    currents for a while, and what is as fast beside it.
    """
    stiffness, resistance = 0.0, 0.0
    for name, sizes in model.effects.items():
        if (fast_stiffness := BY_NAME[name].fast_stiffness) is not None:
            stiffness += fast_stiffness(sizes)
        if (fast_resistance := BY_NAME[name].fast_resistance) is not None:
            resistance += fast_resistance(truth, sizes)
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
    there = [(effect.heats, sizes) for name, sizes in model.effects.items() if (effect := BY_NAME[name]).heats]
    if not there or winding_resistance_drift.EFFECT.name not in model.effects:
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
    heat = model.effects.get(winding_resistance_drift.EFFECT.name)
    alpha, beta = model.effects.get(phase_resistance_imbalance.EFFECT.name, (0.0, 0.0))
    return truth.changed(
        R_s_excess=(alpha, beta),
        R_s_ratio=1.0 if heat is None else 1.0 + winding_resistance_drift.rise(truth, heat),
        psi_f_ratio=1.0 + change_of(truth, model.effects) / truth.machine.psi_f,
    )  # fmt: skip


def _without_errors(rows: Rows, model: Model) -> Rows:
    rows = _unturned(rows.with_machine(model.machine), model)
    error = _current_error(rows, model)
    if isinstance(error, float):
        return rows
    return rows.with_currents((rows.i_s - error) * rows.rotor.conj())


def _unturned(rows: Rows, model: Model) -> Rows:
    """The rows by the true angle, and with the true voltage."""
    angle: Array | float = model.angle
    for name, sizes in model.effects.items():
        effect = BY_NAME[name]
        if effect.angle_error is not None:
            angle = angle + effect.angle_error(rows, sizes)
        if effect.misreads_voltage:
            rows = rows.changed(u=rows.u - effect.voltage(rows, sizes))
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
    errors = [(BY_NAME[name].current_error, name, sizes) for name, sizes in model.effects.items()]
    there = [(error, name, sizes) for error, name, sizes in errors if error is not None]
    if not there:
        return 0.0
    measured = _with_slopes(rows, model) if any(BY_NAME[name].moved for _, name, _ in there) else rows
    found = {name: error(measured, sizes) for error, name, sizes in there}
    for error, name, sizes in there:
        if BY_NAME[name].moved is not None:
            i_s = rows.i_s - sum(found.values())
            true = rows.with_currents(i_s * rows.rotor.conj())
            found[name] = error(_on_their_way(_with_slopes(true, model), model, name), sizes)
    return sum(found.values())


def _with_slopes(rows: Rows, model: Model) -> Rows:
    """The rows with what currents go by within a period, and what effects take from the voltage that drives them."""
    truth = with_local_course(rows, model)
    each = [effect.emf(truth, sizes) for name, sizes in model.effects.items() if (effect := BY_NAME[name]).emf]
    return truth.changed(emf=sum(each, start=0.0))


def _on_their_way(true: Rows, model: Model, name: str) -> Rows:
    """The rows with the currents of which an effect's error of measurement is told, where it is one of true ones."""
    moved = BY_NAME[name].moved
    if moved is None:
        return true
    i = true.i + moved(true, model.effects[name]) * true.rotor.conj()
    return _with_slopes(true.with_currents(i), model)


def frame_of(rows: Rows, truth: Rows) -> Vector:
    """What turns vectors of periods from the true frame into the measured one."""
    return truth.middle * rows.middle.conj()


def effects_voltage(truth: Rows, model: Model) -> Vector:
    """Voltage (V) that the model's effects add, but for its errors of measurement, which `in_truth` takes off.

    What the bridge loses is worked out once: of rows in this model's truth, or of a model without the bridge's effect.
    """
    total, truth = np.zeros(len(truth), np.complex128), _as_seen(truth, model)
    for name, sizes in model.effects.items():
        effect = BY_NAME[name]
        if not effect.measures and effect.together is None:
            if not effect.steep:
                total += effect.voltage(truth, sizes)
            else:
                total += truth.once(effect.voltage, sizes) if truth.lost is None else truth.lost
    for together, several in sharing(model).items():
        total += together(truth, several)
    return total


def sharing(model: Model) -> dict[Together, dict[str, Sizes]]:
    """Effects of the model whose voltages do not add up, by the function that they share."""
    found: dict[Together, dict[str, Sizes]] = {}
    for name, sizes in model.effects.items():
        together = BY_NAME[name].together
        if together is not None:
            found.setdefault(together, {})[name] = sizes
    return found


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
    makes = [effect for effect in LIBRARY if effect.name in model.effects and effect.zero is not None]
    truth = in_truth(smooth, model) if makes else smooth
    for effect in makes:
        assert effect.zero is not None
        left = left - effect.zero(_on_their_way(truth, model, effect.name), model.effects[effect.name])
    return left
