"""The library of effects, each concealed in a recording of the emulated drive: named, sized, and nothing else named."""

from dataclasses import replace
from pathlib import Path

import pytest

from emulator.conceal.files import write
from emulator.conceal.recording import Choice
from emulator.conceal.suite import Suite, make
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.physics.library import BY_NAME, LIBRARY
from estimator.samples import Samples
from tests.estimator.diagnosis.concealed_runs import population, recording_of, written
from tests.proof.parts import near_suite, poor_suite
from tests.score.diagnosed import Said, loaded
from tests.score.oracle import answers_in
from tests.score.rows import row_of
from tests.score.truth import EFFECT, truth_of

SEED = 1907  # a run of several speeds and levels
MOTORS = ("beckhoff_am8141", "servo_4nm", "aalto_2k2", "hbl48zl400", "baldor_ecs101m")
CLASSES = (
    "dead_time", "drops", "magnet_heat", "saturation_q", "iron_loss", "winding_heat", "demagnetisation", "skin",
    "current_gain", "eccentric_once", "turn_short",
)
"""Some of each kind; `make score-diagnosis` has them all."""
FARTHEST = 3.0  # standard errors, of any of four parameters of ten recordings


def recorded(kind: str, folder: Path) -> tuple[list[Samples], Machine]:
    """3 s that conceal a class, in the upper third of its sizes, and the nominal machine."""
    choice = Choice(SEED, (kind,), (0.7, 1.0), MOTORS, 3.0)
    make(Suite(choice, 1, folder / "out", folder / "answers", workers=1), lambda _count: None)
    return loaded(folder / "out", "0001")


def diagnosis_of(kind: str, folder: Path) -> Diagnosis:
    return diagnose(*recorded(kind, folder))


def test_every_effect_says_what_it_is() -> None:
    for effect in LIBRARY:
        assert BY_NAME[effect.name] is effect
        assert effect.title
        assert effect.fingerprint
        assert effect.confused_with
        assert BY_NAME.keys() >= set(effect.confused_with)
        assert all(parameter.unit for parameter in effect.parameters)
        assert effect.sizes


@pytest.mark.slow
@pytest.mark.parametrize("kind", CLASSES)
def test_a_concealed_effect_is_named_and_nothing_else(kind: str, tmp_path: Path) -> None:
    diagnosis = diagnosis_of(kind, tmp_path)
    assert [finding.effect for finding in diagnosis.findings] == [EFFECT[kind]]
    assert diagnosis.fit is not None
    assert diagnosis.fit.free_run_rms_A.after < diagnosis.fit.free_run_rms_A.before
    (answer,) = answers_in(tmp_path / "answers")
    row = row_of(kind, truth_of(answer), {}, Said(diagnosis, "", 0.0))
    assert set(row.deviations) == set(PARAMETERS)
    assert all(off < FARTHEST for off in row.deviations.values()), row.deviations
    assert all(size.right for size in row.sizes.values()), row.sizes


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "number"), [("flux_harmonics", 5), ("iron_loss", 16), ("eccentric_twice", 5)])
def test_a_faint_effect_is_named_once_it_stands_out(kind: str, number: int, tmp_path: Path) -> None:
    """More than ten times what an oracle could see, and still far below a typical size."""
    choice = Choice(SEED, (kind,), (0.0, 1.0), MOTORS, 3.0)
    there, columns, ratio = near_suite.near(choice, number)
    assert ratio > 10.0
    for folder in ("out", "answers"):
        (tmp_path / folder).mkdir()
    write(there, columns, choice, "0001", tmp_path / "out", tmp_path / "answers")
    diagnosis = diagnose(*loaded(tmp_path / "out", "0001"))
    assert [finding.effect for finding in diagnosis.findings] == [EFFECT[kind]]
    (answer,) = answers_in(tmp_path / "answers")
    row = row_of(kind, truth_of(answer), {}, Said(diagnosis, "", 0.0))
    assert all(size.right for size in row.sizes.values()), row.sizes


@pytest.mark.slow
def test_a_loss_is_no_resonance_beside_another_machine(tmp_path: Path) -> None:
    """It leaves less than the loss does, with an inductance a third larger than the data sheet's."""
    there, columns, _ = near_suite.near(near_suite.near_population(2018, 6.0), 22)
    _, runs, nominal = written(there, columns, near_suite.near_population(2018, 6.0), tmp_path)
    assert [finding.effect for finding in diagnose(runs, nominal).findings] == ["iron_loss"]


def of_population(seed: int, number: int, folder: Path) -> tuple[tuple[str, ...], Diagnosis]:
    """What a recording of a population conceals, by classes, and what is said of it."""
    there, runs, nominal = recording_of(population(seed), number, folder)
    return tuple(there.classes), diagnose(runs, nominal)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number"), [
    pytest.param(2003, 62, id="two effects that make up for each other"),
    pytest.param(2003, 249, id="a small effect beside a step between two samples"),
    pytest.param(2003, 265, id="a ripple of which an encoder's rounding leaves some"),
    pytest.param(2003, 327, id="a shape that trades with its size"),
    pytest.param(2004, 142, id="an offset of the voltage that stands for the magnets"),
    pytest.param(2004, 156, id="a bad contact by which R_s is beyond its tolerance"),
    pytest.param(2004, 136, id="a resonance that two losses stand for"),
    pytest.param(2004, 353, id="a resonance that a rising resistance stands for"),
    pytest.param(2004, 266, id="a voltage that losses, an offset and a delay stand for"),
    pytest.param(2005, 39, id="an iron loss that moves where currents change sign"),
    pytest.param(2005, 46, id="a voltage that leads R_s to its bound"),
    pytest.param(2005, 227, id="a light rotor that is healthy"),
    pytest.param(2005, 269, id="a resistance that drops as much of a fast change as the inductances do"),
    pytest.param(2005, 342, id="a saturation beyond what surrogates without it show"),
    pytest.param(2005, 374, id="a light rotor beside an offset of its current sensors"),
    pytest.param(2005, 379, id="a healthy drive at one level, which first steps made mad"),
    pytest.param(2006, 174, id="a drift beside an iron loss of a saturated machine"),
    pytest.param(2006, 351, id="a small saturation beside an encoder that is loud at the ends"),
    pytest.param(2006, 353, id="a step that explains little but at its moment"),
    pytest.param(2007, 11, id="an iron loss that a shift by two rows seems to undo"),
    pytest.param(2007, 28, id="a small resonance that seems a rising resistance"),
    pytest.param(2007, 262, id="a resonance that seems a loss, an offset and a drift"),
    pytest.param(2008, 318, id="a row late beside a short, by a convention two late and one early"),
    pytest.param(2008, 333, id="a healthy drive that a branch beside nothing seems to explain"),
    pytest.param(2010, 71, id="magnets that warm up in a machine that saturates"),
    pytest.param(2010, 117, id="a voltage a row late beside a loss and a short, and rows that are lost"),
    pytest.param(2010, 191, id="an offset that an encoder's rounding makes up"),
    pytest.param(2013, 95, id="an angle that is off, for which a saturation of another machine stands"),
    pytest.param(2014, 181, id="a step that no effect tried first points to"),
    pytest.param(2014, 233, id="a healthy drive whose rotor a torque of i_d i_q moves"),
    pytest.param(2016, 51, id="a healthy drive on whose rounding a rising resistance leans"),
    pytest.param(2016, 321, id="an angle that is off as an offset of the voltage would be"),
    pytest.param(2017, 67, id="a late channel beside a short in a phase of another resistance"),
    pytest.param(2017, 214, id="a voltage a row early, turned by an angle that was foreseen"),
    pytest.param(2017, 238, id="a short whose current alone moves one axis"),
    pytest.param(2019, 175, id="a resonance beside an inductance that is not told"),
])  # fmt: skip
def test_what_was_missed_once_is_said(seed: int, number: int, tmp_path: Path) -> None:
    """Of populations that were looked at."""
    classes, diagnosis = of_population(seed, number, tmp_path)
    known = {EFFECT[name] for name in classes if name in EFFECT}
    assert {finding.effect for finding in diagnosis.findings} == known
    assert diagnosis.ambiguous == ()
    if classes:
        assert diagnosis.verdict is (Verdict.EXPLAINED if known else Verdict.UNEXPLAINED)
    else:
        assert diagnosis.verdict in (Verdict.NO_MISMATCH, Verdict.NOT_ENOUGH_EXCITATION)


@pytest.mark.slow
def test_what_one_level_makes_of_an_inductance_is_doubted_beside_a_name(tmp_path: Path) -> None:
    """A saturation that differs from the machine's parameters by less than a millionth of its energy."""
    _, diagnosis = of_population(2004, 392, tmp_path)
    assert {finding.effect for finding in diagnosis.findings} == {"phase_resistance_imbalance"}
    assert [doubt.effects for doubt in diagnosis.ambiguous] == [("q_axis_saturation",)]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number"), [
    pytest.param(2006, 48, id="an angle's rounding and a free shaft"),
    pytest.param(2006, 202, id="the same on another motor"),
    pytest.param(2008, 308, id="a current that moves less than its noise"),
    pytest.param(2016, 305, id="an angle that is told in coarser numbers than its counts"),
])  # fmt: skip
def test_a_healthy_drive_gets_no_name(seed: int, number: int, tmp_path: Path) -> None:
    """A saturation or a loss, in populations that were looked at."""
    assert of_population(seed, number, tmp_path)[1].findings == ()


@pytest.mark.slow
def test_an_inductance_that_is_not_told_is_not_outside_its_tolerance(tmp_path: Path) -> None:
    """A voltage that leads, beside a current that moves less than its noise."""
    diagnosis = of_population(2009, 276, tmp_path)[1]
    assert [finding.effect for finding in diagnosis.findings] == ["voltage_delay"]
    assert diagnosis.ambiguous == ()


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "numbers"), [
    pytest.param(2004, (52, 68, 69), id="a machine that runs astray, an encoder's beat, currents of a short alone"),
    pytest.param(2009, (13, 31), id="a rising resistance that scales the machine, a current that is noise"),
    pytest.param(2014, (36,), id="magnets that warm up at one level, as a winding that cools"),
    pytest.param(2017, (33, 41), id="what an encoder's counts leave at one speed"),
    pytest.param(2018, (13, 51), id="effects that lean on each other, and a faint one, at one speed and level"),
    pytest.param(2019, (16,), id="an angle that looks like the machine at one speed and level"),
])  # fmt: skip
def test_what_tells_little_gets_no_wrong_name(seed: int, numbers: tuple[int, ...], tmp_path: Path) -> None:
    """Of populations that were looked at."""
    poor_suite.make(seed, 78, tmp_path / "out", tmp_path / "answers", 2, only=numbers)
    answers = answers_in(tmp_path / "answers")
    names = [answer["recording"] for answer in answers]
    assert len(names) == len(numbers)
    said = {name: Said(diagnose(*loaded(tmp_path / "out", name)), "", 0.0) for name in names}
    assert poor_suite.wrong(answers, said) == []


@pytest.mark.slow
def test_a_machine_that_a_meter_contradicts_is_asked_about(tmp_path: Path) -> None:
    """R_s by a meter, 4 % from what all four parameters say: all voltages may be scaled."""
    runs, nominal = recorded("none", tmp_path)
    (answer,) = answers_in(tmp_path / "answers")
    true = truth_of(answer).machine
    metered = replace(nominal, R_s=1.04 * true["R_s"])
    plain, trusted = diagnose(runs, metered), diagnose(runs, metered, trust={"R_s": 0.005})
    assert plain.ambiguous == ()
    assert trusted.verdict is Verdict.AMBIGUOUS
    assert "dc_link_gain" in trusted.ambiguous[0].effects
    assert "beyond the tolerance of 0.5 %" in trusted.remarks[-1]


@pytest.mark.slow
def test_where_nothing_is_concealed_nothing_is_named(tmp_path: Path) -> None:
    diagnosis = diagnosis_of("none", tmp_path)
    assert diagnosis.findings == ()
    assert diagnosis.verdict in (Verdict.NO_MISMATCH, Verdict.NOT_ENOUGH_EXCITATION)


@pytest.mark.slow
def test_as_few_rows_as_can_be_are_judged(tmp_path: Path) -> None:
    (run, *_), nominal = recorded("none", tmp_path)
    diagnosis = diagnose([run[:2400]], nominal)
    assert diagnosis.findings == ()
    assert diagnosis.fit is not None
    assert diagnosis.verdict in (Verdict.NO_MISMATCH, Verdict.NOT_ENOUGH_EXCITATION)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["stray_voltage", "telegraph", "resonance"])
def test_a_stranger_is_described_and_not_named(kind: str, tmp_path: Path) -> None:
    diagnosis = diagnosis_of(kind, tmp_path)
    assert diagnosis.verdict is Verdict.UNEXPLAINED
    assert diagnosis.findings == ()
    assert diagnosis.unexplained is not None
    assert diagnosis.unexplained.description
