"""The number of the published data."""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

_VERSION = text("SELECT version FROM data_version")
_BUMP = text("UPDATE data_version SET version = version + 1, updated_at = now() RETURNING version")


def data_version(session: Session) -> int:
    """The number of the published data; equal numbers mean equal tiles and items."""
    return int(session.execute(_VERSION).scalar_one())


def bump_data_version(session: Session) -> int:
    """Raise the number; last in every transaction that changes published data."""
    return int(session.execute(_BUMP).scalar_one())
