"""A servo drive's sine sweep at standstill: `F_Hz t_s Ts_s`, phase currents, counts of the phase voltages, the dc link.

A stretch of rows a frequency. `va_cnt vb_cnt vc_cnt` are what the legs are told, in counts of a timer whose full scale
the file does not name: it follows from them, `Vdc_V` and the voltage `vqd_V` that they stand for.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from bench.diagnoses.diagnosis_request import Request, Tell
from bench.diagnoses.formats.format import Diagnosed, Format
from bench.diagnoses.formats.standstill import Columns, is_there, read, summary_of
from bench.errors import RecordingError
from estimator.diagnosis.standstill.sweep import diagnose_sweep
from estimator.diagnosis.standstill.tones import Tone

CURRENTS: Final = ("ia_A", "ib_A", "ic_A")
COUNTS: Final = ("va_cnt", "vb_cnt", "vc_cnt")
COLUMNS: Final = ("F_Hz", "t_s", "Ts_s", *CURRENTS, "Vdc_V", *COUNTS, "vqd_V")


def sniff(path: Path, mapping: Mapping[str, str]) -> bool:
    """A frequency, a sampling period and counts."""
    return is_there(path, COLUMNS, mapping)


def diagnose(request: Request, tell: Tell) -> Diagnosed:
    """Read and diagnose a sweep."""
    tell(0.0, "reading")
    columns = read(request, COLUMNS)
    rows = len(columns["t_s"])
    whole = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    columns = {name: column[whole] for name, column in columns.items()}
    tell(0.05, "fitting")
    try:
        tones = _tones(columns)
        diagnosis = diagnose_sweep(tones)
    except ValueError as error:
        raise RecordingError(f"{request.file}: {error}") from error
    used = sum(len(tone.t) for tone in tones)
    return Diagnosed(summary_of(request, COLUMNS, min(t.T_s for t in tones), rows, used), request.nominal, diagnosis)


def _tones(columns: Columns) -> list[Tone]:
    if not len(columns["t_s"]):
        raise ValueError("expected rows with a number in every column, came none")
    alpha = columns["va_cnt"] - np.mean([columns[name] for name in COUNTS], axis=0)
    told = columns["vqd_V"]
    large = np.abs(told) > 0.5 * np.abs(told).max()
    if not large.any() or not np.all(np.abs(alpha[large]) > 0.0):
        raise ValueError("expected voltages vqd_V on the axis of phase a, as the counts have them")
    full = float(np.median(alpha[large] * columns["Vdc_V"][large] / told[large]))
    duties = np.column_stack([columns[name] for name in COUNTS]) / full
    i = np.column_stack([columns[name] for name in CURRENTS])
    tones: list[Tone] = []
    for frequency in np.unique(columns["F_Hz"]):
        at = columns["F_Hz"] == frequency
        t, T_s = columns["t_s"][at], columns["Ts_s"][at]
        if not frequency > 0.0 or not np.allclose(T_s, T_s[0]) or not np.allclose(np.diff(t), T_s[0], rtol=1e-3):
            raise ValueError(f"expected rows {T_s[0]:g} s apart at {frequency:g} Hz, got others")
        tones.append(Tone(float(frequency), float(T_s[0]), t, duties[at], columns["Vdc_V"][at], i[at]))
    return tones


FORMAT: Final = Format("servo-sine", sniff, diagnose)
