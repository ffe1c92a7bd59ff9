"""Road segments and ways with their slopes: the records that are read from the database and written to every file.

Each field states the expression that reads it, the type of its column in a file and its number of digits; the columns
of queries, the properties and the schemas of files follow from that. Nothing here knows the statements
(``app.map.store``) or the files (``app.exports``). Whose data the outputs derive from is said here as well:
OpenStreetMap's licence wants it said wherever the data goes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from types import NoneType
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints
from xml.sax.saxutils import escape

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS, SLOPE_DIGITS, rounded, utc_text

SHARE_DIGITS = 4
CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
"""Longitude and latitude, degrees."""
HEIGHT_DATUM = "mean sea level as the receivers logged it, or the datum of control points near these"
"""What the service's heights refer to. Receivers subtract a geoid of their own, mostly a coarse EGM96."""

Position = tuple[float, float]
"""Longitude, latitude, degrees."""


JSON_TYPES: Mapping[str, tuple[str, str | None]] = {
    "int64": ("integer", "int64"),
    "int32": ("integer", "int32"),
    "int16": ("integer", "int32"),
    "double": ("number", None),
    "string": ("string", None),
    "bool": ("boolean", None),
    "timestamp[ms, tz=UTC]": ("string", "date-time"),
}
"""Arrow's name of a type -> JSON Schema's type and format."""

SQL_TYPES = {
    "integer": "bigint",
    "number": "float8",
    "string": "text",
    "boolean": "boolean",
    "time": "timestamptz",
}
"""How values are sent to the database, by ``Column.kind``."""


@dataclass(frozen=True)
class Column:
    """How a property of a segment is read and written."""

    sql: str
    """The expression that reads it: s is the segment, a what is published of it, which may be missing."""
    arrow: str
    """Its type in columnar files, by Arrow's name."""
    digits: int | None = None
    """Decimal places in every output, for fractions."""

    @property
    def table(self) -> str:
        """The alias of the table that it is read from."""
        return self.sql.partition(".")[0].rpartition("(")[2]

    @property
    def type(self) -> str:
        """In JSON Schema: integer, number, string, boolean."""
        return JSON_TYPES[self.arrow][0]

    @property
    def format(self) -> str | None:
        """In JSON Schema: int32, int64, date-time; None for others."""
        return JSON_TYPES[self.arrow][1]

    @property
    def kind(self) -> str:
        """What values are compared with, one of ``SQL_TYPES``."""
        return "time" if self.format == "date-time" else self.type


class Record:
    """A row with properties and a line: a frozen dataclass whose fields but the line are annotated by a ``Column``."""

    columns: ClassVar[Mapping[str, Column]]
    """By the property's name, in the order of the fields."""
    optional: ClassVar[frozenset[str]]
    """Those that may be None."""
    _digits: ClassVar[Mapping[str, int]]
    id: int | None
    slope_percent: float | None
    steepness_percent: float | None
    """The slope without its sign: however a record is made, the two agree."""
    updated_at: datetime | None
    """When what is published of it last changed; aware."""
    coordinates: tuple[Position, ...]

    def __post_init__(self) -> None:
        slope = self.slope_percent
        object.__setattr__(self, "steepness_percent", None if slope is None else abs(slope))

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        own = {name: hints[name] for name in cls.__annotations__}  # in the order of the fields
        cls.columns = {name: h.__metadata__[0] for name, h in own.items() if get_origin(h) is Annotated}
        cls.optional = frozenset(name for name in cls.columns if NoneType in get_args(own[name].__origin__))
        cls._digits = {name: c.digits for name, c in cls.columns.items() if c.digits is not None}

    def properties(self) -> dict[str, Any]:
        """The properties in their order, rounded, JSON-serialisable; unknown and NaN are None."""
        values = {name: getattr(self, name) for name in self.columns}
        for name, digits in self._digits.items():
            values[name] = rounded(values[name], digits)
        values["updated_at"] = utc_text(self.updated_at)
        return values

    def geometry(self) -> dict[str, Any]:
        """The GeoJSON LineString, from_node first."""
        return {"type": "LineString", "coordinates": [list(p) for p in self.rounded_coordinates()]}

    def rounded_coordinates(self) -> list[Position]:
        """The coordinates at the resolution that files carry."""
        return [
            (round(lon, COORDINATE_DIGITS), round(lat, COORDINATE_DIGITS)) for lon, lat in self.coordinates
        ]

    def geojson(self) -> dict[str, Any]:
        """The GeoJSON Feature (RFC 7946); without an ``id`` member where there is no number."""
        feature: dict[str, Any] = {"type": "Feature"}
        if self.id is not None:
            feature["id"] = self.id
        return feature | {"geometry": self.geometry(), "properties": self.properties()}


@dataclass(frozen=True)
class Segment(Record):
    """A segment and its slope. Unknown is None or NaN here and null in every output, never 0.

    An undriven segment has neither slope nor heights nor ``updated_at``, and counts 0; a gap between driven ones, where
    gaps are asked for, has a slope and counts 0.
    """

    id: Annotated[int | None, Column("s.id", "int64")]
    """The service's number; None outside of a database."""
    osm_way_id: Annotated[int, Column("s.osm_way_id", "int64")]
    from_node: Annotated[int, Column("s.from_node", "int64")]
    to_node: Annotated[int, Column("s.to_node", "int64")]
    length_m: Annotated[float, Column("s.length_m", "double", LENGTH_DIGITS)]
    highway: Annotated[str, Column("s.highway", "string")]
    name: Annotated[str | None, Column("s.name", "string")]
    oneway: Annotated[int, Column("s.oneway", "int16")]
    """1 along the way, -1 against it, 0 both."""
    bridge: Annotated[bool, Column("s.bridge", "bool")]
    tunnel: Annotated[bool, Column("s.tunnel", "bool")]
    slope_percent: Annotated[float | None, Column("a.slope_percent", "double", SLOPE_DIGITS)]
    """Positive uphill from from_node to to_node."""
    slope_sigma_percent: Annotated[float | None, Column("a.slope_sigma_percent", "double", SLOPE_DIGITS)]
    """One standard deviation."""
    drives: Annotated[int, Column("coalesce(a.drives, 0)", "int32")]
    observations: Annotated[int, Column("coalesce(a.observations, 0)", "int32")]
    dem_slope_percent: Annotated[float | None, Column("s.dem_slope_percent", "double", SLOPE_DIGITS)]
    """By the elevation model alone."""
    updated_at: Annotated[datetime | None, Column("a.updated_at", "timestamp[ms, tz=UTC]")]
    """When what is published of it last changed; aware."""
    coordinates: tuple[Position, ...]
    """The line, from_node first; its ends where it comes from the database."""
    height_from_m: Annotated[float | None, Column("a.height_from_m", "double", LENGTH_DIGITS)] = None
    """Of the network's node, which all segments there share; above ``HEIGHT_DATUM`` or what the file states."""
    height_to_m: Annotated[float | None, Column("a.height_to_m", "double", LENGTH_DIGITS)] = None
    height_sigma_m: Annotated[float | None, Column("a.height_sigma_m", "double", LENGTH_DIGITS)] = None
    """One standard deviation, of the less sure end."""
    steepest_percent: Annotated[float | None, Column("a.steepest_percent", "double", SLOPE_DIGITS)] = None
    """Mean grade over the steepest 20 m inside, signed; over the whole segment where it is shorter."""
    steepest_from_m: Annotated[float | None, Column("a.steepest_from_m", "double", LENGTH_DIGITS)] = None
    """Where that begins and ends, from from_node."""
    steepest_to_m: Annotated[float | None, Column("a.steepest_to_m", "double", LENGTH_DIGITS)] = None
    driven_share: Annotated[float | None, Column("a.driven_share", "double", SHARE_DIGITS)] = None
    """Of the length, 0 to 1, over which drives of the network are accepted; unknown with slope-only drives alone."""
    steepness_percent: Annotated[float | None, Column("abs(a.slope_percent)", "double", SLOPE_DIGITS)] = None

    @property
    def stored_id(self) -> int:
        """The service's number of a segment from its database; ValueError for any other segment."""
        if self.id is None:
            raise ValueError("a segment that comes from no database has no number")
        return self.id


@dataclass(frozen=True)
class Way(Record):
    """Consecutive segments of one OpenStreetMap way, as one. Unknown is None."""

    id: Annotated[int, Column("w.id", "int64")]
    """Of its first segment."""
    osm_way_id: Annotated[int, Column("w.osm_way_id", "int64")]
    from_node: Annotated[int, Column("w.from_node", "int64")]
    to_node: Annotated[int, Column("w.to_node", "int64")]
    segments: Annotated[int, Column("w.segments", "int32")]
    length_m: Annotated[float, Column("w.length_m", "double", LENGTH_DIGITS)]
    highway: Annotated[str, Column("w.highway", "string")]
    name: Annotated[str | None, Column("w.name", "string")]
    oneway: Annotated[int, Column("w.oneway", "int16")]
    bridge: Annotated[bool, Column("w.bridge", "bool")]
    tunnel: Annotated[bool, Column("w.tunnel", "bool")]
    slope_percent: Annotated[float | None, Column("w.slope_percent", "double", SLOPE_DIGITS)]
    """Mean over what was measured of it, by length; positive uphill from from_node to to_node."""
    slope_sigma_percent: Annotated[float | None, Column("w.slope_sigma_percent", "double", SLOPE_DIGITS)]
    drives: Annotated[int, Column("w.drives", "int32")]
    observations: Annotated[int, Column("w.observations", "int32")]
    dem_slope_percent: Annotated[float | None, Column("w.dem_slope_percent", "double", SLOPE_DIGITS)]
    updated_at: Annotated[datetime | None, Column("w.updated_at", "timestamp[ms, tz=UTC]")]
    measured_share: Annotated[float, Column("w.measured_share", "double", SHARE_DIGITS)]
    """Of its length, in segments with a slope."""
    steepest_percent: Annotated[float | None, Column("w.steepest_percent", "double", SLOPE_DIGITS)]
    steepest_from_m: Annotated[float | None, Column("w.steepest_from_m", "double", LENGTH_DIGITS)]
    steepest_to_m: Annotated[float | None, Column("w.steepest_to_m", "double", LENGTH_DIGITS)]
    coordinates: tuple[Position, ...]
    steepness_percent: Annotated[float | None, Column("abs(w.slope_percent)", "double", SLOPE_DIGITS)] = None


COLUMNS = Segment.columns
"""The segment properties of the contract, in its order: all fields but the line."""
PROPERTIES = tuple(COLUMNS)


OSM_ATTRIBUTION = "© OpenStreetMap contributors"
OSM_LICENSE = "Open Database License (ODbL) 1.0"
OSM_LICENSE_URL = "https://opendatacommons.org/licenses/odbl/1-0/"
OSM_COPYRIGHT_URL = "https://www.openstreetmap.org/copyright"
MOST_RASTERS = 4
"""An attribution names no more."""


def attribution(dem_names: Iterable[str] = ()) -> str:
    """One line of plain text: OpenStreetMap and its licence, then whose elevation data."""
    roads = f"Roads {OSM_ATTRIBUTION}, {OSM_LICENSE}"
    rasters = _shortened(dem_names)
    return f"{roads}; elevation from {rasters}" if rasters else roads


def attribution_html(dem_names: Iterable[str] = ()) -> str:
    """The same for a map's corner, with a link."""
    roads = f'<a href="{OSM_COPYRIGHT_URL}">{OSM_ATTRIBUTION}</a>'
    rasters = escape(_shortened(dem_names), {'"': "&quot;"})
    return f"{roads}, elevation from {rasters}" if rasters else roads


def _shortened(dem_names: Iterable[str]) -> str:
    names = sorted(set(dem_names))
    rest = len(names) - MOST_RASTERS
    others = f" and {rest} more raster{'s' * (rest > 1)}" if rest > 0 else ""
    return ", ".join(names[:MOST_RASTERS]) + others
