"""Captures and experiments that have ended."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Adds two tables."""
    for name in ("captures", "experiments"):
        op.create_table(
            name,
            sa.Column("bench", sa.String(200), primary_key=True),
            sa.Column("id", sa.String(250), primary_key=True),
            sa.Column("drive", sa.String(200), nullable=False),
            sa.Column("asked", sa.BigInteger, nullable=False),
            sa.Column("state", sa.String(20), nullable=False),
            sa.Column("progress", sa.Double, nullable=False),
            sa.Column("samples", sa.Integer, nullable=False),
            sa.Column("reason", sa.Text, nullable=False),
            sa.Column("remarks", sa.Text, nullable=False),
            sa.Column("file", sa.Text),
            sa.Column("request", sa.Text, nullable=False),
        )
        op.create_index(f"ix_{name}_asked", name, ["asked"])
