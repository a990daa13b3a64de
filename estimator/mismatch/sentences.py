"""The verdict in a sentence. Knows nothing of how it was reached."""

import math

from estimator.machine import UNITS
from estimator.mismatch.verdict import Diagnosis, Finding, Quantity, Verdict
from estimator.mismatch.words import begun
from estimator.physics import convention_error
from estimator.physics.library import BY_NAME

_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))
_COUNTS = ("periods", "phase")
_GAIN = "a gain of all voltages or of all currents, by which the parameters are off then"
_CLOSE = 0.02  # of a scale, that needs no words
_FAMILIAR = ("inverter_voltage_error", "q_axis_saturation", "iron_loss", "winding_resistance_drift")


def sentence_of(diagnosis: Diagnosis, cause: str = "") -> str:
    """The answer as a bench engineer would say it. `cause`: a convention that was followed, in words."""
    fit, said = diagnosis.fit, list[str]()
    if diagnosis.findings:
        parts = [_finding(finding, cause) for finding in diagnosis.findings]
        said.append("; ".join(parts))
        if fit is not None and (loo := fit.leave_one_out) is not None:
            said.append(
                f"leaving out one {loo.left_out} at a time the error goes from {quantity(loo.before, loo.unit)} to "
                f"{quantity(loo.after, loo.unit)}"
            )
        elif fit is not None:
            u, i = fit.one_step_rms_V, fit.free_run_rms_A
            said.append(
                f"on stretches that took no part in the fit the one-step error goes from {quantity(u.before, 'V')} to "
                f"{quantity(u.after, 'V')} and the free-running one from {quantity(i.before, 'A')} to "
                f"{quantity(i.after, 'A')}"
            )
    for doubt in diagnosis.ambiguous:
        titles = [_title(name) for name in doubt.effects]
        are = "are" if len(titles) > 1 or _plural(titles[0]) else "is"
        what = f"whether {' and '.join(titles)} {are} there"
        if doubt.rivals:
            what = " from ".join(titles) if len(titles) < 3 else f"which it is of {', '.join(titles)}"
        said.append(f"cannot tell {what}: {doubt.reason}; {doubt.experiment.sentence}")
    if diagnosis.unexplained is not None:
        lead = "what is left has no name in the library" if diagnosis.findings else "none of the library's effects"
        said.append(f"{lead}: {diagnosis.unexplained.description}")
    elif diagnosis.verdict is Verdict.UNEXPLAINED:
        said.append("no effect is found, but " + "; ".join(diagnosis.remarks))
    elif diagnosis.verdict is Verdict.PARTLY_EXPLAINED:
        said.append("not all is explained: " + "; ".join(diagnosis.remarks))
    if diagnosis.verdict is Verdict.EXPLAINED:
        said.append(_left_open(diagnosis))
    if diagnosis.verdict is Verdict.NO_MISMATCH:
        nothing = "no mismatch: the machine's equations with fitted parameters leave nothing but noise"
        said.append("; ".join(part for part in (nothing, _detectable(diagnosis)) if part))
        said.append(_left_open(diagnosis))
    if diagnosis.verdict is Verdict.NOT_ENOUGH_EXCITATION:
        why = "no effect stands out, and not every parameter can be told"
        said.append(f"not enough excitation to judge: {'; '.join(diagnosis.remarks[-1:]) or why}")
    if diagnosis.experiment is not None and diagnosis.experiment not in (d.experiment for d in diagnosis.ambiguous):
        said.append(diagnosis.experiment.sentence)
    text = ". ".join(begun(part) for part in said if part)
    return text + "."


def _title(name: str) -> str:
    if name == convention_error.NAME:
        return convention_error.TITLE
    return BY_NAME[name].title if name in BY_NAME else name.replace("_", " ")


def _plural(title: str) -> bool:
    return title.startswith(("harmonics", "offsets", "unequal"))


def _finding(finding: Finding, cause: str) -> str:
    sizes = ", ".join(_size(name, q) for name, q in finding.parameters.items() if q.value is not None)
    hid = ", ".join(f"{change:+.3g} {UNITS[name]} of {name}" for name, change in finding.absorbed_as.items())
    if finding.effect == convention_error.NAME:
        return f"the recording follows {convention_error.TITLE}: {cause or sizes}"
    title = BY_NAME[finding.effect].title
    text = f"{title} {'were' if _plural(title) else 'was'} left out: {sizes}"
    if hid:
        text += f"; it hid as {hid}"
    return f"{text}; it acts {finding.where.sentence}"


def _size(name: str, told: Quantity) -> str:
    """A size with its standard error, both of one kind: a count, a share or a quantity with a unit."""
    value, std = told.value or 0.0, told.std or 0.0
    if told.unit != "1":
        said = [quantity(x, told.unit) for x in (value, std)]
    elif name in _COUNTS:
        said = [f"{x:.4g}" for x in (value, std)]
    elif std > 0.0:
        decimals = min(max(1 - math.floor(math.log10(100.0 * std)), 0), 6)
        said = [f"{100.0 * value:.{decimals}f} %", f"{100.0 * std:.3g} %"]
    else:
        said = [f"{100.0 * value:.3g} %"]
    return f"{name.replace('_', ' ')} {' ± '.join(said if std > 0.0 else said[:1])}"


def _detectable(diagnosis: Diagnosis) -> str:
    shown = [name for name in _FAMILIAR if math.isfinite(_limit(diagnosis, name))]
    parts = [f"{_title(name)} from {quantity(diagnosis.detectable[name].value, diagnosis.detectable[name].unit)}"
             for name in shown]
    if not parts:
        return ""
    return f"it would have shown {', '.join(parts)}"


def _left_open(diagnosis: Diagnosis) -> str:
    """What no recording tells: all voltages or all currents scaled alike, by how much where that is bounded."""
    if not diagnosis.scales:
        return f"{_GAIN}, would not have shown within the nominal values' tolerance"
    wide = {what: scale for what, scale in diagnosis.scales.items() if scale.most - scale.least > _CLOSE}
    if not wide:
        return ""
    parts = " or ".join(f"all {what} as {x.least:.2f} to {x.most:.2f} times what they are" for what, x in wide.items())
    return f"a drive that reads {parts} would look the same, the parameters off by that; R_s by a meter would tell"


def _limit(diagnosis: Diagnosis, name: str) -> float:
    value = diagnosis.detectable[name].value if name in diagnosis.detectable else None
    return math.inf if value is None else value


def quantity(value: float | None, unit: str) -> str:
    """A number with an engineering prefix; shares in per cent."""
    if value is None or not math.isfinite(value):
        return "unknown"
    if unit == "1":
        return f"{100.0 * value:.3g} %" if abs(value) < 1.0 else f"{value:.4g}"
    if unit in ("rad", "rad/s", "Hz", "S") or value == 0.0:
        return f"{value:.3g} {unit}"
    for scale, prefix in _PREFIXES:
        if abs(value) >= scale:
            return f"{value / scale:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"
