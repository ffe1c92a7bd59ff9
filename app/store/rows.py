"""What the store returns: plain frozen rows, detached from any session."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from fusion.roads.table import RoadTable
from fusion.types import Ints, Track

Bounds = tuple[float, float, float, float]
"""(west, south, east, north), degrees."""


@dataclass(frozen=True)
class DriveRow:
    """A drive as it stands. ``stage`` of a failed drive is the stage in which it failed."""

    id: uuid.UUID
    sha256: str
    filename: str
    size_bytes: int
    blob_key: str
    status: str
    stage: str | None
    progress: float
    failure_kind: str | None
    failure_reason: str | None
    failure_where: str | None
    method: str
    options: dict[str, Any]
    generation: int
    report: dict[str, Any] | None
    bounds: Bounds | None
    epochs: int | None
    distance_m: float | None
    drive_time: datetime | None
    created_at: datetime
    queued_at: datetime
    started_at: datetime | None
    finished_at: datetime | None


class DrivePlace(NamedTuple):
    """A place in the list of drives, whether or not the drive is still there."""

    created_at: datetime
    id: uuid.UUID


@dataclass(frozen=True)
class SegmentRow:
    """A segment with its combined slope; undriven: slope, sigma and ``updated_at`` None, counts 0.

    A gap between driven segments, where gaps are asked for, has a slope and counts 0.
    ``coordinates`` are ((lon, lat) of from_node, (lon, lat) of to_node), degrees; ``oneway`` is 1 along the
    way, -1 against it, 0 both.
    """

    id: int
    osm_way_id: int
    from_node: int
    to_node: int
    length_m: float
    highway: str
    name: str | None
    oneway: int
    bridge: bool
    tunnel: bool
    slope_percent: float | None
    slope_sigma_percent: float | None
    drives: int
    observations: int
    dem_slope_percent: float | None
    updated_at: datetime | None
    coordinates: tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class DriveSegmentRow:
    """One drive's estimate of one segment; ``segment`` carries the combination of all drives.

    ``in_network`` and ``accepted``: as in ``ObservationRow``.
    """

    segment: SegmentRow
    slope_percent: float
    slope_sigma_percent: float
    observations: int
    passes: int
    first_at: datetime
    last_at: datetime
    in_network: bool
    accepted: bool | None


@dataclass(frozen=True)
class ObservationRow:
    """One drive behind a segment's slope, with the provenance of its estimate.

    ``in_network``: the drive contributes factors, which are solved with all others. ``accepted``: whether any
    of its passes over the segment is heard; None for a slope-only drive. ``weight`` is its share in the slope,
    0 to 1, by the inverse variance of its own estimate.
    """

    drive_id: uuid.UUID
    drive_time: datetime | None
    slope_percent: float
    slope_sigma_percent: float
    observations: int
    passes: int
    first_at: datetime
    last_at: datetime
    in_network: bool
    accepted: bool | None
    weight: float
    method: str
    options: dict[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None
    estimated_at: datetime


@dataclass(frozen=True)
class RoadVersionRow:
    """One import of the road network."""

    id: int
    source_name: str
    sha256: str
    imported_at: datetime
    segments: int
    kept: int
    moved: int
    dropped: int
    added: int


@dataclass(frozen=True)
class StoredRoads:
    """An extract of one road version; ``ids`` holds the database's id of each row, shape (n,)."""

    version_id: int
    table: RoadTable
    ids: Ints


@dataclass(frozen=True)
class ImportCounts:
    """What a road import did: ``kept + moved + added`` is the size of the new network.

    ``measured_lost`` segments lose what ``drives_affected`` drives had measured on them: moved and dropped ones,
    and such as were measured in dependence on one of those.
    ``skipped`` counts, by reason, the node pairs of the file that are no segment (``RoadTable.skipped``).
    """

    kept: int
    moved: int
    dropped: int
    added: int
    measured_lost: int = 0
    drives_affected: int = 0
    skipped: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class DemSet:
    """The active elevation rasters; ``paths`` are on this machine's disk."""

    version_id: int
    datum: str
    imported_at: datetime
    names: tuple[str, ...]
    paths: tuple[Path, ...]


@dataclass(frozen=True)
class StoredTrack:
    """A drive's track; ``segment_id`` is the database's id of the matched segment, -1 where unmatched.

    ``track.segment`` holds the same ids. A segment that a later road import dropped keeps its id here.
    """

    track: Track
    segment_id: Ints


@dataclass(frozen=True)
class AdminStats:
    """Figures for operators. Days are UTC dates of the upload, oldest first."""

    drives_by_status: dict[str, int]
    drives_by_day: list[dict[str, Any]]
    """``{"day": date, "status": str, "drives": int}`` for each day and status of the last ``days`` days."""
    queue_depth: int
    queue_oldest_wait_s: float | None
    running: int
    failures_by_kind: dict[str, int]
    driven_km_by_highway: dict[str, float]
    """Length of distinct segments with an estimate, kilometres."""
    network_km: float
    segments: int
    segments_driven: int
    drives: int
    driven_distance_km: float
    """Sum over the drives, counting a road as often as it was driven."""
    uploaded_bytes: int
    data_version: int
    road_version: RoadVersionRow | None
    dem_version_id: int | None
