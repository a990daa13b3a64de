"""The proof on absorbed effects: its cases, how it judges, and two of them done."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from estimator.machine import PARAMETERS
from tests.proof.parts.absorbed import Outcome, Step, judged, proof_of, prove
from tests.proof.parts.absorbed_cases import KINDS, cases
from tests.proof.proof import Settings

TRUTH = {"R_s": 1.0, "L_d": 1e-3, "L_q": 2e-3, "psi_f": 0.1}


def test_cases_are_decided_by_their_seed_and_every_kind_has_two_motors() -> None:
    one, same, other = cases(1200, quick=False), cases(1200, quick=False), cases(1201, quick=False)
    assert [(case.name, case.size, case.scenario) for case in one] == [
        (case.name, case.size, case.scenario) for case in same
    ]
    assert all(a.size != b.size for a, b in zip(one, other, strict=True))
    assert all(len({case.motor for case in one if case.kind is kind}) >= 2 for kind in KINDS)
    assert {case.name for case in cases(1200, quick=True)} < {case.name for case in one}


def said(verdict: str, *names: str, R_s: float = 1.0) -> dict[str, Any]:
    after = {name: {"value": value, "std": 1e-3 * value} for name, value in {**TRUTH, "R_s": R_s}.items()}
    findings = [{"effect": name, "parameters": {"dead_time": {"value": 1e-6, "std": 1e-8, "unit": "s"}}}
                for name in names]  # fmt: skip
    scales = {"voltages": {"least": 0.97, "most": 1.05}}
    return {"verdict": verdict, "findings": findings, "ambiguous": [], "machine": {"after": after, "scales": scales}}


@pytest.mark.parametrize(
    ("diagnosis", "wrong"),
    [
        (said("explained", "inverter_voltage_error"), ""),
        (said("explained", "iron_loss"), "names iron_loss"),
        (said("no_mismatch"), ""),
        (said("no_mismatch", R_s=1.02), "no_mismatch with R_s off by +2.0%"),
        (said("ambiguous", R_s=1.5), ""),
        (said("partly_explained", "inverter_voltage_error", R_s=1.5), ""),
        (said("explained", "inverter_voltage_error", R_s=0.9), "explained with R_s off by -10.0%"),
    ],
)
def test_who_is_sure_and_wrong_is_told_from_who_doubts(diagnosis: dict[str, Any], wrong: str) -> None:
    (case, *_) = cases(1200, quick=True)
    assert judged("", diagnosis, case, TRUTH).wrong == wrong


@pytest.mark.parametrize(("gain", "warned"), [(1.04, True), (1.06, False), (0.96, False)])
def test_a_scale_that_is_said_to_be_open_is_told_from_one_that_is_not(gain: float, warned: bool) -> None:
    (case,) = [case for case in cases(1200, quick=False) if case.name == "dc-link_gain_servo_4nm"]
    sensing = case.scenario.effects.voltage_sensing._replace(gain=gain)
    effects = case.scenario.effects._replace(voltage_sensing=sensing)
    case = replace(case, scenario=replace(case.scenario, effects=effects))
    step = judged("", said("no_mismatch", R_s=gain), case, TRUTH)
    assert step.wrong.startswith("no_mismatch with R_s off by")
    assert step.warned == warned
    errors = dict.fromkeys(PARAMETERS, gain - 1.0)
    proof = proof_of([Outcome("gain", "m", "", "voltages", "1", 0, 1.0, {"wls": errors}, errors, (step,))])
    assert [bar.held for bar in proof.bars if "that scale" in bar.what] == [warned]


def test_what_was_missed_is_printed_as_missed() -> None:
    errors = dict.fromkeys(PARAMETERS, 0.05)
    wrong = "no_mismatch with R_s off by +5.0%"
    step = Step("the first recording", "no_mismatch", (), (), "", "1e-06 s", errors, wrong)
    by = {"wls": errors}
    outcome = Outcome("dead time", "m", "inverter_voltage_error", "", "1e-06 s", 0, 1.2, by, errors, (step,))
    proof = proof_of([outcome])
    assert [bar.held for bar in proof.bars] == [False, False, False]


@pytest.mark.slow
@pytest.mark.live
def test_two_cases_are_found_by_what_the_bench_does_on_the_drive(tmp_path: Path) -> None:
    proof = prove(Settings(seed=1200, quick=True, jobs=2, folder=tmp_path))
    assert all(bar.held for bar in proof.bars), proof
