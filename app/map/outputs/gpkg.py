"""OGC GeoPackage, written table by table through GDAL."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any

from app.map.outputs.qgis_style import STYLE_DESCRIPTION, STYLE_NAME, qml
from app.map.segment import Segment

LAYER, STYLES = "segments", "layer_styles"
GEOMETRY_COLUMN = "geom"
"""As the standard's examples and GDAL call it; a style is found by it."""


class GeoPackageOutput:
    """One layer, ``segments``, and a table without geometries that holds its style for QGIS."""

    name = "gpkg"
    suffix = ".gpkg"
    description = "OGC GeoPackage, layer segments, WGS 84, with its style for QGIS"

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
                layer_options={"GEOMETRY_NAME": GEOMETRY_COLUMN},
                append=path.exists(),
                **({} if path.exists() else {"layer_metadata": metadata}),
            )
            count += len(table)
        # Listed beside the segments, as an attributes table: QGIS finds a style in no other.
        pyogrio.write_arrow(_style_table(), path, layer=STYLES, driver="GPKG", layer_options={"FID": "id"})
        return count

    def companions(self, path: Path, stated: Mapping[str, str]) -> dict[Path, str]:
        """None: the file holds everything."""
        return {}


def _style_table() -> Any:
    """One row, as QGIS writes and reads it; a schema or geometry column of another name would not be found."""
    import pyarrow as pa  # noqa: PLC0415 - as above

    row = {
        "f_table_catalog": "",
        "f_table_schema": "",
        "f_table_name": LAYER,
        "f_geometry_column": GEOMETRY_COLUMN,
        "styleName": STYLE_NAME,
        "styleQML": qml(),
        "styleSLD": "",
        "useAsDefault": True,
        "description": STYLE_DESCRIPTION,
        "owner": "Versant",
        "ui": None,
        "update_time": datetime.now(UTC),
    }
    types = {"useAsDefault": pa.bool_(), "update_time": pa.timestamp("ms", tz="UTC")}
    schema = pa.schema([pa.field(name, types.get(name, pa.string())) for name in row])
    return pa.Table.from_pylist([row], schema=schema)
