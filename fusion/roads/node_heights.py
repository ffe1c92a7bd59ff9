"""Heights for every node of a road network: measured where they are, elsewhere of the ground, without a step between.

Knows no file and no drive: a graph of nodes and edges, some heights of nodes, and heights of the ground.

Measured heights and those of an elevation model differ: by the offset of their datums, by the model's errors, which
are alike over some hundred metres, and wherever a road is not on the ground. So the model is taken as it is in shape
only. On the ground g of all nodes (below) a correction c is laid: exactly what is measured where something is; along
roads away from there it goes over into the usual offset c0 within about ``REACH_M``:

    sum over edges (c_i - c_j)^2 / length  +  sum over nodes near (c_i - c0)^2 / REACH_M^2  ->  least

where near is half the length of the roads at the node. It is smooth along roads, so the result has no step that neither
the ground nor what was measured has, and it is between the corrections around it. An edge whose rise was measured, but
not its height, pulls c towards that rise, stiffly.

On bridges and in tunnels the ground says nothing, and within ``APPROACH_M`` of their ends it says what lies beside or
above the road, since an elevation model knows no cliffs: g goes on from beyond both ends in proportion to the lengths,
and so it does where the model has voids. A bridge that leads nowhere takes the ground; what is connected to nothing
known takes that of the nearest place that is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from fusion.types import Bools, Floats, Ints

REACH_M = 500.0
"""Along roads, within which a measured offset goes over into the usual one."""
APPROACH_M = 30.0
"""Along roads from bridges and tunnels, within which the ground is doubtful: a post of the usual elevation models."""
STIFFNESS = 100.0
"""How much more an edge of known rise counts than one of the ground's."""
SHORTEST_M = 0.5
"""Shorter edges count as this long, so that they do not drown the others in rounding."""
FEWEST_FOR_OFFSET = 20
"""Measured nodes that an area needs to have an offset of its own."""
_ALMOST_NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class RoadGraph:
    """n nodes and m edges. ``edge`` (m, 2) holds rows of nodes, two different ones each; ``length_m`` (m,) is above 0.

    ``structure`` (m,): bridges and tunnels. ``lon_deg`` and ``lat_deg`` (n,) serve to find what is near.
    """

    edge: Ints
    length_m: Floats
    structure: Bools
    lon_deg: Floats
    lat_deg: Floats

    def __len__(self) -> int:
        return len(self.lon_deg)


@dataclass(frozen=True, eq=False)
class NodeHeights:
    """``height_m`` (n,) without a gap, and by what; all (n,).

    ``measured``; ``spanned``: over bridges, tunnels or voids; ``guessed``: as the nearest known place.
    ``offset_m``: measured minus ground, the median; 0 where nothing was measured.
    """

    height_m: Floats
    measured: Bools
    spanned: Bools
    guessed: Bools
    offset_m: float


def node_heights(
    graph: RoadGraph, ground_m: Floats, measured_m: Floats, rise_m: Floats | None = None
) -> NodeHeights:
    """Heights of all nodes. ``ground_m`` and ``measured_m`` (n,), ``rise_m`` (m,) from the first node of an edge to the
    second; NaN unknown. Raises ``ValueError`` where nothing is known at all.
    """
    measured = np.isfinite(measured_m)
    doubtful = _doubtful(graph)
    known = np.isfinite(ground_m) & ~doubtful
    if not np.isfinite(ground_m).any() and not measured.any():
        raise ValueError("no height is known of any node")
    offset = _offsets(graph, measured_m - np.where(doubtful, np.nan, ground_m))
    start = np.where(known, ground_m, np.nan)
    # Where no ground is in reach, what was measured stands for it, and else what lies below a lonely bridge.
    for other in (measured_m - offset, ground_m):
        alone = ~_reached(graph, np.isfinite(start))
        start[alone] = other[alone]
    guessed = ~_reached(graph, np.isfinite(start))
    if guessed.any():
        start[guessed] = _nearest(graph, start, guessed)
    # What is missing is spanned between the known places, in proportion to lengths.
    ground = _solved(_laplacian(graph, _weight(graph)), np.zeros(len(graph)), start)
    correction = _correction(graph, ground, measured_m, offset, rise_m)
    spanned = np.isnan(start) & ~measured
    usual = float(np.nanmedian(offset)) if measured.any() else 0.0
    return NodeHeights(ground + correction, measured, spanned, guessed, usual)


def _doubtful(graph: RoadGraph) -> Bools:
    """Nodes of bridges and tunnels, and those that are near one along roads on the ground; (n,)."""
    doubtful = np.zeros(len(graph), bool)
    doubtful[graph.edge[graph.structure]] = True
    if doubtful.any():
        i, j = graph.edge[~graph.structure].T
        length = np.maximum(graph.length_m[~graph.structure], SHORTEST_M)
        roads = sparse.csr_matrix((length, (i, j)), shape=(len(graph), len(graph)))
        starts = np.flatnonzero(doubtful)
        away_m = dijkstra(roads, directed=False, indices=starts, limit=APPROACH_M, min_only=True)
        doubtful |= np.isfinite(away_m)
    return doubtful


def _offsets(graph: RoadGraph, difference_m: Floats) -> Floats:
    """The usual difference (n,) around each node: of its square degree where enough is known there, else of all."""
    known = np.isfinite(difference_m)
    if not known.any():
        return np.zeros(len(graph))
    offset = np.full(len(graph), float(np.median(difference_m[known])))
    square = np.floor(graph.lon_deg) * 1000 + np.floor(graph.lat_deg)
    for one in np.unique(square[known]):
        here = known & (square == one)
        if np.count_nonzero(here) >= FEWEST_FOR_OFFSET:
            offset[square == one] = float(np.median(difference_m[here]))
    return offset


def _reached(graph: RoadGraph, known: Bools) -> Bools:
    """Nodes that are connected to a known one."""
    n = len(graph)
    links = sparse.coo_matrix((np.ones(len(graph.edge)), (graph.edge[:, 0], graph.edge[:, 1])), shape=(n, n))
    parts, part = connected_components(links, directed=False)
    has = np.zeros(parts, bool)
    has[part[known]] = True
    return np.asarray(has[part])


def _nearest(graph: RoadGraph, value: Floats, wanted: Bools) -> Floats:
    """For each wanted node the value of the nearest known one, by degrees of latitude; ties go to the first."""
    narrow = np.cos(np.radians(np.clip(np.mean(graph.lat_deg), -89.0, 89.0)))
    place = np.column_stack([graph.lon_deg * narrow, graph.lat_deg])
    known = np.flatnonzero(np.isfinite(value))
    _, nearest = KDTree(place[known]).query(place[wanted])
    return np.asarray(value[known[nearest]])


def _laplacian(graph: RoadGraph, weight: Floats) -> sparse.csr_matrix:
    n, (i, j) = len(graph), graph.edge.T
    return sparse.csr_matrix(
        (
            np.concatenate([weight, weight, -weight, -weight]),
            (np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])),
        ),
        shape=(n, n),
    )


def _weight(graph: RoadGraph) -> Floats:
    return np.asarray(1.0 / np.maximum(graph.length_m, SHORTEST_M))


def _correction(
    graph: RoadGraph, ground: Floats, measured_m: Floats, offset: Floats, rise_m: Floats | None
) -> Floats:
    """What is added to the ground; see the module."""
    weight, target = _weight(graph), np.zeros(len(graph.edge))
    if rise_m is not None:
        i, j = graph.edge.T
        stiff = np.isfinite(rise_m)
        weight = np.where(stiff, STIFFNESS * weight, weight)
        target[stiff] = (rise_m - (ground[j] - ground[i]))[stiff]
    near = np.zeros(len(graph))
    load = np.zeros(len(graph))
    for side, sign in ((0, -1.0), (1, 1.0)):
        half = 0.5 * np.where(graph.structure, 0.0, np.maximum(graph.length_m, SHORTEST_M))
        np.add.at(near, graph.edge[:, side], half)
        np.add.at(load, graph.edge[:, side], sign * weight * target)
    near = np.maximum(near / REACH_M**2, _ALMOST_NOTHING)
    fixed = np.where(np.isfinite(measured_m), measured_m - ground, np.nan)
    return _solved(_laplacian(graph, weight) + sparse.diags(near), load + near * offset, fixed)


def _solved(matrix: sparse.csr_matrix, load: Floats, fixed: Floats) -> Floats:
    """The solution of matrix x = load for the rows that are not fixed; (n,)."""
    out = fixed.copy()
    free = np.flatnonzero(np.isnan(fixed))
    if not len(free):
        return out
    known = np.flatnonzero(~np.isnan(fixed))
    rows = matrix.tocsr()[free]
    right = load[free] - rows[:, known] @ fixed[known]
    factor = splu(rows[:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                  options={"SymmetricMode": True})  # fmt: skip
    out[free] = factor.solve(right)
    return np.asarray(out)
