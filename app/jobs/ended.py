"""Jobs that ended, and are still in the queue's table, go when they are old: failed, cancelled and aborted ones.

One that succeeded goes at its end. Nobody reads the others: what became of a drive or a request stands in its own row.
The queue's own ``delete_old_jobs`` reads all jobs with all their events in one statement, and holds them. Here jobs are
looked at by their numbers, so many at a time, each piece a short transaction that waits for nobody; an event goes with
its job. Numbers are given in the order of time: the look ends where jobs are young.
"""

from __future__ import annotations

import logging

from sqlalchemy import text

from app.core.claims import alone
from app.core.db import Sessions

logger = logging.getLogger(__name__)

PIECE = 5000
"""Jobs that one transaction looks at: 0.2 s where all of them go."""
LOOK_EVERY_S = 3600.0

# By the queue's keys of jobs and of events by job. A job that somebody holds, to put it back, is left for the next
# time; one whose events somebody has deleted is old.
_REMOVE = text("""
    WITH looked AS MATERIALIZED (
        SELECT id, status NOT IN ('todo', 'doing') AS ended FROM procrastinate_jobs
        WHERE id > :after ORDER BY id LIMIT :piece
    ), dated AS MATERIALIZED (
        SELECT l.id, l.ended, coalesce(e.first_at, '-infinity') AS made_at, coalesce(e.last_at, '-infinity') AS last_at
        FROM looked AS l, LATERAL (
            SELECT min(at) AS first_at, max(at) AS last_at FROM procrastinate_events WHERE job_id = l.id) AS e
    ), old AS MATERIALIZED (
        SELECT j.id FROM procrastinate_jobs AS j
        WHERE j.id = ANY(ARRAY(SELECT id FROM dated WHERE ended AND last_at < now() - make_interval(secs => :age_s)))
            AND j.status NOT IN ('todo', 'doing')
        ORDER BY j.id FOR UPDATE SKIP LOCKED
    ), gone AS (
        DELETE FROM procrastinate_jobs WHERE id = ANY(ARRAY(SELECT id FROM old)) RETURNING id
    )
    SELECT (SELECT count(*) FROM gone) AS gone, max(id) AS last,
           count(*) = :piece AND min(made_at) < now() - make_interval(secs => :age_s) AS more
    FROM dated
""")


class EndedJobs:
    """Removes those that ended so many days ago."""

    def __init__(self, sessions: Sessions, kept_days: float) -> None:
        self._sessions, self._age_s = sessions, 86400.0 * kept_days
        self._after, self._gone = 0, 0

    def piece(self) -> bool:
        """The next piece; whether there may be more. Where another process is at it nothing is done."""
        with alone(self._sessions, "ended jobs") as claim:
            if claim is None:
                return False
            with self._sessions.begin() as session:
                values = {"after": self._after, "piece": PIECE, "age_s": self._age_s}
                gone, last, more = session.execute(_REMOVE, values).one()
        self._gone += gone
        if more:
            self._after = last
            return True
        if self._gone:
            logger.info("%d jobs that ended long ago are out of the queue's table", self._gone)
        self._after = self._gone = 0
        return False
