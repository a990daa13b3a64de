"""Data sheet: nominal values and a recording that differ by more than physics makes of a machine.

What a rough fit tells, in sentences. Small units of a recording are thought of before the data sheet is blamed. Knows
no effect.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.intake.causes import bring_in_order
from estimator.diagnosis.intake.correction import Correction
from estimator.diagnosis.intake.rough_fit import RoughFit, RoughStretches, rough_fit, stretches_of
from estimator.diagnosis.words import listed, number
from estimator.machine import PARAMETERS, UNITS, Machine
from estimator.samples import Samples

_TOLD_VALUE: Final = 0.3  # of a value, its standard error at most
_BY_PHYSICS: Final = 3.0  # times, by which physics changes L_d, L_q and psi_f
_NEAR_R_S: Final = 20.0  # the same for R_s: a dead time at small currents looks like it
_CLOSED_SHARE: Final = 0.99  # of the voltages' mean square, that is explained
_SURE_VALUE: Final = 0.05  # of a value, its standard error, where the data sheet is to be wrong
_FAR_R_S: Final = 5.0  # times, by which R_s is off by more than any temperature makes it
_LEAST_ERRORS: Final = 3.0  # standard errors, by which R_s is surely below zero
_FEWEST_STRETCHES: Final = 4  # stretches
_LOOKED_AGAIN: Final = 1.5  # times the current, at which R_s is looked at again
_MAY_DIFFER: Final = 0.15  # by which it may differ then
_FAR_L: Final = 4.0  # times, by which an inductance is higher than any effect makes it
_SATURATION_FACTOR: Final = 8.0  # times, by which saturation and harmonics may lower it
LOUD: Final = 6.0  # times the rated current, which no drive carries
_UNIT_PREFIXES: Final = ((1e3, "m"), (1e6, "u"))


class Wrong(NamedTuple):
    """Something wrong with a recording, in a sentence."""

    sentence: str
    stop: bool = False  # no verdict is possible


class _Compared(NamedTuple):
    """What a rough fit says of a nominal machine."""

    fit: RoughFit
    over: dict[str, float]  # R_s, L_d, L_q, psi_f over the nominal ones
    told: dict[str, bool]  # with some certainty

    def near(self, name: str, factor: float) -> bool:
        """A parameter is told, and so many times the nominal one but for physics."""
        return self.told[name] and 1.0 / _BY_PHYSICS < self.over[name] / factor < _BY_PHYSICS


def units(stretches: RoughStretches, nominal: Machine) -> Iterator[Wrong]:
    """A recording, or a nominal machine, in other units."""
    compared = _compared(stretches, nominal)
    recorded = _recorded(compared, stretches, nominal)
    if recorded is not None:
        yield Wrong(recorded, stop=True)
        return
    yield from _given(compared, nominal)


def _compared(stretches: RoughStretches, nominal: Machine) -> _Compared:
    found = rough_fit(stretches, Correction(), nominal)
    over = {name: float(value) / getattr(nominal, name) for name, value in zip(PARAMETERS, found.value, strict=True)}
    certain = found.std < _TOLD_VALUE * np.abs(found.value)
    told = {name: bool(is_certain) for name, is_certain in zip(PARAMETERS, certain, strict=True)}
    return _Compared(found, over, told)


def _recorded(compared: _Compared, stretches: RoughStretches, nominal: Machine) -> str | None:
    """Voltages, currents or both in a smaller unit, in a sentence.

    Currents that a motor of such a rated current may carry leave it to the nominal values.
    """
    loud = nominal.i_rated is None or float(np.quantile(np.abs(stretches.i), 0.999)) > LOUD * nominal.i_rated
    for factor, letter in _UNIT_PREFIXES:
        for says, u, i in (
            (f"the voltages seem to be in {letter}V, expected V", factor, 1.0),
            (f"the currents seem to be in {letter}A, expected A", 1.0, factor),
            (f"voltages and currents both seem to be in {letter}V and {letter}A, expected V and A", factor, factor),
        ):
            if (loud or i in (1.0, u)) and _scaled_alike(compared, u, u / i):
                return f"{says}: as it stands, the recording asks for {_asked(compared, nominal)}"
    return None


def _scaled_alike(compared: _Compared, u: float, Z: float) -> bool:
    """Parameters are as voltages so many times too high, and impedances so many times, make them."""
    told, over = compared.told, compared.over
    inductances = [name for name in ("L_d", "L_q") if told[name]]
    if told["psi_f"] and not compared.near("psi_f", u):
        return False
    if not told["psi_f"] and (1.0 in (u, Z) or compared.fit.share < _CLOSED_SHARE):  # it alone tells a unit of both
        return False
    if told["R_s"] and not 1.0 / _NEAR_R_S < abs(over["R_s"]) / Z < _NEAR_R_S:
        return False
    return bool(inductances) and all(compared.near(name, Z) for name in inductances)


def _asked(compared: _Compared, nominal: Machine) -> str:
    """What is told of the machine, beside the nominal values."""
    names = [name for name in PARAMETERS if compared.told[name] and name != "R_s"]
    asked = [f"{name} = {number(compared.over[name] * getattr(nominal, name))} {UNITS[name]}" for name in names]
    given = [f"{number(getattr(nominal, name))} {UNITS[name]}" for name in names]
    return f"{listed(asked)}, nominal {'is' if len(names) == 1 else 'are'} {listed(given)}"


def _given(compared: _Compared, nominal: Machine) -> Iterator[Wrong]:
    """A nominal machine in other units."""
    over = compared.over
    likely = {name for name in PARAMETERS if compared.near(name, 1.0)}
    closed = compared.fit.share > _CLOSED_SHARE
    for names in (("R_s",), ("L_d", "L_q"), ("psi_f",)):
        others = set(PARAMETERS) - {*names, "R_s"}
        for unit, says in ((1e-3, "thousandths (milli)"), (1e-6, "millionths (micro)"), (1e3, "thousands (kilo)")):
            if closed and likely >= others and all(compared.near(name, unit) for name in names):
                first = names[0]
                given, asked = getattr(nominal, first), over[first] * getattr(nominal, first)
                seem = f"{' and '.join(names)} seem{'' if len(names) > 1 else 's'}"
                yield Wrong(f"the nominal {seem} to be in {says} of the unit: {first} is given as {given:.4g} "
                            f"{UNITS[first]}, the recording asks for {asked:.3g}; expected SI units", True)


# --- Values that are wrong


def contradicted(runs: Sequence[Samples], nominal: Machine) -> str | None:
    """Nominal values that the recording contradicts by more than physics, in a sentence; None where it does not surely.

    L_d and L_q exchanged; else values that are wrong by a factor. Lower inductances are left to saturation and to
    harmonics, a higher R_s that falls with the current to dead time.
    """
    stretches = stretches_of(runs)
    if stretches is None:
        return None
    compared = _compared(stretches, nominal)
    if compared.fit.share < _CLOSED_SHARE or compared.fit.value[0] < -_LEAST_ERRORS * compared.fit.std[0]:
        return None  # below zero R_s is a controller's gain, and the others follow it
    if _exchanged(compared, nominal):
        return f"the nominal L_d and L_q seem to be exchanged: the recording asks for {_asked(compared, nominal)}"
    wrong = [name for name in PARAMETERS if _far(compared, name)]
    if "R_s" not in wrong and _resists(stretches, nominal):
        wrong.insert(0, "R_s")
    others = [name for name in PARAMETERS if name not in (*wrong, "R_s")]
    if not wrong or not all(compared.near(name, 1.0) for name in others):
        return None
    said = [
        f"the nominal {name} is {number(getattr(nominal, name))} {UNITS[name]}, the recording says "
        f"{number(compared.over[name] * getattr(nominal, name))} {UNITS[name]}" for name in wrong
    ]  # fmt: skip
    beyond = f"{listed(said)}: beyond what physics makes of a machine; expected the values of the recorded motor"
    tolerance = dict.fromkeys(PARAMETERS, _MAY_DIFFER)
    asked = [cause.says for cause in bring_in_order(compared.over, nominal.n_p, tolerance) if cause.of_machine]
    return f"{beyond}; {asked[0]}" if asked else beyond


def _exchanged(compared: _Compared, nominal: Machine) -> bool:
    """Each inductance is the other's nominal one, which are far apart."""
    ratio = nominal.L_q / nominal.L_d
    apart = max(ratio, 1.0 / ratio) > _BY_PHYSICS
    return apart and compared.near("psi_f", 1.0) and all(
        _sure(compared, name) and 0.5 < compared.over[name] / times < 1.5
        for name, times in (("L_d", ratio), ("L_q", 1.0 / ratio))
    )


def _far(compared: _Compared, name: str) -> bool:
    """A parameter is told surely, and is no nominal one that physics has changed."""
    over = compared.over[name]
    if not _sure(compared, name):
        return False
    if name == "R_s":
        return 0.0 < over < 1.0 / _FAR_R_S
    if name == "psi_f":
        return over > _BY_PHYSICS or 0.0 < over < 1.0 / _BY_PHYSICS
    return over > _FAR_L or 0.0 < over < 1.0 / _SATURATION_FACTOR


def _resists(stretches: RoughStretches, nominal: Machine) -> bool:
    """R_s is far too high at high currents, and as high at low ones: drops of an inverter are not."""
    size: NDArray[np.float64] = np.sqrt(np.mean(np.abs(stretches.i) ** 2, axis=1))
    order = np.argsort(size)
    low, high = order[: len(order) // 2], order[len(order) // 2 :]
    if len(low) < _FEWEST_STRETCHES or float(np.mean(size[high])) < _LOOKED_AGAIN * float(np.mean(size[low])):
        return False
    at_low, at_high = (_compared(stretches.at(places), nominal) for places in (low, high))
    alike = abs(at_high.over["R_s"] / at_low.over["R_s"] - 1.0) < _MAY_DIFFER
    return alike and at_high.over["R_s"] > _FAR_R_S and _sure(at_high, "R_s") and at_low.told["R_s"]


def _sure(compared: _Compared, name: str) -> bool:
    k = PARAMETERS.index(name)
    return bool(compared.fit.std[k] < _SURE_VALUE * abs(compared.fit.value[k]))
