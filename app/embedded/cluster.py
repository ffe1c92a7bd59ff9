"""A private PostgreSQL + PostGIS cluster in a folder, reached through a Unix socket only."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self
from urllib.parse import quote

from app.core import databases
from app.core.messages import say
from app.core.settings.places import SQLALCHEMY_SCHEME
from app.embedded import data_folder
from app.embedded.account import Account, account_for, with_access
from app.embedded.binaries import find_binaries
from app.embedded.errors import EmbeddedPostgresError
from app.embedded.postmaster import Postmaster, running_postmaster


class FileLock:
    """A held lock; released by ``release``, at the end of a ``with`` block, or with the process."""

    def __init__(self, path: Path, account: Account) -> None:
        """Open the lock file, not locked yet."""
        self._path = path
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise EmbeddedPostgresError(say("embedded.lock_file", path=path, error=error.strerror)) from error
        account.own(self._handle)

    @classmethod
    def shared(cls, path: Path, account: Account) -> Self:
        """One of any number of holders."""
        lock = cls(path, account)
        fcntl.flock(lock._handle, fcntl.LOCK_SH)
        return lock

    @classmethod
    def exclusive(cls, path: Path, account: Account, timeout_s: float) -> Self:
        """The only holder; waits for the others, at most ``timeout_s``."""
        lock = cls(path, account)
        if not wait_until(lock.try_exclusive, timeout_s):
            lock.release()
            raise EmbeddedPostgresError(say("embedded.locked", seconds=timeout_s, path=path))
        return lock

    def try_exclusive(self) -> bool:
        """Become the only holder if nobody else holds the lock."""
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def release(self) -> None:
        """Give the lock back."""
        os.close(self._handle)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Ask again and again; whether it held in time."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


DATABASE = "versant"
START_TIMEOUT_S = 120.0
"""Also how long another program may take that is starting or stopping the same server."""
STOP_TIMEOUT_S = 60.0
"""For a clean shutdown, which writes everything; then the server is made to crash, which it survives."""
LARGEST_LOG_BYTES = 10 * 2**20
"""A longer log is put aside at the next start."""

# What PostgreSQL says while processes of a killed server are still on their way out.
_STILL_LEAVING = "pre-existing shared memory block"


class EmbeddedPostgres:
    """The cluster in ``data_dir/postgres``: initialised at the first start, then kept.

    Any number of programs may use one folder at once: the first starts the server, the others find it running
    (also one that a killed program left behind), and the last to stop shuts it down. Who uses it is known by
    a file lock, which the kernel releases when a program dies, however it dies. The server has its own
    session, so Ctrl-C reaches the program and not the database under it.

    As root the server runs as an unprivileged user; its folder belongs to that user, mode 0700, and within
    that folder everybody is trusted. ``durable=False`` trades safety in a power cut for speed, for tests.
    """

    def __init__(self, data_dir: Path, *, durable: bool = True) -> None:
        """Nothing is touched before ``start``."""
        self._cluster = Path(data_dir).expanduser().resolve() / "postgres"
        self._data = self._cluster / "data"
        self.log_path = self._cluster / "postgres.log"
        """The server's log."""
        self._durable = durable
        self._usage: FileLock | None = None
        self._socket_dir: Path | None = None

    @property
    def url(self) -> str:
        """SQLAlchemy URL of the database, valid while started."""
        return self.url_of(DATABASE)

    def url_of(self, database: str) -> str:
        """SQLAlchemy URL of another database of the cluster, valid while started."""
        if self._socket_dir is None:
            raise EmbeddedPostgresError(say("embedded.not_started"))
        host = quote(str(self._socket_dir), safe="/")
        return f"{SQLALCHEMY_SCHEME}{data_folder.SUPERUSER}@/{quote(database)}?host={host}&port={data_folder.PORT}"

    def is_running(self) -> bool:
        """Whether a server runs on the folder and takes connections, whoever started it."""
        server = running_postmaster(self._data)
        return server is not None and server.ready

    def start(self) -> Self:
        """Make sure that the server runs and the database exists; raises ``EmbeddedPostgresError``."""
        if self._usage is not None:
            return self
        account = data_folder.own_folder(self._cluster)
        with self._starting_or_stopping(account):
            self._usage = FileLock.shared(self._cluster / "users.lock", account)
            try:
                self._bring_up(account)
            except BaseException:
                self._leave()
                raise
        return self

    def stop(self) -> None:
        """Shut the server down unless another program uses it. Does nothing when not started."""
        if self._usage is not None:
            with self._starting_or_stopping(account_for(self._cluster)):
                self._leave()

    @property
    def lost(self) -> bool:
        """Whether the server that was started here has ended, or can be reached no more. Cheap to ask."""
        if self._usage is None:
            return False
        server = running_postmaster(self._data)
        return server is None or (server.ready and not _has_socket(server))

    def revive(self) -> bool:
        """Start the server again if it is ``lost``; returns whether it was, still under our lock.

        Our use of the folder goes on, and the URLs stay as they are. Raises ``EmbeddedPostgresError``, also
        where the cluster's folder was deleted: a new, empty database is nothing to go on with.
        """
        if not self.lost:
            return False
        if not self._data.is_dir():
            raise EmbeddedPostgresError(say("embedded.folder_gone", folder=self._data))
        account = account_for(self._cluster)
        with self._starting_or_stopping(account):
            if not self.lost:  # another program that uses the folder was quicker
                return False
            self._bring_up(account)
        return True

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _starting_or_stopping(self, account: Account) -> FileLock:
        return FileLock.exclusive(self._cluster / "start.lock", account, START_TIMEOUT_S)

    def _bring_up(self, account: Account) -> None:
        server = self._await_server()
        if server is None:
            self._launch(with_access(account, [self._cluster]))
            server = self._await_server()
        if server is None:
            raise EmbeddedPostgresError(say("embedded.stopped", words=self._last_words()))
        self._socket_dir = server.socket_dir
        databases.ensure_database(self.url_of("postgres"), DATABASE)
        databases.ensure_postgis(self.url)

    def _await_server(self) -> Postmaster | None:
        """The running server once it is ready, or None if there is none or it is one that shuts down."""
        wait_until(lambda: (s := running_postmaster(self._data)) is None or s.ready, START_TIMEOUT_S)
        server = running_postmaster(self._data)
        if server is None:
            return None
        if not server.ready:
            raise EmbeddedPostgresError(
                say("embedded.busy", pid=server.pid, seconds=START_TIMEOUT_S, words=self._last_words())
            )
        if not _has_socket(server):
            # Something cleaned the folder for temporary files; nobody can connect any more.
            self._shut_down(server)
            return None
        return server

    def _launch(self, account: Account) -> None:
        major = data_folder.existing_major(self._data)
        binaries = find_binaries(major)
        if major is None:
            data_folder.initialise(self._cluster, account, binaries.path("initdb"), durable=self._durable)
        socket_dir = data_folder.prepare_socket_dir(self._cluster, account)
        account = with_access(account, [self._cluster, socket_dir])
        # No server runs here. PostgreSQL removes its lock file itself when the pid there is free, but not when another
        # program of the same user has it. What outlives a killed server is still noticed, by its shared memory.
        (self._data / "postmaster.pid").unlink(missing_ok=True)
        data_folder.clear_sockets(socket_dir)
        data_folder.write_settings(self._data, account, socket_dir, durable=self._durable)
        self._rotate_log()
        deadline = time.monotonic() + START_TIMEOUT_S
        # PGDATA and a relative log: pg_ctl passes both options through a shell without proper quoting.
        options = ("-w", "-s", "-t", f"{START_TIMEOUT_S:.0f}", "-l", self.log_path.name)
        command = [binaries.path("pg_ctl"), "start", *options]
        while account.run(command, cwd=self._cluster, PGDATA=str(self._data)).returncode != 0:
            words = self._last_words()
            if _STILL_LEAVING not in words or time.monotonic() > deadline:
                raise EmbeddedPostgresError(say("embedded.did_not_start", words=words))
            time.sleep(0.1)

    def _leave(self) -> None:
        """Give up our use, and shut the server down if it was the last one."""
        usage, self._usage, self._socket_dir = self._usage, None, None
        if usage is None:
            return
        alone = usage.try_exclusive()
        usage.release()
        server = running_postmaster(self._data)
        if alone and server is not None:
            self._shut_down(server)

    def _shut_down(self, server: Postmaster) -> None:
        # Fast: clients are cut off, everything is written. Immediate: a crash, repaired at the next start.
        for how, patience_s in ((signal.SIGINT, STOP_TIMEOUT_S), (signal.SIGQUIT, 10.0)):
            try:
                os.kill(server.pid, how)
            except ProcessLookupError:
                break
            if wait_until(lambda: running_postmaster(self._data) is None, patience_s):
                break
        else:
            raise EmbeddedPostgresError(
                say("embedded.did_not_stop", pid=server.pid, words=self._last_words())
            )
        if server.socket_dir.parent != self._cluster:
            shutil.rmtree(server.socket_dir, ignore_errors=True)

    def _rotate_log(self) -> None:
        if self.log_path.exists() and self.log_path.stat().st_size > LARGEST_LOG_BYTES:
            self.log_path.replace(self.log_path.with_suffix(".log.1"))

    def _last_words(self) -> str:
        try:
            words = data_folder.last_lines(self.log_path.read_text(errors="replace"))
        except OSError:
            words = "(nothing)"
        return say("embedded.log", file=self.log_path, words=words)


def _has_socket(server: Postmaster) -> bool:
    return (server.socket_dir / f".s.PGSQL.{data_folder.PORT}").exists()
