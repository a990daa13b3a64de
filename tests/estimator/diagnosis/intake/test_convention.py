"""Conventions: a recording that follows another one is told from one that lacks physics, and brought in order."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from emulator.conceal.populations import STRANGERS
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.convention import AS_GOOD, Suspicion, suspected
from estimator.diagnosis.intake.speed_factor import speed_factor
from estimator.diagnosis.verdict import Verdict
from estimator.diagnosis.words import sentence_start
from estimator.machine import PARAMETERS, Machine
from estimator.physics.convention_error import UNIT
from tests.estimator.diagnosis.convention_runs import (
    TURN,
    Error,
    angle,
    axes_swapped,
    by_speed,
    in_per_unit,
    made,
    period,
    phases_swapped,
    poles_for_pole_pairs,
    recording,
    scaled,
    shifted,
    speed,
    with_vectors,
)

pytestmark = pytest.mark.thorough

TOLERANCE = dict.fromkeys(PARAMETERS, 0.1)
NUMBERS = (1, 2, 3, 5, 8)

_3, _2 = math.sqrt(3.0), math.sqrt(2.0)

FOUND: dict[str, tuple[Error, str, dict[str, float]]] = {
    "line-to-line voltages": (scaled(u=_3), "voltage_line_to_line", {"u_scale": _3}),
    "line-to-line voltages with their angle": (
        scaled(u=_3 * complex(math.cos(TURN / 12.0), math.sin(TURN / 12.0))), "voltage_line_to_line_ahead",
        {"u_scale": _3, "u_angle": TURN / 12.0},
    ),
    "rms voltages": (scaled(u=1.0 / _2), "voltage_rms", {"u_scale": 1.0 / _2}),
    "voltages twice": (scaled(u=2.0), "voltage_twice", {"u_scale": 2.0}),
    "voltages by half": (scaled(u=0.5), "voltage_half", {"u_scale": 0.5}),
    "voltages times 3/2": (scaled(u=1.5), "voltage_three_halves", {"u_scale": 1.5}),
    "line-to-line rms voltages and rms currents": (
        scaled(_3 / _2, 1.0 / _2), "line_to_line_rms", {"u_scale": _3 / _2, "i_scale": 1.0 / _2},
    ),
    "voltages of the wrong sign": (scaled(u=-1.0), "voltage_sign", {"u_scale": -1.0}),
    "currents of the wrong sign": (scaled(i=-1.0), "current_sign", {"i_scale": -1.0}),
    "a d axis the other way round": (scaled(-1.0, -1.0), "axis_opposite", {"u_scale": -1.0, "i_scale": -1.0}),
    "voltages in per unit": (in_per_unit(1.0), "voltage_per_unit_u_dc", {"u_base": 1.0}),
    "voltages in per unit of half the dc link": (in_per_unit(0.5), "voltage_per_unit_half_u_dc", {"u_base": 0.5}),
    "d and q swapped": (axes_swapped, "axes_swapped", {"u_scale": 1.0}),
    "phases b and c of the currents swapped": (phases_swapped(1, 2), "current_phases_bc", {"i_mirrored": 2.0}),
    "phases a and b of the currents swapped": (phases_swapped(0, 1), "current_phases_ab", {"i_mirrored": 2.0}),
    "an angle of the wrong sign": (angle(lambda theta, _: -theta), "angle_sign", {"theta_scale": -1.0}),
    "a mechanical angle": (angle(lambda theta, m: np.mod(theta / m.n_p, TURN)), "mechanical_angle", {}),
    "an angle times the pole pairs twice": (
        angle(lambda theta, m: np.mod(theta * m.n_p, TURN)), "angle_times_pole_pairs_twice", {},
    ),
    "an angle in degrees": (angle(lambda theta, _: np.degrees(np.mod(theta, TURN))), "angle_in_degrees", {}),
    "a period twice as long": (period(2.0), "period_doubled", {"T_s_scale": 2.0}),
    "a period half as long": (period(0.5), "period_halved", {"T_s_scale": 0.5}),
    "voltages two rows late": (shifted(("u_d", "u_q"), 2), "voltage_2_rows_late", {"u_shift": 2.0}),
    "an angle one row early": (shifted(("theta_e",), -1), "angle_1_row_early", {"theta_shift": -1.0}),
    "a mechanical speed": (speed(lambda m: 1.0 / m.n_p), "speed_unit", {}),
    "a speed in Hz": (speed(lambda _: 1.0 / TURN), "speed_unit", {"omega_scale": 1.0 / TURN}),
}  # fmt: skip


def found(error: Error, number: int) -> Suspicion:
    suspicion = suspected(*made(error, recording("none", number)), TOLERANCE)
    assert suspicion is not None, number
    return suspicion


@pytest.mark.parametrize("name", FOUND)
def test_what_users_do_to_a_recording_is_named_and_undone(name: str) -> None:
    error, cause, parameters = FOUND[name]
    for number in NUMBERS:
        suspicion = found(error, number)
        likely = {suspicion.cause} | {rival.effect for rival in suspicion.rivals if rival.odds < AS_GOOD}
        assert cause in likely, number
        if len(likely) > 1:  # and then it says so
            assert suspicion.ambiguous
            continue
        for key, value in parameters.items():
            told = suspicion.parameters.get(key)
            assert (1.0 if told is None else told.value) == pytest.approx(value), key
        assert all(quantity.unit == UNIT[key] for key, quantity in suspicion.parameters.items())
        assert suspicion.sentence.startswith(sentence_start(suspicion.says))
        assert suspicion.sentence.endswith(".")
        honest, nominal = recording("none", number)
        for run, true in zip(suspicion.runs, honest, strict=True):
            first = round((run.t0 - true.t0) / true.T_s)
            assert len(true) - len(run) <= 4
            rows = slice(first, first + len(run))
            assert run.T_s == pytest.approx(true.T_s)
            for column in ("i_d", "i_q", "u_d", "u_q", "omega_e"):
                scale = float(np.max(np.abs(getattr(true, column))))
                np.testing.assert_allclose(getattr(run, column), getattr(true, column)[rows], atol=1e-6 * scale)
            turned = np.unwrap(true.theta_e)[rows]
            np.testing.assert_allclose(np.unwrap(run.theta_e) - run.theta_e[0], turned - turned[0], atol=1e-6)
        assert suspicion.machine == nominal
        assert suspected(suspicion.runs, suspicion.machine, TOLERANCE) is None


@pytest.mark.parametrize("name", ["voltages twice", "a period twice as long", "a period half as long"])
def test_a_factor_that_leaves_a_parameter_off_does_not_do_as_well_as_one_that_leaves_none(name: str) -> None:
    """Twice the voltages are twice all four parameters, twice the period is not R_s."""
    for number in NUMBERS:
        assert not found(FOUND[name][0], number).ambiguous, number


_TERMINAL: dict[str, float] = {"R_s": 2.0, "L_d": 2.0, "L_q": 2.0}
_PER_PHASE = "are they from terminal to terminal? Per phase is half"
_LINE = "psi_f of the machine file is sqrt(3) times the recording's: is it a line-to-line constant? Per phase is 1/sqrt"
SHEETS: dict[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "terminal_values": (_TERMINAL, ("R_s, L_d and L_q of the machine file are twice the recording's", _PER_PHASE)),
    "terminal_values_flux_line_to_line": (_TERMINAL | {"psi_f": _3}, (_PER_PHASE, _LINE)),
    "flux_line_to_line": ({"psi_f": _3}, (_LINE,)),
    "flux_over_sqrt_3": ({"psi_f": 1.0 / _3}, ("1/sqrt(3) of the recording's: was it divided by sqrt(3) twice?",)),
    "flux_rms": ({"psi_f": 1.0 / _2}, ("1/sqrt(2) of the recording's: is it an rms constant?",)),
    "terminal_resistance": ({"R_s": 2.0}, ("R_s of the machine file is twice the recording's: is it from terminal",)),
    "joined_terminals": (dict.fromkeys(_TERMINAL, 1.5), ("3/2 times", "from one terminal to the two others, joined?")),
    "halved_values": (dict.fromkeys(_TERMINAL, 0.5), ("half the recording's: were they halved",)),
    "delta": (dict.fromkeys(_TERMINAL, 3.0), ("3 times the recording's: are they of one winding of a delta?",)),
}  # fmt: skip


def as_sheet(nominal: Machine, times: Mapping[str, float]) -> Machine:
    return replace(nominal, **{name: factor * getattr(nominal, name) for name, factor in times.items()})


@pytest.mark.parametrize("name", SHEETS)
def test_a_machine_file_of_another_convention_is_asked_about_and_put_right(name: str) -> None:
    times, says = SHEETS[name]
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        suspicion = suspected(runs, as_sheet(nominal, times), TOLERANCE)
        assert suspicion is not None, number
        assert all(part in " ".join(suspicion.ambiguous) for part in says), number
        if suspicion.cause == f"nominal_{name}":
            for parameter in PARAMETERS:
                assert getattr(suspicion.machine, parameter) == pytest.approx(getattr(nominal, parameter))
        else:  # another one is as near, by what a motor differs from its data sheet
            assert suspicion.cause.startswith("nominal_")
        assert suspicion.ambiguous[0] == suspicion.says
        assert suspicion.ambiguous[-1] == "the machine is another one"  # a recording alone does not tell
        assert all(np.array_equal(a.i_q, b.i_q) and np.array_equal(a.u_q, b.u_q)
                   for a, b in zip(suspicion.runs, runs, strict=True))  # fmt: skip


def test_a_flux_per_mechanical_angle_is_told_with_the_pole_pairs() -> None:
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        for factor, cause in ((nominal.n_p, "per_mechanical_angle"), (1.0 / nominal.n_p, "over_pole_pairs_twice"),
                              (1.5 * nominal.n_p, "torque_constant")):  # fmt: skip
            suspicion = suspected(runs, as_sheet(nominal, {"psi_f": factor}), TOLERANCE)
            assert suspicion is not None, number
            assert f"nominal_flux_{cause}" in {suspicion.cause, *(rival.effect for rival in suspicion.rivals)}
            assert suspicion.machine.psi_f == pytest.approx(nominal.psi_f, rel=0.25)


def test_currents_by_two_are_asked_about_beside_a_machine_file_that_does_the_same() -> None:
    for number in NUMBERS:
        suspicion = found(scaled(i=2.0), number)
        assert suspicion.cause == "nominal_terminal_values", number
        assert any(says.startswith("the currents are twice what they are") for says in suspicion.ambiguous[1:])


def test_beside_a_machine_file_no_factor_of_the_recording_is_to_blame() -> None:
    """A dead time raises R_s, and hides whether the file's impedances are twice those of a phase."""
    runs, nominal = recording("dead_time", 1, seed=31)
    suspicion = suspected(runs, as_sheet(nominal, _TERMINAL | {"psi_f": _3}), TOLERANCE)
    assert suspicion is not None
    assert suspicion.cause == "nominal_terminal_values_flux_line_to_line"
    assert suspected(runs, as_sheet(nominal, _TERMINAL), TOLERANCE) is None


def test_the_verdict_asks_about_the_machine_file_first() -> None:
    runs, nominal = recording("none", 3, length=1.0)
    said = diagnose(runs, as_sheet(nominal, _TERMINAL))
    assert said.verdict is Verdict.AMBIGUOUS
    assert not said.findings
    (doubt,) = said.ambiguous
    assert doubt.effects == ("convention_error",)
    assert doubt.reason.startswith("R_s, L_d and L_q of the machine file are twice the recording's: " + _PER_PHASE)
    assert "; it would look the same if the currents are twice what they are" in doubt.reason
    assert "measure R_s between two terminals: a phase's is half" in doubt.experiment.sentence
    said = diagnose(runs, as_sheet(nominal, {"psi_f": _3}))
    assert said.verdict is Verdict.AMBIGUOUS
    assert said.ambiguous[0].reason.startswith(_LINE)
    assert "the voltage of the motor turned without load" in said.ambiguous[0].experiment.sentence


def test_the_verdict_tells_voltages_by_two() -> None:
    said = diagnose(*made(scaled(u=2.0), recording("none", 3, length=1.0)))
    assert said.verdict is Verdict.EXPLAINED
    assert "the voltages are twice what they are" in said.sentence
    assert said.findings[0].parameters["u_scale"].value == pytest.approx(2.0)


@pytest.mark.slow
def test_a_machine_file_is_asked_about_where_missing_physics_hides_it_at_first() -> None:
    runs, nominal = recording("dead_time", 1, seed=31)
    said = diagnose(runs, as_sheet(nominal, _TERMINAL))
    assert said.verdict is Verdict.AMBIGUOUS
    assert [finding.effect for finding in said.findings] == ["inverter_voltage_error"]
    (doubt,) = said.ambiguous
    assert doubt.effects[0] == "convention_error"
    assert doubt.reason.startswith("R_s, L_d and L_q of the machine file are twice the recording's: " + _PER_PHASE)


@pytest.mark.slow
def test_a_factor_that_leaves_a_parameter_off_is_no_fact() -> None:
    """Line-to-line voltages of a motor whose leads are left out of its R_s."""
    runs, nominal = made(scaled(u=_3), recording("none", 3))
    said = diagnose(runs, replace(nominal, R_s=0.6 * nominal.R_s))
    assert said.verdict is Verdict.AMBIGUOUS
    assert not said.findings
    (doubt,) = said.ambiguous
    assert doubt.reason.startswith("perhaps the voltages are line-to-line values")
    assert "but even then R_s = " in doubt.reason


def test_a_sentence_that_begins_with_a_symbol_leaves_it_as_it_is() -> None:
    assert found(axes_swapped, 1).sentence.startswith("d and q are swapped in voltages and currents: ")
    assert found(phases_swapped(1, 2), 1).sentence.startswith("Phases b and c of the currents are swapped: ")
    assert sentence_start("u_d has the wrong sign") == "u_d has the wrong sign"


def test_the_verdict_names_the_cause_and_not_only_a_scale() -> None:
    degrees, cause, _ = FOUND["an angle in degrees"]
    said = diagnose(*made(degrees, recording("none", 3, length=1.0)))
    assert [finding.effect for finding in said.findings] == ["convention_error"], cause
    assert ": the angle is in degrees, expected rad" in said.sentence
    assert "theta scale" not in said.sentence


SPEEDS: dict[str, tuple[Callable[[Machine], float], str]] = {
    "rpm": (lambda m: 60.0 / TURN / m.n_p, "speed_mechanical_rpm"),
    "electrical rpm": (lambda _: 60.0 / TURN, "speed_electrical_rpm"),
    "Hz": (lambda _: 1.0 / TURN, "speed_electrical_turns/s"),
    "degrees/s": (lambda _: 360.0 / TURN, "speed_electrical_degrees/s"),
    "mechanical rad/s": (lambda m: 1.0 / m.n_p, "speed_mechanical_rad/s"),
}


@pytest.mark.parametrize("unit", SPEEDS)
def test_the_unit_of_a_speed_that_the_angle_is_the_integral_of_is_told_by_the_voltages(unit: str) -> None:
    of, cause = SPEEDS[unit]
    for number in NUMBERS:
        runs, nominal = made(by_speed(of), recording("none", number))
        runs = tuple(replace(run, i_a=None, i_b=None, i_c=None) for run in runs)
        suspicion = suspected(runs, nominal, TOLERANCE)
        assert suspicion is not None, number
        _, turn, in_unit = cause.split("_")
        assert suspicion.cause == cause.replace("/", "_per_")
        assert suspicion.says.startswith(f"omega_e is the {turn} speed in {in_unit}, expected")
        assert not suspicion.ambiguous
        assert list(suspicion.parameters) == ["omega_scale"]
        assert suspicion.parameters["omega_scale"].value == pytest.approx(of(nominal))
        for run, true in zip(suspicion.runs, made(by_speed(lambda _: 1.0), recording("none", number))[0], strict=True):
            np.testing.assert_allclose(run.omega_e, true.omega_e, rtol=1e-9)
            np.testing.assert_allclose(run.theta_e, true.theta_e, rtol=1e-9, atol=1e-9)
        found = speed_factor(runs, nominal.n_p)
        assert found is not None
        assert found.factor == pytest.approx(of(nominal))
        told = speed_factor(runs, None)
        assert told is not None
        assert told.factor == pytest.approx(of(nominal), rel=0.02)


@pytest.mark.parametrize("kind", ["none", "one", "two", *STRANGERS])
def test_missing_physics_is_not_taken_for_the_unit_of_a_speed_that_the_angle_is_the_integral_of(kind: str) -> None:
    for number in range(1, 7):
        runs, nominal = made(by_speed(lambda _: 1.0), recording(kind, number, seed=31, length=1.0))
        runs = tuple(replace(run, i_a=None, i_b=None, i_c=None) for run in runs)
        suspicion = suspected(runs, nominal, TOLERANCE)
        assert suspicion is None or "omega_scale" not in suspicion.parameters, (kind, number, suspicion.sentence)
        assert speed_factor(runs, None) is None, (kind, number)


def test_poles_given_for_pole_pairs_are_told_with_the_right_number() -> None:
    for number in NUMBERS:
        suspicion = found(poles_for_pole_pairs, number)
        _, nominal = recording("none", number)
        assert suspicion.cause == f"pole_pairs_{nominal.n_p}"
        assert suspicion.machine == nominal
        assert suspicion.parameters["pole_pairs"].value == 2 * nominal.n_p


def test_a_base_of_per_unit_voltages_is_worked_out_where_no_dc_link_was_recorded() -> None:
    for number in NUMBERS:
        suspicion = found(in_per_unit(1.0, u_dc_known=False), number)
        assert suspicion.cause == "voltage_per_unit"
        (run, *_), _ = recording("none", number)
        assert run.u_dc is not None
        assert 1.0 / (suspicion.parameters["u_scale"].value or math.inf) == pytest.approx(np.mean(run.u_dc), rel=0.12)


def test_factors_that_lie_within_the_tolerance_of_each_other_are_both_named() -> None:
    both = 0
    for number in NUMBERS:
        suspicion = found(scaled(i=1.0 / _2), number)
        names = {suspicion.cause, *(rival.effect for rival in suspicion.rivals if rival.odds < AS_GOOD)}
        assert "current_rms" in names
        if "current_two_thirds" in names:
            both += 1
            assert any("scaled by 2/3" in says or "rms" in says for says in suspicion.ambiguous)
    assert both


@pytest.mark.parametrize("kind", ["none", "one", "two", "three", *STRANGERS])
def test_missing_physics_is_not_taken_for_a_convention(kind: str) -> None:
    for number in range(1, 9):
        runs, nominal = recording(kind, number, seed=31, length=1.0)
        suspicion = suspected(runs, nominal, TOLERANCE)
        assert suspicion is None, (kind, number, suspicion.sentence)


@pytest.mark.parametrize("kind", ["dead_time", "iron_loss", "saturation_q"])
@pytest.mark.parametrize(
    "name",
    ["voltages of the wrong sign", "currents of the wrong sign", "voltages in per unit", "d and q swapped",
     "an angle of the wrong sign", "a mechanical angle", "line-to-line voltages with their angle"],
)  # fmt: skip
def test_a_convention_is_undone_beside_missing_physics(kind: str, name: str) -> None:
    """What a dead time and a loss leave open, a delay may take in a little of: no ground to doubt a sign."""
    error, cause, _ = FOUND[name]
    suspicion = suspected(*made(error, recording(kind, 1, seed=33)), TOLERANCE)
    assert suspicion is not None
    assert suspicion.cause == cause
    assert not suspicion.ambiguous


def test_saturation_hides_no_sign() -> None:
    """An inductance that is a fifth too low, by currents that saturate it."""
    error, cause, _ = FOUND["voltages of the wrong sign"]
    suspicion = suspected(*made(error, recording("saturation_q", 1, seed=31)), TOLERANCE)
    assert suspicion is not None
    assert suspicion.cause == cause


def test_beside_missing_physics_factors_that_are_near_each_other_are_not_told_apart() -> None:
    for name in ("rms voltages", "voltages times 3/2", "voltages in per unit of half the dc link"):
        runs, nominal = made(FOUND[name][0], recording("saturation_q", 1, seed=31))
        for known in (nominal, replace(nominal, i_rated=None)):
            suspicion = suspected(runs, known, TOLERANCE)
            assert suspicion is not None, name
            assert len(suspicion.ambiguous) > 1, name


def test_an_angle_that_physics_may_hide_is_not_called_a_wrong_speed() -> None:
    runs, nominal = made(FOUND["an angle of the wrong sign"][0], recording("dead_time", 1, seed=31))
    suspicion = suspected(runs, nominal, TOLERANCE)
    assert suspicion is not None
    assert suspicion.ambiguous[0] == "the speed has the wrong sign"
    assert suspicion.ambiguous[1].startswith("the angle counts the other way")


@pytest.mark.slow
def test_a_machine_far_from_any_is_no_reason_to_fail() -> None:
    said = diagnose(*made(FOUND["an angle of the wrong sign"][0], recording("dead_time", 1, seed=31)))
    assert said.verdict is Verdict.AMBIGUOUS
    assert not said.findings


def test_an_angle_of_too_many_turns_is_not_called_a_mechanical_speed() -> None:
    for number in NUMBERS:
        error, cause, _ = FOUND["an angle times the pole pairs twice"]
        suspicion = suspected(*made(error, recording("dead_time", number, seed=31)), TOLERANCE)
        assert suspicion is not None, number
        assert suspicion.cause == cause or len(suspicion.ambiguous) > 1, number


@pytest.mark.parametrize("late", [1, -1])
def test_a_shift_of_one_row_is_left_to_the_library(late: int) -> None:
    for number in NUMBERS:
        assert suspected(*made(shifted(("u_d", "u_q"), late), recording("none", number)), TOLERANCE) is None


def test_a_recording_too_short_for_a_fit_is_not_judged() -> None:
    runs, nominal = recording("none", 1)
    assert suspected([runs[0][:15]], nominal, TOLERANCE) is None
    assert suspected([], nominal, TOLERANCE) is None


def test_a_scale_is_contradicted_by_a_machine_that_fits_better_as_recorded() -> None:
    suspicion = found(scaled(u=1.5), NUMBERS[0])
    nominal = suspicion.machine
    names = ("R_s", "L_d", "L_q", "psi_f")
    assert not suspicion.contradicted(nominal, TOLERANCE)
    assert not suspicion.contradicted(replace(nominal, R_s=1.5 * nominal.R_s, L_d=0.8 * nominal.L_d), TOLERANCE)
    as_recorded = {name: getattr(nominal, name) / 1.5 for name in names}
    assert suspicion.contradicted(replace(nominal, **as_recorded), TOLERANCE)


@pytest.mark.slow
def test_a_scale_that_leaves_parameters_off_gets_no_name() -> None:
    """A dc link read as three quarters of what it is: as rms values it would leave R_s and L_d 16 % too high."""
    runs, nominal = recording("none", NUMBERS[2])
    true = {name: quantity.value or 0.0 for name, quantity in diagnose(runs, nominal).machine_after.items()}
    told = {name: true[name] / times for name, times in {"R_s": 1.09, "L_d": 1.09, "L_q": 0.93, "psi_f": 0.93}.items()}
    runs, nominal = made(scaled(u=0.75), (runs, replace(nominal, **told)))
    suspicion = suspected(runs, nominal, TOLERANCE)
    assert suspicion is not None
    assert suspicion.cause == "voltage_rms"
    said = diagnose(runs, nominal)
    assert said.verdict is Verdict.AMBIGUOUS
    assert not said.findings
    (doubt,) = said.ambiguous
    assert {"dc_link_gain", "convention_error"} <= {*doubt.effects}
    assert "the voltages are rms values" in doubt.reason


def test_a_motor_that_stands_without_voltage_or_current_is_not_judged() -> None:
    (run, *_), nominal = recording("none", 1)
    nothing = np.zeros(len(run), complex)
    still = replace(run, theta_e=np.zeros(len(run)), omega_e=np.zeros(len(run)))
    assert suspected([with_vectors(still, i=nothing, u=nothing)], nominal, TOLERANCE) is None
    assert suspected([with_vectors(still, i=nothing)], nominal, TOLERANCE) is None


@pytest.mark.slow
def test_what_is_left_beside_no_such_machine_is_not_called_physics() -> None:
    runs, nominal = recording("angle_offset", 1, length=1.0)
    turned = [with_vectors(run, i=1j * (run.i_d + 1j * run.i_q), u=1j * (run.u_d + 1j * run.u_q)) for run in runs]
    said = diagnose([replace(run, i_a=None, i_b=None, i_c=None) for run in turned], nominal)
    assert said.verdict is Verdict.UNEXPLAINED
    assert said.unexplained is not None
    assert "what it is cannot be told; check the nominal values, and the columns" in said.unexplained.description
