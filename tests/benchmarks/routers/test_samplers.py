"""Samplers of routers on a plane, and what Valhalla writes of it."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.terrain.corrected.grids import ArcSeconds
from routers.programs import decoded
from routers.samplers import HgtTile, stations_m, valhalla_grades


@pytest.fixture(scope="module")
def tile(tmp_path_factory: pytest.TempPathFactory) -> HgtTile:
    """Heights of 2 m a column and 1 m a row."""
    v, u = np.indices((3601, 3601))
    path = tmp_path_factory.mktemp("hgt") / "N49E008.hgt"
    path.write_bytes((2 * u + v).astype(">i2").tobytes())
    return HgtTile(path)


PLACES = np.random.default_rng(1).random((200, 2)) * 0.99 + 0.001


def test_who_interpolates_gets_the_plane(tile: HgtTile) -> None:
    lon, lat = 8 + PLACES[:, 0], 49 + PLACES[:, 1]
    plane = 7200 * PLACES[:, 0] + 3600 * (1 - PLACES[:, 1])
    assert tile.bilinear(lon, lat) == pytest.approx(plane, abs=1e-6)
    quarters = tile.quarters(lon, lat)
    assert (4 * quarters == np.round(4 * quarters)).all()
    assert ((plane - quarters > -1e-6) & (plane - quarters < 0.25)).all()


def test_one_post_is_the_one_that_the_export_sets(tile: HgtTile) -> None:
    lon, lat = 8 + PLACES[:, 0], 49 + PLACES[:, 1]
    column, row = ArcSeconds().one_post(lon, lat)
    assert (tile.one_post(lon, lat) == 2 * (column - 188 * 3600) + row - 40 * 3600).all()


def test_grades_as_edges_have_them() -> None:
    assert stations_m(150.0).tolist() == [0, 60, 120, 150]
    assert valhalla_grades(np.array([0.0, 1.0]), 9.0, structure=False) == (0, 0)
    mean, most = valhalla_grades(np.array([100.0, 103.0, 106.0]), 120.0, structure=False)
    assert (mean, most) == (pytest.approx(5), 5)
    assert valhalla_grades(np.array([106.0, 103.0, 100.0]), 120.0, structure=False)[1] == 0
    deck = valhalla_grades(np.array([100.0, 50.0, 106.0]), 120.0, structure=True)
    assert deck[1] == 4, "6 m in as many parts as there are stations"


def test_polylines_of_six_digits() -> None:
    assert decoded("_izlhA~rlgdF_{geC~ywl@_kwzCn`{nI") == pytest.approx(
        np.array([[-120.2, 38.5], [-120.95, 40.7], [-126.453, 43.252]])
    )
