"""The bridge's dead time and diodes beside a bridge worked out anew: phase by phase, in steps of 50 ns, by Euler.

Nothing of the emulator's equations is used: gates come from a sampled carrier and a counter, a leg that is off conducts
by the diode its current needs, and where that current is none every way the diodes may be is tried until one fits.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.drive.assembly import bench_of
from emulator.frames import phases
from emulator.plant.bridge import BridgeState, scratch, switched
from emulator.plant.dynamics import PlantState, bridge_current, settled, started
from emulator.plant.modulation import Duties
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.turn_short import TurnShort
from emulator.scenario.effects import NONE
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import PAPER, Run, Scenario, drive_for

pytestmark = pytest.mark.thorough

Column = NDArray[np.float64]

T = 1e-4  # s
DT = 5e-8
MOTOR = PAPER.motor
U_DC = 310.0
AXES: Column = np.array([0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0])
LOW, HIGH, OFF = 0, 1, 2


def gates(duties: list[tuple[float, float, float]], dead_time: float) -> NDArray[np.int64]:
    """LOW, HIGH or OFF of each leg in each small step: the carrier's command, off for a while after it changes."""
    n, pause = round(T / DT), round(dead_time / DT)
    carrier = np.abs(1.0 - 2.0 * (np.arange(n) + 0.5) / n)
    told = np.concatenate([(np.array(duty)[:, None] > carrier).astype(np.int64) for duty in duties], axis=1)
    seen = told.copy()
    for k in range(3):
        for edge in np.flatnonzero(np.diff(told[k], prepend=LOW)):
            seen[k, edge : edge + pause] = OFF
    return seen


def slope(i: Column, v: Column, theta: float, omega: float) -> Column:
    """di/dt of the phases (A/s) by the textbook's equations."""
    c, s = np.cos(theta - AXES), np.sin(theta - AXES)
    i_d, i_q, u_d, u_q = 2.0 / 3.0 * (c @ i), -2.0 / 3.0 * (s @ i), 2.0 / 3.0 * (c @ v), -2.0 / 3.0 * (s @ v)
    by_d = (u_d - MOTOR.R_s * i_d + omega * MOTOR.L_q * i_q) / MOTOR.L_d
    by_q = (u_q - MOTOR.R_s * i_q - omega * (MOTOR.L_d * i_d + MOTOR.psi_f)) / MOTOR.L_q
    return by_d * c - by_q * s - omega * (i_d * s + i_q * c)


def levels(gate: NDArray[np.int64], i: Column, drop: float, theta: float, omega: float) -> tuple[Column, list[int]]:
    """The legs' voltages, and which of them float."""
    low, high = -drop, U_DC + drop
    v = np.where(gate == HIGH, U_DC, 0.0)
    v = np.where((gate == OFF) & (i > 0.0), low, np.where((gate == OFF) & (i < 0.0), high, v))
    idle = [k for k in range(3) if gate[k] == OFF and i[k] == 0.0]
    ways = itertools.product(("floats", "low", "high"), repeat=len(idle))
    for way in sorted(ways, key=lambda names: sum(name != "floats" for name in names)):
        tried, free = v.copy(), [k for k, name in zip(idle, way, strict=True) if name == "floats"]
        for k, name in zip(idle, way, strict=True):
            tried[k] = high if name == "high" else low
        tried[free] = 0.0
        if free:  # the voltages at which these currents stay where they are
            by = np.array([slope(i, one, theta, omega) for one in np.eye(3)]) - slope(i, np.zeros(3), theta, omega)
            found = np.linalg.lstsq(by[np.ix_(free, free)].T, -slope(i, tried, theta, omega)[free], rcond=None)[0]
            tried[free] = found + (0.5 * (low + high - found.max() - found.min()) if len(free) == 3 else 0.0)
        moves = slope(i, tried, theta, omega)
        signs = {"floats": 0.0, "low": 1.0, "high": -1.0}
        if bool(np.all((tried >= low - 1e-6) & (tried <= high + 1e-6))) and all(
            signs[name] * moves[k] >= -1e-3 for k, name in zip(idle, way, strict=True)
        ):
            return tried, free
    raise AssertionError("no way for the diodes to be")


def by_small_steps(gate: NDArray[np.int64], i_dq: complex, omega: float, drop: float) -> tuple[Column, float]:
    """Currents (A) at the start of every period, and the charge (C) that the dc link has given."""
    theta, q = 0.0, 0.0
    i: Column = i_dq.real * np.cos(AXES) + i_dq.imag * np.sin(AXES)  # angle zero
    seen = [i]
    for n in range(gate.shape[1]):
        v, free = levels(gate[:, n], i, drop, theta, omega)
        new = i + DT * slope(i, v, theta, omega)
        new[free] = 0.0
        new[(gate[:, n] == OFF) & (i * new < 0.0)] = 0.0  # its diode blocks
        flows = np.flatnonzero(new)
        new[flows] -= new.sum() / max(len(flows), 1)
        if len(flows) == 1:
            new[:] = 0.0
        q += DT * float(0.5 * (i + new)[v > 0.5 * U_DC].sum())
        i, theta = new, theta + DT * omega
        if (n + 1) % round(T / DT) == 0:
            seen.append(i)
    return np.array(seen), q


def by_the_emulator(
    duties: list[tuple[float, float, float]], i_dq: complex, rpm: float, inverter: Inverter, powered: bool
) -> tuple[Column, float]:
    scenario: Scenario = replace(
        PAPER, run=Run(speed_rpm=rpm), drive=drive_for(MOTOR, U_DC, bridge="switched"),
        effects=NONE._replace(inverter=inverter),
    )  # fmt: skip
    bench, room = bench_of(scenario), scratch()
    state, bridge = started(bench.plant, 0.0, rpm * math.pi / 30.0, i_dq), BridgeState(U_DC, *[False] * 3, *[0.0] * 3)
    seen = [phases(bridge_current(bench.plant, state))]
    for n, duty in enumerate(duties):
        bridge, state = switched(
            bench.bridge, bench.plant, Duties(*duty), powered, n * T, T, bench.sub_steps, bridge, state, room
        )
        state = settled(bench.plant, (n + 1) * T, state)
        seen.append(phases(bridge_current(bench.plant, state)))
    return np.array(seen), state.q_dc


@pytest.mark.parametrize("dead_time", [2e-6, 1e-5])
@pytest.mark.parametrize("rpm", [0.0, 1500.0])
@pytest.mark.parametrize("i_dq", [0j, 0.3 - 0.2j, -2.0 + 3j])
def test_any_duties_with_dead_time_are_as_by_small_steps(dead_time: float, rpm: float, i_dq: complex) -> None:
    """Pulses shorter than the dead time, legs that stay low or high, and dead times across a period's end."""
    drawn = np.random.default_rng(round(1e6 * dead_time + rpm + 10.0 * abs(i_dq)))
    edge_cases = drawn.choice([0.0, 0.01, 0.03, 0.5, 0.51, 0.97, 0.99, 1.0], (3, 3))
    near_the_middle = np.round(0.5 + 0.03 * drawn.standard_normal((3, 3)), 3)
    duties: list[tuple[float, float, float]] = [tuple(row) for row in np.concatenate([edge_cases, near_the_middle])]
    expected, charge = by_small_steps(gates(duties, dead_time), i_dq, rpm * MOTOR.n_p * math.pi / 30.0, 0.0)
    found, drawn_charge = by_the_emulator(duties, i_dq, rpm, Inverter(dead_time), True)
    assert np.abs(found - expected).max() < 1e-3
    assert drawn_charge == pytest.approx(charge, rel=2e-3, abs=2e-8)


@pytest.mark.parametrize(("rpm", "i_dq"), [(4500.0, 0j), (9000.0, 13j), (-9000.0, -9.0 + 9j), (1200.0, 2.0 - 3j)])
def test_a_bridge_that_is_off_rectifies_as_by_small_steps(rpm: float, i_dq: complex) -> None:
    """At 9000 rpm the back-EMF drives a current through zero faster than the dc link alone could."""
    periods, drop = 8, 1.0
    off = np.full((3, periods * round(T / DT)), OFF)
    expected, charge = by_small_steps(off, i_dq, rpm * MOTOR.n_p * math.pi / 30.0, drop)
    found, drawn_charge = by_the_emulator([(0.0, 0.0, 0.0)] * periods, i_dq, rpm, Inverter(u_diode=drop), False)
    assert np.abs(found - expected).max() < 5e-3
    assert drawn_charge == pytest.approx(charge, rel=2e-3, abs=2e-8)


def test_no_current_flows_against_its_diode_however_fast_it_stops() -> None:
    """Shorted turns let a phase's current stop faster than dc link over inductance."""
    effects = NONE._replace(inverter=Inverter(u_diode=1.0), turn_short=TurnShort(share=0.5, R_t=0.02))
    motor = MOTORS["hbl48zl400"].machine
    scenario = replace(PAPER, motor=motor, drive=drive_for(motor, 48.0, bridge="switched"), effects=effects)
    bench, pause = bench_of(scenario), 2e-5

    def off(period: float, i_dq: complex) -> PlantState:
        """After the pause, in so short periods that an end is not missed."""
        room, bridge = scratch(), BridgeState(48.0, *[False] * 3, *[0.0] * 3)
        state = started(bench.plant, 0.0, 0.0, i_dq)
        for n in range(round(pause / period)):
            bridge, state = switched(
                bench.bridge, bench.plant, Duties(0.0, 0.0, 0.0), False, n * period, period, round(period / 5e-7),
                bridge, state, room,
            )  # fmt: skip
        return state

    for i_dq in (8.0 + 0j, -8.0 + 0j, 6.0 + 6j):
        whole, fine = off(pause, i_dq), off(1e-6, i_dq)
        assert abs(bridge_current(bench.plant, whole) - bridge_current(bench.plant, fine)) < 0.02
        assert whole.q_dc == pytest.approx(fine.q_dc, rel=0.01)
