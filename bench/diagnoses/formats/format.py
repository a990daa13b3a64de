"""The shape that every format has, and what reading one gives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.diagnoses.diagnosis_request import Request, Tell
from bench.machine_file import Nominal
from bench.recordings.recording import Summary
from estimator.diagnosis.verdict import Diagnosis


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """A recording and what is said of it."""

    recording: Summary
    nominal: Nominal
    diagnosis: Diagnosis
    seen: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """By axis, i_d and i_q, the least current and the largest, A; nothing where rows are no samples in time."""
    u_dc: float | None = None  # V, mean of the dc link; None where it is not known


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of file that can be diagnosed."""

    name: str  # of `--format`
    sniff: Callable[[Path, Mapping[str, str]], bool]  # a file and its mapping: is it one? may raise BenchError, OSError
    diagnose: Callable[[Request, Tell], Diagnosed]  # raises ConfigError, RecordingError, and what the Tell raises
