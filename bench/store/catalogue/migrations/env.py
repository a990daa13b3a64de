"""Run by Alembic: the steps, over the connection that `database` has."""

from alembic import context

from bench.store.catalogue.tables import METADATA

with context.config.attributes["connection"].begin_nested() as _:
    context.configure(connection=context.config.attributes["connection"], target_metadata=METADATA)
    context.run_migrations()
