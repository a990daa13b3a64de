"""What moteus's calibration of L_d leaves (mjbots/moteus, lib/python/moteus, `ld_saturation`): JSON of one motor.

`raw` holds, per level of i_d (A), points of electrical speed `omega` (rad/s) and `y` = u_q - R i_q (V), taken without
load; `params` the resistance R (ohm), the poles and, where it is there, the flux as `v_per_hz`, of another run: a
witness of psi_f to 2 %, unless there is another one, and only where these points agree with it. i_q is not stored.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from bench.diagnoses.diagnosis_request import Request, Tell
from bench.diagnoses.formats.format import Diagnosed, Format
from bench.diagnoses.formats.points import summary_of
from bench.errors import ConfigError, RecordingError, shown
from bench.files import check_regular, json_of, read_bytes
from bench.machine_file import Nominal
from estimator.diagnosis.points.diagnose import given_off
from estimator.diagnosis.points.no_load import NoLoad
from estimator.diagnosis.points.no_load_diagnosis import diagnose_no_load
from estimator.interval import Z_95
from estimator.machine import PLAUSIBLE
from estimator.witness import Witness

_OF_OWN: Final = 0.02  # half of a 95 % interval: v_per_hz is the slope of another run


def sniff(path: Path, _mapping: Mapping[str, str]) -> bool:
    """A JSON object with `raw` and `params`."""
    check_regular(path)
    with path.open("rb") as file:
        if not file.read(64).lstrip().startswith(b"{"):
            return False
    return {"raw", "params"} <= set(_content(path))


def diagnose(request: Request, tell: Tell) -> Diagnosed:
    """Read and diagnose a motor's calibration."""
    tell(0.0, "reading")
    for option, given in (("--map", request.mapping), ("--set", request.constants), ("--align", request.align)):
        if given:
            raise ConfigError(f"{option} is none of moteus-ld's: its file names everything")
    content = _content(request.file)
    points = _points(request.file, content)
    nominal = _nominal(request.nominal, content)
    tell(0.1, "fitting")
    witnesses = {**_own_witness(nominal, content), **request.witnesses}
    diagnosis = diagnose_no_load(points, witnesses)
    sources = {"omega_e": "raw omega", "u_q - R i_q": "raw y", "i_d": "levels of raw", "R_s": "params R"}
    summary = summary_of(request.file, len(points.y), len(points.y), sources, 0.0)
    off = given_off(diagnosis.machine_after, nominal.given, request.trust)
    return Diagnosed(summary, nominal, replace(diagnosis, remarks=(*diagnosis.remarks, *off)))


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json_of(read_bytes(path))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise RecordingError(f"{path}: expected JSON, came something else: {str(error)[:80]}") from error
    return cast(dict[str, Any], _expect(path, "the file", content))


def _points(path: Path, content: Mapping[str, Any]) -> NoLoad:
    raw, params = _expect(path, "raw", content.get("raw")), _expect(path, "params", content.get("params"))
    R_s = _number(path, "params R", params.get("R"))
    low, high = PLAUSIBLE["R_s"]
    if not low <= R_s <= high:
        raise RecordingError(f"{path}: params R: expected {low:g} to {high:g} ohm, came {R_s:g}")
    rows: list[tuple[float, float, float]] = []
    for level, listed in raw.items():
        try:
            i_d = float(level)
        except ValueError:
            raise RecordingError(f"{path}: raw: expected levels of i_d in A, came {shown(level)}") from None
        if not math.isfinite(i_d) or not isinstance(listed, list):
            raise RecordingError(f"{path}: raw {shown(level)}: expected a list of points, came {shown(listed)}")
        for point in cast(list[Any], listed):
            one = _expect(path, f"a point of raw {level}", point)
            omega, y = (_number(path, f"raw {level} {name}", one.get(name)) for name in ("omega", "y"))
            rows.append((omega, y, i_d))
    if not rows:
        raise RecordingError(f"{path}: raw: expected points of omega and y, came none")
    omega_e, y, i_d = np.array(rows).T
    if float(np.max(np.abs(omega_e))) <= 0.0:
        raise RecordingError(f"{path}: raw: expected points at speed, came omega of zero alone")
    return NoLoad(omega_e, y, i_d, R_s)


def _own_witness(nominal: Nominal, content: Mapping[str, Any]) -> dict[str, Witness]:
    """The file's own flux: the slope of another run."""
    flux, n_p = _flux_of(content["params"]), nominal.n_p
    if flux is None or n_p is None:
        return {}
    psi_f = flux / (2.0 * math.pi * n_p)  # v_per_hz: V peak per mechanical turn a second
    return {"psi_f": Witness(psi_f, _OF_OWN * psi_f / Z_95)}


def _flux_of(params: Mapping[str, Any]) -> float | None:
    flux = params.get("v_per_hz")
    return float(flux) if isinstance(flux, int | float) and 0.0 < flux < math.inf else None


def _nominal(given: Nominal, content: Mapping[str, Any]) -> Nominal:
    """What the user says, and else what the file does."""
    params = content["params"]
    poles = params.get("poles")
    n_p = poles // 2 if isinstance(poles, int) and not isinstance(poles, bool) and 2 <= poles <= 400 else None
    known = {"R_s": float(params["R"])}
    flux, inductance = _flux_of(params), params.get("cal_inductance_d_H")
    if n_p is not None and flux is not None:
        known["psi_f"] = flux / (2.0 * math.pi * n_p)
    if isinstance(inductance, int | float) and 0.0 < inductance < math.inf:
        known["L_d"] = float(inductance)
    return replace(given, given={**known, **given.given}, n_p=n_p if given.n_p is None else given.n_p)


def _expect(path: Path, what: str, content: object) -> Mapping[str, Any]:
    if not isinstance(content, dict):
        raise RecordingError(f"{path}: {what}: expected a JSON object, came {shown(content)}")
    return cast(Mapping[str, Any], content)


def _number(path: Path, what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e12:
        raise RecordingError(f"{path}: {what}: expected a finite number, came {shown(value)}")
    return float(value)


FORMAT: Final = Format("moteus-ld", sniff, diagnose)
