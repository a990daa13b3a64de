"""A recording beside its machine with effects, as a machine file has them. Knows nothing of terminals."""

import numpy as np

from bench.diagnosis_request import Request, check_whole
from bench.errors import ConfigError, RecordingError
from bench.recording import Summary, read_recording
from estimator.mismatch.beside import Beside, beside
from estimator.mismatch.model import Model


def simulate(request: Request) -> tuple[Summary, Beside]:
    """Simulate a file's currents. Raises ConfigError, RecordingError."""
    nominal = request.nominal
    machine = check_whole(nominal)
    without = [name for name in nominal.effects if name not in nominal.equations]
    if without:
        raise ConfigError(
            f"{nominal.source}: [effects.{without[0]}]: expected a line `equation`, as a diagnosis of a recording of "
            "every control period writes it, to simulate by, came none"
        )
    recording = read_recording(
        request.file, mapping=request.mapping, constants=request.constants, T_s=nominal.T_s, align=request.align,
        theta_step=nominal.theta_step, u_dc=nominal.u_dc,
    )
    try:
        return recording.summary, beside(recording.runs, Model(machine, dict(nominal.equations), nominal.angle_ahead))
    except np.linalg.LinAlgError:  # ours, not the file's
        raise
    except ValueError as error:
        raise RecordingError(f"{request.file}: {error}") from error
