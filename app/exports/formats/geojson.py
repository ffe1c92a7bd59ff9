"""GeoJSON FeatureCollections, written to a file piece by piece."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

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
        # Where the data come from is a document by itself.
        members = {name: json.loads(text) if name == "provenance" else text for name, text in stated.items()}
        pieces = 0
        with path.open("w", encoding="utf-8") as file:
            for piece in collection_chunks((record.geojson() for record in records), members):
                file.write(piece)
                pieces += 1
        return pieces - 2  # without the beginning and the end
