"""Speed of the plant: `python -m tests.bars.bench_plant`, times real time on one core, by effect, and beside its peers.

A second of the paper's drive at 10 kHz: firmware, sensors, stream and plant, with five integration steps or more a
control period; what that leaves out is measured beside it, against forty. Machines are noisy: the best of several
runs counts for ours, one run for the peers, and what is compared was measured in one run. Ends with 1 where a bar is
missed.
"""

import sys
import time

import numpy as np

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER_RUN, Scenario
from tests.emulator.plant.physics.effects import ALL, only, scenario_with
from tests.peers.speed import real_time_factors
from tests.proof.results import record

PERIODS = 10_000  # one second
REPEATS = 5
SUB_STEPS, FINE = 5, 40
BARS = {"all effects": 8.0, "over motulator": 50.0}


def real_time_factor(scenario: Scenario) -> float:
    """Simulated over computing time."""
    drive = VirtualDrive(scenario)
    drive.warm_up()
    taken = list[float]()
    for _ in range(REPEATS):
        begun = time.perf_counter()
        drive.run(PERIODS)
        taken.append(time.perf_counter() - begun)
    return PERIODS * drive.T_s / min(taken)


def left_out(effects: Effects) -> float:
    """What the steps leave out of the sampled currents, A rms: without noise and a timer's counts, which tip over."""
    i = dict[int, np.ndarray]()
    for sub_steps in (SUB_STEPS, FINE):
        drive = VirtualDrive(scenario_with(effects, sub_steps=sub_steps, timer_counts=0, noise_i=0.0, adc_bits=0))
        recording = drive.record(1000)
        i[sub_steps] = recording["i_d"] + 1j * recording["i_q"]
    return float(np.sqrt(np.mean(np.abs(i[SUB_STEPS] - i[FINE]) ** 2)))


def main() -> int:
    """All of it; about a minute."""
    sets: dict[str, Scenario] = {
        "averaged, no effect": scenario_with(NONE, bridge="averaged", sub_steps=SUB_STEPS),
        "edges, no effect": scenario_with(NONE, sub_steps=SUB_STEPS),
    }
    single = [name for name in Effects._fields if only(name) != NONE]
    sets |= {f"edges, {name}": scenario_with(only(name), sub_steps=SUB_STEPS) for name in single}
    sets["edges, all effects"] = scenario_with(ALL, sub_steps=SUB_STEPS)
    print(f"A second of {PAPER_RUN.name} at 10 kHz, {SUB_STEPS} sub-steps or more, one core: "
          "times real time")  # fmt: skip
    factors = dict[str, float]()
    for name, scenario in sets.items():
        factors[name] = real_time_factor(scenario)
        print(f"  {name:<36}{factors[name]:>8.1f}", flush=True)
    print("  left out by so few sub-steps, of currents of 3 A: "
          f"{left_out(NONE):.1e} A without effects, {left_out(ALL):.1e} A with all")  # fmt: skip
    peers = real_time_factors(PERIODS)
    print("\nThe same second of a 2.2 kW motor's drive, in one run with its peers")
    for name, factor in peers.items():
        print(f"  {name:<36}{factor:>8.3g}")

    averaged, edges = (peers[f"ours, {bridge}"] / peers[f"motulator, {bridge}"] for bridge in ("averaged", "edges"))
    found = {"all effects": factors["edges, all effects"], "over motulator": min(averaged, edges)}
    print()
    for name, bar in BARS.items():
        verdict = "met" if found[name] >= bar else "MISSED"
        print(f"  {name}: {found[name]:.3g}, bar {bar:g}: {verdict}")
    held = all(found[name] >= bar for name, bar in BARS.items())
    none, every = factors["edges, no effect"], factors["edges, all effects"]
    record("plant.speed", f"{none:.0f}; {every:.1f}; {averaged:.0f}; {edges:.0f}", held)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
