"""Files of one machine's recordings to one diagnosis: a pure function of them and of what is known of the machine."""

from dataclasses import replace

from bench.diagnoses.diagnose import compiling, onwards, unused
from bench.diagnoses.diagnosis_request import Request, Result, Tell, check_whole
from bench.diagnoses.figures.figure import figures_text
from bench.diagnoses.figures.forest import forests
from bench.diagnoses.formats import format_of, recording
from bench.diagnoses.report.together import report
from bench.diagnoses.together.machine import machine_text_of
from bench.diagnoses.together.published import as_json
from bench.diagnoses.together.request import DiagnosedTogether, Several
from bench.errors import ConfigError
from estimator.diagnosis.together.together import Named, diagnose_together


def diagnose_recordings(several: Several, tell: Tell = lambda share, phase: None) -> DiagnosedTogether:
    """Read all files, then diagnose them. Raises ConfigError, RecordingError, and what `tell` raises to cancel."""
    machine, requests, tell = check_whole(several.nominal), several.requests, onwards(tell)
    tell(0.0, "reading")
    for request in requests.values():
        _check(request)
    read = {name: recording.read_bounded(request) for name, request in requests.items()}
    first = next(iter(requests.values()))

    def on(share: float, phase: str) -> None:
        tell(recording.READING + (1.0 - recording.READING) * share, phase)

    with recording.refusals_of("one diagnosis of several recordings"):
        said = diagnose_together(
            [Named(name, one.recording.runs) for name, one in read.items()], machine, trust=first.trust,
            witnesses=first.witnesses, progress=on,
        )  # fmt: skip
    alone = dict(zip(said.recordings, said.diagnoses, strict=True))
    reading = [f"{name}: {remark}" for name, one in read.items() for remark in one.remarks]
    aligned = [f"{name}: {remark}" for name, one in read.items() for remark in one.aligned(alone[name])]
    remarks = (*reading, *said.remarks, *aligned, *unused(several.nominal))
    each = {name: one.diagnosed(alone[name]) for name, one in read.items()}
    return DiagnosedTogether(replace(said, remarks=remarks), each, several.nominal)


def _check(request: Request) -> None:
    """Raise ConfigError for a file whose rows are no control periods of both axes."""
    wanted = "one diagnosis of several files takes recordings of every control period"
    kind = format_of(request).name
    if kind != recording.FORMAT.name:
        raise ConfigError(f"{request.file}: {wanted}, got the format {kind}")
    if recording.q_only(request):
        raise ConfigError(f"{request.file}: {wanted} of both axes, got one of the q axis alone")


def work(several: Several, tell: Tell) -> Result:
    """A diagnosis in texts, as a process for such work makes it."""
    with compiling(tell) as on:
        diagnosed = diagnose_recordings(several, on)
    tell(1.0, "writing")
    return result_of(diagnosed, report_too=any(request.report for request in several.requests.values()))


def result_of(diagnosed: DiagnosedTogether, *, report_too: bool) -> Result:
    """A diagnosis in texts."""
    said, nominal, figures = diagnosed.said, diagnosed.nominal, forests(diagnosed.said)
    recordings = [one.recording for one in diagnosed.each.values()]
    page = report(said, recordings, nominal, figures) if report_too else None
    return Result(as_json(diagnosed), machine_text_of(said, nominal), page, figures_text(figures))
