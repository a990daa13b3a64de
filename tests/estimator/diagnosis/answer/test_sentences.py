"""What a finding's sizes read like: value and interval of one kind, no more digits than they bear."""

from dataclasses import replace

import pytest

from estimator.diagnosis.answer.sentences import quantity, sentence_of
from estimator.diagnosis.verdict import Ambiguity, Diagnosis, ErrorChange, Experiment, Fit, Quantity, Range, Verdict
from tests.support.diagnoses import CONVENTION, EXPLAINED, NO_MISMATCH


def with_size(name: str, told: Quantity) -> Diagnosis:
    return replace(EXPLAINED, findings=(replace(EXPLAINED.findings[0], parameters={name: told}),))


@pytest.mark.parametrize(
    ("name", "told", "said"),
    [
        ("gain_b", Quantity(1.0131, 1.4e-5, "1"), "gain b 101.3100 ± 0.0027 %"),
        ("L_q_drop", Quantity(0.256, 0.0179, "1"), "L q drop 25.6 ± 3.5 %"),
        ("d_6", Quantity(-0.0313, None, "1"), "d 6 -3.13 %"),
        ("periods", Quantity(1.0, 3e-4, "1"), "periods 1.00000 ± 0.00059"),
        ("dead_time", Quantity(2e-6, 3e-8, "s"), "dead time 2.000 ± 0.059 us"),
        ("dead_time", Quantity(0.0, 5e-9, "s"), "dead time 0.0 ± 9.8 ns"),
        ("dead_time", Quantity(1.28e-10, None, "s"), "dead time 128 ps"),
        ("conductance", Quantity(7.04e-6, 3.1e-7, "S"), "conductance 7.04 ± 0.61 uS"),
        ("u_drop", Quantity(4.76e-3, 0.0473, "V"), "u drop 5 ± 93 mV"),
        ("L_d_most", Quantity(0.0565, 0.00201, "H"), "L d most 56.5 ± 3.9 mH"),
        ("scale", Quantity(0.974, 0.0097, "1"), "scale 97.4 ± 1.9 %"),
        ("R", Quantity(4321.0, 1234.0, "ohm"), "R 4.3 ± 2.4 kohm"),
    ],
)
def test_a_size_and_its_interval_are_of_one_kind(name: str, told: Quantity, said: str) -> None:
    assert f"left out: {said}; it hid" in sentence_of(with_size(name, told))


def test_of_several_sizes_those_that_are_not_told_from_zero_are_bounds_and_their_shapes_left_out() -> None:
    sizes = {
        "dead_time": Quantity(2e-6, 3e-8, "s"), "u_drop": Quantity(7e-5, 0.054, "V"),
        "zero_crossing_width": Quantity(0.0126, 1.4e-4, "A"), "knee": Quantity(0.077, 32.0, "A"),
    }
    said = sentence_of(replace(EXPLAINED, findings=(replace(EXPLAINED.findings[0], parameters=sizes),)))
    whole = "dead time 2.000 ± 0.059 us, zero crossing width 12.60 ± 0.27 mA, u drop no more than 106 mV"
    assert f"left out: {whole}; it hid" in said
    harmonics = replace(EXPLAINED.findings[0], effect="angle_sensor_error", parameters={
        "once": Quantity(0.01, 1e-4, "rad"), "once_phase": Quantity(1.0, 0.01, "rad"),
        "twice": Quantity(1e-6, 1e-5, "rad"), "twice_phase": Quantity(1.0, 4.0, "rad"),
    })  # fmt: skip
    said = sentence_of(replace(EXPLAINED, findings=(harmonics,)))
    assert said.startswith("Errors of the angle sensor's signals were left out: once 10.00 ± 0.20 mrad, once phase")
    assert "twice no more than 20.6 urad; they hid" in said


def test_a_convention_alone_has_no_before_to_compare_with() -> None:
    text = sentence_of(CONVENTION)
    assert text.startswith("The recording follows a convention that differs from the one expected: ")
    assert "error goes from" not in text


def test_beside_a_convention_errors_are_those_of_the_recording_without_it() -> None:
    both = replace(EXPLAINED, findings=(*CONVENTION.findings, *EXPLAINED.findings))
    assert "Once that convention is undone, on stretches that took no part" in sentence_of(both)


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [(1.28e-10, "s", "128 ps"), (7.04e-6, "S", "7.04 uS"), (0.9996, "V", "1 V"), (1234.0, "Hz", "1.23 kHz"),
     (0.0, "V", "0 V"), (None, "V", "unknown"), (0.0435, "rad", "43.5 mrad"), (0.031, "1", "3.1 %"),
     (2e-15, "s", "0.002 ps")],
)  # fmt: skip
def test_small_sizes_have_prefixes_as_in_the_report(value: float | None, unit: str, said: str) -> None:
    assert quantity(value, unit) == said


@pytest.mark.parametrize(
    ("periods", "said"),
    [(1.0, "periods 1.0000 ± 0.0039, that is, the voltage acts later than its row says; it hid"),
     (-1.0, "periods -1.0000 ± 0.0039, that is, the voltage acts earlier than its row says; it hid"),
     (0.46, "acts later than its row says, or currents are filtered or sampled late, which looks the same; it hid")],
)  # fmt: skip
def test_a_delay_says_in_which_direction_and_what_looks_the_same(periods: float, said: str) -> None:
    sizes = {"periods": Quantity(periods, 0.002, "1")}
    late = replace(EXPLAINED.findings[0], effect="voltage_delay", parameters=sizes)
    assert said in sentence_of(replace(EXPLAINED, findings=(late,)))


def test_what_is_left_beyond_noise_is_told_of_what_is_explained() -> None:
    assert EXPLAINED.fit is not None
    floor = EXPLAINED.fit.one_step_rms_V.noise_floor
    assert floor is not None
    for after, told in ((1.04 * floor, False), (1.1 * floor, True)):
        fit = replace(EXPLAINED.fit, one_step_rms_V=ErrorChange(2.69, after, floor))
        assert ("What is left is little beside the voltage" in sentence_of(replace(EXPLAINED, fit=fit))) is told


def test_a_limit_of_all_there_is_is_none() -> None:
    limits = {"q_axis_saturation": Quantity(6.0, None, "1"), "iron_loss": Quantity(2e-3, None, "S")}
    said = sentence_of(replace(NO_MISMATCH, detectable=limits))
    assert "shown iron loss of 500 ohm or less; it would not have shown saturation along the q axis below 100 %" in said


def test_what_an_effect_hid_as_has_prefixes_too() -> None:
    hidden = replace(EXPLAINED.findings[0], absorbed_as={"R_s": -0.00452, "L_q": 1.2e-4})
    assert "it hid as -4.52 mohm of R_s, +120 uH of L_q; " in sentence_of(replace(EXPLAINED, findings=(hidden,)))


def test_pole_pairs_and_rows_are_counts_and_no_shares() -> None:
    told = {"pole_pairs": Quantity(4.0, None, "1"), "u_shift": Quantity(1.0, None, "1")}
    text = sentence_of(replace(CONVENTION, findings=(replace(CONVENTION.findings[0], parameters=told),)))
    assert "pole pairs 4, u shift 1" in text


def test_what_is_beyond_tolerance_is_said_beside_what_is_found() -> None:
    partly = replace(EXPLAINED, verdict=Verdict.PARTLY_EXPLAINED, remarks=("R_s lies 25% from its nominal",))
    assert "Not all is explained: R_s lies 25% from its nominal." in sentence_of(partly)


def test_three_that_are_not_told_apart_are_named_in_one_sentence() -> None:
    doubt = Ambiguity(("iron_loss", "angle_offset", "ac_resistance"), "why", Experiment("what to do"))
    text = sentence_of(replace(EXPLAINED, ambiguous=(doubt,)))
    assert "Cannot tell which it is of iron loss, an offset of the angle, a resistance that rises with " in text


@pytest.mark.parametrize("verdict", [Verdict.EXPLAINED, Verdict.NO_MISMATCH])
def test_a_gain_that_would_not_show_is_said(verdict: Verdict) -> None:
    found = {"iron_loss": Quantity(100.0, None, "ohm")}
    text = sentence_of(replace(EXPLAINED, verdict=verdict, detectable=found))
    assert "gain of all voltages or of all currents, by which the parameters are off then" in text


@pytest.mark.parametrize("verdict", [Verdict.EXPLAINED, Verdict.NO_MISMATCH])
def test_a_scale_that_would_not_show_is_said(verdict: Verdict) -> None:
    scales = {"voltages": Range(0.995, 1.004), "currents": Range(0.951, 1.032)}
    text = sentence_of(replace(EXPLAINED, verdict=verdict, scales=scales))
    assert "A drive that reads all currents as 0.95 to 1.03 times what they are would look the same" in text
    assert "R_s by a meter would tell" in text
    assert "all voltages" not in text  # closely known


@pytest.mark.parametrize(("after", "noise", "left"), [
    (0.104, 0.1, "leave nothing but noise"),
    (0.3, 0.1, "leave little beside the voltage: an error of 300 mV in one step, where noise makes 100 mV"),
    (0.3, None, "leave an error of 300 mV, of which these rows do not tell how much is noise"),
])  # fmt: skip
def test_what_is_left_of_no_mismatch_is_told_where_it_is_more_than_noise(
    after: float, noise: float | None, left: str
) -> None:
    """What is too small beside the voltage to matter is not nothing."""
    fit = Fit(True, ErrorChange(after, after, noise), ErrorChange(0.01, 0.01), 0.0, ErrorChange(1.0, 1.0))
    said = sentence_of(replace(EXPLAINED, findings=(), verdict=Verdict.NO_MISMATCH, fit=fit))
    assert f"the machine's equations with fitted parameters {left}" in said
