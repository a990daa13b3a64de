"""A published matrix of what is not ideal in a drive, on the emulated one: 16 cells, and motors from its ranges.

terogra/self-commissioning-pmsm-drive, docs/nonideality_robustness_protocol.md: sizes and ranges are those of its table
and of its population. What is different here is told by `DIFFERENT`. Knows nothing of the diagnosis.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.recordings.foreign.content import NOTES
from drivers.wire.codec import channel_signal, count_size
from emulator.conceal.chance import Chance
from emulator.conceal.populations import KINDS
from emulator.conceal.recording import full_scales, recorded
from emulator.drive.virtual_drive import Column, VirtualDrive
from emulator.plant.inverter import longest
from emulator.plant.machine import Machine
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing
from emulator.plant.physics.thermal import Thermal
from emulator.plant.physics.timing import Timing
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import Drive, Excitation, Run, Scenario, check, drive_for
from emulator.scenario.text import section_text, text_of
from tests.score.truth import Size, Truth, truth_of

DIFFERENT: Final = (
    "The published commissioning has a locked rotor, one speed and a coast-down, and knows no motor beforehand; here "
    "it is one recording of 6 s at 10 kHz on a dynamometer whose speed swings, with steps of both currents, and a "
    "data sheet, as the diagnosis needs one, from which the motor is off by up to 10 %. J and B are drawn, not judged.",
    "The bridge switches; its drops soften below 1 % of rated current. The published one adds a mean voltage.",
    "A sagging bus costs reach alone, as there: duties follow from the voltage that the bus has.",
    "Harder here: R_s drifts within the recording, by copper loss, to 1.2 or 1.5 times what it was, and R_s at the "
    "start is the truth; the published one drifts after the commissioning, which sees nothing of it.",
    "Noise is on each phase current, 10 mA, before the converter; the published one is on d and q, after it. The "
    "published 10 mV of noise on the voltage is not there.",
)

U_DC: Final = 24.0  # V
T_S: Final = 1e-4  # s
LENGTH: Final = 6.0  # s
TOLERANCE: Final = 0.10  # of a data sheet
I_RATED: Final = 5.0  # A, the published limit of current references
_RANGES: Final = {
    "R_s": (0.35, 0.65), "L_d": (0.8e-3, 1.4e-3), "L_q": (0.7e-3, 1.3e-3), "psi_f": (0.015, 0.028), "J": (3e-4, 8e-4),
    "B": (0.8e-4, 2.5e-4),
}  # fmt: skip
_JUDGED: Final = ("R_s", "L_d", "L_q", "psi_f")
_EXCITATION: Final = Excitation(i_d_ref=-1.0, i_q_ref=0.5, i_d_step=2.0, i_q_step=3.5)  # A; up to rated current
_REACH: Final = 0.65  # of the voltage that there is, for the data sheet's motor
_SWING: Final = (0.3, 0.7, 0.5)  # mean and amplitude, of the fastest speed, and Hz
_RPM: Final = 2.0 * math.pi / 60.0  # rad/s
_HEAT_STAYS: Final = 1e5  # K/W


@dataclass(frozen=True, slots=True)
class Level:
    """Sizes of everything in the matrix."""

    gains: tuple[float, float, float]  # of the phase currents
    i_offsets: tuple[float, float, float]  # A
    i_bits: int  # of a converter whose step is the quantum
    i_quantum: float  # A
    u_gain: float  # of the recorded voltage
    u_offsets: tuple[float, float]  # V, on d and q
    u_quantum: float  # V
    angle: float  # rad, electrical
    drop: float  # V, by the sign of a phase's current
    sag: float  # of the dc link
    R_s: float  # times that at the start


MILD: Final = Level(
    (1.01, 0.99, 1.00), (0.002, -0.001, -0.001), 14, 0.002, 1.02, (0.005, -0.005), 0.005, math.radians(2.0), 0.030,
    0.05, 1.2,
)  # fmt: skip
STRONG: Final = Level(
    (1.16, 1.14, 1.15), (0.010, -0.015, 0.005), 12, 0.010, 1.12, (0.020, -0.020), 0.020, math.radians(6.0), 0.150,
    0.10, 1.5,
)  # fmt: skip
FAMILIES: Final = ("current", "voltage", "angle", "inverter", "bus sag", "R_s drift", "timing")


@dataclass(frozen=True, slots=True)
class Cell:
    """One of the matrix."""

    name: str
    families: tuple[str, ...]
    level: Level
    published: str  # what became of it: each of three motors

    def has(self, family: str) -> bool:
        """Whether a family is in it."""
        return family in self.families


def _cells() -> tuple[Cell, ...]:
    silent = ("current strong", "voltage strong", "inverter strong")
    cells = [Cell("ideal", (), MILD, "accurate")]
    for family in FAMILIES[:-1]:
        for name, level in ((f"{family} mild", MILD), (f"{family} strong", STRONG)):
            cells.append(Cell(name, (family,), level, "silently wrong" if name in silent else "accurate"))
    cells.append(Cell("timing", ("timing",), MILD, "rejected"))
    cells += [Cell(f"all {name}", FAMILIES, level, "rejected") for name, level in (("mild", MILD), ("strong", STRONG))]
    return tuple(cells)


CELLS: Final = _cells()


@dataclass(frozen=True, slots=True)
class Motor:
    """A motor and what its data sheet says."""

    number: int
    machine: Machine
    nominal: Machine
    seed: int  # of its recordings' noise and steps


@dataclass(frozen=True, slots=True)
class Made:
    """A recording on disk, and the truth about it."""

    name: str
    cell: Cell
    motor: Motor
    truth: Truth


def motor_of(seed: int, number: int) -> Motor:
    """A motor of the published ranges, by chance, each parameter within the tolerance of its data sheet."""
    chance = Chance(seed, number, "motor of the benchmark")
    machine = Machine(**{name: chance.uniform(*_RANGES[name]) for name in _RANGES}, n_p=4, i_rated=I_RATED)
    off = {name: chance.uniform(1.0 - TOLERANCE, 1.0 + TOLERANCE) for name in _JUDGED}
    nominal = machine._replace(**{name: getattr(machine, name) / factor for name, factor in off.items()})
    return Motor(number, machine, nominal, chance.seed())


def made(cell: Cell, motor: Motor, folder: Path, length: float = LENGTH) -> Made:
    """Record a cell with a motor, and write the recording and its machine file."""
    name, periods = f"{cell.name} motor {motor.number}".replace(" ", "_"), round(length / T_S)
    scenario = scenario_of(cell, motor)
    if cell.has("R_s drift"):
        scenario = _warming(scenario, cell, periods)
    check(scenario)
    columns = recorded(scenario, periods)
    steps = {column: count_size(channel_signal(column), full_scales(scenario)) for column in columns if column != "t"}
    if cell.has("voltage"):
        columns |= _misread(columns, cell.level)
        steps |= dict.fromkeys(("u_d", "u_q"), cell.level.u_quantum)
    _write(folder / f"{name}.parquet", columns, steps)
    (folder / f"{name}.toml").write_text(_data_sheet(motor.nominal), encoding="utf-8")
    return Made(name, cell, motor, _truth(cell, scenario, name, periods))


def scenario_of(cell: Cell, motor: Motor) -> Scenario:
    """All of a cell but what is of the recording alone, and R_s, which stays."""
    level = cell.level
    effects = NONE
    if cell.has("current"):
        effects = effects._replace(current_sensing=CurrentSensing(*level.gains, *level.i_offsets))
    if cell.has("angle"):
        effects = effects._replace(angle_sensing=AngleSensing(offset=level.angle / motor.machine.n_p))
    if cell.has("inverter"):
        effects = effects._replace(inverter=Inverter(u_transistor=level.drop, u_diode=level.drop))
    if cell.has("timing"):
        effects = effects._replace(timing=Timing(delay=1, shift=1))
    mean, swing, frequency = _SWING
    fastest = _fastest(motor.nominal)
    run = Run(speed_rpm=mean * fastest, swing_rpm=swing * fastest, swing_frequency=frequency, seed=motor.seed)
    return Scenario(cell.name, motor.machine, _drive(cell, motor), run, _EXCITATION, effects)


def _drive(cell: Cell, motor: Motor) -> Drive:
    """A drive for the data sheet's motor, with an ideal encoder; full scales must not tell of the true one."""
    level = cell.level
    drive = replace(
        drive_for(motor.nominal, U_DC, T_s=T_S, bridge="switched"), adc_bits=0, noise_i=0.01, temperature_trip=500.0
    )
    if cell.has("current"):
        drive = replace(drive, adc_bits=level.i_bits, adc_full=level.i_quantum * 2.0 ** (level.i_bits - 1))
    return replace(drive, u_dc=U_DC * (1.0 - level.sag)) if cell.has("bus sag") else drive


def _fastest(nominal: Machine) -> float:
    """Speed (rpm) up to which the excitation's corners need no more than a share of the voltage."""
    i_d, i_q = _EXCITATION.i_d_ref + _EXCITATION.i_d_step, _EXCITATION.i_q_ref + _EXCITATION.i_q_step
    for rpm in range(3000, 0, -10):
        omega_e = nominal.n_p * rpm * _RPM
        u_d = nominal.R_s * abs(i_d) + omega_e * nominal.L_q * i_q
        u_q = nominal.R_s * i_q + omega_e * (nominal.L_d * i_d + nominal.psi_f)
        if math.hypot(u_d, u_q) <= _REACH * longest(U_DC):
            return float(rpm)
    raise ValueError(f"expected a motor that turns at {U_DC:g} V, came {nominal}")


def _warming(scenario: Scenario, cell: Cell, periods: int) -> Scenario:
    """The scenario with a winding of such heat capacity that R_s ends at the level's multiple.

    C_w dT/dt = 3/2 R_s(T) i^2 with R_s = R_s0 (1 + alpha T): R_s/R_s0 = exp(3/2 R_s0 alpha / C_w * integral of i^2),
    at first for the currents that are commanded, whose levels have half the square of a step, then as it came out.
    """
    e, wanted = scenario.excitation, math.log(cell.level.R_s)
    squares = e.i_d_ref**2 + e.i_q_ref**2 + 0.5 * (e.i_d_step**2 + e.i_q_step**2)  # A2
    C_w = 1.5 * scenario.motor.R_s * Thermal().alpha * squares * periods * T_S / wanted
    came = VirtualDrive(_with_heat(scenario, C_w))
    came.record(periods)
    return _with_heat(scenario, C_w * math.log(came.truth.R_s / scenario.motor.R_s) / wanted)


def _with_heat(scenario: Scenario, C_w: float) -> Scenario:
    thermal = Thermal(C_w=C_w, R_wh=_HEAT_STAYS)
    return replace(scenario, effects=scenario.effects._replace(thermal=thermal))


def _misread(columns: Mapping[str, Column], level: Level) -> dict[str, Column]:
    """Voltages as the drive tells them: gain, offset and rounding on d and q."""
    return {
        name: np.round((level.u_gain * columns[name] + offset) / level.u_quantum) * level.u_quantum
        for name, offset in zip(("u_d", "u_q"), level.u_offsets, strict=True)
    }


_CLASSES: Final = {
    "current": ("current_gain", "current_offset"), "angle": ("angle_offset",), "inverter": ("drops",),
    "R_s drift": ("winding_heat",), "timing": ("voltage_early",),
}  # fmt: skip


def _truth(cell: Cell, scenario: Scenario, name: str, periods: int) -> Truth:
    """Effects by the names of the diagnosis; the one of a common gain of all voltages is the dc link's gain."""
    classes = [each for family in cell.families for each in _CLASSES.get(family, ())]
    kind = KINDS[min(len(classes), 3)]
    answer = {
        "recording": name, "kind": kind, "classes": classes, "periods": periods, "scenario": text_of(scenario),
    }  # fmt: skip
    truth = truth_of(answer)
    misread: dict[str, dict[str, Size]] = {}
    if cell.has("voltage"):
        gain, (d, q) = cell.level.u_gain, cell.level.u_offsets
        largest = max(abs(d), abs(q))
        offsets = {"offset_d": Size(d, largest, "V"), "offset_q": Size(q, largest, "V")}
        misread = {"dc_link_gain": {"gain": Size(gain, abs(gain - 1.0), "1")}, "voltage_offset": offsets}
    return replace(truth, effects={**truth.effects, **misread}, classes=(), subjects=())  # no class of a population


def _data_sheet(nominal: Machine) -> str:
    """The machine file of a user."""
    keys = {name: getattr(nominal, name) for name in (*_JUDGED, "n_p", "i_rated")}
    return section_text("machine", keys) + section_text("drive", {"T_s": T_S, "u_dc": U_DC})


def _write(path: Path, columns: Mapping[str, Column], steps: Mapping[str, float]) -> None:
    import pyarrow
    import pyarrow.parquet

    pa: Any = pyarrow  # comes without types
    pq: Any = pyarrow.parquet
    notes = {"T_s": T_S, "decimation": 1, "steps": dict(steps)}
    table = pa.table(dict(columns)).replace_schema_metadata({NOTES: json.dumps(notes).encode()})
    pq.write_table(table, path)
