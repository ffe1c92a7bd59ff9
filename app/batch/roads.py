"""Roads by place: a file of roads is read once, cut, and each worker reads the places that its logs touch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.batch.folder import write_table, written
from app.batch.places import place_name, places_met
from app.core.mirror import sha256_of
from fusion.roads.osm import read_roads
from fusion.roads.table import DTYPE_OF, RoadTable
from fusion.types import Floats, Ints, Progress, no_progress

PLACES_KEPT = 16
"""Of the last ones that a worker read."""
_ROW = "row"
_DONE = "done"


@dataclass(frozen=True)
class PlacedRoads:
    """Roads in a folder, a file a place; a segment is in that of each place that its box meets.

    The rows of the whole file of roads, which are in the order of ways, are kept with them.
    """

    folder: Path

    @classmethod
    def cut(cls, file: Path, folder: Path, progress: Progress = no_progress) -> PlacedRoads:
        """Those of a file, cut now or before; raises ``RoadsError`` or ``OSError``."""
        placed = cls(folder)
        if (folder / _DONE).is_file():
            return placed
        table = read_roads(file, progress)
        row, place = places_met(*table_boxes(table))
        order = np.argsort(place, kind="stable")
        begins = np.flatnonzero(np.diff(place[order], prepend=-1))
        for number, rows in zip(place[order][begins].tolist(), np.split(row[order], begins[1:]), strict=True):
            part = table.subset(rows)
            columns: dict[str, Any] = {c: getattr(part, c) for c in RoadTable.columns()}
            write_table(placed._file(number), pa.table({_ROW: rows, **columns}))
        with written(folder / _DONE) as partial:
            partial.write_text("")
        return placed

    def near(self, boxes_deg: Floats) -> tuple[RoadTable, Ints]:
        """All roads of the places that boxes (m, 4: west, south, east, north; degrees) meet, and their rows."""
        return self.of_places(np.unique(places_met(*boxes_deg.T)[1]).tolist())

    def of_places(self, places: Sequence[int]) -> tuple[RoadTable, Ints]:
        """All roads of places, in the order of their rows, and these."""
        return _joined(self, tuple(places))

    def _file(self, place: int) -> Path:
        return self.folder / f"{place_name(place)}.parquet"


def key_of_roads(file: Path) -> str:
    """What roads of these bytes are kept under."""
    return sha256_of(file)[:32]


def table_boxes(table: RoadTable) -> tuple[Floats, Floats, Floats, Floats]:
    """West, south, east and north of each segment, (n,)."""
    return (
        np.minimum(table.lon0_deg, table.lon1_deg),
        np.minimum(table.lat0_deg, table.lat1_deg),
        np.maximum(table.lon0_deg, table.lon1_deg),
        np.maximum(table.lat0_deg, table.lat1_deg),
    )


@lru_cache(PLACES_KEPT)
def _read(file: Path) -> tuple[Ints, dict[str, Any]] | None:
    """None where there is no road."""
    if not file.is_file():
        return None
    table = pq.read_table(file, use_threads=False)
    columns = {c: table[c].to_numpy().astype(DTYPE_OF[c]) for c in RoadTable.columns()}
    return table[_ROW].to_numpy(), columns


@lru_cache(2)
def _joined(roads: PlacedRoads, places: tuple[int, ...]) -> tuple[RoadTable, Ints]:
    read: Iterable[Any] = (_read(roads._file(place)) for place in places)
    parts = [one for one in read if one is not None]
    if not parts:
        return RoadTable.empty(), np.empty(0, np.int64)
    rows, first = np.unique(np.concatenate([part[0] for part in parts]), return_index=True)
    columns: dict[str, Any] = {
        c: np.concatenate([part[1][c] for part in parts])[first] for c in RoadTable.columns()
    }
    return RoadTable(**columns), rows
