"""Whole databases: reached, made, dropped, locked for migration, and identified. Knows no table.

Making and dropping is for a server where we are superuser (the embedded cluster and the tests). Unlike the rest
of the service these functions take a URL, since databases are not made inside a transaction; only
``database_identity`` asks a session about its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psycopg
from psycopg import sql
from psycopg.conninfo import conninfo_to_dict
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.messages import say
from app.core.settings.places import libpq_url
from fusion.errors import FusionError

CONNECT_TIMEOUT_S = 10  # for each address that a name stands for

_MIGRATION = 0x5653_4D47  # "VSMG": any constant that no other user of this database takes
_IDENTITY = text("""
    SELECT c.system_identifier || '-' || d.oid FROM pg_control_system() AS c, pg_database AS d
    WHERE d.datname = current_database()
""")


class UnreachableError(FusionError):
    """No connection to the database can be made; the message names it, never with its password."""

    kind = "database-unreachable"


def require_reachable(url: str) -> None:
    """Connect once; raises ``UnreachableError``, at the latest after ``CONNECT_TIMEOUT_S`` per address."""
    place = "VERSANT_DATABASE_URL"
    try:
        parts = conninfo_to_dict(libpq_url(url))
        if "@" in str(parts.get("host", "")):  # what follows the first @ counts as the host, and is secret
            raise UnreachableError(say("cli.database_at_sign"))
        place = f"{parts.get('host', 'localhost')}:{parts.get('port', 5432)}/{parts.get('dbname', '')}"
        psycopg.connect(libpq_url(url), connect_timeout=CONNECT_TIMEOUT_S).close()
    except psycopg.Error as error:
        # Of several lines the last begins with a dash where several addresses were tried, else it is a hint.
        lines = str(error).strip().splitlines() or [type(error).__name__]
        reason = lines[-1] if lines[-1].startswith("- ") else lines[0]
        raise UnreachableError(say("cli.database_away", place=place, reason=reason.strip(" -."))) from error


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
    """Install PostGIS into the database, if it is not there; a standby, which takes no such statement, has it."""
    with psycopg.connect(libpq_url(url), autocommit=True) as connection:
        if not connection.execute("SELECT FROM pg_extension WHERE extname = 'postgis'").fetchall():
            connection.execute("CREATE EXTENSION IF NOT EXISTS postgis")


@contextmanager
def one_migration_at_a_time(url: str) -> Iterator[None]:
    """Hold a lock of the database, so that two programs that start together do not both migrate it."""
    with psycopg.connect(libpq_url(url), prepare_threshold=None) as connection:
        connection.execute("SELECT pg_advisory_xact_lock(%s)", (_MIGRATION,))
        # The end of the transaction gives the lock back, also after a crash.
        yield


def database_identity(session: Session) -> str:
    """A text that no other database has, of this server or any other; a restored dump is another database."""
    return str(session.execute(_IDENTITY).scalar_one())
