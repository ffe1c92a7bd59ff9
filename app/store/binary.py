"""Statements that carry many bytes: on the driver's own cursor, where bytes travel as they are, not as digits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from psycopg import Connection
from sqlalchemy.orm import Session


def fetch_binary(session: Session, query: str, parameters: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """The rows of a query with psycopg's placeholders, in the session's transaction."""
    with _connection(session).cursor(binary=True) as cursor:
        return list(cursor.execute(query, parameters).fetchall())


def send_binary(session: Session, statement: str, parameters: Mapping[str, Any]) -> None:
    """Execute a statement with psycopg's placeholders (``%(name)b`` for bytes) in the session's transaction."""
    with _connection(session).cursor() as cursor:
        cursor.execute(statement, parameters)


def _connection(session: Session) -> Connection[Any]:
    connection: Any = session.connection().connection.driver_connection
    assert isinstance(connection, Connection)  # noqa: S101 - the one driver that app.db uses
    return connection
