"""The audit log: what was deleted, or asked for in bulk, over HTTP, as a row that commits with the change.

Who it was is said by the key that was shown and its owner, which the database notes by itself, and by what the service
can see: the client's address (``app.core.receiving.clients`` says who that is behind a proxy) and its program.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import Depends, Request
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_json, plain_text
from app.core.telemetry.logs import reason_text

LONGEST_PROGRAM = 80
LONGEST_SUBJECT = 200
MOST_SHOWN = 500
MOST_KEPT = 100_000
"""Rows: a client could ask a hundred times a second. The latest stay."""
NAMES, PLACES = frozenset({"filename"}), frozenset({"bbox"})
"""Details that no row holds, and those of which it holds only that there were any."""

_ADD = text("""
    INSERT INTO audit_log (at, action, subject, detail, origin)
    VALUES (clock_timestamp(), :action, :subject, CAST(:detail AS jsonb), :origin)
""")
_READ = text("""
    SELECT a.at, a.action, a.subject, a.detail, a.origin, o.name AS owner, a.key_id AS key
    FROM audit_log AS a JOIN owners AS o ON o.id = a.owner_id
    WHERE a.at > now() - make_interval(days => CAST(:days AS integer)) ORDER BY a.at DESC, a.id DESC LIMIT :most
""")
_READ_OF = text("""
    SELECT id, at, action, subject, detail, origin, key_id AS key FROM audit_log
    WHERE owner_id = :owner_id AND id > :after ORDER BY id LIMIT :most
""")
_PRUNE = text("DELETE FROM audit_log WHERE id <= (SELECT max(id) FROM audit_log) - CAST(:kept AS bigint)")


async def get_origin(request: Request) -> str:
    """From where the request is: address and program."""
    address = request.client.host if request.client else "unknown"
    program = request.headers.get("user-agent", "").strip()
    shown = "".join(c for c in program if c.isprintable())[:LONGEST_PROGRAM]
    return f"{address} {shown}".strip()


Origin = Annotated[str, Depends(get_origin)]


def note(session: Session, origin: str, action: str, subject: object, **detail: Any) -> None:
    """Write a row in the session's transaction; what of ``detail`` is None is left out.

    Rows outlast their subjects, so none holds the name of an uploaded file or a place: a box is noted as ``true``.
    """
    shown: Mapping[str, Any] = {
        name: name in PLACES or value
        for name, value in detail.items()
        if value is not None and name not in NAMES
    }
    values = {
        "action": action,
        "subject": reason_text(str(subject))[:LONGEST_SUBJECT],
        "detail": json.dumps(plain_json(shown)),
        "origin": plain_text(origin),
    }
    session.execute(_ADD, values)


def prune(session: Session, most: int = MOST_KEPT) -> None:
    """Delete all but about ``most`` of the latest rows."""
    session.execute(_PRUNE, {"kept": most})


def entries(session: Session, days: int) -> list[dict[str, Any]]:
    """At most ``MOST_SHOWN`` rows of the last ``days``, the newest first."""
    return [dict(row._mapping) for row in session.execute(_READ, {"days": days, "most": MOST_SHOWN})]


def entries_of(session: Session, owner_id: int, after: int) -> list[dict[str, Any]]:
    """At most ``MOST_SHOWN`` rows of an owner beyond the number ``after``, in their order."""
    rows = session.execute(_READ_OF, {"owner_id": owner_id, "after": after, "most": MOST_SHOWN})
    return [dict(row._mapping) for row in rows]
