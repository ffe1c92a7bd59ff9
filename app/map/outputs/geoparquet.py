"""GeoParquet 1.1, written row group by row group.

The metadata are written here, not by geopandas, which would need all segments in memory at once.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import shapely

from app.map.outputs.arrow import GEOMETRY, SCHEMA, arrow_tables
from app.map.segment import SegmentFeature

NO_BOUNDS = np.array([np.inf, np.inf, -np.inf, -np.inf])


class GeoParquetOutput:
    """One Parquet file with a WKB geometry column; no stated CRS means longitude, latitude on WGS 84."""

    name = "geoparquet"
    suffix = ".parquet"
    description = "GeoParquet 1.1, WKB lines, WGS 84"

    def write(self, features: Iterable[SegmentFeature], path: Path, source: str) -> int:
        """Write the file with ``source`` under the key ``attribution`` of its metadata."""
        count, bounds = 0, NO_BOUNDS
        with pq.ParquetWriter(path, SCHEMA, compression="zstd") as writer:
            for table in arrow_tables(features):
                writer.write_table(table)
                count += len(table)
                bounds = _grown(bounds, table)
            writer.add_key_value_metadata({"geo": json.dumps(_geo(bounds)), "attribution": source})
        return count


def _grown(bounds: Any, table: pa.Table) -> Any:
    found = shapely.total_bounds(shapely.from_wkb(table[GEOMETRY].to_numpy()))
    return np.r_[np.minimum(bounds[:2], found[:2]), np.maximum(bounds[2:], found[2:])]


def _geo(bounds: Any) -> dict[str, Any]:
    column: dict[str, Any] = {"encoding": "WKB", "geometry_types": ["LineString"]}
    if np.all(np.isfinite(bounds)):
        column["bbox"] = [float(value) for value in bounds]
    return {"version": "1.1.0", "primary_column": GEOMETRY, "columns": {GEOMETRY: column}}
