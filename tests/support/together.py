"""Diagnoses of two recordings made by hand, with every field in use."""

import threading
from collections.abc import Iterable, Mapping
from dataclasses import replace

from bench.diagnoses.diagnose import Diagnosed
from bench.diagnoses.diagnosis_request import Result, Tell
from bench.diagnoses.together.diagnose import result_of
from bench.diagnoses.together.request import DiagnosedTogether, Several
from bench.errors import RecordingError
from bench.machine_file import Nominal
from estimator.diagnosis.together.said import Difference, Kind, Shared, SharedFinding, Together
from estimator.diagnosis.verdict import Quantity, Verdict
from tests.support.diagnoses import AMBIGUOUS, EXPLAINED, NO_MISMATCH, NOMINAL, NOTHING_TOLD, RECORDING


def shared(unit: str, *told: tuple[float, float] | None, joint: tuple[float, float] | None = None) -> Shared:
    """A number of recordings; without a joint one they differ."""
    each = tuple(None if one is None else Quantity(*one, unit) for one in told)
    first = next((one for one in each if one is not None), Quantity(None, None, unit))
    return Shared(each, first if joint is None else Quantity(*joint, unit), joint is not None)


NAMES = ("cold", "warm")
EQUATION = (2e-6, 0.85, 0.04, 0.08)
BOTH = Together(
    verdict=Verdict.EXPLAINED,
    sentence="The inverter's voltage error was left out in warm. Of 2 recordings as one: L_d = 4.2380 ± 0.0039 mH.",
    recordings=NAMES,
    machine={
        "R_s": shared("ohm", (0.9668, 4e-4), (1.0248, 5e-4)),
        "L_d": shared("H", (4.238e-3, 3e-6), (4.239e-3, 3e-6), joint=(4.2385e-3, 2.1e-6)),
        "L_q": shared("H", (6.212e-3, 3e-6), None, joint=(6.212e-3, 3e-6)),
        "psi_f": shared("Vs", (0.11999, 1e-5), (0.11998, 1e-5), joint=(0.119985, 7e-6)),
    },
    findings=(
        SharedFinding(
            "inverter_voltage_error",
            {"dead_time": shared("s", (0.0, 3e-9), (2e-6, 3e-8)),
             "knee": shared("A", None, (0.08, 0.01), joint=(0.08, 0.01))},
            ("warm",), 1e40, EQUATION, ("warm",),
        ),
        SharedFinding(
            "d_axis_saturation", {"L_d_drop": shared("1", (0.12, 0.004), (0.121, 0.004), joint=(0.1205, 0.0028))},
            (), 250.0, (0.1205,), NAMES,
        ),
    ),
    differences=(
        Difference("R_s", "", Kind.STATE, NAMES, Quantity(0.058, 6.4e-4, "ohm"), Quantity(0.06, 6.6e-4, "1"),
                   "between cold and warm R_s rose by 6.00 ± 0.13 % (58.0 ± 1.3 mohm)"),
        Difference("inverter_voltage_error", "dead_time", Kind.EFFECT, NAMES, Quantity(2e-6, 3e-8, "s"), None,
                   "the inverter's voltage error is there in warm and not in cold"),
    ),
    ambiguous=(), remarks=("warm: rows lost, by the times: 3",), diagnoses=(NO_MISMATCH, EXPLAINED),
)  # fmt: skip
DOUBTFUL = replace(
    BOTH, verdict=Verdict.AMBIGUOUS, sentence="Cannot tell.", ambiguous=AMBIGUOUS.ambiguous, findings=(),
    differences=(), diagnoses=(AMBIGUOUS, NO_MISMATCH),
)  # fmt: skip
ALIKE = replace(
    BOTH, verdict=Verdict.NO_MISMATCH, sentence="No mismatch.", findings=(), differences=(), remarks=(),
    machine={**BOTH.machine, "R_s": shared("ohm", (0.9668, 4e-4), (0.967, 4e-4), joint=(0.9669, 3e-4))},
    diagnoses=(NO_MISMATCH, NO_MISMATCH),
)  # fmt: skip
NOTHING = replace(
    BOTH, verdict=Verdict.NOT_ENOUGH_EXCITATION, sentence="Nothing can be told.", findings=(), differences=(),
    machine={
        name: Shared((None, None), Quantity(None, None, number.joint.unit), True)
        for name, number in BOTH.machine.items()
    }, remarks=(), diagnoses=(NOTHING_TOLD, NOTHING_TOLD),
)  # fmt: skip
UNEXPLAINED = replace(BOTH, verdict=Verdict.PARTLY_EXPLAINED)
ALL = {
    "explained": BOTH, "ambiguous": DOUBTFUL, "no_mismatch": ALIKE, "nothing_told": NOTHING, "unexplained": UNEXPLAINED,
}  # fmt: skip


def diagnosed(said: Together, nominal: Nominal = NOMINAL) -> DiagnosedTogether:
    """With recordings that they are of."""
    each = {
        name: Diagnosed(replace(RECORDING, path=f"{name}.parquet"), nominal, alone)
        for name, alone in zip(said.recordings, said.diagnoses, strict=True)
    }
    return DiagnosedTogether(said, each, nominal)


def _called(said: Together, names: Mapping[str, str]) -> Together:
    """With other names of recordings."""

    def of(some: Iterable[str]) -> tuple[str, ...]:
        return tuple(names[name] for name in some)

    findings = tuple(
        replace(one, named_by=of(one.named_by), equation_of=of(one.equation_of)) for one in said.findings
    )
    return replace(said, recordings=of(said.recordings), findings=findings)


def work(several: Several, tell: Tell) -> Result:
    """Diagnoses by the name of the first file, in place of the diagnosis; others fail or have no end."""
    (name, first), *_ = several.requests.items()
    stem = first.file.name.partition(".")[0]
    tell(0.5, "looking at the name")
    if stem == "refused":
        raise RecordingError(f"{first.file}: expected another name")
    if stem == "broken":
        raise ZeroDivisionError("division by zero")
    if stem == "endless":
        threading.Event().wait()
    said = _called(ALL.get(stem, BOTH), dict(zip(NAMES, several.requests, strict=True)))
    if first.trust:
        said = replace(said, remarks=(*said.remarks, f"{name}: trust {dict(first.trust)}"))
    return result_of(diagnosed(said, several.nominal), report_too=first.report)
