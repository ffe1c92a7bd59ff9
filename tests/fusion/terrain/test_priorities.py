"""Several rasters by priority, what fills their voids, who gives a height, and seams."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from fusion.terrain.dem import Dem

Write = Callable[..., Path]

FINE = Affine(0.0001, 0, 8.5, 0, -0.0001, 49.0)
COARSE = Affine(0.001, 0, 8.49, 0, -0.001, 49.01)


@pytest.fixture
def two(tmp_path: Path, write_raster: Write) -> list[Path]:
    """A fine raster at 10 m with a hole in the middle, 8.5 to 8.51 E, over a coarse one at 20 m."""
    fine = np.full((101, 101), 10.0, np.float32)
    fine[40:60, 40:60] = np.nan
    return [
        write_raster(tmp_path / "fine.tif", fine, FINE),
        write_raster(tmp_path / "coarse.tif", np.full((31, 31), 20.0, np.float32), COARSE),
    ]


IN_FINE, IN_HOLE, BEYOND = (8.502, 48.998), (8.505, 48.995), (8.515, 48.995)


def at(dem: Dem, *places: tuple[float, float]) -> list[float]:
    lon, lat = np.array(places).T
    return [float(h) for h in dem.heights(lon, lat)]


def test_the_finest_counts_where_no_priority_is_given_and_the_highest_where_one_is(two: list[Path]) -> None:
    for priorities in (None, [0, 0], [5, 1], [-1, -2]):
        with Dem.open(two, priorities) as dem:
            assert at(dem, IN_FINE, IN_HOLE, BEYOND) == [10, 20, 20]
    with Dem.open(two, [0, 1]) as dem:
        assert at(dem, IN_FINE, IN_HOLE, BEYOND) == [20, 20, 20]
        assert dem.names == ("coarse.tif", "fine.tif")


def test_who_gives_a_height_is_named(two: list[Path]) -> None:
    with Dem.open(two) as dem:
        assert dem.sources_at(*IN_FINE) == ("fine.tif",)
        assert dem.sources_at(*IN_HOLE) == ("coarse.tif",)
        assert dem.sources_at([IN_FINE[0], BEYOND[0]], [IN_FINE[1], BEYOND[1]]) == ("fine.tif", "coarse.tif")
        assert dem.sources_at(9.0, 48.0) == ()
        assert dem.sources_at(np.nan, 48.995) == ()
    with Dem.open(two, [0, 1]) as dem:
        assert dem.sources_at(*IN_FINE) == ("coarse.tif",)


def test_tiles_of_one_grid_leave_no_gap_whatever_their_priorities(
    tmp_path: Path, write_raster: Write
) -> None:
    """Tiles of pixels share no posts: the cells between the last of one and the first of the other are of both."""
    east = Affine(0.001, 0, 8.52, 0, -0.001, 49.0)
    paths = [
        write_raster(tmp_path / "west.tif", np.full((20, 20), 1.0), Affine(0.001, 0, 8.5, 0, -0.001, 49.0)),
        write_raster(tmp_path / "east.tif", np.full((20, 20), 3.0), east),
    ]
    between = (8.5195, 48.99)
    for priorities in ([0, 0], [1, 0], [0, 1], [7, -3]):
        with Dem.open(paths, priorities) as dem:
            assert at(dem, (8.51, 48.99), between, (8.53, 48.99)) == pytest.approx([1, 2, 3])
            assert set(dem.sources_at(*between)) == {"west.tif", "east.tif"}
            assert dem.sources_at(8.51, 48.99) == ("west.tif",)


def test_where_tiles_of_one_grid_overlap_the_higher_priority_counts(
    tmp_path: Path, write_raster: Write
) -> None:
    first, second = np.full((10, 10), 1.0), np.full((10, 10), 2.0)
    second[5, 5] = np.nan
    grid = Affine(0.001, 0, 8.0, 0, -0.001, 49.0)
    paths = [write_raster(tmp_path / f"{k}.tif", z, grid) for k, z in enumerate((first, second))]
    void = (8.005, 48.995)
    with Dem.open(paths, [0, 1]) as dem:
        assert at(dem, (8.001, 48.999), void) == [2, 1]
        assert dem.sources_at(*void) == ("0.tif",)
        assert len(dem.names) == 2
        assert dem.description.startswith("2 rasters")


def test_priorities_go_with_their_rasters_and_one_is_wanted_for_each(two: list[Path]) -> None:
    with Dem.open(two[::-1], [1, 0]) as dem:
        assert at(dem, IN_FINE) == [20]
    with pytest.raises(ValueError, match="zip"):
        Dem.open(two, [1])


@given(st.lists(st.floats(8.4905, 8.5195), min_size=2, max_size=6), st.floats(48.985, 49.0))
def test_no_line_steps_from_one_raster_to_the_other(
    steps: tuple[Dem, Dem], lon: list[float], lat: float
) -> None:
    """The two planes are 10 m apart and of one grade: the rise between any two places is that of either alone."""
    both, coarse = steps
    lons, lats = np.array(lon), np.full(len(lon), lat)
    found = both.heights_along(lons, lats, np.zeros(len(lon), np.int64))
    alone = coarse.heights(lons, lats)
    assert np.isfinite(found).all()
    assert found - found[0] == pytest.approx(alone - alone[0], abs=1e-6)


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory, write_raster: Write) -> tuple[Dem, Dem]:
    """A coarse plane with a fine one 10 m above it in its middle; the coarse one alone."""
    folder = tmp_path_factory.mktemp("steps")
    fine = np.tile(10 + 1000 * 0.0001 * np.arange(101), (201, 1))
    coarse = np.tile(-10 + 1000 * 0.001 * np.arange(31), (31, 1))
    paths = [
        write_raster(folder / "fine.tif", fine, FINE),
        write_raster(folder / "coarse.tif", coarse, COARSE),
    ]
    return Dem.open(paths), Dem.open(paths[1:])


def test_lines_are_of_the_first_raster_that_knows_them_whole(steps: tuple[Dem, Dem]) -> None:
    both, coarse = steps
    lon = np.array([8.501, 8.502, 8.505, 8.515])
    lat = np.full(4, 48.995)
    line = np.array([0, 0, 1, 1])
    found = both.heights_along(lon, lat, line)
    assert found[:2].tolist() == both.heights(lon[:2], lat[:2]).tolist()
    assert found[2:].tolist() == coarse.heights(lon[2:], lat[2:]).tolist()
    assert both.heights(lon[2], lat[2]) == pytest.approx(found[2] + 10)
    assert both.heights_along(lon[:0], lat[:0], line[:0]).shape == (0,)


def test_a_line_that_no_raster_knows_whole_is_filled_within_one_datum_only(
    tmp_path: Path, write_raster: Write
) -> None:
    west = write_raster(
        tmp_path / "west.tif", np.full((21, 21), 1.0), Affine(0.0005, 0, 8.5, 0, -0.0005, 49.0)
    )
    lon, lat, line = np.array([8.505, 8.515]), np.full(2, 48.995), np.zeros(2, np.int64)
    for crs, expected in ((4326, [1.0, 4.0]), ("EPSG:4326+5773", [1.0, np.nan])):
        east = write_raster(
            tmp_path / "east.tif", np.full((11, 11), 4.0), Affine(0.001, 0, 8.512, 0, -0.001, 49.0), crs
        )
        with Dem.open([west, east]) as dem:
            assert dem.heights_along(lon, lat, line) == pytest.approx(expected, nan_ok=True)
            assert dem.heights(lon, lat).tolist() == [1.0, 4.0]


def test_one_raster_gives_along_lines_what_it_gives_at_places(tmp_path: Path, write_raster: Write) -> None:
    z = np.random.default_rng(1).normal(100, 20, (40, 40))
    z[10:14, 10:14] = np.nan
    with Dem.open([write_raster(tmp_path / "a.tif", z, COARSE)]) as dem:
        lon, lat = np.random.default_rng(2).uniform([[8.48], [48.96]], [[8.54], [49.02]], (2, 500))
        line = np.arange(500) // 7
        alone, along = dem.heights(lon, lat), dem.heights_along(lon, lat, line)
        assert along.tobytes() == alone.tobytes()


def test_many_places_are_read_part_by_part_and_whole_lines_at_a_time(
    steps: tuple[Dem, Dem], monkeypatch: pytest.MonkeyPatch
) -> None:
    both, _ = steps
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(8.491, 8.519, 90), rng.uniform(48.985, 49.0, 90)
    for line in (np.repeat(np.arange(15), 6), np.tile(np.arange(45), 2), rng.integers(0, 9, 90)):
        at_once = both.heights_along(lon, lat, line)
        for places in (1, 7, 8, 90):
            with monkeypatch.context() as patch:
                patch.setattr("fusion.terrain.dem._PLACES_AT_ONCE", places)
                assert both.heights_along(lon, lat, line).tobytes() == at_once.tobytes()


def test_a_filtered_model_names_who_fills(tmp_path: Path, write_raster: Write) -> None:
    scenes = np.full((101, 101), 8, np.int16)
    scenes[40:60, 40:60] = -1
    elevations = write_raster(tmp_path / "a_dem.tif", np.full((101, 101), 10, np.int16), FINE)
    write_raster(tmp_path / "a_num.tif", scenes, FINE)
    coarse = write_raster(tmp_path / "coarse.tif", np.full((31, 31), 20, np.int16), COARSE)
    with Dem.open([elevations, coarse], [0, 0]) as dem:
        assert dem.sources_at(*IN_HOLE) == ("a_dem.tif",)
        assert dem.filtered(1).sources_at(*IN_HOLE) == ("coarse.tif",)
