"""Corrected elevation models: what changes and what stays, and what who samples along roads gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine

from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.corrected import blocks
from fusion.terrain.corrected.fit import Block, Change, CorrectedTerrain, Levels, Rule
from fusion.terrain.corrected.grids import ArcSeconds, MercatorPixels, PostGrid, posting_m
from fusion.terrain.corrected.roads import RoadHeights
from fusion.terrain.dem import Dem

GRID = ArcSeconds()
WEST, NORTH = 8.0, 49.0
SIDE = 80
COLUMNS, ROWS = (range(int(w), int(w) + SIDE) for w in GRID.coordinates(np.array(WEST), np.array(NORTH)))
POSTS = Affine(1 / 3600, 0, WEST, 0, -1 / 3600, NORTH)
FLAT = np.full((SIDE, SIDE), 200.0, np.float32)


def heights_at(
    block: Block, lon: Any, lat: Any, grid: PostGrid = GRID, columns: range = COLUMNS, rows: range = ROWS
) -> Any:
    """Bilinear between posts, as routers sample."""
    u, v = grid.coordinates(np.asarray(lon), np.asarray(lat))
    u, v = u - columns.start, v - rows.start
    left, top = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b, z = u - left, v - top, block.height_m
    upper = (1 - a) * z[top, left] + a * z[top, left + 1]
    return (1 - b) * upper + b * ((1 - a) * z[top + 1, left] + a * z[top + 1, left + 1])


def road(posts: Any, heights_m: Any, structure: Any = False, way: int = 1) -> RoadHeights:
    """A road through places in posts (column, row) of the raster, with its height at each."""
    at = np.asarray(posts, float)
    lon, lat = WEST + at[:, 0] / 3600, NORTH - at[:, 1] / 3600
    east, north = posting_m(GRID, COLUMNS[40], ROWS[40])
    length = np.hypot(np.diff(at[:, 0]) * east, np.diff(at[:, 1]) * north)
    height, n = np.asarray(heights_m, float), len(at) - 1
    unknown = np.full(n, np.nan)
    return RoadHeights(
        lon[:-1], lat[:-1], lon[1:], lat[1:], length, height[:-1], height[1:], unknown, unknown, unknown,
        np.full(n, 0.2), np.broadcast_to(np.asarray(structure), n).copy(), np.full(n, way),
    )  # fmt: skip


@pytest.fixture
def corrected(write_raster: Any, tmp_path: Path) -> Any:
    def make(z: Any, roads: RoadHeights, **rule: Any) -> Block:
        with Dem.open([write_raster(tmp_path / "dem.tif", np.asarray(z, np.float32), POSTS)]) as dem:
            return CorrectedTerrain(dem, roads, Rule(**rule)).block(GRID, COLUMNS, ROWS)

    return make


DIAGONAL = np.column_stack([np.linspace(20, 60, 30), np.linspace(25, 52, 30)])


def test_a_plane_on_which_roads_lie_stays(corrected: Any) -> None:
    """Whatever the offset of the datums is."""
    v, u = np.indices((SIDE, SIDE))
    plane = 200 + 0.5 * u - 0.25 * v
    block = corrected(plane, road(DIAGONAL, 250 + 0.5 * DIAGONAL[:, 0] - 0.25 * DIAGONAL[:, 1]))
    assert np.abs(block.height_m - plane).max() < 1e-4
    assert set(np.unique(block.change)) == {Change.NONE, Change.BLENDED, Change.ROAD}


@pytest.mark.parametrize("whole", [False, True])
def test_away_from_roads_nothing_changes(corrected: Any, whole: bool) -> None:
    rough = np.round(np.random.default_rng(1).normal(200, 5, (SIDE, SIDE)))
    block = corrected(rough, road(DIAGONAL, 200 + 5 * np.sin(DIAGONAL[:, 0] / 5)), whole=whole, blend_m=90.0)
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    along = np.column_stack([np.linspace(20, 60, 2000), np.linspace(25, 52, 2000)])
    apart = np.array(posting_m(GRID, COLUMNS[40], ROWS[40]))
    off = np.hypot(*((np.stack([u, v], -1)[:, :, None] - along) * apart).transpose(3, 0, 1, 2)).min(axis=2)
    assert (block.change[off > 91] == Change.NONE).all()
    assert (block.height_m[off > 91] == rough[off > 91]).all()
    assert (block.change[off < 89] != Change.NONE).all()
    assert (block.height_m[off < 20] != rough[off < 20]).mean() > 0.5
    if whole:
        assert (block.height_m == np.round(block.height_m)).all()


def test_a_deck_lies_over_a_valley(corrected: Any) -> None:
    """And its ends have the height of the deck's, where the model knows the valley's side."""
    u = np.indices((SIDE, SIDE))[1]
    valley = 200 - 30 * np.exp(-(((u - 40) / 5) ** 2))
    places = np.column_stack([np.arange(15, 66, 2.5), np.full(21, 40.3)])
    deck = (places[:-1, 0] >= 30) & (places[1:, 0] <= 50)
    block = corrected(valley, road(places, np.full(21, 200.0), deck))
    lon = WEST + np.linspace(16, 64, 200) / 3600
    along = heights_at(block, lon, np.full(200, NORTH - 40.3 / 3600))
    assert np.abs(along - along[0]).max() < 0.15
    assert (block.change[40, 32:48] == Change.STRUCTURE).all()
    assert (block.change[40, 18:28] == Change.ROAD).all()
    assert block.height_m[60, 40] == pytest.approx(170, abs=0.01), "beside it the valley stays"


def crossing(corrected: Any, levels: Levels, *, junction: bool = True) -> tuple[float, Any, Any]:
    """The height where a bridge of 8 m crosses a street; heights along the street, whose node is there if it is a
    ``junction``, and along the bridge.
    """
    across = np.column_stack([np.arange(15, 66, 2.5), np.full(21, 40.4)])
    deck = (across[:-1, 0] >= 30) & (across[1:, 0] <= 50)
    below = np.column_stack([np.full(21, 40.4), np.arange(15, 66, 2.5) + (0.4 if junction else 1.65)])
    over, under = road(across, np.full(21, 208.0), deck), road(below, np.full(21, 200.0), way=2)
    block = corrected(FLAT, over.joined(under), levels=levels)
    there = heights_at(block, WEST + 40.4 / 3600, NORTH - 40.4 / 3600)
    along = np.linspace(20, 60, 100)
    street = heights_at(block, np.full(100, WEST + 40.4 / 3600), NORTH - along / 3600)
    bridge = heights_at(block, WEST + along / 3600, np.full(100, NORTH - 40.4 / 3600))
    return float(there - np.median(street[:20])), street, bridge


@pytest.mark.parametrize("levels", [Levels.GROUND, Levels.UPPER])
def test_where_roads_cross_at_two_levels_one_has_the_posts(corrected: Any, levels: Levels) -> None:
    upper = levels is Levels.UPPER
    there, street, bridge = crossing(corrected, levels)
    assert there == pytest.approx(8 if upper else 0, abs=0.3)
    winner, loser = (bridge, street) if upper else (street, bridge)
    assert np.ptp(winner) < 0.7
    assert np.ptp(loser) > 5


def test_shared_posts_are_a_junction_s_before_a_deck_s_and_steps_are_lower(
    corrected: Any,
) -> None:
    assert crossing(corrected, Levels.SHARED)[0] < 2.5, (
        "the node of the street below counts more than the deck"
    )
    there, street, bridge = crossing(corrected, Levels.SHARED, junction=False)
    assert 2 < there < 6
    alone = crossing(corrected, Levels.GROUND, junction=False)[2]
    for line in (street, bridge):
        assert np.abs(np.diff(line)).max() < 0.8 * np.abs(np.diff(alone)).max()


def test_voids_near_roads_are_filled_and_others_stay(corrected: Any) -> None:
    z = FLAT.copy()
    z[20:60, 35:45] = np.nan
    z[0:10, 0:10] = np.nan
    block = corrected(z, road(DIAGONAL, np.full(30, 203.0)))
    along = heights_at(block, WEST + DIAGONAL[1:-1, 0] / 3600, NORTH - DIAGONAL[1:-1, 1] / 3600)
    assert np.abs(along - 200).max() < 0.05
    assert np.isnan(block.height_m[:10, :10]).all()


def test_without_a_model_only_what_is_beside_roads_is_known() -> None:
    block = CorrectedTerrain(None, road(DIAGONAL, np.full(30, 203.0))).block(GRID, COLUMNS, ROWS)
    assert np.isnan(block.height_m[0, 0])
    assert np.nanmax(np.abs(block.height_m - 203)) < 1e-6


@pytest.fixture(scope="module")
def of_town(town: Town, tmp_path_factory: pytest.TempPathFactory) -> tuple[Dem, RoadHeights]:
    """The simulated town's erring model, and its true roads 3 m above its datum."""
    folder = tmp_path_factory.mktemp("town")
    write_dem(town, folder / "dem.tif")
    roads, unknown = town.roads, np.full(len(town.roads), np.nan)
    start, end = (town.node_height_m[side] + 3 for side in (town.start, town.end))
    table = RoadHeights(
        roads.lon0_deg, roads.lat0_deg, roads.lon1_deg, roads.lat1_deg, town.length_m, start, end, unknown, unknown,
        unknown, np.full(len(roads), 0.3), roads.bridge | roads.tunnel, roads.osm_way_id,
    )  # fmt: skip
    return Dem.open([folder / "dem.tif"]), table


def _window(grid: PostGrid, roads: RoadHeights) -> tuple[range, range]:
    u, v = grid.coordinates(np.r_[roads.lon0_deg, roads.lon1_deg], np.r_[roads.lat0_deg, roads.lat1_deg])
    columns, rows = (range(int(w.min()) - 9, int(w.max()) + 10) for w in (u, v))
    return columns, rows


def _slope_error(grid: PostGrid, dem: Dem, roads: RoadHeights, wanted: RoadHeights, **rule: Any) -> float:
    """Of all roads on the ground, rms, percent."""
    columns, rows = _window(grid, roads)
    block = CorrectedTerrain(dem, wanted, Rule(**rule)).block(grid, columns, rows)
    ends = [heights_at(block, lon, lat, grid, columns, rows)
            for lon, lat in ((roads.lon0_deg, roads.lat0_deg), (roads.lon1_deg, roads.lat1_deg))]  # fmt: skip
    true = roads.height_to_m - roads.height_from_m
    error = 100 * (ends[1] - ends[0] - true) / roads.length_m
    return float(np.sqrt(np.nanmean(error[~roads.structure] ** 2)))


@pytest.mark.parametrize("grid", [ArcSeconds(), ArcSeconds(3), MercatorPixels(12)])
def test_slopes_along_roads_err_far_less(of_town: tuple[Dem, RoadHeights], grid: PostGrid) -> None:
    """On posts 30 m apart almost all is had, on 90 m half."""
    dem, roads = of_town
    none = RoadHeights.empty()
    before, after = (_slope_error(grid, dem, roads, wanted) for wanted in (none, roads))
    whole = _slope_error(grid, dem, roads, roads, whole=True)
    fine = grid != ArcSeconds(3)
    assert before > (3 if fine else 2)
    assert after < before * (0.1 if fine else 0.6)
    assert whole < before * (0.2 if fine else 0.7)


def test_whole_metres_are_better_than_rounded_ones(of_town: tuple[Dem, RoadHeights]) -> None:
    dem, roads = of_town
    columns, rows = _window(GRID, roads)
    fine = CorrectedTerrain(dem, roads).block(GRID, columns, rows)
    whole = CorrectedTerrain(dem, roads, Rule(whole=True)).block(GRID, columns, rows)
    on_ground = roads.take(~roads.structure)

    def error(block: Block) -> float:
        low = heights_at(block, on_ground.lon0_deg, on_ground.lat0_deg, columns=columns, rows=rows)
        high = heights_at(block, on_ground.lon1_deg, on_ground.lat1_deg, columns=columns, rows=rows)
        true = on_ground.height_to_m - on_ground.height_from_m
        return float(np.sqrt(np.nanmean(((high - low - true) / on_ground.length_m) ** 2)))

    rounded = Block(np.round(fine.height_m), fine.change)
    assert error(whole) < 0.6 * error(rounded)
    assert np.nanmax(np.abs(whole.height_m - fine.height_m)) <= 2.6


def test_the_slow_offset_is_taken_off(of_town: tuple[Dem, RoadHeights]) -> None:
    dem, roads = of_town
    assert CorrectedTerrain(dem, roads).offset_m == pytest.approx(3, abs=1.5), "the model errs by metres"
    assert CorrectedTerrain(None, roads).offset_m == 0


def test_where_a_way_of_a_bridge_ends_its_height_stays(corrected: Any) -> None:
    """Also over another road: routers take a bridge's height there."""
    across = np.column_stack([np.arange(15, 66, 2.5), np.full(21, 40.4)])
    deck = (across[:-1, 0] >= 30) & (across[1:, 0] <= 50)
    below = np.column_stack([np.full(21, 40.4), np.arange(15, 66, 2.5)])
    heights = []
    for second in (1, 3):
        over = road(across, np.full(21, 208.0), deck)
        over.way[10:] = second  # the deck is of one way, or of two that meet near the other road
        block = corrected(FLAT, over.joined(road(below, np.full(21, 200.0), way=2)))
        heights.append(heights_at(block, WEST + across[10, 0] / 3600, NORTH - 40.4 / 3600))
    one, two = heights
    assert two - one > 5


def test_one_post_for_a_node_has_its_height(of_town: tuple[Dem, RoadHeights]) -> None:
    """As GraphHopper takes it without interpolation: of 3601 parts of a degree the one that a place is in."""
    dem, roads = of_town
    columns, rows = _window(GRID, roads)
    on_ground = roads.take(~roads.structure & (roads.length_m > 40))

    def error(wanted: RoadHeights, *, one_post: bool) -> float:
        z = (
            CorrectedTerrain(dem, wanted, Rule(one_post=one_post, whole=True))
            .block(GRID, columns, rows)
            .height_m
        )

        def at(lon: Any, lat: Any) -> Any:
            east, north = (np.floor(3601 * (w - np.floor(w))).astype(int) for w in (lon, lat))
            column = (np.floor(lon).astype(int) + 180) * 3600 + east - columns.start
            return z[(90 - np.floor(lat).astype(int)) * 3600 - north - rows.start, column]

        rise = at(on_ground.lon1_deg, on_ground.lat1_deg) - at(on_ground.lon0_deg, on_ground.lat0_deg)
        misfit = (rise - on_ground.height_to_m + on_ground.height_from_m) / on_ground.length_m
        return float(np.sqrt(np.nanmean(misfit**2)))

    before, other, after = (
        error(w, one_post=p) for w, p in ((RoadHeights.empty(), False), (roads, False), (roads, True))
    )
    assert after < 0.6 * other < 0.6 * before
    assert after < 0.4 * before


@pytest.mark.parametrize("whole", [False, True])
def test_blocks_agree_where_they_meet(
    of_town: tuple[Dem, RoadHeights], monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    """Small ones make the same surface as a large one; whole metres are chosen by the block."""
    dem, roads = of_town
    columns, rows = _window(GRID, roads)
    one = CorrectedTerrain(dem, roads, Rule(whole=whole)).block(GRID, columns, rows)
    monkeypatch.setattr(blocks, "SIDE_POSTS", 40)
    many = blocks.Blocks(CorrectedTerrain(dem, roads, Rule(whole=whole)), GRID).window(columns, rows)
    assert (one.change == many.change).all()
    apart = np.abs(one.height_m - many.height_m)
    if whole:
        assert np.nanquantile(apart, 0.95) == 0
    else:
        assert np.nanmax(apart) < 0.02
        assert np.nanmean(apart) < 1e-3
