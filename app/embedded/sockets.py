"""The private folder of the server's Unix socket."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from pathlib import Path

from app.embedded.account import Account
from app.embedded.errors import EmbeddedPostgresError

PORT = 5432
"""Only part of the socket's name; nothing listens on a network."""

LONGEST_SOCKET_PATH_BYTES = 103
"""What every system takes: Linux allows 107 bytes, macOS 103."""

# Characters that mean nothing in postgresql.conf, in a connection URL or in libpq's list of hosts.
_PLAIN_PATH = re.compile(r"[A-Za-z0-9_./-]+")


def prepare_socket_dir(cluster: Path, account: Account) -> Path:
    """Create the socket's folder, mode 0700, and return it.

    It is ``cluster/run``, or a private folder among the temporary files where that path is too long for a
    socket or has unusual characters.
    """
    for folder in (cluster / "run", *_temporary(cluster)):
        if _fits(folder):
            _make_private(folder, account)
            return folder
    raise EmbeddedPostgresError(
        f"The path {cluster} is too long for a Unix socket, and so is that of the folder for temporary "
        "files. Choose a shorter data folder, or set TMPDIR to a short path."
    )


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
        if created and account.uid is not None and account.gid is not None:
            os.fchown(handle, account.uid, account.gid)
        if os.fstat(handle).st_uid != owner:
            raise EmbeddedPostgresError(_not_private(folder, owner))
        os.fchmod(handle, 0o700)
    finally:
        os.close(handle)


def _not_private(folder: Path, owner: int) -> str:
    return (
        f"{folder} must be a folder of user {owner} alone, but is somebody else's. Remove it and start again."
    )
