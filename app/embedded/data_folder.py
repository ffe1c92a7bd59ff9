"""The files of the embedded cluster: whose folder it is, how it is made, the settings of its server, and the private
folder of its socket.

Starts and stops nothing.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from pathlib import Path

from app.core.durable import rename_durably
from app.core.messages import say
from app.embedded.account import Account, account_for
from app.embedded.errors import EmbeddedPostgresError

PORT = 5432
"""Only part of the socket's name; nothing listens on a network."""

LONGEST_SOCKET_PATH_BYTES = 103
"""What every system takes: Linux allows 107 bytes, macOS 103."""

# Characters that mean nothing in postgresql.conf, in a connection URL or in libpq's list of hosts.
_PLAIN_PATH = re.compile(r"[A-Za-z0-9_./-]+")

SUPERUSER = "versant"
LOG_LINES_QUOTED = 8

INCLUDE = "versant.conf"
"""Written anew at each start, included by postgresql.conf."""

HBA = """\
# Only the Unix socket exists, in a folder that nobody else can enter.
local all all trust
"""

_ALWAYS = """\
# Written by Versant at each start. Your own settings go into postgresql.conf, below the include.
listen_addresses = ''
port = {port}
unix_socket_directories = '{socket_dir}'
unix_socket_permissions = 0700
max_connections = 100
shared_buffers = 128MB
maintenance_work_mem = 128MB
# One server without replicas: bulk loads into new tables need no log.
wal_level = minimal
max_wal_senders = 0
# Tile queries are short; compiling them takes longer than running them.
jit = off
log_checkpoints = off
log_timezone = 'UTC'
timezone = 'UTC'
"""

_FORGETFUL = """\
# For tests: a power cut may destroy the cluster.
fsync = off
synchronous_commit = off
full_page_writes = off
max_wal_size = 256MB
"""


def own_folder(cluster: Path) -> Account:
    """Make the folder, closed to others, and say whose it is; raises ``EmbeddedPostgresError``."""
    try:
        for place in (cluster, *cluster.parents):
            if place.exists() and not place.is_dir():
                raise EmbeddedPostgresError(say("embedded.no_folder", path=place))
        cluster.parent.mkdir(parents=True, exist_ok=True)
        cluster.mkdir(mode=0o700, exist_ok=True)
        account = account_for(cluster)
        account.own(cluster)
        cluster.chmod(0o700)
    except OSError as error:
        raise EmbeddedPostgresError(say("embedded.unusable", folder=cluster, error=error.strerror)) from error
    if not os.access(cluster, os.R_OK | os.W_OK | os.X_OK):
        raise EmbeddedPostgresError(say("embedded.others_folder", folder=cluster, user=cluster.stat().st_uid))
    return account


def has_cluster(data_dir: Path) -> bool:
    """Whether there is a cluster below a data folder; also one that this user may not look at. Makes nothing."""
    try:
        return (data_dir / "postgres" / "data" / "PG_VERSION").is_file()
    except PermissionError:
        return True


def existing_major(data: Path) -> int | None:
    """The version of PostgreSQL that made the cluster in ``data``; None where there is none yet."""
    try:
        return int((data / "PG_VERSION").read_text())
    except FileNotFoundError:
        if data.exists() and any(data.iterdir()):
            raise EmbeddedPostgresError(say("embedded.something_else", folder=data)) from None
        return None
    except (OSError, ValueError) as error:
        raise EmbeddedPostgresError(say("embedded.damaged", folder=data, error=error)) from error


def initialise(cluster: Path, account: Account, initdb: str, *, durable: bool) -> None:
    """Make a cluster in ``cluster/data`` by the program ``initdb``."""
    # Made beside its place and renamed when whole: a kill in between leaves nothing like a cluster.
    fresh = cluster / "data.new"
    shutil.rmtree(fresh, ignore_errors=True)
    options = ["--encoding=UTF8", "--no-locale", "--auth=trust", f"--username={SUPERUSER}"]
    if not durable:
        options.append("--no-sync")
    done = account.run([initdb, "-D", str(fresh), *options])
    if done.returncode != 0:
        raise EmbeddedPostgresError(say("embedded.no_cluster", folder=cluster, words=last_lines(done.stdout)))
    _write_as(account, fresh / "pg_hba.conf", HBA)
    with (fresh / "postgresql.conf").open("a") as conf:
        conf.write(f"\ninclude '{INCLUDE}'\n")
    rename_durably(fresh, cluster / "data")


def write_settings(data: Path, account: Account, socket_dir: Path, *, durable: bool) -> None:
    """Write ``versant.conf`` anew. ``socket_dir`` holds no character that would need quoting."""
    text = _ALWAYS.format(port=PORT, socket_dir=socket_dir)
    _write_as(account, data / INCLUDE, text if durable else text + _FORGETFUL)


def last_lines(text: str) -> str:
    """The end of what a program said, to be quoted in a message."""
    return "\n".join(["", *text.strip().splitlines()[-LOG_LINES_QUOTED:]])


def _write_as(account: Account, path: Path, text: str) -> None:
    """Replace a file in the account's own folder; never through a link that may have been put there."""
    path.unlink(missing_ok=True)
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "w") as file:
        file.write(text)
    account.own(path)


def prepare_socket_dir(cluster: Path, account: Account) -> Path:
    """Create the socket's folder, mode 0700, and return it.

    It is ``cluster/run``, or a private folder among the temporary files where that path is too long for a
    socket or has unusual characters.
    """
    for folder in (cluster / "run", *_temporary(cluster)):
        if _fits(folder):
            _make_private(folder, account)
            return folder
    raise EmbeddedPostgresError(say("embedded.long_path", path=cluster))


def clear_sockets(folder: Path) -> None:
    """Remove what a crashed server left: its lock file may name a pid that another program has by now."""
    for leftover in folder.glob(".s.PGSQL.*"):
        leftover.unlink(missing_ok=True)


def _temporary(cluster: Path) -> list[Path]:
    # The name follows from the cluster's, so that the next start reuses what a crash left behind.
    name = "versant-" + hashlib.sha256(os.fsencode(cluster)).hexdigest()[:16]
    return [Path(parent) / name for parent in dict.fromkeys((tempfile.gettempdir(), "/tmp"))]  # noqa: S108


def _fits(folder: Path) -> bool:
    name = str(folder / f".s.PGSQL.{PORT}")
    return len(os.fsencode(name)) <= LONGEST_SOCKET_PATH_BYTES and _PLAIN_PATH.fullmatch(name) is not None


def _make_private(folder: Path, account: Account) -> None:
    owner = os.geteuid() if account.uid is None else account.uid
    try:
        folder.mkdir(mode=0o700)
        created = True
    except FileExistsError:
        created = False
    try:
        # Without following links: in a world-writable parent anybody could have put something here first.
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError as error:
        raise EmbeddedPostgresError(_not_private(folder, owner)) from error
    try:
        if created:
            account.own(handle)
        if os.fstat(handle).st_uid != owner:
            raise EmbeddedPostgresError(_not_private(folder, owner))
        os.fchmod(handle, 0o700)
    finally:
        os.close(handle)


def _not_private(folder: Path, owner: int) -> str:
    return say("embedded.not_yours", folder=folder, user=owner)
