"""OGC GeoPackage, written table by table through GDAL."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import pyogrio

from app.map.outputs.arrow import GEOMETRY, SCHEMA, arrow_tables
from app.map.segment import SegmentFeature

LAYER = "segments"


class GeoPackageOutput:
    """One layer, ``segments``."""

    name = "gpkg"
    suffix = ".gpkg"
    description = "OGC GeoPackage, layer segments, WGS 84"

    def write(self, features: Iterable[SegmentFeature], path: Path, source: str) -> int:
        """Write the layer with ``source`` in its description."""
        path.unlink(missing_ok=True)  # GDAL would add to it
        count = 0
        for table in chain([SCHEMA.empty_table()], arrow_tables(features)):
            pyogrio.write_arrow(
                table,
                path,
                layer=LAYER,
                driver="GPKG",
                geometry_name=GEOMETRY,
                geometry_type="LineString",
                crs="EPSG:4326",
                append=path.exists(),
                **({} if path.exists() else {"layer_metadata": {"DESCRIPTION": source}}),
            )
            count += len(table)
        return count
