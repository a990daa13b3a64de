"""Steady points: a table (CSV, CSV.gz, Parquet) with one steady state a row, SI and peak dq quantities.

Columns `u_d u_q i_d i_q`, or `u_q i_q` alone, and `omega_e` (rad/s, electrical) or `speed_rpm` (mechanical, with
pole pairs from the machine file or `--set n_p=...`); `t` (s) where the rows are a log in time. A mapping names columns
called otherwise, and their units: `omega_e=erpm[erpm]`. Further columns are not read.
"""

import math
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.diagnoses.diagnosis_request import Request, Tell
from bench.diagnoses.formats.format import Diagnosed, Format
from bench.errors import ConfigError, RecordingError, shown
from bench.recordings.forms.csv_rows import Lines
from bench.recordings.forms.units import UNCHANGED
from bench.recordings.recording import Summary
from bench.recordings.runs import LONGEST, PROBE
from bench.recordings.sources import Source, bare_names, listed, source_of
from bench.recordings.table import Header, column_names, header_of, quoted, read_parts, read_whole
from estimator.diagnosis.points.diagnose import diagnose_points, given_off
from estimator.diagnosis.points.q_axis_diagnosis import diagnose_q_points
from estimator.diagnosis.points.table import Points, steady

VOLTAGES_AND_CURRENTS: Final = ("u_d", "u_q", "i_d", "i_q")
OF_Q: Final = ("u_q", "i_q")  # without u_d these alone; i_d where it is there
KNOWN: Final = (*VOLTAGES_AND_CURRENTS, "omega_e", "speed_rpm", "t")
CONSTANTS: Final = ("n_p",)
OF_PERIODS: Final = ("theta_e", "i_a", "i_b", "i_c")  # told by recordings only
_MOST: Final = 1_000_000  # rows of a log in time
_MOST_APART: Final = 3_000  # rows, each an operating point
_RAD_S: Final = math.pi / 30.0  # of 1 rpm

Column = NDArray[np.float64]


def sniff(path: Path, mapping: Mapping[str, str]) -> bool:
    """Voltages, currents and a speed, and no time; or a time beside a speed in rpm, or one whose unit puts rows too far
    apart for control periods. Nothing of single periods.
    """
    present = {*bare_names(column_names(path)), *mapping}
    if present & set(OF_PERIODS):
        return False
    if not present >= set(OF_Q):
        return False
    return "speed_rpm" in present or ("omega_e" in present and ("t" not in present or _far_apart(path, mapping)))


def _far_apart(path: Path, mapping: Mapping[str, str]) -> bool:
    """Whether times whose unit is told, and so is no guess, are those of a log."""
    source = source_of(path, header_of(path), "t", mapping.get("t"), None)
    if source is None or (not source.unit and source.scale == UNCHANGED):
        return False
    with closing(read_parts(path, [source.column], PROBE)) as parts:
        first = next((part[source.column] for part in parts if part), np.empty(0))
    t = source.scale(first[np.isfinite(first)])
    return len(t) > 1 and float(np.median(np.diff(t))) > LONGEST


def diagnose(request: Request, tell: Tell, rate: float | None = None) -> Diagnosed:
    """Read and diagnose points. `rate` (Hz) of the rows of a log without a column of times."""
    tell(0.0, "reading")
    if request.align:
        raise ConfigError("--align is of recordings: steady points stand still")
    n_p = _pole_pairs(request)
    header = header_of(request.file)
    sources = sources_of(request.file, header, request.mapping, n_p)
    if "speed_rpm" in sources and n_p is None:
        raise ConfigError(
            f"{request.file}: speed_rpm is mechanical, expected the pole pairs: n_p in --nominal MACHINE.toml, "
            "or --set n_p=..."
        )
    most = _MOST if "t" in sources or rate is not None else _MOST_APART
    too_many = (
        f"expected at most {most} steady points, one operating point a row, came more; a log of them needs a column t "
        "(s), and so does a recording of every control period, with theta_e or omega_e"
    )
    lines = Lines()
    columns = {name: source.column for name, source in sources.items()}
    cells = read_whole(request.file, columns, most, too_many, lines)
    cells = {name: sources[name].scale(column) for name, column in cells.items()}
    omega_e = cells["omega_e"] if "omega_e" in cells else cells["speed_rpm"] * _RAD_S * (n_p or 1)
    nominal = replace(request.nominal, n_p=n_p)
    rows = len(omega_e)
    t = np.arange(rows) / rate if rate is not None and "t" not in cells else cells.get("t")
    none = np.zeros(rows)
    u, i = cells.get("u_d", none) + 1j * cells["u_q"], cells.get("i_d", none) + 1j * cells["i_q"]
    whole = np.isfinite(u) & np.isfinite(i) & np.isfinite(omega_e)
    if t is not None:
        whole &= np.isfinite(t)
    left_out = int(np.sum(~whole))
    if not whole.any():
        raise RecordingError(f"{request.file}: expected rows with a number in every column, came none of {rows}")
    t = None if t is None else t[whole]
    points = Points(omega_e[whole], i[whole], u[whole], t)
    if t is not None:
        points = points.at(np.argsort(t, kind="stable"))
    tell(0.1, "fitting")
    if "u_d" in cells:
        diagnosis = diagnose_points(points, n_p=nominal.n_p, i_rated=nominal.i_rated, witnesses=request.witnesses)
    else:
        diagnosis = diagnose_q_points(points, i_d="i_d" in cells, witnesses=request.witnesses)
    remarks = [*diagnosis.remarks, *given_off(diagnosis.machine_after, nominal.given, request.trust)]
    if left_out:
        remarks.insert(0, f"rows left out for want of a value: {left_out} of {rows}")
    scaled = (source.remark(name) for name, source in sources.items())
    remarks = [said for said in (header.remark, *lines.remarks(), *scaled) if said] + remarks
    summary = summary_of(
        request.file, rows, len(steady(points).points), {name: source.told() for name, source in sources.items()},
        0.0 if t is None else float(t.max() - t.min()),
    )
    return Diagnosed(summary, nominal, replace(diagnosis, remarks=tuple(remarks)))


def summary_of(path: Path, rows: int, used: int, sources: Mapping[str, str], duration: float) -> Summary:
    """The account of a table, which has no control period."""
    return Summary(
        path=str(path), T_s=math.nan, periods=1, rows=rows, used=used, runs=1, duration=duration, left_out=0,
        missing={}, unaligned=0, lost_rows=0, irregular_steps=0, sources=sources, unused=(),
    )  # fmt: skip


def sources_of(path: Path, header: Header, mapping: Mapping[str, str], n_p: int | None) -> dict[str, Source]:
    """The file's column of each quantity. Raises ConfigError, RecordingError."""
    for name in mapping:
        if name not in KNOWN:
            raise ConfigError(f"no quantity {quoted(name)} in steady points, expected one of {', '.join(KNOWN)}")
    looked_for = ((name, source_of(path, header, name, mapping.get(name), n_p)) for name in KNOWN)
    found = {name: source for name, source in looked_for if source is not None}
    needed = VOLTAGES_AND_CURRENTS if "u_d" in found or "u_q" not in found else OF_Q
    missing = [name for name in needed if name not in found]
    if "omega_e" not in found and "speed_rpm" not in found:
        missing.append("omega_e or speed_rpm")
    if missing:
        raise RecordingError(
            f"{path}: missing columns: {', '.join(missing)}; present: {listed(header.names)}; "
            "map a column to each by --map"
        )
    if "omega_e" in found:
        found.pop("speed_rpm", None)
    return found


def _pole_pairs(request: Request) -> int | None:
    for name in request.constants:
        if name not in CONSTANTS:
            raise ConfigError(f"no constant {quoted(name)} for steady points, expected {', '.join(CONSTANTS)}")
    given = request.constants.get("n_p", request.nominal.n_p)
    if given is not None and not (1 <= given <= 200 and given == int(given)):
        raise ConfigError(f"n_p: expected a whole number of pole pairs, 1 to 200, got {shown(given)}")
    return None if given is None else int(given)


FORMAT: Final = Format("points", sniff, diagnose)
