"""Disturbances of nobody's library against what they were told to be: stray voltage, telegraph offset, resonance."""

import math
from typing import Any

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.dynamics import advanced
from emulator.plant.physics.legs import vector as held
from emulator.plant.physics.strangers import Resonance, Stray, Telegraph
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    T_S,
    Column,
    Vectors,
    at,
    line,
    middle,
    steady,
    voltage_error,
    with_effects,
)

TURN = 2.0 * math.pi


def stationary_error(duration: float, **effects: Any) -> tuple[Column, Vectors]:
    """Time of the middle of each period (s) and the voltage (V) that no drive gave, in the stationary frame."""
    r = steady(with_effects(motor=ROUND, i_dq=2j, run=at(30.0), **effects), 0.1, duration)
    return r["t"][:-1] + 0.5 * T_S, -voltage_error(r, ROUND) * np.exp(1j * middle(r))


def test_a_stray_voltage_is_a_line_at_its_frequency_with_its_amplitude_along_its_direction() -> None:
    stray = Stray(amplitude=3.0, frequency=130.0, along_alpha=0.8, along_beta=-0.6)
    t, u = stationary_error(1.0001, stray=stray)
    for order in (1, -1):  # a voltage along a line is half a vector that turns on, and half one that turns back
        assert abs(line(u, TURN * 130.0 * t, order) - 1.5 * (0.8 - 0.6j)) < 0.03
    rest = u - 3.0 * (0.8 - 0.6j) * np.cos(TURN * 130.0 * t)
    assert np.abs(rest).max() < 0.1


def test_a_telegraph_offset_is_there_or_not_for_times_of_its_mean_dwell() -> None:
    telegraph = Telegraph(amplitude=2.0, dwell=0.005, direction=1.0)
    _, u = stationary_error(8.0, telegraph=telegraph)
    there = (u * np.exp(-1j)).real > 1.0
    assert u[there].mean() == pytest.approx(2.0 * np.exp(1j), abs=0.02)
    assert abs(u[~there].mean()) < 0.02
    dwells = np.diff(np.flatnonzero(np.diff(there.astype(int)))) * T_S
    n = len(dwells)
    assert n > 1000
    assert dwells.mean() == pytest.approx(0.005, rel=4.0 / math.sqrt(n))
    assert dwells.std() == pytest.approx(0.005, rel=8.0 / math.sqrt(n))  # as of an exponential distribution
    assert there.mean() == pytest.approx(0.5, abs=0.1)


def test_a_branch_at_the_terminals_rings_as_resistance_coil_and_capacitor_in_series_do() -> None:
    """A voltage step U: i = U / (w L) e^(-a t) sin(w t), a = R / (2 L), w^2 = 1 / (L C) - a^2."""
    branch, U, h = Resonance(C=20e-6, L=2e-3, R=1.0), 50.0, 1e-5
    drive = VirtualDrive(with_effects(motor=ROUND, resonance=branch))
    plant, state = drive.plant_now(), drive.plant
    a = branch.R / (2.0 * branch.L)
    w = math.sqrt(1.0 / (branch.L * branch.C) - a**2)
    for n in range(500):
        state = advanced(plant, held(complex(U), 310.0), n * h, h, 1, state)
        t = (n + 1) * h
        assert state.i_r.real == pytest.approx(U / (w * branch.L) * math.exp(-a * t) * math.sin(w * t), abs=1e-5)


def test_the_drives_currents_ring_with_the_branch_after_a_step() -> None:
    branch = Resonance(C=20e-6, L=2e-3, R=0.2)
    f = 1.0 / (TURN * math.sqrt(branch.L * branch.C))  # 796 Hz
    plain, with_branch = (
        VirtualDrive(with_effects(motor=ROUND, i_dq=5.0 + 0j, drive={"bandwidth": 200.0}, resonance=b)).record(500)
        for b in (Resonance(), branch)
    )
    spectrum = np.abs(np.fft.rfft((with_branch["i_d"] - plain["i_d"]) * np.hanning(500)))
    assert np.fft.rfftfreq(500, T_S)[np.argmax(spectrum[5:]) + 5] == pytest.approx(f, abs=40.0)
