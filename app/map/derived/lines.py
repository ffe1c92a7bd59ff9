"""Lines of two points, as segments are, out of the database, and the plane that they are drawn on."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from fusion.types import Floats

HALF_WORLD = 20037508.342789244
"""Half the width of the world, EPSG:3857."""
LINE = np.dtype([("head", "u1", 13), ("xy", "<f8", (2, 2))])
"""A line of two points as the database sends it: little-endian EWKB with its SRID."""


def lines(column: Collection[bytes]) -> Floats:
    """The ends of lines of two points (n, 2, 2)."""
    return np.asarray(np.frombuffer(b"".join(column), LINE)["xy"], float)
