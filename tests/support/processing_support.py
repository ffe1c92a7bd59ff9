"""What tests of drive processing send, and what they look at in the database."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from sqlalchemy import text

from app.core.blobs import BlobStore, StoredBlob
from app.core.db import Sessions
from app.drives import intake, process, publishing
from app.drives import store as drives
from app.drives.documents import Drive
from app.drives.process import Outcome
from app.jobs.context import JobContext
from app.network.swap import solve_all_marked
from fusion.pipeline import parse_options

Send = Callable[..., Drive]

HEADER = b"time_s,lat_deg,lon_deg\n"
"""What an upload begins with that is taken for a log."""


def put_blob(blobs: BlobStore, chunks: Iterable[bytes]) -> StoredBlob:
    """Store chunks as a blob of their own."""
    with blobs.writer() as writer:
        for chunk in chunks:
            writer.write(chunk)
        return writer.finish()


def accept_upload(
    sessions: Sessions,
    blobs: BlobStore,
    chunks: Iterable[bytes],
    *,
    filename: str,
    method: str,
    options: Mapping[str, Any] | None = None,
) -> tuple[Drive, bool]:
    """Store an upload and queue it, as the route does; the flag says whether it is new."""
    parse_options(method, options or {})
    blob = put_blob(blobs, chunks)
    return intake.register_upload(sessions, blobs, blob, filename=filename, method=method, options=options)


def process_drive(context: JobContext, drive_id: uuid.UUID, generation: int, **options: Any) -> Outcome:
    """Process a drive and publish it, as workers do one after the other."""
    outcome = process.process_drive(context, drive_id, generation, **options)
    publish_all(context.sessions, context.blobs)
    return outcome


def publish_all(sessions: Sessions, blobs: BlobStore) -> None:
    """Solve all that is marked, and end the drives that waited for it."""
    solve_all_marked(sessions)
    publishing.finish(sessions, blobs)


def remove_drive(sessions: Sessions, blobs: BlobStore, drive_id: uuid.UUID) -> bool:
    """Remove a drive as the API and a worker do; whether it was there."""
    with sessions.begin() as session:
        generation = drives.request_removal(session, drive_id)
    if generation is not None:
        publishing.remove(sessions, blobs, drive_id, generation)
        publish_all(sessions, blobs)
    return generation is not None


def carry_out_removals(sessions: Sessions, blobs: BlobStore) -> None:
    """Do what a worker does of removals that were asked for."""
    query = text("SELECT id, generation FROM drives WHERE status = 'cancelled' AND stage IS NULL")
    with sessions() as session:
        waiting = session.execute(query).all()
    for drive_id, generation in waiting:
        publishing.remove(sessions, blobs, drive_id, generation)
    publish_all(sessions, blobs)


def drive_now(context: JobContext, drive_id: uuid.UUID) -> Drive:
    with context.sessions() as session:
        found = drives.get_drive(session, drive_id)
    assert found is not None
    return found


def state(context: JobContext) -> list[tuple[Any, ...]]:
    """Everything published that does not depend on when it was made."""
    with context.sessions() as session:
        estimates = session.execute(
            text(
                """
                SELECT d.sha256, s.osm_way_id, s.from_node, s.to_node, e.slope_percent, e.slope_sigma_percent,
                       e.observations, e.passes, a.slope_percent, a.drives, a.observations
                FROM drive_segments e JOIN drives d ON d.id = e.drive_id JOIN segments s ON s.id = e.segment_id
                JOIN segment_slopes a ON a.segment_id = s.id ORDER BY 1, 2, 3, 4
                """
            )
        ).all()
        orphans = session.execute(
            text(
                "SELECT count(*) FROM segment_slopes WHERE segment_id NOT IN (SELECT segment_id FROM drive_segments)"
            )
        ).scalar_one()
    assert orphans == 0
    return [tuple(row) for row in estimates]
