"""Tracks with hand-corrected routes (Kubicka et al. 2015): reading them, and the metric E."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.frames import LocalProjection
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Track:
    """One drive: n samples in metres, its network, and m directed arcs of which some form the true route.

    ``arc_of`` has shape (segments, 2): the arc row of each segment driven forward and backward, -1 where it
    may not. Arcs with the same end coordinates count as one: ``same`` gives the row that stands for each.
    """

    name: str
    time_s: Floats
    x_m: Floats
    y_m: Floats
    lat_deg: Floats
    lon_deg: Floats
    network: RoadNetwork
    arc_of: Ints
    same: Ints
    arc_length_m: Floats
    arcs: Ints
    nodes_deg: Floats
    route: Ints


def find_tracks(folder: Path) -> list[Path]:
    """The ``.track`` files in a folder or in its subfolders, by name."""
    return sorted([*folder.glob("*.track"), *folder.glob("*/*.track")], key=lambda p: p.name)


def read_track(path: Path) -> Track:
    """Read X.track, X.nodes, X.arcs and X.route."""
    lon, lat, time = np.loadtxt(path, ndmin=2).T[:3]
    nodes = np.loadtxt(path.with_suffix(".nodes"), ndmin=2)
    arcs = np.loadtxt(path.with_suffix(".arcs"), dtype=np.int64, ndmin=2)[:, :2]
    route = np.loadtxt(path.with_suffix(".route"), dtype=np.int64, ndmin=1)
    plane = LocalProjection.around(lon, lat)
    network, arc_of = build_network(nodes, arcs, plane)
    _, place = np.unique(nodes, axis=0, return_inverse=True)
    _, first, group = np.unique(place.ravel()[arcs], axis=0, return_index=True, return_inverse=True)
    nx, ny = plane.to_xy(*nodes.T)
    length = np.hypot(nx[arcs[:, 1]] - nx[arcs[:, 0]], ny[arcs[:, 1]] - ny[arcs[:, 0]])
    x, y = plane.to_xy(lon, lat)
    return Track(
        path.stem, time, x, y, lat, lon, network, arc_of, first[group.ravel()], length, arcs, nodes, route
    )


def build_network(nodes: Floats, arcs: Ints, plane: LocalProjection) -> tuple[RoadNetwork, Ints]:
    """A network whose segments are pairs of opposite arcs, or single arcs as one-way segments."""
    # Nodes at the same place are one node: the road does not end there.
    places, place = np.unique(nodes, axis=0, return_inverse=True)
    ends = place.ravel()[arcs]
    low, high = ends.min(axis=1), ends.max(axis=1)
    usable = np.flatnonzero(low != high)
    pairs, group = np.unique(np.column_stack([low, high])[usable], axis=0, return_inverse=True)
    arc_of = np.full((len(pairs), 2), -1, np.int64)
    against = (ends[usable, 0] != low[usable]).astype(int)
    arc_of[group.ravel()[::-1], against[::-1]] = usable[::-1]
    n = len(pairs)
    oneway = np.where(arc_of[:, 1] < 0, 1, np.where(arc_of[:, 0] < 0, -1, 0))
    a, b = places[pairs[:, 0]], places[pairs[:, 1]]
    table = RoadTable.from_columns(
        osm_way_id=np.arange(n),
        from_node=pairs[:, 0],
        to_node=pairs[:, 1],
        lon0_deg=a[:, 0],
        lat0_deg=a[:, 1],
        lon1_deg=b[:, 0],
        lat1_deg=b[:, 1],
        oneway=oneway,
        bridge=np.zeros(n, bool),
        tunnel=np.zeros(n, bool),
        layer=np.zeros(n),
        highway=["road"] * n,
        name=[None] * n,
    )
    return RoadNetwork.project(table, plane), arc_of


def collapse(arcs: Ints) -> Ints:
    """Drop rows equal to the one before."""
    return arcs[np.concatenate([[True], arcs[1:] != arcs[:-1]])] if len(arcs) else arcs


def longest_common(a: Ints, b: Ints, weight: Floats) -> float:
    """Greatest total weight of a common subsequence of a and b; ``weight`` by value."""
    best = np.zeros(len(b) + 1)
    for value in a:
        score = np.where(b == value, best[:-1] + weight[value], 0.0)
        best[1:] = np.maximum(best[1:], score)
        np.maximum.accumulate(best, out=best)
    return float(best[-1])


def error(track: Track, matched: Ints) -> float:
    """E = (missed + added) / true length: Newson & Krumm 2009, aware of order, direction and repeats."""
    true, answer = collapse(track.same[track.route]), collapse(track.same[matched])
    length = track.arc_length_m
    common = longest_common(true, answer, length)
    true_m = float(length[true].sum())
    return (true_m - common + float(length[answer].sum()) - common) / true_m
