"""The library of effects, each concealed in a recording of the emulated drive: named, sized, and nothing else named."""

from dataclasses import replace
from pathlib import Path

import pytest

from emulator.conceal.recording import Choice
from emulator.conceal.suite import Suite, make
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.physics.library import BY_NAME, LIBRARY
from estimator.samples import Samples
from tests.score.diagnosed import Said, loaded
from tests.score.oracle import answers_in
from tests.score.rows import row_of
from tests.score.truth import EFFECT, truth_of

SEED = 1907  # a run of several speeds and levels
MOTORS = ("beckhoff_am8141", "servo_4nm", "aalto_2k2", "hbl48zl400", "baldor_ecs101m")
CLASSES = (
    "dead_time", "drops", "magnet_heat", "saturation_q", "iron_loss", "winding_heat", "demagnetisation", "skin",
    "current_gain", "eccentric_once", "turn_short", "winding_warmed", "magnets_warmed",
    "signal_harmonics", "hall_displaced",
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
