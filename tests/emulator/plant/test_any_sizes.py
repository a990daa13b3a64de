"""Any sizes a scenario may have: what is not refused runs on finite numbers, and its power is balanced."""

import random
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from emulator.bounds import Bound, Points, PointsBound, ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run, Scenario, check, drive_for
from tests.emulator.plant.test_energy import BAR, imbalances

KINDS: dict[str, Any] = {name: kind for name, kind in get_type_hints(Effects).items() if name != "flux_map"}
WANTED, MOST_TRIES, PERIODS = 12, 60, 300


def drawn_size(drawn: random.Random, kind: type, bound: Bound | PointsBound, default: Any) -> float | Points:
    """Anywhere within its bound; where that is open, up to a hundred times more or less than its default."""
    if isinstance(bound, PointsBound):
        low, high = bound.second.low or 0.0, bound.second.high or 0.0
        return tuple((0.01 * n, drawn.uniform(low, high)) for n in range(3))
    low = bound.low if bound.low is not None else bound.above
    high = bound.high if bound.high is not None else bound.below
    if kind is int:
        return drawn.randint(int(low or 0), int(high or 0))
    if low is not None and high is not None:
        return drawn.uniform(low, high) if drawn.random() < 0.8 else drawn.choice([low, high])
    size = (abs(default) or 1.0) * 10.0 ** drawn.uniform(-3.0, 2.0)
    return size if low is not None else drawn.choice([-1.0, 1.0]) * size


def drawn_scenario(drawn: random.Random) -> Scenario:
    name = drawn.choice(list(MOTORS))
    published = MOTORS[name]
    motor, i = published.machine, published.machine.i_rated
    effects = NONE
    for effect, kind in KINDS.items():
        if drawn.random() < 0.7:
            continue
        sizes: dict[str, float | Points] = {}
        for key, hint in get_type_hints(kind, include_extras=True).items():
            if drawn.random() < 0.7:
                of, bound = get_args(hint)
                sizes[key] = drawn_size(drawn, of, bound, kind._field_defaults[key])
        effects = effects._replace(**{effect: kind(**sizes)})
    bridge = drawn.choice(["averaged", "switched", "switched"])
    if bridge == "averaged":
        effects = effects._replace(inverter=NONE.inverter, dc_link=NONE.dc_link)
    free = drawn.random() < 0.5
    run = Run(
        shaft="free" if free else "dynamometer", speed_rpm=drawn.uniform(-1.0, 1.0) * published.speed_rpm,
        speed_control=free and drawn.random() < 0.5, seed=drawn.randint(1, 1000),
    )  # fmt: skip
    excitation = Excitation(drawn.uniform(-0.5, 0.2) * i, drawn.uniform(-1.0, 1.0) * i, 0.2 * i, 0.2 * i)
    drive = drive_for(
        motor, published.u_dc, T_s=published.T_s, bridge=bridge, sub_steps=drawn.choice([2, 5, 10, 20]),
        timer_counts=drawn.choice([0, 5000]), overmodulation=bridge == "switched" and drawn.random() < 0.3,
        enabled=drawn.random() < 0.9,
    )  # fmt: skip
    return Scenario(name, motor, drive, run, excitation, effects)


def admitted(drawn: random.Random) -> Scenario | None:
    scenario = drawn_scenario(drawn)
    try:
        check(scenario)
    except ScenarioError as error:
        assert "\n" not in str(error)
        return None
    return scenario


@pytest.mark.parametrize("seed", range(4))
def test_any_sizes_are_refused_or_run_on_finite_numbers_and_balanced_power(seed: int) -> None:
    drawn = random.Random(seed)
    tried = [admitted(drawn) for _ in range(MOST_TRIES)]
    scenarios = [scenario for scenario in tried if scenario is not None][:WANTED]
    assert len(scenarios) == WANTED
    for scenario in scenarios:
        drive = VirtualDrive(scenario)
        electrical, mechanical, turned_over = imbalances(drive, PERIODS)
        least = 1e-3 * scenario.motor.psi_f * scenario.motor.i_rated  # J: nothing is balanced to better than this
        assert abs(electrical) < BAR * turned_over + least, scenario
        assert abs(mechanical) < BAR * turned_over + least, scenario
        r = drive.record(20)
        assert all(np.isfinite(r[name]).all() for name in r if name not in ("u_d", "u_q")), scenario
