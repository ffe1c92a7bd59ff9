"""Where files of editions are kept: in the blob store, a folder for each edition, as ``write_files`` wrote it.

What was removed since is still in the files of an older edition. So they go when the next one is there, unless
``VERSANT_EDITIONS_KEPT`` keeps some.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from app.core.blobs import EDITIONS, BlobStore
from app.core.databases import database_identity
from app.core.db import Sessions
from app.core.settings import Settings
from app.releases import store
from app.releases.files import MANIFEST
from app.releases.store import Edition

BLOCK_BYTES = 4 * 2**20
"""What one download holds of a bucket's file."""


def keep_files(settings: Settings, edition: Edition, folder: Path) -> None:
    """Keep the files of an edition (``Edition.files``), which are in ``folder``, under ``folder_key``.

    ``StorageFullError`` where there is no room; what was kept of it until then is removed.
    """
    blobs = BlobStore(settings.blob_store_url, EDITIONS)
    key = folder_key(edition)
    try:
        for file in edition.files:
            blobs.take(f"{key}/{file['name']}", folder / file["name"])
    except BaseException:
        blobs.delete_folder(key)
        raise


def drop_old_files(settings: Settings, sessions: Sessions) -> list[int]:
    """Remove the files of all editions but the newest, ``editions_kept`` of them; the numbers of those that had any.

    What a release that was killed left goes as well, unless another database uses the store.
    """
    blobs = BlobStore(settings.blob_store_url, EDITIONS)
    with sessions.begin() as session:
        identity = database_identity(session)
        blobs.register_database(identity)
        dropped = store.forget_files(session, keep=settings.editions_kept)
        kept = {folder_key(one) for one in store.list_editions(session) if one.files}
    for edition in dropped:
        blobs.delete_folder(folder_key(edition))
    if not set(blobs.databases()) - {identity}:
        for key in set(blobs.keys()) - kept:
            blobs.delete_folder(key)
    return [edition.number for edition in dropped]


def open_file(settings: Settings, edition: Edition, name: str) -> BinaryIO:
    """A file of an edition; ``FileNotFoundError`` where it is not kept."""
    return BlobStore(settings.blob_store_url, EDITIONS).open(f"{folder_key(edition)}/{name}", BLOCK_BYTES)


def folder_key(edition: Edition) -> str:
    """The key of the folder of an edition's files: a name of these contents, so that blobs never change.

    The number alone would name other files after a backup came back.
    """
    sha256 = next(file["sha256"] for file in edition.files if file["name"] == MANIFEST)
    return f"{EDITIONS}/{edition.number}-{sha256[:12]}"
