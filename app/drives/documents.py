"""The JSON documents of the API, with the examples that its OpenAPI document shows."""

from __future__ import annotations

import uuid
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from app.core.http import Link, link
from app.core.tables import DRIVE_STATUSES
from app.core.text import GEO_JSON, Moment
from app.drives.store import DriveRow

EXAMPLE_ID = "3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11"
EXAMPLE_DRIVE = f"http://127.0.0.1:8000/v1/drives/{EXAMPLE_ID}"

DRIVE_EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_ID,
    "status": "done",
    "progress": 1.0,
    "stage": None,
    "failure": None,
    "filename": "monday.ubx",
    "size_bytes": 5_021_417,
    "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
    "method": "profile",
    "options": {},
    "created_at": "2026-11-20T09:12:44.120Z",
    "queued_at": "2026-11-20T09:12:44.120Z",
    "started_at": "2026-11-20T09:12:44.661Z",
    "finished_at": "2026-11-20T09:13:02.004Z",
    "drive_time": "2026-11-20T07:55:10.000Z",
    "epochs": 549,
    "distance_m": 6240.3,
    "bbox": [8.4611, 48.9512, 8.4987, 48.9838],
    "report": {"matched_share": 0.98, "breaks": [], "rejected_segments": 0, "warnings": []},
    "links": [{"href": EXAMPLE_DRIVE, "rel": "self", "type": "application/json"}],
}

# A StrEnum made from the tuple that the table's constraint is made from: one list of statuses.
DriveStatus = StrEnum("DriveStatus", {name.upper(): name for name in DRIVE_STATUSES})  # type: ignore[misc]
TERMINAL_STATUSES = frozenset({"done", "failed", "cancelled"})


class Failure(BaseModel):
    """Why a drive failed."""

    kind: str = Field(description="Stable identifier of the reason.")
    reason: str = Field(description="What is wrong and what to do about it.")
    stage: str | None = Field(description="What the worker was doing.")
    where: str | None = Field(description="The line, byte or field at fault, as far as known.")


class DriveAccepted(BaseModel):
    """The answer to an upload or a request to process again."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "id": EXAMPLE_ID,
                    "status": "queued",
                    "links": [{"href": EXAMPLE_DRIVE, "rel": "self", "type": "application/json"}],
                }
            ]
        }
    )

    id: uuid.UUID
    status: DriveStatus
    links: list[Link]


class Drive(BaseModel):
    """A drive: an uploaded log and what became of it."""

    model_config = ConfigDict(json_schema_extra={"examples": [DRIVE_EXAMPLE]})

    id: uuid.UUID
    status: DriveStatus
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1.")
    stage: str | None = Field(description="What the worker is doing, or was doing when it failed.")
    failure: Failure | None = Field(description="Why it failed; null unless status is failed.")
    filename: str
    size_bytes: int = Field(description="Size as uploaded.")
    sha256: str = Field(description="SHA-256 of the bytes as uploaded; the same bytes are the same drive.")
    method: str = Field(description="The estimator asked for.")
    options: dict[str, Any] = Field(description="The options asked for; the report holds all of them.")
    created_at: Moment
    queued_at: Moment
    started_at: Moment | None
    finished_at: Moment | None
    drive_time: Moment | None = Field(description="When the recording begins.")
    epochs: int | None
    distance_m: float | None
    bbox: tuple[float, float, float, float] | None = Field(description="West, south, east, north; degrees.")
    report: dict[str, Any] | None = Field(
        description="Of the last successful run: matched share and breaks, learned noise, mount, what each sensor "
        "contributes, on how many segments it contradicts other drives (rejected_segments), warnings, versions ..."
    )
    links: list[Link]

    @classmethod
    def of(cls, row: DriveRow, links: list[Link]) -> Drive:
        """Build from what the store returns."""
        names = set(cls.model_fields) - {"failure", "bbox", "links"}
        return cls(
            **{name: getattr(row, name) for name in names},
            failure=_failure(row),
            bbox=row.bounds,
            links=links,
        )


class DriveList(BaseModel):
    """One page of drives, newest upload first."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"drives": [DRIVE_EXAMPLE], "links": []}]})

    drives: list[Drive]
    links: list[Link] = Field(description="`next` is missing on the last page.")


class ReprocessRequest(BaseModel):
    """How to process a drive again; what is left out stays as it was."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"method": "particle", "options": {"particles": 10_000}}]},
    )

    method: str | None = Field(None, description="Another estimator.")
    options: dict[str, Any] | None = Field(None, description="Its options; leaving them out means defaults.")


def _failure(row: DriveRow) -> Failure | None:
    if row.status != "failed":
        return None
    return Failure(
        kind=row.failure_kind or "unknown",
        reason=row.failure_reason or "No reason was recorded. Process the drive again.",
        stage=row.stage,
        where=row.failure_where,
    )


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
