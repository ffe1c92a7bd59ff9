"""A backup of a service that goes on: the database as it is at one moment, then the files that this one refers to.

Blobs never change, and what the dump names stays in the store long enough: only the blob of a drive that is deleted
meanwhile goes at once. So the files need no moment of their own, and those of the backup before are kept. Exports and
their files are left out.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import BinaryIO

from app.core import migrate, mirror
from app.core.blobs import BlobStore
from app.core.databases import database_identity
from app.core.db import Sessions, snapshot
from app.core.filesystems import file_system, free_bytes
from app.core.messages import say
from app.core.settings import Settings
from app.core.version import code_version
from app.terrain.store import DemSource, local_raster
from app.upkeep import store
from app.upkeep.dumps import BackupError, dump
from app.upkeep.manifest import (
    LOGS,
    RASTERS,
    Entry,
    Manifest,
    alone_in,
    entry_of,
    is_there,
    keep,
    read_manifest,
    write_manifest,
)
from fusion.types import Progress, no_progress

_MIB = 2**20

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Wanted:
    """A file that is to be in the backup; SHA-256 (hex) and size, bytes, where they are known before it is read."""

    path: str
    opened: Callable[[], BinaryIO]
    size_bytes: int
    sha256: str | None = None


def back_up(
    settings: Settings, sessions: Sessions, folder: Path, progress: Progress = no_progress
) -> Manifest:
    """Make or renew the backup in a folder; ``BackupError`` where that is not possible.

    Broken off, it leaves the backup that was there, and is gone on with by the next. Logs that the store does not have
    are told in the result and no error: a drive gets its log back by the next upload of it.
    """
    assert settings.session_url is not None  # noqa: S101 - the commands see to it
    with alone_in(folder):
        former = read_manifest(folder)
        with snapshot(sessions) as session:
            identity, versions = database_identity(session), store.versions(session)
            state = migrate.standing(session)
            if state.revision is None:
                raise BackupError(say("backup.empty"))
            _require_same(former, identity, folder)
            contents, exported = store.contents(session), store.export_snapshot(session)
            progress("database", 0.0)
            moment = datetime.now(UTC)
            path = f"database-{moment:%Y%m%dT%H%M%S%fZ}.dump"
            dump(settings.session_url, exported, folder / path, versions.postgres_major)
        files = _Files(folder, former, progress)
        blobs = BlobStore(settings.blob_store_url)
        logs = [
            _Wanted(f"{LOGS}/{key}", partial(blobs.open, key), size_bytes, sha256)
            for key, (sha256, size_bytes) in contents.blobs.items()
        ]
        files.add_all("logs", logs)
        files.add_all("rasters", [one for source in contents.rasters for one in _raster(settings, source)])
        files.add_all("roads", list(_road_files(settings, contents.road_files)))
        with sessions() as session:
            missing = store.wanted_still(session, [path.removeprefix(f"{LOGS}/") for path in files.missing])
        manifest = Manifest(
            made_at=moment.isoformat(timespec="seconds"),
            versions={"versant": code_version(), "revision": state.revision, **versions._asdict()},
            identity=identity,
            drives=contents.drives,
            segments=contents.segments,
            dump=entry_of(folder, path),
            files=tuple(files.entries),
            missing=tuple(missing),
            damaged=tuple(files.damaged),
        )
        write_manifest(folder, manifest)
    return manifest


class _Files:
    """The files of a backup that is being made: those of the one before are taken as they are."""

    def __init__(self, folder: Path, former: Manifest | None, progress: Progress) -> None:
        self._folder, self._progress = folder, progress
        self._former = {entry.path: entry for entry in former.files} if former else {}
        self.entries: list[Entry] = []
        self.missing: list[str] = []
        self.damaged: list[str] = []

    def add_all(self, stage: str, wanted: list[_Wanted]) -> None:
        """Copy what is not there yet."""
        new = [one for one in wanted if not self._known(one)]
        self._require_room(sum(one.size_bytes for one in new))
        total, done = max(sum(one.size_bytes for one in wanted), 1), 0
        for one in wanted:
            self._progress(stage, done / total)
            done += one.size_bytes
            try:
                entry = self._known(one) or self._take(one)
            except FileNotFoundError:
                self.missing.append(one.path)
                continue
            if one.sha256 is not None and entry.sha256 != one.sha256:
                self.damaged.append(one.path.removeprefix(f"{LOGS}/"))
            self.entries.append(entry)
        self._progress(stage, 1.0)

    def _take(self, one: _Wanted) -> Entry:
        """Copy a file, unless a backup that was broken off did: then its bytes tell."""
        if one.sha256 is not None and (self._folder / one.path).is_file():
            entry = entry_of(self._folder, one.path)
            if entry.sha256 == one.sha256:
                return entry
        return keep(self._folder, one.path, one.opened)

    def _known(self, one: _Wanted) -> Entry | None:
        """The file as the backup before has it."""
        entry = self._former.get(one.path)
        fits = entry is not None and one.sha256 in {None, entry.sha256} and is_there(self._folder, entry)
        return entry if fits else None

    def _require_room(self, size_bytes: int) -> None:
        free = free_bytes(*file_system(str(self._folder)))
        if free is not None and free < size_bytes:
            raise BackupError(
                say("backup.no_room", folder=self._folder, free_mib=free / _MIB, needed_mib=size_bytes / _MIB)
            )


def _require_same(former: Manifest | None, identity: str, folder: Path) -> None:
    if former is not None and former.identity != identity:
        raise BackupError(say("backup.other", folder=folder, made_at=former.made_at, drives=former.drives))


def _raster(settings: Settings, source: Mapping[str, object]) -> Iterator[_Wanted]:
    """A raster with what lies beside it: its quality layer. Their folder's name is that of their content."""
    known = DemSource.of(source)
    path = local_raster(settings.dem_dir, known)
    if not path.is_file():
        raise BackupError(say("backup.raster_gone", name=known.name, path=path))
    for file in sorted(path.parent.iterdir()):
        sha256 = known.sha256 if file == path else None
        where = f"{RASTERS}/{path.parent.name}/{file.name}"
        yield _Wanted(where, _opener(file), file.stat().st_size, sha256)


def _road_files(settings: Settings, files: Mapping[str, str]) -> Iterator[_Wanted]:
    """What regions' files said of roads, kept beside the rasters. One that is lost costs files of changes only."""
    for uri, sha256 in files.items():
        try:
            path = mirror.fetch(settings.dem_dir, uri, sha256)
            size_bytes = path.stat().st_size
        except (mirror.MirrorError, FileNotFoundError):
            logger.warning("the roads of a region are not at %s: import its whole file again", uri)
            continue
        yield _Wanted(f"{RASTERS}/{uri}", _opener(path), size_bytes, sha256)


def _opener(path: Path) -> Callable[[], BinaryIO]:
    return lambda: path.open("rb")
