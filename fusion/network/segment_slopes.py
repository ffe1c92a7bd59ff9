"""From the solution of a network to what is published of its segments. How it was found is not known here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fusion.network.combine import NETWORK_ONLY, SlopePart
from fusion.network.control import ControlBeliefs
from fusion.network.curve import place_rows, slope_rows
from fusion.network.drive_beliefs import REJECT_SIGMAS, DriveBeliefs
from fusion.network.equations import Forms, Solution
from fusion.network.pass_columns import PassColumns
from fusion.network.steepest import steepest
from fusion.network.terrain import TerrainBlocks
from fusion.network.unknowns import RoadUnknowns
from fusion.types import Bools, Floats, Ints

PLACE_SIGMA_M = 2.0
"""Where the map's nodes lie along the road, against where they are."""
LANE_SIGMA_M, LANE_LENGTH_M = 0.025, 100.0
"""Height of the lane that was driven against that of the road, and over how much road it changes: a metre to the side
at a crossfall of 2.5 %, which curves turn round."""
KNOWN_SIGMA_M = 500.0
"""Heights less sure than this are unknown: no sensor of heights, elevation model or control point speaks of them. The
pressure of an unknown day still tells them to 300 m (``drive_beliefs.START_SIGMA_M``)."""


@dataclass(frozen=True, eq=False)
class JudgedPasses:
    """All passes (m,): whether each agrees with the solution, and how much it counted there, 1: as it states."""

    passes: PassColumns
    accepted: Bools
    weight: Floats

    def names(self) -> Iterator[tuple[int, int]]:
        """Drive and sequence of each."""
        return zip(self.passes.drive.tolist(), self.passes.sequence.tolist(), strict=True)


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Slopes of whole segments, shape (n,), positive from from_node to to_node, and what they rest on."""

    slope_percent: Floats
    slope_sigma_percent: Floats
    driven_share: Floats
    """Share of the segment's length over which passes are accepted, 0 to 1"""
    height_from_m: Floats
    """Heights of the network's nodes: segments that meet share them, so that loops close"""
    height_to_m: Floats
    height_sigma_m: Floats
    """The larger of the two ends' sigmas, so that it is true of either"""
    steepest_percent: Floats
    """Over the steepest ``steepest.STRETCH_M`` inside, signed; the whole segment where it is shorter"""
    steepest_from_m: Floats
    steepest_to_m: Floats
    """Where that is, metres from from_node on the length that the knots assume"""
    observations: Ints
    passes: Ints
    """Passes that are accepted"""
    rejected: Ints
    """Passes that are not"""
    judged: JudgedPasses
    lag_s: dict[int, float]
    """By drive, how late its altimeter is; only of drives that have one"""
    lag_mean_s: float
    solution: Solution
    unknowns: RoadUnknowns
    model: TerrainBlocks | None
    remarks: list[str]
    """Sentences on control points that the drives contradict"""

    @cached_property
    def accepted(self) -> dict[tuple[int, int], bool]:
        """Whether each pass, by drive and sequence, agrees with the solution."""
        return dict(zip(self.judged.names(), self.judged.accepted.tolist(), strict=True))

    @cached_property
    def weight(self) -> dict[tuple[int, int], float]:
        """How much each pass counted in the solution, by drive and sequence, 1: as it states."""
        return dict(zip(self.judged.names(), self.judged.weight.tolist(), strict=True))

    def parts(self, drives: Sequence[int]) -> list[SlopePart | None]:
        """The network's part in each segment's slope, None without one; ``drives`` (n,) are those accepted there."""
        columns: dict[str, list[Any]] = {
            name: [value if np.isfinite(value) else None for value in getattr(self, name).tolist()]
            for name in ("slope_percent", "slope_sigma_percent", *NETWORK_ONLY)
        }
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return [
            None
            if row["slope_percent"] is None or row["slope_sigma_percent"] is None
            else SlopePart(drives=count, observations=seen, network=True, **row)
            for row, count, seen in zip(rows, drives, self.observations.tolist(), strict=True)
        ]


def published(
    u: RoadUnknowns,
    beliefs: DriveBeliefs,
    model: TerrainBlocks | None,
    solution: Solution,
    control: ControlBeliefs | None = None,
) -> Adjustment:
    """Slopes with their sigmas, and which passes are accepted."""
    n = len(u.length_m)
    slope, sigma = np.full(n, np.nan), np.full(n, np.nan)
    kinds = u.by_intervals()
    forms = [_slope_forms(u, mine) for mine in kinds]
    *of_slopes, of_nodes = solution.variances([*forms, _node_forms(u)])
    for mine, (variables, weights), variances in zip(kinds, forms, of_slopes, strict=True):
        rows, *ends = weights.transpose(1, 0, 2)
        x, variance = solution.x[variables], variances[:, 0]
        for moved, own in zip(ends, variances.T[1:], strict=True):
            variance += PLACE_SIGMA_M**2 * (np.sum(moved * x, axis=1) ** 2 + own)
        variance += lane_variance(u.length_m[mine])
        slope[mine], sigma[mine] = 100 * np.sum(rows * x, axis=1), 100 * np.sqrt(variance)
    judged = _judged(beliefs, solution)
    share, observations = _driven(judged, u.length_m)
    count = np.maximum(judged.passes.condensed, 1)
    accepted, rejected = (
        np.bincount(judged.passes.segment[v], count[v], minlength=n).astype(np.int64)
        for v in (judged.accepted, ~judged.accepted)
    )
    lags = {d: float(solution.x[q.lag]) for d, q in beliefs.unknowns.items() if q.lag is not None}
    mean = np.nan if beliefs.lag_mean is None else float(solution.x[beliefs.lag_mean])
    unknown = ~np.isfinite(slope + sigma)
    heights = _node_heights(u, solution, of_nodes[:, 0])
    heights[:, unknown | ~(heights[2] < KNOWN_SIGMA_M)] = np.nan
    stretch = steepest(solution.x, u.first, u.intervals, u.length_m)
    stretch[:, unknown] = np.nan
    return Adjustment(
        slope_percent=slope,
        slope_sigma_percent=sigma,
        driven_share=share,
        height_from_m=heights[0],
        height_to_m=heights[1],
        height_sigma_m=heights[2],
        steepest_percent=100 * stretch[0],
        steepest_from_m=stretch[1],
        steepest_to_m=stretch[2],
        observations=observations,
        passes=accepted,
        rejected=rejected,
        judged=judged,
        lag_s=lags,
        lag_mean_s=mean,
        solution=solution,
        unknowns=u,
        model=model,
        remarks=control.remarks(solution) if control else [],
    )


def lane_variance(length_m: Floats) -> Floats:
    """Variance (n,) of the mean grade over so much road for the lane that was driven."""
    return np.asarray(2 * (LANE_SIGMA_M / length_m) ** 2 * (1 - np.exp(-length_m / LANE_LENGTH_M)))


def _slope_forms(u: RoadUnknowns, mine: Ints) -> Forms:
    """The slopes of segments with equal numbers of intervals, and how they change when either end moves."""
    length = u.length_m[mine]
    every = [slope_rows(np.zeros(len(mine)), length, length), *place_rows(length)]
    return u.variables(mine), np.stack(every, axis=1)


def _node_forms(u: RoadUnknowns) -> Forms:
    """The heights of nodes."""
    return np.arange(u.nodes)[:, None], np.ones((u.nodes, 1, 1))


def _node_heights(u: RoadUnknowns, solution: Solution, variance: Floats) -> Floats:
    """Heights at from_node and to_node of every segment, and the larger of their sigmas, shape (3, n)."""
    worse = np.maximum(variance[u.start_node], variance[u.end_node])
    return np.array([solution.x[u.start_node], solution.x[u.end_node], np.sqrt(worse)])


def _judged(beliefs: DriveBeliefs, solution: Solution) -> JudgedPasses:
    accepted = [
        (misfit <= REJECT_SIGMAS**2) & (group.blocks.weight > 0)
        for group, misfit in zip(beliefs.groups, beliefs.misfits(solution), strict=True)
    ]
    members = np.concatenate([np.empty(0, np.int64), *(group.members for group in beliefs.groups)])
    return JudgedPasses(
        beliefs.passes.take(members),
        np.concatenate([np.empty(0, np.bool_), *accepted]),
        np.concatenate([np.empty(0), *(group.blocks.weight for group in beliefs.groups)]),
    )


def _driven(judged: JudgedPasses, length_m: Floats) -> tuple[Floats, Ints]:
    """Of each segment (n,) the share over which passes are accepted, 0 to 1, and what was observed there."""
    passes, good = judged.passes, np.flatnonzero(judged.accepted)
    row, observed = passes.segment[good], passes.observations[good]
    start, end = (np.clip(v[good] / length_m[row], 0.0, 1.0) for v in (passes.start_m, passes.end_m))
    order = np.lexsort((start, row))
    row, observed = row[order], observed[order]
    # Segment after segment on one axis, two units apart: how far any stretch reached before each.
    start, end = start[order] + 2.0 * row, end[order] + 2.0 * row
    reach = np.concatenate([[-1.0], np.maximum.accumulate(end)])[:-1][: len(end)]
    new = np.maximum(end - np.maximum(start, reach), 0.0)
    n = len(length_m)
    observations = np.bincount(row, observed, minlength=n).astype(np.int64)
    return np.minimum(np.bincount(row, new, minlength=n), 1.0), observations
