"""PgBouncer in transaction mode before the tests' server: each transaction may come to another connection."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

import psycopg
import pytest
from psycopg.conninfo import conninfo_to_dict
from sqlalchemy import make_url

from app.core.settings.places import libpq_url
from app.embedded.account import account_for, with_access

START_S = 10.0
PROGRAMS = ("/usr/sbin/pgbouncer", "pgbouncer")
_SETTINGS = """
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
max_client_conn = 300
admin_users = {user}
pidfile = {folder}/pid
logfile = {folder}/log
"""

Pooler = Callable[[str, int], AbstractContextManager[str]]


@pytest.fixture(scope="session")
def pooler() -> Pooler:
    """``pooler(url, size)``: the same database through PgBouncer with so many connections to the server."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip("PgBouncer is missing (Debian: apt-get install pgbouncer)")

    @contextmanager
    def pooled(url: str, size: int) -> Iterator[str]:
        parts = conninfo_to_dict(libpq_url(url))
        host, user = str(parts["host"]), str(parts["user"])
        with tempfile.TemporaryDirectory() as name, socket.create_server(("127.0.0.1", 0)) as free:
            folder, listens = Path(name), free.getsockname()[1]
            free.close()
            account = with_access(account_for(Path(host)), [Path(host)])
            if account.uid is not None:
                os.chown(folder, account.uid, -1)
            (folder / "users").write_text(f'"{user}" ""\n')
            settings = _SETTINGS.format(
                host=host, port=parts["port"], listens=listens, folder=folder, size=size, user=user
            )
            (folder / "settings").write_text(settings)
            started = account.run([program, "--quiet", "--daemon", str(folder / "settings")])
            assert started.returncode == 0, started.stdout
            there = make_url(url).set(host="127.0.0.1", port=listens, query={})
            try:
                yield _reached(there.render_as_string(hide_password=False))
            finally:
                with suppress(OSError):
                    os.kill(int((folder / "pid").read_text()), signal.SIGKILL)

    return pooled


def _reached(url: str) -> str:
    deadline = time.monotonic() + START_S
    while True:
        try:
            psycopg.connect(libpq_url(url)).close()
            return url
        except psycopg.OperationalError:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def servers_of(url: str) -> int:
    """How many connections to the server the pooler has for the database of ``url`` just now."""
    name = make_url(url).database
    with psycopg.connect(libpq_url(str(make_url(url).set(database="pgbouncer"))), autocommit=True) as admin:
        rows = admin.execute("SHOW SERVERS").fetchall()
    return sum(1 for row in rows if name in row)
