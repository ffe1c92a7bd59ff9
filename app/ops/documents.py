"""The JSON documents of the API, with the examples that its OpenAPI document shows."""

from __future__ import annotations

from datetime import date
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from app.core.text import Moment
from app.drives.documents import DriveStatus
from app.ops.store import AdminStats

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
