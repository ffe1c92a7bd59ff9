"""Signed distance fields: letters and signs as maps in a browser take them, sharp at every size and turn.

Each pixel says how far its middle is from the outline. The distances are exact, to the outline's own lines, instead of
being taken from a picture of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion.types import Floats

CUTOFF = 0.25
"""Of the range of a pixel's values, what lies inside of an outline: 191 is on it, as renderers of maps expect."""
_ROWS_AT_ONCE = 512


def distance_field(
    contours: Sequence[Floats], left: int, top: int, width: int, height: int, *, radius: float = 8.0
) -> NDArray[np.uint8]:
    """A picture of ``height`` rows of ``width`` pixels, whose upper left corner is at (left, top).

    ``contours`` are closed lines (n, 2), x to the right and y upwards, in pixels; what they wind around is inside
    (nonzero rule). A pixel on the outline is 191, one that is ``radius`` farther outside is 64 levels a quarter of the
    radius less, and none is below 0 or above 255.
    """
    x = left + 0.5 + np.arange(width)
    y = top - 0.5 - np.arange(height)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    starts = np.concatenate(list(contours))
    ends = np.concatenate([np.roll(line, -1, axis=0) for line in contours])
    pieces = [
        _signed_distance(points[k : k + _ROWS_AT_ONCE], starts, ends)
        for k in range(0, len(points), _ROWS_AT_ONCE)
    ]
    outside = np.concatenate(pieces) / radius + CUTOFF
    return np.clip(np.rint(255 - 256 * outside), 0, 255).astype(np.uint8).reshape(height, width)


def _signed_distance(points: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distance of points (m, 2) from lines (n, 2) to (n, 2): positive outside."""
    along = ends - starts
    length2 = np.maximum((along**2).sum(axis=1), 1e-18)
    to = points[:, None, :] - starts[None, :, :]
    share = np.clip((to * along).sum(axis=2) / length2, 0.0, 1.0)
    away = to - share[:, :, None] * along
    nearest = np.sqrt((away**2).sum(axis=2).min(axis=1))
    # How often the outline winds around a point: lines that a ray to the right crosses upwards, less downwards.
    y = points[:, 1, None]
    turn = along[:, 0] * to[:, :, 1] - along[:, 1] * to[:, :, 0]
    upwards = (starts[:, 1] <= y) & (ends[:, 1] > y) & (turn > 0)
    downwards = (starts[:, 1] > y) & (ends[:, 1] <= y) & (turn < 0)
    winding = upwards.sum(axis=1) - downwards.sum(axis=1)
    return np.asarray(np.where(winding != 0, -nearest, nearest), float)
