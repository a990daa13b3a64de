"""Witnesses: how they are written, what they do to estimates and diagnoses, and what contradicts the recording."""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.diagnoses.diagnose import diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.errors import ConfigError
from bench.live.window import Window
from bench.machine_file import Nominal, load_machine
from bench.recordings.capture_file import write_columns
from bench.recordings.recording import open_recording
from bench.recordings.replay import Replay, replay
from bench.witness import witnesses_of
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, PAPER_RUN, Excitation
from estimator.diagnosis.answer.witnessed import contradicting, tolerances
from estimator.diagnosis.verdict import Quantity
from estimator.interval import Z_95
from estimator.online.estimate import Status
from estimator.witness import Witness, updated
from tests.support.real_data import REAL_DATA

WIDE = Witness(0.12, 0.0012)


@pytest.mark.parametrize(("text", "value", "half"), [
    ("psi_f=2.478e-3+-1%", 2.478e-3, 2.478e-5), ("psi_f=2.478mVs+-0.02", 2.478e-3, 2e-5),
    ("R_s=70mohm +- 2mohm", 0.07, 2e-3), ("L_q = 6e-3 ± 2e-4", 6e-3, 2e-4), ("L_d=45uH+-0.5e-6H", 45e-6, 5e-7),
])  # fmt: skip
def test_a_witness_has_a_value_and_half_of_an_interval(text: str, value: float, half: float) -> None:
    (one,) = witnesses_of([text]).values()
    assert one.value == pytest.approx(value)
    assert one.std == pytest.approx(half / Z_95)


@pytest.mark.parametrize(("text", "why"), [
    ("J=1e-3+-1%", "--witness: no parameter 'J', expected one of R_s, L_d, L_q, psi_f"),
    ("psi_f=0.12", "--witness: psi_f: expected a value and its error, such as"),
    ("psi_f=0.12+-0%", "--witness: psi_f: expected an error above zero, got 0%"),
    ("psi_f=0.12+--1e-3", "--witness: psi_f: expected an error above zero, got -1e-3"),
    ("psi_f=0.12A+-1%", "--witness: psi_f in 'A': expected one of Vs, mVs"),
    ("R_s=-1+-1%", "--witness: R_s: expected 0.0001 to"), ("R_s=1+-1%,R_s=2+-1%", "--witness: R_s is given twice"),
    ("", "--witness: expected a value and its error, such as psi_f=2.478e-3+-1% or R_s=70mohm+-2mohm, got ''"),
    (" ,", "--witness: expected a value and its error, such as"),
])  # fmt: skip
def test_an_impossible_witness_gets_a_sentence(text: str, why: str) -> None:
    with pytest.raises(ConfigError, match="^" + re.escape(why)):
        witnesses_of([text])


def test_a_machine_file_may_have_them(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text('[machine]\nn_p = 4\n[witness]\npsi_f = "0.12+-1%"\n', encoding="utf-8")
    assert load_machine(path).witnesses["psi_f"] == pytest.approx((0.12, 0.0012 / Z_95))
    path.write_text("[machine]\nn_p = 4\n[witness]\npsi_f = 0.12\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="expected a text, such as"):
        load_machine(path)


def test_it_is_one_more_row() -> None:
    chance = np.random.default_rng(1)
    A, x = chance.normal(size=(20, 3)), np.array([1.0, 2.0, 3.0])
    y = A @ x + chance.normal(size=20)
    C = np.array(np.linalg.inv(A.T @ A), np.float64)
    H, w = np.array([0.0, 1.0, 0.0]), Witness(2.1, 0.05)
    more = np.linalg.inv(A.T @ A + np.outer(H, H) / w.std**2)
    expected = more @ (A.T @ y + H * w.value / w.std**2)
    found, covariance = updated(C @ A.T @ y, C, [1], [w])
    assert found == pytest.approx(expected)
    assert covariance == pytest.approx(more)


# --- Replay


def replayed(path: Path, witnesses: Mapping[str, Witness], window: Window | None = None) -> Replay:
    with open_recording(path, q_alone=True) as reader:
        return replay(reader, window or Window(length=100_000), witnesses=witnesses)


@pytest.fixture(scope="module")
def q_axis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("q") / "q.parquet"
    columns = VirtualDrive(replace(PAPER_RUN, excitation=Excitation(i_q_step=2.0, step_time=5e-3))).record(20_000)
    write_columns(path, {name: columns[name] for name in ("t", "u_q", "i_q", "theta_e")}, {})
    return path


def test_a_witness_narrows_what_it_is_of_and_what_goes_with_it(q_axis: Path) -> None:
    alone = replayed(q_axis, {}).result.estimates
    found = replayed(q_axis, {"R_s": Witness(0.9664, 0.005)})
    estimates = found.result.estimates
    assert estimates["R_s"].std == pytest.approx(1.0 / math.hypot(1.0 / 0.005, 1.0 / (alone["R_s"].std or 1.0)))
    assert estimates["R_s"].value == pytest.approx(0.9664, abs=0.002)
    assert (estimates["psi_f"].std or 1.0) < 0.99 * (alone["psi_f"].std or 1.0)
    assert any(said.startswith("the witness R_s = 966.4") and "is one more row" in said for said in found.remarks)


def test_a_witness_that_contradicts_is_told_and_not_averaged(q_axis: Path) -> None:
    alone = replayed(q_axis, {}).result.estimates
    found = replayed(q_axis, {"psi_f": Witness(0.132, 1e-3)})
    assert found.result.estimates == alone
    (said,) = (one for one in found.remarks if "contradicts" in one)
    assert "joint standard errors and is not used: the recording alone says 119.9" in said


def test_a_diagnosis_whose_witness_contradicts_says_so_in_its_sentence(q_axis: Path) -> None:
    said = diagnose_recording(Request(q_axis, Nominal({}), witnesses={"psi_f": Witness(0.132, 1e-3)})).diagnosis
    assert re.search(r"\. The witness psi_f = .* contradicts these rows by .* joint standard errors", said.sentence)
    assert sum("contradicts" in one for one in said.remarks) == 1


def test_what_the_recording_does_not_tell_is_the_witnesss(tmp_path: Path) -> None:
    path = tmp_path / "steady.parquet"  # i_d constant: L_d and psi_f are one flux linkage
    held = Excitation(i_d_ref=-2.0, i_q_ref=2.0, i_q_step=2.0)
    columns = VirtualDrive(replace(PAPER, excitation=held)).record(20_000)
    write_columns(path, columns, {})
    alone = replayed(path, {}).result.estimates
    assert alone["L_d"].status is Status.NOT_TOLD
    assert alone["psi_f"].status is Status.NOT_TOLD
    found = replayed(path, {"psi_f": Witness(0.12, 1e-4)})
    L_d = found.result.estimates["L_d"]
    assert L_d.status is Status.OK
    assert L_d.value == pytest.approx(4.24e-3, rel=0.03)
    assert L_d.std == pytest.approx(1e-4 / 2.0, rel=0.3)  # psi_d = psi_f + L_d i_d
    assert any("does not tell psi_f" in said for said in found.remarks)


def test_a_recursion_takes_none(q_axis: Path) -> None:
    with pytest.raises(ConfigError, match="--witness goes with --method wls"):
        replayed(q_axis, {"psi_f": WIDE}, Window(method="rls"))


# --- Diagnoses


def test_a_diagnosis_tells_a_witness_from_what_the_recording_says_without_it() -> None:
    one = Witness(0.12, 0.001)
    prior = tolerances({"psi_f": one})["psi_f"] * one.value
    assert prior == pytest.approx(Z_95 * one.std)

    def together(alone: float, std: float) -> dict[str, Quantity]:
        weights = 1.0 / std**2, 1.0 / prior**2
        value = (alone * weights[0] + one.value * weights[1]) / sum(weights)
        return {"psi_f": Quantity(value, sum(weights) ** -0.5, "Vs")}

    assert not contradicting(together(0.122, 0.001), {"psi_f": one})
    (said,) = contradicting(together(0.125, 0.001), {"psi_f": one}).values()
    assert "contradicts the recording by 3.54 joint standard errors" in said
    assert "the recording alone says 125.0" in said
    assert not contradicting({}, {"psi_f": one})


# --- Points


def table(path: Path) -> Path:
    """u_q by the closed form: 0.5 ohm, 20 mVs; noise of 20 mV."""
    chance = np.random.default_rng(5)
    speeds, currents = [-400.0, -150.0, 60.0, 150.0, 400.0], [-5.0, -3.0, -1.0, 1.0, 3.0, 5.0]
    omega, i_q = (x.ravel() for x in np.meshgrid(speeds, currents))
    u_q = 0.5 * i_q + 0.02 * omega + 0.02 * chance.normal(size=len(omega))
    np.savetxt(path, np.c_[omega, i_q, u_q], delimiter=",", header="omega_e,i_q,u_q", comments="")
    return path


def test_points_take_witnesses_too(tmp_path: Path) -> None:
    path = table(tmp_path / "points.csv")
    alone = diagnose_recording(Request(path, Nominal({}), format="points")).diagnosis
    close = {"R_s": Witness(0.5, 1e-4), "psi_f": Witness(0.03, 1e-4)}
    found = diagnose_recording(Request(path, Nominal({}), format="points", witnesses=close)).diagnosis
    assert (found.machine_after["R_s"].std or 1.0) < 1e-4 < (alone.machine_after["R_s"].std or 0.0)
    assert found.machine_after["psi_f"].value == pytest.approx(alone.machine_after["psi_f"].value, rel=1e-3)
    said = " ".join(found.remarks)
    assert "the witness R_s = 500.00 ± 0.20 mohm is one more row" in said
    assert "the witness psi_f = 30.00 ± 0.20 mVs contradicts these rows" in said


def test_a_calibrations_own_flux_is_a_witness_where_it_is_consistent() -> None:
    files = sorted((REAL_DATA / "moteus_ld").glob("*.json"))
    if not files:
        pytest.skip("no real recordings are here")
    for path in files:
        said = diagnose_recording(Request(path, Nominal({}), format="moteus-ld")).diagnosis.remarks
        assert any("the witness psi_f" in one for one in said), path
