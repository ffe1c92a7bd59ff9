"""What a backup holds: a list of its files with their SHA-256, without which a folder is no backup.

Files are copied under another name and renamed when they are whole, and the list comes last: what is broken off is
never taken for a backup, and the one before stays valid until then. Knows no database.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from app.core.durable import make_folder, rename_durably
from app.core.messages import say
from app.upkeep.dumps import BackupError
from fusion.types import Progress

FORMAT = 1
NAME = "manifest.json"
LOGS, RASTERS = "blobs", "dem"

DUMPS = "database-*.dump"

_LOCK = ".versant-backup.lock"
_PART = ".part"
_CHUNK_BYTES = 1 << 20
_SHOWN = 5


@dataclass(frozen=True)
class Entry:
    """A file of a backup: its path below the backup's folder, its size and the SHA-256 of its bytes (hex)."""

    path: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """One complete backup."""

    made_at: str
    versions: Mapping[str, Any]
    """Of Versant, the schema, PostgreSQL and PostGIS."""
    identity: str
    """Of the database that was saved (``app.core.databases``)."""
    drives: int
    segments: int
    dump: Entry
    files: tuple[Entry, ...]
    missing: tuple[str, ...] = ()
    """Logs of drives that the store did not have."""
    damaged: tuple[str, ...] = ()
    """Logs that are not as they were uploaded."""
    format: int = field(default=FORMAT)

    @property
    def size_bytes(self) -> int:
        """Of all files."""
        return self.dump.size_bytes + sum(entry.size_bytes for entry in self.files)

    def below(self, folder: str) -> list[tuple[Entry, str]]:
        """The files below a folder of the backup, each with its path there."""
        return [(e, e.path.removeprefix(f"{folder}/")) for e in self.files if e.path.startswith(f"{folder}/")]


def read_manifest(folder: Path) -> Manifest | None:
    """The backup in a folder; None where there is none. ``BackupError`` for one that this program cannot read."""
    try:
        content = json.loads((folder / NAME).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise BackupError(say("backup.unreadable", file=folder / NAME, error=error)) from error
    try:
        if content["format"] > FORMAT:
            raise BackupError(say("backup.newer", folder=folder))
        dump, files = Entry(**content.pop("dump")), tuple(Entry(**entry) for entry in content.pop("files"))
        missing, damaged = tuple(content.pop("missing")), tuple(content.pop("damaged"))
        manifest = Manifest(dump=dump, files=files, missing=missing, damaged=damaged, **content)
    except (KeyError, TypeError) as error:
        raise BackupError(say("backup.no_list", file=folder / NAME, error=error)) from error
    outside = [
        e.path for e in (dump, *files) if PurePosixPath(e.path).is_absolute() or ".." in Path(e.path).parts
    ]
    if outside:
        raise BackupError(say("backup.outside", file=folder / NAME, name=outside[0]))
    return manifest


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Make the folder this backup, at once; files that only the backup before needed are deleted."""
    part = folder / f"{NAME}{_PART}"
    with part.open("w", encoding="utf-8") as file:
        json.dump(asdict(manifest), file, indent=1)
    rename_durably(part, folder / NAME)
    named = {entry.path for entry in (manifest.dump, *manifest.files)}
    stored = [path for kind in (LOGS, RASTERS) for path in (folder / kind).rglob("*") if path.is_file()]
    for path in [*stored, *folder.glob(f"{DUMPS}*")]:
        if path.relative_to(folder).as_posix() not in named:
            path.unlink()


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep other programs from writing a backup there, while the block runs; the folder is made, closed to others."""
    make_folder(folder, 0o700)
    if any(folder.iterdir()) and not (folder / _LOCK).exists():
        raise BackupError(say("backup.no_backup", folder=folder))
    with (folder / _LOCK).open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BackupError(say("backup.busy", folder=folder)) from None
        yield


def keep(folder: Path, path: str, opened: Callable[[], BinaryIO]) -> Entry:
    """Copy a file into the backup; it is there whole or not at all. ``FileNotFoundError`` where there is none."""
    target = folder / path
    make_folder(target.parent)
    part = target.with_name(target.name + _PART)
    digest, size = hashlib.sha256(), 0
    with opened() as source, part.open("wb") as copy:
        while chunk := source.read(_CHUNK_BYTES):
            digest.update(chunk)
            size += copy.write(chunk)
    rename_durably(part, target)
    return Entry(path, size, digest.hexdigest())


def entry_of(folder: Path, path: str) -> Entry:
    """What a file of the backup's folder is now."""
    file = folder / path
    with file.open("rb") as opened:
        return Entry(path, file.stat().st_size, hashlib.file_digest(opened, "sha256").hexdigest())


def is_there(folder: Path, entry: Entry) -> bool:
    """Whether a file of an earlier backup is still there, by its size: files of a backup are never written again."""
    file = folder / entry.path
    return file.is_file() and file.stat().st_size == entry.size_bytes


def verify(folder: Path, manifest: Manifest, progress: Progress) -> None:
    """Read every file of a backup; ``BackupError`` that names those that are missing or not as they were."""
    entries, done, bad = (manifest.dump, *manifest.files), 0, []
    for entry in entries:
        progress("checking", done / max(manifest.size_bytes, 1))
        if not (folder / entry.path).is_file():
            bad.append(say("backup.file_missing", file=entry.path))
        elif entry_of(folder, entry.path) != entry:
            bad.append(say("backup.file_damaged", file=entry.path))
        done += entry.size_bytes
    if bad:
        raise BackupError(say("backup.not_whole", folder=folder, names=some(bad)))


def some(names: Iterable[str]) -> str:
    """The first names of many, and how many more there are."""
    listed = list(names)
    more = say("cli.and_more", n=len(listed) - _SHOWN) if len(listed) > _SHOWN else ""
    return ", ".join(listed[:_SHOWN]) + more
