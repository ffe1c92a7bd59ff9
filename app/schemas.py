"""The JSON documents of the API, with the examples that its OpenAPI document shows."""

from __future__ import annotations

import uuid
from datetime import date, datetime
from enum import StrEnum
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer

from app.models import DRIVE_STATUSES
from app.outputs.features import SLOPE_DIGITS, rounded, utc_text
from app.store.rows import AdminStats, DriveRow, ObservationRow

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
OBSERVATION_EXAMPLE: dict[str, Any] = {
    "drive_id": EXAMPLE_ID,
    "drive_time": "2026-11-20T07:55:10.000Z",
    "slope_percent": 6.75,
    "slope_sigma_percent": 0.41,
    "observations": 8,
    "passes": 1,
    "first_at": "2026-11-20T07:55:31.000Z",
    "last_at": "2026-11-20T07:55:38.000Z",
    "in_network": True,
    "accepted": True,
    "weight": 0.5316,
    "method": "profile",
    "options": {"doppler": True, "match_radius_m": 50.0},
    "code_version": "0.1.0",
    "road_version_id": 2,
    "dem_version_id": 1,
    "estimated_at": "2026-11-20T09:13:02.004Z",
}
STATS_EXAMPLE: dict[str, Any] = {
    "drives": 13,
    "drives_by_status": {"done": 12, "failed": 1},
    "drives_by_day": [{"day": "2026-11-20", "status": "done", "drives": 12}],
    "queue_depth": 0,
    "queue_oldest_wait_s": None,
    "running": 0,
    "failures_by_kind": {"no-match": 1},
    "driven_km_by_highway": {"residential": 21.4},
    "driven_distance_km": 74.9,
    "network_km": 1204.2,
    "segments": 29_311,
    "segments_driven": 611,
    "uploaded_bytes": 61_004_311,
    "data_version": 14,
    "road_version": None,
    "dem_version_id": 1,
}

# A StrEnum made from the tuple that the table's constraint is made from: one list of statuses.
DriveStatus = StrEnum("DriveStatus", {name.upper(): name for name in DRIVE_STATUSES})  # type: ignore[misc]
TERMINAL_STATUSES = frozenset({"done", "failed", "cancelled"})

Moment = Annotated[datetime, PlainSerializer(utc_text, return_type=str, when_used="json-unless-none")]
Percent = Annotated[float, BeforeValidator(lambda value: rounded(value, SLOPE_DIGITS))]
Share = Annotated[float, BeforeValidator(lambda value: rounded(value, 4))]


class Link(BaseModel):
    """A typed link (RFC 8288)."""

    href: str = Field(description="Absolute address.")
    rel: str = Field(description="Relation to this document.")
    type: str | None = Field(None, description="Media type of the target.")
    title: str | None = Field(None, description="What the target is.")


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


class Observation(BaseModel):
    """What one drive says about a segment, and how that estimate was made."""

    drive_id: uuid.UUID
    drive_time: Moment | None
    slope_percent: Percent
    slope_sigma_percent: Percent
    observations: int = Field(description="Epochs used.")
    passes: int = Field(description="How often the drive went over the segment.")
    first_at: Moment
    last_at: Moment
    in_network: bool = Field(description="Solved together with all drives, rather than averaged with them.")
    accepted: bool | None = Field(
        description="Whether the drive is heard here, or contradicts the others; null unless in_network."
    )
    weight: Share = Field(
        description="Its share in the segment's slope, 0..1, by the inverse variance of its own estimate."
    )
    method: str
    options: dict[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None
    estimated_at: Moment

    @classmethod
    def of(cls, row: ObservationRow) -> Observation:
        """Build from what the store returns."""
        return cls(**vars(row))


class ObservationList(BaseModel):
    """All drives behind a segment's slope, latest first."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"segment_id": 17, "observations": [OBSERVATION_EXAMPLE], "links": []}]
        }
    )

    segment_id: int
    observations: list[Observation]
    links: list[Link]


class ReprocessRequest(BaseModel):
    """How to process a drive again; what is left out stays as it was."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"method": "particle", "options": {"particles": 10_000}}]},
    )

    method: str | None = Field(None, description="Another estimator.")
    options: dict[str, Any] | None = Field(None, description="Its options; leaving them out means defaults.")


class DayCount(BaseModel):
    """Drives uploaded on one UTC day, by their present status."""

    day: date
    status: DriveStatus
    drives: int


class RoadVersion(BaseModel):
    """One import of the road network."""

    id: int
    source_name: str
    sha256: str
    imported_at: Moment
    segments: int
    kept: int
    moved: int
    dropped: int
    added: int


class Stats(BaseModel):
    """Figures for operators."""

    model_config = ConfigDict(json_schema_extra={"examples": [STATS_EXAMPLE]})

    drives: int
    drives_by_status: dict[str, int]
    drives_by_day: list[DayCount]
    queue_depth: int
    queue_oldest_wait_s: float | None = Field(description="Null while nothing waits.")
    running: int
    failures_by_kind: dict[str, int]
    driven_km_by_highway: dict[str, float] = Field(description="Length of roads with an estimate, by class.")
    driven_distance_km: float = Field(description="Sum over the drives.")
    network_km: float
    segments: int
    segments_driven: int
    uploaded_bytes: int
    data_version: int
    road_version: RoadVersion | None
    dem_version_id: int | None

    @classmethod
    def of(cls, row: AdminStats) -> Stats:
        """Build from what the store returns."""
        values = dict(vars(row))
        values["road_version"] = row.road_version and RoadVersion(**vars(row.road_version))
        return cls(**values)


class Health(BaseModel):
    """The service's own state."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"status": "ready", "checks": {"database": "ok", "blobs": "ok"}}]}
    )

    status: str
    checks: dict[str, str] = Field(default={}, description="Each thing needed: ok, or what is wrong with it.")


def _failure(row: DriveRow) -> Failure | None:
    if row.status != "failed":
        return None
    return Failure(
        kind=row.failure_kind or "unknown",
        reason=row.failure_reason or "No reason was recorded. Process the drive again.",
        stage=row.stage,
        where=row.failure_where,
    )
