"""The thermal bench log of the LEA department, Paderborn (Kirchgaessner, Wallscheid, Boecker): 2 Hz, physical units.

Columns `u_d u_q i_d i_q` and `motor_speed` (rpm) are read; temperatures are not. The log does not tell its pole pairs:
3 are assumed where neither the machine file nor `--set n_p=...` says otherwise, which scales psi_f, L_d and L_q alone.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from bench.diagnoses.diagnosis_request import Request, Tell
from bench.diagnoses.formats import points
from bench.diagnoses.formats.format import Diagnosed, Format
from bench.recordings.table import column_names

RATE: Final = 2.0  # Hz
POLE_PAIRS: Final = 3
SPEED: Final = "motor_speed"  # rpm


def sniff(path: Path, mapping: Mapping[str, str]) -> bool:
    """The log's columns, by their names."""
    present = set(column_names(path))
    return not mapping and present >= {SPEED, "pm", "stator_winding", *points.VOLTAGES_AND_CURRENTS}


def diagnose(request: Request, tell: Tell) -> Diagnosed:
    """Read and diagnose a session's log."""
    mapping = {"speed_rpm": SPEED, **request.mapping}
    told = "n_p" in request.constants or request.nominal.n_p is not None
    nominal = request.nominal if told else replace(request.nominal, n_p=POLE_PAIRS)
    request = replace(request, mapping=mapping, nominal=nominal)
    done = points.diagnose(request, tell, rate=RATE)
    if told:
        return done
    assumed = f"pole pairs are not told, {POLE_PAIRS} assumed; with others psi_f, L_d and L_q scale inversely"
    return replace(done, diagnosis=replace(done.diagnosis, remarks=(*done.diagnosis.remarks, assumed)))


FORMAT: Final = Format("lea-thermal", sniff, diagnose)
