"""Every effect at a size that shows, on the paper's drive: for tests and for timing."""

from dataclasses import replace
from typing import Final

from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.compensation import Compensation
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.plant.physics.current_hum import CurrentHum
from emulator.plant.physics.dc_link import DcLink
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.friction import Friction
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.imbalance import Imbalance
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.plant.physics.skin import Skin
from emulator.plant.physics.strangers import Resonance, Stray, Telegraph
from emulator.plant.physics.thermal import Thermal
from emulator.plant.physics.timing import Timing
from emulator.plant.physics.turn_short import TurnShort
from emulator.plant.physics.warming import Warming
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER_RUN, Scenario

ALL: Final = Effects(
    inverter=Inverter(dead_time=2e-6, min_pulse=1e-6, u_transistor=1.2, u_diode=1.0, r_on=0.05),
    dc_link=DcLink(C=1e-3, R=0.3, ripple=5.0, frequency=300.0),
    saturation=Saturation(L_d_drop=0.1, L_q_drop=0.25, cross_drop=0.1),
    harmonics=Harmonics(d_6=0.02, q_6=0.03, d_12=0.01, q_12=0.01, inductance=0.03, cogging=0.05),
    iron_loss=IronLoss(R_c=200.0, omega_h=500.0),
    thermal=Thermal(C_w=5.0, C_m=20.0, C_h=50.0),
    demagnetisation=Demagnetisation(share=0.1, time=0.1),
    imbalance=Imbalance(a=0.05, b=-0.02),
    turn_short=TurnShort(share=0.05, R_t=0.5, phase=1),
    skin=Skin(rise=0.3, frequency=500.0),
    friction=Friction(coulomb=0.05, static=0.08),
    compliance=Compliance(stiffness=500.0, damping=0.05, J_L=8e-4),
    current_sensing=CurrentSensing(1.01, 0.99, 1.0, 0.02, -0.01, 0.005, 1e-6, 2e-6, 0.0),
    angle_sensing=AngleSensing(offset=0.01, once=0.005, once_phase=0.1, twice=0.003, twice_phase=0.2),
    voltage_sensing=VoltageSensing(gain=1.01, offset=0.5),
    current_hum=CurrentHum(a=0.05, b=-0.02, c=0.01, frequency=60.0, phase=0.4),
    current_filter=CurrentFilter(tau=5e-5, periods=1),
    angle_signal=AngleSignal(gain=0.01, quadrature=0.01, offset_sin=0.005, bandwidth=200.0, latency=5e-5),
    timing=Timing(delay=0, shift=1, lost=0.01),
    compensation=Compensation(time=1.5e-6, width=0.2),
    stray=Stray(amplitude=1.0, frequency=90.0, along_alpha=0.8, along_beta=0.6),
    telegraph=Telegraph(amplitude=0.5, dwell=0.02, direction=0.1),
    resonance=Resonance(C=1e-6, L=20e-3, R=5.0),
    warming=Warming(winding=((0.0, 0.0), (0.5, 0.2)), magnets=((0.1, 0.0), (0.4, -0.03))),
)
"""All that can be together; a flux map excludes saturation, and a longer delay is tried by itself."""


def only(*names: str) -> Effects:
    """Those effects of `ALL` that are named."""
    return NONE._replace(**{name: getattr(ALL, name) for name in names})


def scenario_with(effects: Effects, scenario: Scenario = PAPER_RUN, **drive: object) -> Scenario:
    """The scenario with effects, and with other values of its drive."""
    return replace(scenario, effects=effects, drive=replace(scenario.drive, **drive))  # pyright: ignore[reportArgumentType]
