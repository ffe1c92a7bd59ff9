"""The few cheap figures that a scrape of /metrics reads; the dear ones are in ``app.store.stats``."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import text
from sqlalchemy.orm import Session

# Both are answered from the index on (status, created_at, id).
_BY_STATUS = text("SELECT status, count(*) FROM drives GROUP BY status")
_OLDEST = text(
    "SELECT extract(epoch FROM clock_timestamp() - min(queued_at)) FROM drives WHERE status = 'queued'"
)
_VERSION = text("SELECT version FROM data_version")


@dataclass(frozen=True)
class Gauges:
    """Figures of one moment."""

    drives_by_status: dict[str, int]
    queue_depth: int
    oldest_wait_s: float
    data_version: int


def read_gauges(session: Session) -> Gauges:
    """The figures of this moment."""
    by_status = {str(status): int(count) for status, count in session.execute(_BY_STATUS)}
    oldest = session.execute(_OLDEST).scalar()
    return Gauges(
        drives_by_status=by_status,
        queue_depth=by_status.get("queued", 0),
        oldest_wait_s=max(0.0, float(oldest or 0.0)),
        data_version=int(session.execute(_VERSION).scalar_one()),
    )
