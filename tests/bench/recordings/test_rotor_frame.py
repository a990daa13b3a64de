"""Phase and alpha-beta quantities come out as the dq ones they were made of, by the row's convention."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from numpy.typing import NDArray

from bench.errors import RecordingError
from bench.recordings.recording import open_recording
from tests.support.recordings import read_recording
from tests.support.tables import T_S, plain

pa: Any = pyarrow
pq: Any = pyarrow.parquet

Columns = dict[str, NDArray[np.float64]]

TABLE = plain(500)
THETA, OMEGA = TABLE[:, 6], TABLE[:, 5]
I_DQ, U_DQ = TABLE[:, 3] + 1j * TABLE[:, 4], TABLE[:, 1] + 1j * TABLE[:, 2]
HALF = 0.5 * np.diff(THETA, append=2.0 * THETA[-1] - THETA[-2])
I_AB, U_AB = I_DQ * np.exp(1j * THETA), U_DQ * np.exp(1j * (THETA + HALF))  # in the stationary frame
TURN = {"a": 0.0, "b": 2.0 * math.pi / 3.0, "c": -2.0 * math.pi / 3.0}


def of_phases(letter: str, x: NDArray[np.complex128], common: float = 0.0) -> Columns:
    return {f"{letter}_{name}": (x * np.exp(-1j * angle)).real + common for name, angle in TURN.items()}


TIME_AND_ANGLE = {"t": TABLE[:, 0], "theta_e": THETA}
ALPHA_BETA = {"i_alpha": I_AB.real, "i_beta": I_AB.imag, "u_alpha": U_AB.real, "u_beta": U_AB.imag}
WITH_SPEED = TIME_AND_ANGLE | {"omega_e": OMEGA}


def write(folder: Path, columns: Columns) -> Path:
    pq.write_table(pa.table(columns), folder / "a.parquet")
    return folder / "a.parquet"


def expect_dq(path: Path, **options: Any) -> tuple[str, ...]:
    recording = read_recording(path, **options)
    (run,) = recording.runs
    np.testing.assert_allclose(run.i_d + 1j * run.i_q, I_DQ, atol=1e-9)
    np.testing.assert_allclose(run.u_d + 1j * run.u_q, U_DQ, atol=1e-3)  # the last middle is by the row before
    np.testing.assert_allclose(run.omega_e, OMEGA, atol=0.6)  # the angle's decimals
    return recording.summary.remarks()


@pytest.mark.parametrize("columns", [
    TIME_AND_ANGLE | ALPHA_BETA, WITH_SPEED | ALPHA_BETA,
    WITH_SPEED | of_phases("i", I_AB) | of_phases("u", U_AB, 24.0),
    TIME_AND_ANGLE | ALPHA_BETA | {"theta_e": THETA % (2.0 * math.pi)},
    {name: x for name, x in (WITH_SPEED | of_phases("i", I_AB) | of_phases("u", U_AB)).items() if name != "i_c"},
    {name: x for name, x in (WITH_SPEED | of_phases("i", I_AB) | of_phases("u", U_AB)).items() if name != "i_a"},
    WITH_SPEED | {"i_d": I_DQ.real, "i_q": I_DQ.imag} | of_phases("u", U_AB),
])  # fmt: skip
def test_stationary_quantities_come_out_as_dq(tmp_path: Path, columns: Columns):
    remarks = expect_dq(write(tmp_path, columns))
    assert any(remark.startswith("u_d and u_q are made of u_") for remark in remarks)
    assert ("omega_e is the derivative of theta_e" in remarks) == ("omega_e" not in columns)


def test_units_and_other_names_are_read_before_they_are_turned(tmp_path: Path):
    currents = {f"I{name[-1]} (mA)": 1e3 * x for name, x in of_phases("i", I_AB).items()}
    columns = WITH_SPEED | currents | of_phases("u", U_AB)
    del columns["theta_e"]
    path = write(tmp_path, columns | {"angle": np.degrees(THETA)})
    expect_dq(path, mapping={"i_a": "Ia (mA)", "i_b": "Ib", "i_c": "Ic (mA)", "theta_e": "angle[deg]"})


def test_phase_currents_that_are_turned_are_handed_on_as_well(tmp_path: Path):
    path = write(tmp_path, WITH_SPEED | of_phases("i", I_AB) | of_phases("u", U_AB) | {"u_dc": np.full(500, math.nan)})
    (run,) = read_recording(path, u_dc=48.0).runs
    assert run.i_b is not None and run.u_dc is not None
    assert (run.i_b[7], run.u_dc[0]) == (pytest.approx(of_phases("i", I_AB)["i_b"][7]), 48.0)
    with open_recording(path, optional=False) as reader:
        assert {chunk.samples.i_b is None for chunk in reader} == {True}


def test_the_rotor_does_not_turn_across_a_gap(tmp_path: Path):
    columns = {name: np.delete(x, [200, 201]) for name, x in (TIME_AND_ANGLE | ALPHA_BETA).items()}
    first, second = read_recording(write(tmp_path, columns)).runs
    np.testing.assert_allclose(first.u_q, U_DQ.imag[:200], atol=1e-3)
    np.testing.assert_allclose(second.u_q, U_DQ.imag[202:], atol=1e-3)
    np.testing.assert_allclose(np.r_[first.omega_e, second.omega_e], np.delete(OMEGA, [200, 201]), atol=0.6)


@pytest.mark.parametrize("chunk_rows", [1, 2, 3, 70])
def test_the_samples_do_not_depend_on_how_the_file_is_divided(tmp_path: Path, chunk_rows: int):
    columns = {name: np.delete(x, [40, 41, 99]) for name, x in (TIME_AND_ANGLE | ALPHA_BETA).items()}
    columns["theta_e"][300] = math.nan
    path = write(tmp_path, columns)
    whole = read_recording(path)
    with open_recording(path, chunk_rows=chunk_rows) as reader:
        samples = [chunk.samples for chunk in reader]
        assert reader.summary == whole.summary
    for name in ("u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e"):
        parts, runs = ([getattr(one, name) for one in several] for several in (samples, whole.runs))
        assert np.array_equal(np.concatenate(parts), np.concatenate(runs))


def test_a_rotor_at_standstill_may_have_its_angle_as_a_constant(tmp_path: Path):
    t = T_S * np.arange(50, dtype=np.float64)
    x = 100.0 * t
    path = write(tmp_path, {"t": t, "i_alpha": x, "i_beta": 2 * x, "u_alpha": -x, "u_beta": 0 * x})
    (run,) = read_recording(path, constants={"theta_e": math.pi / 2, "omega_e": 0.0}).runs
    np.testing.assert_allclose([run.i_d, run.i_q, run.u_d, run.u_q], [2 * x, -x, 0 * x, x], atol=1e-12)
    assert np.array_equal(run.theta_e, np.full(50, math.pi / 2))


def test_what_is_missing_is_asked_for_alone(tmp_path: Path):
    path = write(tmp_path, WITH_SPEED | of_phases("i", I_AB))
    with pytest.raises(RecordingError, match=r"missing columns: u_d, u_q; present: .* or u_alpha and u_beta, or u_a"):
        read_recording(path)
    path = write(tmp_path, {"t": TABLE[:, 0]} | ALPHA_BETA)
    with pytest.raises(RecordingError, match=r"missing columns: u_d, u_q, i_d, i_q, omega_e; .* theta_e is needed"):
        read_recording(path)


def test_quantities_of_the_rotors_frame_go_before_others(tmp_path: Path):
    columns = WITH_SPEED | {"i_d": I_DQ.real, "i_q": I_DQ.imag, "u_d": U_DQ.real, "u_q": U_DQ.imag}
    assert expect_dq(write(tmp_path, columns | of_phases("i", 3.0 * I_AB) | of_phases("u", 3.0 * U_AB))) == ()
