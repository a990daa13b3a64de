"""The oracle: the smallest size of a class that could be seen in a recording by who knows all but whether it is there.

`python -m tests.score.oracle --answers DIR [--json OUT] [--jobs N]`

It runs an answer's scenario twice more with ideal sensors, without any effect but the surroundings and with that class
alone, and takes for the class's signal `s` what changes in that which the true textbook machine does not foresee: white
innovations of a Kalman filter that knows the noise. Neyman and Pearson's test correlates them with those of the
recording; no other test of one false alarm in a hundred misses fewer. It misses one in a hundred where the signal's
energy over noise is

    lam = s' C^-1 s = (2 x 2.326)^2 = 21.6        C = 1 + J P J'

which an effect in proportion to its size reaches at

    limit = size sqrt(21.6 / lam)

The size that is run is a tenth of the limit to three limits, so that the proportion holds.

What is assumed: shape and sign of the effect are known, its shape parameters too, and where in the recording it acts;
the size alone is not. R_s, L_d, L_q and psi_f are unknown, normal about the data sheet's values with the deviation of a
number anywhere within its tolerance (P; J: their effect on the innovations), so what looks like another motor of the
series is no evidence. So is the angle, by half a count of the encoder: nobody knows how it rounds, nor aligns it more
closely. All else is known: bridge, dc link, shaft, the measuring chain, and that there is no other effect. Noise is
normal and white: of the phase currents with the converter's rounding, of which two sensors make more in one direction
than across, of the encoder's counts and of the 16-bit counts of angle, currents and voltages. Rows that a recording
lost are taken for there.

Where it is poor: the encoder's rounding is no white noise at speeds of less than a count a period, or of a whole number
of them, nor is the converter's where noise is small against its step; where the shaft is free, a speed that changes
within a period is taken for steady (`lack`: what that leaves, and a dc link that sags, is taken off both runs); a
voltage early or late by one period is no small effect at all, its limit is a share of a period, and so is that of a
filter or a tracking loop one of the whole; of several effects each limit is that of the effect alone beside the
measuring chain, so those that look alike are harder to tell than it says.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from drivers.wire.codec import channel_signal, count_size
from emulator.conceal.chance import Chance
from emulator.conceal.measuring_chain import CHAIN
from emulator.conceal.population import Sections, Setting
from emulator.conceal.populations import POPULATIONS, merged
from emulator.conceal.recording import full_scales
from emulator.drive.virtual_drive import Column, VirtualDrive
from emulator.scenario.effects import effects_from_table
from emulator.scenario.motors import MOTORS, TOLERANCE
from emulator.scenario.scenarios import Scenario, parse
from tests.score.innovations import Array, Noise, innovations

NEEDED: Final = (2.0 * 2.326348) ** 2  # signal energy over noise for 1 % false alarms and 1 % misses
_PARAMETERS: Final = ("R_s", "L_d", "L_q", "psi_f")
_PRIOR: Final = TOLERANCE / math.sqrt(3.0)  # deviation of a number anywhere within the tolerance
_STEP: Final = 1e-4  # of a parameter, for a derivative
_TURN: Final = 1e-4  # rad, likewise
_RPM: Final = 2.0 * math.pi / 60.0  # rad/s
_FITS: Final = 6  # of the parameters at most, each about the one before
_SETTLED: Final = 1e-3  # of the energy, by which a fit still changes it
_B: Final = complex(-0.5, 0.5 * math.sqrt(3.0))  # direction of phase b
_ROUNDED: Final = 1.0 / 12.0  # variance of a number rounded to 1

_FIRST: Final = 0.005  # of a size, that is run first
_LOW, _SMALL = 0.1, 3.0  # limits: a size that is run is between
_LEAST: Final = 1e-3  # of a size, that is run after it
_NOTHING: Final = 1e-12  # of it, at which one gives up
_SHIFTS: Final = {"voltage_early": 1, "voltage_late": -1}  # classes of one size: the row whose voltage a row has
BY_SHARE: Final = ("currents_averaged", "currents_filtered", "angle_tracked")  # classes that no drive has little of


class Oracle:
    """What one recording could show."""

    def __init__(self, answer: Mapping[str, Any]) -> None:
        self._answer = answer
        self.scenario: Final = parse(answer["scenario"], f"recording {answer['recording']}")
        self._without: dict[str, tuple[Mapping[str, Column], Array]] = {}

    @property
    def lack(self) -> float:
        """lam of what the oracle's own machine lacks where there is no effect."""
        errors, change = whitened(self._bare("")[0], self.scenario)
        return float(errors @ weights(errors, change))

    def over_limit(self, name: str) -> float:
        """Size over limit of a class that the recording has."""
        size = self._drawn(name)
        return size / self.limit(name, size)

    def _drawn(self, name: str) -> float:
        return float(self._answer["sizes"][name]["value"])

    def _bare(self, name: str) -> tuple[Mapping[str, Column], Array]:
        """The run without any effect but the surroundings and the measuring chain, which a class of that name is no
        part of, and its innovations.
        """
        beside = name if name in CHAIN else ""
        if beside not in self._without:
            columns = self._run({}, name)
            self._without[beside] = columns, whitened(columns, self.scenario)[0]
        return self._without[beside]

    def limit(self, name: str, size: float) -> float:
        """Smallest size of a class that can be seen. `size`: one from a part of which on it is sought.

        Not a number where every size does.
        """
        x, nothing, low = _FIRST * size, _NOTHING * size, _LOW
        while not low * (limit := self._limit(name, x)) <= x <= _SMALL * limit:
            low = 0.0  # up once, and from there down
            x = min(max(0.5 * _SMALL * limit, _LEAST * x), size)
            if x < nothing:
                return math.nan
        return limit

    def signal(self, name: str, x: float) -> tuple[Array, Array]:
        """What a class of a size changes in the innovations of the true machine; J of that run."""
        errors, change = whitened(self.with_size(name, x), self.scenario)
        return errors - self._bare(name)[1], change

    def _limit(self, name: str, x: float) -> float:
        """By the energy that no machine of the series takes away, its parameters in deviations from the true ones.

        Zero where the size is too large for any innovations to be told.
        """
        columns, least, before = self.with_size(name, x), math.inf, math.inf
        off: Array = np.zeros(len(_PARAMETERS) + 1)
        last = off
        for _ in range(_FITS):
            with np.errstate(over="ignore", invalid="ignore"):  # of a machine that is none
                errors, J = whitened(columns, self.scenario, off)
                changed = errors - self._bare(name)[1]
                there = float(changed @ changed + off @ off)
            if not there < least:  # too far, or another machine's filter went astray
                off = 0.5 * (last + off)
                continue
            signal, least, last = changed - off @ J, there, off
            off = np.asarray(-np.linalg.solve(np.eye(len(J)) + J @ J.T, J @ signal), np.float64)
            left = signal + off @ J
            energy = float(left @ left + off @ off)
            if abs(energy - before) <= _SETTLED * energy:
                return x * math.sqrt(NEEDED / energy)
            before = energy
        return x * math.sqrt(NEEDED / least)

    def with_size(self, name: str, x: float) -> Mapping[str, Column]:
        """The recording's run by ideal sensors with one class alone beside its measuring chain."""
        bare = self._bare(name)[0]
        if name in _SHIFTS:
            share = {key: np.roll(bare[key], -_SHIFTS[name]) - bare[key] for key in ("u_d", "u_q")}
            return {**bare, **{key: bare[key] + x * value for key, value in share.items()}}
        if name in BY_SHARE:
            size = self._drawn(name)
            whole = self._run(self.sections(name, size), name)
            return {key: column + x / size * (whole[key] - column) for key, column in bare.items()}
        return self._run(self.sections(name, x), name)

    def sections(self, name: str, x: float) -> Sections:
        """A class's effects of a size in this recording: as drawn but for the size."""
        answer, scenario = self._answer, self.scenario
        chance = Chance(answer["seed"], answer["number"], f"size {name} {answer['redrawn']}")
        POPULATIONS[name].drawn(chance)  # takes its number
        drive = scenario.drive
        omega_e = MOTORS[answer["motor"]].speed_rpm * _RPM * scenario.motor.n_p
        length = answer["periods"] * drive.T_s
        setting = Setting(scenario.motor, omega_e, drive.u_dc, drive.T_s, length, drive.current_sensors)
        return POPULATIONS[name].sizes(x, setting, chance)

    def chain(self, name: str) -> Sections:
        """The measuring chain beside a class, which is no part of it."""
        classes = [one for one in self._answer["classes"] if one in CHAIN and one != name]
        return merged([self.sections(one, self._drawn(one)) for one in classes])

    def _run(self, sections: Sections, name: str) -> dict[str, Column]:
        """`name`: of the class that the sections are, which is no part of the measuring chain then."""
        effects = effects_from_table(merged([self._surroundings(), self.chain(name), sections]), "", Path())
        drive = replace(self.scenario.drive, noise_i=0.0, adc_bits=0, encoder_counts=0)
        return VirtualDrive(replace(self.scenario, drive=drive, effects=effects)).record(self._answer["periods"])

    def _surroundings(self) -> Sections:
        """But for lost rows."""
        found: Sections = {}
        for section, keys in self._answer["surroundings"].items():
            if section != "timing":
                sizes = getattr(self.scenario.effects, section)
                found[section] = {key: getattr(sizes, key) for key in keys}
        return found


def noise_of(scenario: Scenario) -> Noise:
    """What is known of the noise."""
    drive, full = scenario.drive, full_scales(scenario)
    adc = drive.adc_full / 2.0 ** (drive.adc_bits - 1) if drive.adc_bits else 0.0
    count = count_of(scenario)
    told = {name: count_size(channel_signal(name), full) for name in ("i_d", "u_d", "theta_e")}
    phase, two = drive.noise_i**2 + _ROUNDED * adc**2, drive.current_sensors == 2
    return Noise(  # of a, b and c, or of a and b alone, where a vector is (2 a - b - c) / 3 + j (b - c) / sqrt(3)
        (4.0 if two else 2.0) / 3.0 * phase + _ROUNDED * told["i_d"] ** 2,
        2.0 / 3.0 * phase * _B if two else 0j,
        _ROUNDED * (count**2 + told["theta_e"] ** 2),
        _ROUNDED * told["u_d"] ** 2,
    )


def whitened(columns: Mapping[str, Column], scenario: Scenario, off: Array | None = None) -> tuple[Array, Array]:
    """White innovations of a machine (m), and their change by a deviation of each parameter and of the angle (5 x m).

    The machine is the true one, or `off` by so many deviations in each.
    """
    true = np.array([getattr(scenario.motor, name) for name in _PARAMETERS])
    away = np.zeros(len(true) + 1) if off is None else off
    told = true * (1.0 + _PRIOR * away[:-1])
    machines = np.vstack([true, told, told + _STEP * np.diag(true)])
    half = 0.5 * count_of(scenario)

    def seen(machines: Array, angle: float) -> Array:
        rows = [columns["theta_e"]]
        for d, q in (("i_d", "i_q"), ("u_d", "u_q")):
            vector = (columns[d] + 1j * columns[q]) * np.exp(-1j * angle)
            rows += [vector.real, vector.imag]
        return innovations(np.array([*rows, columns["u_dc"]]), scenario.drive.T_s, machines, noise_of(scenario))

    errors = seen(machines, half * float(away[-1]))
    by_machine = (errors[2:] - errors[1]) * (_PRIOR / _STEP)
    turned = seen(machines[:2], half * float(away[-1]) + _TURN)
    return errors[1], np.vstack([by_machine, (turned[1] - errors[1]) * (half / _TURN)])


def count_of(scenario: Scenario) -> float:
    """The encoder's count as an electrical angle, rad."""
    counts = scenario.drive.encoder_counts
    return 2.0 * math.pi / counts * scenario.motor.n_p if counts else 0.0


def weights(signal: Array, change: Array) -> Array:
    """C^-1 s: what the test correlates innovations with."""
    J = change
    return signal - np.linalg.solve(np.eye(len(J)) + J @ J.T, J @ signal) @ J


def limits(answers: Iterable[Mapping[str, Any]], jobs: int = 1) -> dict[str, dict[str, float]]:
    """Size over limit by recording and class; no class of which no limit is known."""
    asked = list(answers)
    if jobs == 1:
        return {answer["recording"]: _of(answer) for answer in asked}
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        return {answer["recording"]: each for answer, each in zip(asked, pool.map(_of, asked), strict=True)}


def _of(answer: Mapping[str, Any]) -> dict[str, float]:
    if not answer["classes"]:
        return {}
    oracle = Oracle(answer)
    ratios = {name: oracle.over_limit(name) for name in answer["classes"]}
    return {name: ratio for name, ratio in ratios.items() if math.isfinite(ratio)}


def answers_in(folder: Path) -> list[dict[str, Any]]:
    """All answers of a suite, by name."""
    paths = sorted(folder.glob("[0-9]*.json"))
    return [cast(dict[str, Any], json.loads(path.read_text(encoding="utf-8"))) for path in paths]


def main() -> int:
    """Print the median size in limits by class; write all to a file."""
    parser = argparse.ArgumentParser("python -m tests.score.oracle", description="detection limits of a suite")
    parser.add_argument("--answers", type=Path, required=True, metavar="DIR")
    parser.add_argument("--json", type=Path, metavar="OUT", help="size over limit by recording and class")
    parser.add_argument("--jobs", type=int, default=2, metavar="N")
    options = parser.parse_args()
    found = limits(answers_in(options.answers), options.jobs)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(f"{'class':21}{'number':>7}{'size over limit: median':>25}{'min':>9}{'max':>9}{'below 1':>9}{'below 3':>9}")
    for name in POPULATIONS:
        ratios = np.array([each[name] for each in found.values() if name in each])
        if len(ratios):
            print(
                f"{name:21}{len(ratios):7}{np.median(ratios):25.3g}{ratios.min():9.2g}{ratios.max():9.3g}"
                f"{np.sum(ratios < 1.0):9}{np.sum(ratios < 3.0):9}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
