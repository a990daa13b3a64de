"""The effects of a scenario: a section `[effects.<name>]` for each, with its sizes; what is left out has none.

Here too is what sizes cannot be together, or with a motor and a drive: one sentence each.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast, get_type_hints

from emulator.bounds import ScenarioError, check_bounds, from_table
from emulator.machine import Machine
from emulator.physics.compliance import Compliance
from emulator.physics.dc_link import DcLink
from emulator.physics.demagnetisation import Demagnetisation
from emulator.physics.flux_map import NO_MAP, FluxMap, loaded
from emulator.physics.friction import Friction
from emulator.physics.harmonics import Harmonics
from emulator.physics.imbalance import Imbalance
from emulator.physics.iron_loss import IronLoss
from emulator.physics.legs import Inverter
from emulator.physics.saturation import Curve, Saturation, saturation_curve
from emulator.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.physics.skin import Skin, rung_resistance
from emulator.physics.strangers import Resonance, Stray, Telegraph
from emulator.physics.thermal import Thermal
from emulator.physics.timing import Timing
from emulator.physics.turn_short import TurnShort


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
    angle_sensing: AngleSensing = AngleSensing()
    voltage_sensing: VoltageSensing = VoltageSensing()
    timing: Timing = Timing()
    stray: Stray = Stray()
    telegraph: Telegraph = Telegraph()
    resonance: Resonance = Resonance()


NONE = Effects()


def effects_from_table(table: Mapping[str, object], where: str, folder: Path) -> Effects:
    """Effects from the TOML table `effects`; files are looked for in `folder`. Raises ScenarioError."""
    kinds: dict[str, Any] = get_type_hints(Effects)
    values: dict[str, Any] = {}
    for name, section in table.items():
        if name not in kinds:
            raise ScenarioError(f"{where}{name} is no effect; the effects are {', '.join(kinds)}")
        if not isinstance(section, dict):
            raise ScenarioError(f"{where}{name} takes a section, got {section!r}")
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


def check_effects(effects: Effects, motor: Machine, T_s: float, h: float, switched: bool, where: str) -> None:
    """Raise ScenarioError where sizes are out of their bounds or cannot be together; h (s) is the integration step."""
    for name, sizes in effects._asdict().items():
        check_bounds(sizes, f"{where}{name}.")
    _check_inverter(effects, motor, T_s, h, switched, where)
    _check_magnetics(effects, motor, where)
    _check_steps(effects, motor, h, where)
    thermal = effects.thermal
    if 0.0 < thermal.C_w < 1000.0 * T_s / thermal.R_wh:
        raise ScenarioError(
            f"{where}thermal.C_w takes at least {1000.0 * T_s / thermal.R_wh:g} J/K, got {thermal.C_w:g}"
        )


def _check_inverter(effects: Effects, motor: Machine, T_s: float, h: float, switched: bool, where: str) -> None:
    inverter, link = effects.inverter, effects.dc_link
    for name in ("inverter", "dc_link"):
        if not switched and getattr(effects, name) != getattr(NONE, name):
            raise ScenarioError(f"{where}{name} takes drive.bridge = 'switched', got 'averaged'")
    for key, value in (("dead_time", inverter.dead_time), ("min_pulse", inverter.min_pulse)):
        if value > 0.2 * T_s:
            raise ScenarioError(
                f"{where}inverter.{key} takes at most a fifth of the control period, {0.2 * T_s:g} s, got {value:g} s"
            )
    softest = 0.5 * h * max(inverter.u_transistor, inverter.u_diode) / min(motor.L_d, motor.L_q)
    if knee_of(effects, motor) < softest:
        raise ScenarioError(
            f"{where}inverter.knee takes at least {softest:.3g} A with these drops, got {knee_of(effects, motor):.3g} A"
        )
    if link.C > 0.0 and T_s > link.R * link.C:
        raise ScenarioError(
            f"{where}dc_link.C takes at least {T_s / link.R:g} F behind {link.R:g} ohm, got {link.C:g} F"
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


def _check_steps(effects: Effects, motor: Machine, h: float, where: str) -> None:
    """What moves too fast for an integration step h (s)."""
    iron, branch = effects.iron_loss, effects.resonance
    R = motor.R_s + rung_resistance(effects.skin, motor.R_s) + 2.0 * effects.inverter.r_on
    if R * h > 0.5 * min(motor.L_d, motor.L_q):
        raise ScenarioError(
            f"{where}skin and inverter.r_on take resistances of at most {0.5 * min(motor.L_d, motor.L_q) / h:.4g} ohm "
            f"in all at steps of {h:g} s, got {R:.4g}"
        )
    if iron.R_c > 0.0 and iron.lag < h:
        raise ScenarioError(f"{where}iron_loss.lag takes at least an integration step, {h:g} s, got {iron.lag:g} s")
    for name, omega in (("compliance.stiffness", _shaft_resonance(effects, motor)), ("resonance.L", _lc(effects))):
        if omega * h > 0.5:
            raise ScenarioError(
                f"{where}{name} takes a resonance of at most {0.5 / h:.4g} rad/s at steps of {h:g} s, got {omega:.4g}"
            )
    if branch.C > 0.0 and branch.R * h > branch.L:
        raise ScenarioError(
            f"{where}resonance.R takes at most {branch.L / h:g} ohm at steps of {h:g} s, got {branch.R:g}"
        )


def _shaft_resonance(effects: Effects, motor: Machine) -> float:
    """Of the compliant shaft, rad/s."""
    shaft = effects.compliance
    return math.sqrt(shaft.stiffness * (1.0 / motor.J + 1.0 / shaft.J_L))


def _lc(effects: Effects) -> float:
    """Of the branch at the terminals, rad/s."""
    branch = effects.resonance
    return 1.0 / math.sqrt(branch.L * branch.C) if branch.C > 0.0 else 0.0
