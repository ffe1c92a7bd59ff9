"""What is learned of roads place by place: sums over cells of the land, and what goes over smoothly between them.

A part of a network so learns what the whole does, but for its edge. What is learned is not known here.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fusion.frames import METRES_PER_DEGREE
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

CELL_M = 250.0
"""Spacing of the cells' middles: less than what a window is wider than what is published of it, so that windows agree;
with 500 m they do as well (``benchmarks/adjustment.py``)."""

_CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


class Cells:
    """Cells about the n segments of a network; each segment has a share in the four whose middles are around its own.

    ``share`` (n, c), rows adding up to 1, falls linearly with the distance to the north and to the east. The cells lie
    where they lie on earth, whatever part of a network is looked at. Segments of another ``kind`` (n,) have cells of
    their own.
    """

    def __init__(self, network: RoadTable, kind: Ints | None = None) -> None:
        lat = 0.5 * (network.lat0_deg + network.lat1_deg)
        lon = 0.5 * (network.lon0_deg + network.lon1_deg)
        band = np.rint(lat)  # columns are as wide as in the middle of their degree
        place = np.array([lat, lon * np.cos(np.radians(band))]) * (METRES_PER_DEGREE / CELL_M)
        low = np.floor(place)
        part = place - low
        cell = [(band, *(low + np.array(corner)[:, None])) for corner in _CORNERS]
        share = [np.prod(np.where(np.array(corner)[:, None], part, 1 - part), axis=0) for corner in _CORNERS]
        names = np.concatenate([np.array(c, float).reshape(3, -1).T for c in cell])
        _, number = np.unique(names @ [1e14, 1e7, 1.0], return_inverse=True)
        row = np.tile(np.arange(len(network)), len(_CORNERS))
        if kind is not None:
            _, number = np.unique(number * (kind.max(initial=0) + 1) + kind[row], return_inverse=True)
        self.share = sparse.csr_matrix(
            (np.concatenate(share), (row, number)), (len(network), number.max() + 1)
        )

    def sums(self, rows: Ints, values: Floats | float = 1.0) -> Floats:
        """Values (m,) at ``rows`` (m,) added up in each cell (c,), by share."""
        weights = np.broadcast_to(np.asarray(values, float), rows.shape)
        return np.asarray(self.share.T @ np.bincount(rows, weights, minlength=self.share.shape[0]))

    def at_rows(self, values: Floats) -> Floats:
        """What cells (c,) have, at each segment (n,)."""
        return np.asarray(self.share @ values)
