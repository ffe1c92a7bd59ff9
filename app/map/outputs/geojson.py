"""One road segment with its slope, as every output shows it: the contract's 16 properties in one order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from app.core.text import dumps
from app.map.segment import SegmentFeature


def collection_chunks(
    features: Iterable[SegmentFeature], members: dict[str, Any] | None = None
) -> Iterator[str]:
    """The text of a FeatureCollection piece by piece, in constant memory.

    ``members`` are further top-level members such as ``links``; they come before ``features``.
    """
    head = dumps({"type": "FeatureCollection"} | (members or {}))
    yield head[:-1] + ',"features":['
    separator = ""
    for feature in features:
        yield separator + dumps(feature.geojson())
        separator = ",\n"
    yield "]}\n"


class GeoJsonOutput:
    """A FeatureCollection in one file."""

    name = "geojson"
    suffix = ".geojson"
    description = "GeoJSON FeatureCollection (RFC 7946), WGS 84"

    def write(self, features: Iterable[SegmentFeature], path: Path, source: str) -> int:
        """Write the collection with ``source`` as its ``attribution`` member."""
        count = 0

        def counted() -> Iterator[SegmentFeature]:
            nonlocal count
            for feature in features:
                count += 1
                yield feature

        with path.open("w", encoding="utf-8") as file:
            file.writelines(collection_chunks(counted(), {"attribution": source}))
        return count
