"""The network adjustment of ``versant fuse``: all logs with factors solved together, as the service does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from app.published import Part
from fusion.evidence import SegmentEvidence
from fusion.factors import PassFactor
from fusion.neighbourhoods import gap_rows
from fusion.network_adjustment import adjust
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import DriveResult, Ints

Passes = Mapping[int, Sequence[tuple[int, PassFactor]]]
"""By row of the road file: key and factor of each pass."""


class Solved(NamedTuple):
    """What logs with factors say together."""

    parts: dict[int, list[Part]]
    """By row of the road file: driven segments and gaps."""
    rejected: list[int]
    """For each log, the segments that it passed and on which it is not heard, for it contradicts the others."""


class Fused(Protocol):
    """A log's result, and the rows of the road file that its segment indices refer to."""

    @property
    def rows(self) -> Ints: ...
    @property
    def result(self) -> DriveResult: ...


def solve_network(roads: RoadTable, dem: Dem | None, logs: Sequence[Fused]) -> Solved:
    """Solve the logs that give factors together; the others have no part in it."""
    rejected = [0] * len(logs)
    # In the order of driving, so that the order in which logs are named changes no digit.
    numbers = sorted((k for k, one in enumerate(logs) if one.result.factors), key=lambda k: _begin(logs[k]))
    if not numbers:
        return Solved({}, rejected)
    passes, log_of = _passes(logs, numbers)
    evidence = {row: SegmentEvidence.build(keyed) for row, keyed in passes.items()}
    heard = {row: {log_of[key] for key in one.keys[one.accepted].tolist()} for row, one in evidence.items()}
    for row, one in evidence.items():
        for number in {log_of[key] for key in one.keys.tolist()} - heard[row]:
            rejected[number] += 1
    return Solved(_parts(roads, dem, surroundings([logs[k] for k in numbers]), evidence, heard), rejected)


def surroundings(logs: Sequence[Fused]) -> Ints:
    """Rows of the road file around the logs: farther than any gap beside a track is long."""
    return np.unique(np.concatenate([one.rows for one in logs]))


def _parts(
    roads: RoadTable,
    dem: Dem | None,
    near: Ints,
    evidence: Mapping[int, SegmentEvidence],
    heard: Mapping[int, set[int]],
) -> dict[int, list[Part]]:
    """The solution over the rows ``near``; ``heard``: the logs heard on each row."""
    table, driven = roads.subset(near), np.isin(near, list(evidence))
    solved = driven | gap_rows(table, driven)
    table, rows = table.subset(solved), near[solved]
    terrain = dem_slopes(dem, table) if dem else np.full(len(table), np.nan)
    result = adjust(table, [evidence.get(row) for row in rows.tolist()], terrain, rows)
    columns = zip(
        rows.tolist(),
        result.slope_percent.tolist(),
        result.slope_sigma_percent.tolist(),
        [len(heard.get(row, ())) for row in rows.tolist()],
        result.observations.tolist(),
        strict=True,
    )
    return {
        row: [Part(slope, sigma, count, observations, network=True)]
        for row, slope, sigma, count, observations in columns
        if np.isfinite(slope) and np.isfinite(sigma)
    }


def _begin(one: Fused) -> float:
    return float(one.result.track.time_s[0])


def _passes(
    logs: Sequence[Fused], numbers: Sequence[int]
) -> tuple[dict[int, list[tuple[int, PassFactor]]], list[int]]:
    """The passes of the logs with these numbers by row of the road file, under running keys; each key's log."""
    passes: dict[int, list[tuple[int, PassFactor]]] = {}
    log_of: list[int] = []
    for number in numbers:
        one = logs[number]
        for factor in one.result.factors:
            stored = replace(factor, segments=tuple(int(one.rows[s]) for s in factor.segments))
            passes.setdefault(stored.segments[-1], []).append((len(log_of), stored))
            log_of.append(number)
    return passes, log_of
