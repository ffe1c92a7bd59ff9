"""The lock that orders writers, shared or exclusive. It is held until the transaction ends.

The network lock keeps a road import (exclusive) apart from transactions that write estimates (shared), so
that an estimate never lands on a segment that is just being replaced. Several estimates may be written at a
time: they lock the rows of the segments that they touch in id order (``app.store.slopes``).
"""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

_NETWORK = 0x5653_4E54  # "VSNT": any constant that no other user of this database takes

_LOCK_SHARED = text("SELECT pg_advisory_xact_lock_shared(:key)")
_LOCK_EXCLUSIVE = text("SELECT pg_advisory_xact_lock(:key)")


def share_network(session: Session) -> None:
    """Keep road and elevation imports out until this transaction ends."""
    session.execute(_LOCK_SHARED, {"key": _NETWORK})


def own_network(session: Session) -> None:
    """Wait for and keep out every writer of estimates and every other import until this transaction ends."""
    session.execute(_LOCK_EXCLUSIVE, {"key": _NETWORK})
