"""The links of a drive, and its JSON document."""

from __future__ import annotations

from app.outputs.features import GEO_JSON
from app.routes.deps import link
from app.schemas import Drive, DriveAccepted, Link
from app.store.rows import DriveRow


def drive_address(base: str, row: DriveRow) -> str:
    """Absolute address of the drive."""
    return f"{base}/v1/drives/{row.id}"


def drive_links(base: str, row: DriveRow) -> list[Link]:
    """Where the drive's parts are."""
    here = drive_address(base, row)
    return [
        link(here, "self", title="This drive"),
        link(f"{here}/events", "events", "text/event-stream", "Its progress as server-sent events"),
        link(f"{here}/track", "track", GEO_JSON, "Its estimated track"),
        link(f"{here}/profile", "profile", title="Its elevation profile"),
        link(f"{here}/profile?f=png", "profile", "image/png", "Its elevation profile as a picture"),
        link(f"{here}/segments", "segments", GEO_JSON, "Its estimates per road segment"),
        link(f"{here}/reprocess", "reprocess", title="POST: process it again"),
    ]


def drive_document(base: str, row: DriveRow) -> Drive:
    """The drive as the API shows it."""
    return Drive.of(row, drive_links(base, row))


def accepted(base: str, row: DriveRow) -> DriveAccepted:
    """The short answer to an upload or a request to process again."""
    return DriveAccepted.model_validate({"id": row.id, "status": row.status, "links": drive_links(base, row)})
