"""First starts of motors that nobody knows: how many are right, or refused, and how far any of them was moved.

`python -m tests.bars.bench_first_start [--count 50] [--seed 1]`

Each is an emulated drive, a process on a link of its own: a motor of the catalogue with pole pairs drawn from 1 to 30,
phases crossed or not, an encoder that counts down or not, mounted anywhere, with friction, cogging and a load drawn.
Right is who controls the motor afterwards by the right angle: within 3 degrees (electrical), or what it says of itself.
The shaft is looked at in the drive's own process, not by the encoder.
"""

import argparse
import json
import math
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bench.actions.safety.under_control import under_control
from bench.actions.safety.unfinished import Origin
from bench.commissioning.first_start import SETTINGS, FirstStart, Forwards, UnclearError, first_start
from drivers.connect import connect
from drivers.errors import DriveError
from drivers.lease import Lease
from emulator.conceal.chance import Chance
from emulator.scenario.motors import MOTORS
from tests.bars.bench_kills import LINKS
from tests.support.served_drive import emulator, ready

RIGHT: Final = math.radians(3.0)  # rad, electrical
CURRENT: Final = 0.6  # of the rated one, at most
AT_ONCE: Final = 4


@dataclass(frozen=True)
class Drawn:
    """A motor and how it is connected."""

    motor: str
    n_p: int
    offset: float  # rad, mechanical
    reversed: bool
    crossed: bool
    i_rated: float
    forwards: Forwards
    toml: str


@dataclass(frozen=True)
class Seen:
    """One first start."""

    drawn: Drawn
    said: str
    right: bool
    refused: bool
    moved: float  # turns
    seconds: float


def drawn(seed: int, number: int) -> Drawn:
    """A motor of the population."""
    chance = Chance(seed, number, "first start")
    name = chance.one_of(sorted(MOTORS))
    motor = MOTORS[name]
    n_p = max(1, round(chance.log_uniform(0.7, 30.0)))
    plain = motor.machine._replace(n_p=n_p)
    tau = 1.5 * n_p * plain.psi_f * plain.i_rated
    coulomb = tau * chance.log_uniform(0.005, 0.08)
    B = coulomb / (motor.speed_rpm * math.pi / 30.0) * chance.uniform(0.1, 1.0)
    offset, backwards, crossed = chance.uniform(-math.pi, math.pi), chance.happens(0.5), chance.happens(0.5)
    sections: dict[str, dict[str, Any]] = {
        "motor": plain._replace(J=plain.J * chance.log_uniform(1.0, 5.0), B=B)._asdict(),
        "drive": {
            "u_dc": motor.u_dc, "T_s": motor.T_s, "encoder_counts": chance.one_of((4096, 16_384, 131_072, 1_048_576)),
            "encoder_offset": offset, "encoder_reversed": backwards, "phases_crossed": crossed,
            "noise_i": plain.i_rated * 1e-3,
        },
        "run": {"shaft": "free", "speed_rpm": 0.0, "tau_L": coulomb * chance.uniform(-0.8, 0.8)},
        "effects.friction": {"coulomb": coulomb},
        "effects.harmonics": {"cogging": tau * chance.log_uniform(0.001, 0.02)},
        "settings": {"n_p": chance.one_of((1, 2, 4))},
    }  # fmt: skip
    text = "\n".join(
        line for section, values in sections.items()
        for line in (f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in values.items()))
    )  # fmt: skip
    forwards = chance.one_of(tuple(Forwards))
    return Drawn(name, n_p, offset, backwards, crossed, plain.i_rated, forwards, text + "\n")


def error_of(one: Drawn, found: FirstStart) -> float:
    """rad, electrical, by which the drive's angle would be off, at any place of the rotor; infinite where it turns."""
    values = found.values
    ways = (-1 if one.reversed else 1) * (-1 if values["angle_reversed"] else 1)
    exchanged = one.crossed != bool(values["phases_swapped"])
    if values["n_p"] != one.n_p or ways != (-1 if exchanged else 1):
        return math.inf
    mounted = one.offset * (-1 if values["angle_reversed"] else 1)
    return abs((one.n_p * mounted + values["angle_offset"] + math.pi) % math.tau - math.pi)


def started(seed: int, number: int) -> Seen:
    """A motor's first start."""
    one, begun = drawn(seed, number), time.monotonic()
    url = LINKS[tuple(LINKS)[number % len(LINKS)]]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "drawn.toml")
        path.write_text(one.toml, encoding="utf-8")
        with emulator("--at", url, "--scenario", str(path), control="lease") as process:
            ready(process)
            with connect(url) as drive:
                lease, origin = Lease(), Origin(Path(folder), url, "a first start")
                try:
                    with under_control(drive, lease, origin, SETTINGS):
                        found = first_start(drive, lease, CURRENT * one.i_rated, one.forwards)
                except UnclearError as error:
                    return Seen(one, str(error), right=True, refused=True, moved=0.0, seconds=time.monotonic() - begun)
                except DriveError as error:
                    return Seen(one, str(error), right=False, refused=True, moved=0.0, seconds=time.monotonic() - begun)
    off = error_of(one, found)
    said = f"{found.said}; {math.degrees(off):.2f} deg off" if math.isfinite(off) else f"{found.said}; wrong"
    right = off <= max(RIGHT, found.offset_error) and found.moved <= 1.0
    return Seen(one, said, right, refused=False, moved=found.moved, seconds=time.monotonic() - begun)


def main() -> int:
    """Draw, start, print."""
    parser = argparse.ArgumentParser(prog="bench_first_start")
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    counted, furthest = Counter[str](), 0.0
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for number, seen in enumerate(pool.map(started, [given.seed] * given.count, range(given.count))):
            how = "refused" if seen.refused and seen.right else "right" if seen.right else "WRONG"
            counted[how] += 1
            furthest = max(furthest, seen.moved)
            said = f"{number} {seen.drawn.motor}, {seen.drawn.n_p} pole pairs: {how}: {seen.said}"
            print(f"{said} ({seen.seconds:.0f} s)", flush=True)
    print(f"{counted['right']} right, {counted['refused']} refused, {counted['WRONG']} wrong of {given.count}; the "
          f"furthest that a shaft was moved: {furthest:.2f} turns (bar 1)")  # fmt: skip
    return 1 if counted["WRONG"] or furthest > 1.0 else 0


if __name__ == "__main__":
    sys.exit(main())
