"""The numbers behind table and findings: errors at seven temperatures, tracking by window length. Prints nothing."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.paper.published import NAMES, TEMPERATURES, UNITS, Array, per_cent
from tests.paper.runs import METHODS, RIVALS, WINDOW_M, Estimator, Run, fixed, rmse, told, tracked, warming, wls

_SCALE = np.array([1.0 if UNITS[name] == "ohm" else 1e3 for name in NAMES])


@dataclass(frozen=True, slots=True)
class Cells:
    """Table 1 by one method: estimates in ohm and mH, (seeds, 3, 7)."""

    values: Array

    @property
    def errors(self) -> Array:
        """Relative errors in per cent, (seeds, 3, 7)."""
        return np.array([per_cent(table) for table in self.values])

    @property
    def worst(self) -> Array:
        """Largest error of each parameter over temperatures and seeds in per cent, (3,)."""
        return np.max(np.abs(self.errors), axis=(0, 2))

    @property
    def mean(self) -> Array:
        """Mean error of each parameter in per cent, (3,)."""
        return np.mean(np.abs(self.errors), axis=(0, 2))


def table_1(seeds: Sequence[int], *, noise: bool, methods: Iterable[str] = METHODS) -> dict[str, Cells]:
    """What each method tells at the end of each run."""
    values = {name: np.full((len(seeds), 3, len(TEMPERATURES)), np.nan) for name in methods}
    for column, temperature in enumerate(TEMPERATURES):
        for n, seed in enumerate(seeds):
            run = fixed(temperature, seed, noise=noise)
            for name, table in values.items():
                table[n, :, column] = np.array(told(METHODS[name]()(run.samples))) * _SCALE
    return {name: Cells(table) for name, table in values.items()}


def by_window(runs: Sequence[Run], lengths: Sequence[int], m: int = WINDOW_M) -> Array:
    """Tracking error of each window length in per cent, (lengths, 3)."""
    return np.array([_over(runs, lambda length=length: wls(length, m)) for length in lengths])


def best_of(lengths: Sequence[int], errors: Array) -> list[int]:
    """The best length for each parameter."""
    return [lengths[int(n)] for n in np.argmin(errors, axis=0)]


def by_rival(runs: Sequence[Run]) -> dict[str, Array]:
    """Tracking error of each other method in per cent, (3,)."""
    return {name: _over(runs, make) for name, make in RIVALS.items()}


def loud(seeds: Sequence[int], lengths: Sequence[int], noise_i: float) -> Array:
    """`by_window` on the warming run with noise of `noise_i` (A), windows counted in rows of 1 ms."""
    runs = [warming(seed, noise=True, noise_i=noise_i) for seed in seeds]
    return by_window(runs, [10 * length for length in lengths], m=10)


def _over(runs: Sequence[Run], make: Callable[[], Estimator]) -> Array:
    return np.sqrt(np.mean([rmse(tracked(make(), run), run) ** 2 for run in runs], axis=0))
