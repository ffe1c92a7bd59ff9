"""A plain table for spreadsheets and scripts: the properties and the geometry as WKT."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from app.map.segment import PROPERTIES, Segment


class CsvOutput:
    """One row per segment; an empty cell means unknown."""

    name = "csv"
    suffix = ".csv"
    description = "CSV table, geometry as WKT in the last column, WGS 84; an empty cell is unknown"

    def write(self, segments: Iterable[Segment], path: Path, stated: Mapping[str, str]) -> int:
        """Write the table. CSV has no place for what is ``stated``: a comment line would break readers."""
        count = 0
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow([*PROPERTIES, "wkt"])
            for segment in segments:
                table.writerow([*map(_cell, segment.properties().values()), _wkt(segment)])
                count += 1
        return count


def _cell(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value


def _wkt(segment: Segment) -> str:
    return f"LINESTRING ({', '.join(f'{lon} {lat}' for lon, lat in segment.rounded_coordinates())})"
