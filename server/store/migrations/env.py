"""Alembic runs this. Migrations happen in the transaction that `Store.migrate` holds, never on their own."""

from alembic import context

from server.store.tables import TableBase

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=TableBase.metadata,
    render_as_batch=True,  # SQLite alters a table only by copying it
)
with context.begin_transaction():
    context.run_migrations()
