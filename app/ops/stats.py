"""Figures for operators: what is counted, as a document, and the route to it. The statements are in ``store.py``."""

from __future__ import annotations

import uuid
from datetime import date
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field, computed_field
from sqlalchemy import Row
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.http import ServiceDep, problems
from app.core.text import Moment
from app.drives.documents import DriveStatus
from app.network.cells import cell_bounds, cell_name, data_version
from app.ops import store
from app.roads.store import current_road_version

STATS_EXAMPLE: dict[str, Any] = {
    "drives": 13,
    "drives_by_status": {"done": 12, "failed": 1},
    "drives_by_day": [{"day": "2026-11-20", "status": "done", "drives": 12}],
    "queue_depth": 0,
    "queue_oldest_wait_s": None,
    "running": 0,
    "failures_by_kind": {"no-match": 1},
    "cells_waiting": 1,
    "cells_unsolved": 1,
    "unsolved": [
        {
            "cell": "14/8579/5634",
            "bbox": [8.503417, 48.951366, 8.52539, 48.965794],
            "solvers": 4,
            "since": "2026-11-20T09:12:44.120Z",
            "next_at": "2026-11-20T09:14:44.120Z",
            "drives": ["3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11"],
            "advice": "3 attempts to solve this cell have failed ...",
            "square": "14/8579/5634",
        }
    ],
    "derived_behind_s": None,
    "driven_km_by_highway": {"residential": 21.4},
    "driven_distance_km": 74.9,
    "network_km": 1204.2,
    "segments": 29_311,
    "segments_driven": 611,
    "uploaded_bytes": 61_004_311,
    "data_version": 14,
    "road_version": None,
    "dem_version_id": 1,
    "squares_waiting": 1,
    "squares_unsolved": 1,
}


MOST_UNSOLVED = 20


class DayCount(BaseModel):
    """Drives uploaded on one UTC day, by their present status."""

    day: date
    status: DriveStatus
    drives: int


class UnsolvedSquare(BaseModel):
    """A cell of the map whose slopes could not be computed."""

    cell: str = Field(description="z/x/y.")
    bbox: Bounds = Field(description="West, south, east, north; degrees.")
    solvers: int = Field(description="How many solvers have begun it.")
    since: Moment = Field(description="When the oldest of what waits there came.")
    next_at: Moment = Field(description="When it is tried again, unless something new comes.")
    drives: list[uuid.UUID] = Field(
        description="Drives whose slopes there are not published, or whose removal waits for it."
    )
    advice: str = Field(description="What to do about it.")

    @computed_field(description="Former name of `cell`.", json_schema_extra={"deprecated": True})  # type: ignore[prop-decorator]
    @property
    def square(self) -> str:
        """Former name of ``cell``."""
        return self.cell


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
    cells_waiting: int = Field(description="Cells of the map (tiles of zoom 14) that wait to be solved.")
    cells_unsolved: int = Field(description="Of these, how many solvers repeatedly failed to solve.")
    unsolved: list[UnsolvedSquare] = Field(
        description=f"The {MOST_UNSOLVED} of them that have waited longest."
    )
    derived_behind_s: float | None = Field(
        description="For how long a change of segments has waited to be shown by ways and low zooms; null: none has."
    )
    driven_km_by_highway: dict[str, float] = Field(description="Length of roads with an estimate, by class.")
    driven_distance_km: float = Field(description="Sum over the drives.")
    network_km: float
    segments: int
    segments_driven: int
    uploaded_bytes: int
    data_version: int
    road_version: RoadVersion | None
    dem_version_id: int | None

    @computed_field(description="Former name of `cells_waiting`.", json_schema_extra={"deprecated": True})  # type: ignore[prop-decorator]
    @property
    def squares_waiting(self) -> int:
        """Former name of ``cells_waiting``."""
        return self.cells_waiting

    @computed_field(description="Former name of `cells_unsolved`.", json_schema_extra={"deprecated": True})  # type: ignore[prop-decorator]
    @property
    def squares_unsolved(self) -> int:
        """Former name of ``cells_unsolved``."""
        return self.cells_unsolved


router = APIRouter(prefix="/v1/admin", tags=["operation"])


@router.get("/stats", summary="Figures for operators", responses=problems(422, 503))
def stats(
    service: ServiceDep,
    days: Annotated[
        int, Query(ge=1, le=366, description="How many days back drives are counted by day.")
    ] = 30,
) -> Stats:
    """Drives by status and day, the queue, failures by reason, kilometres covered by road class."""
    with service.reading() as session:
        return read_stats(session, days=days)


def read_stats(session: Session, *, days: int = 30) -> Stats:
    """The figures of this moment; drives by day cover the last ``days`` days."""
    by_status = store.drives_by_status(session)
    queue = store.queue(session)
    roads = current_road_version(session)
    cells = store.waiting_cells(session)
    return Stats(
        drives_by_status=by_status,
        drives_by_day=[DayCount(**row) for row in store.drives_by_day(session, days)],
        queue_depth=queue.depth,
        queue_oldest_wait_s=queue.oldest_wait_s,
        running=by_status.get("running", 0),
        failures_by_kind=store.failures_by_kind(session),
        cells_waiting=cells.waiting,
        cells_unsolved=cells.unsolved,
        unsolved=[_unsolved(row) for row in store.unsolved_cells(session, MOST_UNSOLVED)],
        derived_behind_s=store.behind(session).behind_s,
        driven_km_by_highway=store.driven_km_by_highway(session),
        segments_driven=store.segments_driven(session),
        data_version=data_version(session),
        road_version=roads and RoadVersion(**roads._mapping),
        **store.totals(session)._mapping,
    )


def _unsolved(row: Row[Any]) -> UnsolvedSquare:
    advice = (
        f"{row.solvers - 1} attempts to solve this cell have failed; the workers' log says why. A worker that was "
        "killed usually ran out of memory. Workers retry automatically, at least once an hour. To retry at once, "
        "delete a drive that lies here (versant drives delete ID) or process it again."
    )
    shown = {"cell": cell_name(row.cell), "bbox": cell_bounds(row.cell), "drives": sorted(row.drives)}
    return UnsolvedSquare(**{**row._mapping, **shown}, advice=advice)
