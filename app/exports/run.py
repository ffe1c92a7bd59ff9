"""Exports made by workers: one snapshot, one file, one blob.

Runs begin and end as ``app.jobs.requests.run`` says. A file is made in the run's folder, its blob appears at once or
not at all, and a blob that no export refers to is swept. Knows no HTTP.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from app.core.blobs import EXPORTS, StoredBlob
from app.core.caller import OPERATOR_OWNER, read_edition
from app.core.databases import database_identity
from app.core.db import plain_json, snapshot
from app.core.errors import ServiceError
from app.core.filesystems import file_system, free_bytes, full_is_told, storage_full
from app.core.messages import say
from app.core.settings import Settings
from app.core.telemetry.logs import tell
from app.exports import store
from app.exports.documents import Export
from app.exports.making import Made, asked_again, data_state, make_file
from app.exports.store import exports
from app.jobs.requests.run import Discarded, RequestKind, RequestRun, expected_failure
from app.jobs.requests.upkeep import expire
from app.jobs.task import Interrupted
from fusion.errors import FusionError
from fusion.messages import said

CHUNK_BYTES = 2**20
MOST_YIELDS = 3
"""So often an export lets others go first and begins anew; then it runs to its end."""
NO_ROOM = say("export.no_room")

logger = logging.getLogger(__name__)


class TooLargeError(FusionError):
    """The file takes more room than all exports together may, or all of its owner."""

    kind = "too-large"


def _make_export(run: RequestRun[Export]) -> str:
    """Make the export's file; a word on how it ended."""
    began_s, export = time.monotonic(), run.request
    request = asked_again(export.request)
    with full_is_told():
        run.folder.mkdir(parents=True, exist_ok=True)
    path = run.folder / export.file_name

    run.at_each_look = lambda: _require_room(run)
    show_share = partial(run.show, None)
    with run.computing():
        with snapshot(run.sessions) as session:
            is_operators = store.owner_of(session, export.id) == OPERATOR_OWNER
            if run.settings.owners_see_editions and not is_operators:
                read_edition(session)
            run.note(data_version=data_state(session).version)
            output = _in_room(run, lambda: make_file(session, run.settings, request, path, show_share))
        _require_fit(path.stat().st_size, run.settings, is_operators=is_operators)
        blob = _store_file(run, path, show_share)
    if not _finish(run, path, output, blob):
        run.context.part(EXPORTS).delete(blob.key)
        return "unwanted"
    expire(EXPORT, run.context)
    took_s = round(time.monotonic() - began_s, 3)
    tell(logger, "export done", format=request.format.name, bytes=blob.size_bytes, seconds=took_s)
    return "done"


def _require_fit(size_bytes: int, settings: Settings, *, is_operators: bool) -> None:
    """``TooLargeError`` where the file would go as soon as it was there."""
    bounds = [("all exports", settings.exports_max_bytes, "VERSANT_EXPORTS_MAX_BYTES")]
    if not is_operators:
        bounds.append(("all of an owner", settings.exports_owner_bytes, "VERSANT_EXPORTS_OWNER_BYTES"))
    for whose, most_bytes, setting in bounds:
        if size_bytes > most_bytes:
            raise TooLargeError(
                say("export.too_large", size=size_bytes, whose=whose, most=most_bytes, setting=setting)
            )


def _in_room(run: RequestRun[Export], work: Callable[[], Made]) -> Made:
    """The result of work that writes; GDAL does not say of a full disk what it was."""
    try:
        with full_is_told():
            return work()
    except (Interrupted, Discarded, FusionError, ServiceError):
        raise
    except Exception:
        _require_room(run)
        raise


def _require_room(run: RequestRun[Export]) -> None:
    """``StorageFullError`` where less stays free than is to."""
    free = free_bytes(*file_system(str(run.folder.parent)))
    if free is not None and free < run.settings.min_free_bytes:
        raise storage_full()


def _finish(run: RequestRun[Export], path: Path, output: Made, blob: StoredBlob) -> bool:
    companions = asked_again(run.request.request).format.companions(path, output.stated)
    with run.sessions.begin() as session:
        # Before the export refers to the blob: another database's sweep must not take it for an orphan.
        run.context.part(EXPORTS).register_database(database_identity(session))
        return exports.finish(
            session,
            run.request,
            entries=output.count,
            provenance=plain_json(output.provenance),
            companions={place.name: text for place, text in companions.items()},
            notes={"notes": list(output.notes), "said": [said(one) for one in output.notes]},
            blob_key=blob.key,
            sha256=blob.sha256,
            size_bytes=blob.size_bytes,
            **store.expiry(run.settings),
        )


def _store_file(run: RequestRun[Export], path: Path, show_share: Callable[[float], None]) -> StoredBlob:
    size_bytes, keep_free = path.stat().st_size, run.settings.min_free_bytes
    with (
        run.context.part(EXPORTS).writer(
            keep_free_bytes=keep_free, expected_bytes=size_bytes, max_content_bytes=0
        ) as writer,
        path.open("rb") as file,
    ):
        while chunk := file.read(CHUNK_BYTES):
            writer.write(chunk)
            show_share(1.0)
        return writer.finish()


EXPORT = RequestKind(
    exports,
    _make_export,
    advice=say("processing.smaller_export"),
    failure=expected_failure(NO_ROOM),
    folder="exports",
    files=EXPORTS,
    undisturbed_s=lambda yields: 0.0 if yields < MOST_YIELDS else float("inf"),
    at_end=store.expiry,
    expire=store.expire,
)
"""What a worker does for exports."""
