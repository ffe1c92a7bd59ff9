"""Segments with their published slopes out of the database: one, a page of them, a tile, and the drives behind one.

Every statement about what is shown of segments stands here, in full, with its parts in braces. This file knows nothing
of requests and formats; how a segment's properties are read is said in ``app.map.segment``.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

from app.core.caller import seeing_all
from app.core.db import Bounds
from app.core.tables import IS_SHOWN
from app.map.segment import COLUMNS, Segment
from fusion.types import Ints

# What a ``Segment`` is made of, in its order, then its ends.
_SEGMENT_COLUMNS = (
    ", ".join(f"{column.sql} AS {name}" for name, column in COLUMNS.items())
    + ", ST_X(ST_StartPoint(s.geom)) AS lon0, ST_Y(ST_StartPoint(s.geom)) AS lat0"
    + ", ST_X(ST_EndPoint(s.geom)) AS lon1, ST_Y(ST_EndPoint(s.geom)) AS lat1"
)

# A gap's slope comes from the driven segments on both its sides: only who asks for gaps sees it.
_SEGMENTS_AND_GAPS = "segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id"
_SEGMENTS = _SEGMENTS_AND_GAPS + " AND a.drives > 0"

_DRIVEN = {None: "true", True: "a.drives > 0", False: "coalesce(a.drives, 0) = 0"}

_IN_BOX = "ST_Intersects({line}, ST_MakeEnvelope({west}, :south, {east}, :north, 4326))"
_IN_REGION = " AND s.regions @> ARRAY[CAST(:region AS smallint)]"


def in_box_sql(line: str, bbox: Bounds | None) -> str:
    """The condition of lines that meet a box, whose parameters are its ``corners``; None: of all lines.

    A box whose west is east of its east crosses the antimeridian (RFC 7946, section 5.2).
    """
    if bbox is None:
        return "true"
    if bbox[0] <= bbox[2]:
        return _IN_BOX.format(line=line, west=":west", east=":east")
    west, east = (_IN_BOX.format(line=line, west=w, east=e) for w, e in ((":west", "180"), ("-180", ":east")))
    return f"({west} OR {east})"


def corners(bbox: Bounds | None) -> dict[str, float]:
    """The parameters of a statement for a box."""
    return {} if bbox is None else dict(zip(("west", "south", "east", "north"), bbox, strict=True))


def _statement(
    template: str, gaps: bool = False, driven: bool | None = None, bbox: Bounds | None = None, region: int = 0
) -> TextClause:
    """The statement with its parts from the constants above; what a caller gives stays a parameter of it."""
    in_box = in_box_sql("s.geom", bbox) + (_IN_REGION if region else "")
    segments = _SEGMENTS_AND_GAPS if gaps else _SEGMENTS
    return text(
        template.format(columns=_SEGMENT_COLUMNS, segments=segments, driven=_DRIVEN[driven], in_box=in_box)
    )


def _segment(row: Row[Any]) -> Segment:
    """The segment of a row that begins with ``_SEGMENT_COLUMNS``."""
    properties = dict(zip(COLUMNS, row, strict=False))
    return Segment(**properties, coordinates=((row.lon0, row.lat0), (row.lon1, row.lat1)))


_PAGE = """
    SELECT {columns} FROM {segments}
    WHERE s.id > :after_id AND {driven} AND {in_box}
    ORDER BY s.id LIMIT :limit
"""
_COUNT = "SELECT count(*) FROM {segments} WHERE {driven} AND {in_box}"
_ONE = "SELECT {columns} FROM {segments} WHERE s.id = :id"
_EACH = "SELECT {columns} FROM {segments} WHERE s.id = ANY(:ids)"
_OF_WAYS = "SELECT {columns} FROM {segments} WHERE s.osm_way_id = ANY(:ways) ORDER BY s.id"
_WAYS = text("SELECT DISTINCT osm_way_id FROM segments ORDER BY osm_way_id")


PAGE = 5000
"""Segments that ``all_segments`` reads at once."""


def all_segments(
    session: Session,
    bbox: Bounds | None = None,
    *,
    driven: bool | None = None,
    gaps: bool = False,
    region: int | None = None,
) -> Iterator[Segment]:
    """Every segment, by ascending id, page by page, in constant memory.

    ``bbox`` keeps those that meet the box (degrees; west > east: across the antimeridian), ``driven`` those
    that were (True) or were not (False) driven. With ``gaps`` undriven segments between driven ones come with
    the slope that the network gives them, else without one, like all undriven segments. ``region`` keeps those of
    one region, by its number.
    """
    page = _statement(_PAGE, gaps=gaps, driven=driven, bbox=bbox, region=region or 0)
    values: dict[str, Any] = {"after_id": 0, "limit": PAGE, "region": region, **corners(bbox)}
    while rows := [_segment(row) for row in session.execute(page, values)]:
        yield from rows
        values["after_id"] = rows[-1].stored_id


def count_segments(session: Session, *, bbox: Bounds | None = None, driven: bool | None = None) -> int:
    """How many segments ``all_segments`` reaches with these filters. Reads all of them."""
    count = _statement(_COUNT, driven=driven, bbox=bbox)
    return int(session.execute(count, corners(bbox)).scalar_one())


def get_segment(session: Session, segment_id: int, *, gaps: bool = False) -> Segment | None:
    """The segment, or None; ``gaps`` as in ``all_segments``."""
    row = session.execute(_statement(_ONE, gaps=gaps), {"id": segment_id}).one_or_none()
    return None if row is None else _segment(row)


def segments_by_id(session: Session, ids: Sequence[int]) -> list[Segment]:
    """Those of these segments that there are, in any order."""
    return [_segment(row) for row in session.execute(_statement(_EACH), {"ids": list(ids)})]


def segments_of_ways(session: Session, ways: Sequence[int]) -> list[Segment]:
    """All segments of these OpenStreetMap ways, by ascending id."""
    return [_segment(row) for row in session.execute(_statement(_OF_WAYS), {"ways": list(ways)})]


def way_ids(session: Session) -> Ints:
    """The numbers of all OpenStreetMap ways that have segments, ascending."""
    return np.fromiter(session.execute(_WAYS).scalars(), np.int64)


# The drives behind a segment, each with how its estimate was made, and whether any pass of it is accepted. What
# one contributes, 1/percent squared, is nothing where a drive of the network is rejected. A share is one of all drives,
# so all are read, as three columns, whichever page is shown and whoever asks.
_WEIGHED = f"""
    WITH shown AS (
        SELECT e.* FROM drive_segments AS e JOIN drives AS d ON d.id = e.drive_id AND {IS_SHOWN.format("d")}
        WHERE e.segment_id = :id
    ), weighed AS (
        SELECT e.drive_id, e.first_at, h.accepted,
               CASE WHEN h.accepted OR NOT e.in_network THEN e.slope_sigma_percent ^ -2 ELSE 0 END AS information
        FROM shown AS e
        LEFT JOIN (SELECT p.drive_id, d.duplicate_of IS NULL AND p.passes > coalesce(r.passes, 0) AS accepted
                   FROM (SELECT drive_id, count(*) AS passes FROM drive_passes
                         WHERE segment_id = :id
                             AND partition = (SELECT versant_partition(cell) FROM segments WHERE id = :id)
                         GROUP BY drive_id) AS p
                   JOIN drives AS d ON d.id = p.drive_id
                   LEFT JOIN (SELECT drive_id, count(*) AS passes FROM rejected_passes WHERE segment_id = :id
                              GROUP BY drive_id) AS r ON r.drive_id = p.drive_id) AS h ON h.drive_id = e.drive_id
    )
"""  # noqa: S608 - constants
_INFORMATION = text(f"{_WEIGHED} SELECT sum(information) FROM weighed")  # noqa: S608 - constants
_OBSERVATIONS = text(f"""{_WEIGHED}
    , page AS (
        SELECT * FROM weighed
        WHERE CAST(:after_first_at AS timestamptz) IS NULL
            OR (first_at, drive_id) < (CAST(:after_first_at AS timestamptz), CAST(:after_id AS uuid))
        ORDER BY first_at DESC, drive_id DESC LIMIT :limit
    )
    SELECT d.id AS drive_id, d.drive_time, e.slope_percent, e.slope_sigma_percent, e.observations, e.passes,
           e.first_at, e.last_at, e.in_network, h.accepted, p.method, p.options, p.code_version,
           p.road_version_id, p.dem_version_id, p.created_at AS estimated_at,
           coalesce(h.information / nullif(CAST(:information AS float8), 0), 0) AS weight
    FROM page AS h
    JOIN shown AS e ON e.drive_id = h.drive_id
    JOIN drives AS d ON d.id = e.drive_id
    JOIN provenances AS p ON p.id = e.provenance_id
    ORDER BY h.first_at DESC, h.drive_id DESC
""")  # noqa: S608 - constants


def segment_observations(
    session: Session, segment_id: int, *, limit: int = 100, after: tuple[datetime, uuid.UUID] | None = None
) -> Sequence[Row[Any]]:
    """At most ``limit`` of the caller's drives behind a segment's slope, the latest first, each with its share in all.

    ``after``: of the last one before the page, when it came to the segment and its id. Empty for an undriven or
    unknown segment.
    """
    first_at, drive_id = after or (None, None)
    with seeing_all(session):
        information = session.execute(_INFORMATION, {"id": segment_id}).scalar()
    values = {"id": segment_id, "limit": limit, "after_first_at": first_at, "after_id": drive_id}
    return session.execute(_OBSERVATIONS, {**values, "information": information}).all()


@dataclass(frozen=True)
class DriveSegmentRow:
    """One drive's estimate of one segment; ``segment`` carries the combination of all drives.

    ``in_network``: the drive contributes factors, which are solved with all others. ``accepted``: whether any of its
    passes over the segment is accepted; None for a slope-only drive.
    """

    segment: Segment
    slope_percent: float
    slope_sigma_percent: float
    observations: int
    passes: int
    first_at: datetime
    last_at: datetime
    in_network: bool
    accepted: bool | None


# A drive's own estimates beside the combination of all drives.
_OF_DRIVE = _statement("""
    SELECT {columns}, e.slope_percent AS own_slope, e.slope_sigma_percent AS own_sigma,
           e.observations AS own_observations, e.passes, e.first_at, e.last_at, e.in_network, h.accepted
    FROM drive_segments AS e
    JOIN segments AS s ON s.id = e.segment_id
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
    LEFT JOIN (SELECT p.segment_id, bool_and(d.duplicate_of IS NULL) AND count(*) > count(r.pass_id) AS accepted
               FROM drives AS d JOIN drive_constants AS c ON c.drive_id = d.id
               JOIN drive_passes AS p ON p.drive_id = d.id AND p.partition = ANY(c.partitions)
               LEFT JOIN rejected_passes AS r ON r.segment_id = p.segment_id AND r.pass_id = p.id
               WHERE d.id = :drive_id GROUP BY p.segment_id) AS h ON h.segment_id = s.id
    WHERE e.drive_id = :drive_id AND (CAST(:after_first_at AS timestamptz) IS NULL
        OR (e.first_at, s.id) > (CAST(:after_first_at AS timestamptz), CAST(:after_id AS bigint)))
    ORDER BY e.first_at, s.id LIMIT CAST(:limit AS bigint)
""")


def drive_segment_rows(
    session: Session,
    drive_id: uuid.UUID,
    *,
    limit: int | None = None,
    after: tuple[datetime, int] | None = None,
) -> list[DriveSegmentRow]:
    """A drive's estimates in the order of their first observation; at most ``limit``, all where it is None.

    ``after``: first observation and id of the last segment before the page.
    """
    first_at, segment_id = after or (None, None)
    values = {"drive_id": drive_id, "limit": limit, "after_first_at": first_at, "after_id": segment_id}
    own = len(COLUMNS) + 4  # behind what is of the segment, and its ends
    return [DriveSegmentRow(_segment(row), *row[own:]) for row in session.execute(_OF_DRIVE, values)]


FULL_ZOOM = 13
"""From this zoom on tiles show all roads; below, those of GeoJSON only the greater ones and whatever was driven."""

_MOTORWAYS = ("motorway", "trunk", "motorway_link", "trunk_link")
_PRIMARY = (*_MOTORWAYS, "primary", "primary_link")
_TERTIARY = (*_PRIMARY, "secondary", "secondary_link", "tertiary", "tertiary_link")

# A page of the segments of a tile, whole.
_TILE = _statement("""
    SELECT {columns} FROM {segments}
    WHERE s.id > :after_id AND ST_Intersects(s.geom_3857, ST_TileEnvelope(:z, :x, :y))
        AND (CAST(:classes AS text[]) IS NULL OR s.highway = ANY(:classes) OR a.segment_id IS NOT NULL)
    ORDER BY s.id LIMIT :limit
""")


def geojson_tile(
    session: Session,
    z: int,
    x: int,
    y: int,
    *,
    full_zoom: int = FULL_ZOOM,
    after_id: int = 0,
    limit: int = 5000,
) -> list[Segment]:
    """At most ``limit`` of the segments that meet the tile, with an id above ``after_id``, by ascending id.

    They are whole and have all properties. Going on from the last id reaches every segment once.
    """
    values = {"z": z, "x": x, "y": y, "classes": _classes(z, full_zoom), "after_id": after_id, "limit": limit}
    return [_segment(row) for row in session.execute(_TILE, values)]


def _classes(z: int, full_zoom: int) -> list[str] | None:
    """The road classes shown at a zoom whether driven or not; None stands for all."""
    if z >= full_zoom:
        return None
    if z >= 10:
        return list(_TERTIARY)
    return list(_PRIMARY if z >= 8 else _MOTORWAYS)
