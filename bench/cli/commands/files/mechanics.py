"""`pmsm-bench mechanics`: a recording to its shaft's inertia, friction and load torque, as a table or JSON."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from bench.cli.exit_codes import DOES_NOT, HOLDS, NOT_TOLD
from bench.cli.output import print_json
from bench.cli.terminal import Terminal
from bench.engineering import number
from bench.errors import ConfigError
from bench.machine_file import Nominal, load_machine
from bench.recordings.recording import RecordingReader, Summary, joined, open_recording
from estimator.diagnosis.words import sentence_start
from estimator.interval import Z_95, half_width
from estimator.machine import Machine
from estimator.mechanics.mechanics import Mechanics, Told, mechanics
from estimator.online.estimate import Estimate
from estimator.samples import Samples

MOST: Final = 2_000_000  # rows, the first of a longer recording
_NO_VOLTAGE: Final = {"u_d": 0.0, "u_q": 0.0}  # nothing here reads them
_SMALL: Final = 1e-3  # below, a number is shown with an exponent
_CODES: Final = {Told.OK: HOLDS, Told.DOUBTFUL: DOES_NOT}


def run(
    file: Path, machine: Path, trust: Mapping[str, float], mapping: Mapping[str, str], constants: Mapping[str, float],
    *, as_json: bool,
) -> int:
    """Read, tell, print; the exit code."""
    nominal = load_machine(machine)
    known = _machine_of(nominal, constants)
    std = {name: share * abs(getattr(known, name)) / Z_95 for name, share in trust.items() if name in nominal.given}
    with open_recording(
        file, mapping=mapping, constants=_NO_VOLTAGE | dict(constants), T_s=nominal.T_s, theta_step=nominal.theta_step,
        n_p=known.n_p, optional=False,
    ) as reader:
        runs = _runs(reader)
        said = mechanics(runs, known, std)
        remarks = _remarks(reader.summary, runs, nominal, std)
    if as_json:
        print_json({"recording": file, "machine": machine, **_plain(said), "remarks": remarks})
    else:
        _print(file, said, remarks)
    return _CODES.get(said.status, NOT_TOLD)


def _machine_of(nominal: Nominal, constants: Mapping[str, float]) -> Machine:
    """What makes torque of currents. Raises ConfigError where it is not there."""
    n_p = constants.get("n_p", nominal.n_p)
    missing = [name for name, value in (("psi_f", nominal.given.get("psi_f")), ("n_p", n_p)) if value is None]
    if missing or n_p is None:
        raise ConfigError(f"{nominal.source}: torque needs {' and '.join(missing)}, expected them in [machine]")
    L = [nominal.given.get(name) for name in ("L_d", "L_q")]
    L_d, L_q = (0.0, 0.0) if L[0] is None or L[1] is None else (L[0], L[1])
    return Machine(nominal.given.get("R_s", 0.0), L_d, L_q, nominal.given["psi_f"], int(n_p), nominal.i_rated)


def _runs(reader: RecordingReader) -> list[Samples]:
    runs: list[Samples] = []
    for run in joined(reader):
        runs.append(run[: MOST - sum(map(len, runs))])
        if sum(map(len, runs)) >= MOST:
            break
    return runs


def _remarks(summary: Summary, runs: list[Samples], nominal: Nominal, std: Mapping[str, float]) -> list[str]:
    """What a user should know besides, a sentence each."""
    said = list(summary.remarks())
    if sum(map(len, runs)) >= MOST:
        said.append(f"the first {MOST} rows are used")
    if "L_d" not in nominal.given or "L_q" not in nominal.given:
        said.append("L_d or L_q is not given: reluctance torque is taken for none")
    if "psi_f" not in std:
        said.append("psi_f is taken as exact: all four are off by the share that it is; --trust psi_f=2% counts it in")
    if not nominal.theta_step:
        said.append("encoder_counts is not given: an angle that is half a count behind is not in the intervals")
    return said


def _plain(said: Mechanics) -> dict[str, Any]:
    """As plain values, SI."""
    content = asdict(said)
    return {
        "status": said.status.value, "sentence": said.sentence,
        "estimates": {name: asdict(e) for name, e in said.estimates.items()}, "sum": content["sum"],
        "stretch_s": said.stretch, "stretches": said.stretches, "torque_rms_Nm": said.torque_rms,
        "residual_rms_Nm": said.residual_rms, "rows": said.rows, "gaps": said.gaps,
    }


def _print(file: Path, said: Mechanics, remarks: list[str]) -> None:
    console = Terminal(soft_wrap=True)
    table = Table()
    for heading in ("", "value", "± 95 %", "unit", "status"):
        table.add_column(heading, justify="right" if heading in ("value", "± 95 %") else "left")
    every = [*said.estimates.values(), *([] if said.sum is None else [said.sum])]
    counts = Counter(e.reason for e in every if e.reason and e.reason not in said.sentence)
    below = [reason for reason, count in counts.items() if count > 1]
    for e in every:
        table.add_row(*_cells(e, (said.sentence, *below)))
    console.print(f"{file}: {said.rows} rows, {said.gaps} gaps")
    console.print(table, soft_wrap=False)
    if said.stretch is not None and said.torque_rms is not None and said.residual_rms is not None:
        console.print(
            f"{said.stretches} stretches of {1e3 * said.stretch:.3g} ms; {said.torque_rms:.3g} Nm rms accelerate the "
            f"shaft, {said.residual_rms:.2g} Nm rms are left"
        )
    for sentence in filter(None, (said.sentence, *below)):
        console.print(f"{sentence_start(sentence)}.")
    for remark in remarks:
        console.print(remark)


def _cells(e: Estimate, elsewhere: Sequence[str]) -> list[str]:
    """Of a row; its reason unless that is told elsewhere."""
    half = half_width(e.std)
    status = e.status.replace("_", " ")
    reason = "" if any(e.reason in sentence for sentence in elsewhere) else f": {e.reason}"
    return [
        e.name, "-" if e.value is None else _digits(e.value, half), "-" if half is None else f"{half:.2g}", e.unit,
        f"{status}{reason}",
    ]


def _digits(value: float, half: float | None) -> str:
    """To the second digit of the interval; small numbers with an exponent."""
    if abs(value) >= _SMALL or value == 0.0:
        return number(value, half)
    exponent = math.floor(math.log10(abs(value)))
    return f"{number(value / 10.0**exponent, None if half is None else half / 10.0**exponent)}e{exponent:03d}"
