"""GeoParquet 1.1, written row group by row group.

The metadata are written here, not by geopandas, which would need all segments in memory at once.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from app.exports.format import WAY_FILTERS, WAYS, Stated, TableFormat
from app.map.segment import Record

NO_BOUNDS = np.array([np.inf, np.inf, -np.inf, -np.inf])


class GeoParquet(TableFormat):
    """One Parquet file with a WKB geometry column; no stated CRS means longitude, latitude on WGS 84."""

    name = "geoparquet"
    suffixes = (".parquet",)
    media_type = "application/vnd.apache.parquet"
    description = "GeoParquet 1.1, WKB lines, WGS 84"

    def write_records(self, records: Iterable[Record], path: Path, stated: Stated) -> int:
        """Write the file with what is ``stated`` among its metadata."""
        # Imported where a file is written: every command that only names the outputs would wait for it.
        import pyarrow.parquet as pq  # noqa: PLC0415

        from app.exports.writing import arrow  # noqa: PLC0415

        count, bounds = 0, NO_BOUNDS
        with pq.ParquetWriter(path, arrow.schema_of(self.layer), compression="zstd") as writer:
            for table in arrow.arrow_tables(records, arrow.ROWS_PER_GROUP, self.layer):
                writer.write_table(table)
                count += len(table)
                more = arrow.bounds_deg(table)
                bounds = np.r_[np.minimum(bounds[:2], more[:2]), np.maximum(bounds[2:], more[2:])]
            column: dict[str, Any] = {"encoding": "WKB", "geometry_types": ["LineString"]}
            if np.all(np.isfinite(bounds)):
                column["bbox"] = bounds.tolist()
            geo = json.dumps(
                {"version": "1.1.0", "primary_column": arrow.GEOMETRY, "columns": {arrow.GEOMETRY: column}}
            )
            writer.add_key_value_metadata({"geo": geo, **stated})
        return count


class WayParquet(GeoParquet):
    """The same of whole ways."""

    name = "ways-parquet"
    description = "GeoParquet 1.1 of whole ways: mean slope by length, steepest 20 m and where"
    layer = WAYS
    holds = WAYS.name
    filters = WAY_FILTERS
