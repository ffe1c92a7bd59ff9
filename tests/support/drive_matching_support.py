# mypy: disable-error-code="arg-type"
"""Networks of ways, drives along corners, and what holds of every match, for tests of the matcher of whole drives."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from fusion.frames import LocalProjection
from fusion.matching.path import PathMatch
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable

Place = tuple[float, float]
PLANE = LocalProjection(8.0, 49.0)


def roads(nodes: dict[int, Place], lines: Sequence[tuple[Sequence[int], int]]) -> RoadNetwork:
    """A network of ways, each a line of nodes and its ``oneway``; metres."""
    rows = [(w, a, b, one) for w, (line, one) in enumerate(lines) for a, b in pairwise(line)]
    way, a, b, oneway = (np.array(c) for c in zip(*rows, strict=True))
    xy = np.array([nodes[n] for n in range(len(nodes))])
    lon, lat = PLANE.to_lonlat(*xy.T)
    no, n = np.zeros(len(a)), len(a)
    ends = {"lon0_deg": lon[a], "lat0_deg": lat[a], "lon1_deg": lon[b], "lat1_deg": lat[b]}
    tags = {"bridge": no, "tunnel": no, "layer": no, "highway": ["road"] * n, "name": [None] * n}
    table = RoadTable.from_columns(osm_way_id=way, from_node=a, to_node=b, oneway=oneway, **ends, **tags)
    return RoadNetwork.project(table, PLANE)


def town() -> RoadNetwork:
    """A grid of 6 x 6 crossings 120 m apart, two-way, each street in segments of 60 m."""
    nodes: dict[int, Place] = {}
    for j in range(11):
        for i in range(11):
            nodes[11 * j + i] = (60.0 * i, 60.0 * j)
    east = [([11 * j + i for i in range(11)], 0) for j in range(0, 11, 2)]
    north = [([11 * j + i for j in range(11)], 0) for i in range(0, 11, 2)]
    return roads(nodes, east + north)


def along(corners: Sequence[Place], speed: float = 10.0, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Samples at 1 Hz on a line of corners, columns time, x, y."""
    at = np.array(corners, float)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(at, axis=0).T))])
    s = np.append(np.arange(0.0, way[-1], speed), way[-1])
    rng = np.random.default_rng(seed)
    x, y = (np.interp(s, way, c) + noise * rng.normal(size=len(s)) for c in at.T)
    return np.stack([np.arange(len(s), dtype=float), x, y])


def nodes_of(network: RoadNetwork, match: PathMatch) -> list[int]:
    """The nodes along the path, as far as segments were driven to their end."""
    t = network.table
    out: list[int] = []
    for s, forward in zip(match.segment, match.forward, strict=True):
        ends = (int(t.from_node[s]), int(t.to_node[s]))
        for node in ends if forward else ends[::-1]:
            if not out or out[-1] != node:
                out.append(node)
    return out


def check(network: RoadNetwork, match: PathMatch, time: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    """What holds of every match."""
    t, length = network.table, network.length_m
    stay = np.abs(match.leave_m - match.enter_m)
    assert np.all((match.enter_m >= 0) & (match.enter_m <= length[match.segment] + 1e-9))
    assert np.all((match.leave_m >= 0) & (match.leave_m <= length[match.segment] + 1e-9))
    assert np.all(np.where(match.forward, 1, -1) * (match.leave_m - match.enter_m) >= 0)
    assert np.all((match.confidence >= 0) & (match.confidence <= 1))
    allowed = np.where(match.forward, t.oneway[match.segment] >= 0, t.oneway[match.segment] <= 0)
    assert allowed.all()
    np.testing.assert_allclose(match.start_m[1:], (match.start_m + stay)[:-1], atol=1e-6)
    assert np.all(match.enter_time_s <= match.leave_time_s)
    assert np.all(np.diff(match.enter_time_s) >= -1e-9)
    runs = np.diff(match.run)
    assert np.all((runs == 0) | (runs == 1))
    for i in np.flatnonzero(runs == 0):
        a, b = match.segment[i], match.segment[i + 1]
        if a == b and match.forward[i] != match.forward[i + 1]:
            assert match.leave_m[i] == pytest.approx(match.enter_m[i + 1], abs=1e-6)
            continue
        left = t.to_node[a] if match.forward[i] else t.from_node[a]
        entered = t.from_node[b] if match.forward[i + 1] else t.to_node[b]
        assert left == entered
        assert match.leave_m[i] == pytest.approx(length[a] if match.forward[i] else 0.0, abs=1e-6)
        assert match.enter_m[i + 1] == pytest.approx(0.0 if match.forward[i + 1] else length[b], abs=1e-6)
    on = match.traversal >= 0
    assert len(match.traversal) == len(time)
    assert np.array_equal(on, np.isfinite(match.distance_m))
    assert np.array_equal(on, np.isfinite(match.offset_m))
    assert not on[~(np.isfinite(x) & np.isfinite(y))].any()
    row, at = match.traversal[on], match.distance_m[on]
    assert np.all(at >= match.start_m[row] - 1e-6)
    assert np.all(at <= (match.start_m + stay)[row] + 1e-6)
    _, from_node = match.position_on(at)
    share = from_node / length[match.segment[row]]
    s = match.segment[row]
    if len(s):
        shown = np.isclose(match.position_on(at)[0], row)
        px = network.x0[s] + share * (network.x1 - network.x0)[s]
        py = network.y0[s] + share * (network.y1 - network.y0)[s]
        np.testing.assert_allclose(
            np.hypot(px - x[on], py - y[on])[shown], match.offset_m[on][shown], atol=1e-5
        )
