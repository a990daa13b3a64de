"""Diagnose: a recording and a nominal machine to a verdict with findings, doubts, a model and how well it fits.

User errors first (`intake`), then the set of effects that explains the rows (`search`), what of it can be told
(`answer.judged`) and how (`answer.statement`). A pure function: the same samples give the same answer. Knows nothing of
files and reports.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from estimator.diagnosis.angle.hall_edges import through_edges
from estimator.diagnosis.answer.convention_told import taken_back, with_convention
from estimator.diagnosis.answer.design import experiment
from estimator.diagnosis.answer.held_out import odd_stretches
from estimator.diagnosis.answer.judged import Judged, judged
from estimator.diagnosis.answer.quality import SHORTEST, longest
from estimator.diagnosis.answer.sentences import sentence_of, with_contradictions
from estimator.diagnosis.answer.statement import stated
from estimator.diagnosis.answer.witnessed import contradicting, taken_in, tolerances
from estimator.diagnosis.intake.answered import Answered, answer_alone, answered
from estimator.diagnosis.intake.bad_samples import without_bad
from estimator.diagnosis.intake.convention import Suspicion, both, of_sensor, suspected
from estimator.diagnosis.intake.data_sheet import contradicted
from estimator.diagnosis.intake.drive_data import believed
from estimator.diagnosis.intake.input_check import checked
from estimator.diagnosis.intake.phase_sensors import sensor_fault, without_fault
from estimator.diagnosis.intake.prepared import prepared
from estimator.diagnosis.intake.voltage_frame import in_own_frame
from estimator.diagnosis.likelihood.columns import STRETCHES
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import unidentified_inductances
from estimator.diagnosis.search.fitting import at_nominal
from estimator.diagnosis.search.stages import explained
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.samples import Samples
from estimator.twin.model import Model
from estimator.witness import Witness

TOLERANCE: Final = 0.10  # of a data sheet's R_s, L_d, L_q, psi_f
_FEWEST: Final = 50 * STRETCHES  # rows
_INDUCTANCES: Final = frozenset({"L_d", "L_q"})
_MAPPED: Final = (
    "the flux linkages bend as no saturation curve of the library does: a free map of them over the currents is a part "
    "of this diagnosis"
)


class Examined(NamedTuple):
    """A diagnosis, and what it was found by; that is None where nothing was fitted."""

    diagnosis: Diagnosis
    given: Given | None = None
    judged: Judged | None = None


def _silent(_share: float, _phase: str) -> None:
    return


def diagnose(runs: Sequence[Samples], nominal: Machine, *, trust: Mapping[str, float] | None = None,
             witnesses: Mapping[str, Witness] | None = None,
             progress: Callable[[float, str], None] = _silent) -> Diagnosis:
    """Diagnose a recording's runs. `trust`: tolerance of R_s, L_d, L_q, psi_f as a share. `progress` may raise.

    `witnesses` stand in for nominal values, with half a 95 % interval for the tolerance; one that the recording
    contradicts does not. Raises ValueError, in a sentence, for samples that cannot be diagnosed.
    """
    return examined(runs, nominal, trust=trust, witnesses=witnesses, progress=progress).diagnosis


def examined(runs: Sequence[Samples], nominal: Machine, *, trust: Mapping[str, float] | None = None,
             witnesses: Mapping[str, Witness] | None = None,
             progress: Callable[[float, str], None] = _silent, as_recorded: bool = False) -> Examined:
    """As `diagnose`, with the fit that the diagnosis was found by. `as_recorded`: whatever convention is suspected."""
    used, trust, against = dict(witnesses or {}), trust or {}, list[str]()
    while True:
        by = replace(nominal, **{name: one.value for name, one in used.items()})
        found = _examined(runs, by, {**trust, **tolerances(used)}, progress, as_recorded)
        wrong = contradicting(found.diagnosis.machine_after, used)
        if not wrong:
            break
        against += wrong.values()
        used = {name: one for name, one in used.items() if name not in wrong}
    said = found.diagnosis
    said = with_contradictions(said, against)
    return found._replace(diagnosis=replace(said, remarks=(*said.remarks, *taken_in(used))))


def _examined(
    runs: Sequence[Samples], nominal: Machine, trust: Mapping[str, float], progress: Callable[[float, str], None],
    as_recorded: bool,
) -> Examined:  # fmt: skip
    tolerance = {name: trust.get(name, TOLERANCE) for name in PARAMETERS}
    runs, through = through_edges(runs)
    runs, left_out = without_bad(runs, nominal)
    runs, sensor, said = _with_sound_sensors(runs, nominal)
    checks = checked(runs, nominal)
    checks = checks._replace(remarks=(*through, *left_out, *said, *checks.remarks))
    long_enough = [run for run in runs if len(run) >= 3]
    rows_there = sum(map(len, long_enough))
    if checks.stop or rows_there < _FEWEST:
        few = f"expected at least {_FEWEST} rows to tell effects from noise, came {rows_there}; record some seconds"
        return Examined(_no_verdict(checks.remarks if checks.stop else (*checks.remarks, few)))
    if (answer := answer_alone(long_enough, nominal.i_rated)) is not None:
        return Examined(_told_answer(long_enough, nominal, tolerance, checks.remarks, answer))
    suspicion = None if as_recorded else suspected(long_enough, nominal, tolerance)
    if suspicion is not None:
        told = suspicion if sensor is None else both(sensor, suspicion)
        found = _explained_without(long_enough, nominal, tolerance, checks.remarks, progress, told)
        if found is not None:
            return found
    elif not as_recorded and (wrong := contradicted(long_enough, nominal)) is not None:
        return Examined(_no_verdict((*checks.remarks, wrong)))
    told = None if sensor is None else replace(sensor, runs=tuple(long_enough))
    found = _explained_without(long_enough, nominal, tolerance, checks.remarks, progress, told)
    assert found is not None
    return found


def _with_sound_sensors(
    runs: Sequence[Samples], nominal: Machine
) -> tuple[Sequence[Samples], Suspicion | None, tuple[str, ...]]:
    """The runs as three sound sensors of phase currents make them; what was wrong with one where i_d and i_q are made
    of it, else remarks.
    """
    fault = sensor_fault(runs)
    if fault is None:
        return runs, None, ()
    if fault.sure and fault.made_of:
        sensor = of_sensor(fault, runs, nominal)
        return sensor.runs, sensor, ()
    if fault.sure and fault.made_of is False:
        runs = without_fault(runs, fault)
    return runs, None, (fault.remark(),)


def _explained_without(
    runs: Sequence[Samples], nominal: Machine, tolerance: Mapping[str, float], remarks: Sequence[str],
    progress: Callable[[float, str], None], suspicion: Suspicion | None = None,
) -> Examined | None:  # fmt: skip
    """The diagnosis of the recording without a suspected cause; None where the library takes some of that back."""
    if suspicion is not None:
        runs, nominal = suspicion.runs, suspicion.machine
    runs, not_used = believed(runs)
    runs, framed = in_own_frame(runs, nominal)
    remarks = (*remarks, *not_used, *framed)
    rows, given = prepared(runs, nominal, tolerance)
    if longest(odd_stretches(len(rows)) & rows.joined) < SHORTEST:
        return Examined(_no_verdict((*remarks, (
            f"expected stretches of at least {SHORTEST} periods without a gap to judge by; record over a faster link, "
            "or by a capture buffer"
        ))))  # fmt: skip
    progress(0.0, "fitting")
    answer = answered(runs)
    unidentified = _INDUCTANCES if answer and answer.alone else unidentified_inductances(at_nominal(rows, given))
    given = replace(given, unidentified=unidentified, answered=answer is not None)
    there = explained(rows, given, progress)
    if suspicion is not None and taken_back(suspicion, there.found.model, tolerance):
        return None
    told = judged(rows, given, there, progress)
    progress(0.9, "weighing the answer")
    diagnosis = stated(given, told)
    if suspicion is not None:
        diagnosis = with_convention(diagnosis, suspicion)
    said = sentence_of(diagnosis, "" if suspicion is None else suspicion.says)
    causes = () if suspicion is None else (suspicion.sentence,)
    mapped = () if diagnosis.flux_map is None else (_MAPPED,)
    diagnosis = replace(diagnosis, remarks=(*remarks, *causes, *diagnosis.remarks, *mapped), sentence=said)
    return Examined(diagnosis, given, told)


def _told_answer(
    runs: Sequence[Samples], nominal: Machine, tolerance: Mapping[str, float], remarks: Sequence[str], answer: Answered
) -> Diagnosis:
    """Nothing moves but noise and what the controller makes of it: no fit, and what to record instead."""
    runs, not_used = believed(runs)
    rows, given = prepared(runs, nominal, tolerance)
    noise_d, noise_q = answer.noise
    noise = nominal.L_d * noise_d, nominal.L_q * noise_q, noise_d
    richer = experiment(rows, Model(given.machine), noise, nominal, tolerance)
    said = replace(_no_verdict((*remarks, *not_used, answer.sentence)), experiment=richer)
    return replace(said, sentence=sentence_of(said))


def _no_verdict(remarks: Sequence[str]) -> Diagnosis:
    """Nothing can be fitted: what is wrong, and what to record instead."""
    said = "not enough to judge: " + "; ".join(remarks)
    return Diagnosis(
        Verdict.NOT_ENOUGH_EXCITATION, said[0].upper() + said[1:], (), (), None, {}, {}, {}, None, (), tuple(remarks),
        None,
    )  # fmt: skip
