"""Editions out of the database, and the statements by which one is made of what may be told."""

from __future__ import annotations

from dataclasses import dataclass, fields
from datetime import date
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.caller import present_caller


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
# What every document of an edition says of it.
_NOTED = ("number", "day", "owners", "owners_needed")
# As they were, the rows of editions that named any file.
_FORGET_FILES = text(f"""
    UPDATE editions AS now SET files = '[]' FROM editions AS e
    WHERE now.number = e.number AND e.files <> '[]'
        AND e.number NOT IN (SELECT number FROM editions ORDER BY number DESC LIMIT :keep)
    RETURNING {", ".join(f"e.{one.name}" for one in fields(Edition))}
""")  # noqa: S608 - constants


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


def edition_note(session: Session) -> dict[str, Any]:
    """The member ``edition`` of a document of the map: which one the present caller sees; none of the live map."""
    edition = latest_edition(session) if present_caller().sees == "edition" else None
    return {} if edition is None else {"edition": identity(edition)}


def identity(edition: Edition) -> dict[str, Any]:
    """What every document of an edition says of it: which one it is, and among how many owners each is hidden."""
    return {**{name: getattr(edition, name) for name in _NOTED}, "day": edition.day.isoformat()}


def forget_files(session: Session, keep: int) -> list[Edition]:
    """Let all editions but the newest ones, ``keep`` of them, have no files; those that had some, with their files."""
    return [Edition(*row) for row in session.execute(_FORGET_FILES, {"keep": keep})]
