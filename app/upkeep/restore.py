"""A backup brought back into an empty database, and its files to where they are kept. Nothing is ever overwritten."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy.exc import SQLAlchemyError

from app.changes.store import begin_epoch
from app.changes.webhooks.store import switch_all_off
from app.core import databases, migrate, mirror, schema
from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.filesystems import file_system, free_bytes, put_file
from app.core.messages import say
from app.core.settings import Settings
from app.upkeep import dumps, store
from app.upkeep.dumps import BackupError
from app.upkeep.manifest import LOGS, RASTERS, Entry, Manifest, read_manifest, verify
from fusion.types import Progress, no_progress

_MIB = 2**20
_RESTORED = say("backup.webhook_off")


@dataclass(frozen=True)
class Restored:
    """What came back: logs that were not in the store yet, drives that wait to be processed."""

    logs: int
    waiting: int
    other_databases: tuple[str, ...]
    """Identities of databases that have used the store before; while there are any, sweeps remove nothing."""


def checked(folder: Path, progress: Progress = no_progress) -> Manifest:
    """The backup in a folder, all of whose files are as they were; ``BackupError`` where they are not."""
    manifest = read_manifest(folder)
    if manifest is None:
        raise BackupError(say("backup.incomplete", folder=folder))
    revision = manifest.versions["revision"]
    if revision is not None and not migrate.is_known(revision):
        raise BackupError(say("backup.newer_schema", revision=revision, version=manifest.versions["versant"]))
    verify(folder, manifest, progress)
    return manifest


def require_empty(sessions: Sessions, manifest: Manifest) -> None:
    """``BackupError`` unless the database is empty and of a version that can take the backup."""
    with sessions() as session:
        if not store.is_empty(session):
            raise BackupError(say("backup.not_empty"))
        here = store.versions(session)
    if here.postgres_major < manifest.versions["postgres_major"]:
        raise BackupError(
            say("backup.newer_server", version=manifest.versions["postgres"], here=here.postgres)
        )


def restore(
    settings: Settings, sessions: Sessions, folder: Path, manifest: Manifest, progress: Progress = no_progress
) -> Restored:
    """Bring a checked backup back; the database is the last to come, so what is broken off can be done again.

    Where the store of logs was empty the restored database is the only one that uses it. Else it is another one to the
    store, and sweeps remove nothing until they are told that the former one is gone.
    """
    assert settings.session_url is not None  # noqa: S101 - the commands see to it
    require_empty(sessions, manifest)
    databases.ensure_postgis(settings.session_url)
    blobs = BlobStore(settings.blob_store_url)
    logs = manifest.below(LOGS)
    with sessions() as session:
        identity, here = databases.database_identity(session), store.versions(session)
    mine, stored = {key for _, key in logs}, set(blobs.keys())
    _require_room(settings, manifest, stored)
    if stored <= mine and not blobs.databases():
        blobs.register_database(identity)
    new = 0
    for done, (entry, key) in enumerate(logs):
        progress("logs", done / len(logs))
        new += blobs.take(key, folder / entry.path)
    _rasters(settings, folder, manifest.below(RASTERS), progress)
    progress("database", 0.0)
    newest = max(here.postgres_major, manifest.versions["postgres_major"])
    _roles(sessions)
    dumps.restore(settings.session_url, folder / manifest.dump.path, newest)
    schema.give_rights(settings.session_url)
    with sessions.begin() as session:
        waiting = store.put_back(session)
        followed = store.is_followed(session)
        if followed:
            switch_all_off(session, _RESTORED)
    if followed:
        begin_epoch(sessions)
    progress("database", 1.0)
    return Restored(new, waiting, tuple(name for name in blobs.databases() if name != identity))


def _roles(sessions: Sessions) -> None:
    """Make the roles that the dump names: they are the server's, and in no dump of a database."""
    try:
        with sessions.begin() as session:
            schema.ensure_roles(session.connection())
    except SQLAlchemyError as error:
        reason = " ".join(str(getattr(error, "orig", None) or error).split())
        raise BackupError(say("backup.roles", reason=reason)) from error


def _require_room(settings: Settings, manifest: Manifest, stored: Set[str]) -> None:
    """That files which are not there yet find room, each kind where it goes; the database's needs are its server's."""
    rasters = mirror.local_folder(settings.dem_dir)
    for url, kind in ((settings.blob_store_url, LOGS), (str(rasters), RASTERS)):
        needed = sum(
            entry.size_bytes
            for entry, name in manifest.below(kind)
            if not (name in stored if kind == LOGS else (rasters / name).exists())
        )
        free = free_bytes(*file_system(url))
        if free is not None and free < needed:
            raise BackupError(
                say("backup.no_room_there", free_mib=free / _MIB, place=url, needed_mib=needed / _MIB)
            )


def _rasters(
    settings: Settings, folder: Path, files: Sequence[tuple[Entry, str]], progress: Progress
) -> None:
    """Rasters lie in folders named after their content, roads in such as no other has: what is there is right."""
    place = mirror.local_folder(settings.dem_dir)
    for done, (entry, name) in enumerate(files):
        progress("rasters", done / len(files))
        if not (place / name).exists():
            put_file(*file_system(str(place)), folder / entry.path, name)
    try:
        # The quality layer first: where a raster is, what belongs to it is as well.
        mirror.send(
            settings.dem_dir, sorted((name for _, name in files), key=lambda name: "_num" not in name.lower())
        )
    except mirror.MirrorError as error:
        raise BackupError(say("backup.raster", error=error)) from error
