"""The interchange and its drive: the thesis's size and pace, roads that hang together, smooth heights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from shapely import LineString, STRtree

from fusion.roads.osm import read_roads
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import Arcs
from fusion.simulate.write.csv_file import csv_columns
from fusion.simulate.write.osm_file import write_osm
from published.particle.scene.calais import Interchange, calais_drive, make_interchange

SEEDS = (1, 2, 3, 4)


@pytest.fixture(scope="module", params=SEEDS)
def scene(request: pytest.FixtureRequest) -> Interchange:
    return make_interchange(request.param)


@pytest.fixture(scope="module")
def drive(scene: Interchange) -> SimulatedDrive:
    return calais_drive(scene, scene.seed, receiver="perfect")


def test_size_is_the_thesis(scene: Interchange) -> None:
    assert 400 <= len(scene.roads) <= 435  # 417
    assert 60 <= len(scene.ways) <= 80  # 73
    assert scene.length_m.min() > 10
    assert scene.length_m.max() < 260
    assert np.mean(scene.length_m < 61) > 0.5
    assert max(np.abs(scene.node_x_m).max(), np.abs(scene.node_y_m).max()) < 1520


def test_the_drive_has_the_thesis_length_and_pace(drive: SimulatedDrive) -> None:
    assert len(drive.elapsed_s) == 549
    np.testing.assert_allclose(np.diff(drive.elapsed_s), 1.0)
    assert drive.truth.speed_mps.mean() == pytest.approx(60 / 3.6, rel=0.06)
    assert drive.truth.speed_mps.max() < 25.2
    assert drive.antenna_m == 1.55


def test_the_drive_takes_ramps_and_motorways_both_ways(scene: Interchange, drive: SimulatedDrive) -> None:
    names = scene.roads.name[drive.truth.segment]
    highway = scene.roads.highway[drive.truth.segment]
    assert np.mean(highway == "motorway") > 0.35
    assert np.sum(highway == "motorway_link") > 60
    east = drive.truth.velocity_mps[:, 0]
    north = drive.truth.velocity_mps[:, 1]
    for name, along in (("A 16", east), ("A 216", north)):
        assert np.sum((names == name) & (along > 10)) > 20
        assert np.sum((names == name) & (along < -10)) > 20
    assert np.any(scene.roads.bridge[drive.truth.segment])


def test_one_way_roads_are_driven_their_way(scene: Interchange, drive: SimulatedDrive) -> None:
    oneway = scene.roads.oneway[drive.truth.segment]
    assert np.all(drive.truth.forward[oneway == 1])
    assert not np.any(oneway == -1)
    special = np.isin(scene.roads.highway.astype(str), ["motorway", "motorway_link"])
    assert np.all(scene.roads.oneway[special] == 1)


def test_segments_with_four_epochs_are_like_the_thesis(scene: Interchange, drive: SimulatedDrive) -> None:
    segment, epochs = np.unique(drive.truth.segment, return_counts=True)
    long = segment[epochs >= 4]
    assert 0.35 < len(long) / len(segment) < 0.55  # about half
    assert 40 <= len(long) <= 70  # 46
    assert 20 <= epochs.max() <= 35  # 25
    slope = scene.true_slope_percent[long]
    assert -5 < slope.min() < -1  # -2.6
    assert 1 < slope.max() < 6  # 4.7
    assert np.abs(scene.true_slope_percent).max() < 6


def test_every_arc_can_be_reached_from_every_other(scene: Interchange) -> None:
    arcs = Arcs.of(scene)
    count, _ = connected_components(arcs.graph(arcs.seconds), directed=True, connection="strong")
    assert count == 1
    assert scene.junction_degree.min() >= 2


def test_loops_have_loop_radii(scene: Interchange, drive: SimulatedDrive) -> None:
    ramp = scene.roads.highway[drive.truth.segment] == "motorway_link"
    turning = ramp & (drive.truth.speed_mps > 10.5) & (np.abs(drive.truth.yaw_rate_radps) > 0.07)
    radius = drive.truth.speed_mps[turning] / np.abs(drive.truth.yaw_rate_radps[turning])
    assert turning.sum() > 40
    assert radius.min() > 50
    assert 60 < np.median(radius) < 125
    loop = drive.truth.yaw_rate_radps > 0.05
    assert np.sum(drive.truth.yaw_rate_radps[loop & ramp]) > np.radians(240)  # clockwise, at 1 Hz


def test_the_vehicle_keeps_to_the_road(scene: Interchange) -> None:
    drive = calais_drive(scene, 7)
    state = drive.motion.at(np.arange(5.0, 540.0, 0.1))
    a, b = scene.start[state.segment], scene.end[state.segment]
    along = np.column_stack([scene.node_x_m[b] - scene.node_x_m[a], scene.node_y_m[b] - scene.node_y_m[a]])
    along /= scene.length_m[state.segment][:, None]
    off = np.column_stack([state.x_m - scene.node_x_m[a], state.y_m - scene.node_y_m[a]])
    aside = np.abs(off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0])
    assert np.quantile(aside, 0.99) < 3.5  # lane of 1.75 m, wander, and half a metre of bulge
    assert aside.max() < 6.0
    assert np.linalg.norm(state.acceleration_mps2[:, :2], axis=1).max() < 4.0


def test_heights_are_continuous_and_grades_change_gently(scene: Interchange) -> None:
    drive = calais_drive(scene, 7)
    state = drive.motion.at(np.arange(5.0, 540.0, 0.05))
    step = np.hypot(np.diff(state.x_m), np.diff(state.y_m))
    assert np.abs(np.diff(state.z_m)).max() < 0.08 * 25 * 0.05
    moving = step > 0.05
    bend = np.abs(np.diff(state.grade))[moving] / step[moving]
    assert np.quantile(bend, 0.99) < 1 / 500  # crest radii of motorways, and kinks rounded at junctions
    assert bend.max() < 1 / 60


def test_roads_that_cross_without_a_junction_lie_apart(scene: Interchange) -> None:
    x, y = scene.node_x_m, scene.node_y_m
    ends = zip(scene.start, scene.end, strict=True)
    lines = [LineString([(x[a], y[a]), (x[b], y[b])]) for a, b in ends]
    first, second = STRtree(lines).query(lines, predicate="crosses")
    pairs = [(a, b) for a, b in zip(first, second, strict=True) if a < b]
    assert len(pairs) == 10  # N and S over E, W and the road below; the overpass and the lane over E and W
    for a, b in pairs:
        point = lines[a].intersection(lines[b])
        heights = [
            float(scene.road_height(np.array(k), np.array(lines[k].project(point, normalized=True))))
            for k in (a, b)
        ]
        above = bool(scene.roads.bridge[a])
        assert scene.roads.bridge[a] != scene.roads.bridge[b]
        assert (heights[0] - heights[1]) * (1 if above else -1) > 4.5


def test_embankments_stand_at_the_bridges_and_the_a16_on_the_ground(scene: Interchange) -> None:
    off = scene.node_height_m - scene.height(scene.node_x_m, scene.node_y_m)
    on_ramp = np.isin(scene.roads.highway.astype(str), ["motorway_link"])
    assert off[scene.start[on_ramp]].max() > 3
    a16 = (scene.roads.name == "A 16") & ~scene.roads.bridge
    assert np.sqrt(np.mean(off[scene.start[a16]] ** 2)) < 1.0
    assert np.abs(off).max() < 9


def test_the_map_file_holds_the_roads(scene: Interchange, tmp_path: Path) -> None:
    write_osm(scene, tmp_path / "roads.osm")
    roads = read_roads(tmp_path / "roads.osm")
    for name in ("osm_way_id", "from_node", "to_node", "oneway", "bridge", "highway", "name"):
        np.testing.assert_array_equal(getattr(roads, name), getattr(scene.roads, name))


def test_a_random_drive_works_as_in_the_town(scene: Interchange) -> None:
    drive = simulate_drive(scene, 5, 300.0, rate_hz=2.0)
    assert len(drive.elapsed_s) >= 599
    assert np.all(drive.truth.forward[scene.roads.oneway[drive.truth.segment] == 1])


def test_a_seed_makes_one_scene_and_one_drive() -> None:
    a, b, other = make_interchange(5), make_interchange(5), make_interchange(6)
    np.testing.assert_array_equal(a.node_height_m, b.node_height_m)
    np.testing.assert_array_equal(a.circuit.segment, b.circuit.segment)
    assert not np.array_equal(a.node_x_m[:50], other.node_x_m[:50])
    first, same, another = calais_drive(a, 1), calais_drive(b, 1), calais_drive(a, 2)
    for name, column in csv_columns(first).items():
        np.testing.assert_array_equal(column, csv_columns(same)[name])
    assert not np.array_equal(first.gnss.alt_msl_m, another.gnss.alt_msl_m)
