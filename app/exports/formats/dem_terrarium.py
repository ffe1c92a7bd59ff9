"""Terrarium tiles, in a PMTiles archive, of the elevation model in which roads have their measured heights.

Consumers: MapLibre (``raster-dem`` with ``encoding: terrarium``) and GraphHopper (``PMTilesElevationProvider``, which
keeps whole metres). Grammar: PNG of 256 x 256 pixels; the height in metres is red x 256 + green + blue / 256 - 32768.
Heights are fitted to the middles of the pixels of each zoom anew. Tiles have no void: theirs is 0 m, as is usual.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from app.exports.format import ALL_FILTERS, Format, Stated, nothing_beside
from app.exports.formats.pmtiles import PNG, ZoomOptions, tile_number, write_pmtiles
from app.exports.writing.relief import ReliefOptions, relief_of

if TYPE_CHECKING:
    from app.exports.source import Source, Tile
    from fusion.terrain.corrected.fit import CorrectedTerrain
    from fusion.types import Floats

_LOWEST_M = -32768


class TerrariumOptions(ZoomOptions, ReliefOptions):
    """Which tiles."""

    min_zoom: int = Field(9, ge=5, le=14, description="The lowest zoom.")
    max_zoom: int = Field(
        12, ge=5, le=14, description="The highest zoom: a pixel of 12 is 25 m at 49 degrees north."
    )


class DemTerrarium(Format):
    """The tiles in which a road was measured, and those beside it."""

    name = "dem-terrarium"
    consumer = "MapLibre, GraphHopper (Terrarium PNG in PMTiles)"
    suffixes = (".terrarium.pmtiles",)
    media_type = "application/vnd.pmtiles"
    description = f"Elevation model with the measured heights of roads along them, as tiles ({consumer})"
    options = TerrariumOptions
    holds = "tiles"
    filters = ALL_FILTERS
    companions = nothing_beside

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the archive; its tiles. ``RoadsError`` where no height of a road is known."""
        from fusion.terrain.corrected.files import bounds_of  # noqa: PLC0415 - with it rasterio is loaded

        zooms = (options.min_zoom, options.max_zoom)
        with relief_of(source, options, whole=False) as relief:
            bounds = bounds_of(relief.roads, options.blend_m)
            metadata = {
                "name": "Versant elevations",
                "description": "Elevation model with measured roads",
                "type": "overlay",
                "encoding": "terrarium",
                "version": "1",
                **stated,
                "height_datum": relief.datum or stated.get("height_datum", "unknown"),
            }
            tiles = _tiles(source, relief.terrain, _addresses(bounds, zooms))
            return write_pmtiles(path, tiles, metadata=metadata, zooms=zooms, bounds_deg=bounds, kind=PNG)


def _addresses(bounds_deg: tuple[float, float, float, float], zooms: tuple[int, int]) -> list[Tile]:
    """The tiles of a box, by their numbers."""
    from fusion.terrain.corrected.grids import TILE_PIXELS, MercatorPixels  # noqa: PLC0415 - as above

    west, south, east, north = bounds_deg
    found: list[Tile] = []
    for z in range(zooms[0], zooms[1] + 1):
        u, v = MercatorPixels(z).coordinates(np.array([west, east]), np.array([north, south]))
        (left, right), (top, low) = (np.floor((w + 0.5) / TILE_PIXELS).astype(int).tolist() for w in (u, v))
        found += [(z, x, y) for x in range(left, right + 1) for y in range(top, low + 1)]
    return sorted(found, key=lambda tile: tile_number(*tile))


def _tiles(source: Source, terrain: CorrectedTerrain, addresses: list[Tile]) -> Iterator[tuple[Tile, bytes]]:
    """The tiles that hold any height."""
    from fusion.terrain.corrected.grids import TILE_PIXELS, MercatorPixels  # noqa: PLC0415 - as above

    for done, (z, x, y) in enumerate(addresses):
        source.on_progress(done / len(addresses))
        columns, rows = (range(w * TILE_PIXELS, (w + 1) * TILE_PIXELS) for w in (x, y))
        block = terrain.block(MercatorPixels(z), columns, rows)
        height = np.asarray(block.height_m, float)
        if np.isfinite(height).any():
            yield (z, x, y), terrarium_png(height)


def terrarium_png(height_m: Floats) -> bytes:
    """Heights (rows, columns), m, as a PNG; voids are 0 m."""
    from PIL import Image  # noqa: PLC0415 - for who writes pictures alone

    steps = np.rint((np.nan_to_num(height_m) - _LOWEST_M) * 256).astype(np.uint32)
    colours = np.stack([steps >> 16 & 255, steps >> 8 & 255, steps & 255], axis=-1).astype(np.uint8)
    packed = io.BytesIO()
    Image.fromarray(colours).save(packed, "PNG")
    return packed.getvalue()
