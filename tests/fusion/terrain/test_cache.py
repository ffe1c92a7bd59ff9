"""What an elevation model keeps in memory: bounded, shared by threads, gone when it is closed."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from affine import Affine

from fusion.terrain import cache
from fusion.terrain.dem import Dem
from terrain_support import POSTS, hills

Write = Callable[..., Path]


def test_memory_and_open_files_are_bounded(
    tmp_path: Path, write_raster: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "MAX_OPEN_FILES", 2)
    monkeypatch.setattr(cache, "MAX_BLOCKS", 3)
    z = hills(300, 300)
    paths = [
        write_raster(
            tmp_path / f"{r}{c}.tif",
            z[r : r + 100, c : c + 100],
            Affine(0.001, 0, 8 + 0.001 * c, 0, -0.001, 49 - 0.001 * r),
        )
        for r in (0, 100, 200)
        for c in (0, 100, 200)
    ]
    rng = np.random.default_rng(2)
    with Dem.open(paths) as dem:
        for _ in range(3):
            rows, columns = rng.integers(0, 300, (2, 500))
            assert dem.heights(8 + columns * 0.001, 49 - rows * 0.001).tolist() == z[rows, columns].tolist()
            assert len(dem._cache._files) <= 2
            assert len(dem._cache._blocks) <= 3


def test_several_threads_may_ask_at_once(
    tmp_path: Path, write_raster: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "MAX_BLOCKS", 2)
    z = hills(900, 900)
    rng = np.random.default_rng(4)
    wanted = [rng.integers(0, 900, (2, 400)) for _ in range(24)]
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS)]) as dem, ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda w: dem.heights(8 + w[1] * 0.001, 49 - w[0] * 0.001), wanted))
    for w, heights in zip(wanted, found, strict=True):
        assert heights.tolist() == z[w[0], w[1]].tolist()


def test_a_closed_model_says_so(tmp_path: Path, write_raster: Write) -> None:
    dem = Dem.open([write_raster(tmp_path / "a.tif", hills(5, 5), POSTS)])
    dem.close()
    with pytest.raises(ValueError, match="closed"):
        dem.heights(8.001, 48.999)
