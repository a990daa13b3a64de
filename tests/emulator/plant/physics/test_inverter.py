"""The inverter and its dc link against closed forms: dead time, clamping, drops, pulses, sag, the voltage's limits."""

import cmath
import math

import numpy as np
import pytest

from drivers.wire.cia402 import OVERVOLTAGE
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.dc_link import DcLink, charged
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.sensing import CurrentSensing, VoltageSensing
from emulator.scenario.scenarios import Run
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    SALIENT,
    T_S,
    Column,
    Recording,
    at,
    currents,
    free,
    line,
    middle,
    phases_of,
    stationary_voltages,
    steady,
    switched,
    voltage_error,
    voltages,
    with_effects,
)
from tests.gallery.within import coming_period

U_DC = 310.0


def signs(i: complex) -> complex:
    """Space vector of the signs of the phases of a current."""
    a, b, c = (math.copysign(1.0, x) for x in phases_of(i))
    turn = cmath.exp(2j * math.pi / 3.0)
    return 2.0 / 3.0 * (a + b * turn + c * turn**2)


def spread(r: Recording) -> Column:
    """The greatest voltage (V) between two terminals, as recorded."""
    phase = np.array([phases_of(complex(u)) for u in stationary_voltages(r)])
    return phase.max(axis=1) - phase.min(axis=1)


@pytest.mark.parametrize("degrees", [0.0, 50.0, 130.0, 250.0])
def test_dead_time_takes_its_share_of_the_dc_link_against_every_phases_current(degrees: float) -> None:
    dead_time, i = 2e-6, cmath.rect(4.0, math.radians(degrees))
    r = steady(switched(with_effects(i_dq=i, inverter=Inverter(dead_time=dead_time))), 0.05, 0.02)
    expected = dead_time / T_S * U_DC * signs(i)
    assert abs(complex(voltage_error(r, SALIENT).mean()) - expected) < 0.01 * abs(expected)


def test_dead_time_draws_the_harmonics_of_a_square_wave() -> None:
    """sign(cos x) = 4/pi (cos x - 1/3 cos 3x + 1/5 cos 5x - 1/7 cos 7x ...): 5 and 11 turn back, 7 and 13 on."""
    dead_time, i = 2e-6, 10j
    inverter = Inverter(dead_time)
    scenario = switched(with_effects(motor=ROUND, i_dq=i, run=at(20.0), drive={"bandwidth": 4e3}, inverter=inverter))
    r = steady(scenario, 0.1, 0.1001)
    x = middle(r) + math.pi / 2.0  # of the current
    seen = voltage_error(r, ROUND) / 1j / (4.0 / math.pi * dead_time / T_S * U_DC)  # in the current's own frame
    late = -np.angle(line(seen, x, 0))  # the current's own harmonics move its zero crossings a little
    assert abs(late) < 0.02
    for n, expected in ((1, 1.0), (-5, 1.0 / 5.0), (7, -1.0 / 7.0), (-11, -1.0 / 11.0), (13, 1.0 / 13.0)):
        assert abs(line(seen, x, n - 1) - expected * np.exp(-1j * n * late)) < 0.01, n


def test_clamping_holds_a_phases_current_at_zero_for_a_while() -> None:
    """Without dead time a sine of 2 A is within 20 mA of zero for 2 asin(1 %) / pi of its time."""
    near: list[float] = []
    for dead_time in (0.0, 5e-6):
        scenario = switched(with_effects(i_dq=2j, run=at(5.0), inverter=Inverter(dead_time)))
        i_a = steady(scenario, 0.2, 0.4)["i_a"]
        near.append(float(np.mean(np.abs(i_a) < 0.02)))
    assert near[0] == pytest.approx(2.0 * math.asin(0.01) / math.pi, abs=0.003)
    assert near[1] > 5.0 * near[0]


def test_between_edges_a_clamped_current_is_zero_for_most_of_a_dead_time() -> None:
    """Near its zero crossing, in steps of a quarter of a microsecond; without dead time it only passes."""
    still: list[float] = []
    for dead_time in (0.0, 3e-6):
        drive = VirtualDrive(switched(with_effects(motor=ROUND, i_dq=2j, run=at(20.0), inverter=Inverter(dead_time))))
        drive.run(2243)
        t, i_a = coming_period(drive)
        still.append(float(np.diff(t)[np.abs(i_a[1:]) < 1e-5].sum()))
    assert still[0] < 1e-6
    assert still[1] > 2e-6


def test_a_bridge_that_is_off_lets_currents_end_and_keeps_them_at_none() -> None:
    scenario = switched(with_effects(i_dq=3.0 + 2j, run=at(20.0), inverter=Inverter(2e-6, u_diode=0.7)))
    drive = VirtualDrive(scenario)
    drive.run(200)
    assert abs(currents(drive.record(1))[0]) > 3.0
    drive.write("control_word", 0)
    r = drive.record(200)
    ended = int(np.argmax(np.abs(currents(r)) < 1e-4))
    assert 0 < ended < 20
    assert np.abs(currents(r))[ended:].max() < 1e-4  # the back-EMF of 15 V is far below the dc link


@pytest.mark.parametrize(("u_transistor", "u_diode"), [(1.2, 1.2), (2.0, 0.8)])
def test_drops_and_on_resistance_show_as_dc_voltage_at_standstill(u_transistor: float, u_diode: float) -> None:
    """Transistor and diode of a leg share its current by the duty; the currents of b and c flow the other way."""
    r_on, i = 0.1, 4.0
    inverter = Inverter(0.0, 0.0, u_transistor, u_diode, r_on)
    r = steady(switched(with_effects(i_dq=complex(i), inverter=inverter)), 0.05, 0.02)
    u = float(r["u_d"].mean())
    d_a, d_bc = 0.5 + 0.75 * u / U_DC, 0.5 - 0.75 * u / U_DC
    lost_a = d_a * u_transistor + (1.0 - d_a) * u_diode
    lost_bc = d_bc * u_diode + (1.0 - d_bc) * u_transistor
    expected = 2.0 / 3.0 * (lost_a + lost_bc) + r_on * i
    assert complex(voltage_error(r, SALIENT).mean()) == pytest.approx(expected, rel=0.01)


def test_a_shortest_pulse_leaves_out_what_would_be_shorter() -> None:
    """Of the spread between highest and lowest duty: 1 - 2 pulses to 1 does not happen any more."""
    spreads: list[Column] = []
    for pulse in (0.0, 5e-6):
        inverter = Inverter(0.0, pulse)
        scenario = with_effects(motor=ROUND, run=at(320.0, ROUND), drive={"u_dc": 275.0}, inverter=inverter)
        r = steady(switched(scenario), 0.02, 0.1)
        spreads.append(spread(r) / 275.0)
    gap = [np.mean((s > 0.901) & (s < 0.999)) for s in spreads]
    assert gap[0] > 0.3
    assert gap[1] == 0.0
    assert np.mean(spreads[1] >= 0.999) > 0.1


def test_the_dc_link_sags_by_its_resistance_times_the_current_it_gives() -> None:
    R = 2.0
    r = steady(switched(with_effects(i_dq=6j, run=at(100.0), dc_link=DcLink(C=5e-4, R=R))), 0.1, 0.1)
    P = 1.5 * float(np.mean((voltages(r) * currents(r).conj()).real))
    u_dc = float(np.mean(r["u_dc"]))
    assert U_DC - u_dc > 4.0
    assert U_DC - u_dc == pytest.approx(R * P / u_dc, rel=0.01)


def test_the_dc_links_ripple_is_the_sources_behind_resistance_and_capacitor() -> None:
    link = DcLink(C=5e-4, R=2.0, ripple=10.0, frequency=200.0)
    r = steady(switched(with_effects(dc_link=link)), 0.1, 0.1)
    w = 2.0 * math.pi * link.frequency
    seen = 2.0 * line(r["u_dc"], w * r["t"], 1)
    assert abs(seen) == pytest.approx(link.ripple / math.hypot(1.0, w * link.R * link.C), rel=0.01)


def test_without_overmodulation_the_voltage_ends_at_the_circle_within_the_hexagon() -> None:
    scenario = switched(with_effects(motor=ROUND, i_dq=10j, run=free(200.0, ROUND)))
    r = steady(scenario, 0.0, 0.4)
    assert np.abs(voltages(r)).max() == pytest.approx(310.0 / math.sqrt(3.0), rel=1e-6)


def test_overmodulation_tries_more_and_the_legs_cut_it_off_at_the_hexagon() -> None:
    scenario = switched(with_effects(motor=ROUND, i_dq=10j, run=free(200.0, ROUND), drive={"overmodulation": True}))
    r = steady(scenario, 0.0, 0.4)
    assert spread(r).max() <= U_DC * (1.0 + 1e-9)
    assert U_DC / math.sqrt(3.0) * 1.02 < np.abs(voltages(r)).max() <= 2.0 / 3.0 * U_DC * (1.0 + 1e-9)


def test_a_steady_draw_takes_the_dc_link_down_as_a_capacitor_behind_a_resistance_goes() -> None:
    link, E, i, h = DcLink(C=1e-4, R=2.0), 300.0, 10.0, 1.5e-4
    expected = E - link.R * i * (1.0 - math.exp(-h / (link.R * link.C)))
    assert charged(link, E, E, i * h, 0.0, h) == pytest.approx(expected, rel=1e-12)
    assert charged(link, E, E, 1e3 * i * h, 0.0, h) > 0.0  # diodes hold an empty one


def test_braking_into_a_dc_link_that_takes_little_trips_for_overvoltage() -> None:
    run = Run(speed_rpm=1500.0)
    drive = VirtualDrive(switched(with_effects(i_dq=-8j, run=run, dc_link=DcLink(C=2e-4, R=50.0))))
    r = drive.record(1000)
    assert np.nanmax(r["u_dc"]) > 1.2 * U_DC
    assert drive.read("error_code") == OVERVOLTAGE
    assert np.abs(currents(r)[-100:]).max() < 0.1


def test_a_drive_that_reads_its_dc_link_as_none_goes_on_with_numbers() -> None:
    """The reading sinks below zero before the link does."""
    link, low = DcLink(C=2e-4, R=500.0), VoltageSensing(offset=-100.0)
    never = {"undervoltage_trip": 0.0}
    r = steady(
        switched(with_effects(i_dq=6j, run=at(50.0), drive=never, dc_link=link, voltage_sensing=low)), 0.0, 0.05
    )
    assert all(np.isfinite(column).all() for column in r.values())


def test_a_bridge_that_is_off_shows_no_current_to_a_channel_that_samples_late() -> None:
    skewed = CurrentSensing(skew_a=1e-5, skew_b=5e-6)
    drive = VirtualDrive(switched(with_effects(run=at(100.0), drive={"enabled": False}, current_sensing=skewed)))
    r = drive.record(50)
    assert max(float(np.abs(r[name]).max()) for name in ("i_a", "i_b", "i_c")) < 1e-3
