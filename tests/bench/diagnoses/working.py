"""What a worker does in the tests of it."""

import os
import signal

from bench.diagnoses.diagnosis_request import Tell
from bench.errors import LimitError


def work(job: str, tell: Tell) -> object:
    """The job in capitals, the process, its cores; or what the job's name says."""
    tell(0.5, f"at {job}")
    if job == "refused":
        raise LimitError("expected another job")
    if job == "broken":
        raise ZeroDivisionError("division by zero")
    if job == "dies":
        os.kill(os.getpid(), signal.SIGSEGV)
    if job == "endless":
        while True:
            signal.pause()
    return job.upper(), os.getpid(), os.environ["OPENBLAS_NUM_THREADS"]
