"""The verdict in a sentence. Knows nothing of how it was reached."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from estimator.diagnosis.verdict import Diagnosis, Finding, Fit, Quantity, Verdict
from estimator.diagnosis.words import number, sentence_start, with_interval
from estimator.interval import half_width
from estimator.machine import UNITS
from estimator.physics import convention_error, dead_time_compensation, inverter_voltage_error, speed_lag
from estimator.physics.library import BY_NAME
from estimator.witness import Witness

_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))
_UNITLESS = ("periods", "phase", "pole_pairs", "u_shift", "theta_shift", "u_mirrored", "i_mirrored")  # without a unit
_GAIN_WORDS = "a gain of all voltages or of all currents, by which the parameters are off then"
_UNFITTED = {
    convention_error.NAME: convention_error.TITLE, "dc_link_gain": "a dc link that is misread",
    speed_lag.NAME: speed_lag.TITLE,
}
"""Titles of causes that no column stands for."""
_LIKE_NOISE = 1.05  # times the noise floor
_NEAR_ONE = 0.02  # of a scale, that needs no words
_WHOLE_PERIODS = 0.05  # periods, by which a delay is one of whole periods
_FAMILIAR = ("inverter_voltage_error", "q_axis_saturation", "iron_loss", "winding_resistance_drift")


def with_sentence(diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis, and what it says."""
    return replace(diagnosis, sentence=sentence_of(diagnosis))


def with_contradictions(diagnosis: Diagnosis, against: Sequence[str]) -> Diagnosis:
    """The diagnosis, and what contradicts it, clauses: whoever reads its sentence alone has to know."""
    more = [f"{sentence_start(one)}." for one in against]
    return replace(
        diagnosis, remarks=(*diagnosis.remarks, *against), sentence=" ".join((diagnosis.sentence, *more))
    )


def sentence_of(diagnosis: Diagnosis, cause: str = "") -> str:
    """The answer as a bench engineer would say it. `cause`: a convention that was followed, in words."""
    fit, said = diagnosis.fit, list[str]()
    if diagnosis.findings:
        said += [_finding_in_words(finding, cause, diagnosis.findings) for finding in diagnosis.findings]
        if fit is not None and (loo := fit.leave_one_out) is not None:
            said.append(
                f"leaving out one {loo.left_out} at a time the error goes from {quantity(loo.before, loo.unit)} to "
                f"{quantity(loo.after, loo.unit)}"
            )
        elif fit is not None and compares(diagnosis):
            u, i = fit.one_step_rms_V, fit.free_run_rms_A
            undone = any(finding.effect == convention_error.NAME for finding in diagnosis.findings)
            said.append(
                f"{'once that convention is undone, ' if undone else ''}on stretches that took no part in the fit the "
                f"one-step error goes from {quantity(u.before, 'V')} to {quantity(u.after, 'V')} and the free-running "
                f"one from {quantity(i.before, 'A')} to {quantity(i.after, 'A')}"
            )
    for doubt in diagnosis.ambiguous:
        titles = [title_of(name) for name in doubt.effects]
        are = "are" if len(titles) > 1 or plural(titles[0]) else "is"
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
        said += [f"what is left is {left}" if (left := _beyond_noise(fit)) else "", _left_open(diagnosis)]
    if diagnosis.verdict is Verdict.NO_MISMATCH:
        left = _beyond_noise(fit) or "nothing but noise"
        nothing = f"no mismatch: the machine's equations with fitted parameters leave {left}"
        said.append("; ".join(part for part in (nothing, _detectable_in_words(diagnosis)) if part))
        said.append(_left_open(diagnosis))
    if diagnosis.verdict is Verdict.NOT_ENOUGH_EXCITATION:
        why = "no effect stands out, and not every parameter can be told"
        said.append(f"not enough excitation to judge: {'; '.join(diagnosis.remarks[-1:]) or why}")
    if diagnosis.experiment is not None and diagnosis.experiment not in (d.experiment for d in diagnosis.ambiguous):
        said.append(diagnosis.experiment.sentence)
    text = ". ".join(sentence_start(part) for part in said if part)
    return text + "."


def _beyond_noise(fit: Fit | None) -> str:
    """What is left where nothing is amiss, if it is more than noise, or may be: too little of the voltage to matter."""
    error = None if fit is None else fit.one_step_rms_V
    if error is None or math.isnan(error.after):
        return ""
    if error.noise_floor is None:
        return f"an error of {quantity(error.after, 'V')}, of which these rows do not tell how much is noise"
    if error.after <= _LIKE_NOISE * error.noise_floor:
        return ""
    return (
        f"little beside the voltage: an error of {quantity(error.after, 'V')} in one step, where noise makes "
        f"{quantity(error.noise_floor, 'V')}"
    )


def compares(diagnosis: Diagnosis) -> bool:
    """Whether a fit's before and after are of two models. Where a convention alone is named, both are of the recording
    without it, and of the same model.
    """
    doubted = (name for doubt in diagnosis.ambiguous for name in doubt.effects)
    named = {finding.effect for finding in diagnosis.findings} | set(doubted)
    u = None if diagnosis.fit is None else diagnosis.fit.one_step_rms_V
    return u is not None and (convention_error.NAME not in named or u.before != u.after)


def title_of(name: str) -> str:
    """An effect, or a cause that no column stands for, in a sentence."""
    return BY_NAME[name].title if name in BY_NAME else _UNFITTED.get(name, name.replace("_", " "))


def plural(title: str) -> bool:
    """An effect's title is one of several things."""
    return title.startswith(("harmonics", "offsets", "unequal", "constant voltages", "errors", "displaced"))


def _finding_in_words(finding: Finding, cause: str, findings: Sequence[Finding]) -> str:
    sizes = _sizes_in_words(finding)
    hid = ", ".join(_signed(change, UNITS[name]) + f" of {name}" for name, change in finding.absorbed_as.items())
    if finding.effect == convention_error.NAME:
        return f"the recording follows {convention_error.TITLE}: {cause or sizes}"
    title = title_of(finding.effect)
    many = plural(title)
    text = f"{title} {'were' if many else 'was'} left out: {sizes}"
    if finding.effect == "voltage_delay":
        text += _delayed(finding.parameters)
    if finding.effect == dead_time_compensation.EFFECT.name:
        text += _compensated(finding, findings)
    if hid:
        text += f"; {'they' if many else 'it'} hid as {hid}"
    return f"{text}; {'they act' if many else 'it acts'} {finding.where.sentence}"


def _sizes_in_words(finding: Finding) -> str:
    """Of several sizes those that differ from zero, and of the others the most that they may be, but for shapes."""
    sizes = {name: q for name, q in finding.parameters.items() if q.value is not None}
    told = {name: q for name, q in sizes.items() if abs(q.value or 0.0) > (half_width(q.std) or 0.0)}
    if not told:
        return ", ".join(_size_in_words(name, q) for name, q in sizes.items())
    effect = BY_NAME.get(finding.effect)
    shapes = {parameter.name for parameter in effect.parameters if parameter.shape} if effect else set[str]()
    said = [_size_in_words(name, q) for name, q in told.items()]
    for name, q in sizes.items():
        most = abs(q.value or 0.0) + (half_width(q.std) or 0.0)
        if name not in told and name not in shapes and "phase" not in name and 0.0 < most < math.inf:
            said.append(f"{name.replace('_', ' ')} no more than {quantity(most, q.unit)}")
    return ", ".join(said)


def _delayed(told: Mapping[str, Quantity]) -> str:
    """What a delay means, in periods or in seconds; of no whole periods it need not be the voltage's."""
    ((name, delay),) = told.items()
    by = delay.value or 0.0
    text = f", that is, the voltage acts {'later' if by > 0.0 else 'earlier'} than its row says"
    if by > 0.0 and (name != "periods" or abs(by - round(by)) > _WHOLE_PERIODS):
        text += ", or currents are filtered or sampled late, which looks the same"
    return text


def _compensated(finding: Finding, findings: Sequence[Finding]) -> str:
    """What a compensation means beside the dead time, where that is told, too; else it is what is too much of it."""
    added = finding.parameters["time"].value or 0.0
    bridges = (each.parameters for each in findings if each.effect == inverter_voltage_error.EFFECT.name)
    lost = next((told["dead_time"].value for told in bridges if "dead_time" in told), None)
    if not lost:
        return ", that is, the drive adds that much more than its legs lose"
    return f", that is, the drive adds {number(added / lost, 2)} times what its dead time loses"


def _signed(change: float, unit: str) -> str:
    return f"{'+' if change > 0.0 else ''}{quantity(change, unit)}"


def _size_in_words(name: str, told: Quantity) -> str:
    """A size with half its 95 % interval: a count, a share or a quantity with a unit."""
    value, std = told.value or 0.0, told.std
    if told.unit != "1":
        said = quantity(value, told.unit, std)
    elif name in _UNITLESS:
        said = with_interval(value, std, 4)
    else:
        said = f"{with_interval(100.0 * value, None if std is None else 100.0 * std)} %"
    return f"{name.replace('_', ' ')} {said}"


def _detectable_in_words(diagnosis: Diagnosis) -> str:
    limits = {name: diagnosis.detectable[name] for name in _FAMILIAR if math.isfinite(_limit_told(diagnosis, name))}
    unseen = [name for name, limit in limits.items() if limit.unit == "1" and _limit_told(diagnosis, name) >= 1.0]
    seen = [f"{title_of(name)} {_from(limit)}" for name, limit in limits.items() if name not in unseen]
    parts = [f"it would have shown {', '.join(seen)}"] if seen else []
    if unseen:
        parts.append(f"it would not have shown {' or '.join(map(title_of, unseen))} below 100 %")
    return "; ".join(parts)


def _from(limit: Quantity) -> str:
    """The size from which on; of a conductance, as the resistance that findings tell."""
    if limit.unit == "S" and limit.value:
        return f"of {quantity(1.0 / limit.value, 'ohm')} or less"
    return f"from {quantity(limit.value, limit.unit)}"


def _left_open(diagnosis: Diagnosis) -> str:
    """What no recording tells: all voltages or all currents scaled alike, by how much where that is bounded."""
    if not diagnosis.scales:
        return f"{_GAIN_WORDS}, would not have shown"
    wide = {what: scale for what, scale in diagnosis.scales.items() if scale.most - scale.least > _NEAR_ONE}
    if not wide:
        return ""
    parts = " or ".join(f"all {what} as {x.least:.2f} to {x.most:.2f} times what they are" for what, x in wide.items())
    return f"a drive that reads {parts} would look the same, the parameters off by that; R_s by a meter would tell"


def _limit_told(diagnosis: Diagnosis, name: str) -> float:
    value = diagnosis.detectable[name].value if name in diagnosis.detectable else None
    return math.inf if value is None else value


def said_of_witness(name: str, witness: Witness) -> str:
    """What was measured, of a parameter."""
    return f"{name} = {quantity(witness.value, UNITS[name], witness.std)}"


def quantity(value: float | None, unit: str, std: float | None = None) -> str:
    """A number with an engineering prefix, and half its 95 % interval: `2.000 ± 0.059 us`; shares in per cent."""
    if value is None or not math.isfinite(value):
        return "unknown"
    scale, shown = _with_prefix(max(abs(value), half_width(std) or 0.0), unit)
    return f"{with_interval(value / scale, None if std is None else std / scale)} {shown}".rstrip()


def _with_prefix(size: float, unit: str) -> tuple[float, str]:
    """By what to divide a number of that size, and the unit of the quotient."""
    if unit == "1":
        return (0.01, "%") if size < 1.0 else (1.0, "")
    if unit == "rad/s" or size == 0.0 or not math.isfinite(size):
        return 1.0, unit
    scale, prefix = next((one for one in _PREFIXES if size >= 0.9995 * one[0]), _PREFIXES[-1])
    return scale, f"{prefix}{unit}"
