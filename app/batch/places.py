"""Places: tiles by which roads, passes and logs are kept together."""

from __future__ import annotations

import numpy as np

from fusion.arrays import counted
from fusion.types import Floats, Ints

PLACE_ZOOM, CELL_ZOOM = 10, 14
"""Of the tiles whose roads and passes are one file, and of those by which passes in it are in order."""
EDGE_DEG = 85.0511287798066
_INNER = CELL_ZOOM - PLACE_ZOOM


def tiles(lon_deg: Floats, lat_deg: Floats, zoom: int) -> tuple[Ints, Ints]:
    """Column and row of the tile of each position, (n,) each; those beyond the edge in the last ones."""
    count = 1 << zoom
    lat = np.radians(np.clip(lat_deg, -EDGE_DEG, EDGE_DEG))
    column = np.floor((np.asarray(lon_deg) + 180) / 360 * count)
    row = np.floor((1 - np.arcsinh(np.tan(lat)) / np.pi) / 2 * count)
    return (
        np.clip(column, 0, count - 1).astype(np.int64),
        np.clip(row, 0, count - 1).astype(np.int64),
    )


def places(lon_deg: Floats, lat_deg: Floats) -> Ints:
    """The number of the place of each position, (n,); ``place_name`` has its name."""
    column, row = tiles(lon_deg, lat_deg, PLACE_ZOOM)
    return interleaved(column, row)


def cells(lon_deg: Floats, lat_deg: Floats) -> Ints:
    """The number of the cell of each position, (n,): near ones have near numbers, and a place has a run of them."""
    return interleaved(*tiles(lon_deg, lat_deg, CELL_ZOOM))


def place_of_cell(cell: Ints) -> Ints:
    """The place that each cell lies in."""
    return cell >> 2 * _INNER


def interleaved(column: Ints, row: Ints) -> Ints:
    """Bits of both by turns (Morton 1966), so that the order of numbers keeps neighbours together."""
    out = np.zeros_like(column)
    for bit in range(CELL_ZOOM):
        out |= (column >> bit & 1) << 2 * bit | (row >> bit & 1) << 2 * bit + 1
    return out


def place_name(place: int) -> str:
    """Of a place, for a file: zoom, column, row."""
    column = sum((place >> 2 * bit & 1) << bit for bit in range(PLACE_ZOOM))
    row = sum((place >> 2 * bit + 1 & 1) << bit for bit in range(PLACE_ZOOM))
    return f"{PLACE_ZOOM}-{column}-{row}"


def place_of_name(name: str) -> int:
    """The place that is called so."""
    _, column, row = (int(part) for part in name.split("-"))
    return int(interleaved(np.array(column), np.array(row)))


def places_met(west: Floats, south: Floats, east: Floats, north: Floats) -> tuple[Ints, Ints]:
    """Which places boxes (n,) meet: the number of the box, ascending, and the place."""
    left, low = tiles(west, south, PLACE_ZOOM)
    right, high = tiles(east, north, PLACE_ZOOM)
    across = right - left + 1
    box, k = counted(across * (low - high + 1))
    return box, interleaved(left[box] + k % across[box], high[box] + k // across[box])
