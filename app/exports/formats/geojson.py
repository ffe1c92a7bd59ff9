"""GeoJSON FeatureCollections, written to a file piece by piece."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from app.core.text import GEO_JSON, collection_chunks
from app.exports.format import Stated, TableFormat
from app.map.segment import Record


class GeoJson(TableFormat):
    """A FeatureCollection in one file."""

    name = "geojson"
    suffixes = (".geojson",)
    media_type = GEO_JSON
    description = "GeoJSON FeatureCollection (RFC 7946), WGS 84"

    def write_records(self, records: Iterable[Record], path: Path, stated: Stated) -> int:
        """Write the collection with what is ``stated`` as members."""
        count = 0
        # Where the data come from is a document by itself.
        members = {name: json.loads(text) if name == "provenance" else text for name, text in stated.items()}

        def counted() -> Iterator[dict[str, Any]]:
            nonlocal count
            for record in records:
                count += 1
                yield record.geojson()

        with path.open("w", encoding="utf-8") as file:
            file.writelines(collection_chunks(counted(), members))
        return count
