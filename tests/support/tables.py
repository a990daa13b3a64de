"""A plain recording as text, for tests that write it as other tools do, and for what is read of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tests.support.recordings import read_recording

NAMES: Final = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e")
T_S: Final = 1e-4  # s
ROWS: Final = 2000

Table = NDArray[np.float64]  # shape (rows, 7)
Lines = list[list[str]]  # the cells of each line, the header's first


def plain(rows: int = ROWS) -> Table:
    """A recording of a rotor that speeds up, to decimals that CSVs have."""
    t = np.arange(rows) * T_S
    theta = 0.3 + 300.0 * t + 450.0 * t**2
    u_q, i_q = 8.0 + 3.0 * np.sin(40.0 * t), 1.0 + 2.0 * np.sin(40.0 * t)
    columns = (t, 0.2 - u_q / 9.0, u_q, np.cos(25.0 * t) - 2.0, i_q, 300.0 + 900.0 * t, theta)
    rounded = [np.round(x, n) for x, n in zip(columns, (4, 3, 3, 3, 3, 2, 4), strict=True)]
    return np.column_stack(rounded).astype(np.float64)


def cells(table: Table) -> Lines:
    """The plain form's cells."""
    form = ("{:.4f}", "{:.3f}", "{:.3f}", "{:.3f}", "{:.3f}", "{:.2f}", "{:.4f}")
    return [list(NAMES), *([one.format(x) for one, x in zip(form, row, strict=True)] for row in table)]


def text(lines: Sequence[Sequence[str]], separator: str = ",", end: str = "\n") -> str:
    """Lines of cells as a file."""
    return "".join(separator.join(line) + end for line in lines)


def expect(path: Path, table: Table, *said: str, runs: Sequence[slice] = (slice(None),), **options: Any) -> None:
    """Read a file: stretches of that table come of it, and these remarks in this order, among others."""
    recording = read_recording(path, **options)
    assert len(recording.runs) == len(runs), recording.summary
    for run, rows in zip(recording.runs, runs, strict=True):
        for k, name in enumerate(NAMES[1:], start=1):
            np.testing.assert_allclose(getattr(run, name), table[rows, k], rtol=1e-12, atol=1e-12)
    remarks = iter(recording.summary.remarks())
    for part in said:
        assert any(part in remark for remark in remarks), (part, recording.summary.remarks())
