"""What netconvert is given of an elevation model is where the model has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.terrain.dem import Dem
from routers.samplers import VOID
from routers.sumo import _write_geotiff


def test_the_part_of_a_tile_that_holds_heights_stays_where_it_is(tmp_path: Path) -> None:
    tile = np.full((3601, 3601), VOID, ">i2")
    v, u = np.indices((300, 200))
    tile[1000:1300, 2000:2200] = 2 * u + v
    path = tmp_path / "N49E008.hgt"
    path.write_bytes(tile.tobytes())
    _write_geotiff(path, tmp_path / "model.tif")
    lon, lat = 8 + np.array([2010.0, 2100.5, 2190.0]) / 3600, 50 - np.array([1010.0, 1100.0, 1290.5]) / 3600
    with Dem.open([tmp_path / "model.tif"]) as dem:
        assert np.allclose(dem.heights(lon, lat), [2 * 10 + 10, 2 * 100.5 + 100, 2 * 190 + 290.5], atol=1e-3)
