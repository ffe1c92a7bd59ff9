"""What tests of drive processing send, and what they look at in the database."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from sqlalchemy import text

from app.core.blobs import BlobStore, StoredBlob
from app.core.db import Sessions
from app.drives import intake
from app.drives import store as drives
from app.drives.documents import Drive
from app.drives.process import Workbench
from fusion.pipeline import parse_options

Send = Callable[..., Drive]


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


def drive_now(bench: Workbench, drive_id: uuid.UUID) -> Drive:
    with bench.sessions() as session:
        found = drives.get_drive(session, drive_id)
    assert found is not None
    return found


def state(bench: Workbench) -> list[tuple[Any, ...]]:
    """Everything published that does not depend on when it was made."""
    with bench.sessions() as session:
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
