"""The lock that orders writers. It is held until the transaction ends.

Whoever changes the roads, the elevation or what drives contribute takes the network lock first, before it
reads anything that it builds on: imports, published and removed drives come one after the other. Workers
estimate in parallel, which takes seconds; what they write takes a part of one.
"""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

_NETWORK = 0x5653_4E54  # "VSNT": any constant that no other user of this database takes

_LOCK = text("SELECT pg_advisory_xact_lock(:key)")


def own_network(session: Session) -> None:
    """Wait for and keep out every other writer of estimates and every import until this transaction ends."""
    session.execute(_LOCK, {"key": _NETWORK})
