"""A stream cut into runs: consecutive finite samples, each run with the sample before it where it joins that.

What every streaming estimator does with gaps and with values that are no numbers. Knows nothing of balances.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import stretches
from estimator.samples import NOT_KNOWN, Resolution, Samples

_COLUMNS: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean")


@dataclass(slots=True, eq=False)
class Stream:
    """Where a stream is; `runs_of` changes it in place."""

    last: Samples | None = None  # the newest sample, whose row waits for its end; None after a break
    T_s: float = 1.0  # s, control period of the samples so far, known after a break too
    periods: int = 1  # control periods that a row covers
    resolution: Resolution = NOT_KNOWN
    runs: int = 0  # unbroken stretches so far
    left_out: int = 0  # samples refused because a value was not finite

    @property
    def gaps(self) -> int:
        """Breaks between the stretches so far."""
        return max(0, self.runs - 1)


def runs_of(stream: Stream, samples: Samples, *, joined: bool = True) -> Iterator[tuple[Samples, bool]]:
    """Runs of finite samples in turn, and whether each continues the run before.

    `joined`: the first sample follows the last one taken in by exactly one row; otherwise a new run begins. A run that
    continues another starts with that one's last sample. Samples with a value that is not finite are left out and
    counted, and end the run, at a block's end too.
    """
    if not joined:
        stream.last = None
    finite = _finite_rows(samples)
    if finite.all():
        if len(samples):
            yield _taken_run(stream, samples)
        return
    stream.left_out += int(np.count_nonzero(~finite))
    for first, end in stretches(finite):
        if first > 0:
            stream.last = None
        yield _taken_run(stream, samples[first:end])
    if not finite[-1]:
        stream.last = None


def _finite_rows(samples: Samples) -> NDArray[np.bool_]:
    columns = [getattr(samples, name) for name in _COLUMNS]
    return np.logical_and.reduce([np.isfinite(column) for column in columns if column is not None])


def _taken_run(stream: Stream, run: Samples) -> tuple[Samples, bool]:
    before, stream.last = stream.last, run[len(run) - 1 :]
    stream.T_s, stream.periods, stream.resolution = run.T_s, run.periods, run.resolution
    if before is None:
        stream.runs += 1
        return run, False
    return _joined_samples(before, run), True


def _joined_samples(a: Samples, b: Samples) -> Samples:
    pairs = [(name, getattr(a, name), getattr(b, name)) for name in _COLUMNS]
    both = {name: None if x is None or y is None else np.concatenate((x, y)) for name, x, y in pairs}
    return replace(b, **both, t0=a.t0)
