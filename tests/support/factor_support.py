"""Small road networks, and passes over them made up from what they are to say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fusion.frames import LocalProjection
from fusion.network.curve import grade_rows, height_rows, slope_row, smoothness, variable_count
from fusion.network.evidence import SegmentEvidence
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable

PLANE = LocalProjection(8.5, 49.0)
ROUGHNESS = 3e-5
Height = Callable[[int, np.ndarray], np.ndarray]
"""Height of a row at distances along it, metres."""


def roads(
    points: Mapping[int, tuple[float, float]], edges: Sequence[tuple[int, int]], **columns: object
) -> RoadTable:
    """A table of the edges between numbered points (metres east, north), in the order given: one way an edge."""
    ends = np.array([[*points[a], *points[b]] for a, b in edges], float).reshape(-1, 4)
    lon0, lat0 = PLANE.to_lonlat(ends[:, 0], ends[:, 1])
    lon1, lat1 = PLANE.to_lonlat(ends[:, 2], ends[:, 3])
    n = len(edges)
    whole = {
        "osm_way_id": np.arange(1, n + 1),
        "from_node": [a for a, _ in edges],
        "to_node": [b for _, b in edges],
        "lon0_deg": lon0,
        "lat0_deg": lat0,
        "lon1_deg": lon1,
        "lat1_deg": lat1,
        "oneway": np.zeros(n),
        "bridge": np.zeros(n, bool),
        "tunnel": np.zeros(n, bool),
        "layer": np.zeros(n),
        "highway": ["residential"] * n,
        "name": [None] * n,
    }
    return RoadTable.from_columns(**(whole | columns))  # type: ignore[arg-type]


def street(*lengths_m: float, **columns: object) -> RoadTable:
    """A straight street eastwards, of segments of these lengths; nodes 0, 1, 2 ..."""
    east = np.concatenate([[0.0], np.cumsum(lengths_m)])
    edges = [(k, k + 1) for k in range(len(lengths_m))]
    return roads({k: (float(x), 0.0) for k, x in enumerate(east)}, edges, **columns)


def block_of_streets(width: int, height: int, side_m: float = 60.0) -> RoadTable:
    """A grid of streets, drawn in either direction by turns."""
    number = {(x, y): x + width * y for x in range(width) for y in range(height)}
    points = {k: (side_m * x, 1.1 * side_m * y) for (x, y), k in number.items()}
    across = [(number[x, y], number[x + 1, y]) for x in range(width - 1) for y in range(height)]
    down = [(number[x, y], number[x, y + 1]) for x in range(width) for y in range(height - 1)]
    edges = [(b, a) if k % 3 == 0 else (a, b) for k, (a, b) in enumerate(across + down)]
    return roads(points, edges)


def lone_slope(length: float, information: np.ndarray, vector: np.ndarray) -> tuple[float, float]:
    """Slope (%) and sigma over the own segment, its variables last, if hardly anything else is known."""
    own = int(variable_count(length))
    total = information + 1e-7 * np.eye(len(vector))
    total[-own:, -own:] += smoothness(length, 1e-3)
    row = np.zeros(len(vector))
    row[-own:] = slope_row(0.0, length, length)
    solved = np.linalg.solve(total, np.column_stack([row, vector]))
    return 100 * float(row @ solved[:, 1]), 100 * float(np.sqrt(row @ solved[:, 0]))


def factor_from(
    table: RoadTable,
    segments: Sequence[int],
    information: np.ndarray,
    vector: np.ndarray,
    *,
    part: tuple[float, float] | None = None,
    roughness: float = ROUGHNESS,
    observations: int = 5,
) -> PassFactor:
    """A pass with this likelihood over the last of ``segments``."""
    length = float(table.length_m[segments[-1]])
    start, end = part or (0.0, length)
    return PassFactor(
        tuple(segments), information, vector, *lone_slope(length, information, vector), start, end, roughness,
        observations, 1.7e9, 1.7e9 + 5.0,
    )  # fmt: skip


def graded(
    table: RoadTable,
    row: int,
    grades: Callable[[np.ndarray], np.ndarray],
    sigma: float,
    rng: np.random.Generator | None = None,
    *,
    part: tuple[float, float] | None = None,
    every_m: float = 8.0,
    **more: float,
) -> PassFactor:
    """A pass that measured the grade (1) every few metres; the noise is drawn from ``rng``, or there is none."""
    length = float(table.length_m[row])
    start, end = part or (0.0, length)
    count = max(2, int((end - start) / every_m))
    at = start + (end - start) * (np.arange(count) + 0.5) / count
    value = grades(at) + (0.0 if rng is None else sigma * rng.normal(size=count))
    rows = grade_rows(at, length)
    return factor_from(
        table,
        (row,),
        rows.T @ rows / sigma**2,
        rows.T @ value / sigma**2,
        part=part,
        observations=count,
        **more,
    )


def steady(
    table: RoadTable, row: int, slope_percent: float, sigma: float = 0.01, **more: float
) -> PassFactor:
    """A pass that measured the same grade everywhere, without noise."""
    return graded(table, row, lambda at: np.full(len(at), slope_percent / 100), sigma, **more)  # type: ignore[arg-type]


def levelled(
    table: RoadTable,
    segments: Sequence[int],
    height: Height,
    sigma_m: float,
    rng: np.random.Generator | None = None,
    every_m: float = 10.0,
) -> PassFactor:
    """A pass that measured heights from an unknown level along ``segments``, in driving order.

    The factor is what its last segment adds to what was measured on those before, as Vecchia's approximation has it.
    """
    parts = []
    for row in segments:
        length = float(table.length_m[row])
        at = np.linspace(0.0, length, max(2, int(length / every_m)))
        noise = 0.0 if rng is None else sigma_m * rng.normal(size=len(at))
        parts.append((height_rows(at, length), height(row, at) + noise))
    whole = _unlevelled(parts, sigma_m)
    before = _unlevelled(parts[:-1], sigma_m) if len(parts) > 1 else (np.zeros((0, 0)), np.zeros(0))
    information, vector = whole[0].copy(), whole[1].copy()
    size = len(before[1])
    information[:size, :size] -= before[0]
    vector[:size] -= before[1]
    return factor_from(table, segments, information, vector)


def _unlevelled(
    parts: Sequence[tuple[np.ndarray, np.ndarray]], sigma_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Information and vector of stacked height measurements whose common level is unknown."""
    size = sum(rows.shape[1] for rows, _ in parts)
    rows, offset = np.zeros((sum(len(v) for _, v in parts), size)), 0
    at = 0
    for block, values in parts:
        rows[at : at + len(values), offset : offset + block.shape[1]] = block
        at, offset = at + len(values), offset + block.shape[1]
    value = np.concatenate([v for _, v in parts])
    rows, value = rows - rows.mean(axis=0), value - value.mean()  # a flat level takes the mean away
    return rows.T @ rows / sigma_m**2, rows.T @ value / sigma_m**2


def evidence_of(factors: Sequence[PassFactor]) -> dict[int, SegmentEvidence]:
    """Evidence by own segment, keys in the order given."""
    passes: dict[int, list[tuple[int, PassFactor]]] = {}
    for key, factor in enumerate(factors):
        passes.setdefault(factor.segments[-1], []).append((key, factor))
    return {row: SegmentEvidence.build(keyed) for row, keyed in passes.items()}


def in_rows(table: RoadTable, factors: Sequence[PassFactor]) -> list[SegmentEvidence | None]:
    """The same as a list over the table's rows."""
    known = evidence_of(factors)
    return [known.get(row) for row in range(len(table))]


def unknown(table: RoadTable) -> np.ndarray:
    """DEM slopes where there is no DEM."""
    return np.full(len(table), np.nan)
