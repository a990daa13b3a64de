"""The machine file: what it says, and the sentence for each thing it cannot say."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import ConfigError
from bench.machine_file import Nominal, load_machine
from estimator.machine import PARAMETERS, UNITS, Machine

Load = Callable[[str | bytes], Nominal]

WHOLE = """
[machine]            # SI, per phase, peak dq
R_s = 0.9664
L_d = 4.24e-3
L_q = 6.21e-3
psi_f = 0.12
n_p = 4
i_rated = 6.0
[drive]
T_s = 1e-4
u_dc = 310.0
encoder_counts = 65536
"""


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def write_and_load(content: str | bytes) -> Nominal:
        path = tmp_path / "machine.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return load_machine(path)

    return write_and_load


def refusal(load: Load, content: str | bytes) -> str:
    with pytest.raises(ConfigError) as caught:
        load(content)
    said = str(caught.value)
    assert "machine.toml" in said
    assert "\n" not in said
    return said


def test_a_whole_file_gives_the_machine_and_the_drive(load: Load):
    nominal = load(WHOLE)
    assert nominal.machine == Machine(0.9664, 4.24e-3, 6.21e-3, 0.12, n_p=4, i_rated=6.0)
    assert (nominal.T_s, nominal.u_dc, nominal.encoder_counts) == (1e-4, 310.0, 65536)
    assert nominal.theta_step == pytest.approx(4 * 2 * math.pi / 65536)
    assert nominal.given == {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}


def test_every_parameter_has_a_unit():
    assert tuple(UNITS) == PARAMETERS


def test_what_the_file_leaves_out_is_unknown_and_the_machine_is_not_whole(load: Load):
    nominal = load("[machine]\nR_s = 0.16\nL_q = 124e-6\n")
    assert nominal.given == {"R_s": 0.16, "L_q": 124e-6}
    assert nominal.machine is None
    assert nominal == Nominal(given={"R_s": 0.16, "L_q": 124e-6})


def test_a_whole_number_is_a_resistance_too(load: Load):
    assert load("[machine]\nR_s = 1\n").given == {"R_s": 1.0}


def test_the_rated_current_may_be_unknown(load: Load):
    machine = load(WHOLE.replace("i_rated = 6.0", "")).machine
    assert machine is not None
    assert machine.i_rated is None


def test_an_unknown_key_names_the_allowed(load: Load):
    said = refusal(load, "[machine]\nRs = 1.0\n")
    assert "Rs is unknown" in said
    assert "R_s, L_d, L_q, psi_f, n_p, i_rated" in said


def test_an_unknown_table_or_a_key_outside_names_the_tables(load: Load):
    for content in ("[motor]\nR_s = 1.0\n", "R_s = 1.0\n", WHOLE + "[inverter]\n"):
        assert "[machine] and [drive]" in refusal(load, content)


def test_effects_have_the_names_that_a_diagnosis_gives_them(load: Load):
    known = load(WHOLE + "[effects.iron_loss]\nconductance = 1e-3\n[effects.convention_error]\nu_scale = 1.5\n")
    assert known.effects == {"iron_loss": {"conductance": 1e-3}, "convention_error": {"u_scale": 1.5}}
    said = refusal(load, WHOLE + "[effects.ironloss]\nconductance = 1e-3\n")
    assert "unknown effect 'ironloss', expected one of inverter_voltage_error, d_axis_saturation, " in said


def test_a_file_without_a_machine_says_so(load: Load):
    assert "[machine] is missing" in refusal(load, "")
    assert "expected a table [machine]" in refusal(load, "machine = 3\n")
    assert "expected a table [drive]" in refusal(load, "drive = [1]\n[machine]\n")


@pytest.mark.parametrize("value", ["'0.9664'", "true", "[0.9]", "1979-05-27", "{ohm = 1}"])
def test_a_wrong_type_names_the_key_and_what_came(load: Load, value: str):
    assert "[machine] R_s: expected a number of ohm" in refusal(load, f"[machine]\nR_s = {value}\n")


def test_pole_pairs_are_a_whole_number(load: Load):
    assert "n_p: expected a whole number" in refusal(load, "[machine]\nn_p = 4.0\n")
    assert "n_p: expected a whole number" in refusal(load, "[machine]\nn_p = true\n")


def test_counts_of_an_encoder_are_whole_and_need_the_pole_pairs(load: Load):
    assert "encoder_counts needs [machine] n_p" in refusal(load, "[machine]\n[drive]\nencoder_counts = 4096\n")
    assert "expected a whole number" in refusal(load, "[machine]\nn_p = 4\n[drive]\nencoder_counts = 4096.0\n")
    assert load("[machine]\nn_p = 4\n").theta_step == 0.0


@pytest.mark.parametrize("value", ["0", "0.0", "-1.5", "nan", "inf", "-inf"])
@pytest.mark.parametrize("key", ["R_s", "L_d", "L_q", "psi_f", "i_rated"])
def test_a_value_not_finite_and_above_zero_is_refused(load: Load, key: str, value: str):
    said = refusal(load, f"[machine]\n{key} = {value}\n")
    assert key in said
    assert "above zero" in said


def test_a_control_period_of_zero_is_refused(load: Load):
    assert "[drive] T_s" in refusal(load, "[machine]\n[drive]\nT_s = 0\n")


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [("L_d", "4.24", "H"), ("L_q", "1e-9", "H"), ("R_s", "2e3", "ohm"), ("psi_f", "1e3", "Vs"), ("n_p", "9999", "")],
)
def test_a_value_in_another_unit_is_told_by_its_size(load: Load, key: str, value: str, unit: str):
    said = refusal(load, f"[machine]\n{key} = {value}\n")
    assert f"{key} = {float(value):g} {unit}" in said
    assert said.endswith("SI units, per phase")


def test_a_number_without_end_is_refused(load: Load):
    refusal(load, "[machine]\nn_p = 1" + "0" * 400)
    refusal(load, "[machine]\nn_p = 1" + "0" * 5000)
    said = refusal(load, "[machine]\n[drive]\nangle_ahead = -1" + "0" * 400)
    assert said.endswith("[drive] angle_ahead = -1e+300 rad: expected -3.14159 to 3.14159 rad; SI units, per phase")


def test_a_key_of_several_lines_is_told_in_one(load: Load):
    assert r"[machine]: 'R\ns' is unknown" in refusal(load, '[machine]\n"R\\ns" = 1.0\n')


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        ("iron_loss = 3", "[effects]: expected a table [effects.iron_loss], got 3"),
        ("iron_loss.conductance = inf", "[effects.iron_loss] conductance: expected a finite number, got inf"),
        ("iron_loss.equation = [1, 2]",
         "[effects.iron_loss] equation: expected 3 finite numbers (conductance, omega_h, lag), got [1, 2]"),
        ("convention_error.equation = []", "[effects.convention_error] equation: expected none, got []"),
    ],
)
def test_an_effect_that_cannot_be_is_told_with_what_was_expected(load: Load, effect: str, said: str):
    assert refusal(load, f"[machine]\n[effects]\n{effect}\n").endswith(said)


def test_a_size_beyond_all_measure_is_the_largest(load: Load):
    found = load(f"[machine]\n[effects.iron_loss]\na = 1e305\nb = -1{'0' * 400}\n")
    assert found.effects == {"iron_loss": {"a": 1e300, "b": -1e300}}


def test_a_syntax_error_names_its_line(load: Load):
    assert "line 3" in refusal(load, "[machine]\nR_s = 1.0\nL_d 4e-3\n")
    assert "not TOML" in refusal(load, "[machine]\nR_s = " + "[" * 5000)


def test_a_file_that_is_not_text_says_so(load: Load):
    assert "UTF-8" in refusal(load, b"[machine]\nR_s = \xff\n")


def test_a_file_that_cannot_be_read_says_why(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read: No such file"):
        load_machine(tmp_path / "none.toml")
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load_machine(tmp_path)
    with pytest.raises(ConfigError):
        load_machine("with\0zero")


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(lambda s: ("[machine]\n" + s).encode())))
def test_any_bytes_are_a_machine_or_a_sentence(tmp_path_factory: pytest.TempPathFactory, content: bytes):
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes(content)
    try:
        assert isinstance(load_machine(path), Nominal)
    except ConfigError as error:
        assert "any.toml" in str(error)
