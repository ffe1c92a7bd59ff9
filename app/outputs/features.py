"""One road segment with its slope, as every output shows it: the contract's 16 properties in one order."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

GEO_JSON = "application/geo+json"

COORDINATE_DIGITS = 7  # degrees: OpenStreetMap's own resolution, about 1 cm
LENGTH_DIGITS = 3  # metres
SLOPE_DIGITS = 4  # percent: 1 mm per kilometre, far below any sigma

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


def rounded(value: float | None, digits: int) -> float | None:
    """``value`` rounded; None where it is None, NaN or infinite."""
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits) + 0.0  # -0.0 would print as such


def utc_text(moment: datetime | None) -> str | None:
    """RFC 3339 in UTC, to the millisecond, with a Z; ValueError for a naive time."""
    if moment is None:
        return None
    if moment.tzinfo is None:
        raise ValueError("a time without its zone cannot be written as UTC")
    return moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def dumps(value: Any) -> str:
    """Compact JSON; ValueError for a NaN, which JSON does not have."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def collection_chunks(
    features: Iterable[SegmentFeature], members: dict[str, Any] | None = None
) -> Iterator[str]:
    """The text of a FeatureCollection piece by piece, in constant memory.

    ``members`` are further top-level members such as ``links``; they come before ``features``.
    """
    head = dumps({"type": "FeatureCollection"} | (members or {}))
    yield head[:-1] + ',"features":['
    separator = ""
    for feature in features:
        yield separator + dumps(feature.geojson())
        separator = ",\n"
    yield "]}\n"
