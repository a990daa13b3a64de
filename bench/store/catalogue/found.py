"""What files say of themselves, in the catalogue: so that a list of thousands reads no thousands of files.

The files are the truth; a row counts as long as its file is as it was. Raises UnavailableError where the catalogue
cannot be had.
"""

import socket
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Engine, Table, delete, select

from bench.store.catalogue.database import connected, plain, put

_AT_ONCE: Final = 500  # rows

Row = Mapping[str, Any]  # by column, without the folder


class FoundFiles:
    """Rows of one table, of one folder of this machine; from any thread."""

    def __init__(self, engine: Engine, table: Table, folder: Path) -> None:
        self._engine, self._table = engine, table
        self._folder = plain(f"{socket.gethostname()}:{folder.absolute()}")

    def all(self) -> list[dict[str, Any]]:
        """Every row."""
        own = select(self._table).where(self._table.c.folder == self._folder)
        with connected(self._engine) as connection:
            return [dict(row) for row in connection.execute(own).mappings()]

    def add(self, rows: Sequence[Row]) -> None:
        """Put rows in place of those of their ids."""
        told = [{"folder": self._folder} | {key: _kept(value) for key, value in row.items()} for row in rows]
        with connected(self._engine) as connection:
            for k in range(0, len(told), _AT_ONCE):
                connection.execute(put(self._engine, self._table), told[k : k + _AT_ONCE])

    def drop(self, ids: Iterable[str]) -> None:
        """Forget those whose files have gone."""
        gone = list(ids)
        with connected(self._engine) as connection:
            for k in range(0, len(gone), _AT_ONCE):
                connection.execute(delete(self._table).where(
                    self._table.c.folder == self._folder, self._table.c.id.in_(gone[k : k + _AT_ONCE]),
                ))

    def rebuild(self, rows: Sequence[Row]) -> None:
        """These alone."""
        there = {row["id"] for row in rows}
        self.drop(row["id"] for row in self.all() if row["id"] not in there)
        self.add(rows)


def _kept(value: Any) -> Any:
    return plain(value) if isinstance(value, str) else value
