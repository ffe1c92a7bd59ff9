"""Runs of operations in a worker: one at a time, behind uploads. They begin and end as ``app.jobs.requests.run`` says.

Knows no HTTP.
"""

from __future__ import annotations

import logging

from app.core.blobs import IMPORTS
from app.core.db import plain_json
from app.core.filesystems import full_is_told, require_room
from app.core.telemetry.logs import tell
from app.jobs.requests.run import RequestKind, expected_failure
from app.operations import store
from app.operations.store import operations
from app.operations.work import Outcome, PlanChangedError, Run, file_of, work
from fusion.errors import FusionError

CHUNK_BYTES = 2**20
SLICE_S = 20.0
"""An operation lets others go first at once, then after so long, twice, four times as long: it comes to its end."""
LOST = "The file of this operation is gone from the storage. Ask for it again, with the file."
NO_ROOM = (
    "The service's storage is full. Ask again when whoever runs the service has made room (/readyz says how much there "
    "is)."
)

logger = logging.getLogger(__name__)


class FileLostError(FusionError):
    """The file that came with an operation is not there any more."""

    kind = "file-lost"


def _operate(run: Run) -> str:
    """Do, or plan, what was asked for; a word on how it ended."""
    operation = run.request
    run.show("beginning", 0.0)
    if operation.blob_key is not None:
        _fetch_file(run, operation.blob_key)
    try:
        outcome = work(run)
    except PlanChangedError as changed:
        outcome = Outcome(changed.plan, planned=True)
    with run.sessions.begin() as session:
        if outcome.planned:
            ours = store.plan(session, operation, outcome.document)
        else:
            ours = operations.finish(session, operation, result=plain_json(outcome.document), blob_key=None)
    if not ours:
        return "unwanted"
    if outcome.planned:
        return "planned"
    if operation.blob_key is not None:
        run.context.part(IMPORTS).delete(operation.blob_key)
    run.context.roads_changed(run.sessions)
    tell(logger, "operation done", kind=operation.kind)
    return "done"


def _fetch_file(run: Run, blob_key: str) -> None:
    """Bring the file that came with the operation to this machine."""
    size = max(int(run.request.request["size_bytes"]), 1)
    try:
        with full_is_told(), run.context.part(IMPORTS).open(blob_key, CHUNK_BYTES) as source:
            run.folder.mkdir(parents=True, exist_ok=True)
            require_room(run.folder, size, run.settings.min_free_bytes)
            with file_of(run).open("wb") as target:
                while chunk := source.read(CHUNK_BYTES):
                    target.write(chunk)
                    run.show("fetching the file", target.tell() / size)
    except FileNotFoundError as error:
        raise FileLostError(LOST) from error


OPERATION = RequestKind(
    operations,
    _operate,
    advice="Ask for it again: what was done of it stays. The command line knows no such limit.",
    failure=expected_failure(NO_ROOM),
    folder="operations",
    files=IMPORTS,
    undisturbed_s=lambda yields: SLICE_S * (2**yields - 1),
    expire=store.forget_plans,
)
"""What a worker does for operations."""
