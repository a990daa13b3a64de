"""A hum of the current sensors and a voltage of the mains' frequency: each by its name, or both where none can tell."""

from dataclasses import replace

import pytest

from emulator.conceal.recording import Choice, drawn, recorded
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.samples import Samples
from tests.support.samples import machine_of

SEED = 7120
HUM, VOLTAGE = "current_sensor_hum", "mains_voltage"


def told(kind: str, motor: str, sensors: int, ratio: float) -> Diagnosis:
    """Of a recording of a class, by so many sensors, of a motor with L_q that many times L_d."""
    scenario = drawn(Choice(SEED, (kind,), (0.5, 1.0), (motor,), 0.2), 1)[0].scenario
    timing = scenario.effects.timing._replace(lost=0.0)
    scenario = replace(
        scenario, drive=replace(scenario.drive, current_sensors=sensors, encoder_counts=0),
        motor=scenario.motor._replace(L_q=ratio * scenario.motor.L_d), effects=scenario.effects._replace(timing=timing),
    )  # fmt: skip
    T_s = scenario.drive.T_s
    c = recorded(scenario, round(2.0 / T_s))
    samples = Samples(
        c["theta_e"], c["omega_e"], c["i_d"], c["i_q"], c["u_d"], c["u_q"], T_s, u_dc=c["u_dc"], i_a=c["i_a"],
        i_b=c["i_b"], i_c=c["i_c"],
    )  # fmt: skip
    return diagnose([samples], machine_of(scenario.motor))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "sensors", "ratio", "named"),
    [("current_hum", 2, 1.3, [HUM]), ("current_hum", 3, 1.0, [HUM]), ("mains_voltage", 2, 1.3, [VOLTAGE])],
)
def test_saliency_or_a_third_sensor_tells_a_hum_from_a_voltage(
    kind: str, sensors: int, ratio: float, named: list[str]
) -> None:
    diagnosis = told(kind, "servo_4nm", sensors, ratio)
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert [finding.effect for finding in diagnosis.findings] == named


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["current_hum", "mains_voltage"])
def test_without_these_both_are_told_and_what_would_tell(kind: str) -> None:
    diagnosis = told(kind, "servo_4nm", 2, 1.0)
    assert diagnosis.verdict is Verdict.AMBIGUOUS
    assert not diagnosis.findings
    (doubt,) = diagnosis.ambiguous
    assert set(doubt.effects) == {HUM, VOLTAGE}
    sentence = doubt.experiment.sentence
    assert "with the bridge off" in sentence
    assert sentence.endswith("only mains hum of the current sensors can be read")
