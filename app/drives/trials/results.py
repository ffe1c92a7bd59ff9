"""What a trial yielded, as it is kept: the slopes of its segments as an Arrow IPC stream. Knows no database."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa

from app.drives.tracks import stream
from app.map.segment import Segment
from app.map.store import DriveSegmentRow
from fusion.types import Ints, SegmentSlope

_NAMES = tuple(spec.name for spec in fields(SegmentSlope))


def encode_slopes(slopes: Iterable[SegmentSlope], segment_ids: Ints) -> bytes:
    """The slopes in the order of driving; ``segment`` becomes the database's id of each."""
    ordered = sorted(slopes, key=lambda slope: (slope.first_time_s, slope.segment))
    columns = {name: np.array([getattr(slope, name) for slope in ordered]) for name in _NAMES}
    columns["segment"] = segment_ids[columns["segment"].astype(np.int64)]
    kinds = {"segment": np.int64, "observations": np.int64, "passes": np.int64}
    return stream({name: column.astype(kinds.get(name, np.float64)) for name, column in columns.items()})


def decode_slopes(data: bytes) -> list[SegmentSlope]:
    """The inverse of ``encode_slopes``; ``segment`` is the database's id."""
    table = pa.ipc.open_stream(data).read_all()
    columns = (table.column(name).to_pylist() for name in _NAMES)
    return [SegmentSlope(*values) for values in zip(*columns, strict=True)]


def beside_the_map(slopes: Sequence[SegmentSlope], segments: Sequence[Segment]) -> list[DriveSegmentRow]:
    """The slopes as a drive's estimates are shown, each beside what all drives together say.

    A segment that an import dropped since is left out.
    """
    by_id = {segment.stored_id: segment for segment in segments}
    return [
        DriveSegmentRow(
            segment=by_id[slope.segment],
            slope_percent=slope.slope_percent,
            slope_sigma_percent=slope.slope_sigma_percent,
            observations=slope.observations,
            passes=slope.passes,
            first_at=datetime.fromtimestamp(slope.first_time_s, UTC),
            last_at=datetime.fromtimestamp(slope.last_time_s, UTC),
            in_network=False,
            accepted=None,
        )
        for slope in slopes
        if slope.segment in by_id
    ]
