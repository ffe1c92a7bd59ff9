"""Editions out of the database, and the statements by which one is made of what may be told."""

from __future__ import annotations

from dataclasses import dataclass, fields
from datetime import date
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session


@dataclass(frozen=True)
class Edition:
    """An edition of the map for the public."""

    number: int
    day: date
    owners: int
    """Among so many each is hidden, even from those that work together."""
    owners_needed: int
    """Distinct owners who drove a segment of it."""
    segments: int
    length_m: float
    withheld_share: float | None
    """Of the driven segments; None where none is driven. Two decimals, as of their length."""
    withheld_length_share: float | None
    files: list[dict[str, Any]]
    """Of those that are kept: ``name``, ``media_type``, ``size_bytes``, ``sha256``."""


_COLUMNS = ", ".join(one.name for one in fields(Edition))
_LIST = text(f"SELECT {_COLUMNS} FROM editions ORDER BY number DESC")  # noqa: S608 - constants
_LATEST = text(f"SELECT {_COLUMNS} FROM editions ORDER BY number DESC LIMIT 1")  # noqa: S608 - constants
_ONE = text(f"SELECT {_COLUMNS} FROM editions WHERE number = :number")  # noqa: S608 - constants


def _edition(row: Row[Any] | None) -> Edition | None:
    return None if row is None else Edition(*row)


def list_editions(session: Session) -> list[Edition]:
    """All editions, the newest first."""
    return [Edition(*row) for row in session.execute(_LIST)]


def latest_edition(session: Session) -> Edition | None:
    """The newest edition; None: there is none yet."""
    return _edition(session.execute(_LATEST).one_or_none())


def get_edition(session: Session, number: int) -> Edition | None:
    """The edition of that number; None: there is none."""
    return _edition(session.execute(_ONE, {"number": number}).one_or_none())
