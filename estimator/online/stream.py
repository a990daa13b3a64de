"""A stream cut into runs: consecutive finite samples, each run with the sample before it where it joins that.

What every streaming estimator does with gaps and with values that are no numbers. Knows nothing of balances.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.samples import NOT_KNOWN, Resolution, Samples


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
    edges = np.flatnonzero(np.diff(np.concatenate(([False], finite, [False]))))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        if first > 0:
            stream.last = None
        yield _taken_run(stream, samples[int(first) : int(end)])
    if not finite[-1]:
        stream.last = None


def _finite_rows(samples: Samples) -> NDArray[np.bool_]:
    columns = [samples.theta_e, samples.omega_e, samples.i_d, samples.i_q, samples.u_d, samples.u_q]
    columns += [column for column in (samples.i_d_mean, samples.i_q_mean) if column is not None]
    return np.logical_and.reduce([np.isfinite(column) for column in columns])


def _taken_run(stream: Stream, run: Samples) -> tuple[Samples, bool]:
    before, stream.last = stream.last, run[len(run) - 1 :]
    stream.T_s, stream.periods, stream.resolution = run.T_s, run.periods, run.resolution
    if before is None:
        stream.runs += 1
        return run, False
    return _joined_samples(before, run), True


def _joined_samples(a: Samples, b: Samples) -> Samples:
    def both(x: Array, y: Array) -> Array:
        return np.concatenate((x, y))

    def both_or_none(x: Array | None, y: Array | None) -> Array | None:
        return None if x is None or y is None else np.concatenate((x, y))

    return replace(
        b, theta_e=both(a.theta_e, b.theta_e), omega_e=both(a.omega_e, b.omega_e), i_d=both(a.i_d, b.i_d),
        i_q=both(a.i_q, b.i_q), u_d=both(a.u_d, b.u_d), u_q=both(a.u_q, b.u_q),
        i_d_mean=both_or_none(a.i_d_mean, b.i_d_mean), i_q_mean=both_or_none(a.i_q_mean, b.i_q_mean), t0=a.t0,
    )
