"""The identity of the published data, for ETags."""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

# The number alone would repeat in another database behind the same address (a demo made anew); the time of
# the last change does not.
_TAG = text("SELECT version, CAST(extract(epoch FROM updated_at) * 1000000 AS bigint) FROM data_version")


def data_version_tag(session: Session) -> str:
    """A short text that is equal for equal published data, across databases too."""
    version, changed_us = session.execute(_TAG).one()
    return f"{version}.{changed_us:x}"
