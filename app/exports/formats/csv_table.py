"""A plain table for spreadsheets and scripts: the properties and the geometry as WKT.

What CSV has no place for, whose data it is, what heights refer to and of which type columns are, stands beside it, as
W3C's "Metadata Vocabulary for Tabular Data" (CSV on the Web) wants it.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from app.exports.format import WAY_FILTERS, WAYS, Stated, TableFormat
from app.map.segment import OSM_LICENSE_URL, Record

GEOMETRY = "wkt"
_DATATYPES = {"time": "dateTime"}
"""What CSVW calls otherwise than ``Column.kind``."""


class Csv(TableFormat):
    """One row per segment; an empty cell means unknown."""

    name = "csv"
    suffixes = (".csv",)
    media_type = "text/csv"
    description = (
        "CSV table, geometry as WKT in the last column, WGS 84; an empty cell is unknown; "
        "whose data it is stands beside it (CSVW)"
    )

    def write_records(self, records: Iterable[Record], path: Path, stated: Stated) -> int:
        """Write the table. What is ``stated`` goes beside it: a comment line would break readers."""
        count = 0
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow([*self.layer.columns, GEOMETRY])
            for record in records:
                line = ", ".join(f"{lon} {lat}" for lon, lat in record.rounded_coordinates())
                values = record.properties().values()
                cells = [str(value).lower() if isinstance(value, bool) else value for value in values]
                table.writerow([*cells, f"LINESTRING ({line})"])
                count += 1
        return count

    def companions(self, path: Path, stated: Stated) -> dict[Path, str]:
        """``slopes.csv-metadata.json`` for ``slopes.csv``, where readers of CSVW look for it."""
        about: dict[str, Any] = {"dc:title": self.layer.title, "dc:license": {"@id": OSM_LICENSE_URL}}
        if "attribution" in stated:
            about["dc:rights"] = stated["attribution"]
        if "height_datum" in stated:
            about["dc:description"] = f"Heights refer to: {stated['height_datum']}."
        if "changed_at" in stated:
            about["dc:modified"] = {"@value": stated["changed_at"], "@type": "xsd:dateTime"}
        if "provenance" in stated:
            about["dc:provenance"] = stated["provenance"]
        types = {name: _DATATYPES.get(one.kind, one.kind) for name, one in self.layer.columns.items()}
        types[GEOMETRY] = "string"
        columns = [{"name": name, "titles": name, "datatype": kind} for name, kind in types.items()]
        table = {
            "@context": ["http://www.w3.org/ns/csvw", {"@language": "en"}],
            "url": path.name,
            **about,
            "tableSchema": {"columns": columns},
        }
        text = json.dumps(table, indent=2, ensure_ascii=False) + "\n"
        return {path.with_name(f"{path.name}-metadata.json"): text}


class WayCsv(Csv):
    """The same of whole ways."""

    name = "ways-csv"
    description = "CSV table of whole ways: mean slope by length, steepest 20 m and where; else as csv"
    layer = WAYS
    holds = WAYS.name
    filters = WAY_FILTERS
