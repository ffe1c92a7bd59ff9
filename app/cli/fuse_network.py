"""The network adjustment of ``versant fuse``: all logs with factors solved together, as the service does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

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


class Fused(Protocol):
    """A log's result, and the rows of the road file that its segment indices refer to."""

    @property
    def rows(self) -> Ints: ...
    @property
    def result(self) -> DriveResult: ...


def network_parts(roads: RoadTable, dem: Dem | None, logs: Sequence[Fused]) -> dict[int, list[Part]]:
    """What the logs that give factors say together, by row of the road file: driven segments and gaps."""
    # In the order of driving, so that the order in which logs are named changes no digit.
    with_factors = sorted((one for one in logs if one.result.factors), key=_begin)
    if not with_factors:
        return {}
    passes, log_of = _passes(with_factors)
    evidence = {row: SegmentEvidence.build(keyed) for row, keyed in passes.items()}
    # A log's extract of the road file reaches farther than any gap beside its track is long.
    near = np.unique(np.concatenate([one.rows for one in with_factors]))
    table, driven = roads.subset(near), np.isin(near, list(evidence))
    solved = driven | gap_rows(table, driven)
    table, rows = table.subset(solved), near[solved]
    terrain = dem_slopes(dem, table) if dem else np.full(len(table), np.nan)
    known = [evidence.get(row) for row in rows.tolist()]
    result = adjust(table, known, terrain, rows)
    drives = [
        0 if one is None else len({log_of[key] for key in one.keys[one.accepted].tolist()}) for one in known
    ]
    columns = zip(
        rows.tolist(),
        result.slope_percent.tolist(),
        result.slope_sigma_percent.tolist(),
        drives,
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


def _passes(logs: Sequence[Fused]) -> tuple[dict[int, list[tuple[int, PassFactor]]], list[int]]:
    """The passes by row of the road file, under running numbers, and the log of each number."""
    passes: dict[int, list[tuple[int, PassFactor]]] = {}
    log_of: list[int] = []
    for number, one in enumerate(logs):
        for factor in one.result.factors:
            stored = replace(factor, segments=tuple(int(one.rows[s]) for s in factor.segments))
            passes.setdefault(stored.segments[-1], []).append((len(log_of), stored))
            log_of.append(number)
    return passes, log_of
