"""A hilly street whose heights are known, and drives along it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from factor_support import Profile, Sensors, driven, graded
from fusion.network.curve import interval_count
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable

EVERYTHING = Sensors(
    0.02, 0.01, 0.02, altitude_m=0.5, pressure_m=0.1, walk_m2_per_s=(0.15, 0.01), mount=0.03, bias=0.01
)
LATE = Sensors(np.nan, altitude_m=0.2, walk_m2_per_s=(0.01, 0.01), lag_s=2.5)


def height_at(x: np.ndarray) -> np.ndarray:
    """Height at distances from the west end of a street, m."""
    return np.asarray(150 + 0.02 * x + 3 * np.sin(x / 70))


def edges_of(table: RoadTable) -> np.ndarray:
    """Where the segments of a street begin and the last one ends, m."""
    return np.concatenate([[0.0], np.cumsum(table.length_m)])


def hill_of(table: RoadTable) -> Profile:
    """``height_at`` by row and distance along it."""
    edge = edges_of(table)
    return lambda row, at: height_at(edge[row] + at)


def true_percent(table: RoadTable) -> np.ndarray:
    """The slopes of the segments: regression of height on distance."""
    parts = (np.linspace(a, b, 400) for a, b in itertools.pairwise(edges_of(table)))
    return np.array([100 * np.polyfit(x, height_at(x), 1)[0] for x in parts])


def knots_m(table: RoadTable) -> np.ndarray:
    """Where the knots of all segments lie, one segment after another, m from the west end."""
    counts = (interval_count(table.length_m) + 1).tolist()
    ends = itertools.pairwise(edges_of(table))
    return np.concatenate([np.linspace(a, b, n) for (a, b), n in zip(ends, counts, strict=True)])


def ride(
    table: RoadTable, sensors: Sensors, seed: int, rows: Sequence[int] | None = None
) -> list[PassFactor]:
    """A drive along the street, or over some of its rows."""
    chosen = range(len(table)) if rows is None else rows
    return driven(table, chosen, hill_of(table), sensors, np.random.default_rng(seed))


def hilly(row: int, at: np.ndarray) -> np.ndarray:
    """Grades of any road: it waves, another wave on every row."""
    return np.asarray(0.05 * np.sin(row + at / 40))


def waves(
    table: RoadTable, seed: int, rows: Sequence[int] | None = None, sigma: float = 0.02
) -> list[PassFactor]:
    """A drive with one noisy pass over each of the rows, none of which knows of the others."""
    rng = np.random.default_rng(seed)
    return [
        graded(table, row, lambda at, row=row: hilly(row, at), sigma, rng, sequence=k)  # type: ignore[misc]
        for k, row in enumerate(range(len(table)) if rows is None else rows)
    ]
