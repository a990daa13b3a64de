"""Recordings of every control period: `bench.recordings.recording`."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from bench.diagnoses.diagnosis_request import Request, Tell, check_whole
from bench.diagnoses.formats.format import Diagnosed, Format
from bench.errors import BenchError, ConfigError, RecordingError
from bench.recordings.long_recording import read_in_stretches
from bench.recordings.recording import Recording, RecordingReader, check_every_period, joined, open_recording, whole
from bench.recordings.runs import Chunk, perhaps_of_instants
from bench.recordings.screen import Screen
from bench.recordings.sources import bare_names
from bench.recordings.table import column_names
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.speed_lag import SpeedLags
from estimator.diagnosis.points.diagnose import given_off
from estimator.diagnosis.points.q_axis_diagnosis import diagnose_q_log
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.interval import Z_95
from estimator.physics import voltage_delay
from estimator.samples import Samples

READING: Final = 0.05
"""Share of the work."""
_STRAY: Final = 1e-3  # share of the rows at either end of a current's range, which may be wrong
_WHOLE_ROW: Final = 0.1  # rows, by which a delay may be off a whole one


def diagnose_recording(request: Request, tell: Tell) -> Diagnosed:
    """Read and diagnose a recording."""
    nominal = request.nominal
    if not nominal.given and nominal.n_p is None and not q_only(request):
        needs = f"{request.file}: a recording needs its machine's data, expected --nominal MACHINE.toml"
        if "t" not in (*bare_names(column_names(request.file)), *request.mapping):
            needs += (
                "; a table of steady points, which needs none, has u_d, u_q, i_d, i_q and omega_e or speed_rpm; "
                f"present: {', '.join(column_names(request.file)[:30])}; other names by --map NAME=COLUMN"
            )
        raise ConfigError(needs)
    machine = None if q_only(request) else check_whole(nominal)
    tell(0.0, "reading")
    one = read_bounded(request)

    def on(share: float, phase: str) -> None:
        tell(READING + (1.0 - READING) * share, phase)

    with refusals_of(request.file):
        if machine is None:
            diagnosis = _of_q_axis(one.recording, request, on)
        else:
            runs = one.recording.runs
            diagnosis = diagnose(runs, machine, trust=request.trust, witnesses=request.witnesses, progress=on)
    return one.diagnosed(diagnosis)


@dataclass(frozen=True, slots=True)
class Read:
    """A recording in memory, by what it was asked for."""

    request: Request
    recording: Recording
    remarks: tuple[str, ...]  # on reading it

    def diagnosed(self, diagnosis: Diagnosis) -> Diagnosed:
        """What is said of it, with what is to be said of the file."""
        runs = self.recording.runs
        remarks = (*self.remarks, *diagnosis.remarks, *self.aligned(diagnosis), *self._far_apart(diagnosis))
        seen = {axis: _span(runs, axis) for axis in ("i_d", "i_q")}
        said = replace(diagnosis, remarks=remarks)
        return Diagnosed(self.recording.summary, self.request.nominal, said, seen, _mean_u_dc(runs))

    def aligned(self, diagnosis: Diagnosis) -> Iterator[str]:
        """How its voltages were taken, where they surely stand a row off."""
        return _aligned(diagnosis, self.request.align.get("u", 0.0))

    def _far_apart(self, diagnosis: Diagnosis) -> Sequence[str]:
        """What rows may be in which something stays unexplained, a sentence where they are far apart."""
        said, summary = diagnosis.verdict, self.recording.summary
        if said not in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED) or self.request.nominal.T_s is not None:
            return ()
        return () if self.recording.runs[0].q_only else perhaps_of_instants(summary.T_s, summary.periods)


def read_bounded(request: Request) -> Read:
    """The recording that a request asks of, or stretches of it where it is long. Raises ConfigError, RecordingError."""
    recording, stretches = read_in_stretches(lambda: opened(request, q_alone=True))
    return Read(request, recording, (*((stretches,) if stretches else ()), *recording.summary.remarks()))


def _aligned(diagnosis: Diagnosis, u: float) -> Iterator[str]:
    """How a file's voltages were taken that surely stand a row off; `u`: rows by which they were moved already."""
    for finding in diagnosis.findings:
        delay = finding.parameters.get("periods") if finding.effect == voltage_delay.EFFECT.name else None
        if delay is None or delay.value is None or delay.std is None:
            continue
        rows = round(delay.value)
        if rows and abs(delay.value - rows) + Z_95 * delay.std < _WHOLE_ROW:
            yield (
                f"the voltages are taken as they act, a row {'later' if rows > 0 else 'earlier'} than they stand: with "
                f"--align u={u + rows:g} replay and mechanics take them so, too"
            )


def q_only(request: Request) -> bool:
    """Whether the q axis alone was recorded, for which nothing needs to be known of the machine."""
    try:
        with opened(request, q_alone=True) as reader:
            return reader.sources.q_only
    except (OSError, BenchError):  # whoever reads it will say what is wrong
        return False


def _of_q_axis(recording: Recording, request: Request, on: Callable[[float, str], None]) -> Diagnosis:
    """What is said of the rows that a machine may make."""
    on(0.1, "fitting")
    screen, lags = Screen(), SpeedLags()
    chunks = [Chunk(run, k, joined=False) for k, run in enumerate(recording.runs)]
    kept = [*(left for chunk in chunks for left in screen.take(chunk)), *screen.finish()]
    runs = list(joined(kept))
    for run in runs:
        lags.take(run)
    lag = lags.found()
    diagnosis = diagnose_q_log(runs, aligned_already="u" in request.align, witnesses=request.witnesses)
    late = (said,) if lag is not None and (said := lag.sentence()) else ()
    off = given_off(diagnosis.machine_after, request.nominal.given, request.trust)
    return replace(diagnosis, remarks=(*screen.remarks(), *late, *diagnosis.remarks, *off))


def _span(runs: Sequence[Samples], axis: str) -> tuple[float, float]:
    column = np.concatenate([getattr(run, axis) for run in runs])
    low, high = np.quantile(column, (_STRAY, 1.0 - _STRAY))
    return float(low), float(high)


def _mean_u_dc(runs: Sequence[Samples]) -> float | None:
    columns = [run.u_dc for run in runs if run.u_dc is not None]
    return float(np.mean(np.concatenate(columns))) if columns else None


@contextmanager
def opened(request: Request, *, q_alone: bool = False) -> Generator[RecordingReader]:
    """The recording that a request asks of, chunk by chunk. Raises RecordingError, also for a stream's rows."""
    nominal = request.nominal
    with open_recording(
        request.file, mapping=request.mapping, constants=request.constants, T_s=nominal.T_s, align=request.align,
        theta_step=nominal.theta_step, u_dc=nominal.u_dc, n_p=nominal.n_p,
        q_alone=q_alone,
    ) as reader:
        check_every_period(request.file, reader.clock.periods)
        yield reader


def read(request: Request) -> Recording:
    """The recording that a request asks of, as a whole. Raises RecordingError."""
    with opened(request) as reader:
        return whole(reader)


@contextmanager
def refusals_of(what: Path | str) -> Generator[None]:
    """What the estimator refuses of a file, or of several, as a sentence for the user: a RecordingError."""
    try:
        yield
    except np.linalg.LinAlgError:  # ours, not the file's
        raise
    except ValueError as error:
        raise RecordingError(f"{what}: {error}") from error


FORMAT: Final = Format("recording", lambda _path, _mapping: True, diagnose_recording)
