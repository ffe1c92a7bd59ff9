"""What readiness asks the database."""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

_HAS_TABLE = text("SELECT to_regclass('alembic_version') IS NOT NULL")
_REVISION = text("SELECT version_num FROM alembic_version")


def schema_revision(session: Session) -> str | None:
    """The migration that the database is at, or None where none was applied."""
    if not session.execute(_HAS_TABLE).scalar_one():
        return None
    revision = session.execute(_REVISION).scalar()
    return None if revision is None else str(revision)
