"""GeoJSON FeatureCollections, written piece by piece: to a file, or wherever a stream goes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from app.core.text import GEO_JSON, dumps
from app.exports.writing.qgis_style import style_beside
from app.map.segment import Segment


def collection_chunks(segments: Iterable[Segment], members: dict[str, Any] | None = None) -> Iterator[str]:
    """The text of a FeatureCollection piece by piece, in constant memory.

    ``members`` are further top-level members such as ``links``; they come before ``features``.
    """
    head = dumps({"type": "FeatureCollection"} | (members or {}))
    yield head[:-1] + ',"features":['
    separator = ""
    for segment in segments:
        yield separator + dumps(segment.geojson())
        separator = ",\n"
    yield "]}\n"


class GeoJsonOutput:
    """A FeatureCollection in one file."""

    name = "geojson"
    suffix = ".geojson"
    media_type = GEO_JSON
    description = "GeoJSON FeatureCollection (RFC 7946), WGS 84"

    def write(self, segments: Iterable[Segment], path: Path, stated: Mapping[str, str]) -> int:
        """Write the collection with what is ``stated`` as members."""
        count = 0

        def counted() -> Iterator[Segment]:
            nonlocal count
            for segment in segments:
                count += 1
                yield segment

        with path.open("w", encoding="utf-8") as file:
            file.writelines(collection_chunks(counted(), _members(stated)))
        return count

    def companions(self, path: Path, stated: Mapping[str, str]) -> dict[Path, str]:
        """The style for QGIS."""
        return style_beside(path)


def _members(stated: Mapping[str, str]) -> dict[str, Any]:
    """What is stated as members; where the data come from is a document by itself."""
    members: dict[str, Any] = dict(stated)
    if "provenance" in members:
        members["provenance"] = json.loads(members["provenance"])
    return members
