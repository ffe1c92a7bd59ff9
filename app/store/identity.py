"""Which database this is."""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

_IDENTITY = text(
    """
    SELECT c.system_identifier || '-' || d.oid FROM pg_control_system() AS c, pg_database AS d
    WHERE d.datname = current_database()
    """
)


def database_identity(session: Session) -> str:
    """A text that no other database has, of this server or any other; a restored dump is another database."""
    return str(session.execute(_IDENTITY).scalar_one())
