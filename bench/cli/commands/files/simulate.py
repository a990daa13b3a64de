"""`pmsm-bench simulate`: a recording beside its machine, to two errors and the simulated currents."""

from collections.abc import Mapping
from pathlib import Path

from bench.cli.output import check_recording, print_json
from bench.cli.terminal import Terminal
from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.simulate import simulate
from bench.engineering import quantity, words
from bench.machine_file import load_machine
from bench.recordings.capture_file import write_columns
from estimator.diagnosis.verdict import ErrorChange


def run(
    file: Path, machine: Path, mapping: Mapping[str, str], constants: Mapping[str, float], align: Mapping[str, float],
    out: Path | None, *, as_json: bool,
) -> None:
    """Simulate, print the errors without and with the effects, write the simulated currents."""
    if out is not None:
        check_recording(out)
    nominal = load_machine(machine)
    summary, found = simulate(Request(file, nominal, mapping=mapping, constants=constants, align=align))
    if out is not None:
        columns = {"t": found.t, "i_d": found.i.real, "i_q": found.i.imag}
        write_columns(out, columns, {"simulated": str(file), "machine": str(machine)})
    if as_json:
        print_json({
            "recording": file, "machine": machine, "effects": list(nominal.equations), "samples": len(found.t),
            "one_step_rms_V": found.one_step_rms_V, "free_run_rms_A": found.free_run_rms_A,
            "remarks": list(summary.remarks()), "out": out,
        })
        return
    console = Terminal(soft_wrap=True)
    effects = ", ".join(words(name) for name in nominal.equations) or "no effects"
    console.print(f"{file} by {machine}, with {effects}:")
    for what, error, unit in (
        ("one-step error", found.one_step_rms_V, "V"), ("free-running error", found.free_run_rms_A, "A"),
    ):  # fmt: skip
        console.print(f"  {what}: {_both(error, unit)}")
    for remark in summary.remarks():
        console.print(f"  {remark}")
    if out is not None:
        console.print(f"  {out}: {len(found.t)} samples")


def _both(error: ErrorChange, unit: str) -> str:
    return f"{quantity(error.before, unit)} rms by the machine alone, {quantity(error.after, unit)} with its effects"
