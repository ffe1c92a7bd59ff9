"""What a file is a table of: road segments, or whole ways, each record with its properties and its line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Protocol, get_origin, get_type_hints

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS, SLOPE_DIGITS, rounded, utc_text
from app.map.segment import COLUMNS, SHARE_DIGITS, Column, Position


class Record(Protocol):
    """A row of a layer."""

    @property
    def coordinates(self) -> tuple[Position, ...]:
        """The line."""
        ...

    @property
    def updated_at(self) -> datetime | None:
        """When what is said of it last changed; aware."""
        ...

    def properties(self) -> dict[str, Any]:
        """The properties in the layer's order, rounded; unknown is None."""
        ...

    def rounded_coordinates(self) -> list[Position]:
        """The coordinates at the resolution that outputs carry."""
        ...


@dataclass(frozen=True)
class Way:
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

    def properties(self) -> dict[str, Any]:
        """As of ``Segment``."""
        values = {name: getattr(self, name) for name in WAY_COLUMNS}
        for name, column in WAY_COLUMNS.items():
            if column.digits is not None:
                values[name] = rounded(values[name], column.digits)
        values["updated_at"] = utc_text(self.updated_at)
        return values

    def rounded_coordinates(self) -> list[Position]:
        """As of ``Segment``."""
        return [
            (round(lon, COORDINATE_DIGITS), round(lat, COORDINATE_DIGITS)) for lon, lat in self.coordinates
        ]


@dataclass(frozen=True)
class Layer:
    """A table of records of one kind."""

    name: str
    title: str
    columns: Mapping[str, Column]


def _way_columns() -> dict[str, Column]:
    hints = get_type_hints(Way, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated}


WAY_COLUMNS = _way_columns()
SEGMENTS = Layer("segments", "Slopes of road segments", COLUMNS)
WAYS = Layer("ways", "Slopes of whole ways", WAY_COLUMNS)
