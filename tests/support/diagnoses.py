"""Diagnoses made by hand, of every kind and with every field in use."""

import math
import os
import threading
from dataclasses import replace

import numpy as np

from bench.diagnoses.diagnose import Diagnosed, as_json
from bench.diagnoses.diagnosed_machine import machine_text
from bench.diagnoses.diagnosis_request import Request, Result, Tell
from bench.diagnoses.figures.figure import figures_text
from bench.diagnoses.figures.pictures import pictures
from bench.diagnoses.report.page import report
from bench.errors import RecordingError
from bench.machine_file import Nominal
from bench.recordings.recording import Summary
from estimator.diagnosis.answer.sentences import sentence_of
from estimator.diagnosis.verdict import (
    Ambiguity,
    Candidate,
    Diagnosis,
    ErrorChange,
    Experiment,
    Finding,
    Fit,
    Hold,
    Map,
    Place,
    Quantity,
    Rival,
    Traces,
    Unexplained,
    Verdict,
)

NOMINAL = Nominal(
    {"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.3e-3, "psi_f": 0.118}, n_p=4, i_rated=6.0, T_s=1e-4, u_dc=310.0,
    encoder_counts=65536,
)
RECORDING = Summary(
    "runs/0007.parquet", 1e-4, 1, 60_000, 59_990, 2, 6.0, 4, {"u_d": 4}, 0, 6, 0, {"t": "column t"}, (), 60_000
)


def _traces() -> Traces:
    """As an inverter's voltage error shows: at zero crossings, sixth order, on both axes."""
    random = np.random.default_rng(7)
    t = np.linspace(0.0, 6.0, 121)
    window_t = np.arange(0.0, 0.05, 1e-4) + 2.4
    angle = 2 * np.pi * 80 * window_t
    error = 3.0 * np.sign(np.sin(3 * angle)) * (0.4 + 0.6 * np.abs(np.cos(3 * angle)))
    noise = random.normal(0.0, 0.4, (2, len(window_t)))
    i_d, i_q = -1.0 + 0.2 * np.sin(angle), 3.0 + np.sign(np.sin(angle / 4))
    frequency = np.linspace(0.0, 5000.0, 400)
    floor = 6e-3 * np.ones_like(frequency)
    lines = sum(0.2 / k * np.exp(-(((frequency - 480 * k) / 15) ** 2)) for k in range(1, 5))
    edges_x, edges_y = np.linspace(0, 360, 25), np.linspace(0, 6, 9)
    angles = (edges_x[:-1] + edges_x[1:]) / 2
    before = 0.4 + 2.5 * np.exp(-((((angles + 30) % 60) - 30) / 12) ** 2)[None, :] * np.ones((8, 1))
    before[0, :5] = np.nan
    return Traces(
        t=t, before_V=2.6 + 0.3 * np.sin(t) + random.normal(0, 0.05, len(t)),
        after_V=0.4 + random.normal(0, 0.01, len(t)),
        window_t=window_t,
        window={"u_d": (error + noise[0], noise[0]), "u_q": (0.6 * error + noise[1], noise[1])},
        window_i={"i_d": (i_d, i_d + 0.15 * np.sin(3 * angle), i_d + 0.01),
                  "i_q": (i_q, i_q + 0.25 * np.sin(3 * angle), i_q - 0.01)},
        frequency=frequency, spectrum=(floor + lines, floor),
        maps=(
            Map("electrical angle, deg", "current, A", edges_x, edges_y, before, 0.4 + 0 * before),
            Map("speed, rpm", "i_q, A", np.linspace(0, 3e3, 7), edges_y - 3, before[:, :6], before[:, :6] / 5),
        ),
        periods=10, floor_V=0.38,
    )  # fmt: skip


def _quantity(value: float | None, std: float | None, unit: str) -> Quantity:
    return Quantity(value, std, unit)


_WHERE = Place(
    "where a phase current changes sign", {"distance": (-0.4, 0.4), "axis": "q", "order": 6.0}, 0.92, 0.12
)

EXPLAINED = Diagnosis(
    verdict=Verdict.EXPLAINED,
    sentence=(
        "The inverter's voltage error was left out: 2.0 us of dead time at 310 V; it hid as +1.46 ohm of R_s; it acts "
        "where a phase current changes sign; with it the held-out error falls from 2.69 V to 0.40 V."
    ),
    findings=(
        Finding(
            "inverter_voltage_error",
            {"dead_time": _quantity(2.0e-6, 3e-8, "s"), "u_drop": _quantity(0.85, 0.02, "V"),
             "zero_crossing_width": _quantity(0.04, None, "A")},
            _WHERE, 1e40, (Rival("phase_resistance_imbalance", 3.4e11), Rival("q_axis_saturation", math.inf)),
            {"R_s": 1.46, "L_q": -1.2e-4},
        ),
        Finding(
            "d_axis_saturation", {"L_d_drop": _quantity(0.12, 0.004, "1")},
            replace(_WHERE, sentence="at high i_d", region={"i_d": (-6.0, -4.0)}, energy_share=0.4), 250.0,
            (Rival("cross_saturation", 250.0),), {"L_d": -3e-4},
        ),
    ),
    ambiguous=(), unexplained=None,
    detectable={
        "inverter_voltage_error": _quantity(0.031, None, "V"), "iron_loss": _quantity(2400.0, None, "ohm"),
        "winding_resistance_drift": _quantity(0.004, None, "1"), "voltage_delay": _quantity(None, None, "1"),
    },
    machine_before={
        "R_s": _quantity(2.43, 0.02, "ohm"), "L_d": _quantity(4.01e-3, 2e-5, "H"),
        "L_q": _quantity(6.1e-3, 2e-5, "H"), "psi_f": _quantity(0.1192, 1e-4, "Vs"),
    },
    machine_after={
        "R_s": _quantity(0.9668, 4e-4, "ohm"), "L_d": _quantity(4.238e-3, 3e-6, "H"),
        "L_q": _quantity(6.212e-3, 3e-6, "H"), "psi_f": _quantity(0.11999, 1e-5, "Vs"),
    },
    fit=Fit(True, ErrorChange(2.69, 0.40, 0.39), ErrorChange(0.31, 0.012), 0.978, ErrorChange(14.0, 1.04)),
    candidates=(
        Candidate("inverter_voltage_error", 5321.0, 4100.0, chosen=True),
        Candidate("phase_resistance_imbalance", 812.0, -1.8, chosen=False),
        Candidate("d_axis_saturation", 90.0, 2.4, chosen=True),
        Candidate("iron_loss", 14.0, -2.1, chosen=False),
        Candidate("voltage_delay", 0.6, -2.6, chosen=False),
        Candidate("angle_offset", -math.inf, math.nan, chosen=False),
    ),
    remarks=("the currents' converter clips at 24 A in 12 rows",),
    traces=_traces(),
)

AMBIGUOUS = replace(
    EXPLAINED,
    verdict=Verdict.AMBIGUOUS,
    sentence="Iron loss cannot be told from winding resistance drift on this recording.",
    findings=(),
    ambiguous=(
        Ambiguity(
            ("iron_loss", "winding_resistance_drift"), "they are collinear to 0.99 here, at one speed",
            Experiment(
                "record 500 and 2000 rpm at the same currents", (500.0, 2000.0), (0.0, -1.8), (3.0,), 6.0,
                (Hold(500.0, 0.0, 3.0, 3.0), Hold(2000.0, -1.8, 3.0, 3.0)), 0.6, 1e6,
            ),
        ),
    ),
    unexplained=Unexplained(0.7, _WHERE, "a 90 Hz voltage of 1.0 V fixed in the stationary frame"),
)  # fmt: skip

DOUBTFUL = replace(AMBIGUOUS, sentence=sentence_of(AMBIGUOUS), experiment=AMBIGUOUS.ambiguous[0].experiment)

CONVENTION = replace(
    EXPLAINED,
    sentence="The recording follows a convention that differs from the one expected: u scale 150 %.",
    findings=(
        Finding("convention_error", {"u_scale": _quantity(1.5, None, "1")}, Place("in every row", {}, 1.0, 1.0), 1e30,
                (), {}),
    ),
    fit=Fit(True, ErrorChange(16.5, 16.5, 16.4), ErrorChange(0.012, 0.012), 0.0, ErrorChange(1.04, 1.04)),
)  # fmt: skip

UNEXPLAINED = replace(AMBIGUOUS, verdict=Verdict.UNEXPLAINED, ambiguous=(), sentence="None of these: a 90 Hz voltage.")

NO_MISMATCH = replace(
    EXPLAINED, verdict=Verdict.NO_MISMATCH, sentence="No mismatch beyond noise.", findings=(), remarks=(),
)

NOTHING_TOLD = Diagnosis(
    Verdict.NOT_ENOUGH_EXCITATION, "The motor stands still and its currents do not change: nothing can be told.",
    (), (), None, {}, {}, {}, None, (), ("record at 500 rpm or more, with steps of i_d and i_q",), None,
)  # fmt: skip

ALL = {
    "explained": EXPLAINED, "ambiguous": AMBIGUOUS, "unexplained": UNEXPLAINED, "no mismatch": NO_MISMATCH,
    "nothing told": NOTHING_TOLD,
}  # fmt: skip

OTHERS = {"convention": CONVENTION, "doubtful": DOUBTFUL}


def work(request: Request, tell: Tell) -> Result:
    """Diagnoses by the names of files, in place of the diagnosis: `explained.csv`; others fail, die, or have no end."""
    name = request.file.name.partition(".")[0].rstrip("0123456789")
    tell(0.5, "looking at the name")
    if name == "refused":
        raise RecordingError(f"{request.file}: expected another name")
    if name == "broken":
        raise ZeroDivisionError("division by zero")
    if name == "dies":
        os._exit(3)
    if name == "endless":
        threading.Event().wait()
    if name == "overtaken":  # somebody else writes where its output is to go
        (request.file.parent / "out.json").write_text("mine", encoding="utf-8")
    if name == "homeless":  # somebody takes the folder of its outputs away
        (request.file.parent / "out").rmdir()
    diagnosis = (ALL | OTHERS).get(name.replace("_", " "), EXPLAINED)
    content = as_json(Diagnosed(replace(RECORDING, path=str(request.file)), request.nominal, diagnosis))
    content["remarks"] += [f"trust {dict(request.trust)}"] if request.trust else []
    if told := ", ".join(f"{key} {one.value:g}" for key, one in sorted(request.witnesses.items())):
        content["remarks"] += [f"witnesses {told}"]
    machine = machine_text(diagnosis, request.nominal, request.file.name) if diagnosis.machine_after else None
    page = page_of(diagnosis, request.nominal) if request.report else None
    return Result(content, machine, page, figures_text(pictures(diagnosis)))


def page_of(diagnosis: Diagnosis, nominal: Nominal = NOMINAL, recording: Summary = RECORDING) -> str:
    """Its report."""
    return report(diagnosis, recording, nominal, pictures(diagnosis))
