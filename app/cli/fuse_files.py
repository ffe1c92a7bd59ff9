"""Logs, a road file and rasters in; combined segments out. What the service does, without its database."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.cli.logs import LogFiles
from app.map.segment import Segment
from fusion.methods.base import OF_TERRAIN, DriveResult, Options
from fusion.network.combine import NETWORK_ONLY, SlopePart, published_slope
from fusion.network.control import ControlPoint
from fusion.pipeline import network_datum, positions_of, run_drive, solve_network, surroundings
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable, rows_of
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import Floats, Ints, Progress, no_progress


@dataclass(frozen=True)
class FusedLog:
    """One log's result; ``rows`` are those of the road file that the result's segment indices refer to, ``epoch_s`` the
    times of its positions."""

    source: LogFiles
    network: RoadNetwork
    rows: Ints
    result: DriveResult
    epoch_s: Floats
    seconds: float


class Combined(NamedTuple):
    """What the logs of a ``Fusion`` say together."""

    features: list[Segment]
    rejected: list[int]
    """For each log, on how many segments it contradicts the others and is not heard."""
    repeated: dict[int, int]
    """Logs of a drive that another log is of too, each with that one, by their places in ``Fusion.fused``."""
    remarks: list[str]
    """Sentences on control points and the elevation model."""
    height_datum: str | None
    """What the heights refer to; None where there are none."""


@dataclass
class Fusion:
    """What several logs say together; slopes are kept per segment until they are combined."""

    method: str
    options: Options
    roads: RoadTable
    dem: Dem | None
    control: Sequence[ControlPoint] = ()
    fused: list[FusedLog] = field(default_factory=list)
    _seen: dict[tuple[str, ...], LogFiles] = field(default_factory=dict)

    def twin(self, source: LogFiles) -> str | None:
        """The earlier log of the same bytes, if there is one: the service counts such a drive once, too."""
        digests = sorted(_digest(path) for path in source.files())
        earlier = self._seen.setdefault(tuple(digests), source)
        return None if earlier == source else earlier.name

    def add(self, log: Path | LogFiles, progress: Progress = no_progress) -> FusedLog:
        """Read and fuse one log; raises ``FusionError`` or ``OSError`` and leaves the others untouched."""
        started = time.perf_counter()
        source = LogFiles((log,)) if isinstance(log, Path) else log
        found = positions_of(source.read(progress, self.options.columns), self.options, progress)
        network, result = run_drive(
            found, self.roads, self.dem, method=self.method, options=self.options, progress=progress
        )
        rows, seconds = rows_of(self.roads, network.table), time.perf_counter() - started
        fused = FusedLog(source, network, rows, result, found.log.fix.time_s, seconds)
        self.fused.append(fused)
        return fused

    def features(self, now: datetime | None = None, *, gaps: bool = False) -> list[Segment]:
        """Every segment with a slope, in the order of the road file; sigma and counts as in the service.

        ``gaps``: also undriven segments between driven ones, with 0 drives.
        """
        return self.solve(now, gaps=gaps).features

    def solve(self, now: datetime | None = None, *, gaps: bool = False) -> Combined:
        """The ``features``, and how the logs agree."""
        solved = solve_network(self.roads, self.dem, self.fused, self.control)
        parts = solved.parts
        for k, one in enumerate(self.fused):
            for slope in () if one.result.factors or k in solved.repeated else one.result.slopes:
                said = SlopePart(
                    slope.slope_percent, slope.slope_sigma_percent, 1, slope.observations,
                    of_terrain=self.method in OF_TERRAIN,
                )  # fmt: skip
                parts.setdefault(int(one.rows[slope.segment]), []).append(said)
        shown = sorted(row for row, of_row in parts.items() if gaps or any(part.drives for part in of_row))
        table = self.roads.subset(np.array(shown, np.int64))
        terrain = dem_slopes(self.dem, table) if self.dem else np.full(len(table), np.nan)
        now = now or datetime.now(UTC)
        features = [_feature(table, k, parts[row], float(terrain[k]), now) for k, row in enumerate(shown)]
        datum = network_datum(self.dem, self.fused, self.control)
        return Combined(features, solved.rejected, solved.repeated, solved.remarks, datum)

    def surroundings(self) -> RoadTable:
        """The roads of the file around the logs that were fused (at least one)."""
        return self.roads.subset(surroundings(self.fused))


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _feature(
    table: RoadTable, row: int, parts: Sequence[SlopePart], dem_slope: float, now: datetime
) -> Segment:
    total = published_slope(parts)
    name = table.name[row]
    return Segment(
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
        **{name: getattr(total, name) for name in NETWORK_ONLY},
    )


def summary(fused: FusedLog) -> dict[str, Any]:
    """What ``--json`` says of one log."""
    return {
        "file": fused.source.name,
        "status": "done",
        "reason": None,
        "segments": len(fused.result.slopes),
        "seconds": round(fused.seconds, 3),
        "report": fused.result.report,
    }
