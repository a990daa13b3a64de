"""Provisional: replaced by the diagnosis itself. Has its interface, and says that it cannot tell."""

import time
from collections.abc import Callable, Mapping, Sequence

from estimator.machine import PARAMETERS, UNITS, Machine
from estimator.mismatch.verdict import Diagnosis, Quantity, Verdict
from estimator.samples import Samples


def nothing(share: float, phase: str) -> None:
    """Hears nothing."""


def diagnose(
    runs: Sequence[Samples], nominal: Machine, *, trust: Mapping[str, float] | None = None,
    progress: Callable[[float, str], None] = nothing,
) -> Diagnosis:
    """See the module."""
    rows = sum(map(len, runs))
    if rows < 100:
        raise ValueError(f"expected at least 100 rows, came {rows}")
    for step in range(10):
        progress(step / 10, "fitting")
        time.sleep(rows / 1e6)
    before = {name: Quantity(getattr(nominal, name), None, UNITS[name]) for name in PARAMETERS}
    return Diagnosis(
        Verdict.NOT_ENOUGH_EXCITATION, "Nothing can be told: the diagnosis is provisional.", (), (), None, {}, before,
        before, None, (), (), None,
    )
