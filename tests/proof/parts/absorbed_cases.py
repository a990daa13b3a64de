"""Cases of an effect that a conventional fit absorbs: what is there, drawn by a seed, and what a user knows of it.

Every case is a drive on a dynamometer at one speed and about one level of current, with small steps of i_d and i_q by
which a fit of R_s, L_d, L_q and psi_f has something to tell them by. Knows nothing of fits and diagnoses.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from bench.machine_file import Nominal
from emulator.conceal.chance import Chance
from emulator.conceal.population import Setting
from emulator.plant.machine import Machine
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.plant.physics.thermal import REFERENCE, Thermal
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.motors import MOTORS, TOLERANCE
from emulator.scenario.scenarios import Excitation, Run, Scenario, drive_for
from estimator.machine import PARAMETERS

SECONDS: Final = 3.0  # of a recording
LONG: Final = 6.0  # of one in which the machine warms up
WINDOW: Final = 1.0  # of a fit there
_SPEED, _I_D, _I_Q, _STEP = 0.4, -0.2, 0.4, 0.05  # of rated speed and current
_STEP_TIME: Final = 5e-3  # s
_DEGREE: Final = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class Kind:
    """An effect that can be absorbed."""

    title: str
    effect: str  # that a diagnosis should name; "" where nothing on the drive can tell
    parameter: str  # of the finding, that is its size
    unit: str
    motors: tuple[str, ...]
    range: tuple[float, float]  # of the size, as `sizes` takes it
    sizes: Callable[[float, float, Setting], Effects]  # of a size, a sign
    told: Callable[["Case", Mapping[str, float]], float]  # the size as a diagnosis tells it, by what is true
    seconds: float = SECONDS
    scaled: str = ""  # what is scaled alike, as a diagnosis calls it: no recording tells that


@dataclass(frozen=True, slots=True)
class Case:
    """A drive with an effect, and what its user has."""

    seed: int
    kind: Kind
    motor: str
    steps: bool  # small ones around the level
    scenario: Scenario
    size: float  # as drawn, or halved since
    nominal: Nominal
    remake: Callable[[float], Effects]

    @property
    def title(self) -> str:
        """In words."""
        return f"{self.kind.title}, {'small steps' if self.steps else 'a level alone'}"

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.kind.title.replace(' ', '_')}_{self.motor}"

    @property
    def seconds(self) -> float:
        """Of its recording."""
        return self.kind.seconds

    @property
    def window(self) -> float:
        """s, that a conventional fit takes; a machine that warms up moves by little within it."""
        return WINDOW if self.seconds > SECONDS else SECONDS

    @property
    def held(self) -> tuple[str, ...]:
        """Parameters that a conventional fit is given: one level tells two."""
        return () if self.steps else ("L_d", "L_q")

    @property
    def without(self) -> Scenario:
        """The case's drive without the effect."""
        return replace(self.scenario, effects=NONE)

    def halved(self) -> "Case":
        """The case with half the effect."""
        size = 0.5 * self.size
        return replace(self, size=size, scenario=replace(self.scenario, effects=self.remake(size)))


def _dead_time(x: float, _sign: float, on: Setting) -> Effects:
    return NONE._replace(inverter=Inverter(dead_time=x * on.T_s))


def _iron_loss(x: float, _sign: float, on: Setting) -> Effects:
    return NONE._replace(iron_loss=IronLoss(R_c=on.back_emf / (x * on.machine.i_rated)))


def _dc_link_gain(x: float, sign: float, _on: Setting) -> Effects:
    return NONE._replace(voltage_sensing=VoltageSensing(gain=1.0 + sign * x))


def _current_gain(x: float, sign: float, _on: Setting) -> Effects:
    gain = 1.0 + sign * x
    return NONE._replace(current_sensing=CurrentSensing(gain, gain, gain))


def _angle_offset(x: float, sign: float, on: Setting) -> Effects:
    return NONE._replace(angle_sensing=AngleSensing(offset=sign * x / on.machine.n_p))


def _winding_heat(x: float, _sign: float, on: Setting) -> Effects:
    # x: rise in K within the recording at this level of current, nothing leaving the winding
    level = 1.5 * on.machine.R_s * on.machine.i_rated**2 * (_I_D**2 + _I_Q**2)
    C_w = level * on.length / x
    R = 5.0 * on.length / C_w
    return NONE._replace(thermal=Thermal(C_w=C_w, C_h=20.0 * C_w, C_m=10.0 * C_w, R_wh=R, R_mh=100.0 * R, R_ha=R))


def _magnet_heat(x: float, _sign: float, on: Setting) -> Effects:
    # Surroundings that are x warmer heat housing and magnets; the winding is cooled and keeps its resistance
    C_w = on.P_copper * on.length
    C_h = 100.0 * C_w
    return NONE._replace(
        thermal=Thermal(
            C_w=C_w, C_h=C_h, C_m=0.01 * C_h, R_wh=1e3 * on.length / C_w, R_mh=0.5 * on.length / (0.01 * C_h),
            R_ha=0.02 * on.length / C_h, alpha=0.0, ambient=REFERENCE + x,
        )
    )  # fmt: skip


KINDS: Final = (
    Kind("dead time", "inverter_voltage_error", "dead_time", "s", ("beckhoff_am8141", "aalto_2k2"), (0.001, 0.006),
         _dead_time, lambda case, _truth: case.scenario.effects.inverter.dead_time),
    Kind("iron loss", "iron_loss", "R_c", "ohm", ("servo_4nm", "aalto_2k2"), (0.02, 0.08), _iron_loss,
         lambda case, _truth: case.scenario.effects.iron_loss.R_c),
    Kind("angle offset", "angle_offset", "offset", "rad", ("beckhoff_am8141", "aalto_2k2"),
         (1.0 * _DEGREE, 6.0 * _DEGREE), _angle_offset,
         lambda case, _truth: case.scenario.effects.angle_sensing.offset * case.scenario.motor.n_p),
    Kind("winding that warms up", "winding_resistance_drift", "rise", "1", ("servo_4nm", "beckhoff_am8141"),
         (15.0, 60.0), _winding_heat, lambda _case, truth: truth["rise"], LONG),
    Kind("magnets that warm up", "magnet_flux_drift", "change", "1", ("servo_4nm", "aalto_2k2"), (10.0, 40.0),
         _magnet_heat, lambda _case, truth: truth["change"], LONG),
    Kind("dc-link gain", "", "gain", "1", ("servo_4nm", "beckhoff_am8141"), (0.03, 0.10), _dc_link_gain,
         lambda case, _truth: case.scenario.effects.voltage_sensing.gain, scaled="voltages"),
    Kind("gain of all current sensors", "", "gain", "1", ("aalto_2k2", "beckhoff_am8141"), (0.03, 0.10),
         _current_gain, lambda case, _truth: case.scenario.effects.current_sensing.gain_a, scaled="currents"),
)  # fmt: skip


_LEVELS: Final = ("dead time", "iron loss", "angle offset", "winding that warms up")
"""Kinds of which the first motor runs at a level alone."""


def cases(seed: int, *, quick: bool) -> list[Case]:
    """All cases of a seed; quick: one at a level alone and one with steps."""
    dead, angle = KINDS[0], KINDS[2]
    wanted = [(dead, dead.motors[0]), (angle, angle.motors[1])] if quick else [
        (kind, motor) for kind in KINDS for motor in kind.motors
    ]  # fmt: skip
    return [_case(seed, kind, motor) for kind, motor in wanted]


def _case(seed: int, kind: Kind, name: str) -> Case:
    chance = Chance(seed, KINDS.index(kind), name)
    motor = MOTORS[name]
    machine = _one_of_a_series(chance, motor.machine)
    drive = drive_for(machine, motor.u_dc, T_s=motor.T_s, bridge="switched", temperature_trip=180.0)
    i, steps = machine.i_rated, not (kind.title in _LEVELS and name == kind.motors[0])
    excitation = Excitation(_I_D * i, _I_Q * i, _STEP * i, _STEP * i, _STEP_TIME)
    if not steps:
        excitation = Excitation(_I_D * i, _I_Q * i, kind="none")
    run = Run(speed_rpm=_SPEED * motor.speed_rpm, seed=chance.seed())
    setting = Setting(machine, motor.speed_rpm * math.tau / 60.0 * machine.n_p, motor.u_dc, motor.T_s, kind.seconds)
    sign, size = chance.sign(), chance.log_uniform(*kind.range)

    def remade(x: float) -> Effects:
        return kind.sizes(x, sign, setting)

    scenario = Scenario(f"{name}.toml", machine, drive, run, excitation, remade(size))
    rated = motor.machine
    given = {key: getattr(rated, key) for key in PARAMETERS}
    nominal = Nominal(given, n_p=rated.n_p, i_rated=rated.i_rated, T_s=motor.T_s, u_dc=motor.u_dc)
    return Case(seed, kind, name, steps, scenario, size, nominal, remade)


def _one_of_a_series(chance: Chance, nominal: Machine) -> Machine:
    """Each parameter within the data sheet's tolerance."""
    off = {key: 1.0 + 0.7 * TOLERANCE * chance.uniform(-1.0, 1.0) for key in PARAMETERS}
    return nominal._replace(**{key: getattr(nominal, key) * factor for key, factor in off.items()})
