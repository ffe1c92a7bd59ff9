"""Which jobs a process computes now, so that its death counts against these jobs alone.

A process marks a job while it computes it, and holds a file locked as the sign that it lives (``Signs``).
Every worker looks again and again whether one of its machine died, and charges the jobs that carry the marks of that
one with a death, unless the server has been started since. So a process that is cut off, paused or asked to stop, a
machine that vanished and a database that was away are nobody's fault. What the dead had claimed is free from then on. A
mark is its process's: the next run of the job, wherever it is, puts its own in its place.
"""

from __future__ import annotations

import fcntl
import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session
from sqlalchemy.sql.elements import TextClause

from app.core import claims
from app.core.claims import process_name
from app.core.db import Sessions

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


SIGNS = "processes"
"""Folder in the data folder for signs of life."""
FORGOTTEN_AFTER_S = 86_400.0
"""Files of former starts of the machine, or of another machine that uses the folder too, go then."""
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@cache
def _boot() -> str:
    """What no other start of this machine has. Where the system does not tell, its end seems to be a death."""
    with suppress(OSError):
        return _BOOT.read_text().strip()
    return "boot"


class Signs:
    """The files in a folder that the processes of one machine share; this process's own among them.

    Each is locked, and the kernel unlocks it when its process ends, however. A connection to the database was such a
    sign, but a pooler does not show whose it is, and one that is cut off looks like one that died. A file whose lock is
    free is of a process that died, unless its name ends with another start of the machine: then the machine went. Of
    other machines, which have folders of their own, nothing is said.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._handle: int | None = None

    def begin(self) -> None:
        """Give this process's sign. Where no file can be locked there is none, and its death is not noticed."""
        name = f"{process_name()}.{_boot()}"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            hidden = self._folder / f".{name}"
            self._handle = os.open(hidden, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            fcntl.flock(self._handle, fcntl.LOCK_EX)
            hidden.rename(self._folder / name)  # nobody sees it while it is not locked
        except OSError as error:
            logger.warning(
                "no file can be locked in %s (%s): if this process dies nobody will know",
                self._folder,
                error.strerror,
            )

    def end(self) -> None:
        """This process is about to end in order, or to be killed for good reason: nobody has to wonder about it."""
        handle, self._handle = self._handle, None
        if handle is not None:
            with suppress(OSError):
                (self._folder / f"{process_name()}.{_boot()}").unlink()
            os.close(handle)

    @contextmanager
    def died(self) -> Iterator[list[str]]:
        """Names of processes that died on this machine since it was started; forgotten when the block succeeds.

        Nobody else is told of them meanwhile.
        """
        found: dict[Path, int] = {}
        try:
            for path in self._others():
                if (handle := _locked(path)) is not None:
                    found[path] = handle
            yield [path.name.rpartition(".")[0] for path in found]
            for path in found:
                path.unlink(missing_ok=True)
        finally:
            for handle in found.values():
                os.close(handle)

    def living(self) -> int:
        """How many processes of this machine live and share the folder."""
        count = 0
        for path in self._folder.glob(f"[!.]*.{_boot()}"):
            if (handle := _locked(path)) is None:
                count += 1
            else:
                os.close(handle)
        return count

    def _others(self) -> list[Path]:
        """Files of this start of the machine."""
        with suppress(OSError):
            paths = [path for path in self._folder.iterdir() if not path.name.startswith(".")]
            of_now = [path for path in paths if path.name.endswith(f".{_boot()}")]
            for path in set(paths).difference(of_now):
                with suppress(OSError):
                    if time.time() - path.stat().st_mtime > FORGOTTEN_AFTER_S:
                        path.unlink()
            return sorted(of_now)
        return []


def _locked(path: Path) -> int | None:
    """The file, opened and locked; None where its process lives, or somebody else looks at it."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle
