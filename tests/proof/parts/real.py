"""Real recordings: what is said of steady points, of standing motors and of a thermal bench, beside what was asked.

The files are others' and none of the project's: where they are absent, it is said where they can be had.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import plotly.graph_objects

from bench.diagnoses.diagnose import diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.engineering import quantity, words
from bench.machine_file import Nominal
from estimator.diagnosis.verdict import Diagnosis, LeaveOneOut, Quantity
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.support.real_data import REAL_DATA

go: Any = plotly.graph_objects  # comes without types

VOLTAGE_ERROR: Final = "inverter_voltage_error"
HALF: Final = 0.5  # of the held-out error, that is to be gone where the effect is named
SINE: Final = 0.014  # of the impedance, held out
_DRIFTS: Final = ("winding_resistance_drift", "magnet_flux_drift", "magnet_flux_step")
_TURNS: Final = 50.0  # rpm, above which the motor is driven
_NDFEB: Final = -0.0011  # of the magnets' flux, 1/K
_SOURCES: Final[Mapping[str, str]] = {
    "moteus_ld": "mjbots/moteus at db1a762, lib/python/moteus/test/testdata/ld_*.json (Apache-2.0)",
    "servo_standstill": "yahalit/Sensorless at eabc2fd, sine_identification and voltage_pulses (no licence stated: for "
    "a look of one's own, not to be handed on)",
    "lea_thermal": "dkesada/dbnR, session 60 of its electric-motor table, in physical units",
}
_FILES: Final[Mapping[str, tuple[str, ...]]] = {
    "moteus-ld": tuple(f"moteus_ld/ld_{name}.json" for name in ("be8108", "custom", "mj5208", "spindle")),
    "servo-sine": ("servo_standstill/sine_identification.csv",),
    "servo-pulses": ("servo_standstill/voltage_pulses.csv.gz",),
    "lea-thermal": ("lea_thermal/session60.csv",),
}


def prove(settings: Settings) -> Proof:
    """Diagnose what is there; the rest is told as missing."""
    del settings  # nothing here is drawn
    absent = [name for names in _FILES.values() for name in names if not (REAL_DATA / name).is_file()]
    said = {
        name: said_of(REAL_DATA / name, kind) for kind, names in _FILES.items() for name in names if name not in absent
    }
    moteus = {Path(name).stem.removeprefix("ld_"): said[name] for name in _FILES["moteus-ld"] if name in said}
    sine, pulses, thermal = (said.get(_FILES[kind][0]) for kind in ("servo-sine", "servo-pulses", "lea-thermal"))
    tables = [
        _moteus_table(moteus), *(
            _told(title, one)
            for title, one in (
                ("Servo at standstill, sine voltages: what is told", sine),
                ("Servo at standstill, voltage pulses: what is told", pulses),
                ("Traction motor on a thermal bench: what is told, by the electrical columns alone", thermal),
            ) if one is not None
        ),
    ]  # fmt: skip
    return Proof(
        name="real", title="Real recordings", said=_said(moteus), bars=(
            *moteus_bars(moteus), sine_bar(sine), pulses_bar(pulses), *thermal_bars(thermal),
        ),
        tables=tuple(table for table in tables if table.rows), pictures=(_picture(moteus),) if moteus else (),
        missing=missing(absent),
    )  # fmt: skip


def said_of(path: Path, kind: str) -> Diagnosis:
    """What `pmsm-bench diagnose --format KIND FILE` says."""
    return diagnose_recording(Request(path, Nominal({}), format=kind)).diagnosis


def missing(absent: Sequence[str]) -> str:
    """What is not there, and where it can be had; nothing where all is."""
    if not absent:
        return ""
    folders = dict.fromkeys(Path(name).parts[0] for name in absent)
    sources = "; ".join(f"{folder}: {_SOURCES[folder]}" for folder in folders)
    return (
        f"not here: {', '.join(absent)}. They go into folders of these names in {REAL_DATA} (PMSM_BENCH_DATA names "
        f"another place), from public repositories: {sources}"
    )


def _said(moteus: Mapping[str, Diagnosis]) -> str:
    named = [name for name, one in moteus.items() if one.findings]
    return (
        f"Steady points of {len(moteus)} motors: the inverter's voltage error is named on "
        f"{' and '.join(named) or 'none'}, where speeds that took no part in the fit bear it out, and on no other. A "
        "servo at standstill under sine voltages and voltage pulses; a traction motor of which the electrical columns "
        "alone are read, its thermocouples kept as witnesses. Each file is diagnosed as `pmsm-bench diagnose --format "
        "moteus-ld|servo-sine|servo-pulses|lea-thermal FILE` does it, without a machine file."
    )


# --- bars


def moteus_bars(moteus: Mapping[str, Diagnosis]) -> list[Bar]:
    """The held-out error where the effect is named, and where it is not."""
    named, quiet = dict[str, LeaveOneOut](), dict[str, LeaveOneOut]()
    for name, one in moteus.items():
        loo = one.fit.leave_one_out if one.fit else None
        if loo is not None:
            (named if one.findings else quiet)[name] = loo
    share = {name: loo.alternatives[VOLTAGE_ERROR] / loo.before for name, loo in (named | quiet).items()}
    upstream = {name: loo.alternatives["free_offsets"] / loo.before for name, loo in (named | quiet).items()}
    worse = [name for name in named if share[name] >= 1.0]
    others = {finding.effect for one in moteus.values() for finding in one.findings} - {VOLTAGE_ERROR}
    halved = all(share[name] <= HALF for name in named) if named else None
    return [
        Bar("moteus: held-out error with the effect over that without, where it is named", f"at most {HALF:g}",
            _shares({name: share[name] for name in named}), halved),
        Bar("moteus: named where the held-out error does not improve", "none", ", ".join(worse) or "none",
            not worse if moteus else None),
        Bar("moteus: another effect named", "none", ", ".join(sorted(others)) or "none",
            not others if moteus else None),
        Bar("  with the effect over without, where it is not named", "",
            _shares({name: share[name] for name in quiet}), None),
        Bar("  with upstream's free offset a level over without", "", _shares(upstream), None),
    ]  # fmt: skip


def sine_bar(sine: Diagnosis | None) -> Bar:
    """The impedance on frequencies left out."""
    what, asked = "servo, sine: impedance error on frequencies left out", f"at most {SINE:.1%}"
    loo = sine.fit.leave_one_out if sine and sine.fit else None
    if loo is None:
        return Bar(what, asked, "", None)
    return Bar(what, asked, f"{loo.after:.2%} ({loo.before:.1%} with R, L and a delay alone)", loo.after <= SINE)


def pulses_bar(pulses: Diagnosis | None) -> Bar:
    """What is told of them; nothing was asked in numbers."""
    what = "servo, pulses: current on angles left out"
    loo = pulses.fit.leave_one_out if pulses and pulses.fit else None
    if loo is None:
        return Bar(what, "", "", None)
    before, after = (quantity(rms, loo.unit, like=loo.before) for rms in (loo.before, loo.after))
    return Bar(what, "", f"{before} before, {after} after", None)


def thermal_bars(thermal: Diagnosis | None) -> list[Bar]:
    """What is to be named, and what is not to be claimed."""
    found = {finding.effect for finding in thermal.findings} if thermal else set[str]()
    saturated = bool(found & {"d_axis_saturation", "q_axis_saturation", "cross_saturation"})
    drift = found & set(_DRIFTS)
    names = ", ".join(map(words, sorted(found))) or "nothing"
    asked = ("saturation and voltage error named", "no drift claimed", "drift told within its interval")
    if thermal is None:
        return [Bar(f"thermal bench: {what}", "yes", "", None) for what in asked]
    return [
        Bar(f"thermal bench: {asked[0]}", "both", names, saturated and VOLTAGE_ERROR in found),
        Bar(f"thermal bench: {asked[1]}", "none", ", ".join(sorted(drift)) or "none", not drift),
        _witnessed(thermal, asked[2]),
    ]


def _witnessed(thermal: Diagnosis, what: str) -> Bar:
    """What is said of the magnets' drift, beside the thermocouple that was withheld."""
    asked = "the thermocouple's within the 95 % interval"
    told = next((remark for remark in thermal.remarks if remark.startswith("drift of the magnets' flux")), "")
    number = re.search(r"([+-]?[\d.]+) ± ([\d.]+) %", told)
    if number is None:
        return Bar(f"thermal bench: {what}", asked, "nothing said of it", False)
    value, half = (float(each) for each in number.groups())
    warmer = _warmer(REAL_DATA / _FILES["lea-thermal"][0])
    true = 100.0 * _NDFEB * warmer
    figure = f"{number[0]}; by {warmer:+.1f} K of the magnets {true:+.2f} %"
    return Bar(f"thermal bench: {what}", asked, figure, abs(value - true) <= half)


def _warmer(path: Path) -> float:
    """By how much the magnets warm up while the motor is driven, along a straight line, K."""
    with path.open(encoding="utf-8") as file:
        rows = [(float(row["pm"]), float(row["motor_speed"])) for row in csv.DictReader(file)]
    driven = [(k, magnet) for k, (magnet, speed) in enumerate(rows) if abs(speed) > _TURNS]
    k, magnet = np.array(driven, np.float64).T
    late = k - k.mean()
    return float(late @ magnet / (late @ late) * (k[-1] - k[0]))


def _shares(shares: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {share:.2f}" for name, share in shares.items())


# --- tables


def _moteus_table(moteus: Mapping[str, Diagnosis]) -> Table:
    heads = ("motor", "verdict", "voltage error", "left out: without", "with it", "upstream's offsets", "said")
    rows: list[tuple[str, ...]] = []
    for name, one in moteus.items():
        loo = one.fit.leave_one_out if one.fit else None
        size = next((f.parameters["voltage"] for f in one.findings if f.effect == VOLTAGE_ERROR), None)
        cells = ["", "", ""]
        if loo is not None:
            errors = (loo.before, loo.alternatives[VOLTAGE_ERROR], loo.alternatives["free_offsets"])
            cells = [quantity(rms, "V", like=loo.before) for rms in errors]
        rows.append((name, words(one.verdict), _size(size) if size else "not named", *cells, one.sentence))
    return Table("moteus: steady points of four motors, one speed within a level of i_d left out at a time", heads,
                 tuple(rows))  # fmt: skip


def _told(title: str, said: Diagnosis) -> Table:
    rows = [("verdict", words(said.verdict)), ("said", said.sentence)]
    for finding in said.findings:
        sizes = ", ".join(f"{words(name)} {_size(size)}" for name, size in finding.parameters.items())
        rows.append((words(finding.effect), sizes))
    for name, size in said.machine_after.items():
        before = said.machine_before.get(name)
        rows.append((f"{name} before and after", f"{_size(before) if before else ''}; {_size(size)}"))
    rows += [("remark", remark) for remark in said.remarks]
    return Table(title, ("", ""), tuple(rows))


def _size(size: Quantity) -> str:
    return quantity(size.value, size.unit, size.std)


def _picture(moteus: Mapping[str, Diagnosis]) -> Any:
    """Held-out errors of the motors by model, over those without the effect."""
    figure = go.Figure()
    models = {"without": "before", "upstream's free offsets": "free_offsets", "with the effect": VOLTAGE_ERROR}
    colours = {"without": "#c8571b", "upstream's free offsets": "#8a8f98", "with the effect": "#14708c"}
    for label, key in models.items():
        shown = {name: one.fit.leave_one_out for name, one in moteus.items() if one.fit and one.fit.leave_one_out}
        y = [1e3 * (loo.before if key == "before" else loo.alternatives[key]) for loo in shown.values()]
        figure.add_bar(x=list(shown), y=y, name=label, marker={"color": colours[label]})
    figure.update_yaxes(title="error on speeds left out, mV", type="log")
    figure.update_layout(title="moteus: held-out error by model", height=320, barmode="group")
    return figure
