"""From the solution of a network to what is published of its segments. How it was found is not known here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.network.curve import place_rows, slope_rows
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.equations import Solution
from fusion.network.terrain import TerrainBlocks
from fusion.network.unknowns import RoadUnknowns
from fusion.types import Floats, Ints

PLACE_SIGMA_M = 2.0
"""Where the map's nodes lie along the road, against where they are."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Slopes of whole segments, shape (n,), positive from from_node to to_node, and what they rest on."""

    slope_percent: Floats
    slope_sigma_percent: Floats
    driven_share: Floats
    """Share of the segment's length over which passes are heard, 0 to 1"""
    observations: Ints
    passes: Ints
    """Passes that are heard"""
    rejected: Ints
    """Passes that are not"""
    heard: dict[tuple[int, int], bool]
    """Whether each pass, by drive and sequence, agrees with the solution"""
    lag_s: dict[int, float]
    """By drive, how late its altimeter is; only of drives that have one"""
    lag_mean_s: float
    solution: Solution
    unknowns: RoadUnknowns
    model: TerrainBlocks | None


def published(
    u: RoadUnknowns, said: DriveBeliefs, model: TerrainBlocks | None, solution: Solution
) -> Adjustment:
    """Slopes with their sigmas, and which passes are heard."""
    n = len(u.length_m)
    slope, sigma = np.full(n, np.nan), np.full(n, np.nan)
    for mine in u.by_intervals():
        variables, length = u.variables(mine), u.length_m[mine]
        covariance, x = solution.equations.covariance(variables), solution.x[variables]
        rows = slope_rows(np.zeros(len(mine)), length, length)
        variance = np.einsum("mi,mij,mj->m", rows, covariance, rows)
        for moved in place_rows(length):
            variance += PLACE_SIGMA_M**2 * (
                np.sum(moved * x, axis=1) ** 2 + np.einsum("mi,mij,mj->m", moved, covariance, moved)
            )
        slope[mine], sigma[mine] = 100 * np.sum(rows * x, axis=1), 100 * np.sqrt(variance)
    heard: dict[tuple[int, int], bool] = {}
    counts = np.zeros((3, n), np.int64)
    cover: list[list[tuple[float, float]]] = [[] for _ in range(n)]
    for (members, _, _, _), misfit in zip(said.groups, said.misfits(solution), strict=True):
        for (d, k), good in zip(members, said.agrees(members, misfit).tolist(), strict=True):
            factor = said.passes[d][k]
            heard[d, factor.sequence] = good
            counts[1 if good else 2, factor.segment] += 1
            if good:
                counts[0, factor.segment] += factor.observations
                cover[factor.segment].append((factor.start_m, factor.end_m))
    share = np.array([_covered(parts) for parts in cover]) / u.length_m
    lags = {d: float(solution.x[q.lag]) for d, q in said.unknowns.items() if q.lag is not None}
    mean = np.nan if said.lag_mean is None else float(solution.x[said.lag_mean])
    observations, passes, rejected = counts
    return Adjustment(
        slope_percent=slope,
        slope_sigma_percent=sigma,
        driven_share=np.minimum(share, 1.0),
        observations=observations,
        passes=passes,
        rejected=rejected,
        heard=heard,
        lag_s=lags,
        lag_mean_s=mean,
        solution=solution,
        unknowns=u,
        model=model,
    )


def _covered(parts: Sequence[tuple[float, float]]) -> float:
    """Length of the union of stretches, m."""
    total, reach = 0.0, -np.inf
    for start, end in sorted(parts):
        total += max(end - max(start, reach), 0.0)
        reach = max(reach, end)
    return total
