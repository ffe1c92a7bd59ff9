"""What is known of drives, and what their passes say, as Parquet files: a group of drives each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.batch.folder import BatchFolder, write_table
from app.batch.places import cells, place_name, place_of_cell, places
from fusion.network.combine import SlopePart
from fusion.network.duplicates import DriveTrace
from fusion.network.pass_factor import PassFactor
from fusion.results import alone
from fusion.roads.table import RoadTable
from fusion.together import DriveFacts, FusedDrive, OnceDriven
from fusion.types import Floats, Ints

ROWS_TOGETHER = 512
"""Passes that can be read alone."""
_LISTS = {
    "trace_row": pa.int64(), "trace_enter_s": pa.float64(), "epoch_s": pa.float64(), "near": pa.int64(),
    "place": pa.int64(),
    "once_row": pa.int64(), "once_slope_percent": pa.float64(), "once_sigma_percent": pa.float64(),
    "once_driven_m": pa.float64(), "once_speed_mps": pa.float64(), "alone_row": pa.int64(),
    "alone_slope_percent": pa.float64(), "alone_sigma_percent": pa.float64(), "alone_observations": pa.int64(),
}  # fmt: skip
DRIVES = pa.schema(
    {
        "log": pa.string(), "reason": pa.string(), "again": pa.bool_(), "report": pa.string(), "begin_s": pa.float64(),
        "end_s": pa.float64(), "kind": pa.string(), "in_network": pa.bool_(), "measurements": pa.int64(),
        "lag_s": pa.float64(), "segments": pa.int64(), **{name: pa.list_(kind) for name, kind in _LISTS.items()},
    }
)  # fmt: skip
"""One row a log. Rows of roads are those of the whole file; ``near`` are those around the drive, in ``place``.
``lag_s`` is unknown where nothing can be late; ``alone``: what a drive says that has no part in the network."""
PASSES = pa.schema(
    {
        "drive": pa.int32(), "sequence": pa.int32(), "cell": pa.int64(), "row": pa.int64(), "osm_way_id": pa.int64(),
        "from_node": pa.int64(), "to_node": pa.int64(), "factor": pa.binary(),
    }
)  # fmt: skip
"""One row a pass: ``drive`` is the row of its log in the file of drives that is called as its own is."""


@dataclass(frozen=True, eq=False)
class PassRows:
    """Passes of some drives with their segments (n,)."""

    drive: Ints
    factors: list[PassFactor]
    row: Ints
    cell: Ints
    names: list[Ints]
    """Way, from_node and to_node of each"""

    @classmethod
    def of(cls, drive: int, one: FusedDrive, factors: Sequence[PassFactor], roads: RoadTable) -> PassRows:
        """Of one drive; ``roads`` are the segments that it counts in."""
        at = np.array([f.segment for f in factors], np.int64)
        names = [getattr(roads, name)[at] for name in ("osm_way_id", "from_node", "to_node")]
        number = np.full(len(at), drive, np.int64)
        return cls(number, list(factors), one.rows[at], cells_of(roads)[at], names)

    def table(self) -> pa.Table:
        """As it is kept, those near each other together."""
        sequence = np.array([f.sequence for f in self.factors], np.int64)
        order = np.lexsort((sequence, self.drive, self.row, self.cell))
        stored = PassFactor.encode_all(self.factors)
        way, start, end = (name[order] for name in self.names)
        columns = (
            self.drive[order], sequence[order], self.cell[order], self.row[order], way, start, end,
            [stored[k] for k in order.tolist()],
        )  # fmt: skip
        return pa.table(dict(zip(PASSES.names, columns, strict=True)), schema=PASSES)


def cells_of(roads: RoadTable) -> Ints:
    """The cell in which the middle of each segment lies, (n,)."""
    return cells(*_middles(roads))


def _middles(roads: RoadTable) -> tuple[Floats, Floats]:
    return 0.5 * (roads.lon0_deg + roads.lon1_deg), 0.5 * (roads.lat0_deg + roads.lat1_deg)


def write_passes(folder: BatchFolder, key: str, rows: Sequence[PassRows]) -> None:
    """Those of a group, a file a place."""
    if not rows:
        return
    table = pa.concat_tables(one.table() for one in rows).sort_by(
        [(name, "ascending") for name in ("cell", "row", "drive", "sequence")]
    )
    place = place_of_cell(table["cell"].to_numpy())
    for number in np.unique(place).tolist():
        file = passes_file(folder, number, key)
        write_table(file, table.filter(pa.array(place == number)), ROWS_TOGETHER)


def passes_file(folder: BatchFolder, place: int, key: str) -> Path:
    """Where a group's passes in a place are."""
    return folder.passes / f"place={place_name(place)}" / f"{key}.parquet"


def drive_row(log: str, one: FusedDrive, roads: RoadTable) -> dict[str, Any]:
    """The row of a drive; ``roads`` are the segments that it counts in."""
    facts, result = DriveFacts.of(one), one.result
    own = [] if result.factors else alone(one)
    return {
        "log": log, "begin_s": facts.begin_s, "end_s": float(result.track.time_s[-1]), "kind": facts.kind,
        "in_network": facts.in_network, "measurements": facts.trace.measurements,
        "lag_s": None if result.late_by is None or not result.factors else result.factors[0].lag_s,
        "segments": len(result.slopes), "trace_row": facts.trace.segment, "trace_enter_s": facts.trace.enter_s,
        "epoch_s": facts.trace.epoch_s, "near": one.rows,
        "place": np.unique(places(*_middles(roads))),
        **{f"once_{spec.name}": getattr(facts.once, spec.name) for spec in fields(OnceDriven)},
        "alone_row": [row for row, _ in own], "alone_slope_percent": [s.slope_percent for _, s in own],
        "alone_sigma_percent": [s.slope_sigma_percent for _, s in own],
        "alone_observations": [s.observations for _, s in own],
    }  # fmt: skip


def write_drives(file: Path, rows: Iterable[dict[str, Any]]) -> None:
    """A group's logs: rows of ``drive_row``, or of a log and why it is not used."""
    columns: dict[str, list[Any]] = {name: [] for name in DRIVES.names}
    for row in rows:
        for name, values in columns.items():
            values.append(row.get(name, False if name in ("again", "in_network") else None))
    write_table(file, pa.table(columns, schema=DRIVES))


def read_drives(file: Path) -> list[dict[str, Any]]:
    """Their rows; lists as arrays, (0,) where there are none."""
    table = pq.read_table(file, use_threads=False)
    plain: list[dict[str, Any]] = table.drop_columns(list(_LISTS)).to_pylist()
    for name, kind in _LISTS.items():
        column = table[name].combine_chunks()
        flat = column.flatten().to_numpy(zero_copy_only=False).astype(kind.to_pandas_dtype())
        ends = np.cumsum([len(one) if one is not None else 0 for one in _lengths(column)])
        for row, part in zip(plain, np.split(flat, ends[:-1]), strict=True):
            row[name] = part
    return plain


def _lengths(column: pa.Array) -> list[Any]:
    return [one.values if one.is_valid else None for one in column]


def passes_in(folder: BatchFolder, place: int) -> list[Path]:
    """The files of passes in a place, by name."""
    return sorted(passes_file(folder, place, "").parent.glob("*.parquet"))


def factors_of(table: pa.Table, row: Ints) -> list[PassFactor]:
    """Stored passes (n,), over ``row`` (n,) instead of the file's."""
    told, sequence = table["factor"].to_pylist(), table["sequence"].to_pylist()
    return PassFactor.decode_all(list(zip(told, row.tolist(), sequence, strict=True)))


def facts_of(row: Mapping[str, Any], roads: Ints) -> DriveFacts:
    """What is known of a drive, over the table of these rows of the file of roads."""
    trace = DriveTrace(
        np.searchsorted(roads, row["trace_row"]), row["trace_enter_s"], row["epoch_s"], row["measurements"]
    )
    once = {spec.name: row[f"once_{spec.name}"] for spec in fields(OnceDriven)}
    once["row"] = np.searchsorted(roads, row["once_row"])
    return DriveFacts(trace, OnceDriven(**once), row["kind"], row["begin_s"], row["in_network"])


def alone_of(row: Mapping[str, Any], roads: Ints, of_terrain: bool) -> list[tuple[int, SlopePart]]:
    """What a drive that has no part in the network says, over the same (``fusion.results.alone``)."""
    names = ("slope_percent", "sigma_percent", "observations")
    said = zip(*(row[f"alone_{name}"].tolist() for name in names), strict=True)
    at = np.searchsorted(roads, row["alone_row"]).tolist()
    return [
        (where, SlopePart(slope, sigma, 1, count, of_terrain=of_terrain))
        for where, (slope, sigma, count) in zip(at, said, strict=True)
    ]
