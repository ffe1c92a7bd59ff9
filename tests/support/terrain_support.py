"""Posts and heights of made-up rasters, for tests of the terrain."""

from __future__ import annotations

import numpy as np
from affine import Affine
from numpy.typing import ArrayLike

from fusion.terrain.mosaic import DemPatch
from fusion.terrain.windows import HeightModel

POSTS = Affine(0.001, 0, 8.0, 0, -0.001, 49.0)  # of most rasters here: north-west post at (8, 49)


def hills(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    v, u = np.indices((rows, columns))
    noise = np.random.default_rng(seed).normal(size=(rows, columns))
    return 200 + 0.3 * u - 0.2 * v + noise


def at_posts(posts: Affine, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    v, u = np.indices((rows, columns))
    return posts.a * u + posts.b * v + posts.c, posts.d * u + posts.e * v + posts.f


def posts_deg(patch: DemPatch) -> tuple[np.ndarray, np.ndarray]:
    """Longitudes and latitudes of all posts of a patch, degrees, both of ``z``'s shape."""
    rows, columns = np.indices(patch.z.shape, float)
    return patch.mosaic.lonlat(patch.u0 + columns * patch.step, patch.v0 + rows * patch.step)


def heights_of(model: HeightModel, x_m: ArrayLike, y_m: ArrayLike) -> np.ndarray:
    """Heights at local metres, in the broadcast shape."""
    return np.asarray(np.vectorize(model.height_at, otypes=[float])(x_m, y_m))
