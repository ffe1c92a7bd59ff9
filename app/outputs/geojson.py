"""GeoJSON (RFC 7946), written feature by feature."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from app.outputs.features import SegmentFeature, collection_chunks


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
