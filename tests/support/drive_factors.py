"""Passes over a street as a drive with altitudes and grades would make them, from what the road is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from accuracy.road_draws import PLANE, road_through
from fusion.network.curve import grade_rows, height_rows, variable_count
from fusion.network.pass_factor import ENTRY, EXIT, NUISANCES, PassFactor
from fusion.roads.table import RoadTable

Height = Callable[[np.ndarray], np.ndarray]
"""Height (m) of the street at distances from its beginning."""
T0_S = 1_700_000_000.0


def street_east(*lengths_m: float, loop: bool = False) -> RoadTable:
    """A straight street eastwards, of segments of these lengths, a way each; nodes 0, 1, 2 ... or the first again."""
    n = len(lengths_m)
    east = np.concatenate([[0.0], np.cumsum(lengths_m)])
    lon, lat = PLANE.to_lonlat(east, np.zeros(n + 1))
    node = np.append(np.arange(n), 0 if loop else n)
    return road_through(lon, lat, np.arange(1, n + 1), node)


def drive_along(
    table: RoadTable,
    height: Height,
    *,
    rows: Sequence[int] | None = None,
    offset_m: float = 0.0,
    altitude_sigma_m: float | None = 0.3,
    grade_sigma: float = 0.005,
    begin_s: float = T0_S,
    speed_mps: float = 10.0,
) -> list[PassFactor]:
    """The passes of one drive over the rows of a street in turn, measured every five metres without an error.

    Altitudes lie ``offset_m`` above the road, which the drive does not know; None measures no altitudes.
    """
    start = np.concatenate([[0.0], np.cumsum(table.length_m)])
    passes: list[PassFactor] = []
    for k in range(len(table)) if rows is None else rows:
        length = float(table.length_m[k])
        at = np.linspace(0.0, length, max(int(length / 5.0), 2) + 1)
        knots = int(variable_count(length))
        design = np.zeros((2 * len(at), knots + NUISANCES))
        design[: len(at), :knots] = grade_rows(at, length)
        design[len(at) :, :knots] = height_rows(at, length)
        design[len(at) :, knots + ENTRY.start] = 1 - at / length
        design[len(at) :, knots + EXIT.start] = at / length
        up = height(start[k] + at)
        grade = (height(start[k] + at + 0.01) - height(start[k] + at - 0.01)) / 0.02
        value = np.concatenate([grade, up + offset_m])
        sigma = np.repeat([grade_sigma, altitude_sigma_m or np.inf], len(at))
        scaled = design / sigma[:, None] ** 2
        passes.append(
            PassFactor(
                segment=k,
                sequence=len(passes),
                mount=0,
                information=scaled.T @ design,
                vector=scaled.T @ value,
                square=float(np.sum((value / sigma) ** 2)),
                rows=int(np.isfinite(sigma).sum()),
                walk_m2_per_s=(0.01, 0.01),
                start_m=0.0,
                end_m=length,
                roughness=3e-5,
                observations=len(at),
                first_time_s=begin_s + start[k] / speed_mps,
                last_time_s=begin_s + start[k + 1] / speed_mps,
            )
        )
    return passes
