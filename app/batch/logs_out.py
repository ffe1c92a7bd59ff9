"""The stored logs of a service as a folder that ``versant batch`` reads: ``versant export-logs``.

A folder for each owner, in it one for each drive with its log under the name that it came by. Beside them stands a list
of what is there; the same folder again gets what is new, and loses what was removed.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.batch.folder import BatchError, written
from app.batch.run import Shown
from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.messages import say
from app.drives.batches.importing import StoredLog, count_stored_logs, stored_logs
from app.drives.parts.reading import log_name, plain_name
from app.drives.receiving.upload_bundle import COPY_BYTES
from fusion.messages import message_of

LIST = ".drives.jsonl"
"""Hidden: a batch leaves it out."""
_DRIVE = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


@dataclass
class Exported:
    """What came of it."""

    logs: Counter[str] = field(default_factory=Counter)
    """By the owner"""
    new: int = 0
    removed: int = 0
    left_out: dict[str, str] = field(default_factory=dict)
    """Drives whose logs are not in the folder, and why not"""


def export_logs(
    sessions: Sessions, blobs: BlobStore, folder: Path, owner_id: int | None, shown: Shown
) -> Exported:
    """Write the logs of that owner, or of all. Raises ``BatchError`` for a folder with other files in it, ``OSError``.

    Each file appears whole or not at all, so it may be cut off at any moment and begun again.
    """
    _require_ours(folder)
    with sessions() as session:
        bar = shown.count("logs", count_stored_logs(session, owner_id))
    exported, places = Exported(), dict[str, str | None]()
    with written(folder / LIST) as partial, partial.open("w", encoding="utf-8") as out:
        for one in _all(sessions, owner_id):
            places[str(one.id)] = None
            try:
                path = _path(blobs, one)
                exported.new += _copied(blobs, one, folder / path)
            except BatchError as error:
                exported.left_out[str(one.id)] = message_of(error)
            except FileNotFoundError:
                exported.left_out[str(one.id)] = say("batch.log_lost")
            else:
                places[str(one.id)] = str(Path(path).parent)
                exported.logs[one.owner] += 1
                out.write(json.dumps(_document(one, path)) + "\n")
            bar(1)
    exported.removed = _remove_others(folder, places)
    return exported


def _require_ours(folder: Path) -> None:
    """``BatchError`` for a folder with other files; one that is empty is ours from here on."""
    if (folder / LIST).is_file():
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise BatchError(say("batch.other_files", folder=folder))
    with written(folder / LIST) as partial:
        partial.write_text("")


def _remove_others(folder: Path, places: Mapping[str, str | None]) -> int:
    """Remove what is there of drives that are not in ``places``, or in another place there; how many.

    Of a drive without a place the service has lost the log: what is here of it stays.
    """
    count = 0
    for place in folder.glob("*/*"):
        is_drive = place.is_dir() and _DRIVE.fullmatch(place.name)
        if is_drive and places.get(place.name, "") not in (None, str(place.relative_to(folder))):
            shutil.rmtree(place)
            count += 1
    return count


def _all(sessions: Sessions, owner_id: int | None) -> Iterator[StoredLog]:
    """All of them, oldest upload first, some at a time: no transaction lasts as long as the copying."""
    after = None
    while True:
        with sessions() as session:
            some = stored_logs(session, owner_id, after)
        yield from some
        if not some:
            return
        after = some[-1]


def _path(blobs: BlobStore, one: StoredLog) -> str:
    """Where the log is in the folder."""
    with blobs.open(one.blob_key) as file:
        name = plain_name(log_name(one.filename, file))
    return f"{one.owner_id}-{plain_name(one.owner)}/{one.id}/{name}"


def _copied(blobs: BlobStore, one: StoredLog, path: Path) -> bool:
    """Copy a log unless it is there; ``BatchError`` where its bytes are not what was uploaded."""
    if path.is_file() and path.stat().st_size == one.size_bytes:
        return False
    digest = hashlib.sha256()
    with written(path) as partial, partial.open("wb") as out:
        with blobs.open(one.blob_key) as file:
            while data := file.read(COPY_BYTES):
                digest.update(data)
                out.write(data)
        if digest.hexdigest() != one.sha256:
            raise BatchError(say("batch.log_damaged"))
    return True


def _document(one: StoredLog, path: str) -> dict[str, Any]:
    names = ("owner", "filename", "sha256", "size_bytes", "method", "options")
    uploaded = {"drive": str(one.id), "path": path, "created_at": one.created_at.isoformat()}
    return uploaded | {name: getattr(one, name) for name in names}
