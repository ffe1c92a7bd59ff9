"""Which roads are stored: the import that brought them, how far they reach, and the regions that they belong to.

A region is roads that came from one file and are updated by the next. A segment may be in several.

The roads themselves are read by ``app.network.extracts``, and written by ``app.roads.imports``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.messages import say
from fusion.errors import RoadsError

_EXTENT = text("""
    SELECT ST_XMin(e), ST_YMin(e), ST_XMax(e), ST_YMax(e) FROM (SELECT ST_Extent(geom) AS e FROM segments) AS x
""")

_CROWDED = text("SELECT cell, count(*) FROM segments GROUP BY cell")


def road_extent(session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Reads the whole table."""
    west, south, east, north = session.execute(_EXTENT).one()
    return None if west is None else (float(west), float(south), float(east), float(north))


def road_crowds(session: Session) -> dict[int, int]:
    """How many segments have their middle in each cell of the map that has any."""
    return {int(cell): int(count) for cell, count in session.execute(_CROWDED)}


# The whole network is as it was until the import has ended.
_BEGIN = text("""
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added, length_m, region)
    SELECT :source_name, :sha256, coalesce(last.segments, 0), 0, 0, 0, 0,
           CASE WHEN last.id IS NULL THEN 0 ELSE last.length_m END, :region
    FROM (SELECT 1) AS one LEFT JOIN (SELECT * FROM road_versions ORDER BY id DESC LIMIT 1) AS last ON true
    RETURNING id, imported_at
""")
_END = text("""
    UPDATE road_versions
    SET kept = :kept, moved = :moved, dropped = :dropped, added = :added, imported_at = clock_timestamp(),
        segments = whole.segments, length_m = whole.length_m
    FROM (SELECT count(*) AS segments, coalesce(sum(length_m), 0) AS length_m FROM segments) AS whole
    WHERE id = :id
""")
# The planner must not go by the figures of an empty table until autovacuum comes round.
_ANALYZE = text("ANALYZE segments")
_ROAD_TAG = text("SELECT max(id), max(imported_at) FROM road_versions")
_CURRENT = text("""
    SELECT id, source_name, sha256, imported_at, segments, kept, moved, dropped, added
    FROM road_versions ORDER BY id DESC LIMIT 1
""")


def current_road_version(session: Session) -> Row[Any] | None:
    """The last import, by the names of columns in ``_CURRENT``; None before the first."""
    return session.execute(_CURRENT).one_or_none()


def road_tag(session: Session) -> tuple[object, ...]:
    """Is another when an import has begun, and another again when it has ended."""
    return tuple(session.execute(_ROAD_TAG).one())


def begin_version(session: Session, source_name: str, sha256: str, region: str) -> tuple[int, datetime]:
    """Note that an import begins; its number, and when that was by the database's clock."""
    values = {"source_name": source_name, "sha256": sha256, "region": region}
    row = session.execute(_BEGIN, values).one()
    return int(row.id), row.imported_at


def end_version(session: Session, version_id: int, **counts: int) -> None:
    """Note what the import did (``kept``, ``moved``, ``dropped``, ``added``), and how large the network is now.

    Reads the whole table.
    """
    session.execute(_END, {"id": version_id, **counts})
    session.execute(_ANALYZE)


LONGEST_NAME = 100
_SUFFIXES = re.compile(r"(\.(osm|pbf|osc|gz|bz2|xml|o5m))+$", re.IGNORECASE)
_UNUSUAL = re.compile(r"[^\w.-]+")


@dataclass(frozen=True)
class Region:
    """A region as its last import left it; ``file`` is what changes are applied to, where it is kept."""

    id: int
    name: str
    source_name: str
    sha256: str
    imported_at: datetime
    segments: int
    file_uri: str | None
    file_sha256: str | None
    bounds: list[float] | None
    """West, south, east, north of its roads, degrees"""


@dataclass(frozen=True)
class RegionFigures:
    """What a list of regions says of one."""

    name: str
    source_name: str
    imported_at: datetime
    segments: int
    measured: int
    """Segments on which any drive has measured anything"""


_COLUMNS = "id, name, source_name, sha256, imported_at, segments, file_uri, file_sha256, bounds"
_FIND = text(f"SELECT {_COLUMNS} FROM regions WHERE name = :name")  # noqa: S608 - constants
_ALL = text(f"SELECT {_COLUMNS} FROM regions ORDER BY name")  # noqa: S608 - constants
_MAKE = text("""
    INSERT INTO regions (name, source_name, sha256, road_version_id, segments)
    VALUES (:name, :source_name, :sha256, :version, 0) RETURNING id
""")
_NOTE = text("""
    UPDATE regions SET source_name = :name, sha256 = :sha256, road_version_id = :version,
        segments = :segments, imported_at = clock_timestamp(), file_uri = :file_uri, file_sha256 = :file_sha256,
        bounds = CAST(:bounds AS float8[])
    WHERE id = :id
""")
_REGION_EXTENT = text("""
    SELECT ST_XMin(e), ST_YMin(e), ST_XMax(e), ST_YMax(e)
    FROM (SELECT ST_Extent(geom) AS e FROM segments WHERE regions @> ARRAY[CAST(:id AS smallint)]) AS x
""")
_REMOVE = text("DELETE FROM regions WHERE id = :id")
# Of what is published: a look at each driven segment, not at what each drive says of it.
_DRIVEN = text("""
    SELECT r.name, count(*) FROM segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id
    CROSS JOIN LATERAL unnest(s.regions) AS of_region JOIN regions AS r ON r.id = of_region
    WHERE a.drives > 0 GROUP BY r.name
""")
_FIGURES = text("""
    SELECT r.name, r.source_name, r.imported_at, r.segments, coalesce(m.measured, 0) AS measured
    FROM regions AS r LEFT JOIN (
        SELECT region, count(*) AS measured
        FROM (SELECT DISTINCT segment_id FROM drive_segments) AS e
        JOIN segments AS s ON s.id = e.segment_id, unnest(s.regions) AS region
        GROUP BY region) AS m ON m.region = r.id
    ORDER BY r.name
""")


def region_name(file_name: str) -> str:
    """The name of a file's region: the file's own in small letters, without what tells its format."""
    plain = _UNUSUAL.sub("-", _SUFFIXES.sub("", file_name)).lower()
    return plain[:LONGEST_NAME] or "roads"


def check_name(name: str) -> str:
    """The name, as given; ``RoadsError`` for one that cannot be a region's."""
    if not name or len(name) > LONGEST_NAME or _UNUSUAL.search(name):
        raise RoadsError(say("roads.region_name", most=LONGEST_NAME, name=name))
    return name


def find_region(session: Session, name: str) -> Region | None:
    """The region of this name."""
    row = session.execute(_FIND, {"name": name}).one_or_none()
    return None if row is None else Region(**row._mapping)


def all_regions(session: Session) -> list[Region]:
    """Every region, by name."""
    return [Region(**row._mapping) for row in session.execute(_ALL)]


def known_region(session: Session, name: str) -> Region:
    """The region of this name; ``RoadsError`` where there is none, with those that there are."""
    if (region := find_region(session, name)) is None:
        names = [one.name for one in all_regions(session)]
        there = say("roads.there_are", names=", ".join(names)) if names else say("roads.none_yet")
        raise RoadsError(say("roads.no_region", name=name, there=there))
    return region


def changed_region(session: Session, name: str | None, file_name: str) -> Region:
    """The region that a file of changes is for: the one that is named, that of the file's name, or the only one."""
    names = [one.name for one in all_regions(session)]
    guess = region_name(file_name) if len(names) != 1 or region_name(file_name) in names else names[0]
    if name is None and guess not in names:
        there = ", ".join(names) or "there is none yet"
        raise RoadsError(say("roads.changes_of_which", file=file_name, there=there))
    return known_region(session, guess if name is None else name)


def region_extent(session: Session, region_id: int) -> Bounds:
    """West, south, east, north of a region's segments, degrees."""
    west, south, east, north = session.execute(_REGION_EXTENT, {"id": region_id}).one()
    return float(west), float(south), float(east), float(north)


def make_region(session: Session, name: str, source_name: str, sha256: str, version: int) -> int:
    """Begin a region; its number."""
    values = {"name": name, "source_name": source_name, "sha256": sha256, "version": version}
    return int(session.execute(_MAKE, values).scalar_one())


def note_import(session: Session, region_id: int, **columns: Any) -> None:
    """Note what an import brought: ``name`` and ``sha256`` of the file, ``version``, ``segments``, ``file_uri``,
    ``file_sha256``, ``bounds``."""
    session.execute(_NOTE, {"id": region_id, **columns})


def forget_region(session: Session, region_id: int) -> None:
    """Delete the region, which has no segments any more."""
    session.execute(_REMOVE, {"id": region_id})


def driven_by_region(session: Session) -> dict[str, int]:
    """How many segments of each region were driven, those of which any was. Reads all that is published."""
    return {row[0]: row[1] for row in session.execute(_DRIVEN)}


def region_figures(session: Session) -> Sequence[RegionFigures]:
    """All regions by name. Reads all estimates."""
    return [RegionFigures(**row._mapping) for row in session.execute(_FIGURES)]
