"""Whole databases: made and dropped on a server where we are superuser (the embedded cluster and the tests).

Unlike the rest of this package these functions take a URL: databases are not made inside a transaction.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psycopg
from psycopg import sql

from app.settings import libpq_url

_MIGRATION = 0x5653_4D47  # "VSMG": any constant that no other user of this database takes


def ensure_database(server_url: str, name: str, *, template: str = "template0") -> bool:
    """Create database ``name`` as a copy of ``template`` unless it exists; returns whether it was created.

    ``server_url`` names any other database of the same server.
    """
    with psycopg.connect(libpq_url(server_url), autocommit=True) as connection:
        if connection.execute("SELECT 1 FROM pg_database WHERE datname = %s", (name,)).fetchone():
            return False
        connection.execute(
            sql.SQL("CREATE DATABASE {} TEMPLATE {}").format(sql.Identifier(name), sql.Identifier(template))
        )
        return True


def drop_database(server_url: str, name: str) -> None:
    """Drop database ``name``, ending the connections that are still open to it; no error if it is gone."""
    with psycopg.connect(libpq_url(server_url), autocommit=True) as connection:
        connection.execute(sql.SQL("DROP DATABASE IF EXISTS {} WITH (FORCE)").format(sql.Identifier(name)))


def ensure_postgis(url: str) -> None:
    """Install PostGIS into the database, if it is not there."""
    with psycopg.connect(libpq_url(url), autocommit=True) as connection:
        connection.execute("CREATE EXTENSION IF NOT EXISTS postgis")


@contextmanager
def one_migration_at_a_time(url: str) -> Iterator[None]:
    """Hold a lock of the database, so that two programs that start together do not both migrate it."""
    with psycopg.connect(libpq_url(url), autocommit=True) as connection:
        connection.execute("SELECT pg_advisory_lock(%s)", (_MIGRATION,))
        # Closing the connection gives the lock back, also after a crash.
        yield
