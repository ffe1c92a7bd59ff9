"""What a file is a table of: road segments, or whole ways, each record with its properties and its line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated

from app.core.text import LENGTH_DIGITS, SLOPE_DIGITS
from app.map.segment import SHARE_DIGITS, Column, Position, Record, Segment


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


@dataclass(frozen=True)
class Layer:
    """A table of records of one kind."""

    name: str
    title: str
    columns: Mapping[str, Column]


SEGMENTS = Layer("segments", "Slopes of road segments", Segment.columns)
WAYS = Layer("ways", "Slopes of whole ways", Way.columns)
