"""Printing: Table 1 with ours beside the published numbers, errors, tracking, bars. Computes next to nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tests.paper.findings import Cells
from tests.paper.published import NAMES, TABLE_1, TEMPERATURES, TRUE, UNITS, Array, per_cent, without_misprint

_WIDTH = 22


@dataclass(frozen=True, slots=True)
class Bar:
    """Something to be met."""

    what: str
    got: float
    at_most: float  # in the unit of `got`
    unit: str = "%"

    @property
    def met(self) -> bool:
        """Whether it is."""
        return self.got <= self.at_most

    def __str__(self) -> str:
        verdict = "met   " if self.met else "MISSED"
        return f"  {verdict}  {self.what}: {self.got:.4f} {self.unit}, at most {self.at_most:g} {self.unit}"


def table_1(cells: Mapping[str, Cells], seed: int, title: str) -> str:
    """Table 1: value and relative error in per cent, published and ours, of the first run."""
    lines = [f"Table 1, {title} (seed {seed}): estimate, relative error in %"]
    for k, name in enumerate(NAMES):
        lines.append(_row(f"{name}, {UNITS[name]}", [f"{T:g} degC" for T in TEMPERATURES]))
        lines.append(_row("  true", [f"{value:.4f}" for value in TRUE[k]]))
        rows = {f"published {method}": table[k] for method, table in TABLE_1.items()}
        rows |= {f"ours {method}": found.values[0, k] for method, found in cells.items()}
        for method, values in rows.items():
            lines.append(_row(f"  {method}", [
                f"{value:.4f} {100.0 * (value / true - 1.0):+8.4f}" for value, true in zip(values, TRUE[k], strict=True)
            ]))
    return "\n".join(lines)


def worst_and_mean(sets: Mapping[str, Mapping[str, Cells]], seeds: int) -> str:
    """Worst (mean) errors: published over 7 temperatures, ours over 7 temperatures and all seeds."""
    lines = [
        f"Worst (mean) relative error in %; ours over seven temperatures and {seeds} seeds",
        f"{'':<36}" + "".join(f"{name:>20}" for name in NAMES),
    ]
    for method, table in TABLE_1.items():
        lines.append(_errors(f"published {method}", np.abs(per_cent(table))))
    lines.append(_errors("published WLS but for one cell", np.abs(without_misprint(per_cent(TABLE_1["WLS"])))))
    for noise, cells in sets.items():
        for method, found in cells.items():
            absolute = np.moveaxis(np.abs(found.errors), 0, 1).reshape(3, -1)
            lines.append(_errors(f"ours {method}, {noise}", absolute))
    return "\n".join(lines)


def tracking(title: str, lengths: Sequence[int], errors: Array, rivals: Mapping[str, Array] | None = None) -> str:
    """Tracking errors by window length; a star marks the best."""
    best = np.argmin(errors, axis=0)
    lines = [title, f"  {'':<22}" + "".join(f"{name:>12}" for name in NAMES)]
    for n, length in enumerate(lengths):
        marks = "".join(f"{error:>11.4f}{'*' if best[k] == n else ' '}" for k, error in enumerate(errors[n]))
        lines.append(f"  {f'window {length}':<22}{marks}")
    for name, error in (rivals or {}).items():
        lines.append(f"  {name:<22}" + "".join(f"{value:>11.4f} " for value in error))
    return "\n".join(lines)


def _row(label: str, cells: Sequence[str]) -> str:
    return f"{label:<{_WIDTH}}" + "".join(f"{cell:>18}" for cell in cells)


def _errors(label: str, absolute: Array) -> str:
    pairs = zip(np.nanmax(absolute, axis=1), np.nanmean(absolute, axis=1), strict=True)
    return f"{label:<36}" + "".join(f"{f'{worst:.4f} ({mean:.4f})':>20}" for worst, mean in pairs)
