"""Who computes in the background lets those go first who wait for an answer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import text

from app.core import background
from app.core.background import NICENESS, lower_server_priority
from app.core.db import make_engine

LOWERS_PRIORITY = """
import os
from pathlib import Path
from app.core.background import lower_priority
lower_priority()
lower_priority()
group = Path("/proc/self/autogroup")
print(os.nice(0), group.read_text().split()[-1] if group.exists() else "none")
"""


def niceness_of_backend(url: str, *, in_background: bool) -> int:
    engine = make_engine(url, pool_size=1, background=in_background)
    try:
        with engine.connect() as connection:
            pid = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
            return os.getpriority(os.PRIO_PROCESS, pid)
    finally:
        engine.dispose()


def test_a_process_lowers_its_priority_with_its_session(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", LOWERS_PRIORITY],
        capture_output=True, text=True, check=True, env=environment, start_new_session=True,
    )  # fmt: skip
    own, session = done.stdout.split()
    assert int(own) == max(NICENESS, os.nice(0))  # however often it is asked to
    assert session in {str(NICENESS), "none"}


@pytest.mark.db
def test_the_servers_process_of_a_connection_has_background_priority(
    database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = niceness_of_backend(database_url, in_background=False)
    monkeypatch.setattr(background, "NICENESS", usual + 3)
    assert niceness_of_backend(database_url, in_background=True) == usual + 3
    assert niceness_of_backend(database_url, in_background=False) == usual


class Elsewhere:
    """A connection to a server of another machine, on which a process has the number of this one."""

    class info:  # noqa: N801 - as psycopg has it
        backend_pid = os.getpid()

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def fileno(self) -> int:
        return self._descriptor


def test_a_process_that_serves_no_connection_of_ours_is_left_alone() -> None:
    import socket  # noqa: PLC0415

    before = os.getpriority(os.PRIO_PROCESS, os.getpid())
    with socket.socket(socket.AF_INET) as tcp:
        lower_server_priority(Elsewhere(tcp.fileno()))
    ours, theirs = socket.socketpair(socket.AF_UNIX)  # a server that is no parent of that process
    with ours, theirs:
        lower_server_priority(Elsewhere(ours.fileno()))
    assert os.getpriority(os.PRIO_PROCESS, os.getpid()) == before
