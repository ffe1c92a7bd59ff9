"""The lock of those who change the map, and the number of what is published.

Whoever changes what drives say, or the roads under it, owns the network first and raises the number last, in the same
transaction. Whoever reads needs no lock: the number tells whether anything changed since. What is changed, and how, is
not known here.
"""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

_NETWORK = 0x5653_4E54  # "VSNT": any constant that no other user of this database takes

_LOCK = text("SELECT pg_advisory_xact_lock(:key)")

_VERSION = text("SELECT version FROM data_version")
_BUMP = text("UPDATE data_version SET version = version + 1, updated_at = now() RETURNING version")

# The number alone would repeat in another database behind the same address (a demo made anew); the time of
# the last change does not.
_TAG = text("SELECT version, CAST(extract(epoch FROM updated_at) * 1000000 AS bigint) FROM data_version")


def own_network(session: Session) -> None:
    """Wait for and keep out every other writer of estimates and every import until this transaction ends."""
    session.execute(_LOCK, {"key": _NETWORK})


def bump_data_version(session: Session) -> int:
    """Raise the number; last in every transaction that changes published data."""
    return int(session.execute(_BUMP).scalar_one())


def data_version(session: Session) -> int:
    """The number of the published data; equal numbers mean equal tiles and items."""
    return int(session.execute(_VERSION).scalar_one())


def data_version_tag(session: Session) -> str:
    """A short text that is equal for equal published data, across databases too."""
    version, changed_us = session.execute(_TAG).one()
    return f"{version}.{changed_us:x}"
