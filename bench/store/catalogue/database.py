"""A catalogue that is open: SQLite beside the recordings, or a PostgreSQL, brought up to its newest form."""

import contextlib
from pathlib import Path
from typing import Any, Final

from alembic import command
from alembic.config import Config
from sqlalchemy import Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, SQLAlchemyError

from bench.errors import ConfigError, UnavailableError

_TIMEOUT: Final = 5  # s, for a lock of SQLite, and for a connection to PostgreSQL
_MIGRATIONS: Final = Path(__file__).with_name("migrations")


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
        raise UnavailableError(f"the catalogue cannot be opened: {said_of(error)}") from None
    return engine


def said_of(error: Exception) -> str:
    """What is wrong, in a line, without addresses."""
    cause = getattr(error, "orig", None) or error
    return " ".join(str(cause).split())[:200] or type(error).__name__


def _engine(address: str) -> Engine:
    if "://" in address:
        url = make_url(address).set(drivername="postgresql+psycopg")
        return create_engine(url, pool_pre_ping=True, connect_args={"connect_timeout": _TIMEOUT})
    path = Path(address)
    with contextlib.suppress(OSError):  # told when it is opened
        path.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(f"sqlite:///{path}", connect_args={"timeout": _TIMEOUT})

    @event.listens_for(engine, "connect")
    def connected(connection: Any, _: Any) -> None:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")  # a power cut may cost the last second, and harms nothing

    return engine
