"""Places and times in requests: reference systems, boxes, geometries of filters, as conditions on a line in degrees;
``datetime`` of OGC API Features, and what CQL2 writes as dates, timestamps and intervals.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from app.core.db import Bounds
from app.core.errors import BadQueryError
from app.core.messages import say
from app.core.query import bbox_numbers, box_of
from app.map.segment import CRS84 as CRS84_URI
from app.map.store import corners, in_box_sql

RADIUS_M = 6_378_137.0
EDGE_M = math.pi * RADIUS_M
"""How far web Mercator reaches."""
_PLACEHOLDER = re.compile(r"(?<!:):(\w+)")

MOST_POINTS = 5000
"""Of a geometry in a filter."""


@dataclass(frozen=True)
class Crs:
    """A reference system in which places are asked for and answered."""

    uri: str
    srid: int
    digits: int
    """Decimal places of coordinates."""
    latitude_first: bool = False

    def to_degrees(self, x: float, y: float) -> tuple[float, float]:
        """Longitude and latitude of a place in this system's order of axes."""
        if self.srid == CRS84.srid:
            return (y, x) if self.latitude_first else (x, y)
        # What lies a hair beyond the edge was rounded.
        if not (abs(x) <= EDGE_M * (1 + 1e-9) and abs(y) <= 1.1 * EDGE_M):
            raise ValueError(say("items.off_the_map", x=x, y=y, edge_m=EDGE_M))
        lon = math.degrees(x / RADIUS_M)
        return max(-180.0, min(180.0, lon)), math.degrees(math.atan(math.sinh(y / RADIUS_M)))


CRS84 = Crs(CRS84_URI, 4326, 7)
EPSG4326 = Crs("http://www.opengis.net/def/crs/EPSG/0/4326", 4326, 7, latitude_first=True)
EPSG3857 = Crs("http://www.opengis.net/def/crs/EPSG/0/3857", 3857, 3)
CRSS: Mapping[str, Crs] = {one.uri: one for one in (CRS84, EPSG4326, EPSG3857)}
"""Address -> system; the first is the default and that of storage."""


@dataclass(frozen=True)
class Condition:
    """A condition in SQL with psycopg's placeholders, and their values."""

    sql: str
    values: Mapping[str, Any]

    @classmethod
    def joined(cls, word: str, parts: Iterable[Condition]) -> Condition:
        """These conditions with a word between them, ``AND`` or ``OR``; without any: true."""
        some = list(parts)
        values = {name: value for one in some for name, value in one.values.items()}
        return cls(f" {word} ".join(one.sql for one in some) or "true", values)


def parse_crs(text: str, field: str) -> Crs:
    """The system of this address; ``BadQueryError`` that lists them all for any other."""
    if text not in CRSS:
        raise BadQueryError.about(field, say("items.no_crs", name=text, names=", ".join(CRSS)))
    return CRSS[text]


def parse_box(text: str, crs: Crs) -> Bounds:
    """West, south, east, north in degrees of a box in a system; west > east crosses the antimeridian.

    Raises ``BadQueryError``.
    """
    x0, y0, x1, y1 = bbox_numbers(text)
    try:
        west, south = crs.to_degrees(x0, y0)
        east, north = crs.to_degrees(x1, y1)
    except ValueError as error:
        raise BadQueryError.about("bbox", say("filter.reason", reason=error)) from None
    return box_of(west, south, east, north)


def in_box(line: str, box: Bounds) -> Condition:
    """The lines that meet a box."""
    return Condition(psycopg_sql(in_box_sql(line, box)), corners(box))


def psycopg_sql(sql: str) -> str:
    """A part of a statement with psycopg's placeholders in place of SQLAlchemy's."""
    return _PLACEHOLDER.sub(r"%(\1)s", sql)


def wkb_of(node: Mapping[str, Any], crs: Crs) -> bytes:
    """A geometry of a filter (GeoJSON, or ``{"bbox": [...]}``) in degrees, longitude first, as well-known binary.

    Raises ``ValueError`` that says what is wrong with it.
    """
    import shapely  # noqa: PLC0415 - it costs every start, and few filters have a geometry
    from shapely.geometry import shape  # noqa: PLC0415

    if "bbox" in node:
        return bytes(shapely.to_wkb(_boxes(node["bbox"], crs)))
    if node.get("type") not in _GEOMETRIES:
        raise ValueError(say("items.no_geometry", name=node.get("type"), names=", ".join(_GEOMETRIES)))
    try:
        geometry = shapely.force_2d(shape(node))
        points = shapely.get_coordinates(geometry)
    except (ValueError, TypeError, IndexError, KeyError, AttributeError, shapely.errors.ShapelyError):
        raise ValueError(say("items.bad_geometry", kind=node["type"])) from None
    if not 0 < len(points) <= MOST_POINTS:
        raise ValueError(say("items.points", n=len(points), most=MOST_POINTS))
    placed = [_checked(*crs.to_degrees(float(x), float(y))) for x, y in points]
    geometry = shapely.set_coordinates(geometry, placed)
    if not geometry.is_valid:
        raise ValueError(say("items.not_valid", reason=shapely.is_valid_reason(geometry)))
    return bytes(shapely.to_wkb(geometry))


_GEOMETRIES = ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon")


def _checked(lon: float, lat: float) -> tuple[float, float]:
    if not (abs(lon) <= 180 and abs(lat) <= 90):
        raise ValueError(say("items.no_lon_lat", lon=lon, lat=lat))
    return lon, lat


def _boxes(numbers: Any, crs: Crs) -> Any:
    from shapely.geometry import MultiPolygon, box  # noqa: PLC0415

    west, south, east, north = parse_box(",".join(str(number) for number in numbers), crs)
    if west <= east:
        return box(west, south, east, north)
    return MultiPolygon([box(west, south, 180.0, north), box(-180.0, south, east, north)])


OPEN = ".."
Span = tuple[datetime | None, datetime | None]
"""First and last moment, both included; None: open."""

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}", re.ASCII)
_TIME = re.compile(r"\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}:\d{2}(\.\d{1,9})?(Z|[+-]\d{2}:\d{2})", re.ASCII)
_MICROSECOND = timedelta(microseconds=1)
_SECONDS = re.compile(r":\d{2}:\d{2}\.(\d{4,})")


def moment(text: str) -> datetime:
    """The moment of a time of RFC 3339, or the first of a date in UTC; ``ValueError`` for anything else."""
    upper = text.strip().upper()
    if _DATE.fullmatch(upper):
        return datetime.fromisoformat(upper).replace(tzinfo=UTC)
    if not _TIME.fullmatch(upper):
        raise ValueError(say("items.no_time", text=text))
    try:
        return datetime.fromisoformat(upper).astimezone(UTC)
    except (ValueError, OverflowError):
        raise ValueError(say("items.no_day", text=text)) from None


def span(text: str) -> Span:
    """First and last moment of a time as it is written: a date is a day, a time what its digits leave open.

    Times are served in milliseconds and kept in microseconds, so that a time that was read here means the millisecond.
    """
    first = moment(text)
    if _DATE.fullmatch(text.strip()):
        return first, first + timedelta(days=1) - _MICROSECOND
    finest = _MICROSECOND if _SECONDS.search(text) else timedelta(milliseconds=1)
    return first, first + finest - _MICROSECOND


def interval(first: str, last: str) -> Span:
    """From one time to another, each of which may be ``..`` or nothing; ``ValueError`` if it ends before it begins."""
    start = None if first in {"", OPEN} else span(first)[0]
    end = None if last in {"", OPEN} else span(last)[1]
    if start is not None and end is not None and end < start:
        raise ValueError(say("items.ends_before", first=first, last=last))
    return start, end


def parse_datetime(text: str) -> Span:
    """What ``datetime`` asks for; ``BadQueryError`` for what is neither time nor interval."""
    try:
        parts = text.split("/")
        if len(parts) > 2:
            raise ValueError(say("items.ends"))
        if len(parts) == 2 and all(part in {"", OPEN} for part in parts):
            raise ValueError(say("items.one_end"))
        return span(text) if len(parts) == 1 else interval(*parts)
    except (ValueError, OverflowError) as error:
        raise BadQueryError.about("datetime", say("items.datetime", reason=error)) from None
