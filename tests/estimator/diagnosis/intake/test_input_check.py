"""Input check: what is wrong with a recording is said in a sentence, and nothing is said of one that is in order."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from emulator.conceal.populations import POPULATIONS, STRANGERS
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.data_sheet import contradicted
from estimator.diagnosis.intake.input_check import checked
from estimator.diagnosis.verdict import Verdict
from estimator.machine import Machine
from estimator.samples import Resolution, Samples
from tests.estimator.diagnosis.convention_runs import (
    LENGTH,
    TURN,
    currents,
    made,
    recording,
    scaled,
    some_soon,
    speed,
    voltages,
    with_vectors,
)

pytestmark = pytest.mark.thorough

NUMBERS = (1, 2, 3, 5, 8)


@pytest.mark.parametrize("kind", ["none", "one", "two", "three", *STRANGERS])
def test_nothing_is_said_of_a_recording_in_order(kind: str) -> None:
    for number in range(1, 9):
        assert checked(*recording(kind, number, seed=31, length=1.0)) == ((), False), (kind, number)


def only(runs: "list[Samples] | tuple[Samples, ...]", nominal: Machine, *, stop: bool) -> str:
    """The one remark on a recording."""
    told = checked(runs, nominal)
    assert len(told.remarks) == 1, told
    assert told.stop is stop
    assert "expected" in told.remarks[0] or "cannot" in told.remarks[0] or "can be told" in told.remarks[0]
    return told.remarks[0]


@pytest.mark.parametrize("number", NUMBERS)
def test_too_few_rows_end_the_diagnosis(number: int) -> None:
    (run, *_), nominal = recording("none", number)
    assert "40 rows, expected at least 50" in only([run[:40]], nominal, stop=True)
    assert "0 rows" in only([], nominal, stop=True)
    pieces = [run[k : k + 10] for k in range(0, 200, 20)]
    assert "longest run without a gap has 10 rows" in only(pieces, nominal, stop=True)


@pytest.mark.parametrize("number", NUMBERS)
def test_the_state_of_hall_sensors_is_no_angle(number: int) -> None:
    runs, nominal = recording("none", number)
    sector = TURN / 6.0
    raw = [replace(run, theta_e=sector * (np.floor(run.theta_e / sector) + 0.5)) for run in runs]
    assert "steps of 60 deg" in only(raw, nominal, stop=True)


def test_many_gaps_are_told_with_what_is_missing() -> None:
    (run, *_), nominal = recording("none", 1)
    pieces = [run[k : k + 100] for k in range(0, 6000, 125)]
    assert "1175 of 5975 rows are missing, in 47 gaps" in only(pieces, nominal, stop=False)


def test_rows_that_are_lost_one_by_one_end_the_diagnosis_where_hardly_any_follow_each_other() -> None:
    (run, *_), nominal = recording("none", 1)
    kept = np.flatnonzero(np.random.default_rng(1).random(len(run)) > 0.3)
    edges = [0, *(np.flatnonzero(np.diff(kept) > 1) + 1).tolist(), len(kept)]
    pieces = [run[kept[a] : kept[b - 1] + 1] for a, b in pairwise(edges)]
    said = only(pieces, nominal, stop=True)
    assert f"{kept[-1] + 1 - len(kept)} of {kept[-1] + 1} rows are missing" in said
    assert "in runs of less than 20: too few follow each other" in said
    bursts = [run[k : k + 60] for k in range(0, 6000, 90)]
    assert not checked(bursts, nominal).stop


@pytest.mark.parametrize("column", ["theta_e", "i_q", "u_d"])
def test_a_value_that_is_no_number_is_told_by_its_column(column: str) -> None:
    (run, *_), nominal = recording("none", 1)
    values = getattr(run, column).copy()
    values[7], values[11] = np.nan, np.inf
    said = only([replace(run, **{column: values})], nominal, stop=True)
    assert f"{column} is not a number in 2 of {len(run)} rows" in said


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_dc_link_without_voltage_ends_the_diagnosis(value: float) -> None:
    (run, *_), nominal = recording("none", 1)
    assert run.u_dc is not None
    once = run.u_dc.copy()
    once[9] = value
    for u_dc, count in ((once, 1), (np.full(len(run), value), len(run))):
        said = only([replace(run, u_dc=u_dc)], nominal, stop=True)
        assert f"u_dc is not above 0 V in {count} of {len(run)} rows" in said


@pytest.mark.parametrize("number", NUMBERS)
def test_columns_that_hold_one_value_are_told(number: int) -> None:
    runs, nominal = recording("none", number)
    for still, what in (("i", "currents"), ("u", "voltages")):
        same = [with_vectors(run, **{still: np.full(len(run), 1.0 + 1.0j)}) for run in runs]
        assert f"the {what} are the same in every row" in only(same, nominal, stop=True)


def noise(run: Samples, size: float) -> np.ndarray:
    chance = np.random.default_rng(1)
    return size * (chance.standard_normal(len(run)) + 1j * chance.standard_normal(len(run)))


def test_a_motor_that_stands_is_told_with_what_can_be_known() -> None:
    (run, *_), nominal = recording("none", 1)
    assert nominal.i_rated is not None
    still = replace(run, theta_e=np.full(len(run), 0.3), omega_e=np.zeros(len(run)))
    idle = 1e-3 * nominal.i_rated
    no_current = with_vectors(still, i=noise(run, idle), u=noise(run, nominal.R_s * idle))
    assert "stands" in only([no_current], nominal, stop=True)
    assert "carries no current" in only([with_vectors(run, i=noise(run, idle))], nominal, stop=True)
    told = checked([replace(still, i_a=None)], nominal)
    assert not told.stop
    assert "R_s, L_d and L_q can be told, psi_f" in told.remarks[0]


def clipped(run: Samples, level: float) -> Samples:
    """The three channels cut off, and the rotor frame's currents made of them."""
    assert run.i_a is not None
    assert run.i_b is not None
    assert run.i_c is not None
    a, b, c = (np.clip(phase, -level, level) for phase in (run.i_a, run.i_b, run.i_c))
    turn = np.exp(1j * TURN / 3.0)
    i_dq = 2.0 / 3.0 * (a + turn * b + turn.conjugate() * c) * np.exp(-1j * run.theta_e)
    return replace(with_vectors(run, i=i_dq), i_a=a, i_b=b, i_c=c)


def test_currents_that_are_cut_off_are_told_with_the_level() -> None:
    found = 0
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        level = 0.6 * max(float(np.max(np.abs(run.i_a))) for run in runs if run.i_a is not None)
        told = checked([clipped(run, level) for run in runs], nominal)
        assert not told.stop
        found += any(f"the phase currents are cut off at {level:.3g} A" in said for said in told.remarks)
    assert found >= 4


@pytest.mark.parametrize("name", ["i_d", "i_q"])
def test_a_column_of_currents_that_is_cut_off_is_told_with_the_level(name: str) -> None:
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        level = float(np.quantile(np.abs(np.concatenate([getattr(run, name) for run in runs])), 0.7))
        cut = [replace(run, **{name: np.clip(getattr(run, name), -level, level)}) for run in runs]
        assert any(f"{name} is cut off at" in said for said in checked(cut, nominal).remarks), number


def test_an_angle_that_is_read_every_few_periods_is_told() -> None:
    for every in (4, 40):
        found = 0
        for number in NUMBERS:
            runs, nominal = recording("none", number)
            held = [replace(run, theta_e=run.theta_e[np.arange(len(run)) // every * every]) for run in runs]
            found += any("and then catches up by more than 4" in said for said in checked(held, nominal).remarks)
        assert found >= 4


@pytest.mark.parametrize("count", [1e-4, 2e-3, 3e-2])
def test_a_motor_that_stands_and_starts_slowly_on_a_coarse_encoder_holds_no_angle(count: float) -> None:
    (run, *_), nominal = recording("none", 1)
    t = np.arange(len(run)) * run.T_s
    for slow in (2.0, 20.0, 200.0):  # rad/s
        theta = slow * np.maximum(t - 0.5 * t[-1], 0.0)
        for told in (0.0, count, 0.06 * count):
            so = Resolution(theta_e=told, encoder=told)
            coarse = replace(run, theta_e=count * np.floor(theta / count) % TURN, resolution=so)
            assert not any("catches up" in said for said in checked([coarse], nominal).remarks), (slow, told)


def test_a_rated_current_that_the_currents_exceed_by_far_is_told() -> None:
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        high = max(float(np.max(np.hypot(run.i_d, run.i_q))) for run in runs)
        assert "times the nominal i_rated" in only(runs, replace(nominal, i_rated=high / 20.0), stop=False)


def test_a_motor_that_stands_says_nothing_of_units() -> None:
    (run, *_), nominal = recording("none", 1)
    omega, i = run.omega_e, run.i_d + 1j * run.i_q
    by_speed = 1j * omega * (nominal.psi_f + nominal.L_d * i.real + 1j * nominal.L_q * i.imag)
    still = with_vectors(run, u=run.u_d + 1j * run.u_q - by_speed)
    still = replace(still, theta_e=np.zeros(len(run)), omega_e=np.zeros(len(run)), i_a=None, i_b=None, i_c=None)
    for known in (nominal, replace(nominal, i_rated=None)):
        assert "stands" in only([still], known, stop=False)


def test_a_voltage_at_its_limit_for_long_is_told() -> None:
    (run, *_), nominal = recording("none", 1)
    assert run.u_dc is not None
    full = run.u_dc / np.sqrt(3.0) * np.exp(1j * np.angle(voltages(run) + 1e-9))
    assert any("at its limit" in said for said in checked([with_vectors(run, u=full)], nominal).remarks)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_speed_that_contradicts_the_angle_is_told_with_the_ratio(number: int) -> None:
    n_p = recording("none", number)[1].n_p
    assert f"omega_e is {1.0 / n_p:.4g} times" in only(
        *made(speed(lambda m: 1.0 / m.n_p), recording("none", number)), stop=False
    )
    assert "omega_e is -1 times" in only(*made(speed(lambda _: -1.0), recording("none", number)), stop=False)


@pytest.mark.parametrize("number", NUMBERS)
def test_phase_currents_that_contradict_the_rotor_frame_are_told(number: int) -> None:
    runs, nominal = recording("none", number)
    swapped = [replace(run, i_b=run.i_c, i_c=run.i_b) for run in runs]
    assert "do not give i_d and i_q" in only(swapped, nominal, stop=False)
    rms = [with_vectors(run, i=currents(run)) for run in runs]
    rms = [replace(run, **{name: getattr(run, name) / np.sqrt(2.0) for name in ("i_a", "i_b", "i_c")}) for run in rms]
    assert "are 0.707 times what i_d and i_q say" in only(rms, nominal, stop=False)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_machine_in_other_units_is_told(number: int) -> None:
    runs, nominal = recording("none", number)
    in_mH = replace(nominal, L_d=1e3 * nominal.L_d, L_q=1e3 * nominal.L_q)
    assert "the nominal L_d and L_q seem to be in thousandths" in only(runs, in_mH, stop=True)
    in_mWb = replace(nominal, psi_f=1e3 * nominal.psi_f)
    assert "the nominal psi_f seems to be in thousandths" in only(runs, in_mWb, stop=True)
    between_lines = replace(nominal, R_s=2.0 * nominal.R_s)  # which is asked about as a convention
    assert checked(runs, between_lines) == ((), False)


def test_an_angle_made_of_a_speed_in_rpm_is_told_by_the_phase_currents() -> None:
    told = 0
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        times = 60.0 / TURN / nominal.n_p
        in_rpm = [replace(run, theta_e=times * (np.unwrap(run.theta_e) - run.theta_e[0]), omega_e=times * run.omega_e)
                  for run in runs]
        said = " ".join(checked(in_rpm, nominal).remarks)
        told += f"turns {times:.4g} times as fast" in said and "mechanical and in rpm" in said
    assert told >= 4


UNITS = {
    "the voltages seem to be in mV, expected V": scaled(u=1e3),
    "the currents seem to be in mA, expected A": scaled(i=1e3),
    "voltages and currents both seem to be in mV and mA, expected V and A": scaled(u=1e3, i=1e3),
    "the voltages seem to be in uV, expected V": scaled(u=1e6),
}


@pytest.mark.parametrize("says", UNITS)
def test_a_recording_in_smaller_units_is_told_by_them_and_the_data_sheet_is_not_blamed(says: str) -> None:
    for kind, number in [*(("none", number) for number in NUMBERS), ("drops", 2), ("dead_time", 6), ("telegraph", 5)]:
        runs, nominal = made(UNITS[says], recording(kind, number, seed=31))
        said = only(runs, nominal, stop=True)
        assert said.startswith(f"{says}: as it stands, the recording asks for "), (kind, number)
        links = [replace(run, u_dc=None if run.u_dc is None else 1e3 * run.u_dc) for run in runs]
        assert only(links, nominal, stop=True) == said


def test_currents_that_the_motor_may_carry_leave_it_to_a_data_sheet_in_milliohms_and_millihenries() -> None:
    runs, nominal = recording("none", 1)
    in_milli = replace(nominal, R_s=1e3 * nominal.R_s, L_d=1e3 * nominal.L_d, L_q=1e3 * nominal.L_q)
    assert "the nominal L_d and L_q seem to be in thousandths" in only(runs, in_milli, stop=True)


WRONG: dict[str, Callable[[Machine], Machine]] = {
    "the nominal R_s is ": lambda m: replace(m, R_s=10.0 * m.R_s),
    "the nominal psi_f is ": lambda m: replace(m, psi_f=5.0 * m.psi_f),
    "the nominal L_d is ": lambda m: replace(m, L_d=12.0 * m.L_d, L_q=12.0 * m.L_q),
    "the nominal L_q is ": lambda m: replace(m, L_q=m.L_q / 6.0),
}


@pytest.mark.parametrize("says", WRONG)
def test_a_nominal_value_that_is_wrong_by_a_factor_is_told_with_what_the_recording_says(says: str) -> None:
    for number in (1, 2, 3, 5):
        runs, nominal = recording("none", number)
        assert contradicted(runs, nominal) is None
        said = contradicted(runs, WRONG[says](nominal))
        assert said is not None, number
        assert said.startswith(says)
        assert "the recording says" in said


def test_exchanged_inductances_are_told_where_they_are_far_apart() -> None:
    far = [recording("none", number) for number in range(1, 9)]
    far = [(runs, nominal) for runs, nominal in far if nominal.L_q > 3.0 * nominal.L_d]
    assert far
    for runs, nominal in far:
        exchanged = replace(nominal, L_d=nominal.L_q, L_q=nominal.L_d)
        assert "the nominal L_d and L_q seem to be exchanged" in str(contradicted(runs, exchanged))
        assert diagnose(runs, exchanged).verdict is Verdict.NOT_ENOUGH_EXCITATION


@pytest.mark.parametrize("kind", some_soon(["two", "three", *POPULATIONS]))
def test_physics_is_no_wrong_data_sheet(kind: str) -> None:
    for number in range(1, 7):
        assert contradicted(*recording(kind, number, seed=31, length=1.0)) is None, number


def test_a_resistance_that_is_too_high_at_every_current_is_no_dead_time() -> None:
    said = [contradicted(runs, replace(nominal, R_s=nominal.R_s / 10.0))
            for runs, nominal in (recording("none", number) for number in range(1, 9))]
    assert sum(one is not None for one in said) >= 2
    assert all(one.startswith("the nominal R_s is ") for one in said if one is not None)


def test_values_that_are_off_by_less_are_left_to_the_diagnosis() -> None:
    for number in NUMBERS:
        runs, nominal = recording("none", number)
        for other in ({"R_s": nominal.R_s / 3.0}, {"R_s": 3.0 * nominal.R_s}, {"psi_f": 2.5 * nominal.psi_f}):
            assert contradicted(runs, replace(nominal, **other)) is None


def test_two_drives_in_one_recording_are_told() -> None:
    (first, *_), nominal = recording("none", 1)
    others = [recording("none", number) for number in range(2, 12)]
    (other, *_), _ = next(o for o in others if o[1].L_d > 2.0 * nominal.L_d or o[1].L_d < 0.5 * nominal.L_d)
    later = replace(other, T_s=first.T_s, t0=first.t0 + 2.0 * LENGTH)
    assert "two drives" in only([first, later], nominal, stop=True)
    assert checked([first[:5000], replace(first[5000:], t0=first.t0 + 2.0 * LENGTH)], nominal).remarks[1:] == ()
