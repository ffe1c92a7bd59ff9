"""Segments as Arrow tables, a bounded number at a time, for the columnar outputs.

Importing this imports pyarrow and shapely, so the outputs do that only when such a file is written.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np
import pyarrow as pa
import shapely

from app.map.segment import COLUMNS, PROPERTIES, Segment
from fusion.types import Floats

GEOMETRY = "geometry"
ROWS_PER_TABLE = 50_000

_TIME = pa.timestamp("ms", tz="UTC")  # a type with a parameter, so no name stands for it


def _type(name: str) -> pa.DataType:
    return _TIME if name == str(_TIME) else pa.type_for_alias(name)


SCHEMA = pa.schema(
    [pa.field(name, _type(column.arrow)) for name, column in COLUMNS.items()]
    + [pa.field(GEOMETRY, pa.binary())]
)
"""The properties in the contract's order, then the line as WKB."""


def arrow_tables(segments: Iterable[Segment], rows: int = ROWS_PER_TABLE) -> Iterator[pa.Table]:
    """Tables of at most ``rows`` rows in order; nothing for no segments."""
    source = iter(segments)
    while chunk := list(islice(source, rows)):
        yield arrow_table(chunk)


def arrow_table(segments: list[Segment]) -> pa.Table:
    """One table in ``SCHEMA``, rounded as in every output; unknown is null."""
    rows = [segment.properties() for segment in segments]
    columns = {name: [row[name] for row in rows] for name in PROPERTIES}
    columns["updated_at"] = [segment.updated_at for segment in segments]
    return pa.table({**columns, GEOMETRY: wkb(segments)}, schema=SCHEMA)


def bounds_deg(table: pa.Table) -> Floats:
    """West, south, east, north of a table's lines, shape (4,)."""
    bounds: Floats = shapely.total_bounds(shapely.from_wkb(table[GEOMETRY].to_numpy()))
    return bounds


def wkb(segments: list[Segment]) -> list[bytes]:
    """The lines as well-known binary, little endian."""
    counts = [len(s.coordinates) for s in segments]
    points = np.array([p for s in segments for p in s.rounded_coordinates()], float).reshape(-1, 2)
    lines = shapely.linestrings(points, indices=np.repeat(np.arange(len(segments)), counts))
    return list(shapely.to_wkb(lines, byte_order=1))
