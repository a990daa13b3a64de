"""What is asked of one diagnosis of several recordings, and what comes of it. Knows nothing of how it is done."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.formats.format import Diagnosed
from bench.machine_file import Nominal
from estimator.diagnosis.together.said import Together

WORK: Final = "bench.diagnoses.together.diagnose:work"
"""Takes a `Several` and a Tell, gives a Result."""


@dataclass(frozen=True, slots=True)
class Several:
    """Recordings of one machine, which is the same in each request."""

    requests: Mapping[str, Request]  # by the recording's name

    @property
    def nominal(self) -> Nominal:
        """What is known of the machine."""
        return next(iter(self.requests.values())).nominal


@dataclass(frozen=True, slots=True)
class DiagnosedTogether:
    """Recordings and what is said of them."""

    said: Together
    each: Mapping[str, Diagnosed]  # by the recording's name, what is said of it alone
    nominal: Nominal
