"""The first form: settings of windows, and the history of estimates."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """From nothing."""
    op.create_table(
        "window_settings",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("bench", sa.String(200), nullable=False),
        sa.Column("drive", sa.String(200), nullable=False),
        sa.Column("changed", sa.BigInteger, nullable=False),
        sa.Column("configured", sa.Text, nullable=False),
        sa.Column("settings", sa.Text, nullable=False),
    )
    op.create_index("ix_window_settings_bench", "window_settings", ["bench"])
    op.create_table(
        "series",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("bench", sa.String(200), nullable=False),
        sa.Column("drive", sa.String(200), nullable=False),
        sa.Column("parameter", sa.String(20), nullable=False),
        sa.UniqueConstraint("bench", "drive", "parameter", name="series_once"),
    )
    op.create_table(
        "points",
        sa.Column("series", sa.Integer, sa.ForeignKey("series.id"), primary_key=True),
        sa.Column("span", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("t", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("value", sa.Double, nullable=False),
        sa.Column("std", sa.Double),
        sa.Column("low", sa.Double, nullable=False),
        sa.Column("high", sa.Double, nullable=False),
        sa.Column("status", sa.SmallInteger, nullable=False),
        sqlite_with_rowid=False,
    )
