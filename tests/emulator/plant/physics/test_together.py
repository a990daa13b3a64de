"""What holds for all effects: the order of the integration, sizes of zero, refusals of what cannot be."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.dc_link import DcLink
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.friction import Friction
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.sensing import AngleSensing
from emulator.plant.physics.skin import Skin
from emulator.plant.physics.strangers import Resonance, Stray, Telegraph
from emulator.plant.physics.thermal import Thermal
from emulator.plant.physics.turn_short import TurnShort
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER_RUN, Run, parse
from tests.emulator.plant.physics.effect_runs import Column
from tests.emulator.plant.physics.effects import only, scenario_with

SMOOTH = (
    "saturation", "harmonics", "iron_loss", "imbalance", "turn_short", "skin", "friction", "compliance", "stray",
    "resonance",
)  # fmt: skip
FAST = {"iron_loss", "turn_short", "skin", "resonance"}  # time constants near a control period
NO_SIZE = NONE._replace(
    inverter=Inverter(knee=0.5),
    dc_link=DcLink(R=2.0, frequency=100.0),
    iron_loss=IronLoss(omega_h=300.0, lag=2e-4),
    thermal=Thermal(C_m=1.0, ambient=60.0, alpha=0.01),
    demagnetisation=Demagnetisation(time=0.01),
    turn_short=TurnShort(R_t=0.01, phase=2),
    skin=Skin(frequency=50.0),
    friction=Friction(omega_s=1.0),
    compliance=Compliance(damping=1.0, J_L=1.0),
    angle_sensing=AngleSensing(once_phase=1.0, twice_phase=2.0),
    stray=Stray(along_beta=1.0),
    telegraph=Telegraph(dwell=1e-3),
    resonance=Resonance(L=1e-2, R=0.0),
)
"""What remains of effects whose size is zero."""


@pytest.mark.parametrize("names", [(name,) for name in SMOOTH] + [SMOOTH], ids=[*SMOOTH, "all of them"])
def test_halving_the_sub_step_divides_the_error_by_sixteen(names: tuple[str, ...]) -> None:
    """What is smooth within a control period, so without edges; on a shaft that is free to move."""
    run = Run(shaft="free", speed_rpm=900.0, tau_L=0.5)

    def course(sub_steps: int) -> Column:
        scenario = scenario_with(only(*names), bridge="averaged", noise_i=0.0, adc_bits=0, sub_steps=sub_steps)
        return VirtualDrive(replace(scenario, run=run)).record(150)["i_a"]

    exact = course(512)
    coarsest = 4 if set(names) & FAST else 1  # below lies what rounding makes, above what is no step for a fast effect
    errors = [float(np.linalg.norm(course(coarsest * n) - exact)) for n in (1, 2, 4)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize("name", [name for name in Effects._fields if getattr(NO_SIZE, name) != getattr(NONE, name)])
def test_an_effect_of_size_zero_changes_no_bit(name: str) -> None:
    plain = VirtualDrive(scenario_with(NONE)).record(300)
    other = VirtualDrive(scenario_with(NONE._replace(**{name: getattr(NO_SIZE, name)}))).record(300)
    for column, values in plain.items():
        assert np.array_equal(values, other[column]), column


def written(folder: Path, name: str, **arrays: Any) -> None:
    np.savez(folder / name, **arrays)


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of flux maps of which none is one."""
    folder = tmp_path_factory.mktemp("maps")
    (folder / "text.npz").write_text("no map")
    written(folder, "words.npz", i_s_dq=np.array(["a"]), psi_s_dq=np.array(["b"]))
    np.save(folder / "one.npy", np.zeros(20))
    (folder / "cut.npz").write_bytes((folder / "words.npz").read_bytes()[:200])
    written(folder, "half.npz", i_s_dq=np.zeros(20, complex))
    written(folder, "few.npz", i_s_dq=np.zeros(3, complex), psi_s_dq=np.zeros(3, complex))
    written(folder, "flat.npz", i_s_dq=np.zeros(20, complex), psi_s_dq=1j * np.arange(20.0))
    side = np.linspace(-1.0, 1.0, 9)
    psi = (side + 1j * side[:, None]).ravel()
    written(folder, "folded.npz", i_s_dq=psi.real**3 - 0.5 * psi.real + 1j * psi.imag, psi_s_dq=psi)
    return folder


@pytest.mark.parametrize(
    ("section", "sentence"),
    [
        ("effects.rust]", "effects.rust is no effect; the effects are inverter, dc_link, saturation, "),
        ("effects]\nskin = 3", "effects.skin takes a section, got 3"),
        ("effects.skin]\nraise = 0.1", "effects.skin.raise is no key here; the keys are rise, frequency"),
        ("effects.skin]\nrise = -0.1", "effects.skin.rise takes at least 0 and at most 5, got -0.1"),
        ("effects.skin]\nrise = nan", "effects.skin.rise takes at least 0 and at most 5, got nan"),
        ('effects.skin]\nrise = "a lot"', "effects.skin.rise takes a number, got 'a lot'"),
        ("effects.turn_short]\nphase = 3", "effects.turn_short.phase takes at least 0 and at most 2, got 3"),
        ("effects.turn_short]\nphase = 0.5", "effects.turn_short.phase takes a whole number, got 0.5"),
        ("effects.turn_short]\nR_t = 0", "effects.turn_short.R_t takes above 0 ohm, got 0"),
        ("effects.imbalance]\na = -1", "effects.imbalance.a takes at least -0.5 and at most 2, got -1"),
        ("effects.iron_loss]\nR_c = -5", "effects.iron_loss.R_c takes at least 0 ohm, got -5"),
        ("effects.timing]\ndelay = 2", "effects.timing.delay takes at least -1 periods and at most 1 periods, got 2"),
        (
            "effects.timing]\ndelay = -1\nshift = 1",
            "effects.timing.shift takes 0 or -1 with a delay of -1, by which no voltage is known early, got 1",
        ),
        ("effects.friction]\ncoulomb = inf", "effects.friction.coulomb takes at least 0 Nm, got inf"),
        ("effects.inverter]\ndead_time = 1e-6", "effects.inverter takes drive.bridge = 'switched', got 'averaged'"),
        ("effects.dc_link]\nC = 1e-3", "effects.dc_link takes drive.bridge = 'switched', got 'averaged'"),
        (
            'drive]\nbridge = "switched"\nT_s = 2e-5\n[effects.inverter]\ndead_time = 5e-6',
            "effects.inverter.dead_time takes at most a fifth of the control period, 4e-06 s, got 5e-06 s",
        ),
        (
            'drive]\nbridge = "switched"\n[effects.inverter]\ndead_time = 2e-4',
            "effects.inverter.dead_time takes at least 0 s and at most 2e-05 s, got 0.0002",
        ),
        (
            'drive]\nbridge = "switched"\nT_s = 2e-5\n[effects.inverter]\nmin_pulse = 5e-6',
            "effects.inverter.min_pulse takes at most a fifth of the control period, 4e-06 s, got 5e-06 s",
        ),
        (
            'drive]\nbridge = "switched"\n[effects.inverter]\nu_diode = 2.0\nknee = 1e-5',
            "effects.inverter.knee takes at least 0.00606 A with these drops, got 1e-05 A",
        ),
        (
            'drive]\nbridge = "switched"\n[effects.inverter]\nr_on = 100.0',
            "effects.skin and inverter.r_on take resistances of at most 82.5 ohm in all at steps of 1e-05 s, got 200.5",
        ),
        (
            'drive]\nbridge = "switched"\n[effects.dc_link]\nC = 1e-5',
            "effects.dc_link.C takes at least 0.0002 F behind 0.5 ohm, got 1e-05 F",
        ),
        (
            'drive]\nbridge = "switched"\n[effects.dc_link]\nripple = 3.0',
            "effects.dc_link.ripple takes a capacitor, dc_link.C, got 3 V without one",
        ),
        ("effects.saturation]\nL_q_drop = 1", "effects.saturation.L_q_drop takes at least 0 and at most 0.7, got 1"),
        (
            "effects.saturation]\nL_d_drop = 0.6",
            "effects.saturation.L_d_drop takes less for this motor, whose magnets alone would saturate it, got 0.6",
        ),
        (
            "effects.saturation]\ncross_drop = 0.6",
            "effects.saturation.cross_drop takes less for this motor, whose magnets alone would saturate it, got 0.6",
        ),
        ('effects.flux_map]\nfile = "none.npz"', "effects.flux_map.file: no such file: "),
        ('effects.flux_map]\nfile = "text.npz"', "effects.flux_map.file: text.npz is no .npz file of numbers "),
        ('effects.flux_map]\nfile = "words.npz"', "effects.flux_map.file: words.npz is no .npz file of numbers "),
        ('effects.flux_map]\nfile = "one.npy"', "effects.flux_map.file: one.npy is no .npz file of numbers "),
        ('effects.flux_map]\nfile = "cut.npz"', "effects.flux_map.file: cut.npz is no .npz file of numbers "),
        (
            'effects.flux_map]\nfile = "half.npz"',
            "effects.flux_map.file: half.npz takes the arrays i_s_dq and psi_s_dq, psi_s_dq is missing",
        ),
        ('effects.flux_map]\nfile = "few.npz"', "effects.flux_map.file: few.npz takes at least 16 finite points, "),
        ('effects.flux_map]\nfile = "flat.npz"', "effects.flux_map.file: a flux map takes points that differ on both"),
        ('effects.flux_map]\nfile = "folded.npz"', "effects.flux_map.file: a flux map takes inductances above zero "),
        (
            'effects.flux_map]\nfile = "few.npz"\n[effects.saturation]\nL_q_drop = 0.1',
            "effects.saturation takes no size beside effects.flux_map, which has its own",
        ),
        (
            "drive]\nsub_steps = 3\n[effects.iron_loss]\nR_c = 300.0\nlag = 2e-5",
            "effects.iron_loss.lag takes at least 6.68e-05 s at steps of 3.33333e-05 s and this R_c, got 2e-05 s",
        ),
        (
            "effects.compliance]\nstiffness = 1e7",
            "effects.compliance.stiffness takes a resonance of at most 2.5e+04 rad/s at steps of 1e-05 s, got ",
        ),
        (
            "effects.resonance]\nC = 1e-9\nL = 1e-6",
            "effects.resonance.L takes a resonance of at most 2.5e+04 rad/s at steps of 1e-05 s, got 3.162e+07",
        ),
        (
            "effects.resonance]\nC = 1e-3\nL = 1e-4\nR = 20.0",
            "effects.resonance.R takes at most 5 ohm at steps of 1e-05 s, got 20",
        ),
        ("effects.thermal]\nC_w = 0.1", "effects.thermal.C_w takes at least 0.2 J/K, got 0.1"),
        ("effects.thermal]\nC_w = 10\nC_m = 1e-3", "effects.thermal.C_m takes at least 0.005 J/K, got 0.001"),
        ("effects.thermal]\nC_w = 10\nC_h = 1e-3", "effects.thermal.C_h takes at least 0.05691 J/K, got 0.001"),
        (
            "drive]\nsub_steps = 2\n[effects.skin]\nrise = 0.1\nfrequency = 5000",
            "effects.skin.frequency takes at most 1592 Hz at steps of 5e-05 s, got 5000",
        ),
        (
            "drive]\nsub_steps = 2\n[effects.stray]\namplitude = 1.0\nfrequency = 5000",
            "effects.stray.frequency takes at most 1592 Hz at steps of 5e-05 s, got 5000",
        ),
        (
            "drive]\nsub_steps = 1\n[effects.turn_short]\nshare = 0.1",
            "effects.turn_short takes integration steps of at most 3e-05 s, by drive.sub_steps, got 0.0001 s",
        ),
        (
            "effects.iron_loss]\nR_c = 0.01",
            "effects.iron_loss.lag takes at least 0.00107 s at steps of 1e-05 s and this R_c, got 0.0001 s",
        ),
        (
            "effects.compliance]\nstiffness = 100.0\ndamping = 100.0",
            "effects.compliance.damping takes at most 13.5 Nm s/rad at steps of 1e-05 s, got 100",
        ),
        (
            "effects.friction]\ncoulomb = 1.0\nomega_0 = 1e-3",
            "effects.friction.omega_0 takes at least 0.037 rad/s with this friction at steps of 1e-05 s, got 0.001",
        ),
        ("effects.stray]\namplitude = 1e6", "effects.stray.amplitude takes at most 310 V here, got 1e+06"),
        ("effects.telegraph]\namplitude = 400", "effects.telegraph.amplitude takes at most 310 V here, got 400"),
        ("effects.harmonics]\ncogging = 50.0", "effects.harmonics.cogging takes at most 4 Nm here, got 50"),
        (
            'drive]\nbridge = "switched"\n[effects.dc_link]\nC = 1e-3\nripple = 300.0',
            "effects.dc_link.ripple takes at most 155 V here, got 300",
        ),
        (
            'drive]\nbridge = "switched"\n[effects.dc_link]\nC = 1e-5\nR = 50.0',
            "effects.dc_link.C takes at least 1.73e-05 F, of which the rated current empties a quarter",
        ),
        (
            "drive]\nu_dc = 48.0\n[run]\nspeed_rpm = 0\n[effects.voltage_sensing]\noffset = -60.0",
            "effects.voltage_sensing takes gain and offset by which 48 V read as 12 V at least, got -12 V",
        ),
    ],
)
def test_effects_that_cannot_be_are_refused_with_a_sentence(section: str, sentence: str, maps: Path) -> None:
    text = f'[motor]\nname = "servo_4nm"\n[{section}'
    with pytest.raises(ScenarioError, match="^" + re.escape(f"x.toml: {sentence}")) as refusal:
        parse(text, "x.toml", maps)
    assert "\n" not in str(refusal.value)


def test_thermal_and_a_temperature_profile_exclude_each_other() -> None:
    run = replace(PAPER_RUN.run, temperature_profile=((0.0, 23.4), (1.0, 40.0)))
    with pytest.raises(ScenarioError, match=r"paper_run: run\.temperature_profile takes no points beside "):
        VirtualDrive(replace(scenario_with(only("thermal")), run=run))
