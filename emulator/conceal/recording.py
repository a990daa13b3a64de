"""A concealed recording: drawn from a seed and a number, and run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.wire.codec import FullScales, counts_to_si, si_to_counts
from emulator.bounds import ScenarioError
from emulator.conceal.chance import Chance
from emulator.conceal.measuring_chain import MeasuringChain, drawn_chain
from emulator.conceal.population import Setting
from emulator.conceal.populations import POPULATIONS, chosen, merged
from emulator.conceal.runs import Drawn, drawn_run
from emulator.drive.simulation import RECORDED
from emulator.drive.virtual_drive import Column, VirtualDrive
from emulator.scenario.effects import effects_from_table
from emulator.scenario.scenarios import Scenario, check

_RUNS = 4  # drawn at most: a run that no size can be had in is given up
_SIZES = 6  # drawn at most per run


@dataclass(frozen=True, slots=True)
class Choice:
    """What a suite is drawn from."""

    seed: int
    kinds: tuple[str, ...]  # kinds or classes, each as likely as the others
    window: tuple[float, float]  # part of each range, 0 to 1
    motors: tuple[str, ...]
    length: float  # s
    chain: bool = False  # a measuring chain is drawn for each
    current_sensors: int = 0  # of each; 0: as many as its chain has, three without one


@dataclass(frozen=True, slots=True)
class Concealed:
    """What a recording holds, and what nobody is told."""

    number: int
    kind: str
    classes: tuple[str, ...]  # none, or the effects' names
    sizes: Mapping[str, float]  # of each class, as its population tells them
    scenario: Scenario
    drawn: Drawn
    periods: int
    redrawn: int  # sizes and runs that a check refused or that ended in a fault


def drawn(choice: Choice, number: int) -> tuple[Concealed, Mapping[str, Column]]:
    """A recording and its columns, decided by the choice and the number alone.

    Sizes that cannot be or that make the drive trip are drawn anew, and after some of these the run.
    """
    chance = Chance(choice.seed, number, "class")
    kind = chance.one_of(choice.kinds)
    chain = drawn_chain(Chance(choice.seed, number, "chain")) if choice.chain else MeasuringChain(3, ())
    sensors = choice.current_sensors or chain.current_sensors
    own = chosen(kind, chance)
    classes = (*own, *chain.beside(own))
    for attempt in range(_RUNS * _SIZES):
        run = drawn_run(Chance(choice.seed, number, f"run {attempt // _SIZES}"), choice.motors, choice.length)
        run = replace(run, drive=replace(run.drive, current_sensors=sensors))
        try:
            concealed = _sized(choice, number, attempt, kind, classes, run)
            return concealed, recorded(concealed.scenario, concealed.periods)
        except (ScenarioError, TripError):
            continue
    raise ScenarioError(
        f"recording {number}: none of {_RUNS * _SIZES} draws of {' and '.join(classes) or 'no effect'} "
        "is one that the drive can do"
    )


class TripError(Exception):
    """The drive went into fault within a recording."""


def recorded(scenario: Scenario, periods: int) -> dict[str, Column]:
    """The columns of a recording, as the 16-bit counts of the wire. Raises TripError."""
    drive = VirtualDrive(scenario)
    columns = drive.record(periods)
    if drive.read("error_code") or not all(bool(np.all(np.isfinite(column))) for column in columns.values()):
        raise TripError
    names = [name for name in RECORDED if name != "t"]
    counts = si_to_counts([columns[name] for name in names], names, full_scales(scenario))
    values = counts_to_si(counts, names, full_scales(scenario))
    return {"t": columns["t"]} | dict(zip(names, values, strict=True))


def full_scales(scenario: Scenario) -> FullScales:
    """Of the counts."""
    drive = scenario.drive
    return {"i_full": drive.i_full, "u_full": drive.u_full, "omega_full": drive.omega_full}


def _sized(
    choice: Choice, number: int, attempt: int, kind: str, classes: Sequence[str], run: Drawn
) -> Concealed:
    """The run with sizes for its classes. Raises ScenarioError where they cannot be."""
    drive = run.drive
    setting = Setting(run.machine, run.omega_e, drive.u_dc, drive.T_s, choice.length, drive.current_sensors)
    sizes: dict[str, float] = {}
    parts = [run.surroundings]
    for name in classes:
        chance = Chance(choice.seed, number, f"size {name} {attempt}")
        sizes[name] = POPULATIONS[name].drawn(chance, choice.window)
        parts.append(POPULATIONS[name].sizes(sizes[name], setting, chance))
    name = f"recording {number}"
    effects = effects_from_table(merged(parts), f"{name}: effects.", Path())
    if effects.hall.rate:
        drive = replace(drive, encoder_counts=0)
    scenario = Scenario(name, run.machine, drive, run.run, run.excitation, effects)
    check(scenario)
    periods = round(choice.length / run.drive.T_s)
    return Concealed(number, kind, tuple(classes), sizes, scenario, run, periods, attempt)
