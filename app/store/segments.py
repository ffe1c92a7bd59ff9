"""Reading segments: one, by box, by drive, and the drives behind one."""

from __future__ import annotations

import uuid
from dataclasses import fields
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.store.rows import Bounds, DriveSegmentRow, ObservationRow, SegmentRow

_PROPERTIES = tuple(spec.name for spec in fields(SegmentRow) if spec.name != "coordinates")

# What a SegmentRow is made of, in its order, then its ends; the tables are called s (segments) and a
# (segment_slopes, may be missing).
SEGMENT_COLUMNS = """
    s.id, s.osm_way_id, s.from_node, s.to_node, s.length_m, s.highway, s.name, s.oneway, s.bridge, s.tunnel,
    a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0) AS drives,
    coalesce(a.observations, 0) AS observations, s.dem_slope_percent, a.updated_at,
    ST_X(ST_StartPoint(s.geom)) AS lon0, ST_Y(ST_StartPoint(s.geom)) AS lat0,
    ST_X(ST_EndPoint(s.geom)) AS lon1, ST_Y(ST_EndPoint(s.geom)) AS lat1
"""
FROM_SEGMENTS = " FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id "

_IN_BOX = " AND ST_Intersects(s.geom, ST_MakeEnvelope(:west, :south, :east, :north, 4326))"

# A box whose west is east of its east crosses the antimeridian (RFC 7946, section 5.2).
_IN_BOX_ACROSS = (
    " AND (ST_Intersects(s.geom, ST_MakeEnvelope(:west, :south, 180, :north, 4326))"
    " OR ST_Intersects(s.geom, ST_MakeEnvelope(-180, :south, :east, :north, 4326)))"
)
_DRIVEN = {None: "", True: " AND a.segment_id IS NOT NULL", False: " AND a.segment_id IS NULL"}


def segment_items(
    session: Session,
    *,
    bbox: Bounds | None = None,
    after_id: int = 0,
    limit: int = 100,
    driven: bool | None = None,
) -> list[SegmentRow]:
    """At most ``limit`` segments with an id above ``after_id``, by ascending id.

    ``bbox`` keeps those that meet the box (degrees; west > east: across the antimeridian), ``driven`` those
    with (True) or without (False) an estimate. Going on from the last id reaches every segment once.
    """
    where, values = _filters(bbox, driven)
    query = "SELECT" + SEGMENT_COLUMNS + FROM_SEGMENTS + "WHERE s.id > :after_id" + where
    query += " ORDER BY s.id LIMIT :limit"
    found = session.execute(text(query), {"after_id": after_id, "limit": limit, **values})
    return [segment_row(row) for row in found]


def count_segments(session: Session, *, bbox: Bounds | None = None, driven: bool | None = None) -> int:
    """How many segments ``segment_items`` reaches with these filters. Reads all of them."""
    where, values = _filters(bbox, driven)
    query = "SELECT count(*)" + FROM_SEGMENTS + "WHERE true" + where
    return int(session.execute(text(query), values).scalar_one())


def get_segment(session: Session, segment_id: int) -> SegmentRow | None:
    """The segment, or None."""
    query = text("SELECT" + SEGMENT_COLUMNS + FROM_SEGMENTS + "WHERE s.id = :id")
    row = session.execute(query, {"id": segment_id}).one_or_none()
    return None if row is None else segment_row(row)


def segment_observations(session: Session, segment_id: int) -> list[ObservationRow]:
    """The drives behind a segment's slope, latest drive first; empty for an undriven or unknown segment."""
    return [ObservationRow(**row._mapping) for row in session.execute(_OBSERVATIONS, {"id": segment_id})]


def drive_segment_rows(session: Session, drive_id: uuid.UUID) -> list[DriveSegmentRow]:
    """A drive's estimates in the order of their first observation."""
    return [
        DriveSegmentRow(
            segment=segment_row(row),
            slope_percent=row.own_slope,
            slope_sigma_percent=row.own_sigma,
            observations=row.own_observations,
            passes=row.passes,
            first_at=row.first_at,
            last_at=row.last_at,
        )
        for row in session.execute(_OF_DRIVE, {"drive_id": drive_id})
    ]


def segment_row(row: Row[Any]) -> SegmentRow:
    """The row that ``SEGMENT_COLUMNS`` selected; further columns are ignored."""
    ends = ((row.lon0, row.lat0), (row.lon1, row.lat1))
    return SegmentRow(**dict(zip(_PROPERTIES, row, strict=False)), coordinates=ends)


# The drives behind a segment, each with how its estimate was made.
_OBSERVATIONS = text(
    """
    SELECT d.id AS drive_id, d.drive_time, e.slope_percent, e.slope_sigma_percent, e.observations, e.passes,
           e.first_at, e.last_at, p.method, p.options, p.code_version, p.road_version_id, p.dem_version_id,
           p.created_at AS estimated_at
    FROM drive_segments AS e
    JOIN drives AS d ON d.id = e.drive_id
    JOIN provenances AS p ON p.id = e.provenance_id
    WHERE e.segment_id = :id
    ORDER BY e.first_at DESC, d.id
    """
)

# A drive's own estimates beside the combination of all drives.
_OF_DRIVE = text(
    "SELECT"
    + SEGMENT_COLUMNS
    + """, e.slope_percent AS own_slope, e.slope_sigma_percent AS own_sigma,
    e.observations AS own_observations, e.passes, e.first_at, e.last_at
    FROM drive_segments AS e
    JOIN segments AS s ON s.id = e.segment_id
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id
    WHERE e.drive_id = :drive_id
    ORDER BY e.first_at, s.id
    """
)


def _filters(bbox: Bounds | None, driven: bool | None) -> tuple[str, dict[str, float]]:
    where = _DRIVEN[driven]
    if bbox is None:
        return where, {}
    west, south, east, north = bbox
    box = _IN_BOX if west <= east else _IN_BOX_ACROSS
    return where + box, {"west": west, "south": south, "east": east, "north": north}
