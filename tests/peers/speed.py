"""How fast each simulates the same second: real-time factors, one core, measured in one process."""

import time
from collections.abc import Callable
from typing import Any, cast

import gym_electric_motor as gem
import numpy as np
from gym_electric_motor.physical_systems.mechanical_loads import ConstantSpeedLoad

from emulator.drive.virtual_drive import VirtualDrive
from tests.peers.cases import AVERAGED, PERIODS, REFERENCES, SWITCHED, Case, recorded
from tests.peers.with_motulator import under_references, under_voltages

_REPEATS = 5  # of ours, the best counts: a second takes it milliseconds, the others seconds


def real_time_factors(periods: int = PERIODS) -> dict[str, float]:
    """Simulated time over computing time, by simulator, for so many control periods of 0.1 ms.

    Ours: drive with firmware, sensors and stream. motulator's: averaged with its own vector control; with edges,
    machine and shaft only, its carrier compared with duties that are given. gym-electric-motor's: machine and averaged
    converter at a fixed speed, actions that are given.
    """
    _, voltages = recorded(SWITCHED, periods)
    duration = periods * AVERAGED.scenario.drive.T_s
    timed = {
        "motulator, averaged": lambda: under_references(REFERENCES, periods),
        "motulator, edges": lambda: under_voltages(SWITCHED, voltages),
        "gym-electric-motor, averaged": _environment(AVERAGED, periods),
    }
    ours = {"ours, averaged": AVERAGED, "ours, edges": SWITCHED}
    taken = {name: min(_taken(_drive(case, periods)) for _ in range(_REPEATS)) for name, case in ours.items()}
    taken |= {name: _taken(run) for name, run in timed.items()}
    return {name: duration / seconds for name, seconds in taken.items()}


def _taken(run: Callable[[], object]) -> float:
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


def _drive(case: Case, periods: int) -> Callable[[], object]:
    drive = VirtualDrive(case.scenario)
    drive.warm_up()
    return lambda: drive.run(periods)


def _environment(case: Case, periods: int) -> Callable[[], object]:
    motor, drive = case.scenario.motor, case.scenario.drive
    env: Any = cast(Any, gem).make(
        "Cont-CC-PMSM-v0",
        motor={
            "motor_parameter": {
                "p": motor.n_p, "l_d": motor.L_d, "l_q": motor.L_q, "j_rotor": motor.J, "r_s": motor.R_s,
                "psi_p": motor.psi_f,
            },
            "limit_values": {"i": drive.i_max, "u": drive.u_dc, "omega": 1000.0},
        },
        supply={"u_nominal": drive.u_dc}, load=cast(Any, ConstantSpeedLoad)(omega_fixed=100.0), tau=drive.T_s,
        constraints=(), visualization=(),
    )
    env.reset(seed=1)
    actions = 0.2 * np.sin(300.0 * drive.T_s * np.arange(periods)[:, None] + 2.0 * np.pi / 3.0 * np.arange(3))

    def run() -> None:
        for action in actions:
            env.step(action)

    return run
