"""What every route needs: the service's parts, links that work from outside, conditional answers."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS, SLOPE_DIGITS, rounded, utc_text


def feature_of(row: SegmentRow) -> SegmentFeature:
    """A row of the store as what the outputs write."""
    return SegmentFeature(**vars(row))


PROPERTIES = (
    "id",
    "osm_way_id",
    "from_node",
    "to_node",
    "length_m",
    "highway",
    "name",
    "oneway",
    "bridge",
    "tunnel",
    "slope_percent",
    "slope_sigma_percent",
    "drives",
    "observations",
    "dem_slope_percent",
    "updated_at",
)
"""The segment properties of the contract, in its order."""

Position = tuple[float, float]


@dataclass(frozen=True)
class SegmentFeature:
    """A segment and its slope. Unknown is None or NaN here and null in every output, never 0.

    ``id`` is the service's number (None outside a database), ``coordinates`` are (longitude, latitude) pairs
    in degrees from from_node to to_node, ``oneway`` is 1 along the way, -1 against it, 0 both. Slopes and
    sigma are in percent, positive uphill from from_node to to_node; ``updated_at`` is aware.
    """

    id: int | None
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
    coordinates: tuple[Position, ...]

    def properties(self) -> dict[str, Any]:
        """The 16 properties in the contract's order, rounded, JSON-serialisable; NaN is None."""
        return {
            "id": self.id,
            "osm_way_id": self.osm_way_id,
            "from_node": self.from_node,
            "to_node": self.to_node,
            "length_m": rounded(self.length_m, LENGTH_DIGITS),
            "highway": self.highway,
            "name": self.name,
            "oneway": self.oneway,
            "bridge": self.bridge,
            "tunnel": self.tunnel,
            "slope_percent": rounded(self.slope_percent, SLOPE_DIGITS),
            "slope_sigma_percent": rounded(self.slope_sigma_percent, SLOPE_DIGITS),
            "drives": self.drives,
            "observations": self.observations,
            "dem_slope_percent": rounded(self.dem_slope_percent, SLOPE_DIGITS),
            "updated_at": utc_text(self.updated_at),
        }

    def geometry(self) -> dict[str, Any]:
        """The GeoJSON LineString, from_node first."""
        return {"type": "LineString", "coordinates": [list(p) for p in self.rounded_coordinates()]}

    def rounded_coordinates(self) -> list[Position]:
        """The coordinates at the resolution that outputs carry."""
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
