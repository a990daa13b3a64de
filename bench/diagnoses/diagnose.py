"""A file and what is known of its machine to a diagnosis: a pure function of both. Knows nothing of terminals and HTTP.
"""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from bench.diagnoses.diagnosed_machine import machine_text
from bench.diagnoses.diagnosis_request import COMPILING, Request, Result, Tell
from bench.diagnoses.figures.figure import figures_text
from bench.diagnoses.figures.pictures import pictures
from bench.diagnoses.formats import format_of
from bench.diagnoses.formats.format import Diagnosed
from bench.diagnoses.published import as_json
from bench.diagnoses.report.page import report
from bench.machine_file import Nominal
from estimator.kernel import on_compile


def diagnose_recording(request: Request, tell: Tell = lambda share, phase: None) -> Diagnosed:
    """Read and diagnose a file. Raises ConfigError, RecordingError, and what `tell` raises to cancel."""
    diagnosed = format_of(request).diagnose(request, onwards(tell))
    said = diagnosed.diagnosis
    return replace(diagnosed, diagnosis=replace(said, remarks=(*said.remarks, *unused(request.nominal))))


def unused(nominal: Nominal) -> tuple[str, ...]:
    """What a machine file says and no diagnosis takes: a sentence, or none."""
    if not nominal.effects:
        return ()
    return (f"the effects in {nominal.source}'s [effects] are not used by a diagnosis: it looks for them anew",)


def onwards(tell: Tell) -> Tell:
    """Tells no less than it has told: what is tried once more takes longer, and undoes nothing."""
    most = 0.0

    def told(share: float, phase: str) -> None:
        nonlocal most
        most = max(most, share)
        tell(most, phase)

    return told


@contextmanager
def compiling(tell: Tell) -> Generator[Tell]:
    """Tells as `tell` does, and of kernels that are compiled meanwhile."""
    done = 0.0

    def on(share: float, phase: str) -> None:
        nonlocal done
        done = share
        tell(share, phase)

    with on_compile(lambda: on(done, COMPILING)):
        yield on


def work(request: Request, tell: Tell) -> Result:
    """A diagnosis in texts, as a process for such work makes it."""
    with compiling(tell) as on:
        diagnosed = diagnose_recording(request, on)
    diagnosis = diagnosed.diagnosis
    tell(1.0, "writing")
    fitted, figures = bool(diagnosis.machine_after), pictures(diagnosis)
    return Result(
        as_json(diagnosed),
        machine_text(diagnosis, diagnosed.nominal, request.file.name) if fitted else None,
        report(diagnosis, diagnosed.recording, diagnosed.nominal, figures) if request.report else None,
        figures_text(figures),
    )
