"""A recording beside its machine with effects, as a machine file has them. Knows nothing of terminals."""

from bench.diagnoses.diagnosis_request import Request, check_whole
from bench.diagnoses.formats.recording import read, refusals_of
from bench.errors import ConfigError
from bench.recordings.recording import Summary
from estimator.diagnosis.answer.beside import Comparison, compared_with
from estimator.twin.model import Model


def simulate(request: Request) -> tuple[Summary, Comparison]:
    """Simulate a file's currents. Raises ConfigError, RecordingError."""
    nominal = request.nominal
    machine = check_whole(nominal)
    without = [name for name in nominal.effects if name not in nominal.equations]
    if without:
        raise ConfigError(
            f"{nominal.source}: [effects.{without[0]}]: expected a line `equation`, as a diagnosis of a recording of "
            "every control period writes it, to simulate by, came none"
        )
    recording = read(request)
    with refusals_of(request.file):
        return recording.summary, compared_with(
            recording.runs, Model(machine, dict(nominal.equations), nominal.angle_ahead)
        )
