"""Servers beside the embedded one: a hot standby that follows it, and PgBouncer before it. Each can be killed and comes
back at the same address. Linux."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path

import psycopg
from psycopg.conninfo import conninfo_to_dict
from sqlalchemy import make_url

from app.core.settings.places import libpq_url
from app.embedded import data_folder
from app.embedded.account import account_for, with_access
from app.embedded.binaries import find_binaries
from app.embedded.cluster import EmbeddedPostgres
from app.embedded.postmaster import running_postmaster

START_S = 20.0
PROGRAMS = ("/usr/sbin/pgbouncer", "pgbouncer")
CLIENTS_MOST = 300

_PRIMARY = """
wal_level = replica
max_wal_senders = 10
wal_keep_size = 1GB
synchronous_commit = on
hot_standby_feedback = on
"""
_MAY_FOLLOW = "local replication all trust\n"
_POOLER = """
[databases]
* = host={host} port={port}
[pgbouncer]
listen_addr = 127.0.0.1
listen_port = {listens}
unix_socket_dir =
auth_type = trust
auth_file = {folder}/users
pool_mode = transaction
default_pool_size = {size}
max_client_conn = {most}
server_login_retry = 1
admin_users = {user}
pidfile = {folder}/pid
logfile = {folder}/log
"""


def make_primary(data_dir: Path, *, durable: bool = True) -> None:
    """Make a cluster in ``data_dir``, as the embedded one, that standbys may follow once it is started."""
    cluster = data_dir / "postgres"
    account = with_access(data_folder.own_folder(cluster), [cluster])
    data_folder.initialise(cluster, account, find_binaries().path("initdb"), durable=durable)
    for name, more in (("postgresql.conf", _PRIMARY), ("pg_hba.conf", _MAY_FOLLOW)):
        with (cluster / "data" / name).open("a") as file:
            file.write(more)


def make_standby(primary: EmbeddedPostgres, data_dir: Path, *, durable: bool = True) -> EmbeddedPostgres:
    """A copy of the running primary in ``data_dir`` that follows it once it is started."""
    there = conninfo_to_dict(libpq_url(primary.url))
    cluster, host = data_dir / "postgres", Path(str(there["host"]))
    account = with_access(data_folder.own_folder(cluster), [cluster, host])
    program = find_binaries().path("pg_basebackup")
    place = ["-h", str(host), "-p", str(there["port"]), "-U", str(there["user"]), "-D", str(cluster / "data")]
    done = account.run([program, *place, "-R", "-X", "stream", "-c", "fast", *(() if durable else ["-N"])])
    if done.returncode:
        raise RuntimeError(f"no standby could be made: {done.stdout}")
    return EmbeddedPostgres(data_dir, durable=durable)


def kill_server(data_dir: Path) -> bool:
    """SIGKILL to the postmaster of the cluster there; whether there was one."""
    server = running_postmaster(data_dir / "postgres" / "data")
    if server is None:
        return False
    with suppress(ProcessLookupError):
        os.kill(server.pid, signal.SIGKILL)
        return True
    return False


def await_replayed(primary_url: str, standby_url: str, within_s: float = START_S) -> None:
    """Wait until the standby shows all that the primary has written by now."""
    with psycopg.connect(libpq_url(primary_url), autocommit=True) as primary:
        ((written,),) = primary.execute("SELECT CAST(pg_current_wal_lsn() AS text)").fetchall()
    ends = time.monotonic() + within_s
    with psycopg.connect(libpq_url(standby_url), autocommit=True) as standby:
        reached = "SELECT pg_last_wal_replay_lsn() >= CAST(%s AS pg_lsn)"
        while not standby.execute(reached, (written,)).fetchall()[0][0]:
            if time.monotonic() > ends:
                raise TimeoutError("the standby does not follow")
            time.sleep(0.01)


def find_pgbouncer() -> str | None:
    """The program; None: it is not installed."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class PgBouncer:
    """A pooler in transaction mode before the server of a URL, on a port that it keeps."""

    def __init__(self, program: str, url: str, size: int, folder: Path) -> None:
        """``size``: connections to the server for each database; ``folder``: an empty one, for its files."""
        self._program, self._folder = program, folder
        parts = conninfo_to_dict(libpq_url(url))
        with socket.create_server(("127.0.0.1", 0)) as free:
            listens = free.getsockname()[1]
        self.url = make_url(url).set(host="127.0.0.1", port=listens, query={}).render_as_string(False)
        """The same database through it."""
        host, user = str(parts["host"]), str(parts["user"])
        self._account = with_access(account_for(Path(host)), [Path(host)])
        if self._account.uid is not None:
            os.chown(folder, self._account.uid, -1)
        (folder / "users").write_text(f'"{user}" ""\n')
        values = {"host": host, "port": parts["port"], "user": user, "size": size, "most": CLIENTS_MOST}
        (folder / "settings").write_text(_POOLER.format(**values, listens=listens, folder=folder))

    def launch(self) -> bool:
        """Start it; whether it began."""
        with suppress(OSError):
            (self._folder / "pid").unlink()  # of one that was killed
        command = [self._program, "--quiet", "--daemon", str(self._folder / "settings")]
        return self._account.run(command).returncode == 0

    def start(self) -> None:
        """Start it, and wait until it answers."""
        if not self.launch():
            raise RuntimeError(f"PgBouncer did not start; {self._folder / 'log'} may say why")
        ends = time.monotonic() + START_S
        while True:
            with suppress(psycopg.OperationalError):
                psycopg.connect(self._admin, autocommit=True).close()
                return
            if time.monotonic() > ends:
                raise TimeoutError("PgBouncer does not answer")
            time.sleep(0.05)

    @property
    def runs(self) -> bool:
        """Whether its process is there."""
        try:
            return Path(f"/proc/{int((self._folder / 'pid').read_text())}").exists()
        except (OSError, ValueError):
            return False

    def kill(self) -> bool:
        """SIGKILL; whether there was something to kill."""
        with suppress(OSError, ValueError):
            os.kill(int((self._folder / "pid").read_text()), signal.SIGKILL)
            return True
        return False

    @property
    def _admin(self) -> str:
        return libpq_url(make_url(self.url).set(database="pgbouncer").render_as_string(False))

    def connections(self) -> tuple[int, int]:
        """How many clients it has just now, and how many connections to the server."""
        name = make_url(self.url).database
        with psycopg.connect(self._admin, autocommit=True) as admin:
            counts = [
                sum(1 for row in admin.execute(show).fetchall() if name in row)
                for show in (b"SHOW CLIENTS", b"SHOW SERVERS")
            ]
        return counts[0], counts[1]
