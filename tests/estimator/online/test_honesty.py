"""No confident wrong answer: where little is excited, much is noise or something is amiss, whatever the method."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import pytest

from bench.live import method
from bench.live.window import Window
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.machine import Machine
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from estimator.machine import PARAMETERS
from estimator.online.estimate import Status
from tests.support.samples import noiseless, recorded, streamed, truth_of

pytestmark = pytest.mark.slow

CONSTANT = Excitation(-2.0, 2.0)
FAR = 4.5  # standard errors; with a few hundred answers a test, none is expected beyond 4
FAST = Machine(R_s=0.05, L_d=60e-6, L_q=80e-6, psi_f=6e-3, n_p=2, i_rated=30.0)


@dataclass(frozen=True)
class Case:
    """A run, and how its rows are taken."""

    scenario: Scenario = PAPER
    rows: int = 4000
    every_period: bool = False
    settle: int = 0  # control periods before the first row
    noise_i: float | None = None
    drive: dict[str, int] = field(default_factory=dict[str, int])
    run: dict[str, float] = field(default_factory=dict[str, float])

    def seeded(self, seed: int) -> Scenario:
        """The scenario with all of it."""
        drive = replace(self.scenario.drive, **self.drive)  # type: ignore[arg-type]
        if self.noise_i is not None:
            drive = replace(drive, noise_i=self.noise_i)
        run = replace(self.scenario.run, seed=seed, **self.run)  # type: ignore[arg-type]
        return replace(self.scenario, drive=drive, run=run)


def excited(excitation: Excitation, base: Scenario = PAPER) -> Scenario:
    """The scenario under other currents."""
    return replace(base, excitation=excitation)


SWINGING = {"swing_rpm": 400.0, "swing_frequency": 5.0}
HIGH_SPEED = Scenario("fast", FAST, drive_for(FAST, 400.0), Run(), Excitation(-6.0, 9.0, 12.0, 15.0, 5e-3))
CASES = {
    "constant currents from the start-up on": Case(excited(CONSTANT), 6000),
    "constant currents, a short while after it": Case(excited(CONSTANT), 2000),
    "constant currents, speed swings": Case(excited(CONSTANT), run=SWINGING),
    "constant currents, speed swings, settled": Case(excited(CONSTANT), settle=20_000, run=SWINGING),
    "steps on i_d only, i_q zero": Case(excited(Excitation(0.0, 0.0, 3.0)), settle=5000),
    "steps on i_q only, i_d zero": Case(excited(Excitation(0.0, 2.0, 0.0, 3.0))),
    "the same without noise": Case(noiseless(excited(Excitation(0.0, 2.0, 0.0, 3.0)))),
    "every control period": Case(rows=6000, every_period=True),
    "every control period, 30 mA": Case(rows=6000, every_period=True, noise_i=0.03),
    "every control period, 50 mA": Case(rows=6000, every_period=True, noise_i=0.05),
    "half an ampere of noise": Case(noise_i=0.5),
    "encoder of 1024 counts": Case(drive={"encoder_counts": 1024}),
    "encoder of 4096 counts": Case(drive={"encoder_counts": 4096}),
    "encoder of 4096 counts, no noise": Case(noiseless(), drive={"encoder_counts": 4096}),
    "encoder of 65536 counts": Case(drive={"encoder_counts": 65536}),
    "steps of 50 mA": Case(excited(Excitation(-2.0, 2.0, 0.05, 0.05))),
    "steps of 50 mA, i_d about zero": Case(excited(Excitation(0.0, 2.0, 0.05, 0.05))),
    "steps of 50 mA on i_d": Case(excited(Excitation(0.0, 2.0, 0.05, 2.05))),
    "converter of 8 bits": Case(drive={"adc_bits": 8}),
    "0.8 rad a control period": Case(noiseless(HIGH_SPEED), settle=1000, run={"speed_rpm": 40_000.0}),
    "-0.8 rad a control period": Case(noiseless(HIGH_SPEED), settle=1000, run={"speed_rpm": -40_000.0}),
}


def windows(drive: VirtualDrive, off: float) -> dict[str, Window]:
    """Every method; the filter starts `off` from the truth, but for psi_f, which it holds."""
    truth = truth_of(drive)
    held = {name: value * (1.0 if name == "psi_f" else 1.0 + off) for name, value in truth.items()}
    return {
        "all rows": Window(length=100_000),
        "short": Window(length=500),
        "auto": Window(length="auto"),
        "rls": Window(method="rls"),
        "rls, forgetting": Window(method="rls", forgetting_factor=0.99),
        "ekf": Window(held=held).changed({"method": "ekf"}),
        "published ekf": Window(held=held).changed({"method": "ekf", "ekf": {"preset": "paper"}}),
    }


def answers(case: Case, off: float) -> Iterator[tuple[str, str, float, float, float]]:
    """Method, parameter, value, standard error and truth of all that is told, from time to time."""
    drive = VirtualDrive(case.seeded(11))
    truth = truth_of(drive)
    drive.run(case.settle)
    samples = recorded(drive, case.rows) if case.every_period else streamed(drive, case.rows)
    for name, window in windows(drive, off).items():
        running = method.start(window)
        step = case.rows // 10
        for k in range(10):
            method.take(running, samples[k * step : (k + 1) * step], joined=True)
            told = method.estimate(running).estimates
            for parameter in PARAMETERS:
                e = told[parameter]
                if e.status is Status.OK:
                    assert e.value is not None and e.std is not None
                    yield name, parameter, e.value, e.std, truth[parameter]


@pytest.mark.parametrize("off", [0.3, -0.4])
@pytest.mark.parametrize("name", CASES)
def test_what_is_told_is_near_the_truth(name: str, off: float) -> None:
    far = [answer for answer in answers(CASES[name], off) if not abs(answer[2] - answer[4]) < FAR * answer[3]]
    assert not far
