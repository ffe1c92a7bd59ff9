"""Segments as Arrow tables, a bounded number at a time, for the columnar outputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np
import pyarrow as pa
import shapely

from app.map.segment import PROPERTIES, SegmentFeature

GEOMETRY = "geometry"
ROWS_PER_TABLE = 50_000

_TYPES = {
    "id": pa.int64(),
    "osm_way_id": pa.int64(),
    "from_node": pa.int64(),
    "to_node": pa.int64(),
    "length_m": pa.float64(),
    "highway": pa.string(),
    "name": pa.string(),
    "oneway": pa.int16(),
    "bridge": pa.bool_(),
    "tunnel": pa.bool_(),
    "slope_percent": pa.float64(),
    "slope_sigma_percent": pa.float64(),
    "drives": pa.int32(),
    "observations": pa.int32(),
    "dem_slope_percent": pa.float64(),
    "updated_at": pa.timestamp("ms", tz="UTC"),
}
SCHEMA = pa.schema([pa.field(name, _TYPES[name]) for name in PROPERTIES] + [pa.field(GEOMETRY, pa.binary())])
"""The 16 properties in the contract's order, then the line as WKB."""


def arrow_tables(features: Iterable[SegmentFeature], rows: int = ROWS_PER_TABLE) -> Iterator[pa.Table]:
    """Tables of at most ``rows`` rows in order; nothing for no features."""
    source = iter(features)
    while chunk := list(islice(source, rows)):
        yield arrow_table(chunk)


def arrow_table(features: list[SegmentFeature]) -> pa.Table:
    """One table in ``SCHEMA``, rounded as in every output; unknown is null."""
    rows = [feature.properties() for feature in features]
    columns = {name: [row[name] for row in rows] for name in PROPERTIES}
    columns["updated_at"] = [feature.updated_at for feature in features]
    return pa.table({**columns, GEOMETRY: wkb(features)}, schema=SCHEMA)


def wkb(features: list[SegmentFeature]) -> list[bytes]:
    """The lines as well-known binary, little endian."""
    counts = [len(f.coordinates) for f in features]
    points = np.array([p for f in features for p in f.rounded_coordinates()], float).reshape(-1, 2)
    lines = shapely.linestrings(points, indices=np.repeat(np.arange(len(features)), counts))
    return list(shapely.to_wkb(lines, byte_order=1))
