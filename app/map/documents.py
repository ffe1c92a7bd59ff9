"""The JSON documents of the API, with the examples that its OpenAPI document shows."""

from __future__ import annotations

import uuid
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from app.core.http import Link
from app.core.text import SLOPE_DIGITS, Moment, rounded
from app.drives.documents import EXAMPLE_ID
from app.map.store import ObservationRow

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
Percent = Annotated[float, BeforeValidator(lambda value: rounded(value, SLOPE_DIGITS))]
Share = Annotated[float, BeforeValidator(lambda value: rounded(value, 4))]


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
