"""A recording's Parquet: row groups as they come, sealed, on disk, then named; whole or not at all."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.files import named
from bench.recordings.foreign.content import NOTES, UNIT, pa, pq
from bench.recordings.seal import seal

Columns = Mapping[str, NDArray[np.float64]]


def write_sealed(
    path: Path, part: Path, units: Mapping[str, str], groups: Iterator[Columns],
    told: Mapping[str, Any] | Callable[[], Mapping[str, Any]],
) -> Path:
    """Write columns with these units and tell under which name: this one or the next that is free. Raises OSError.

    `part`: where it is written; `groups`: of each row group the columns; `told`: the notes, or what gives them once all
    groups have come.
    """
    fields = [pa.field(name, pa.float64(), metadata={UNIT: unit}) for name, unit in units.items()]
    schema = pa.schema(fields, metadata=None if callable(told) else _metadata(told))
    with pq.ParquetWriter(part, schema, compression="zstd", write_page_checksum=True) as writer:
        for columns in groups:
            writer.write_table(pa.table({name: columns[name] for name in units}, schema=schema))
        if callable(told):
            writer.add_key_value_metadata(_metadata(told()))
    with part.open("r+b") as written:
        seal(written)
        return named(part, written, path)


def _metadata(told: Mapping[str, Any]) -> dict[bytes, bytes]:
    return {NOTES: json.dumps(dict(told)).encode()}
