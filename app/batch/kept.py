"""What a service has of a drive beside its passes, as a Parquet file of a group: track, own estimates, what they rest
on. ``versant import-batch`` reads it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.batch.folder import BatchFolder, write_table
from app.batch.stored import factors_of, passes_file, read_drives
from app.drives.log_facts import LogFacts, records_of
from app.drives.tracks import decode, decode_measurements, encode, encode_measurements
from fusion.methods.base import DriveResult
from fusion.pipeline import road_boxes
from fusion.terrain.dem import Dem
from fusion.together import FusedDrive
from fusion.types import DriveLog, Floats, Ints, SegmentSlope, Track

MOST_GROUND = 1000
"""Places of a track of which the ground's height is noted: by them it is seen whether rasters are the same."""
_SLOPES = {spec.name: pa.float64() for spec in fields(SegmentSlope)} | {
    name: pa.int64() for name in ("segment", "observations", "passes")
}
SCHEMA = pa.schema(
    {
        "drive": pa.int32(), "track": pa.binary(), "measurements": pa.binary(), "boxes": pa.list_(pa.float64()),
        "ground_m": pa.list_(pa.float32()), "bounds": pa.list_(pa.float64()), "drive_time_s": pa.float64(),
        "records": pa.int64(), **{f"slope_{name}": pa.list_(kind) for name, kind in _SLOPES.items()},
    }
)  # fmt: skip
"""One row a drive, by its place in the group. Segments are rows of the whole file of roads. ``boxes`` (m * 4): all
roads that meet these were looked at; ``drive_time_s`` is unknown where the log has no date."""


@dataclass(frozen=True, eq=False)
class Origin:
    """The log of a drive as it was read, and with its positions."""

    read: DriveLog
    located: DriveLog


def kept_row(k: int, one: FusedDrive, origin: Origin, terrain: Dem | None) -> dict[str, Any]:
    """The row of a drive."""
    result, facts = one.result, LogFacts.of(origin.located)
    slopes = {f"slope_{name}": [getattr(each, name) for each in result.slopes] for name in _SLOPES} | {
        "slope_segment": [int(one.rows[each.segment]) for each in result.slopes]
    }
    return {
        "drive": k,
        "track": encode(result.track, one.rows),
        "measurements": None if result.measurements is None else encode_measurements(result.measurements),
        "boxes": road_boxes(origin.located).ravel(),
        "ground_m": ground_under(result.track, terrain),
        "bounds": facts.bounds_deg,
        "drive_time_s": None if facts.drive_time is None else facts.drive_time.timestamp(),
        "records": records_of(origin.read),
        **slopes,
    }


def ground_under(track: Track, terrain: Dem | None) -> Floats:
    """The height of the ground by the rasters along a track, m, NaN unknown, at ``MOST_GROUND`` places at most."""
    some = slice(None, None, -(-len(track) // MOST_GROUND))
    lon, lat = track.lon_deg[some], track.lat_deg[some]
    return np.full(len(lon), np.nan) if terrain is None else terrain.heights(lon, lat)


def write_kept(folder: BatchFolder, key: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Those of a group."""
    columns = {name: [row[name] for row in rows] for name in SCHEMA.names}
    write_table(folder.tracks(key), pa.table(columns, schema=SCHEMA))


@dataclass(frozen=True, eq=False)
class KeptDrive:
    """A drive as a service takes it. Segments of its result are rows of the whole file of roads."""

    log: str
    result: DriveResult
    facts: LogFacts
    boxes_deg: Floats
    ground_m: Floats
    records: int
    lag_s: float | None
    """How late its altimeter was taken for, where it has one"""


def read_kept(folder: BatchFolder, key: str, passes: Sequence[int]) -> Iterator[KeptDrive]:
    """The drives of a group that came to an end; ``passes``: the places in which it has any."""
    drives = read_drives(folder.drives(key))
    factors = _factors(folder, key, passes)
    for row in pq.read_table(folder.tracks(key), use_threads=False).to_pylist():
        drive = drives[row["drive"]]
        measured = row["measurements"]
        result = DriveResult(
            track=decode(row["track"]),
            slopes=tuple(_slopes(row)),
            report=json.loads(drive["report"]),
            factors=tuple(factors.get(row["drive"], ())),
            measurements=None if measured is None else decode_measurements(measured),
        )
        begins_s, (west, south, east, north) = row["drive_time_s"], row["bounds"]
        begins = None if begins_s is None else datetime.fromtimestamp(begins_s, UTC)
        yield KeptDrive(
            drive["log"],
            result,
            LogFacts(drive["epoch_s"], (west, south, east, north), begins),
            np.array(row["boxes"], float).reshape(-1, 4),
            np.array([np.nan if one is None else one for one in row["ground_m"]], float),
            row["records"],
            drive["lag_s"],
        )


def _slopes(row: Mapping[str, Any]) -> Iterator[SegmentSlope]:
    for values in zip(*(row[f"slope_{name}"] for name in _SLOPES), strict=True):
        yield SegmentSlope(**dict(zip(_SLOPES, values, strict=True)))


def _factors(folder: BatchFolder, key: str, places: Sequence[int]) -> dict[int, list[Any]]:
    """The passes of each drive of a group, in the order of driving."""
    tables = [
        pq.read_table(passes_file(folder, place, key), partitioning=None, use_threads=False)
        for place in places
    ]
    if not tables:
        return {}
    table = pa.concat_tables(tables).sort_by([("drive", "ascending"), ("sequence", "ascending")])
    found: dict[int, list[Any]] = {}
    row: Ints = table["row"].to_numpy()
    for drive, factor in zip(table["drive"].to_pylist(), factors_of(table, row), strict=True):
        found.setdefault(drive, []).append(factor)
    return found


def over(result: DriveResult, rows: Ints) -> DriveResult:
    """The result over the segments of these rows (n,), ascending, by their places among them."""

    def place(row: int) -> int:
        return int(np.searchsorted(rows, row))

    segment = result.track.segment
    matched = np.where(segment >= 0, np.searchsorted(rows, segment), -1)
    return replace(
        result,
        track=replace(result.track, segment=matched),
        slopes=tuple(replace(one, segment=place(one.segment)) for one in result.slopes),
        factors=tuple(one.over(place(one.segment)) for one in result.factors),
    )
