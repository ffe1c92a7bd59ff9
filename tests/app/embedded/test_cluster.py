"""The embedded cluster: its whole life, crashes, company, awkward folders."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest

from app.core.settings.places import libpq_url
from app.embedded.account import account_for
from app.embedded.cluster import EmbeddedPostgres
from app.embedded.data_folder import LONGEST_SOCKET_PATH_BYTES
from app.embedded.errors import EmbeddedPostgresError
from app.embedded.postmaster import running_postmaster

pytestmark = pytest.mark.db

AWKWARD_NAMES = ["with space, $HOME, `quote's\", a:b and ü", "very-long-" + "x" * 200]


def ask(server: EmbeddedPostgres, query: str) -> str:
    with psycopg.connect(libpq_url(server.url), autocommit=True) as connection:
        row = connection.execute(query.encode()).fetchone()
    assert row is not None
    return str(row[0])


def command(server: EmbeddedPostgres, statement: str) -> None:
    with psycopg.connect(libpq_url(server.url), autocommit=True) as connection:
        connection.execute(statement.encode())


def pid_of(folder: Path) -> int:
    running = running_postmaster(folder / "postgres" / "data")
    assert running is not None
    return running.pid


def wait_gone(pid: int) -> None:
    deadline = time.monotonic() + 20
    while Path(f"/proc/{pid}/cwd").exists() and time.monotonic() < deadline:
        time.sleep(0.02)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a cluster in it that does not run. pytest's folders are 0700: as root, the hard case."""
    folder = tmp_path_factory.mktemp("cluster")
    with EmbeddedPostgres(folder, durable=False):
        pass
    yield folder
    assert running_postmaster(folder / "postgres" / "data") is None, "a test left its server running"


def test_start_and_stop(made: Path) -> None:
    server = EmbeddedPostgres(made, durable=False)
    assert not server.is_running()
    with server:
        assert server.is_running()
        assert ask(server, "SELECT postgis_version()").startswith("3.")
        assert ask(server, "SHOW server_encoding") == "UTF8"
    assert not server.is_running()


def test_nothing_listens_on_a_network(made: Path) -> None:
    with EmbeddedPostgres(made, durable=False) as server:
        assert ask(server, "SHOW listen_addresses") == ""
        sockets = Path(ask(server, "SHOW unix_socket_directories"))
        inodes = {
            os.readlink(link)  # noqa: PTH115 - "socket:[1234]" is no path
            for link in Path(f"/proc/{pid_of(made)}/fd").iterdir()
            if os.readlink(link).startswith("socket:")  # noqa: PTH115
        }
    assert stat.S_IMODE(sockets.stat().st_mode) == 0o700
    tcp = "".join(
        Path(f"/proc/net/{name}").read_text()
        for name in ("tcp", "tcp6")
        if Path(f"/proc/net/{name}").exists()
    )
    listening = {f"socket:[{line.split()[9]}]" for line in tcp.splitlines() if line.split()[3] == "0A"}
    assert inodes, "the Unix socket itself is among the open files"
    assert not inodes & listening


def test_the_server_is_not_root(made: Path) -> None:
    with EmbeddedPostgres(made, durable=False):
        assert Path(f"/proc/{pid_of(made)}").stat().st_uid != 0


def test_data_outlives_a_restart(made: Path) -> None:
    with EmbeddedPostgres(made, durable=False) as server:
        command(server, "CREATE TABLE kept AS SELECT 42 AS answer")
    with EmbeddedPostgres(made, durable=False) as server:
        assert ask(server, "SELECT answer FROM kept") == "42"
        command(server, "DROP TABLE kept")


def test_a_killed_server_is_started_again(made: Path) -> None:
    with EmbeddedPostgres(made) as server:  # durable, as `versant up` has it
        command(server, "CREATE TABLE committed AS SELECT 7 AS answer")
        pid = pid_of(made)
        os.kill(pid, signal.SIGKILL)
        wait_gone(pid)
        assert not server.is_running()
    with EmbeddedPostgres(made, durable=False) as server:
        assert ask(server, "SELECT answer FROM committed") == "7"
        command(server, "DROP TABLE committed")


def test_a_killed_server_is_revived_for_those_who_use_it(made: Path) -> None:
    with EmbeddedPostgres(made) as server, EmbeddedPostgres(made) as companion:
        assert not server.lost
        assert not server.revive(), "nothing to do while it runs"
        command(server, "CREATE TABLE committed AS SELECT 7 AS answer")
        url, pid = server.url, pid_of(made)
        os.kill(pid, signal.SIGKILL)
        wait_gone(pid)
        assert server.lost
        assert server.revive()
        assert server.url == url
        assert pid_of(made) != pid
        assert ask(server, "SELECT answer FROM committed") == "7"
        assert not companion.revive(), "the other program was quicker"
        command(server, "DROP TABLE committed")
        companion.stop()
        assert server.is_running(), "its use of the folder went on"
    assert not server.is_running()
    assert not server.lost, "who stopped it does not miss it"


def test_a_server_without_its_socket_is_lost(made: Path) -> None:
    with EmbeddedPostgres(made, durable=False) as server:
        (made / "postgres" / "run" / ".s.PGSQL.5432").unlink()
        assert server.revive()
        assert ask(server, "SELECT 1") == "1"


def test_a_deleted_cluster_is_not_replaced_by_an_empty_one(tmp_path: Path) -> None:
    with EmbeddedPostgres(tmp_path, durable=False) as server:
        pid = pid_of(tmp_path)
        os.kill(pid, signal.SIGKILL)
        wait_gone(pid)
        (tmp_path / "postgres" / "data").rename(tmp_path / "elsewhere")
        with pytest.raises(EmbeddedPostgresError, match="is gone"):
            server.revive()
        assert not (tmp_path / "postgres" / "data").exists()


@pytest.mark.parametrize("content", ["", "no number\n", "999999999999999999999\n", "-1\n", "0\n"])
def test_a_lock_file_of_rubbish_is_no_obstacle(content: str, made: Path) -> None:
    lock = made / "postgres" / "data" / "postmaster.pid"
    lock.write_text(content)
    assert running_postmaster(lock.parent) is None
    with EmbeddedPostgres(made, durable=False) as server:
        assert server.is_running()


def test_a_lock_file_with_the_pid_of_another_program_is_no_obstacle(made: Path) -> None:
    account = account_for(made / "postgres")
    # The same user as the server's: the case that PostgreSQL itself refuses to start in.
    other = subprocess.Popen(["sleep", "60"], user=account.uid, group=account.gid, cwd="/")
    try:
        lock = made / "postgres" / "data" / "postmaster.pid"
        lock.write_text(
            f"{other.pid}\n{lock.parent}\n1700000000\n5432\n{made}/postgres/run\n\n 1 1\nready   \n"
        )
        (made / "postgres" / "run" / ".s.PGSQL.5432.lock").write_text(f"{other.pid}\n")
        assert not EmbeddedPostgres(made).is_running()
        with EmbeddedPostgres(made, durable=False) as server:
            assert ask(server, "SELECT 1") == "1"
        assert other.poll() is None, "the other program must be left alone"
    finally:
        other.kill()
        other.wait()


def test_a_postmaster_that_is_another_clusters_is_not_ours(made: Path, tmp_path: Path) -> None:
    with EmbeddedPostgres(made, durable=False):
        foreign = tmp_path / "data"
        foreign.mkdir()
        (foreign / "postmaster.pid").write_text((made / "postgres" / "data" / "postmaster.pid").read_text())
        assert running_postmaster(foreign) is None


def test_the_last_to_leave_stops_the_server(made: Path) -> None:
    first, second = EmbeddedPostgres(made, durable=False), EmbeddedPostgres(made, durable=False)
    first.start()
    pid = pid_of(made)
    second.start()
    assert pid_of(made) == pid
    first.stop()
    assert ask(second, "SELECT 1") == "1"
    second.stop()
    assert not second.is_running()


USER = """
import sys, time
from pathlib import Path
from app.embedded.cluster import EmbeddedPostgres
with EmbeddedPostgres(Path(sys.argv[1]), durable=False) as server:
    print(server.url, flush=True)
    sys.stdin.read()
"""


def user_process(folder: Path) -> subprocess.Popen[str]:
    """Another program that uses the cluster until its standard input ends."""
    return subprocess.Popen(
        [sys.executable, "-c", USER, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[3],
    )


def url_from(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_two_programs_that_start_at_once_share_one_server(made: Path) -> None:
    with user_process(made) as one, user_process(made) as two:
        urls = {url_from(one), url_from(two)}
        assert len(urls) == 1
        assert "" not in urls
        one.communicate()
        with psycopg.connect(libpq_url(urls.pop())) as connection:
            assert connection.execute("SELECT 1").fetchone() == (1,)
        two.communicate()
    assert (one.returncode, two.returncode) == (0, 0)
    assert not EmbeddedPostgres(made).is_running()


def test_the_server_of_a_killed_program_is_adopted_and_stopped(made: Path) -> None:
    with user_process(made) as program:
        assert url_from(program)
        program.kill()
    orphan = pid_of(made)
    with EmbeddedPostgres(made, durable=False) as server:
        assert pid_of(made) == orphan
        assert ask(server, "SELECT 1") == "1"
    assert not server.is_running()
    wait_gone(orphan)


def test_ctrl_c_does_not_reach_the_server(made: Path) -> None:
    with EmbeddedPostgres(made, durable=False):
        pid = pid_of(made)
        assert os.getsid(pid) != os.getsid(0)
        assert os.getpgid(pid) != os.getpgid(0)


def test_a_socket_that_was_cleaned_away_is_made_again(made: Path) -> None:
    with user_process(made) as program:
        assert url_from(program)
        program.kill()
    (made / "postgres" / "run" / ".s.PGSQL.5432").unlink()
    with EmbeddedPostgres(made, durable=False) as server:
        assert ask(server, "SELECT 1") == "1"


def test_variables_that_mean_another_server_are_ignored(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"PGPORT": "6543", "PGHOST": "nowhere", "PGDATA": "/nowhere", "PGUSER": "x"}.items():
        monkeypatch.setenv(name, value)
    with EmbeddedPostgres(made, durable=False) as server:
        assert ask(server, "SELECT current_user") == "versant"


@pytest.mark.parametrize("name", AWKWARD_NAMES)
def test_folders_with_awkward_names(name: str, tmp_path: Path) -> None:
    folder = tmp_path / name
    with EmbeddedPostgres(folder, durable=False) as server:
        assert Path(ask(server, "SHOW data_directory")) == folder / "postgres" / "data"
        sockets = Path(ask(server, "SHOW unix_socket_directories"))
        assert len(os.fsencode(sockets / ".s.PGSQL.5432")) <= LONGEST_SOCKET_PATH_BYTES
        assert stat.S_IMODE(sockets.stat().st_mode) == 0o700
    assert not sockets.exists(), "a folder among the temporary files is cleaned up"


def test_a_failed_start_quotes_the_log(made: Path) -> None:
    settings = made / "postgres" / "data" / "postgresql.conf"
    before = settings.read_text()
    settings.write_text(before + "\nwork_mem = 'plenty'\n")
    try:
        with pytest.raises(EmbeddedPostgresError, match='"work_mem": "plenty"'):
            EmbeddedPostgres(made, durable=False).start()
    finally:
        settings.write_text(before)
    with EmbeddedPostgres(made, durable=False) as server:  # and no lock is left behind
        assert server.is_running()


def test_url_before_the_start() -> None:
    with pytest.raises(EmbeddedPostgresError, match="has not been started"):
        _ = EmbeddedPostgres(Path("nowhere")).url
