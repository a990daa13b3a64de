"""Columns in other units, and factors: by a mapping, by the columns' own names; what is told of them."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.errors import ConfigError, RecordingError
from bench.recordings.forms.units import scale_of
from tests.support.recordings import read_recording
from tests.support.tables import NAMES, expect, plain

TABLE = plain(400)


def write(path: Path, **columns: tuple[str, float]) -> Path:
    """The table with some columns called otherwise, and divided by a factor."""
    others = [columns.get(name, (name, 1.0)) for name in NAMES]
    made = {name: TABLE[:, k] / factor for k, (name, factor) in enumerate(others)}
    lines = [",".join(made), *(",".join(map(repr, row)) for row in np.column_stack(list(made.values())).tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.csv"


RPM = math.pi / 30.0


@pytest.mark.parametrize(("quantity", "unit", "n_p", "factor"), [
    ("t", "ms", None, 1e-3), ("t", "\u00b5s", None, 1e-6), ("t", "\u03bcs", None, 1e-6), ("t", "ns", None, 1e-9),
    ("u_d", "mV", None, 1e-3), ("u_dc", "kV", None, 1e3), ("i_q_mean", "mA", None, 1e-3), ("i_a", "kA", None, 1e3),
    ("theta_e", "deg", None, math.pi / 180), ("theta_e", "turn", None, 2 * math.pi), ("theta_e", "rad", None, 1.0),
    ("theta_e", "mechanical deg", 4, 4 * math.pi / 180), ("theta_e", "rad (mech.)", 4, 4.0),
    ("omega_e", "rpm", 4, 4 * RPM), ("omega_e", "1/min", 4, 4 * RPM), ("omega_e", "RPM", 4, 4 * RPM),
    ("omega_e", "erpm", None, RPM), ("omega_e", "eRPM", None, RPM), ("omega_e", "electrical rpm", None, RPM),
    ("omega_e", "Hz", None, 2 * math.pi), ("omega_e", "rps", 4, 8 * math.pi),
    ("omega_e", "mechanical Hz", 4, 8 * math.pi),
    ("omega_e", "mechanical rad/s", 4, 4.0), ("omega_e", "deg/s", None, math.pi / 180),
    ("speed_rpm", "rpm", None, 1.0), ("speed_rpm", "erpm", 4, 0.25), ("speed_rpm", "mechanical rad/s", None, 1 / RPM),
])  # fmt: skip
def test_units_are_si_by_their_factor(quantity: str, unit: str, n_p: int | None, factor: float):
    scale = scale_of(quantity, unit, n_p)
    assert scale is not None
    assert (scale.factor, scale.offset) == (pytest.approx(factor, rel=1e-12), 0.0)


@pytest.mark.parametrize(("quantity", "unit"), [
    ("t", "V"), ("t", "mechanical s"), ("i_d", "LSB"), ("u_d", "MV"), ("omega_e", "electrical mechanical rpm"),
    ("theta_e", "rpm"), ("periods", "s"), ("temp_winding", "K"),
])  # fmt: skip
def test_what_is_no_unit_of_a_quantity_has_no_factor(quantity: str, unit: str):
    assert scale_of(quantity, unit, 4) is None


def test_revolutions_of_the_shaft_need_the_pole_pairs_and_say_so(path: Path):
    write(path, omega_e=("n", 4 * RPM))
    with pytest.raises(ConfigError, match=r"omega_e in rpm is mechanical, expected the pole pairs: n_p in --nominal"):
        read_recording(path, mapping={"omega_e": "n[rpm]"})
    several: list[dict[str, Any]] = [{"n_p": 4}, {"constants": {"n_p": 4}}, {"n_p": 3, "constants": {"n_p": 4}}]
    for options in several:
        expect(path, TABLE, "omega_e is column 'n', in rpm: times 0.418879", mapping={"omega_e": "n[rpm]"}, **options)
    with pytest.raises(ConfigError, match=r"constant n_p = 2.5: expected a whole number of pole pairs"):
        read_recording(path, mapping={"omega_e": "n[rpm]"}, constants={"n_p": 2.5})


@pytest.mark.parametrize("said", [
    "Time*1e-3", "Time / 1000", "1e-3*Time", "Time[ms]", "Time [ms]", "Time*1e-3 + 2", "Time-5*1e-3",
])  # fmt: skip
def test_a_factor_an_offset_or_a_unit_may_follow_a_column(path: Path, said: str):
    expect(write(path, t=("Time", 1e-3)), TABLE, "t is column 'Time'", mapping={"t": said})


def test_operations_are_done_from_left_to_right(path: Path):
    recording = read_recording(write(path), mapping={"i_d": "i_d*2+1*3", "theta_e": "theta_e[deg]-0.5"})
    np.testing.assert_allclose(recording.runs[0].i_d, (TABLE[:, 3] * 2 + 1) * 3)
    np.testing.assert_allclose(recording.runs[0].theta_e, np.radians(TABLE[:, 6]) - 0.5)


@pytest.mark.parametrize("name", ["I-1", "I*2", "a[x]", "Iq/2", "i q (raw)", "i_q [LSB]", "2*I", "i[deg]"])
def test_a_column_called_like_an_operation_is_named_as_it_stands(path: Path, name: str):
    expect(write(path, i_q=(name, 1.0)), TABLE, mapping={"i_q": name})
    assert read_recording(path, mapping={"i_q": name}).summary.sources["i_q"] == f"column {name}"
    expect(write(path, i_q=(name, 10.0)), TABLE, f"i_q is column {name!r}, times 10", mapping={"i_q": f"{name}*10"})


@pytest.mark.parametrize(("column", "factor", "said"), [
    (("t", "t [ms]"), 1e-3, {}), (("t", "Time (ms)"), 1e-3, {}), (("t", "time / us"), 1e-6, {}),
    (("t", "t in ms"), 1e-3, {}),
    (("t", "Clock (ms)"), 1e-3, {"t": "Clock (ms)"}), (("t", "Clock (ms)"), 1e-3, {"t": "Clock"}),
    (("theta_e", "theta_e[deg]"), math.pi / 180, {}),
    (("theta_e", "angle[deg]"), math.pi / 180, {"theta_e": "angle[deg]"}),
    (("i_q", "i_q [mA]"), 1e-3, {}), (("i_q", "i_q (A)"), 1.0, {}), (("omega_e", "omega_e [Hz]"), 2 * math.pi, {}),
    (("i_q", "i_q [A]"), 1e-3, {"i_q": "i_q [A][mA]"}), (("i_q", "i_q [A]"), 1e-3, {"i_q": "i_q[mA]"}),
])  # fmt: skip
def test_a_unit_in_a_columns_own_name_is_read(
    path: Path, column: tuple[str, str], factor: float, said: dict[str, str]
):
    quantity, name = column
    expect(write(path, **{quantity: (name, factor)}), TABLE, mapping=said)
    remarks = read_recording(path, mapping=said).summary.remarks()
    told = [f"{quantity} is column {name!r}, in " in remark for remark in remarks]
    assert told == ([True] if factor != 1.0 else [])


def test_two_columns_for_a_quantity_are_asked_about(path: Path):
    lines = write(path, t=("t [s]", 1.0)).read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([f"{lines[0]},t [ms]", *(f"{line},0" for line in lines[1:])]), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"expected one column for t, came 't \[s\]' and 't \[ms\]'; choose"):
        read_recording(path)
    expect(path, TABLE, mapping={"t": "t [s]"})


@pytest.mark.parametrize(("said", "sentence"), [
    ("Tim*1e-3", "no column 'Tim*1e-3' for t; present: Time, u_d"),
    ("Time*x", "no column 'Time*x' for t; present: Time, u_d"),
    ("Time[V]", "--map: t in 'V': expected one of s, sec, ms, us, ns, min, h"),
    ("Time/0", "--map t: cannot divide by zero"),
])  # fmt: skip
def test_what_a_mapping_cannot_say_is_a_sentence(path: Path, said: str, sentence: str):
    with pytest.raises((RecordingError, ConfigError)) as caught:
        read_recording(write(path, t=("Time", 1e-3)), mapping={"t": said})
    assert sentence in str(caught.value)
