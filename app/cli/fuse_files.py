"""Logs, a road file and rasters in; combined segments out. What the service does, without its database."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.outputs.features import SegmentFeature
from fusion.combine import combine
from fusion.formats import read_log
from fusion.methods.base import Options
from fusion.pipeline import run_drive
from fusion.roads.network import RoadNetwork, RoadTable
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import DriveResult, Ints, Progress, SegmentSlope, no_progress

SegmentKey = tuple[int, int, int]
"""(osm_way_id, from_node, to_node)."""


@dataclass(frozen=True)
class FusedLog:
    """One log's result, and the network that its segment indices refer to."""

    path: Path
    network: RoadNetwork
    result: DriveResult
    seconds: float

    def key(self, segment: int) -> SegmentKey:
        """The identity of a segment of the network."""
        table = self.network.table
        return int(table.osm_way_id[segment]), int(table.from_node[segment]), int(table.to_node[segment])


@dataclass
class Fusion:
    """What several logs say together; slopes are kept per segment until they are combined."""

    method: str
    options: Options
    roads: RoadTable
    dem: Dem | None
    fused: list[FusedLog] = field(default_factory=list)
    _seen: dict[str, Path] = field(default_factory=dict)

    def twin(self, path: Path) -> Path | None:
        """The earlier log with the same bytes, if there is one: the service counts such a drive once, too."""
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        earlier = self._seen.setdefault(digest, path)
        return None if earlier == path else earlier

    def add(self, path: Path, progress: Progress = no_progress) -> FusedLog:
        """Read and fuse one log; raises ``FusionError`` or ``OSError`` and leaves the others untouched."""
        started = time.perf_counter()
        log = read_log(path, progress=progress)
        network, result = run_drive(
            log, self.roads, self.dem, method=self.method, options=self.options, progress=progress
        )
        fused = FusedLog(path, network, result, time.perf_counter() - started)
        self.fused.append(fused)
        return fused

    def features(self, now: datetime | None = None) -> list[SegmentFeature]:
        """Every segment with a slope, in the order of the road file; sigma and counts as in the service."""
        estimates: dict[SegmentKey, list[SegmentSlope]] = {}
        for one in self.fused:
            for slope in one.result.slopes:
                estimates.setdefault(one.key(slope.segment), []).append(slope)
        table = self.roads.subset(_rows(self.roads, estimates))
        terrain = dem_slopes(self.dem, table) if self.dem else np.full(len(table), np.nan)
        now = now or datetime.now(UTC)
        return [
            _feature(table, k, estimates[_key(table, k)], float(terrain[k]), now) for k in range(len(table))
        ]


def _key(table: RoadTable, row: int) -> SegmentKey:
    return int(table.osm_way_id[row]), int(table.from_node[row]), int(table.to_node[row])


def _rows(table: RoadTable, wanted: Mapping[SegmentKey, object]) -> Ints:
    ways = np.array(sorted({way for way, _, _ in wanted}), np.int64)
    candidates = np.flatnonzero(np.isin(table.osm_way_id, ways))
    return np.array([row for row in candidates if _key(table, int(row)) in wanted], np.int64)


def _feature(
    table: RoadTable, row: int, estimates: Sequence[SegmentSlope], dem_slope: float, now: datetime
) -> SegmentFeature:
    total = combine(
        np.array([e.slope_percent for e in estimates]),
        np.array([e.slope_sigma_percent for e in estimates]),
        np.array([e.observations for e in estimates]),
    )
    name = table.name[row]
    return SegmentFeature(
        id=None,
        osm_way_id=int(table.osm_way_id[row]),
        from_node=int(table.from_node[row]),
        to_node=int(table.to_node[row]),
        length_m=float(table.length_m[row]),
        highway=str(table.highway[row]),
        name=None if name is None else str(name),
        oneway=int(table.oneway[row]),
        bridge=bool(table.bridge[row]),
        tunnel=bool(table.tunnel[row]),
        slope_percent=total.slope_percent,
        slope_sigma_percent=total.slope_sigma_percent,
        drives=total.drives,
        observations=total.observations,
        dem_slope_percent=dem_slope,
        updated_at=now,
        coordinates=(
            (float(table.lon0_deg[row]), float(table.lat0_deg[row])),
            (float(table.lon1_deg[row]), float(table.lat1_deg[row])),
        ),
    )


def summary(fused: FusedLog) -> dict[str, Any]:
    """What ``--json`` says of one log."""
    return {
        "file": str(fused.path),
        "status": "done",
        "reason": None,
        "segments": len(fused.result.slopes),
        "seconds": round(fused.seconds, 3),
        "report": fused.result.report,
    }
