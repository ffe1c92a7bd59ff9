"""Totals of all processes in the database: each process writes a row of its own, and the API adds them up.

So no worker needs a port to scrape, no two processes wait for each other, and totals outlive the process that counted
them: a killed worker loses the last few seconds. Rows of processes that have ended are folded into one. A process whose
row was folded, since it was silent for long, begins another with what came since: no counter ever falls.
"""

from __future__ import annotations

import json
import logging
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.telemetry.measures import Totals, growth, totals_now

WRITE_EVERY_S = 5.0
FOLD_AFTER_S = 3600.0
"""Age of rows that are folded into one."""
FOLD_FROM_ROWS = 20
"""Fewer rows are not folded."""

logger = logging.getLogger(__name__)

_WRITE = text("""
    UPDATE process_totals SET totals = CAST(:totals AS jsonb), written_at = clock_timestamp() WHERE id = :id
    RETURNING id
""")
_BEGIN = text(
    "INSERT INTO process_totals (id, process, totals) VALUES (:id, :process, CAST(:totals AS jsonb))"
)

# As decimal fractions: a sum of binary ones depends on its order, and a counter that falls by a rounding looks to
# Prometheus as if it had begun anew.
_SUMS = text("""
    SELECT of_it.key, CAST(sum(CAST(of_it.value AS numeric)) AS float8)
    FROM process_totals AS p, jsonb_each_text(p.totals) AS of_it GROUP BY of_it.key
""")
_FOLD = text("""
    WITH ended AS MATERIALIZED (
        SELECT id FROM process_totals WHERE written_at < clock_timestamp() - make_interval(secs => :after_s)
        FOR UPDATE SKIP LOCKED
    ), gone AS (
        DELETE FROM process_totals WHERE id IN (SELECT id FROM ended) AND (SELECT count(*) FROM ended) >= :from_rows
        RETURNING totals
    ), summed AS (
        SELECT of_it.key, sum(CAST(of_it.value AS numeric)) AS total
        FROM gone, jsonb_each_text(gone.totals) AS of_it GROUP BY of_it.key
    )
    INSERT INTO process_totals (id, process, totals)
    SELECT gen_random_uuid(), 'processes that have ended', jsonb_object_agg(key, total) FROM summed HAVING count(*) > 0
""")


class Ledger:
    """Counts of this process from now on, and its row."""

    def __init__(self, sessions: Sessions, process: str) -> None:
        self._sessions, self._process = sessions, process
        self._since = totals_now()
        self._id: uuid.UUID | None = None
        self._written: Totals = {}
        self._lock = threading.Lock()

    def write(self) -> None:
        """Write what has been counted, if anything has been since the last time. A chore of every few seconds."""
        with self._lock:
            now = totals_now()
            totals = growth(now, self._since)
            if totals == self._written:
                return
            with self._sessions.begin() as session:
                # Else there is no row yet, or it was added up with those of others, as it stood.
                if session.execute(_WRITE, self._values(totals)).scalar() is None:
                    since = {key: self._since.get(key, 0.0) + t for key, t in self._written.items()}
                    self._since, self._written = {**self._since, **since}, {}
                    totals = growth(now, self._since)
                    self._id = uuid.uuid4()
                    session.execute(_BEGIN, self._values(totals) | {"process": self._process})
            self._written = totals

    def _values(self, totals: Totals) -> dict[str, object]:
        return {"id": self._id, "totals": json.dumps(totals)}

    def fold(self) -> None:
        """Add up the rows of processes that have ended, where there are many."""
        with self._sessions.begin() as session:
            session.execute(_FOLD, {"after_s": FOLD_AFTER_S, "from_rows": FOLD_FROM_ROWS})


@contextmanager
def counting(sessions: Sessions, process: str) -> Iterator[Ledger]:
    """What the process counts within the block is written at its end at the latest."""
    ledger = Ledger(sessions, process)
    try:
        yield ledger
    finally:
        try:
            ledger.write()
        except Exception:  # the figures of some seconds: no reason to fail what was done
            logger.info("what was counted last is lost: it could not be written", exc_info=True)


def totals_of_all(session: Session) -> Totals:
    """The totals over all processes, those that have ended included."""
    return {row[0]: row[1] for row in session.execute(_SUMS)}
