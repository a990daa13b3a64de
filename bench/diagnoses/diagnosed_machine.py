"""A diagnosis as a machine file: the parameters after it, the drive as it was, the effects found, with their units."""

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from bench.machine_file import EQUATION, Nominal
from estimator.diagnosis.verdict import Diagnosis, Finding, FluxTable, Quantity
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS
from estimator.physics.library import BY_NAME


def machine_text(
    diagnosis: Diagnosis, nominal: Nominal, recording: str, notes: Mapping[str, str] = MappingProxyType({})
) -> str:
    """TOML that `load_machine` takes. `recording`: its name, for a comment; `notes`: by parameter and effect, too."""
    lines = [
        _comment(f"as diagnosed from {recording}: {diagnosis.verdict.value.replace('_', ' ')}"),
        _comment(diagnosis.sentence),
        "",
        "[machine]  # SI, per phase, peak dq",
        *(
            _noted(line, notes.get(name))
            for name in PARAMETERS if (line := _parameter(name, diagnosis.machine_after.get(name), nominal))
        ),
    ]
    n_p, T_s = diagnosis.pole_pairs or nominal.n_p, nominal.T_s
    for finding in diagnosis.findings:  # a convention that the file was written by, and these values with it
        scale = finding.parameters.get("T_s_scale")
        if T_s is not None and scale is not None and scale.value:
            T_s /= scale.value
    if n_p is not None:
        lines.append(f"n_p = {n_p}" + ("" if n_p == nominal.n_p else f"  # {nominal.n_p} were given"))
    if nominal.i_rated is not None:
        lines.append(_line("i_rated", nominal.i_rated, "A"))
    drive = {"T_s": (T_s, "s"), "u_dc": (nominal.u_dc, "V"), "encoder_counts": (nominal.encoder_counts, "")}
    drive["angle_ahead"] = diagnosis.angle or None, "rad electrical, of the recorded angle, within a count"
    if known := [_line(name, value, unit) for name, (value, unit) in drive.items() if value is not None]:
        lines += ["", "[drive]", *known]
    for finding in diagnosis.findings:
        lines += ["", _noted(f"[effects.{finding.effect}]", notes.get(finding.effect))]
        for name, found in finding.parameters.items():
            lines += [_line(key, value, found.unit) for key, value in _both(name, found)]
        if finding.equation:
            lines.append(_equation(finding))
    if diagnosis.flux_map is not None:
        lines += ["", *_flux_map(diagnosis.flux_map)]
    return "\n".join(lines) + "\n"


def _flux_map(told: FluxTable) -> list[str]:
    def row(values: Iterable[float]) -> str:
        return "[" + ", ".join(f"{value:.7g}" for value in values) + "]"

    def table(rows: Iterable[Iterable[float]]) -> str:
        return "[\n" + "".join(f"    {row(values)},\n" for values in rows) + "]"

    return [
        "[flux_map]  # Vs at A: a row for each i_d, a column for each i_q; nan where neither the recording nor its "
        "mirror image in i_q has been",
        f"i_d = {row(told.i_d)}",
        f"i_q = {row(told.i_q)}",
        f"psi_d = {table(told.psi_d)}",
        f"psi_q = {table(told.psi_q)}",
        f"psi_d_std = {table(told.psi_d_std)}",
        f"psi_q_std = {table(told.psi_q_std)}",
    ]


def _parameter(name: str, found: Quantity | None, nominal: Nominal) -> str:
    """A parameter after the diagnosis; the nominal one, or none, where that is none that a machine file may hold."""
    unit, given = UNITS[name], nominal.given.get(name)
    low, high = PLAUSIBLE[name]
    if found is not None and found.value is not None and low <= found.value <= high:
        return _line(name, found.value, unit + (f", std {found.std:.2g}" if _finite(found.std) else ""))
    if given is None:
        return ""
    if found is None or found.value is None:
        return _line(name, given, f"{unit}, nominal: it could not be told")
    return _line(name, given, f"{unit}, nominal: the fit says {found.value:.3g}")


def _both(name: str, found: Quantity) -> list[tuple[str, float]]:
    return [
        (key, value) for key, value in ((name, found.value), (f"{name}_std", found.std))
        if value is not None and math.isfinite(value)
    ]


def _equation(finding: Finding) -> str:
    names = ", ".join(f"{p.name} in {p.unit}" if p.unit != "1" else p.name for p in BY_NAME[finding.effect].parameters)
    values = ", ".join(f"{value:.9g}" for value in finding.equation)
    return f"{EQUATION} = [{values}]  # for the twin, as estimator/physics/{finding.effect}.py has them: {names}"


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _line(name: str, value: float, comment: str) -> str:
    return f"{name} = {value:.9g}" + (f"  # {comment}" if comment not in ("", "1") else "")


def _noted(line: str, note: str | None) -> str:
    """With a note at the end of its comment."""
    return line if not note else f"{line}{'; ' if '#' in line else '  # '}{_comment(note)[2:]}"


def _comment(text: str) -> str:
    return "# " + "".join(c if c.isprintable() else " " for c in text)
