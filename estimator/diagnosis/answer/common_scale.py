"""Common scale: all voltages, or all currents, read larger or smaller alike, which no recording of a drive tells.

Voltages read f times what they are make R_s, L_d, L_q and psi_f come out f times as large; currents read f times what
they are, R_s, L_d and L_q 1/f times. Equations hold as before, so what a data sheet says of the parameters is all that
speaks against it:

    value / (1 + tolerance) <= f nominal <= value / (1 - tolerance)        for each parameter, of voltages
"""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Final

from estimator.diagnosis.intake.causes import AS_GIVEN, Scale, bring_in_order
from estimator.diagnosis.verdict import Ambiguity, Experiment, Finding, Quantity, Range
from estimator.machine import PARAMETERS, Machine

IMPEDANCES: Final = ("R_s", "L_d", "L_q")
_ERRORS: Final = 2.0  # standard errors of a parameter that its tolerance is wider by
_BY_R_S: Final = "R_s at the terminals, at standstill"
_CAUSES: Final = {
    "voltages": ("dc_link_gain", "the dc link's voltage with a meter"),
    "currents": ("current_sensor_gain", "a current by a probe"),
}
"""By what is read wrong alike: what is doubted then, and what to measure."""
_UNCALIBRATED: Final = {
    "current_sensor_gain": ("currents", "the gains of the current sensors differ"),
    "voltage_offset": ("voltages", "the recorded voltages have an offset"),
}
"""By the effect that shows that sensors are off: what they read, and that in words."""


def scales_left_open(
    after: Mapping[str, Quantity], nominal: Machine, tolerance: Mapping[str, float], compared: Collection[str]
) -> dict[str, Range]:
    """What all voltages, or all currents, may be read as, over what they are, by `compared` parameters.

    Those are what a data sheet speaks of; a scale is left out where it agrees with none, or nothing bounds it.
    """
    told = [name for name in compared if after[name].value is not None and after[name].std is not None]
    found: dict[str, Range] = {}
    for what, names in (("voltages", told), ("currents", [name for name in told if name in IMPEDANCES])):
        least, most = 0.0, math.inf
        for name in names:
            given, value, std = getattr(nominal, name), after[name].value or 0.0, after[name].std or 0.0
            least = max(least, (value - _ERRORS * std) / (given * (1.0 + tolerance[name])))
            if tolerance[name] < 1.0:
                most = min(most, (value + _ERRORS * std) / (given * (1.0 - tolerance[name])))
        if 0.0 < least <= most < math.inf:
            found[what] = Range(least, most) if what == "voltages" else Range(1.0 / most, 1.0 / least)
    return found


def uncalibrated(
    findings: Iterable[Finding], scales: Mapping[str, Range], tolerance: Mapping[str, float]
) -> list[Ambiguity]:
    """What sensors that are found to be off leave open: by how much all they read is, where that may be far."""
    found, far = {finding.effect for finding in findings}, max(tolerance[name] for name in IMPEDANCES)
    doubts: list[Ambiguity] = []
    for effect, (what, shown) in _UNCALIBRATED.items():
        (doubted, measured), open_ = _CAUSES[what], scales.get(what)
        if effect not in found or open_ is None or (1.0 - far <= open_.least and open_.most <= 1.0 + far):
            continue
        reason = (
            f"{shown}, and no recording of voltages and currents tells by how much all {what} are off: by the nominal "
            f"values they may be read as {_range(open_)} times what they are, and the parameters are off by that"
        )
        doubts.append(Ambiguity((doubted, "convention_error"), reason, _measuring(measured)))
    return doubts


def scaled(
    after: Mapping[str, Quantity], off: Collection[str], nominal: Machine, tolerance: Mapping[str, float],
    scales: Mapping[str, Range],
) -> list[Ambiguity]:  # fmt: skip
    """What parameters that are `off` their tolerance leave open: a machine file that follows another convention, which
    is asked first, all voltages or currents scaled alike, or another machine.

    No doubt where no one scale brings all of them within it; nor of R_s alone, which rises with the winding's
    temperature, unless it is told more closely than others: by a meter.
    """
    ratios = {name: float(after[name].value or 0.0) / getattr(nominal, name) for name in PARAMETERS}
    likely = bring_in_order(ratios, nominal.n_p, tolerance) if off else []
    told = next((one for one in likely if one.of_machine), None)
    if told is None and set(off) <= {"R_s"} and (not off or tolerance["R_s"] >= max(tolerance.values())):
        return []
    causes: dict[str, tuple[str, str]] = {}  # by effect: what is read wrong, and what to measure it by
    for what, (effect, measured) in _CAUSES.items():
        open_ = scales.get(what)
        of_psi_f = what == "currents" and abs(ratios["psi_f"] - 1.0) > tolerance["psi_f"]  # which no current scales
        if open_ is not None and not open_.least <= 1.0 <= open_.most and not of_psi_f:
            causes[effect] = f"all {what} may be read as {_range(open_)} times what they are", measured
    if not causes and told is None:
        return []
    shown = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items())
    why, measured = [one[0] for one in causes.values()], [one[1] for one in causes.values()]
    why.append("the machine is another one. A recording of voltages and currents alone cannot tell")
    shown = f"these parameters are so many times their nominal values: {shown}"
    if told is None:
        return [Ambiguity((*causes, "convention_error"), f"{shown}: {'; or '.join(why)}", _measuring(*measured))]
    asked = f"{told.says}; {shown}; or {'; or '.join(why)}"
    return [Ambiguity(("convention_error", *causes), asked, look_up(told), rivals=bool(causes))]


def look_up(cause: Scale) -> Experiment:
    """What tells whether a machine file follows another convention."""
    by = "the voltage of the motor turned without load"
    if cause.given[:3] != AS_GIVEN[:3]:
        by = "R_s between two terminals: a phase's is half"
    return Experiment(f"look up what the values of the motor's data sheet are of, or measure {by}")


def _range(scale: Range) -> str:
    return f"{scale.least:.2f} to {scale.most:.2f}"


def _measuring(*what: str) -> Experiment:
    return Experiment(f"measure {', '.join(what)}, or {_BY_R_S}")
