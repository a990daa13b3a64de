"""What happened to drives: events, writes, who controlled them, parameters."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Adds four tables."""
    _create("events", _text("kind", sa.String(20)), _text("sentence"))
    _create(
        "audit", _text("who"), _text("by"), _text("method"), _text("path"), _text("status", sa.Integer),
        _text("outcome"), _text("body"), _text("before"), _text("after"),
    )  # fmt: skip
    _create(
        "leases", _text("part", sa.String(20)), _text("holder"), sa.Column("ended", sa.BigInteger),
        sa.Column("how", sa.Text, nullable=False, server_default=""),
    )  # fmt: skip
    _create("parameters", _text("why"), _text("device"), _text("values"))


def _text(name: str, kind: Any = sa.Text) -> sa.Column[Any]:
    return sa.Column(name, kind, nullable=False)


def _create(name: str, *columns: sa.Column[Any]) -> None:
    op.create_table(
        name,
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("bench", sa.String(200), nullable=False),
        sa.Column("drive", sa.String(200), nullable=False),
        sa.Column("at", sa.BigInteger, nullable=False),
        *columns,
    )
    op.create_index(f"ix_{name}_drive", name, ["bench", "drive", "at"])
