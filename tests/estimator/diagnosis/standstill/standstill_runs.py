"""Recordings of the emulator's switched bridge before a locked motor: sine voltages, voltage pulses.

Only what a drive would record is handed on: duties, dc link, phase currents with noise.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emulator.frames import phases
from emulator.plant.bridge import Bridge, BridgeState, scratch, switched
from emulator.plant.dynamics import Plant, bridge_current
from emulator.plant.machine import Machine
from emulator.plant.modulation import Duties, modulated
from emulator.plant.physics.dc_link import DcLink
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import Effects
from estimator.diagnosis.standstill.pulse_fit import Train
from estimator.diagnosis.standstill.tones import Tone
from tests.emulator.plant.plants import LOCKED, at_rest, plant_with

SERVO = Machine(R_s=0.1, L_d=1.4e-4, L_q=1.5e-4, psi_f=0.01, n_p=4, i_rated=7.0)
SALIENT = Machine(R_s=0.15, L_d=2.2e-4, L_q=2.6e-4, psi_f=0.01, n_p=7, i_rated=10.0)
T, U_DC = 50e-6, 26.0
STEP = 5e-6  # s, of pulses
FREQUENCIES = (100.0, 160.0, 260.0, 400.0, 600.0, 900.0, 1300.0)
PERIODS, SETTLING = 5, 5e-3  # s
NOISE = 0.02  # A

Signal = NDArray[np.float64]


def bridge_with(inverter: Inverter) -> Bridge:
    """A bridge with edges, on a stiff dc link."""
    return Bridge(True, 0, inverter, DcLink(), U_DC, 0.05, 1e-9)


def sweep(
    effects: Effects | None = None, inverter: Inverter | None = None, *, gains: Sequence[float] = (1.0, 1.0, 1.0),
    amperes: float = 5.0, frequencies: Sequence[float] = FREQUENCIES, seed: int = 1,
) -> list[Tone]:  # fmt: skip
    """Sine voltages on the d axis of a motor that stands, each about as large as some current needs."""
    rng = np.random.default_rng(seed)
    plant = plant_with(SERVO, LOCKED, effects or Effects())
    return [_tone(plant, bridge_with(inverter or Inverter()), f, amperes, np.array(gains), rng) for f in frequencies]


def _tone(plant: Plant, bridge: Bridge, f: float, amperes: float, gains: Signal, rng: np.random.Generator) -> Tone:
    turns = math.ceil(SETTLING * f)
    rows = round((turns + PERIODS) / f / T)
    amplitude = min(abs(complex(0.3, 2.0 * math.pi * f * SERVO.L_d)) * amperes, 0.5 * U_DC)
    state, before = at_rest(plant), BridgeState(U_DC, False, False, False, 0.0, 0.0, 0.0)
    duties, currents, room = np.empty((rows, 3)), np.empty((rows, 3)), scratch()
    for k in range(rows):
        told = modulated(complex(amplitude * math.cos(2.0 * math.pi * f * k * T), 0.0), U_DC, 0)
        duties[k], currents[k] = told, phases(bridge_current(plant, state))
        before, state = switched(bridge, plant, told, True, k * T, T, 20, before, state, room)
    kept = slice(round(turns / f / T), rows)
    measured = gains * currents[kept] + rng.normal(0.0, NOISE, (rows - kept.start, 3))
    t = np.arange(kept.start, rows, dtype=np.float64) * T
    return Tone(f, T, t, duties[kept], np.full(len(t), U_DC), measured)


def pulses(
    effects: Effects | None = None, inverter: Inverter | None = None, *, machine: Machine = SALIENT, u_dc: float = U_DC,
    seed: int = 1,
) -> list[Train]:  # fmt: skip
    """Pulses of a phase before the two others, forth and back to some current, at angles of a held rotor."""
    rng = np.random.default_rng(seed)
    plant = plant_with(machine, LOCKED, effects or Effects())
    bridge = bridge_with(inverter or Inverter())
    turns = np.arange(1, 12) / (12.0 * machine.n_p)
    return [
        _train(plant, bridge, 2.0 * math.pi * float(turn), leg, way, u_dc, rng)
        for turn in turns for leg in range(3) for way in (1, -1)
    ]  # fmt: skip


def _train(
    plant: Plant, bridge: Bridge, angle: float, leg: int, way: int, u_dc: float, rng: np.random.Generator
) -> Train:
    """Forth, back, shorted, back, shorted, forth, shorted: states numbered, lengths in rows."""
    alone = tuple(float((k == leg) == (way > 0)) for k in range(3))
    others, short = tuple(1.0 - x for x in alone), (0.0, 0.0, 0.0)
    steps = [
        (alone, 1, 36), (others, -1, 34), (short, 0, 12), (others, -1, 36), (short, 0, 30), (alone, 1, 28),
        (short, 0, 12),
    ]  # fmt: skip
    state, before = at_rest(plant, angle), BridgeState(U_DC, False, False, False, 0.0, 0.0, 0.0)
    currents: list[tuple[float, ...]] = []
    room, k = scratch(), 0
    for told, _, rows in steps:
        for _ in range(rows):
            currents.append(tuple(phases(bridge_current(plant, state))))
            before, state = switched(bridge, plant, Duties(*told), True, k * STEP, STEP, 4, before, state, room)
            k += 1
    kinds = np.repeat(np.arange(len(steps)), [rows for _, _, rows in steps])
    sign = np.repeat([float(s) for _, s, _ in steps], [rows for _, _, rows in steps])
    i = np.array(currents) + rng.normal(0.0, 2.0 * NOISE, (len(kinds), 3))
    return Train(angle, STEP, kinds, sign, np.full(len(kinds), u_dc), i)
