"""What goes into a proposed set: loops tuned by what is known, and recordings as the drive would read them with it."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from bench.commissioning.proposal import SHARE, A, by_torque, corrected, machine_of, speed_gains, tuned, turn_of
from bench.commissioning.trial import Reading
from bench.errors import LimitError
from bench.parameters.made import DOUBTFUL, Made
from bench.parameters.parameter_set import OK, Entry, ParameterSet
from drivers.capture import Capture
from drivers.wire.dictionary import TABLE_SIDE, TABLE_SIZE
from estimator.machine import Machine
from estimator.mechanics.mechanics import PARAMETERS, UNITS, Mechanics, Told
from estimator.online.estimate import Estimate, Status

T_s = 1e-4
MACHINE = Machine(0.97, 4.2e-3, 6.2e-3, 0.12, n_p=4)
PLAIN = {f"i_{phase}_gain": 1.0 for phase in "abc"} | {f"i_{phase}_offset": 0.0 for phase in "abc"}
BEFORE = PLAIN | {"angle_offset": 0.0, "phases_swapped": 0.0, "speed_filter": 1e-3, "n_p": 4.0}
KNOWN = {"control_R_s": 0.97, "control_L_d": 4.2e-3, "control_L_q": 6.2e-3, "control_psi_f": 0.12}


def recorded(**columns: np.ndarray) -> Capture:
    return Capture(columns, 0, T_s, 1)


def turning(phases: np.ndarray, theta: np.ndarray) -> Capture:
    """Phase currents (A, three rows, together zero) as a drive has them, at angles (rad)."""
    turns = np.exp(2j * math.pi / 3.0 * np.arange(3))
    i = 2.0 / 3.0 * (turns @ phases) * np.exp(-1j * theta)
    return recorded(theta_e=theta % math.tau, omega_e=np.zeros(len(theta)), i_d=i.real, i_q=i.imag)


@pytest.fixture
def phases() -> np.ndarray:
    given = np.random.default_rng(3).normal(0.0, 3.0, (3, 50))
    return given - given.mean(axis=0)


THETA = np.linspace(-1.0, 9.0, 50)


def test_nothing_changed_is_nothing_corrected(phases: np.ndarray) -> None:
    one = turning(phases, THETA)
    same = corrected(one, BEFORE, BEFORE)
    for name in ("i_d", "i_q", "theta_e", "omega_e"):
        assert same.columns[name] == pytest.approx(one.columns[name], abs=1e-12)
    assert (same.T_s, same.decimation, same.tick) == (one.T_s, one.decimation, one.tick)


@pytest.mark.parametrize("swapped", [0.0, 1.0])
def test_currents_are_read_anew_by_other_gains_and_offsets(phases: np.ndarray, swapped: float) -> None:
    image = BEFORE | {"i_a_gain": 1.02, "i_b_gain": 0.97, "i_c_offset": 0.3, "phases_swapped": swapped}
    now = image | {"i_a_gain": 1.0, "i_b_gain": 1.05, "i_b_offset": -0.2, "i_c_offset": 0.1, "i_c_gain": 0.9}
    gains, offsets = (np.array([[now[f"i_{p}_{what}"]] for p in "abc"]) for what in ("gain", "offset"))
    old_gains, old_offsets = (np.array([[image[f"i_{p}_{what}"]] for p in "abc"]) for what in ("gain", "offset"))
    order = [0, 2, 1] if swapped else [0, 1, 2]  # of the converters, by phases
    readings = phases[order] / old_gains + old_offsets
    expected = turning((gains * (readings - offsets))[order], THETA)
    got = corrected(turning(phases, THETA), image, now)
    for name in ("i_d", "i_q", "theta_e"):
        assert got.columns[name] == pytest.approx(expected.columns[name], abs=1e-12)


def test_an_angle_that_is_put_right_turns_the_currents(phases: np.ndarray) -> None:
    got = corrected(turning(phases, THETA), BEFORE | {"angle_offset": 0.1}, BEFORE | {"angle_offset": 0.35})
    expected = turning(phases, THETA + 0.25)
    for name in ("i_d", "i_q", "theta_e"):
        assert got.columns[name] == pytest.approx(expected.columns[name], abs=1e-12)


@pytest.mark.parametrize("backwards", [0.0, 1.0])
def test_an_encoder_s_table_counts_where_the_turn_is_known(phases: np.ndarray, backwards: float) -> None:
    way, reading = (-1.0 if backwards else 1.0), np.linspace(0.3, 5.9, 50)
    table = 0.01 * np.sin(math.tau * np.arange(TABLE_SIZE) / TABLE_SIZE)
    image = BEFORE | {"angle_correction": 0.0, "angle_reversed": backwards, "angle_offset": 0.2}
    now = image | {"angle_correction": 1.0, **{f"angle_table_{k}": float(x) for k, x in enumerate(table, 1)}}
    seen = 4.0 * way * reading + 0.2
    turn = math.floor(seen[0] / math.tau) % 4
    off = np.interp(reading, np.arange(TABLE_SIZE) * math.tau / TABLE_SIZE, table)
    expected = turning(phases, seen - 4.0 * way * off)
    got = corrected(turning(phases, seen), image, now, turn)
    for name in ("i_d", "i_q", "theta_e"):
        assert got.columns[name] == pytest.approx(expected.columns[name], abs=1e-9)
    unknown = corrected(turning(phases, seen), image, now)
    assert unknown.columns["i_d"] == pytest.approx(turning(phases, seen).columns["i_d"], abs=1e-9)


def test_the_turn_is_what_most_slow_readings_say() -> None:
    theta = 3.0 * math.tau + np.linspace(0.0, 20.0, 2001)  # of four turns, the last
    one = replace(recorded(theta_e=theta % math.tau), tick=500)
    right = [Reading(500 + k, 502 + k, float(theta[k + 1]) / 4.0) for k in (10, 300, 900, 1990)]
    assert turn_of(one, right, BEFORE) == 3
    wrong = Reading(700, 702, float(theta[201]) / 4.0 + math.tau / 4.0)
    assert turn_of(one, [*right, wrong], BEFORE) == 3
    assert turn_of(one, [right[0], wrong], BEFORE) is None
    late, before, after = Reading(500, 900, 0.0), Reading(400, 402, 0.0), Reading(2499, 2502, 0.0)
    assert turn_of(one, [late, before, after], BEFORE) is None
    assert turn_of(one, [], BEFORE) is None


def tables(psi_d: np.ndarray, psi_q: np.ndarray, i_d: tuple[float, float], i_q_max: float) -> dict[str, float]:
    values = {"saturation_correction": 1.0, "table_i_d_min": i_d[0], "table_i_d_max": i_d[1], "table_i_q_max": i_q_max}
    for name, table in (("psi_d_table", psi_d), ("psi_q_table", psi_q)):
        values |= {f"{name}_{k}": float(entry) for k, entry in enumerate(table.ravel(), 1)}
    return values


def test_tables_of_a_machine_whose_inductances_are_constant_leave_i_q_as_it_is() -> None:
    d, q = np.meshgrid(np.linspace(-4.0, 2.0, TABLE_SIDE), np.linspace(0.0, 6.0, TABLE_SIDE), indexing="ij")
    values = tables(MACHINE.psi_f + MACHINE.L_d * d, MACHINE.L_q * q, (-4.0, 2.0), 6.0)
    i_d, i_q = np.array([-3.0, 0.0, 1.5, -1.0, -6.0]), np.array([5.0, -2.0, 0.0, -5.5, 7.0])  # and beyond the tables
    got = by_torque(recorded(i_d=i_d, i_q=i_q), values, MACHINE)
    assert got.columns["i_q"] == pytest.approx(i_q, abs=1e-12)
    assert (got.columns["i_d"] == i_d).all()


def test_i_q_that_saturates_counts_by_its_torque() -> None:
    d, q = np.meshgrid(np.linspace(-4.0, 4.0, TABLE_SIDE), np.linspace(0.0, 7.0, TABLE_SIDE), indexing="ij")
    psi_d = MACHINE.psi_f + MACHINE.L_d * d - 0.004 * q  # i_q takes from the flux along d
    values = tables(psi_d, MACHINE.L_q * q, (-4.0, 4.0), 7.0)
    got = by_torque(recorded(i_d=np.zeros(2), i_q=np.array([5.0, -5.0])), values, MACHINE)
    assert got.columns["i_q"] == pytest.approx([5.0 * (0.12 - 0.02) / 0.12, -5.0 * (0.12 - 0.02) / 0.12])


def test_without_tables_that_act_nothing_changes() -> None:
    one = recorded(i_d=np.zeros(2), i_q=np.ones(2))
    assert by_torque(one, {}, MACHINE) is one
    assert by_torque(one, {"saturation_correction": 0.0}, MACHINE) is one


def made(values: Mapping[str, float], status: str = OK) -> Made:
    entries = {name: Entry(value, status=status) for name, value in values.items()}
    return Made(ParameterSet("a", entries, 3, 7, 8), ("first",))


def shaft(status: Told = Told.OK, J: float | None = 2e-3, sentence: str = "") -> Mechanics:
    values = {"J": J, "B": 1e-3, "T_C": 0.01, "tau_L": 0.0}
    told = {name: Estimate(name, values[name], 1e-6, UNITS[name], Status.OK) for name in PARAMETERS}
    return Mechanics(status, sentence, told)


def test_loops_are_tuned_by_machine_and_shaft() -> None:
    done = tuned(made(KNOWN), shaft(), BEFORE, T_s, None)
    values = done.set.values
    alpha = SHARE / T_s
    assert (values["own_gains"], values["bandwidth"]) == (0.0, pytest.approx(alpha))
    K, delays = 1.5 * 16 * 0.12 / 2e-3, 1.0 / alpha + 1e-3 + 0.5 * T_s
    assert values["k_p_speed"] == pytest.approx(1.0 / (A * K * delays))
    assert values["k_i_speed"] == pytest.approx(values["k_p_speed"] / (A * A * delays))
    assert {done.set.entries[name].status for name in ("bandwidth", "k_p_speed", "k_i_speed")} == {OK}
    assert (done.set.name, done.set.version, done.set.layout_id, done.set.serial) == ("a", 3, 7, 8)
    assert done.remarks == ("first",)
    assert KNOWN.items() <= values.items()
    asked = tuned(made(KNOWN), shaft(), BEFORE, T_s, 700.0)
    assert asked.set.values["bandwidth"] == 700.0
    assert asked.set.values["k_p_speed"] < values["k_p_speed"]


@pytest.mark.parametrize(("given", "said"), [
    (None, "the machine is not told"), (shaft(Told.NO_ACCELERATION, None, "the shaft stands"), "the shaft stands"),
    (shaft(Told.DOUBTFUL, 2e-3, "something swings"), "something swings"),
])  # fmt: skip
def test_without_an_inertia_the_speed_control_is_left_as_it_is_and_that_is_said(
    given: Mechanics | None, said: str
) -> None:
    done = tuned(made(KNOWN), given, BEFORE, T_s, None)
    assert not {"k_p_speed", "k_i_speed"} & done.set.values.keys()
    assert "bandwidth" in done.set.values
    assert done.remarks[0] == "first"
    assert done.remarks[1] == f"gains of the speed control are left as they are: J is not told for certain ({said})"


def test_without_inductances_and_flux_nothing_is_tuned() -> None:
    done = tuned(made({"angle_offset": 0.1}), shaft(), BEFORE, T_s, None)
    assert done.set.values == {"angle_offset": 0.1}


def test_gains_of_what_is_doubtful_are_doubtful() -> None:
    done = tuned(made(KNOWN, DOUBTFUL), shaft(), BEFORE, T_s, None)
    assert {done.set.entries[name].status for name in ("bandwidth", "k_p_speed", "k_i_speed")} == {DOUBTFUL}


def test_an_inertia_that_is_none_gives_no_gains() -> None:
    with pytest.raises(LimitError, match="J is not told"):
        speed_gains(shaft(J=None), 0.12, BEFORE, 2000.0, T_s)
    with pytest.raises(LimitError, match="above zero"):
        speed_gains(shaft(J=-1e-3), 0.12, BEFORE, 2000.0, T_s)


def test_a_machine_is_all_four_or_none() -> None:
    values = {"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.2e-3, "psi_f": 0.12}
    std = {name: 0.01 * value for name, value in values.items()}
    after: dict[str, dict[str, float | None]] = {
        name: {"value": value, "std": std[name]} for name, value in values.items()
    }  # fmt: skip
    assert machine_of({"machine": {"after": after}}, 4) == (MACHINE, std)
    after["L_d"]["std"] = None
    found = machine_of({"machine": {"after": after}}, 7)
    assert found is not None
    assert (found[0], set(found[1])) == (replace(MACHINE, n_p=7), {"R_s", "L_q", "psi_f"})
    assert machine_of({"machine": {"after": after | {"L_q": {"value": None}}}}, 4) is None
    assert machine_of({}, 4) is None
