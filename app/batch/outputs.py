"""The files of a batch's slopes."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from app.batch.folder import BatchFolder
from app.exports.formats import SEGMENT_FORMATS, write_segments
from app.exports.writing.solved import segments_of
from app.map.segment import attribution
from fusion.results import Solution

SLOPES = "slopes"
DEFAULT_FORMATS = ("geoparquet",)


def write_outputs(
    folder: BatchFolder,
    formats: Sequence[str],
    solution: Solution,
    rasters: Sequence[str],
    newest: datetime,
) -> list[Path]:
    """Write the segments in each of the formats; equal solutions make equal bytes."""
    files = []
    for name in formats:
        path = folder.slopes(SLOPES + SEGMENT_FORMATS[name].suffixes[0])
        write_segments(
            segments_of(solution, newest),
            path,
            source=attribution(rasters),
            height_datum=solution.height_datum,
        )
        files.append(path)
    return files
