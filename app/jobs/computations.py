"""Which jobs a process computes now, so that its death counts against these jobs alone.

A process marks a job while it computes it, and holds a file locked as the sign that it lives (``app.jobs.signs``).
Every worker looks again and again whether one of its machine died, and charges the jobs that carry the marks of that
one with a death, unless the server has been started since. So a process that is cut off, paused or asked to stop, a
machine that vanished and a database that was away are nobody's fault. What the dead had claimed is free from then on. A
mark is its process's: the next run of the job, wherever it is, puts its own in its place.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session
from sqlalchemy.sql.elements import TextClause

from app.core import claims
from app.core.claims import process_name
from app.core.db import Sessions
from app.jobs.signs import Signs

logger = logging.getLogger(__name__)

# A mark that is lost with the server would not have counted: nobody waits for the disk.
_SOON = text(
    "SELECT set_config('synchronous_commit', 'off', true), set_config('statement_timeout', '10s', true)"
)
_BEGIN = text("""
    INSERT INTO computations (job_id, since, process) VALUES (:job, clock_timestamp(), :process)
    ON CONFLICT (job_id) DO UPDATE SET since = excluded.since, process = excluded.process
""")
_END = text("UPDATE computations SET since = NULL WHERE job_id = :job AND process = :process")
_END_ALL = text("UPDATE computations SET since = NULL WHERE process = :process AND since IS NOT NULL")
_DEATHS = text("SELECT deaths FROM computations WHERE job_id = :job")
_FORGET = text("DELETE FROM computations WHERE job_id = :job")
_CHARGE = text("""
    UPDATE computations SET since = NULL, deaths = deaths + CAST(since > pg_postmaster_start_time() AS integer)
    WHERE process = ANY(:processes) AND since IS NOT NULL
""")

# Of jobs that came to their end while the database was not there to be told so, or in the hands of another worker.
_FORGET_GONE = text(
    "DELETE FROM computations AS c WHERE NOT EXISTS (SELECT FROM procrastinate_jobs AS j WHERE j.id = c.job_id)"
)


class Liveness:
    """This process's marks, and the sign of its life. Any thread may use it."""

    def __init__(self, sessions: Sessions, signs: Signs) -> None:
        self._sessions, self._signs = sessions, signs
        self._stopping = threading.Event()

    @contextmanager
    def computing(self, job: int) -> Iterator[None]:
        """The block computes the job; SQLAlchemy's ``OperationalError`` when the database cannot be told so."""
        if self._stopping.is_set():
            yield
            return
        mark = {"job": job, "process": process_name()}
        self._write(_BEGIN, mark)
        try:
            yield
        finally:
            self._clear(_END, mark)

    def deaths(self, job: int) -> int:
        """In how many runs of the job the process died of it."""
        with self._sessions() as session:
            return session.execute(_DEATHS, {"job": job}).scalar() or 0

    def forget(self, job: int) -> None:
        """The job is at its end."""
        self._clear(_FORGET, {"job": job})

    def stop(self) -> None:
        """This process is about to end, and none of its jobs is to blame: take their marks away, set no more."""
        self._stopping.set()
        self._signs.end()  # what can be done without the database comes first
        self._clear(_END_ALL, {"process": process_name()})

    def _write(self, statement: TextClause, values: dict[str, Any]) -> None:
        with self._sessions.begin() as session:
            session.execute(_SOON)
            session.execute(statement, values)

    def _clear(self, statement: TextClause, values: dict[str, Any]) -> None:
        """Take a mark away; where the database is gone it will not count (see above)."""
        for _ in range(2):  # the connection may be cut just now
            with suppress(SQLAlchemyError):
                self._write(statement, values)
                return
        logger.warning("a mark of a computation could not be taken away: the database is not there")


def charge_dead(sessions: Sessions, signs: Signs) -> list[str]:
    """Count deaths against what processes of this machine computed that died, and end their claims; their names."""
    with signs.died() as processes:
        if processes:
            with sessions.begin() as session:
                session.execute(_CHARGE, {"processes": processes})
                claims.free_of(session, processes)
        return processes


def forget_gone(session: Session) -> None:
    """Take away what is left of jobs that are in the queue no more."""
    session.execute(_FORGET_GONE)
