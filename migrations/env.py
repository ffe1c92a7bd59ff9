"""Alembic's entry: where the database is, and which of its objects are ours.

The database is ``config.attributes["connection"]`` (a SQLAlchemy connection, used as it is), else the option
``sqlalchemy.url`` that ``app.core.migrate`` sets, else ``VERSANT_DATABASE_URL``.
"""

import importlib
import os
import pkgutil
from typing import Any

from alembic import context
from geoalchemy2 import alembic_helpers
from sqlalchemy import Connection, create_engine, pool

from app.core import migrate, schema, tables
from app.core.settings.places import sqlalchemy_url
from app.core.tables import Base
from app.core.tables.network import PARTITION_PREFIX

for _module in pkgutil.iter_modules(tables.__path__, f"{tables.__name__}."):
    importlib.import_module(_module.name)  # each describes tables of the same base


def include_object(thing: Any, name: str | None, kind: str, reflected: bool, compare_to: Any) -> bool:
    """Hide the queue's tables, partitions and PostGIS's own from the comparison."""
    if kind == "table" and name is not None and name.startswith(("procrastinate_", PARTITION_PREFIX)):
        return False
    return bool(alembic_helpers.include_object(thing, name, kind, reflected, compare_to))


def note_support(*, ctx: Any, step: Any, heads: Any, **_: Any) -> None:
    """After each migration: which programs the schema serves now."""
    for head in heads:
        module = step.revision_map.get_revision(head).module
        schema.note_support(ctx.connection, migrate.oldest_program(module))


def run(connection: Connection) -> None:
    """Run the migrations on an open connection, all in one transaction."""
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        include_object=include_object,
        process_revision_directives=alembic_helpers.writer,
        render_item=alembic_helpers.render_item,
        compare_server_default=False,
        on_version_apply=note_support,
    )
    with context.begin_transaction():
        context.run_migrations()


def url() -> str:
    """The database's URL, from the caller or the environment."""
    given = context.config.get_alembic_option("sqlalchemy.url") or os.environ.get("VERSANT_DATABASE_URL")
    if not given:
        raise SystemExit(
            "No database is named. Set VERSANT_DATABASE_URL to its URL, such as "
            "postgresql://user@host/versant, or use `versant migrate`."
        )
    return str(given)


if context.is_offline_mode():
    raise SystemExit("The queue's schema needs a connection: migrations cannot be written out as SQL.")
if (given_connection := context.config.attributes.get("connection")) is not None:
    run(given_connection)
else:
    engine = create_engine(sqlalchemy_url(url()), poolclass=pool.NullPool)
    with engine.connect() as own_connection:
        run(own_connection)
    engine.dispose()
