"""A cause that is no physics, told beside the diagnosis of the recording without it."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from estimator.diagnosis.answer.common_scale import look_up
from estimator.diagnosis.intake.causes import NO_SCALE
from estimator.diagnosis.intake.convention import Suspicion
from estimator.diagnosis.verdict import Ambiguity, Diagnosis, Experiment, Finding, Place, Verdict
from estimator.diagnosis.words import continued
from estimator.physics import convention_error, voltage_delay
from estimator.twin.model import Model

_MOST_OF_A_ROW: Final = 0.5
_LOOK_UP: Final = "look up the recording's units and conventions in the drive's manual"


def taken_back(suspicion: Suspicion, model: Model, tolerance: Mapping[str, float]) -> bool:
    """What the library finds speaks against the cause: a machine that fits better as recorded, or rows moved too far,
    so that voltages act later than the corrected rows say.
    """
    if model.bend is None and suspicion.contradicted(model.machine, tolerance):
        return True
    shift, delay = suspicion.parameters.get("u_shift"), model.effects.get(voltage_delay.EFFECT.name)
    if shift is None or shift.value is None or delay is None:
        return False
    periods, direction = delay
    return periods * direction * math.copysign(1.0, shift.value) > _MOST_OF_A_ROW


def with_convention(diagnosis: Diagnosis, suspicion: Suspicion) -> Diagnosis:
    """The diagnosis of the corrected recording, and the cause that was corrected: in doubt where another does as well,
    or where parameters are off as by another scale still.
    """
    said = suspicion.sentence.removesuffix(".")
    of_machine = suspicion.scale.of_machine
    perhaps = continued(said) if of_machine else f"perhaps {continued(said)}"
    if suspicion.ambiguous:
        told = look_up(suspicion.scale) if of_machine else Experiment(_LOOK_UP)
        why = f"{perhaps}; it would look the same if {', or if '.join(suspicion.ambiguous[1:])}"
        names = (convention_error.NAME, *suspicion.rival_effects)
        doubt = Ambiguity(names, why, told, rivals=len(names) > 1)
        return replace(diagnosis, verdict=Verdict.AMBIGUOUS, ambiguous=(doubt, *diagnosis.ambiguous))
    if suspicion.scale is not NO_SCALE and diagnosis.remarks and not diagnosis.ambiguous:
        doubt = Ambiguity((convention_error.NAME,), f"{perhaps}; but even then {'; '.join(diagnosis.remarks)}",
                          Experiment(_LOOK_UP), rivals=False)  # fmt: skip
        return replace(diagnosis, verdict=Verdict.AMBIGUOUS, ambiguous=(doubt,))
    off = [doubt for doubt in diagnosis.ambiguous if diagnosis.remarks and convention_error.NAME in doubt.effects]
    if off:
        doubt = replace(off[0], reason=f"{perhaps}; but even then {off[0].reason}")
        others = [other for other in diagnosis.ambiguous if other not in off]
        return replace(diagnosis, ambiguous=(doubt, *others))
    everywhere = Place("in every row", {}, 1.0, 1.0)
    finding = Finding(
        convention_error.NAME, suspicion.parameters, everywhere, min(suspicion.odds, 1e300), suspicion.rivals, {}
    )
    verdict = diagnosis.verdict
    if verdict is Verdict.NO_MISMATCH:
        verdict = Verdict.EXPLAINED
    elif verdict is Verdict.UNEXPLAINED:
        verdict = Verdict.PARTLY_EXPLAINED
    return replace(
        diagnosis, verdict=verdict, findings=(finding, *diagnosis.findings), pole_pairs=suspicion.machine.n_p
    )
