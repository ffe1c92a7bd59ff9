"""FlatGeobuf with a spatial index, written through GDAL: one file that clients read parts of over HTTP."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from app.exports.format import SEGMENTS, Stated, TableFormat
from app.map.segment import Record


class FlatGeobuf(TableFormat):
    """One layer with a packed Hilbert R-tree, whose features are in its order."""

    name = "flatgeobuf"
    suffixes = (".fgb",)
    media_type = "application/vnd.flatgeobuf"
    description = "FlatGeobuf with a spatial index, layer segments, WGS 84"

    def write_records(self, records: Iterable[Record], path: Path, stated: Stated) -> int:
        """Write the layer; what is ``stated`` is in its header, whose data it is as its description.

        GDAL keeps some 100 bytes a segment for the index; the segments themselves go through a file beside ``path``.
        """
        # Imported where a file is written: every command that only names the outputs would wait for it.
        from app.exports.writing.arrow import write_by_gdal  # noqa: PLC0415

        metadata = dict(stated)
        options = {"SPATIAL_INDEX": "YES", "TITLE": SEGMENTS.title}
        options["DESCRIPTION"] = metadata.pop("attribution")
        return write_by_gdal(records, path, "FlatGeobuf", metadata=metadata, options=options)
