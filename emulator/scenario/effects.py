"""The effects of a scenario: a section `[effects.<name>]` for each, with its sizes; what is left out has none.

Here too is what sizes cannot be together, or with a motor and a drive: one sentence each.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast, get_type_hints

from emulator.bounds import ScenarioError, check_bounds, from_table
from emulator.input_file import shown
from emulator.plant.machine import Machine
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.compensation import Compensation
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.plant.physics.current_hum import CurrentHum
from emulator.plant.physics.dc_link import DcLink
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.flux_map import NO_MAP, FluxMap, loaded
from emulator.plant.physics.friction import Friction
from emulator.plant.physics.hall import Hall
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.imbalance import Imbalance, share_of
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Curve, Saturation, saturation_curve
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing, read_voltage
from emulator.plant.physics.skin import Skin, rung_resistance
from emulator.plant.physics.strangers import Resonance, Stray, Telegraph
from emulator.plant.physics.thermal import Thermal
from emulator.plant.physics.timing import Timing
from emulator.plant.physics.turn_short import TurnShort, loop_inductance
from emulator.plant.physics.warming import Warming


class MapFile(NamedTuple):
    """A measured flux map instead of the motor's L_d, L_q and psi_f: see `physics.flux_map`."""

    file: str = ""  # beside the scenario's file, or an absolute path


class Effects(NamedTuple):
    """All of them."""

    inverter: Inverter = Inverter()
    dc_link: DcLink = DcLink()
    saturation: Saturation = Saturation()
    flux_map: MapFile = MapFile()
    harmonics: Harmonics = Harmonics()
    iron_loss: IronLoss = IronLoss()
    thermal: Thermal = Thermal()
    demagnetisation: Demagnetisation = Demagnetisation()
    imbalance: Imbalance = Imbalance()
    turn_short: TurnShort = TurnShort()
    skin: Skin = Skin()
    friction: Friction = Friction()
    compliance: Compliance = Compliance()
    current_sensing: CurrentSensing = CurrentSensing()
    current_hum: CurrentHum = CurrentHum()
    current_filter: CurrentFilter = CurrentFilter()
    angle_sensing: AngleSensing = AngleSensing()
    angle_signal: AngleSignal = AngleSignal()
    voltage_sensing: VoltageSensing = VoltageSensing()
    timing: Timing = Timing()
    compensation: Compensation = Compensation()
    stray: Stray = Stray()
    telegraph: Telegraph = Telegraph()
    resonance: Resonance = Resonance()
    warming: Warming = Warming()
    hall: Hall = Hall()


NONE = Effects()


def effects_from_table(table: Mapping[str, object], where: str, folder: Path) -> Effects:
    """Effects from the TOML table `effects`; files are looked for in `folder`. Raises ScenarioError."""
    kinds: dict[str, Any] = get_type_hints(Effects)
    values: dict[str, Any] = {}
    for name, section in table.items():
        if name not in kinds:
            raise ScenarioError(f"{where}{shown(name)[1:-1]} is no effect; the effects are {', '.join(kinds)}")
        if not isinstance(section, dict):
            raise ScenarioError(f"{where}{name} takes a section, got {shown(section)}")
        values[name] = from_table(kinds[name], cast(dict[str, object], section), f"{where}{name}.")
    if "flux_map" in values:
        values["flux_map"] = MapFile(str(folder / values["flux_map"].file))
    return Effects(**values)


def curve_of(effects: Effects, motor: Machine) -> Curve:
    """The saturation curve of a motor. Raises ValueError."""
    return saturation_curve(effects.saturation, motor.L_d, motor.L_q, motor.psi_f, motor.i_rated)


def flux_map_of(effects: Effects) -> FluxMap:
    """The measured map, or none. Raises ValueError."""
    return loaded(Path(effects.flux_map.file)) if effects.flux_map.file else NO_MAP


def knee_of(effects: Effects, motor: Machine) -> float:
    """Current (A) below which a switch's drop softens."""
    return effects.inverter.knee or 0.01 * motor.i_rated


def check_effects(
    effects: Effects, motor: Machine, u_dc: float, T_s: float, h: float, switched: bool, where: str
) -> None:
    """Raise ScenarioError where sizes are out of their bounds or cannot be together; h (s) is the integration step."""
    for name, sizes in effects._asdict().items():
        check_bounds(sizes, f"{where}{name}.")
    try:
        _check_magnetics(effects, motor, where)
        _check_inverter(effects, motor, u_dc, T_s, h, switched, where)
        _check_steps(effects, motor, h, where)
        _check_filter(effects.current_filter.tau, h, where)
        _check_most(effects, motor, u_dc, where)
        if effects.thermal.C_w > 0.0:
            _check_thermal(effects.thermal, motor, T_s, where)
        if effects.timing.delay < 0 < effects.timing.shift:
            raise ScenarioError(
                f"{where}timing.shift takes 0 or -1 with a delay of -1, by which no voltage is known early, "
                f"got {effects.timing.shift}"
            )
    except ArithmeticError:
        raise ScenarioError(f"{where[:-1]}: with this motor numbers are beyond what can be reckoned with") from None


def _check_inverter(
    effects: Effects, motor: Machine, u_dc: float, T_s: float, h: float, switched: bool, where: str
) -> None:
    inverter, link = effects.inverter, effects.dc_link
    for name in ("inverter", "dc_link"):
        if not switched and getattr(effects, name) != getattr(NONE, name):
            raise ScenarioError(f"{where}{name} takes drive.bridge = 'switched', got 'averaged'")
    for key, value in (("dead_time", inverter.dead_time), ("min_pulse", inverter.min_pulse)):
        if value > 0.2 * T_s:
            raise ScenarioError(
                f"{where}inverter.{key} takes at most a fifth of the control period, {0.2 * T_s:g} s, got {value:g} s"
            )
    softest = 0.5 * h * max(inverter.u_transistor, inverter.u_diode) * _stiffness(effects, motor)
    if knee_of(effects, motor) < softest:
        raise ScenarioError(
            f"{where}inverter.knee takes at least {softest:.3g} A with these drops, got {knee_of(effects, motor):.3g} A"
        )
    if link.C > 0.0 and T_s > link.R * link.C:
        raise ScenarioError(
            f"{where}dc_link.C takes at least {T_s / link.R:g} F behind {link.R:g} ohm, got {link.C:g} F"
        )
    least = 1.5 * motor.i_rated * T_s / (0.25 * u_dc)
    if 0.0 < link.C < least:
        raise ScenarioError(
            f"{where}dc_link.C takes at least {least:.3g} F, of which the rated current empties a quarter in a control "
            f"period, got {link.C:g} F"
        )
    if link.C == 0.0 and link.ripple > 0.0:
        raise ScenarioError(f"{where}dc_link.ripple takes a capacitor, dc_link.C, got {link.ripple:g} V without one")


def _check_magnetics(effects: Effects, motor: Machine, where: str) -> None:
    if effects.saturation != Saturation() and effects.flux_map.file:
        raise ScenarioError(f"{where}saturation takes no size beside effects.flux_map, which has its own")
    try:
        curve_of(effects, motor)
    except ValueError as error:
        raise ScenarioError(f"{where}saturation.{error}") from None
    try:
        flux_map_of(effects)
    except ValueError as error:
        raise ScenarioError(f"{where}flux_map.file: {error}") from None


def _check_filter(tau: float, h: float, where: str) -> None:
    if 0.0 < tau < 2.0 * h:
        raise ScenarioError(
            f"{where}current_filter.tau takes 0 or at least {2.0 * h:.3g} s at steps of {h:g} s, got {tau:g} s"
        )


def _check_steps(effects: Effects, motor: Machine, h: float, where: str) -> None:
    """What moves too fast for an integration step h (s)."""
    iron, branch, short, skin = effects.iron_loss, effects.resonance, effects.turn_short, effects.skin
    warmest = 1.0 + max((share for _, share in effects.warming.winding), default=0.0)
    R = motor.R_s * warmest + rung_resistance(skin, motor.R_s) + 2.0 * effects.inverter.r_on
    if R * h > 0.5 * min(motor.L_d, motor.L_q):
        raise ScenarioError(
            f"{where}skin and inverter.r_on take resistances of at most {0.5 * min(motor.L_d, motor.L_q) / h:.4g} ohm "
            f"in all at steps of {h:g} s, got {R:.4g}"
        )
    r_on, most = effects.inverter.r_on, 0.5 / (h * _stiffness(effects, motor))
    if r_on > most:
        raise ScenarioError(_too_fast(f"{where}inverter.r_on", "ohm", most, r_on, h))
    if iron.R_c > 0.0 and iron.lag < 2.0 * h * (1.0 + R / iron.R_c):
        raise ScenarioError(
            f"{where}iron_loss.lag takes at least {2.0 * h * (1.0 + R / iron.R_c):.3g} s at steps of {h:g} s "
            f"and this R_c, got {iron.lag:g} s"
        )
    if skin.rise > 0.0 and 2.0 * math.pi * skin.frequency * h > 0.5:
        raise ScenarioError(_too_fast(f"{where}skin.frequency", "Hz", 0.5 / (2.0 * math.pi * h), skin.frequency, h))
    if effects.stray.amplitude > 0.0 and 2.0 * math.pi * effects.stray.frequency * h > 0.5:
        most = 0.5 / (2.0 * math.pi * h)
        raise ScenarioError(_too_fast(f"{where}stray.frequency", "Hz", most, effects.stray.frequency, h))
    if short.share > 0.0:
        R_k = motor.R_s * (1.0 + share_of(effects.imbalance, short.phase))
        longest = 0.3 * loop_inductance(short, motor.R_s) / (short.R_t + short.share * R_k)
        if h > longest:
            raise ScenarioError(
                f"{where}turn_short takes integration steps of at most {longest:.3g} s, by drive.sub_steps, got {h:g} s"
            )
    for name, omega in (("compliance.stiffness", _shaft_resonance(effects, motor)), ("resonance.L", _lc(effects))):
        if omega * h > 0.25:
            raise ScenarioError(
                f"{where}{name} takes a resonance of at most {0.25 / h:.4g} rad/s at steps of {h:g} s, got {omega:.4g}"
            )
    if branch.C > 0.0 and branch.R * h > 0.5 * branch.L:
        raise ScenarioError(
            f"{where}resonance.R takes at most {0.5 * branch.L / h:g} ohm at steps of {h:g} s, got {branch.R:g}"
        )
    shaft, friction = effects.compliance, effects.friction
    lighter = min(motor.J, shaft.J_L)
    if shaft.stiffness > 0.0 and shaft.damping * h > 0.25 * lighter:
        most = 0.25 * lighter / h
        raise ScenarioError(_too_fast(f"{where}compliance.damping", "Nm s/rad", most, shaft.damping, h))
    steepest = max(friction.coulomb, friction.static) / motor.J
    if steepest * h > 0.5 * friction.omega_0:
        raise ScenarioError(
            f"{where}friction.omega_0 takes at least {2.0 * steepest * h:.3g} rad/s with this friction at steps of "
            f"{h:g} s, got {friction.omega_0:g}"
        )


def _too_fast(key: str, unit: str, most: float, got: float, h: float) -> str:
    return f"{key} takes at most {most:.4g} {unit} at steps of {h:g} s, got {got:g}"


def _check_most(effects: Effects, motor: Machine, u_dc: float, where: str) -> None:
    """What would be more than all the rest."""
    tau = 1.5 * motor.n_p * motor.psi_f * motor.i_rated
    for key, unit, value, most in (
        ("stray.amplitude", "V", effects.stray.amplitude, u_dc),
        ("telegraph.amplitude", "V", effects.telegraph.amplitude, u_dc),
        ("dc_link.ripple", "V", effects.dc_link.ripple, 0.5 * u_dc),
        ("harmonics.cogging", "Nm", effects.harmonics.cogging, tau),
    ):
        if value > most:
            raise ScenarioError(f"{where}{key} takes at most {most:.4g} {unit} here, got {value:g}")
    read, least = read_voltage(effects.voltage_sensing, u_dc), 0.25 * u_dc
    if read < least:
        raise ScenarioError(
            f"{where}voltage_sensing takes gain and offset by which {u_dc:g} V read as {least:g} V at least, "
            f"got {read:g} V"
        )


def _check_thermal(thermal: Thermal, motor: Machine, T_s: float, where: str) -> None:
    """Each node's time constants are long against the control period, and no current warms it at once."""
    most = 1.5 * motor.R_s * (3.0 * motor.i_rated) ** 2  # W
    by_h = 1.0 / thermal.R_wh + 1.0 / thermal.R_mh + 1.0 / thermal.R_ha
    for key, value, least in (
        ("C_w", thermal.C_w, T_s * max(1000.0 / thermal.R_wh, most)),
        ("C_m", thermal.C_m, T_s * 100.0 / thermal.R_mh),
        ("C_h", thermal.C_h, T_s * max(100.0 * by_h, most)),
    ):
        if value < least:
            raise ScenarioError(f"{where}thermal.{key} takes at least {least:.4g} J/K, got {value:g}")


def _stiffness(effects: Effects, motor: Machine) -> float:
    """How fast the bridge's current follows a voltage, 1/H: the motor's, and of what carries current beside it."""
    branch, iron, short = effects.resonance, effects.iron_loss, effects.turn_short
    total = 1.0 / (min(motor.L_d, motor.L_q) * (1.0 - max(effects.saturation)) ** 2)
    if branch.C > 0.0:
        total += 1.0 / branch.L
    if iron.R_c > 0.0:
        total += 1.0 / (iron.lag * iron.R_c)
    if short.share > 0.0:
        total += 2.0 / 3.0 * short.share**2 / loop_inductance(short, motor.R_s)
    return total


def _shaft_resonance(effects: Effects, motor: Machine) -> float:
    """Of the compliant shaft, rad/s."""
    shaft = effects.compliance
    return math.sqrt(shaft.stiffness * (1.0 / motor.J + 1.0 / shaft.J_L))


def _lc(effects: Effects) -> float:
    """Of the branch at the terminals, rad/s."""
    branch = effects.resonance
    return 1.0 / math.sqrt(branch.L * branch.C) if branch.C > 0.0 else 0.0
