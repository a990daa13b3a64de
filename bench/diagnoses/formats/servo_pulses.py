"""A servo drive's voltage pulses on a held rotor: `angle_pu segment state`, phase currents, the dc link.

A segment is a train of pulses in one direction at one angle (in turns of the rotor). The low four bits of `state` say
what the bridge does: 1 nothing; 2, 7, 9 drive the current forth; 3, 5, 10 back; 4, 6, 8, 11 short the phases. Where
nothing is done the currents' offsets show.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from bench.diagnoses.diagnosis_request import Request, Tell
from bench.diagnoses.formats.format import Diagnosed, Format
from bench.diagnoses.formats.standstill import Columns, is_there, read, summary_of
from bench.errors import RecordingError
from estimator.diagnosis.standstill.pulse_fit import Train
from estimator.diagnosis.standstill.pulses import diagnose_pulses

CURRENTS: Final = ("ia_A", "ib_A", "ic_A")
COLUMNS: Final = ("angle_pu", "segment", "t_us", "Vdc_V", *CURRENTS, "state")
_SIGNS: Final = {2: 1.0, 7: 1.0, 9: 1.0, 3: -1.0, 5: -1.0, 10: -1.0}
_IDLE: Final = 1


def sniff(path: Path, mapping: Mapping[str, str]) -> bool:
    """Segments at angles, with states of the bridge."""
    return is_there(path, COLUMNS, mapping)


def diagnose(request: Request, tell: Tell) -> Diagnosed:
    """Read and diagnose pulses. Of the machine file, R_s and the pole pairs are of use."""
    tell(0.0, "reading")
    columns = read(request, COLUMNS)
    tell(0.1, "fitting")
    nominal = request.nominal
    try:
        trains = _trains(columns)
        diagnosis = diagnose_pulses(trains, nominal.n_p, nominal.given.get("R_s"))
    except ValueError as error:
        raise RecordingError(f"{request.file}: {error}") from error
    rows, used = len(columns["t_us"]), sum(len(train.sign) for train in trains)
    return Diagnosed(summary_of(request, COLUMNS, trains[0].T_s, rows, used), nominal, diagnosis)


def _trains(columns: Columns) -> list[Train]:
    whole = np.all([np.isfinite(column) for name, column in columns.items() if name != "angle_pu"], axis=0)
    columns = {name: column[whole] for name, column in columns.items()}
    state = columns["state"].astype(np.int64) & 15
    i = np.column_stack([columns[name] for name in CURRENTS])
    idle = state == _IDLE
    if not idle.any():
        raise ValueError("expected rows of state 1, which show the currents' offsets, came none")
    i = i - i[idle].mean(axis=0)
    at_angle = np.isfinite(columns["angle_pu"])
    trains: list[Train] = []
    for angle, segment in np.unique(np.column_stack([columns["angle_pu"], columns["segment"]])[at_angle], axis=0):
        rows = np.flatnonzero((columns["angle_pu"] == angle) & (columns["segment"] == segment))
        steps = np.diff(columns["t_us"][rows])
        if len(steps) < 2 or not np.allclose(steps, steps[0], rtol=0.01) or not steps[0] > 0.0:
            raise ValueError(f"expected equal steps of t_us in segment {segment:g} at angle {angle:g}, got others")
        sign = np.array([_SIGNS.get(int(s), 0.0) for s in state[rows]])
        trains.append(Train(2.0 * math.pi * float(angle), 1e-6 * float(np.median(steps)), state[rows], sign,
                            columns["Vdc_V"][rows], i[rows]))  # fmt: skip
    if not trains:
        raise ValueError("expected segments at angles, came none")
    return trains


FORMAT: Final = Format("servo-pulses", sniff, diagnose)
