"""The database as one file and back, by PostgreSQL's own programs."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from psycopg.conninfo import conninfo_to_dict, make_conninfo

from app.core.messages import say
from app.core.settings.places import libpq_url
from app.embedded.binaries import find_client
from fusion.errors import FusionError

LEFT_OUT = ("drive_trials", "exports", "operations", "sessions", "login_links")
"""Tables whose rows are of no use elsewhere: whoever needs what they are about asks for it again, with its files, or
logs in again."""
_LINES_QUOTED = 5


class BackupError(FusionError):
    """A backup cannot be made or brought back; the message says why and what to do."""

    kind = "backup"


def dump(url: str, snapshot: str, target: Path, major: int) -> None:
    """Write what the snapshot sees into ``target``, in PostgreSQL's custom format (compressed), but for ``LEFT_OUT``.

    ``major`` is the server's version. Raises ``PostgresMissingError`` or ``BackupError``.
    """
    program, _ = find_client("pg_dump", major)
    place, secret = _connection(url)
    options = [
        "--format=custom",
        "--no-owner",
        "--no-privileges",
        "--no-unlogged-table-data",  # what can be made again: vector tiles
        *(f"--exclude-table-data={table}" for table in LEFT_OUT),
        f"--snapshot={snapshot}",
        f"--file={target}",
    ]
    _run([program, *options, f"--dbname={place}"], secret, say("backup.not_saved"))


def restore(url: str, source: Path, major: int) -> None:
    """Bring a dump back into an empty database that has PostGIS: all of it, or nothing.

    ``major`` is the version of the newer one of both servers. Raises ``PostgresMissingError`` or ``BackupError``.
    """
    program, _ = find_client("pg_restore", major)
    place, secret = _connection(url)
    with tempfile.NamedTemporaryFile("w", prefix="versant-restore-", suffix=".list") as chosen:
        chosen.write(_without_extensions(_run([program, "--list", str(source)], {}, say("backup.dump"))))
        chosen.flush()
        options = ["--exit-on-error", "--single-transaction", "--no-owner", "--no-privileges"]
        listed = f"--use-list={chosen.name}"
        failed = say("backup.not_restored")
        _run([program, *options, listed, f"--dbname={place}", str(source)], secret, failed)


def _without_extensions(listing: str) -> str:
    """The entries of a dump but its extensions, which are there and belong to whoever installed them."""
    return "".join(f"{line}\n" for line in listing.splitlines() if " EXTENSION " not in line)


def _connection(url: str) -> tuple[str, Mapping[str, str]]:
    """What is said on the command line, where everybody sees it, and the password, which goes another way."""
    parts = {
        name: str(value) for name, value in conninfo_to_dict(libpq_url(url)).items() if value is not None
    }
    password = parts.pop("password", None)
    return make_conninfo("", **parts), {} if password is None else {"PGPASSWORD": password}


def _run(command: Sequence[str], secret: Mapping[str, str], failed: str) -> str:
    done = subprocess.run(  # noqa: S603 - programs of PostgreSQL with our own arguments
        command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **secret, "LC_ALL": "C"},
    )
    if done.returncode != 0:
        words = " ".join(done.stderr.strip().splitlines()[-_LINES_QUOTED:])
        raise BackupError(say("backup.failed", what=failed, reason=words or say("backup.no_reason")))
    return done.stdout
