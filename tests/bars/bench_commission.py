"""Commissioning of drives in which an effect is concealed, and whose data sheets are off: does the drive end better?

`python -m tests.bars.bench_commission [--count 20] [--seed 1]`

Each is an emulated drive, a process on a link of its own, its motor one out of a series of the catalogue's, its data
sheet off by up to 30 %, its shaft free with friction and load, one effect drawn that the firmware can make up for. It
is commissioned as `pmsm-bench commission` does; what comes of it is held against the truth.
"""

import argparse
import json
import math
import sys
import tempfile
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from bench.actions import experiment
from bench.actions.experiment import Plan
from bench.actions.safety.limits import Limits
from bench.actions.safety.unfinished import Origin
from bench.commissioning.identify import Around, Identified, identify, shaft_numbers, try_loops
from bench.commissioning.loops import Judged, judged
from bench.diagnoses.diagnosis_request import WORK, Request
from bench.diagnoses.worker import Failed, Progress, Worker
from bench.errors import BenchError
from bench.machine_file import Nominal
from bench.parameters import flash as flashes
from bench.parameters.link import OwnLink
from bench.recordings.capture_file import Heading, write_recording
from drivers.capture import Upload
from drivers.errors import DriveError
from emulator.conceal.chance import Chance
from emulator.conceal.population import Setting
from emulator.conceal.populations import EFFECTS, merged
from emulator.plant.machine import Machine
from emulator.scenario.motors import MOTORS
from estimator.machine import PARAMETERS
from tests.bars.bench_kills import LINKS
from tests.support.served_drive import emulator, ready

CLASSES: Final = (
    "dead_time", "drops", "saturation_q", "saturation_d", "cross_saturation", "current_offset", "current_gain",
    "angle_offset", "eccentric_once",
)
OFF: Final = 0.3  # of the data sheet's values
TRUST: Final = 0.4


@dataclass
class Seen:
    """One drive."""

    number: int
    motor: str
    effect: str
    size: float
    wrong: list[str] = field(default_factory=list[str])
    said: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Drawn:
    """A drive as it is."""

    motor: str
    effect: str
    size: float
    true: Machine
    sheet: Machine
    toml: str


def drawn(seed: int, number: int) -> Drawn:
    """A drive of the population."""
    chance = Chance(seed, number, "commission")
    name = chance.one_of(sorted(MOTORS))
    motor = MOTORS[name]
    plain = motor.machine
    like = {key: getattr(plain, key) * chance.uniform(0.8, 1.2) for key in PARAMETERS}
    true = plain._replace(**like, J=plain.J * chance.log_uniform(1.0, 5.0))
    sheet = true._replace(**{key: getattr(true, key) * chance.uniform(1.0 - OFF, 1.0 + OFF) for key in PARAMETERS})
    tau = 1.5 * true.n_p * true.psi_f * true.i_rated
    coulomb, fastest = tau * chance.log_uniform(0.005, 0.1), motor.speed_rpm * math.pi / 30.0
    true = true._replace(B=tau / fastest * chance.log_uniform(0.002, 0.05))
    effect = chance.one_of(CLASSES)
    size = EFFECTS[effect].drawn(chance)
    sections: Any = merged((
        EFFECTS[effect].sizes(size, Setting(true, fastest * true.n_p, motor.u_dc, motor.T_s, 2.0), chance),
        {"friction": {"coulomb": coulomb}},
    ))  # fmt: skip
    sections = {
        "motor": true._asdict(),
        "drive": {
            "u_dc": motor.u_dc, "T_s": motor.T_s, "bridge": "switched", "i_max": 1.5 * true.i_rated, "adc_bits": 14,
            "noise_i": true.i_rated * chance.log_uniform(3e-4, 2e-3),
            "encoder_counts": chance.one_of((16_384, 131_072, 1_048_576)),
        },
        "run": {
            "shaft": "free", "speed_control": True, "speed_reference": "ramp",
            "speed_bandwidth": chance.uniform(20.0, 40.0), "tau_L": coulomb * chance.uniform(0.0, 0.8),
        },
        "settings": {f"control_{key}": getattr(sheet, key) for key in PARAMETERS},
        **{f"effects.{section}": values for section, values in sections.items()},
    }  # fmt: skip
    lines = [
        line for section, values in sections.items()
        for line in (f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in values.items()))
    ]  # fmt: skip
    return Drawn(name, effect, size, true, sheet, "\n".join(lines) + "\n")


def commissioned(seed: int, number: int, link: str) -> Seen:
    """A drive from its delivery to its loops tried again."""
    one = drawn(seed, number)
    seen, begun = Seen(number, one.motor, one.effect, one.size), time.monotonic()
    url = LINKS[link]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario = folder / "drawn.toml"
        scenario.write_text(one.toml, encoding="utf-8")
        try:
            with emulator("--at", url, "--scenario", str(scenario), control="lease") as process:
                ready(process)
                with OwnLink(url) as own:
                    _commission(seen, one, own, folder)
        except (BenchError, DriveError, AssertionError) as error:
            seen.wrong.append(f"{type(error).__name__}: {error}")
    seen.seconds = time.monotonic() - begun
    return seen


def _commission(seen: Seen, one: Drawn, link: Any, folder: Path) -> None:
    true, i_rated = one.true, one.true.i_rated
    limits = Limits(i_max=1.2 * i_rated, speed_max_rpm=MOTORS[one.motor].speed_rpm)
    origin = Origin(folder / "control", "drawn", "commissioning")
    count = iter(range(99))

    def record(plan: Plan) -> Path:
        drive = link()
        path = folder / f"{next(count)}.parquet"
        part = experiment.begin(path, plan, drive, {"drive": "drawn", "url": "drawn"})
        experiment.run(drive, plan, part=part, limits=limits, origin=origin)
        file, said = part.settled()
        assert file is not None, said
        return file

    def keep(upload: Upload) -> Path:
        identity = link().identity
        request = {"signals": list(upload.setup.channels), "length": upload.setup.length}
        heading = Heading.of(f"drawn-{next(count)}", "drawn", "drawn", datetime.now(UTC).isoformat(), request, identity)
        return write_recording(folder / f"{heading.id}.parquet", heading, upload)

    def diagnose(path: Path) -> dict[str, Any]:
        sheet = one.sheet
        given = {key: getattr(sheet, key) for key in PARAMETERS}
        nominal = Nominal(given, n_p=sheet.n_p, i_rated=i_rated)
        with Worker(WORK) as worker:
            worker.begin(Request(path, nominal, dict.fromkeys(given, TRUST)))
            while isinstance(heard := worker.hear(), Progress):
                pass
        if isinstance(heard, Failed):
            raise BenchError(heard.why)
        return heard.result.content

    around = Around(link, limits, i_rated, origin, keep, record, diagnose, lambda said: None)
    found = identify(around, "commissioned")
    seen.said = f"{found.diagnosis['verdict']}: {', '.join(f['effect'] for f in found.diagnosis['findings'])}"
    _held_against(seen, found, true)
    flashed = flashes.flash(link, found.made.set, flashes.Around(folder / "journals", "drawn", override="the bar"))
    if flashed.end is not flashes.End.FLASHED:
        seen.wrong.append(flashed.said)
    after = try_loops(around)
    assert found.machine is not None
    now = judged(after, found.machine, *shaft_numbers(after, found.machine, found.shaft))
    for before, then in zip(found.loops, now, strict=True):
        _compared(seen, before, then)


def _held_against(seen: Seen, found: Identified, true: Machine) -> None:
    """Parameters within 0.5 % or their interval; J within 2 %."""
    after = found.diagnosis["machine"]["after"]
    for name in PARAMETERS:
        told, truth = after[name], getattr(true, name)
        off = told["value"] - truth
        if abs(off) > max(0.005 * truth, 1.96 * (told["std"] or 0.0)):
            seen.wrong.append(f"{name} {100 * off / truth:+.2f} % +- {100 * 1.96 * (told['std'] or 0) / truth:.2f}")
    J = found.shaft.estimates["J"].value if found.shaft else None
    if J is None:
        seen.wrong.append(f"J not told: {found.shaft.sentence if found.shaft else 'no machine'}")
    elif abs(J / true.J - 1.0) > 0.02:
        seen.wrong.append(f"J {100 * (J / true.J - 1):+.2f} %")


def _compared(seen: Seen, before: Judged, then: Judged) -> None:
    name = then.name
    if then.tracking is None or then.settling is None or then.overshoot is None:
        seen.wrong.append(f"{name}: {then.sentence}")
        return
    if before.tracking is not None and then.tracking > 1.05 * before.tracking:
        seen.wrong.append(f"{name}: worse than before, {then.tracking:.3g} s for {before.tracking:.3g} s")
    if abs(then.overshoot - then.promised_overshoot) > 0.1:
        seen.wrong.append(f"{name}: overshoot {then.overshoot:.3f}, promised {then.promised_overshoot:.3f}")
    told = then.settling, then.promised_settling
    if told[0] != told[1] and not abs(told[0] - told[1]) <= 0.1 * told[1]:
        seen.wrong.append(f"{name}: settles in {told[0]:.3g} s, promised {told[1]:.3g} s")


def main() -> int:
    parser = argparse.ArgumentParser(prog="bench_commission")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    good = 0
    for number in range(given.first, given.first + given.count):
        seen = commissioned(given.seed, number, tuple(LINKS)[number % len(LINKS)])
        good += not seen.wrong
        print(f"{number} {seen.motor} {seen.effect} {seen.size:.3g}: {seen.said}; {'; '.join(seen.wrong) or 'good'} "
              f"({seen.seconds:.0f} s)", flush=True)
    print(f"{good} of {given.count}")
    return 0 if good >= 0.9 * given.count else 1


if __name__ == "__main__":
    sys.exit(main())
