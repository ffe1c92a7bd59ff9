"""Finds the programs of a PostgreSQL server that has PostGIS."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from app.core.messages import say
from app.embedded.errors import PostgresMissingError

OLDEST_MAJOR = 13
"""The queue (procrastinate) needs PostgreSQL 13 or newer."""

PLACES = (
    "/usr/lib/postgresql/*/bin",  # Debian, Ubuntu
    "/usr/pgsql-*/bin",  # Fedora, Red Hat
    "/usr/lib/postgresql*/bin",  # openSUSE, Alpine
    "/opt/homebrew/opt/postgresql@*/bin",
    "/usr/local/opt/postgresql@*/bin",
    "/home/linuxbrew/.linuxbrew/opt/postgresql@*/bin",
    "/Applications/Postgres.app/Contents/Versions/*/bin",
    "/usr/local/pgsql/bin",
)

ADVICE = say("embedded.install")


@dataclass(frozen=True)
class Binaries:
    """A folder that holds ``initdb``, ``pg_ctl`` and ``postgres`` of one version."""

    folder: Path
    major: int
    postgis: bool

    def path(self, program: str) -> str:
        """The program's absolute path."""
        return str(self.folder / program)


def find_binaries(major: int | None = None, *, places: Iterable[Path] | None = None) -> Binaries:
    """The newest PostgreSQL with PostGIS, or the one of version ``major`` that an existing cluster needs.

    ``places`` are the folders to look in, by default ``PATH`` and where the usual packages put them. Raises
    ``PostgresMissingError`` that says what was found and what to install.
    """
    candidates = [b for folder in _distinct(places or _usual_places()) if (b := _inspect(folder)) is not None]
    fit = [b for b in candidates if b.postgis and b.major >= OLDEST_MAJOR and major in (None, b.major)]
    if fit:
        return max(fit, key=lambda b: b.major)
    raise PostgresMissingError(_explain(candidates, major))


def find_client(program: str, least_major: int, *, places: Iterable[Path] | None = None) -> tuple[str, int]:
    """A client program, such as ``pg_dump``, of this version or the next newer one that is here: path and version.

    ``places`` as for ``find_binaries``. Raises ``PostgresMissingError`` that says what to install.
    """
    clients: dict[int, str] = {}
    which = shutil.which(program)
    for folder in _distinct(places or [*_usual_places(), *([Path(which).parent] if which else [])]):
        version = re.search(r"\(PostgreSQL\) (\d+)", output(str(folder / program), "--version"))
        if version is not None:
            clients.setdefault(int(version[1]), str(folder / program))
    fit = [major for major in clients if major >= least_major]
    if fit:
        return clients[min(fit)], min(fit)
    there = ", ".join(f"that of PostgreSQL {major}" for major in sorted(clients)) or "none"
    raise PostgresMissingError(say("embedded.program", program=program, version=least_major, there=there))


def _explain(candidates: list[Binaries], major: int | None) -> str:
    there = "; ".join(
        f"PostgreSQL {b.major} in {b.folder}{'' if b.postgis else ', without PostGIS'}" for b in candidates
    )
    if major is not None:
        return say("embedded.other_major", version=major, there=there or "nothing")
    if not candidates:
        return say("embedded.none", advice=ADVICE)
    return say("embedded.too_old", version=OLDEST_MAJOR, there=there, advice=ADVICE)


def _usual_places() -> Iterator[Path]:
    for program in ("initdb", "pg_ctl", "postgres"):
        if (path := shutil.which(program)) is not None:
            yield Path(path).resolve().parent
    if (pg_config := shutil.which("pg_config")) is not None and (bindir := output(pg_config, "--bindir")):
        yield Path(bindir)
    for pattern in PLACES:
        yield from Path("/").glob(pattern.lstrip("/"))


def _distinct(folders: Iterable[Path]) -> Iterator[Path]:
    seen: set[Path] = set()
    for folder in folders:
        if (resolved := folder.resolve()) not in seen:
            seen.add(resolved)
            yield resolved


def _inspect(folder: Path) -> Binaries | None:
    if not all((folder / program).is_file() for program in ("initdb", "pg_ctl", "postgres")):
        return None
    version = re.search(r"\(PostgreSQL\) (\d+)", output(str(folder / "postgres"), "--version"))
    if version is None:
        return None
    major = int(version[1])
    postgis = any((share / "extension" / "postgis.control").is_file() for share in _share_dirs(folder, major))
    return Binaries(folder, major, postgis)


def _share_dirs(folder: Path, major: int) -> Iterator[Path]:
    if (folder / "pg_config").is_file() and (sharedir := output(str(folder / "pg_config"), "--sharedir")):
        yield Path(sharedir)
    # Debian ships pg_config apart from the server, so the usual places follow.
    yield Path(f"/usr/share/postgresql/{major}")
    root = folder.parent
    for share in ("share", "share/postgresql", f"share/postgresql@{major}"):
        yield root / share


def output(*command: str) -> str:
    """What a program prints; empty where it fails, hangs or is not there."""
    try:
        # stdin is closed and the working directory fixed: nothing of the caller's surroundings matters.
        done = subprocess.run(  # noqa: S603 - the command is ours
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=20,
            stdin=subprocess.DEVNULL,
            cwd="/",
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
