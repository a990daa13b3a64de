"""What files of a standing servo have in common: named columns of numbers, no machine, no control period.

Knows nothing of what they mean.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.diagnoses.diagnosis_request import Request
from bench.errors import ConfigError, RecordingError
from bench.recordings.recording import Summary
from bench.recordings.table import column_names, read_whole

_MOST: Final = 5_000_000  # rows

Columns = dict[str, NDArray[np.float64]]


def is_there(path: Path, columns: Sequence[str], mapping: Mapping[str, str]) -> bool:
    """The file has all of these columns, or others mapped to them."""
    return set(columns) <= {*column_names(path), *mapping}


def read(request: Request, columns: Sequence[str]) -> Columns:
    """Columns by the format's names. Raises ConfigError, RecordingError."""
    for option, given in (("--set", request.constants), ("--align", request.align)):
        if given:
            raise ConfigError(f"{option} is none of this format's: expected columns {', '.join(columns)}")
    if unknown := [name for name in request.mapping if name not in columns]:
        raise ConfigError(f"--map: no quantity {unknown[0]!r} in this format, expected one of {', '.join(columns)}")
    path, present = request.file, column_names(request.file)
    names = {name: request.mapping.get(name, name) for name in columns}
    if missing := [column for column in names.values() if column not in present]:
        raise RecordingError(f"{path}: missing columns: {', '.join(missing)}; present: {', '.join(present[:30])}")
    return read_whole(path, names, _MOST, f"expected at most {_MOST} rows, came more")


def summary_of(request: Request, columns: Sequence[str], T_s: float, rows: int, used: int) -> Summary:
    """The account of the file."""
    return Summary(
        path=str(request.file), T_s=T_s, periods=1, rows=rows, used=used, runs=1, duration=rows * T_s,
        left_out=rows - used, missing={}, unaligned=0, lost_rows=0, irregular_steps=0,
        sources={name: f"column {request.mapping.get(name, name)}" for name in columns}, unused=(),
    )  # fmt: skip
