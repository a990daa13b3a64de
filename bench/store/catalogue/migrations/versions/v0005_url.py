"""Recordings: where the drive was."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Adds a column; what files said is forgotten, and read anew with it."""
    op.add_column("recordings", sa.Column("url", sa.Text, nullable=False, server_default=""))
    op.execute("DELETE FROM recordings")
