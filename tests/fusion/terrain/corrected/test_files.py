"""Files of corrected models: names, layouts, posts on edges, bytes."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from fusion.terrain.corrected.blocks import Blocks
from fusion.terrain.corrected.files import (
    Layout,
    bounds_of,
    degrees_with,
    tile_name,
    write_geotiff,
    write_hgt,
)
from fusion.terrain.corrected.fit import Change, CorrectedTerrain, Rule
from fusion.terrain.corrected.grids import ArcSeconds
from fusion.terrain.corrected.roads import RoadHeights
from fusion.terrain.dem import Dem

COARSE = ArcSeconds(3)


def across_the_edge() -> RoadHeights:
    """A road that crosses 8 E at 49.5 N, 300 m above nothing."""
    lon = 7.995 + np.arange(11) * 0.001
    n, lat = 10, np.full(11, 49.5003)
    heights, unknown = np.linspace(300, 310, 11), np.full(10, np.nan)
    return RoadHeights(
        lon[:-1], lat[:-1], lon[1:], lat[1:], np.full(n, 72.3), heights[:-1], heights[1:], unknown, unknown, unknown,
        np.full(n, 0.2), np.zeros(n, bool), np.ones(n, np.int64),
    )  # fmt: skip


def test_tiles_are_named_by_their_corner() -> None:
    assert [tile_name(*corner) for corner in ((49, 8), (-1, -1), (0, 0), (-33, 151))] == [
        "N49E008", "S01W001", "N00E000", "S33E151",
    ]  # fmt: skip


def test_a_road_touches_the_tiles_that_it_reaches() -> None:
    roads = across_the_edge()
    assert degrees_with(roads, 100) == [(49, 7), (49, 8)]
    assert degrees_with(roads.take(slice(6, None)), 50) == [(49, 8)]
    assert degrees_with(roads.take(slice(6, None)), 200) == [(49, 7), (49, 8)]
    assert degrees_with(RoadHeights.empty(), 100) == []


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> dict[Layout, Path]:
    """The same road in each layout, without a model."""
    folder, roads = tmp_path_factory.mktemp("hgt"), across_the_edge()
    made = {}
    for layout in Layout:
        blocks = Blocks(CorrectedTerrain(None, roads, Rule(whole=True)), COARSE)
        made[layout] = folder / f"{layout}.zip"
        void = write_hgt(made[layout], blocks, degrees_with(roads, 100), layout, "Roads © somebody")
        assert void == ["N49E007", "N49E008"], "without a model most of them is"
    return made


def test_layouts(archives: dict[Layout, Path]) -> None:
    """Each router finds its names, and the same tiles."""
    names = {
        Layout.VALHALLA: ["N49/N49E007.hgt", "N49/N49E008.hgt"],
        Layout.BROUTER: ["N49E007.hgt", "N49E008.hgt"],
        Layout.GRAPHHOPPER: ["N49E007.hgt.zip", "N49E008.hgt.zip"],
    }
    tiles = []
    for layout, path in archives.items():
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
            assert archive.read("README.txt").decode() == "Roads © somebody"
            others = ["README.txt", "changed/N49E007.tif", "changed/N49E008.tif"]
            assert sorted(archive.namelist()) == sorted([*names[layout], *others])
            data = [archive.read(name) for name in names[layout]]
        if layout is Layout.GRAPHHOPPER:
            data = [
                zipfile.ZipFile(io.BytesIO(one)).read(f"N49E00{k}.hgt")
                for k, one in zip((7, 8), data, strict=True)
            ]
        tiles.append(data)
    assert tiles[0] == tiles[1] == tiles[2]
    assert all(len(one) == 2 * 1201 * 1201 for one in tiles[0])


def test_gdal_reads_tiles_and_neighbours_share_their_edge(
    archives: dict[Layout, Path], tmp_path: Path
) -> None:
    zipfile.ZipFile(archives[Layout.BROUTER]).extractall(tmp_path)
    posts = []
    for name in ("N49E007", "N49E008"):
        with (
            rasterio.open(tmp_path / f"{name}.hgt") as tile,
            rasterio.open(tmp_path / f"changed/{name}.tif") as changed,
        ):
            assert tile.bounds == pytest.approx(changed.bounds)
            z, what = tile.read(1), changed.read(1)
        assert ((z == -32768) == (what == Change.NONE)).all()
        known = z[what > 0]
        assert 299 <= known.min() < known.max() <= 311
        posts.append((z, what))
    for west, east in zip(*posts, strict=True):
        assert (west[:, -1] == east[:, 0]).all()
        assert len(np.unique(west[:, -1])) > 1
    with Dem.open([tmp_path / "N49E007.hgt", tmp_path / "N49E008.hgt"]) as dem:
        assert dem.datum == "EGM96"
        assert dem.heights(8.0, 49.5003) == pytest.approx(305, abs=1)


def test_a_geotiff_keeps_millimetres_and_says_where_it_comes_from(tmp_path: Path) -> None:
    roads, made = across_the_edge(), []
    for name in ("a.tif", "b.tif"):
        blocks = Blocks(CorrectedTerrain(None, roads), ArcSeconds())
        tags = {"ATTRIBUTION": "Roads © somebody"}
        count = write_geotiff(tmp_path / name, blocks, bounds_of(roads, 120), "EGM2008", tags)
        made.append((tmp_path / name).read_bytes())
    assert made[0] == made[1]
    assert {path.name for path in tmp_path.iterdir()} == {"a.tif", "b.tif"}
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.tags()["ATTRIBUTION"] == "Roads © somebody"
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        z, change = file.read()
        assert np.count_nonzero(change) == count > 250
        assert set(np.unique(change)) == {0, 1, 2}
        row, column = file.index(7.995 + 0.005, 49.5003)
        assert z[row - 1 : row + 2, column - 1 : column + 2].max() % 1 > 0
    with Dem.open([tmp_path / "a.tif"]) as dem:
        assert dem.datum == "EGM2008"
        assert dem.heights(roads.lon0_deg, roads.lat0_deg) == pytest.approx(roads.height_from_m, abs=0.1)


def test_work_can_be_ended_at_each_block() -> None:
    def look() -> Any:
        raise KeyboardInterrupt

    blocks = Blocks(CorrectedTerrain(None, across_the_edge()), COARSE, look)
    with pytest.raises(KeyboardInterrupt):
        blocks.window(range(10), range(10))
