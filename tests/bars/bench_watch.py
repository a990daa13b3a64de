"""The watch over a stream, by `python -m tests.bars.bench_watch`: its cost, how quiet it is, how soon and how small it
tells.

By the drive's clock: windows are judged once a second, as the service does. Machines are noisy: of several runs the
shortest counts.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

from bench.live import watch
from bench.live.watch import Explained, Watch
from bench.live.window import Window
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import Effects
from emulator.scenario.scenarios import PAPER, Scenario
from tests.estimator.diagnosis.test_watch import SCENARIOS, estimates_of, paper
from tests.proof.results import record
from tests.support.samples import streamed

_BLOCK = 5  # rows, as they come over a link
_START = datetime(2026, 1, 1, tzinfo=UTC)


def seconds_of(scenario: Scenario, count: int, length: int = 1000) -> Iterator[Watch]:
    """The watch after each second of the stream; its clock is the drive's."""
    drive, said = VirtualDrive(scenario), Watch()
    for k in range(count):
        samples = streamed(drive, 1000)
        watch.take(said, samples, Window(length=length))
        watch.judge(said, Window(length=length), estimates_of(samples), {}, _START + timedelta(seconds=k + 1))
        yield said


def cost(scenario: Scenario, length: int) -> float:
    """Seconds for one window's judgement, with the place of a mismatch where there is one."""
    window, drive = Window(length=length), VirtualDrive(scenario)
    took, said = list[float](), Watch()
    for _ in range(6 + length // 1000):
        samples = streamed(drive, 1000)
        for k in range(0, 1000, _BLOCK):
            watch.take(said, samples[k : k + _BLOCK], window)
        estimates = estimates_of(samples)
        began = time.perf_counter()
        watch.judge(said, window, estimates, {}, _START)
        took.append(time.perf_counter() - began)
    return min(took[-5:])


def main() -> int:
    """Print the figures. 0 when there is no false alarm, and at most 5 us a row."""
    parser = argparse.ArgumentParser("bench_watch", description=__doc__)
    parser.add_argument("--seconds", type=int, default=300, help="of the drive's stream, for each motor")
    options = parser.parse_args()
    costs, sure, least, late = list[float](), list[float](), list[int](), list[str]()
    dead_time = paper(Effects(inverter=Inverter(dead_time=1e-6)))
    most = 0.0
    print("a window judged, once a second: without, with a mismatch")
    for length in (1000, 10_000, watch.MOST):
        quiet, loud = (cost(scenario, length) for scenario in (PAPER, dead_time))
        most = max(most, quiet / length)
        costs.append(quiet)
        print(f"  {length:6} rows {1e3 * quiet:6.2f} ms, {1e3 * loud:6.2f} ms: {1e6 * quiet / length:.2f} us a row")
    alarms = 0
    for name in ("paper", "50 W hobby", "50 kW traction"):
        each = list[tuple[float, bool]]()
        for said in seconds_of(SCENARIOS[name], options.seconds):
            each.append((said.said.significance or 0.0, said.said.since is not None))
        alarms += each[-1][1]
        sure.append(max(s for s, _ in each))
        print(f"{name}, {options.seconds} s without an effect: significance at most {max(s for s, _ in each):.1f}, "
              f"{'a false alarm' if each[-1][1] else 'no alarm'}")
    for ns in (100, 50, 20, 10):
        *_, last = seconds_of(paper(Effects(inverter=Inverter(dead_time=1e-9 * ns))), 4)
        print(f"dead time of {ns} ns at 310 V: {last.said.status}, {last.said.rms_V:.3f} V above noise, "
              f"{last.said.significance:.0f} standard deviations; from {last.said.least_V:.3f} V it matters")
        least += [ns] if last.said.status is Explained.NO else []
    for share in (0.03, 0.01, 0.003):
        scenario = paper(Effects(demagnetisation=Demagnetisation(share, 10.5)))
        seconds = enumerate(seconds_of(scenario, 16, 4000))
        told = next((k for k, said in seconds if said.said.status is Explained.NO), None)
        print(f"magnets {100 * share:g} % weaker at 10.5 s, a window of 4 s: "
              + ("not told" if told is None else f"told at {told + 1} s"))
        late.append("not told" if told is None else f"within {told + 1 - 10.5:.1f} s")
    held = not alarms and most < 5e-6
    calm = f"{alarms or 'no'} alarm, {max(sure):.1f} standard deviations at most"
    record("service.watch", f"{calm}; {min(least, default=0)} ns; {late[-1]}; {1e3 * costs[0]:.1f} ms", held)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
