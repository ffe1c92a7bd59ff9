"""The log of what was destroyed, or asked for in bulk, over HTTP: a row that commits with what it tells of.

There is no login yet, so who it was is what the service can see: the client's address (``app.core.receiving.clients``
says who that is behind a proxy) and its program.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, NamedTuple

from fastapi import Depends, Request
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_json, plain_text

LONGEST_PROGRAM = 80
LONGEST_SUBJECT = 200
MOST_SHOWN = 500

_ADD = text(
    """
    INSERT INTO audit_log (at, action, subject, detail, origin)
    VALUES (clock_timestamp(), :action, :subject, CAST(:detail AS jsonb), :origin)
    """
)
_READ = text(
    """
    SELECT at, action, subject, detail, origin FROM audit_log
    WHERE at > now() - make_interval(days => CAST(:days AS integer)) ORDER BY at DESC, id DESC LIMIT :most
    """
)


class Audited(NamedTuple):
    """One row of the log."""

    at: datetime
    action: str
    subject: str
    detail: dict[str, Any]
    origin: str


async def get_origin(request: Request) -> str:
    """Who asks, as far as the service can tell; the one place that a login will change."""
    address = request.client.host if request.client else "unknown"
    program = request.headers.get("user-agent", "").strip()
    shown = "".join(c for c in program if c.isprintable())[:LONGEST_PROGRAM]
    return f"{address} {shown}".strip()


Origin = Annotated[str, Depends(get_origin)]


def note(session: Session, origin: str, action: str, subject: object, **detail: Any) -> None:
    """Write a row in the session's transaction; what of ``detail`` is None is left out."""
    known: Mapping[str, Any] = {name: value for name, value in detail.items() if value is not None}
    values = {
        "action": action,
        "subject": plain_text(str(subject))[:LONGEST_SUBJECT],
        "detail": json.dumps(plain_json(known)),
        "origin": plain_text(origin),
    }
    session.execute(_ADD, values)


def entries(session: Session, days: int, most: int = MOST_SHOWN) -> list[Audited]:
    """The latest rows of so many days, the newest first."""
    return [Audited(*row) for row in session.execute(_READ, {"days": days, "most": most})]
