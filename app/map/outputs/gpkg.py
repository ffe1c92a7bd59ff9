"""OGC GeoPackage, written table by table through GDAL."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path

from app.map.segment import Segment

LAYER = "segments"


class GeoPackageOutput:
    """One layer, ``segments``."""

    name = "gpkg"
    suffix = ".gpkg"
    description = "OGC GeoPackage, layer segments, WGS 84"

    def write(self, segments: Iterable[Segment], path: Path, stated: Mapping[str, str]) -> int:
        """Write the layer with what is ``stated`` among its metadata, whose data it is as its description."""
        # Imported where a file is written: every command that only names the outputs would wait for it.
        import pyogrio  # noqa: PLC0415

        from app.map.outputs.arrow import GEOMETRY, SCHEMA, arrow_tables  # noqa: PLC0415

        metadata = {{"attribution": "DESCRIPTION"}.get(name, name): text for name, text in stated.items()}
        path.unlink(missing_ok=True)  # GDAL would add to it
        count = 0
        for table in chain([SCHEMA.empty_table()], arrow_tables(segments)):
            pyogrio.write_arrow(
                table,
                path,
                layer=LAYER,
                driver="GPKG",
                geometry_name=GEOMETRY,
                geometry_type="LineString",
                crs="EPSG:4326",
                append=path.exists(),
                **({} if path.exists() else {"layer_metadata": metadata}),
            )
            count += len(table)
        return count
