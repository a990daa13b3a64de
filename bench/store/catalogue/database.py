"""A catalogue that is open: SQLite beside the recordings, or a PostgreSQL, brought up to its newest form."""

import contextlib
import sqlite3
from collections.abc import Generator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Engine, Table, create_engine, event
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DataError, IntegrityError, SQLAlchemyError

from bench.errors import ConfigError, InternalError, UnavailableError

_TIMEOUT: Final = 5  # s, for a lock of SQLite, and for a connection to PostgreSQL
_MIGRATIONS: Final = Path(__file__).with_name("migrations")
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def check_address(address: str) -> None:
    """Raise ConfigError where no catalogue can have such an address."""
    expected = "expected a file, or postgresql://user:password@host/name"
    if "://" not in address:
        return
    try:
        kind = make_url(address).get_backend_name()
    except ArgumentError:
        raise ConfigError(f"{expected}, got something else") from None  # without what may be a password
    if kind != "postgresql":
        raise ConfigError(f"{expected}, got one of {kind}")


def opened(address: str) -> Engine:
    """The catalogue at a file, or of a PostgreSQL. Raises ConfigError, UnavailableError."""
    check_address(address)
    engine = _engine(address)
    try:
        with engine.begin() as connection:
            if engine.dialect.name == "postgresql":  # one bench after the other
                connection.exec_driver_sql("SELECT pg_advisory_xact_lock(7066737361)")
            config = Config()
            config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")
    except (SQLAlchemyError, OSError) as error:
        engine.dispose()
        raise UnavailableError(f"the catalogue cannot be opened: {said_of(error)}{_advice(engine, error)}") from None
    return engine


@contextlib.contextmanager
def connected(engine: Engine) -> Generator[Connection]:
    """A transaction. Raises UnavailableError where the catalogue cannot be had, InternalError for rows that it refuses.
    """
    try:
        with engine.begin() as connection:
            yield connection
    except (DataError, IntegrityError) as error:
        raise InternalError(f"the catalogue refuses what is to be remembered: {said_of(error)}") from None
    except (SQLAlchemyError, OSError) as error:
        raise UnavailableError(f"the catalogue cannot be used: {said_of(error)}{_advice(engine, error)}") from None


def put(engine: Engine, table: Table) -> Any:
    """An INSERT by which a row takes the place of one that has its key."""
    columns, key = table.columns, [column.name for column in table.primary_key]
    statement = insert_into(engine, table)
    return statement.on_conflict_do_update(index_elements=key, set_={
        name: statement.excluded[name] for name in columns.keys() if name not in key  # noqa: SIM118 - of no mapping
    })  # fmt: skip


def insert_into(engine: Engine, table: Table) -> Any:
    """An INSERT of the database's own kind, which takes conflicts."""
    return (postgresql if engine.dialect.name == "postgresql" else sqlite).insert(table)


def plain(text: str) -> str:
    """As any database can keep it: without NUL and halves of letters."""
    return text.replace("\0", "\\0").encode(errors="backslashreplace").decode()


def microseconds(time: datetime) -> int:
    """Since 1970, UTC."""
    return (time - _EPOCH) // timedelta(microseconds=1)


def time_at(microseconds_: int) -> datetime:
    """So many after 1970, UTC."""
    return _EPOCH + timedelta(microseconds=microseconds_)


def said_of(error: Exception) -> str:
    """What is wrong, in a line, without addresses."""
    cause = getattr(error, "orig", None) or error
    return " ".join(str(cause).split())[:200] or type(error).__name__


def _advice(engine: Engine, error: Exception) -> str:
    """What to do where a file is damaged, or is no catalogue; empty where it is something else."""
    code = getattr(getattr(error, "orig", None), "sqlite_errorcode", 0) & 0xFF
    if code not in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return ""
    return (
        f"; move {engine.url.database} away and start the service again: lists come back from the files of recordings "
        "and diagnoses; the history of estimates, chosen windows and what happened to drives begin anew"
    )


def _engine(address: str) -> Engine:
    if "://" in address:
        url = make_url(address).set(drivername="postgresql+psycopg")
        patience = {"connect_timeout": _TIMEOUT, "tcp_user_timeout": 1000 * _TIMEOUT}  # s, ms
        return create_engine(url, pool_pre_ping=True, connect_args=patience)
    path = Path(address)
    with contextlib.suppress(OSError):  # told when it is opened
        path.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(f"sqlite:///{path}", connect_args={"timeout": _TIMEOUT})

    @event.listens_for(engine, "connect")
    def connected(connection: Any, _: Any) -> None:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")  # a power cut may cost the last second, and harms nothing

    return engine
