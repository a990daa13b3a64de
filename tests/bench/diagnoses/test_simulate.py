"""What a diagnosis found, as its machine file has it, simulated beside a recording."""

from pathlib import Path

import pyarrow.parquet
import pytest
from typer.testing import CliRunner

from bench.cli.main import app
from bench.diagnoses.diagnosed_machine import machine_text
from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.simulate import simulate
from bench.errors import ConfigError
from bench.machine_file import load_machine
from emulator.conceal.recording import Choice
from estimator.diagnosis.diagnose import diagnose
from estimator.physics.library import LIBRARY
from tests.estimator.diagnosis.concealed_runs import recording_of
from tests.estimator.physics.equations import rows_without_noise, with_effect


@pytest.mark.parametrize("kind", ["angle_offset", "skin"])
def test_the_machine_that_a_diagnosis_writes_simulates_the_recording(kind: str, tmp_path: Path) -> None:
    """As well as the diagnosis says; the file's numbers are those of the model."""
    _, runs, nominal = recording_of(Choice(9, (kind,), (0.5, 1.0), ("servo_4nm",), 2.0), 1, tmp_path)
    diagnosis = diagnose(runs, nominal)
    assert len(diagnosis.findings) == 1
    assert diagnosis.fit is not None
    found = tmp_path / "found.toml"
    found.write_text(machine_text(diagnosis, load_machine(tmp_path / "0001.toml"), "0001.parquet"), encoding="utf-8")
    machine = load_machine(found)
    (finding,) = diagnosis.findings
    assert machine.equations[finding.effect] == pytest.approx(finding.equation, rel=1e-8)
    assert machine.angle_ahead == pytest.approx(diagnosis.angle, rel=1e-8)
    _, beside = simulate(Request(tmp_path / "0001.parquet", machine))
    assert beside.free_run_rms_A.after < 0.1 * beside.free_run_rms_A.before
    assert beside.free_run_rms_A.after == pytest.approx(diagnosis.fit.free_run_rms_A.after, rel=0.1)
    out = tmp_path / "out.parquet"
    words = ["simulate", str(tmp_path / "0001.parquet"), "--machine", str(found), "--out", str(out)]
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.output
    assert "with its effects" in said.output
    assert pyarrow.parquet.read_table(out).num_rows == len(beside.t)


@pytest.mark.parametrize(("line", "said"), [
    ("dead_time = 2e-6", "expected a line `equation`"), ("equation = [1.0]", "expected 4 finite numbers (dead_time,"),
    ("equation = 1.0", "expected 4 finite numbers"), ('equation = [1, 2, 3, "x"]', "expected 4 finite numbers"),
])  # fmt: skip
def test_effects_that_cannot_be_simulated_are_said(line: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_text(
        "[machine]\nR_s = 1.0\nL_d = 1e-3\nL_q = 1e-3\npsi_f = 0.1\nn_p = 4\n"
        f"[effects.inverter_voltage_error]\n{line}\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match=r"m\.toml") as caught:
        simulate(Request(tmp_path / "none.parquet", load_machine(file)))
    assert said in str(caught.value)


def test_the_benchs_manual_names_every_effect_and_its_parameters() -> None:
    """As JSON and machine files have them."""
    manual = (Path(__file__).parents[3] / "bench" / "README.md").read_text(encoding="utf-8")
    table = manual.split("### Effects and their")[1].split("Equation, source, range")[0]
    rows = rows_without_noise(with_effect("none", "servo_4nm"))
    for effect in LIBRARY:
        assert f"`{effect.name}`" in table, effect.name
        sizes = [parameter.typical(rows) for parameter in effect.parameters]
        told = effect.told(rows, sizes) if effect.told else [parameter.name for parameter in effect.parameters]
        assert all(f"`{name}`" in table for name in told), effect.name
