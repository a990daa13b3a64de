"""What undoes an effect, by hand: signs, units, and what the drive had before."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from bench.parameters.compensation import TABLE, Recorded, UntoldError, compensations, electrical_turn
from bench.parameters.made import Size
from bench.parameters.parameter_set import FLASHED, problem_of
from drivers.wire.dictionary import TABLE_SIDE, TABLE_SIZE
from estimator.physics.library import BY_NAME

MACHINE = {"R_s": 1.0, "L_d": 4e-3, "L_q": 6e-3, "psi_f": 0.12, "n_p": 4.0, "i_rated": 6.0}
CURRENTS = {"i_d": (-3.0, 1.0), "i_q": (-2.0, 5.0)}


def recorded(
    found: Mapping[str, Mapping[str, float]], drive: Mapping[str, float] | None = None, **more: Any
) -> Recorded:
    told = {effect: {name: Size(value, 0.01) for name, value in sizes.items()} for effect, sizes in found.items()}
    return replace(Recorded(drive or {}, MACHINE, told, CURRENTS, 1e-4, 300.0), **more)


def values(given: Recorded) -> dict[str, float]:
    made, said = compensations(given)
    assert said == []
    found = {name: size.value for one in made for name, size in one.values.items()}
    assert [problem for name, value in found.items() if (problem := problem_of(name, value))] == []
    return found


def test_every_effect_has_its_line() -> None:
    assert set(BY_NAME) <= set(TABLE)
    for how in TABLE.values():
        assert callable(how) or not how.endswith(".")


def test_a_channel_that_reads_too_much_gets_a_smaller_gain() -> None:
    found = {"current_sensor_gain": {"gain_a": 1.02, "gain_b": 0.99, "gain_c": 0.99}}
    assert values(recorded(found)) == pytest.approx({"i_a_gain": 1 / 1.02, "i_b_gain": 1 / 0.99, "i_c_gain": 1 / 0.99})
    there = values(recorded(found, {"i_a_gain": 1.1, "phases_swapped": 1.0, "i_c_gain": 0.9}))
    assert there == pytest.approx({"i_a_gain": 1.1 / 1.02, "i_c_gain": 0.9 / 0.99, "i_b_gain": 1 / 0.99})


def test_an_offset_is_that_of_a_reading_before_its_gain() -> None:
    found = {"current_sensor_offset": {"offset_a": 0.1, "offset_b": -0.05, "offset_c": -0.05}}
    assert values(recorded(found)) == pytest.approx({"i_a_offset": 0.1, "i_b_offset": -0.05, "i_c_offset": -0.05})
    there = values(recorded(found, {"i_a_offset": 0.3, "i_a_gain": 2.0}))
    assert there["i_a_offset"] == pytest.approx(0.35)  # 2 (reading - 0.3) = i + 0.1


def test_gain_and_offset_together_undo_both() -> None:
    gain, offset, had, off = 1.04, 0.2, 1.1, 0.3
    told = {
        "current_sensor_gain": {"gain_a": gain, "gain_b": 1.0, "gain_c": 1.0},
        "current_sensor_offset": {"offset_a": offset, "offset_b": 0.0, "offset_c": 0.0},
    }
    set_ = values(recorded(told, {"i_a_gain": had, "i_a_offset": off}))
    true = 3.0
    reading = (gain * true + offset) / had + off  # the drive's had (reading - off) is gain true + offset
    assert set_["i_a_gain"] * (reading - set_["i_a_offset"]) == pytest.approx(true)


@pytest.mark.parametrize(("had", "is_"), [(0.0, -0.1), (0.25, 0.15), (-3.1, math.tau - 3.2)])
def test_an_angle_that_is_ahead_is_taken_back(had: float, is_: float) -> None:
    found = {"angle_offset": {"offset": 0.1}}
    assert values(recorded(found, {"angle_offset": had})) == pytest.approx({"angle_offset": is_})


def test_dead_time_and_drop_are_on_top_of_those_before_where_they_were_made_up_for() -> None:
    found = {"inverter_voltage_error": {
        "dead_time": 1e-6, "u_drop": 0.5, "zero_crossing_width": 0.2, "knee": 0.01,
    }}
    had = {"dead_time": 2e-6, "inverter_drop": 0.7, "inverter_width": 0.1}
    fresh = {"inverter_correction": 1.0, "dead_time": 1e-6, "inverter_width": 0.2, "inverter_drop": 0.5}
    assert values(recorded(found, had)) == pytest.approx(fresh)
    assert values(recorded(found, had | {"inverter_correction": 1.0})) == pytest.approx(
        fresh | {"dead_time": 3e-6, "inverter_drop": 1.2}
    )


def test_soft_drops_and_a_table_before_make_a_table() -> None:
    soft = {"inverter_voltage_error": {
        "dead_time": 1e-6, "u_drop": 2.0, "zero_crossing_width": 0.02, "knee": 0.5,
    }}
    there = values(recorded(soft))
    assert (there["inverter_correction"], there["inverter_table_current"]) == (2.0, 4.0)
    assert there["inverter_table_1"] == 0.0
    assert there[f"inverter_table_{TABLE_SIZE}"] == pytest.approx(1e-6 / 1e-4 * 300.0 + 2.0, rel=0.01)
    before = {f"inverter_table_{k}": 7.0 for k in range(2, TABLE_SIZE + 1)}
    again = values(recorded(soft, {"inverter_correction": 2.0, "inverter_table_current": 4.0, **before}))
    assert again["inverter_table_40"] == pytest.approx(there["inverter_table_40"] + 7.0)
    times = {"inverter_correction": 1.0, "dead_time": 2e-6, "inverter_drop": 1.0, "inverter_width": 0.1}
    over = values(recorded(soft, times))
    assert over["inverter_table_40"] == pytest.approx(there["inverter_table_40"] + 7.0)


def test_a_voltage_of_steady_points_is_a_drop() -> None:
    found = {"inverter_voltage_error": {"voltage": 6.0, "zero_crossing_width": 0.3}}
    (one,), (said,) = compensations(recorded(found))
    there = {name: size.value for name, size in one.values.items()}
    assert (there["dead_time"], there["inverter_drop"], there["inverter_width"]) == (0.0, 6.0, 0.3)
    assert one.values["dead_time"].std is None
    assert said == "how much of the inverter's voltage error is dead time is not told: inverter_drop takes it all"


def test_a_drop_that_is_told_as_none_is_as_unsure_as_that() -> None:
    told = {"dead_time": Size(1e-6, 1e-8), "u_drop": Size(0.0, 0.4), "zero_crossing_width": Size(0.2)}
    (one,), _ = compensations(replace(recorded({}), found={"inverter_voltage_error": told}))
    assert (one.values["inverter_drop"], one.values["dead_time"].std) == (Size(0.0, 0.4), 1e-8)


def test_dead_time_and_drop_are_taken_over_where_a_table_of_soft_drops_cannot_be() -> None:
    soft = {"inverter_voltage_error": {"dead_time": 1e-6, "u_drop": 2.0, "zero_crossing_width": 0.02, "knee": 0.5}}
    unknown = replace(recorded(soft), u_dc=None)
    (one,), (said,) = compensations(unknown)
    assert (one.values["dead_time"].value, one.values["inverter_drop"].value) == (1e-6, 2.0)
    assert said == (
        "the drop is taken for one of no softness: a table of it needs the control period and the dc link's voltage"
    )
    none, (why,) = compensations(replace(unknown, drive={"inverter_correction": 2.0}))
    assert none == []
    assert why.endswith("the drive has a table of lost voltage, and another one needs the control period and the dc "
                        "link's voltage")  # fmt: skip


def once(angle: float) -> float:
    """What an encoder reads too much (rad, mechanical) at a true angle."""
    return 0.05 * math.sin(angle + 0.4) + 0.01 * math.sin(2.0 * angle - 1.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("begun", [0, 3])
def test_an_eccentric_encoders_table_is_by_its_readings(way: float, begun: int) -> None:
    """The diagnosis counts mechanical angles from the electrical turn in which the recording began."""
    n_p, offset = 4, 0.7
    by = begun * math.tau / n_p
    found = {"encoder_eccentricity": {
        "once": 0.2, "once_phase": 0.4 + by, "twice": 0.04, "twice_phase": -1.0 + 2.0 * by,
    }}
    drive = {"angle_reversed": 1.0 if way < 0.0 else 0.0, "angle_offset": offset, "n_p": 4.0}
    there = values(recorded(found, drive, electrical_turn=begun))
    assert there["angle_correction"] == 1.0
    for k in range(0, TABLE_SIZE, 5):
        reading = k * math.tau / TABLE_SIZE
        true = way * (reading - there[f"angle_table_{k + 1}"]) + offset / n_p
        assert true + once(true) == pytest.approx(way * reading + offset / n_p, abs=1e-9)


def test_a_second_table_is_on_top_of_the_first() -> None:
    left = {"encoder_eccentricity": {"once": 0.2, "once_phase": 0.4, "twice": 0.0, "twice_phase": 0.0}}
    before = {f"angle_table_{k}": 0.01 for k in range(1, TABLE_SIZE + 1)} | {"angle_correction": 1.0}
    first, second = values(recorded(left, electrical_turn=0)), values(recorded(left, before, electrical_turn=0))
    assert second["angle_table_1"] == pytest.approx(first["angle_table_1"] + 0.01, abs=1e-3)
    assert values(recorded(left, before | {"angle_correction": 0.0}, electrical_turn=0)) == pytest.approx(first)


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("reversed_", [0.0, 1.0])
def test_the_encoders_reading_tells_the_electrical_turn(turn: int, reversed_: float) -> None:
    drive = {"n_p": 4.0, "angle_offset": 0.5, "angle_reversed": reversed_}
    theta_m = turn * math.tau / 4.0 + 0.2
    reading = (-1.0 if reversed_ else 1.0) * (theta_m - 0.5 / 4.0)
    assert electrical_turn(reading, 0.8, drive) == turn
    assert electrical_turn(reading % math.tau, 0.8 + 0.01, drive) == turn


def test_without_it_there_is_no_table_but_of_one_pole_pair() -> None:
    sizes = {"encoder_eccentricity": {"once": 0.2, "once_phase": 0.4, "twice": 0.0, "twice_phase": 0.0}}
    made, (said,) = compensations(recorded(sizes))
    assert made == []
    assert "which of 4 electrical turns it began in" in said
    one = Recorded({}, MACHINE | {"n_p": 1.0}, recorded(sizes).found)
    assert compensations(one)[1] == []
    oval = recorded({"encoder_eccentricity": {"once": 0.01, "once_phase": 0.4, "twice": 0.2, "twice_phase": 0.0}})
    assert values(replace(oval, machine=MACHINE | {"n_p": 2.0}))["angle_table_9"] == pytest.approx(0.1, abs=0.01)


def test_saturations_share_tables_over_the_currents_that_were_seen() -> None:
    found = {"d_axis_saturation": {"L_d_drop": 0.1}, "q_axis_saturation": {"L_q_drop": 0.3}}
    made, said = compensations(recorded(found, {"saturation_correction": 1.0, "psi_d_table_1": 9.0}))
    assert said == []
    (one,) = made
    assert one.effects == ("d_axis_saturation", "q_axis_saturation")
    assert "i_d from -3 to 1 A, i_q from -2 to 5 A" in one.note
    there = {name: size.value for name, size in one.values.items()}
    assert (there["table_i_d_min"], there["table_i_d_max"], there["table_i_q_max"]) == (-3.0, 1.0, 5.0)
    last = TABLE_SIDE * (TABLE_SIDE - 1)
    assert there["psi_q_table_1"] == there[f"psi_q_table_{last + 1}"] == 0.0
    step, at = 5.0 / (TABLE_SIDE - 1), last + 1  # i_d = 1 A
    inner, outer = (there[f"psi_q_table_{at + k + 1}"] - there[f"psi_q_table_{at + k}"] for k in (0, TABLE_SIDE - 2))
    assert inner == pytest.approx(6e-3 * step, rel=0.03)
    assert outer < 0.75 * inner
    assert there[f"psi_d_table_{last + 1}"] == pytest.approx(0.12 + 4e-3, rel=0.01)
    assert there["psi_d_table_1"] == pytest.approx(0.12 - 3 * 4e-3, rel=0.01)


def test_drops_without_the_current_that_they_are_at_make_no_tables() -> None:
    bare = Recorded({}, {"R_s": 1.0}, {"q_axis_saturation": {"L_q_drop": Size(0.3)}})
    assert compensations(bare)[0] == []
    with pytest.raises(UntoldError):
        TABLE["q_axis_saturation"](bare)  # pyright: ignore


def test_a_flux_map_is_read_between_its_currents_and_goes_on_straight_beyond() -> None:
    i_d, i_q = [-4.0, -2.0, 0.0, 2.0], [-4.0, -2.0, 0.0, 2.0, 4.0]
    psi_d: list[list[float | None]] = [[0.1 + 4e-3 * d - 1e-4 * q * q for q in i_q] for d in i_d]
    psi_q: list[list[float | None]] = [[5e-3 * q for q in i_q] for _ in i_d]
    psi_d[0][4] = psi_q[0][4] = psi_d[0][0] = psi_q[0][0] = None
    there = recorded(
        {"q_axis_saturation": {"L_q_least": 4e-3, "L_q_most": 6e-3}},
        flux_map={"i_d": i_d, "i_q": i_q, "psi_d": psi_d, "psi_q": psi_q}, currents={},
    )
    (one,), said = compensations(there)
    assert said == []
    assert "entries, where the map has none, are by those beside" in one.note
    found = {name: size.value for name, size in one.values.items()}
    assert (found["table_i_d_min"], found["table_i_d_max"], found["table_i_q_max"]) == (-4.0, 2.0, 4.0)
    assert found["psi_d_table_1"] == pytest.approx(0.1 - 16e-3)
    assert found[f"psi_q_table_{TABLE_SIZE}"] == pytest.approx(20e-3)
    assert found[f"psi_q_table_{TABLE_SIDE}"] == pytest.approx(5e-3 * 4.0)  # where there is none


def test_a_late_angle_is_an_old_one_and_other_conventions_are_the_recordings() -> None:
    read_late = recorded({"angle_latency": {"latency": 7e-5}}, {"angle_latency": 1e-5})
    assert values(read_late) == pytest.approx({"angle_latency": 8e-5})
    late = recorded({"convention_error": {"theta_shift": 2.0}}, {"angle_latency": 1e-5})
    assert values(late) == pytest.approx({"angle_latency": 2.1e-4})
    assert compensations(late)[0][0].doubt == "it may be the recording alone that has the angle late"
    assert "a matter of the recording" in compensations(recorded({"convention_error": {"u_scale": 1.7}}))[1][0]


def test_what_no_compensation_absorbs_is_said() -> None:
    _, said = compensations(recorded({"iron_loss": {"conductance": 1e-3}, "ghost": {}}))
    assert said == [
        "iron_loss is absorbed by no compensation: part of the current makes heat and no torque, the more the faster "
        "it turns",
        "ghost is absorbed by no compensation: the bench knows of none",
    ]


def test_signals_are_those_that_a_set_may_hold() -> None:
    names = {signal.name for signal in FLASHED}
    assert {"i_a_gain", "i_c_offset", "angle_table_64", "psi_q_table_64", "inverter_table_1"} <= names
