"""Heights of all nodes out of some: no gap, no step, straight over bridges; laws of the blend over random networks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.frames import METRES_PER_DEGREE
from fusion.roads.node_heights import REACH_M, RoadGraph, node_heights
from fusion.types import Floats


def chain(length_m: Floats, bridges: tuple[int, ...] = ()) -> RoadGraph:
    """A road to the east whose edges have these lengths; some of them are bridges."""
    n = len(length_m)
    edge = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    lon = 8.2 + np.append(0.0, np.cumsum(length_m)) / METRES_PER_DEGREE
    return RoadGraph(edge, length_m, np.isin(np.arange(n), bridges), lon, np.zeros(n + 1))


def unknown(n: int, **known: float) -> Floats:
    out = np.full(n, np.nan)
    for name, value in known.items():
        out[int(name[1:])] = value
    return out


def test_without_anything_measured_heights_are_those_of_the_ground() -> None:
    ground = np.array([100.0, 104.0, 103.0, 107.0])
    found = node_heights(chain(np.full(3, 50.0)), ground, unknown(4))
    assert found.height_m == pytest.approx(ground)
    assert not (found.measured | found.spanned | found.guessed).any() and found.offset_m == 0


def test_a_bridge_goes_straight_from_beyond_its_ends_whatever_lies_below() -> None:
    """The nodes at the ends and a stub before them have the valley's side in a raster."""
    length = np.array([50.0, 20.0, 20.0, 60.0, 20.0, 20.0, 50.0])
    ground = np.array([100.0, 102.0, 88.0, 60.0, 55.0, 70.0, 112.0, 113.0])
    found = node_heights(chain(length, bridges=(3,)), ground, unknown(8))
    assert found.height_m == pytest.approx(
        [100, 102, 102 + 10 / 7, 102 + 20 / 7, 112 - 20 / 7, 112 - 10 / 7, 112, 113]
    )
    assert found.spanned.tolist() == [False, False, True, True, True, True, False, False]
    # Ground that is farther away along the road counts, however near it lies.
    far = node_heights(
        chain(np.array([50.0, 35.0, 60.0, 50.0]), bridges=(2,)), ground[[0, 1, 3, 4, 7]], unknown(5)
    )
    assert far.height_m[1] == 102 and far.spanned.tolist() == [False, False, True, True, False]


def test_a_bridge_between_measured_ends_is_straight_too_and_a_measured_pier_bends_it() -> None:
    length = np.full(4, 50.0)
    ground = np.array([100.0, 102.0, 60.0, 112.0, 113.0])
    graph = chain(length, bridges=(1, 2))
    assert node_heights(graph, ground, unknown(5, n1=110, n3=120)).height_m[2] == pytest.approx(115)
    assert node_heights(graph, ground, unknown(5, n1=110, n2=118, n3=120)).height_m[2] == 118


def test_a_void_of_the_ground_is_spanned_and_an_island_without_ground_is_guessed_and_told() -> None:
    two = chain(np.array([100.0, 50.0, 150.0, 80.0]))
    apart = RoadGraph(
        two.edge[[0, 1, 3]], two.length_m[[0, 1, 3]], two.structure[[0, 1, 3]], two.lon_deg, two.lat_deg
    )
    found = node_heights(apart, unknown(5, n0=100, n2=130), unknown(5))
    assert found.height_m == pytest.approx([100, 120, 130, 130, 130])
    assert found.spanned.tolist() == [False, True, False, False, False]
    assert found.guessed.tolist() == [False, False, False, True, True]
    measured = node_heights(apart, unknown(5, n0=100, n2=130), unknown(5, n3=200.0))
    assert measured.height_m[3:] == pytest.approx([200, 200])
    assert not measured.guessed.any()


def test_a_lonely_bridge_has_the_height_of_what_is_below() -> None:
    found = node_heights(chain(np.array([30.0]), bridges=(0,)), np.array([10.0, 12.0]), unknown(2))
    assert found.height_m == pytest.approx([10, 12])


def test_nothing_known_at_all_is_refused() -> None:
    with pytest.raises(ValueError, match="no height"):
        node_heights(chain(np.array([30.0])), unknown(2), unknown(2))


def test_away_from_what_was_measured_the_ground_is_shifted_by_the_usual_offset() -> None:
    """Many measured nodes are 5 m above the ground, one is 9 m: beside it 9 m fade out over the reach, never faster."""
    length = np.full(1000, 20.0)
    ground = 100 + 10 * np.sin(np.arange(1001) / 20)
    measured = unknown(1001)
    measured[:40] = ground[:40] + 5
    measured[500] = ground[500] + 9
    found = node_heights(chain(length), ground, measured)
    shift = found.height_m - ground
    assert found.offset_m == pytest.approx(5)
    assert shift[500:] == pytest.approx(5 + 4 * np.exp(-20 * np.arange(501) / REACH_M), abs=0.01)
    assert np.abs(np.diff(shift)).max() < 4 * 20 / REACH_M * 1.05


def test_a_measured_slope_without_a_height_is_kept() -> None:
    length, ground = np.full(40, 25.0), np.full(41, 100.0)
    rise = np.full(40, np.nan)
    rise[18:22] = 0.08 * 25
    found = node_heights(chain(length), ground, unknown(41, n0=103), rise)
    assert np.diff(found.height_m)[18:22] == pytest.approx(2.0, rel=0.05)
    assert found.height_m[0] == 103


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_laws(seed: int) -> None:
    """No gap; measured is kept; corrections lie between those around; turning edges round or order changes nothing."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 40))
    edge = np.column_stack([np.arange(1, n), [rng.integers(0, k) for k in range(1, n)]])
    extra = rng.integers(0, n, (n // 3, 2))
    edge = np.vstack([edge, extra[extra[:, 0] != extra[:, 1]]])
    edge = edge[rng.random(len(edge)) < 0.9]
    length = rng.uniform(0.1, 300, len(edge))
    structure = rng.random(len(edge)) < 0.15
    graph = RoadGraph(edge, length, structure, rng.uniform(8, 8.1, n), rng.uniform(49, 49.1, n))
    ground = np.where(rng.random(n) < 0.8, rng.normal(200, 20, n), np.nan)
    measured = np.where(rng.random(n) < 0.4, 200 + rng.normal(0, 20, n), np.nan)
    if not np.isfinite(ground).any():
        ground[0] = 200.0
    found = node_heights(graph, ground, measured)
    assert np.isfinite(found.height_m).all()
    known = np.isfinite(measured)
    assert np.array_equal(found.height_m[known], measured[known])
    values = np.concatenate([ground[np.isfinite(ground)], measured[known]])
    offset = abs(found.offset_m) + np.ptp(values)
    assert values.min() - offset <= found.height_m.min() and found.height_m.max() <= values.max() + offset
    order = rng.permutation(len(edge))
    turned = RoadGraph(edge[order][:, ::-1], length[order], structure[order], graph.lon_deg, graph.lat_deg)
    assert node_heights(turned, ground, measured).height_m == pytest.approx(found.height_m, abs=1e-6)
    # A datum of the ground that is another one changes nothing where something was measured of each kind.
    on_ground = known & np.isfinite(ground) & ~found.spanned
    if on_ground.any() and np.isfinite(found.offset_m) and found.offset_m != 0:
        other = node_heights(graph, ground + 47.0, measured)
        assert other.height_m == pytest.approx(found.height_m, abs=1e-6)
