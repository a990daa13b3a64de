"""What the files of recordings and of diagnoses say."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Adds two tables."""
    op.create_table(
        "recordings",
        sa.Column("folder", sa.String(1000), primary_key=True),
        sa.Column("id", sa.String(250), primary_key=True),
        sa.Column("changed", sa.BigInteger, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("drive", sa.Text, nullable=False),
        sa.Column("begun", sa.BigInteger, nullable=False),
        sa.Column("rows", sa.BigInteger, nullable=False),
        sa.Column("seconds", sa.Double),
        sa.Column("columns", sa.Text, nullable=False),
        sa.Column("title", sa.Text, nullable=False),
        sa.Column("note", sa.Text, nullable=False),
        sa.Column("marks", sa.Text, nullable=False),
        sa.Column("whole", sa.Boolean, nullable=False),
        sa.Column("ended", sa.Text, nullable=False),
        sa.Column("gaps", sa.Integer, nullable=False),
        sa.Column("rows_lost", sa.BigInteger, nullable=False),
        sa.Column("continues", sa.Text, nullable=False),
        sa.Column("problem", sa.Text, nullable=False),
    )
    op.create_table(
        "diagnoses",
        sa.Column("folder", sa.String(1000), primary_key=True),
        sa.Column("id", sa.String(50), primary_key=True),
        sa.Column("recording", sa.Text, nullable=False),
        sa.Column("drive", sa.Text, nullable=False),
        sa.Column("asked", sa.BigInteger, nullable=False),
        sa.Column("started", sa.BigInteger),
        sa.Column("ended", sa.BigInteger, nullable=False),
        sa.Column("state", sa.String(20), nullable=False),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("verdict", sa.String(50)),
        sa.Column("sentence", sa.Text),
        sa.Column("request", sa.Text, nullable=False),
        sa.Column("versions", sa.Text, nullable=False),
        sa.Column("sums", sa.Text, nullable=False),
    )
