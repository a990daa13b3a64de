"""A forced angle in place of the encoder's: the rotor follows the field, and the encoder is read as it comes."""

import math
from dataclasses import replace

import pytest

from drivers.wire.lease import Action, Bridge, Record, packed
from emulator.drive.control_lease import DeniedError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.friction import Friction
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, Run

MOUNTED = 0.4  # rad, mechanical
CURRENT = 2.0  # A
SECOND = 10_000  # control periods
FREE = replace(
    PAPER, run=Run(shaft="free"), effects=NONE._replace(friction=Friction(coulomb=0.01)),
    motor=PAPER.motor._replace(J=2e-4, B=1e-3),
)  # fmt: skip


def forced(**drive: bool) -> VirtualDrive:
    """A drive whose field stands at angle 0, and whose rotor has come to it."""
    virtual = VirtualDrive(replace(
        FREE, drive=replace(FREE.drive, encoder_offset=MOUNTED, enabled=False, **drive),
        excitation=replace(FREE.excitation, i_q_ref=0.0, i_d_step=0.0, i_q_step=0.0),
    ))  # fmt: skip
    virtual.write("angle_source", 1.0)
    virtual.write("i_d_ref", CURRENT)
    for word in (6.0, 7.0, 15.0):
        virtual.write("control_word", word)
    virtual.run(2 * SECOND)
    return virtual


@pytest.mark.parametrize(("crossed", "backwards", "way"), [
    (False, False, 1.0), (True, False, -1.0), (False, True, -1.0), (True, True, 1.0),
])  # fmt: skip
def test_the_encoder_turns_by_the_field_over_pole_pairs_with_it_or_against_it(
    crossed: bool, backwards: bool, way: float
) -> None:
    virtual = forced(phases_crossed=crossed, encoder_reversed=backwards)
    assert virtual.read("encoder_angle") == pytest.approx(MOUNTED, abs=0.01)
    virtual.write("forced_angle", math.pi / 2.0)
    virtual.run(2 * SECOND)
    assert virtual.read("encoder_angle") == pytest.approx(MOUNTED + way * math.pi / 2.0 / FREE.motor.n_p, abs=0.01)
    assert virtual.read("theta_e") == pytest.approx(math.pi / 2.0, abs=1e-3)
    assert virtual.read("i_d") == pytest.approx(CURRENT, abs=0.1)


def test_the_field_goes_at_its_rate() -> None:
    virtual = forced()
    virtual.write("forced_speed", 2.0)
    virtual.write("forced_angle", 1.0)
    virtual.run(SECOND // 4)
    assert virtual.read("theta_e") == pytest.approx(0.5, abs=0.01)
    assert virtual.read("omega_e") == pytest.approx(2.0, rel=0.01)


def test_the_source_of_the_angle_is_not_changed_while_the_bridge_is_on() -> None:
    virtual = forced()
    with pytest.raises(DeniedError):
        virtual.write("angle_source", 0.0)


def test_without_control_it_is_the_encoder_s_again_and_no_speed_comes_of_the_change() -> None:
    virtual = VirtualDrive(FREE, on_links=True)

    def control(action: Action, bridge: Bridge) -> None:
        virtual.control(packed(Record(7, action, bridge, 1.0, "test")))

    control(Action.TAKE, Bridge.AS_IT_IS)
    with pytest.raises(DeniedError):  # by who does not hold it
        virtual.request("angle_source", 1.0)
    virtual.write("angle_source", 1.0)
    virtual.write("i_d_ref", CURRENT)
    control(Action.RENEW, Bridge.ON)
    virtual.run(SECOND // 2)
    control(Action.RELEASE, Bridge.AS_IT_IS)
    virtual.run(100)
    assert virtual.values(("angle_source", "forced_angle", "i_d_ref")) == dict.fromkeys(
        ("angle_source", "forced_angle", "i_d_ref"), 0.0
    )
    assert abs(virtual.read("omega_e")) < 30.0
