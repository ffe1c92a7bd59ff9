"""Which jobs a process computes now, so that its death counts against these jobs alone.

A process holds one connection as the sign that it lives: the kernel closes it when the process ends, however it ends,
and the server notices at once. A job whose worker is silent is charged with a death only if its mark stands, the server
has lost that connection, and the server itself has not been started since. So a process that is cut off, paused or
asked to stop, a machine that vanished and a database that was away are nobody's fault.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import psycopg
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.settings.places import libpq_url

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 10

# A mark that is lost with the server would not have counted: nobody waits for the disk.
_OPTIONS = "-c synchronous_commit=off -c statement_timeout=10s"

_IDENTITY = "SELECT pid, backend_start FROM pg_stat_activity WHERE pid = pg_backend_pid()"
_BEGIN = """
    INSERT INTO computations (job_id, since, process, backend, backend_start)
    VALUES (%(job)s, clock_timestamp(), %(process)s, %(backend)s, %(start)s)
    ON CONFLICT (job_id) DO UPDATE SET since = excluded.since, process = excluded.process,
        backend = excluded.backend, backend_start = excluded.backend_start
"""
_END = """
    UPDATE computations SET since = NULL
    WHERE job_id = %(job)s AND backend = %(backend)s AND backend_start = %(start)s
"""
_END_ALL = "UPDATE computations SET since = NULL WHERE backend = %(backend)s AND backend_start = %(start)s"
_ALIVE = "SELECT 1"
_DEATHS = "SELECT deaths FROM computations WHERE job_id = %(job)s"
_FORGET = "DELETE FROM computations WHERE job_id = %(job)s"

# Whoever may not see another role's connections sees their numbers at least.
_CHARGE = text("""
    UPDATE computations AS c
    SET since = NULL, deaths = c.deaths + CASE WHEN c.since > pg_postmaster_start_time() AND NOT EXISTS (
            SELECT FROM pg_stat_activity AS a
            WHERE a.pid = c.backend AND coalesce(a.backend_start, c.backend_start) = c.backend_start
        ) THEN 1 ELSE 0 END
    WHERE c.job_id = :job AND c.since IS NOT NULL RETURNING c.deaths
""")

# Of jobs that came to their end while the database was not there to be told so, or in the hands of another worker.
_FORGET_GONE = text(
    "DELETE FROM computations AS c WHERE NOT EXISTS (SELECT FROM procrastinate_jobs AS j WHERE j.id = c.job_id)"
)


class Liveness:
    """This process's marks, and the connection that ends when it does. Any thread may use it."""

    def __init__(self, url: str) -> None:
        self._url = libpq_url(url)
        self._name = f"{socket.gethostname()}:{os.getpid()}"
        self._connection: psycopg.Connection[Any] | None = None
        self._identity: dict[str, Any] = {}
        self._marks: dict[int, dict[str, Any]] = {}
        self._lock = threading.Lock()
        self._stopping = threading.Event()

    @contextmanager
    def computing(self, job: int) -> Iterator[None]:
        """The block computes the job; psycopg's ``OperationalError`` when the database cannot be told so."""
        if self._stopping.is_set():
            yield
            return
        with self._lock:
            self._mark(job)
        try:
            yield
        finally:
            self._clear(_END, self._marks.pop(job))

    def look(self) -> None:
        """Where the connection was cut, renew it and the marks, so that nobody takes this process for dead."""
        with self._lock:
            if not self._marks or self._stopping.is_set():
                return
            try:
                self._open().execute(_ALIVE)
            except psycopg.Error:
                for job in tuple(self._marks):
                    self._mark(job)

    def deaths(self, job: int) -> int:
        """In how many runs of the job the process died of it."""
        with self._lock:
            row = self._open().execute(_DEATHS, {"job": job}).fetchone()
        return row[0] if row else 0

    def forget(self, job: int) -> None:
        """The job is at its end."""
        self._clear(_FORGET, {"job": job})

    def stop(self) -> None:
        """This process is about to end, and none of its jobs is to blame: take their marks away, set no more."""
        self._stopping.set()
        if self._identity:
            self._clear(_END_ALL, self._identity)

    def close(self) -> None:
        """Give the connection back; the next use opens another."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()

    def _mark(self, job: int) -> None:
        connection = self._open()
        mark = {"job": job, **self._identity}
        connection.execute(_BEGIN, {"process": self._name, **mark})
        self._marks[job] = mark

    def _open(self) -> psycopg.Connection[Any]:
        if self._connection is None or self._connection.closed:
            self._connection = psycopg.connect(
                self._url,
                autocommit=True,
                connect_timeout=CONNECT_TIMEOUT_S,
                tcp_user_timeout=CONNECT_TIMEOUT_S * 1000,
                options=_OPTIONS,
                application_name="versant liveness",
            )
            row = self._connection.execute(_IDENTITY).fetchone()
            assert row is not None  # noqa: S101 - a connection sees itself
            self._identity = {"backend": row[0], "start": row[1]}
        return self._connection

    def _clear(self, statement: str, values: dict[str, Any]) -> None:
        """Take a mark away; where the database is gone it will not count (see above)."""
        for _ in range(2):  # the connection may have been cut while nobody looked
            with suppress(psycopg.Error), self._lock:
                self._open().execute(statement.encode(), values)
                return
        logger.warning("a mark of a computation could not be taken away: the database is not there")


def charge(session: Session, job: int) -> int:
    """The worker of a job is silent: count a death if its process died while it computed; returns how many."""
    return session.execute(_CHARGE, {"job": job}).scalar() or 0


def forget_gone(session: Session) -> None:
    """Take away what is left of jobs that are in the queue no more."""
    session.execute(_FORGET_GONE)
