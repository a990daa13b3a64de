"""Rows that skip control periods, of drives drawn anew: `python -m tests.bars.estimator.bench_skipping_rows [DRIVES]`.

Of each drive, 6 s of all control periods, in levels of 10 to 50 ms, one row in 5, 10 and 20 is kept. Printed: how
many parameters are told, how many of these within half a per cent or two standard errors, and how often 95 % intervals
hold the truth. Status 1 where a bar is missed.
"""

import sys
from dataclasses import replace
from typing import Final

import numpy as np

from emulator.conceal.recording import Choice, drawn
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Scenario
from estimator.interval import Z_95
from estimator.machine import PARAMETERS
from estimator.online import skipping_rows
from estimator.online.estimate import Status
from estimator.samples import Samples
from tests.proof.results import record

SEED: Final = 1017
DRIVES: Final = 60
ONE_IN: Final = (5, 10, 20)
STEPS: Final = (0.01, 0.02, 0.05)  # s
PERIODS: Final = 60_000
WITHIN: Final = 5e-3
BARS: Final = (0.98, 0.93)  # within that or two standard errors; in 95 % intervals


def drive(number: int) -> Scenario:
    """A healthy drive of the population, in levels."""
    there, _ = drawn(Choice(SEED, ("none",), (0.0, 1.0), tuple(MOTORS), 0.1), number)
    excitation = replace(there.scenario.excitation, kind="levels", step_time=STEPS[number % len(STEPS)])
    return replace(there.scenario, excitation=excitation)


def off(scenario: Scenario) -> list[tuple[float, float]]:
    """Of each parameter that is told: its error and its standard error, shares of its value."""
    columns, T_s, found = VirtualDrive(scenario).record(PERIODS), scenario.drive.T_s, list[tuple[float, float]]()
    names = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
    for one_in in ONE_IN:
        theta_e, omega_e, i_d, i_q, u_d, u_q = (np.ascontiguousarray(columns[name][::one_in]) for name in names)
        samples = Samples(theta_e, omega_e, i_d, i_q, u_d, u_q, T_s, one_in)
        state = skipping_rows.finish(skipping_rows.update(skipping_rows.init(T_s), samples))
        for name, e in skipping_rows.estimate(state).result.estimates.items():
            if e.status is Status.OK and e.value is not None and e.std is not None:
                true = getattr(scenario.motor, name)
                found.append((e.value / true - 1.0, e.std / true))
    return found


def main() -> int:
    """Draw, estimate, count."""
    drives = int(sys.argv[1]) if len(sys.argv) > 1 else DRIVES
    each = [one for number in range(1, drives + 1) for one in off(drive(number))]
    error = np.array([abs(one) for one, _ in each])
    std = np.array([one for _, one in each])
    asked = drives * len(ONE_IN) * len(PARAMETERS)
    right, covered = float(np.mean(error < np.maximum(WITHIN, 2.0 * std))), float(np.mean(error < Z_95 * std))
    held = bool(right >= BARS[0] and covered >= BARS[1])
    figure = (
        f"{len(each)} of {asked} told, {right:.1%} of them within 0.5 % or two standard errors (median error "
        f"{np.median(error):.2%}); {covered:.1%} in 95 % intervals"
    )
    print(figure)
    record("estimates.skipping", figure, held)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
