"""Where files of editions are kept: in the blob store, a folder for each edition, as ``app.releases.files`` wrote it.

What was removed since is still in the files of an older edition. So they go when those of the next one are there,
unless ``VERSANT_EDITIONS_KEPT`` keeps some.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import BinaryIO

from app.core.blobs import EDITIONS, BlobStore
from app.core.databases import database_identity
from app.core.db import Sessions
from app.core.settings import Settings
from app.core.text import whole_file
from app.releases import store
from app.releases.documents import MANIFEST
from app.releases.store import Edition

BLOCK_BYTES = 4 * 2**20
"""What one download holds of a bucket's file."""


def keep_files(settings: Settings, sessions: Sessions, edition: Edition, folder: Path) -> None:
    """Keep the files that the edition names, which are in ``folder``; then those of older editions go.

    ``StorageFullError`` where there is no room; nothing of them is kept then.
    """
    blobs, key = _blobs(settings), folder_key(edition)
    try:
        for file in edition.files:
            blobs.take(f"{key}/{file['name']}", folder / file["name"])
        with sessions.begin() as session:
            # Before the edition refers to them: another database's release must not take them for left over.
            blobs.register_database(database_identity(session))
            store.name_files(session, edition)
    except BaseException:
        blobs.delete_folder(key)
        raise
    _drop_others(settings, sessions)


def _drop_others(settings: Settings, sessions: Sessions) -> None:
    """Remove the files of all editions but the newest, and what a release that was killed left.

    That may be another database's where others use the store: then it stays.
    """
    blobs = _blobs(settings)
    with sessions.begin() as session:
        identity = database_identity(session)
        dropped = store.forget_files(session, keep=settings.editions_kept)
        kept = {folder_key(one) for one in store.list_editions(session) if one.files}
    drop_files(settings, dropped)
    if not set(blobs.databases()) - {identity}:
        for key in set(blobs.keys()) - kept:
            blobs.delete_folder(key)


def drop_files(settings: Settings, editions: list[Edition]) -> None:
    """Remove the files that these editions name."""
    blobs = _blobs(settings)
    for edition in editions:
        if edition.files:
            blobs.delete_folder(folder_key(edition))


def open_file(settings: Settings, edition: Edition, name: str) -> BinaryIO:
    """A file of an edition; ``FileNotFoundError`` where it is not kept."""
    return _blobs(settings).open(f"{folder_key(edition)}/{name}", BLOCK_BYTES)


def copy_files(settings: Settings, edition: Edition, folder: Path) -> None:
    """Write the files of an edition into ``folder``, which is made where it is missing, the manifest last.

    ``FileNotFoundError`` where they are not kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for file in edition.files:
        with (
            whole_file(folder / file["name"]) as partial,
            open_file(settings, edition, file["name"]) as source,
            partial.open("wb") as target,
        ):
            shutil.copyfileobj(source, target, BLOCK_BYTES)


def folder_key(edition: Edition) -> str:
    """The key of the folder of an edition's files: a name of these contents, so that blobs never change.

    The number alone would name other files after a backup came back.
    """
    sha256 = next(file["sha256"] for file in edition.files if file["name"] == MANIFEST)
    return f"{EDITIONS}/{edition.number}-{sha256[:12]}"


def _blobs(settings: Settings) -> BlobStore:
    return BlobStore(settings.blob_store_url, EDITIONS)
