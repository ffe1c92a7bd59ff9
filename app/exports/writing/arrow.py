"""Segments, or ways, as Arrow tables, a bounded number at a time, for the columnar outputs and for GDAL's.

Importing this imports pyarrow and shapely, so the outputs do that only when such a file is written.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyogrio
import shapely

from app.exports.format import SEGMENTS, Layer
from app.map.segment import Record
from fusion.types import Floats

GEOMETRY = "geometry"
ROWS_PER_TABLE = 10_000
ROWS_PER_GROUP = 50_000
"""Of a Parquet file: what a reader takes in at once."""

_TIME = pa.timestamp("ms", tz="UTC")  # a type with a parameter, so no name stands for it


def schema_of(layer: Layer) -> pa.Schema:
    """The properties in the contract's order, then the line as WKB."""
    fields = [
        pa.field(name, _TIME if column.arrow == str(_TIME) else pa.type_for_alias(column.arrow))
        for name, column in layer.columns.items()
    ]
    return pa.schema([*fields, pa.field(GEOMETRY, pa.binary())])


def arrow_tables(records: Iterable[Record], rows: int, layer: Layer = SEGMENTS) -> Iterator[pa.Table]:
    """Tables of at most ``rows`` rows in order, rounded as in every output, unknown as null; none for no records."""
    source, schema = iter(records), schema_of(layer)
    while chunk := list(islice(source, rows)):
        properties = [record.properties() for record in chunk]
        columns = {name: [one[name] for one in properties] for name in layer.columns}
        columns["updated_at"] = [record.updated_at for record in chunk]
        yield pa.table({**columns, GEOMETRY: wkb(chunk)}, schema=schema)


def bounds_deg(table: pa.Table) -> Floats:
    """West, south, east, north of a table's lines, shape (4,)."""
    bounds: Floats = shapely.total_bounds(shapely.from_wkb(table[GEOMETRY].to_numpy()))
    return bounds


def wkb(records: list[Record]) -> list[bytes]:
    """The lines as well-known binary, little endian."""
    counts = [len(record.coordinates) for record in records]
    points = np.array([p for record in records for p in record.rounded_coordinates()], float).reshape(-1, 2)
    lines = shapely.linestrings(points, indices=np.repeat(np.arange(len(records)), counts))
    return list(shapely.to_wkb(lines, byte_order=1))


def write_by_gdal(
    records: Iterable[Record],
    path: Path,
    driver: str,
    *,
    metadata: Mapping[str, str],
    options: Mapping[str, str],
) -> int:
    """Write a new file with the segments as its one layer, WGS 84, by one of GDAL's drivers; returns how many.

    The driver draws table after table out of the records. What these raise is raised.
    """
    path.unlink(missing_ok=True)  # GDAL would add to it
    count, failed = 0, list[BaseException]()

    def batches() -> Iterator[pa.RecordBatch]:
        nonlocal count
        try:
            for table in arrow_tables(records, ROWS_PER_TABLE):
                count += len(table)
                yield from table.to_batches()
        except BaseException as error:  # the driver says of it only that there was one
            failed.append(error)
            raise

    try:
        pyogrio.write_arrow(
            pa.RecordBatchReader.from_batches(schema_of(SEGMENTS), batches()),
            path,
            layer=SEGMENTS.name,
            driver=driver,
            geometry_name=GEOMETRY,
            geometry_type="LineString",
            crs="EPSG:4326",
            layer_options=dict(options),
            layer_metadata=dict(metadata),
        )
    except Exception:
        if failed:
            raise failed[0] from None
        raise
    return count
