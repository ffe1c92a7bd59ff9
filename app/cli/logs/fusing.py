"""Logs, a road file and rasters in; combined segments out: the service's computation without its database."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from app.cli.console import part_of
from app.cli.logs.named import LogFiles
from app.exports.writing.solved import segments_of
from app.map.segment import Segment
from fusion.messages import with_remarks
from fusion.methods.base import Options
from fusion.network.control import ControlPoint
from fusion.network.unknowns import knot_positions
from fusion.pipeline import positions_of, run_drive
from fusion.report import with_agreement
from fusion.results import Solution, solve_fused
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable, rows_of
from fusion.terrain.dem import Dem
from fusion.together import FusedDrive, surroundings
from fusion.types import Progress, no_progress

PARTS = {"reading": (0.0, 0.15), "positioning": (0.15, 0.4), "estimating": (0.4, 1.0)}
"""The parts of the work on one log, and the shares of the whole at which they begin and end."""


@dataclass(frozen=True, eq=False)
class FusedLog(FusedDrive):
    """One log's result, from which files it came, over which roads, and how long it took."""

    source: LogFiles
    network: RoadNetwork
    seconds: float


class Combined(NamedTuple):
    """What the logs of a ``Fusion`` say together."""

    solution: Solution
    """Its drives are the logs by their places in ``Fusion.fused``."""
    features: list[Segment]
    """Its segments, as they are written."""
    rasters: tuple[str, ...]
    """Names of the elevation rasters that give the heights of these segments."""


@dataclass
class Fusion:
    """Several logs, fused one by one, and then solved together."""

    method: str
    options: Options
    roads: RoadTable
    dem: Dem | None
    control: Sequence[ControlPoint] = ()
    fused: list[FusedLog] = field(default_factory=list)
    _seen: dict[tuple[str, ...], LogFiles] = field(default_factory=dict)

    def earlier_copy(self, source: LogFiles) -> str | None:
        """The earlier log of the same bytes, if there is one: the service counts such a drive once, too."""
        digests = sorted(source.digests)
        earlier = self._seen.setdefault(tuple(digests), source)
        return None if earlier == source else earlier.name

    def add(self, log: Path | LogFiles, progress: Progress = no_progress) -> FusedLog:
        """Read and fuse one log; raises ``FusionError`` or ``OSError`` and leaves the others untouched."""
        started = time.perf_counter()
        source = LogFiles((log,)) if isinstance(log, Path) else log
        reading, positioning, estimating = (
            part_of(progress, *PARTS[name]) for name in ("reading", "positioning", "estimating")
        )
        located = positions_of(source.read(reading, self.options.columns), self.options, positioning)
        network, result = run_drive(
            located, self.roads, self.dem, method=self.method, options=self.options, progress=estimating
        )
        rows, seconds = rows_of(self.roads, network.table), time.perf_counter() - started
        fused = FusedLog(rows, result, located.log.fix.time_s, source, network, seconds)
        self.fused.append(fused)
        return fused

    def features(self, now: datetime | None = None, *, gaps: bool = False) -> list[Segment]:
        """Every segment with a slope, in the order of the road file; sigma and counts as in the service.

        ``gaps``: also undriven segments between driven ones, with 0 drives.
        """
        return self.solve(now, gaps=gaps).features

    def solve(self, now: datetime | None = None, *, gaps: bool = False) -> Combined:
        """The ``features``, and how the logs agree."""
        solved = solve_fused(self.fused, self.roads, self.dem, control=self.control, gaps=gaps)
        now = now or datetime.now(UTC)
        features = list(segments_of(solved, now))
        rasters = self.dem.sources_at(*knot_positions(solved.roads)) if self.dem else ()
        return Combined(solved, features, rasters)

    def surroundings(self) -> RoadTable:
        """The roads of the file around the logs that were fused (at least one)."""
        return self.roads.subset(surroundings(self.fused))


def outcome_of(fused: FusedLog) -> dict[str, Any]:
    """What ``--json`` says of one log."""
    return {
        "file": fused.source.name,
        "status": "done",
        "reason": None,
        "segments": len(fused.result.slopes),
        "seconds": round(fused.seconds, 3),
        "report": fused.result.report,
    }


def agreement(solution: Solution, outcomes: Sequence[dict[str, Any]]) -> None:
    """Add to the outcomes of the logs that were fused how each agrees with the others."""
    for k, (outcome, rejected) in enumerate(zip(outcomes, solution.rejected, strict=True)):
        report, duplicate = outcome["report"], solution.duplicates.get(k)
        name = None if duplicate is None else outcomes[duplicate]["file"]
        report.update(with_remarks({}, with_agreement(report, rejected, name)))
        report["rejected_segments"] = outcome["rejected_segments"] = rejected
