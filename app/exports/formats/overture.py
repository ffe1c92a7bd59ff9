"""Slopes by Overture's segments: a table that joins segments to GERS ids by a bridge file.

Consumer: whoever has Overture's transportation theme; the ids and ranges are those of its bridge files
(``app.exports.writing.gers``). A row is a segment, or a part of one, in an Overture segment. Where the bridge file has
ranges they decide; else a segment stands beside each Overture segment that its way went into, which ``candidates``
counts. A segment of a way that the file does not know has one row without a GERS id, so none is lost. Without a bridge
file all rows are such: they say where each segment lies along its way, which is what a join of one's own needs.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from app.exports.format import ALL_FILTERS, Format, NoOptions, Stated

if TYPE_CHECKING:
    from app.exports.source import Source


class OvertureOptions(NoOptions):
    """Whose ids."""

    local_files: ClassVar[frozenset[str]] = frozenset({"bridge"})

    bridge: Path | None = Field(
        None, description="Overture's bridge file of segments and OpenStreetMap, or a folder of its parts."
    )


class Overture(Format):
    """Segments by GERS ids."""

    name = "overture"
    consumer = "Overture Maps (GERS ids, bridge files)"
    suffixes = (".csv", ".parquet")
    media_type = "text/csv"
    description = (
        f"Slopes by Overture's segments and parts of them, or by parts of OpenStreetMap ways ({consumer})"
    )
    options = OvertureOptions
    holds = "rows"
    filters = ALL_FILTERS

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the rows, by ascending segment; their number. ``BadOptionsError`` for a file that is no bridge file."""
        # Imported where a file is written: every command that only names the formats would wait for it.
        from app.exports.writing.gers import read_bridge  # noqa: PLC0415
        from app.exports.writing.gers_join import COLUMNS, Join  # noqa: PLC0415
        from app.exports.writing.way_places import read_way_ends  # noqa: PLC0415

        ways = source.osm_way_ids()
        bridge = None if options.bridge is None else read_bridge(options.bridge, ways)
        join = Join(source, bridge, read_way_ends(source.road_files, ways))
        if path.suffix.lower() == ".parquet":
            count = _write_parquet(path, COLUMNS, join.rows(), stated)
        else:
            count = _write_csv(path, COLUMNS, join.rows())
        for text in join.notes():
            source.note(text)
        return count


def _write_csv(path: Path, columns: Mapping[str, str], rows: Iterator[tuple[Any, ...]]) -> int:
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns)
        for row in rows:
            table.writerow(row)
            count += 1
    return count


def _write_parquet(
    path: Path, columns: Mapping[str, str], rows: Iterator[tuple[Any, ...]], stated: Stated
) -> int:
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    from app.exports.writing.arrow import ROWS_PER_GROUP  # noqa: PLC0415

    schema, count = pa.schema([(name, pa.type_for_alias(kind)) for name, kind in columns.items()]), 0
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        while group := list(islice(rows, ROWS_PER_GROUP)):
            values = zip(*group, strict=True)
            arrays = [pa.array(column, one.type) for column, one in zip(values, schema, strict=True)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(group)
        writer.add_key_value_metadata(dict(stated))
    return count
