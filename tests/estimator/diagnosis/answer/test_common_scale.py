"""What no recording tells - all voltages or all currents scaled alike - is said as far as a data sheet allows it."""

import pytest

from estimator.diagnosis.answer.common_scale import IMPEDANCES, scaled, scales_left_open, uncalibrated
from estimator.diagnosis.verdict import Ambiguity, Finding, Place, Quantity, Range
from estimator.machine import PARAMETERS, UNITS, Machine

NOMINAL = Machine(1.0, 2e-3, 3e-3, 0.1, 4, 5.0)
TOLERANCE = dict.fromkeys(PARAMETERS, 0.1)
TRUE = {"R_s": 1.06, "L_d": 2e-3 * 0.95, "L_q": 3e-3 * 1.02, "psi_f": 0.1 * 0.98}  # of this machine, of the series


def told(voltages: float = 1.0, currents: float = 1.0, std: float = 0.0) -> dict[str, Quantity]:
    """What a fit makes of the true machine by a drive that reads so many times what is there."""
    values = {name: TRUE[name] * voltages / (currents if name in IMPEDANCES else 1.0) for name in PARAMETERS}
    return {name: Quantity(value, std * value, UNITS[name]) for name, value in values.items()}


@pytest.mark.parametrize("gain", [0.94, 1.0, 1.07])
def test_the_range_holds_the_gain_that_is_there(gain: float) -> None:
    voltages = scales_left_open(told(voltages=gain), NOMINAL, TOLERANCE, PARAMETERS)["voltages"]
    assert voltages.least == pytest.approx(gain * 1.06 / 1.1)
    assert voltages.most == pytest.approx(gain * 0.95 / 0.9)
    currents = scales_left_open(told(currents=gain), NOMINAL, TOLERANCE, PARAMETERS)["currents"]
    assert currents.least == pytest.approx(gain * 0.9 / 0.95)
    assert currents.most == pytest.approx(gain * 1.1 / 1.06)


def test_a_meter_leaves_little_open_and_an_uncertain_fit_more() -> None:
    machine = Machine(TRUE["R_s"], 2e-3, 3e-3, 0.1, 4, 5.0)
    metered = scales_left_open(told(), machine, TOLERANCE | {"R_s": 0.005}, PARAMETERS)
    assert metered["currents"].most - metered["currents"].least == pytest.approx(0.01, rel=0.01)
    wide = scales_left_open(told(std=0.02), NOMINAL, TOLERANCE, PARAMETERS)["voltages"]
    assert wide.least == pytest.approx(1.06 * 0.96 / 1.1)


def test_what_is_not_told_says_nothing_of_a_scale() -> None:
    untold = told() | {"R_s": Quantity(None, None, "ohm"), "L_d": Quantity(1e-3, None, "H")}
    assert scales_left_open(untold, NOMINAL, TOLERANCE, PARAMETERS)["currents"].least == pytest.approx(0.9 / 1.02)
    assert set(scales_left_open(told(), NOMINAL, TOLERANCE, ["psi_f"])) == {"voltages"}
    assert scales_left_open(told(), NOMINAL, dict.fromkeys(PARAMETERS, 1.0), PARAMETERS) == {}
    another = told() | {"L_d": Quantity(5e-3, 1e-6, "H")}
    assert scales_left_open(another, NOMINAL, TOLERANCE, PARAMETERS) == {}


def test_sensors_that_are_off_are_doubted_where_all_they_read_may_be() -> None:
    differ, offset = (
        Finding(name, {}, Place("", {}, 1.0, 1.0), 1e9, (), {}) for name in ("current_sensor_gain", "voltage_offset")
    )
    (doubt,) = uncalibrated([differ], {"currents": Range(0.98, 1.15)}, TOLERANCE)
    assert "read as 0.98 to 1.15 times what they are" in doubt.reason
    assert "a current by a probe" in doubt.experiment.sentence
    assert uncalibrated([differ], {"currents": Range(0.95, 1.05)}, TOLERANCE) == []
    (doubt,) = uncalibrated([differ, offset], {"currents": Range(0.95, 1.05), "voltages": Range(0.88, 1.0)}, TOLERANCE)
    assert doubt.effects == ("dc_link_gain", "convention_error")
    assert uncalibrated([], {"currents": Range(0.98, 1.15)}, TOLERANCE) == []


def test_parameters_beyond_their_tolerance_are_asked_about_by_what_they_have_in_common() -> None:
    def asked(after: dict[str, Quantity], *off: str) -> list[Ambiguity]:
        return scaled(after, off, NOMINAL, TOLERANCE, scales_left_open(after, NOMINAL, TOLERANCE, PARAMETERS))

    (doubt,) = asked(told(voltages=1.2), *PARAMETERS)
    assert doubt.effects == ("dc_link_gain", "convention_error")
    assert "all voltages may be read as 1.16 to 1.27 times what they are" in doubt.reason
    (doubt,) = asked(told(currents=1.2), "L_d", "L_q")
    assert doubt.effects == ("current_sensor_gain", "convention_error")
    (doubt,) = asked(told(voltages=0.93), "L_d")
    assert doubt.effects == ("dc_link_gain", "current_sensor_gain", "convention_error")
    assert asked(told() | {"L_d": Quantity(9e-3, 1e-6, "H")}, "L_d") == []
    assert asked(told()) == []


def test_a_machine_file_of_another_convention_is_asked_about_before_sensors() -> None:
    def asked(by: dict[str, float]) -> list[Ambiguity]:
        after = {name: Quantity(getattr(NOMINAL, name) / by.get(name, 1.0), 0.0, UNITS[name]) for name in PARAMETERS}
        return scaled(after, list(by), NOMINAL, TOLERANCE, scales_left_open(after, NOMINAL, TOLERANCE, PARAMETERS))

    (doubt,) = asked(dict.fromkeys(IMPEDANCES, 2.0))
    assert doubt.effects == ("convention_error", "current_sensor_gain")
    assert doubt.rivals
    assert doubt.reason.startswith("R_s, L_d and L_q of the machine file are twice the recording's: are they from term")
    assert "psi_f 1.00; or all currents may be read as 1.80 to 2.20 times what they are; or the machine" in doubt.reason
    (doubt,) = asked({"psi_f": 3.0**0.5})
    assert doubt.effects == ("convention_error",)
    assert not doubt.rivals
    assert doubt.reason.startswith("psi_f of the machine file is sqrt(3) times the recording's")
    (doubt,) = asked({"R_s": 2.0})
    assert doubt.reason.startswith("R_s of the machine file is twice the recording's")
    assert asked({"psi_f": 1.2})[0].effects == ("dc_link_gain", "convention_error")
    assert asked({"R_s": 1.4}) == []


def test_a_winding_is_warm_before_all_else_is_scaled_unless_a_meter_tells_it() -> None:
    after = told(voltages=1.05)
    scales = scales_left_open(after, NOMINAL, TOLERANCE, PARAMETERS)
    assert scaled(after, ["R_s"], NOMINAL, TOLERANCE, scales) == []
    assert scaled(after, ["R_s"], NOMINAL, TOLERANCE | {"R_s": 0.05}, scales) != []
