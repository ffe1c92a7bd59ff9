"""A plain table for spreadsheets and scripts: the properties and the geometry as WKT.

What CSV has no place for, whose data it is, what heights refer to and of which type columns are, stands beside it, as
W3C's "Metadata Vocabulary for Tabular Data" (CSV on the Web) wants it.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from app.exports.writing.layers import SEGMENTS, WAYS, Layer, Record
from app.map.attribution import OSM_LICENSE_URL

GEOMETRY = "wkt"
_DATATYPES = {
    "int16": "integer",
    "int32": "integer",
    "int64": "integer",
    "double": "number",
    "string": "string",
    "bool": "boolean",
    "timestamp[ms, tz=UTC]": "dateTime",
}


class CsvOutput:
    """One row per segment; an empty cell means unknown."""

    name = "csv"
    suffix = ".csv"
    media_type = "text/csv"
    layer: Layer = SEGMENTS
    description = (
        "CSV table, geometry as WKT in the last column, WGS 84; an empty cell is unknown; "
        "whose data it is stands beside it (CSVW)"
    )

    def write(self, segments: Iterable[Record], path: Path, stated: Mapping[str, str]) -> int:
        """Write the table. What is ``stated`` goes beside it: a comment line would break readers."""
        count = 0
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow([*self.layer.columns, GEOMETRY])
            for segment in segments:
                table.writerow([*map(_cell, segment.properties().values()), _wkt(segment)])
                count += 1
        return count

    def companions(self, path: Path, stated: Mapping[str, str]) -> dict[Path, str]:
        """``slopes.csv-metadata.json`` for ``slopes.csv``, where readers of CSVW look for it."""
        said: dict[str, Any] = {"dc:title": self.layer.title, "dc:license": {"@id": OSM_LICENSE_URL}}
        if "attribution" in stated:
            said["dc:rights"] = stated["attribution"]
        if "height_datum" in stated:
            said["dc:description"] = f"Heights refer to: {stated['height_datum']}."
        if "changed_at" in stated:
            said["dc:modified"] = {"@value": stated["changed_at"], "@type": "xsd:dateTime"}
        if "provenance" in stated:
            said["dc:provenance"] = stated["provenance"]
        types = {name: _DATATYPES[column.arrow] for name, column in self.layer.columns.items()}
        types[GEOMETRY] = "string"
        columns = [{"name": name, "titles": name, "datatype": kind} for name, kind in types.items()]
        table = {
            "@context": ["http://www.w3.org/ns/csvw", {"@language": "en"}],
            "url": path.name,
            **said,
            "tableSchema": {"columns": columns},
        }
        text = json.dumps(table, indent=2, ensure_ascii=False) + "\n"
        return {path.with_name(f"{path.name}-metadata.json"): text}


class WayCsvOutput(CsvOutput):
    """The same of whole ways."""

    name = "ways-csv"
    description = "CSV table of whole ways: mean slope by length, steepest 20 m and where; else as csv"
    layer = WAYS


def _cell(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value


def _wkt(segment: Record) -> str:
    return f"LINESTRING ({', '.join(f'{lon} {lat}' for lon, lat in segment.rounded_coordinates())})"
