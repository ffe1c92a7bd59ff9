"""GeoJSON FeatureCollections, written piece by piece: to a file, or wherever a stream goes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from app.core.text import GEO_JSON, dumps
from app.exports.format import Stated, TableFormat
from app.map.segment import Record


def collection_chunks(records: Iterable[Record], members: dict[str, Any] | None = None) -> Iterator[str]:
    """The text of a FeatureCollection piece by piece, in constant memory.

    ``members`` are further top-level members such as ``links``; they come before ``features``.
    """
    head = dumps({"type": "FeatureCollection"} | (members or {}))
    yield head[:-1] + ',"features":['
    separator = ""
    for record in records:
        yield separator + dumps(record.geojson())
        separator = ",\n"
    yield "]}\n"


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
            for piece in collection_chunks(records, members):
                file.write(piece)
                pieces += 1
        return pieces - 2  # without the beginning and the end
