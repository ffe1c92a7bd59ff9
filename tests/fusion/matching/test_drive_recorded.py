"""The matcher of whole drives on recorded drives and on the synthetic town; skipped where the data is absent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.frames import LocalProjection
from fusion.matching.drive import DriveMatcher
from fusion.matching.path import PathMatch
from fusion.roads.network import RoadNetwork
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town


def connected(network: RoadNetwork, match: PathMatch) -> bool:
    """Whether consecutive traversals of a run meet at a node or turn on their segment."""
    t, f, s = network.table, match.forward, match.segment
    left = np.where(f, t.to_node[s], t.from_node[s])[:-1]
    entered = np.where(f, t.from_node[s], t.to_node[s])[1:]
    turned = (s[1:] == s[:-1]) & (f[1:] != f[:-1])
    return bool(np.all((left == entered) | turned | (np.diff(match.run) == 1)))


def read_arcs(folder: Path, name: str) -> tuple[RoadNetwork, np.ndarray]:
    """The arcs of a track of Kubicka et al. as one-way segments, and the row of each segment."""
    nodes = np.loadtxt(folder / f"{name}.nodes")
    arcs = np.loadtxt(folder / f"{name}.arcs", dtype=np.int64)[:, :2]
    n = len(arcs)
    order = np.lexsort((arcs[:, 1], arcs[:, 0], arcs.max(axis=1), arcs.min(axis=1)))
    arcs = arcs[order]
    pair = np.sort(arcs, axis=1)
    two = np.zeros(n, bool)
    two[:-1] = (pair[1:] == pair[:-1]).all(axis=1)
    keep = np.concatenate([[True], ~two[:-1]])
    rows = np.flatnonzero(keep)
    a, b = nodes[arcs[rows, 0]], nodes[arcs[rows, 1]]
    table = RoadTable.from_columns(
        osm_way_id=rows,
        from_node=arcs[rows, 0],
        to_node=arcs[rows, 1],
        lon0_deg=a[:, 0],
        lat0_deg=a[:, 1],
        lon1_deg=b[:, 0],
        lat1_deg=b[:, 1],
        oneway=np.where(two[rows], 0, 1),
        bridge=np.zeros(len(rows), bool),
        tunnel=np.zeros(len(rows), bool),
        layer=np.zeros(len(rows)),
        highway=["road"] * len(rows),
        name=[None] * len(rows),
    )
    return RoadNetwork.project(table), arcs


@pytest.mark.parametrize("name", ["00000000", "00000014"])
def test_hand_corrected_routes_are_found(shared_data: Path, name: str) -> None:
    """Nearly all of the length driven lies on the route, and nearly all of the route is driven."""
    folder = shared_data / "kubicka" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    network, _ = read_arcs(folder, name)
    lon, lat, time = np.loadtxt(folder / f"{name}.track").T
    match = DriveMatcher(network).match(time, *network.projection.to_xy(lon, lat))
    assert connected(network, match)
    arcs = np.loadtxt(folder / f"{name}.arcs", dtype=np.int64)[:, :2]
    route = {(int(a), int(b)) for a, b in arcs[np.loadtxt(folder / f"{name}.route", dtype=np.int64)]}
    t, s = network.table, match.segment
    ends = np.column_stack([t.from_node[s], t.to_node[s]])
    ends = np.where(match.forward[:, None], ends, ends[:, ::-1])
    driven = [(int(a), int(b)) for a, b in ends]
    stay = np.abs(match.leave_m - match.enter_m)
    assert stay[[d in route for d in driven]].sum() > 0.98 * stay.sum()
    assert len(route & set(driven)) > 0.97 * len(route)


def test_a_real_receiver_follows_its_road(shared_data: Path) -> None:
    folder = shared_data / "comma2k19"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    network = RoadNetwork.project(read_roads(folder / "roads.osm"))
    fix = read_log(folder / "log.csv").fix
    x, y = network.projection.to_xy(fix.lon_deg, fix.lat_deg)
    match = DriveMatcher(network).match(fix.time_s, x, y, sigma_m=fix.h_acc_m)
    assert connected(network, match)
    assert len(match.breaks) == 0
    assert (match.traversal >= 0).all()
    assert len(set(match.segment.tolist())) == len(match)


@pytest.mark.parametrize("receiver", ["m8", "phone"])
def test_drives_through_the_town_are_found_whole(town: Town, receiver: str) -> None:
    """Under and over bridges and through the tunnel: every passage is there, in order, and no other road."""
    network = RoadNetwork.project(town.roads, town.projection)
    drive = simulate_drive(town, seed=5, duration_s=500, receiver=receiver)
    x, y = (np.where(drive.has_gnss, v, np.nan) for v in (drive.gnss.x_m, drive.gnss.y_m))
    match = DriveMatcher(network).match(drive.time_s, x, y)
    assert connected(network, match)
    assert match.run.max() == 0
    true = [(p[0], p[1]) for p in drive.passes()]
    got = list(zip(match.segment.tolist(), match.forward.tolist(), strict=True))
    inner = true[1:-1]  # the noise decides whether the first and the last segment are touched
    begin = got.index(inner[0])
    assert got[begin : begin + len(inner)] == inner
    assert len(got) <= len(true) + 2


def test_a_network_of_a_city_is_prepared_and_matched_quickly(shared_data: Path) -> None:
    """Not a speed test: a whole city's network is taken as it is, and a drive on one long way is found on it."""
    path = shared_data / "maps" / "liechtenstein-2015-07.osm.pbf"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    network = RoadNetwork.project(read_roads(path), LocalProjection(9.55, 47.15))
    matcher = DriveMatcher(network)
    t = network.table
    ways, count = np.unique(t.osm_way_id, return_counts=True)
    rows = np.flatnonzero(t.osm_way_id == ways[np.argmax(count)])
    follows = {int(t.from_node[r]): int(r) for r in rows}
    at = next(r for r in rows if t.from_node[r] not in set(t.to_node[rows].tolist()))
    line = []
    while at is not None:
        line.append(at)
        at = follows.pop(int(t.to_node[at]), None)  # type: ignore[assignment]
    x, y = (
        np.append(network.x0[line], network.x1[line[-1]]),
        np.append(network.y0[line], network.y1[line[-1]]),
    )
    way = np.concatenate([[0.0], np.cumsum(network.length_m[line])])
    s = np.arange(0.0, way[-1], 12.0)
    match = matcher.match(np.arange(len(s)), np.interp(s, way, x), np.interp(s, way, y))
    assert connected(network, match)
    assert match.length_m == pytest.approx(s[-1], abs=15)
    assert np.isin(match.segment, line).mean() > 0.95
