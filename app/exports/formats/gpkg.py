"""OGC GeoPackage, written through GDAL."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.core.text import utc_text
from app.exports.format import SEGMENTS, Stated, TableFormat, nothing_beside
from app.exports.writing.qgis_style import STYLE_DESCRIPTION, STYLE_NAME, qml
from app.map.segment import Record

STYLES = "layer_styles"
GEOMETRY_COLUMN = "geom"
"""As the standard's examples and GDAL call it; a style is found by it."""


class GeoPackage(TableFormat):
    """One layer, ``segments``, and a table without geometries that holds its style for QGIS."""

    name = "gpkg"
    suffixes = (".gpkg",)
    media_type = "application/geopackage+sqlite3"
    description = "OGC GeoPackage, layer segments, WGS 84, with its style for QGIS"
    companions = nothing_beside

    def write_records(self, records: Iterable[Record], path: Path, stated: Stated) -> int:
        """Write the layer with what is ``stated`` among its metadata, whose data it is as its description.

        A GeoPackage says when its tables changed: when the data did, where that is stated.
        """
        # Imported where a file is written: every command that only names the outputs would wait for it.
        import pyogrio  # noqa: PLC0415

        from app.exports.writing.arrow import write_by_gdal  # noqa: PLC0415

        metadata = {{"attribution": "DESCRIPTION"}.get(name, name): text for name, text in stated.items()}
        moment = datetime.fromisoformat(stated["changed_at"]) if "changed_at" in stated else datetime.now(UTC)
        with _dated(moment):
            options = {"GEOMETRY_NAME": GEOMETRY_COLUMN}
            count = write_by_gdal(records, path, "GPKG", metadata=metadata, options=options)
            # Listed beside the segments, as an attributes table: QGIS finds a style in no other.
            pyogrio.write_arrow(
                _style_table(moment), path, layer=STYLES, driver="GPKG", layer_options={"FID": "id"}
            )
        return count


@contextmanager
def _dated(moment: datetime) -> Iterator[None]:
    """Let GDAL take this for the present time: the same data then yield the same bytes."""
    import pyogrio  # noqa: PLC0415 - as above

    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": utc_text(moment)})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": None})


def _style_table(moment: datetime) -> Any:
    """One row, as QGIS writes and reads it; a schema or geometry column of another name would not be found."""
    import pyarrow as pa  # noqa: PLC0415 - as above

    row = {
        "f_table_catalog": "",
        "f_table_schema": "",
        "f_table_name": SEGMENTS.name,
        "f_geometry_column": GEOMETRY_COLUMN,
        "styleName": STYLE_NAME,
        "styleQML": qml(),
        "styleSLD": "",
        "useAsDefault": True,
        "description": STYLE_DESCRIPTION,
        "owner": "Versant",
        "ui": None,
        "update_time": moment,
    }
    types = {"useAsDefault": pa.bool_(), "update_time": pa.timestamp("ms", tz="UTC")}
    schema = pa.schema([pa.field(name, types.get(name, pa.string())) for name in row])
    return pa.Table.from_pylist([row], schema=schema)
