"""LeuvenMapMatching on a track, for comparison; needs the packages ``leuvenmapmatching`` and ``rtree``."""

from __future__ import annotations

import time

import numpy as np

from fusion.types import Ints
from published.matchers.tracks import Track

SPACING_M = 14.0
SETTINGS = {"obs_noise": 15, "max_dist": 50, "max_lattice_width": 10, "non_emitting_states": True}


def available() -> bool:
    """Whether both packages can be imported."""
    try:
        import leuvenmapmatching  # noqa: F401, PLC0415 - an optional dependency of this benchmark
        import rtree  # noqa: F401, PLC0415
    except ImportError:
        return False
    return True


def thinned(track: Track) -> list[tuple[float, float]]:
    """(y, x) of points ``SPACING_M`` apart."""
    out = [(float(track.y_m[0]), float(track.x_m[0]))]
    for y, x in zip(track.y_m.tolist(), track.x_m.tolist(), strict=True):
        if np.hypot(y - out[-1][0], x - out[-1][1]) >= SPACING_M:
            out.append((y, x))
    return out


def match(track: Track) -> tuple[Ints, float]:
    """Matched arc rows, and the seconds of this thread it took without building the map.

    Where the matcher stops before the end it starts again behind that point.
    """
    from leuvenmapmatching.map.inmem import InMemMap  # noqa: PLC0415
    from leuvenmapmatching.matcher.distance import DistanceMatcher  # noqa: PLC0415

    x, y = track.network.projection.to_xy(*track.nodes_deg.T)
    network = InMemMap(track.name, use_latlon=False, use_rtree=True, index_edges=True)
    for node, place in enumerate(zip(y.tolist(), x.tolist(), strict=True)):
        network.add_node(node, place)
    row_of: dict[tuple[int, int], int] = {}
    for row, (a, b) in enumerate(track.arcs.tolist()):
        network.add_edge(a, b)
        row_of.setdefault((a, b), row)
    start = time.thread_time()
    points, edges = thinned(track), []
    while points:
        matcher = DistanceMatcher(network, **SETTINGS)
        states, last = matcher.match(points)
        edges += [s for s in states if isinstance(s, tuple)]
        points = points[max(last, 0) + 1 :]
    seconds = time.thread_time() - start
    return np.array([row_of[e] for e in edges if e in row_of], np.int64), seconds
