"""A corrected model as files: HGT tiles in an archive, and a GeoTIFF that is optimised for the cloud.

The same model makes the same bytes. Memory: one tile of a degree, or one row of blocks.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.shutil
from affine import Affine
from rasterio.io import MemoryFile
from rasterio.windows import Window

from fusion.frames import SHORTEST_DEGREE_M
from fusion.terrain.corrected.blocks import SIDE_POSTS, Blocks, filled
from fusion.terrain.corrected.fit import Change
from fusion.terrain.corrected.grids import ArcSeconds
from fusion.terrain.corrected.roads import RoadHeights
from fusion.types import Floats, Progress, no_progress

HGT_VOID = -32768
CHANGES = ", ".join(f"{one.value} {one.name.lower()}" for one in Change)
"""What the numbers of the second layer mean."""
_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # an archive's entries have a time
_COMPOUND = {"EGM96": "EPSG:9707", "EGM2008": "EPSG:9518"}
"""WGS 84 with heights above these datums."""


class Layout(StrEnum):
    """How HGT tiles are laid out, by who reads them."""

    VALHALLA = "valhalla"
    """N49/N49E008.hgt"""
    BROUTER = "brouter"
    """N49E008.hgt"""
    GRAPHHOPPER = "graphhopper"
    """N49E008.hgt.zip, with the tile in it"""


def degrees_with(roads: RoadHeights, beside_m: float) -> list[tuple[int, int]]:
    """The tiles of a degree (latitude and longitude of the south-west corner) that roads reach, from south-west on.

    ``beside_m``: so far beside a road a tile is touched as well.
    """
    west, south, east, north = _boxes(roads, beside_m)
    west, south, last, top = (np.floor(w) for w in (west, south, east, north))
    corners = np.unique(np.column_stack([south, west, top, last]).astype(int), axis=0)
    found = {
        (y, x)
        for south, west, top, last in corners.tolist()
        for y in range(south, top + 1)
        for x in range(west, last + 1)
    }
    return sorted(found)


def bounds_of(roads: RoadHeights, beside_m: float) -> tuple[float, float, float, float]:
    """West, south, east and north of the roads and what is beside them, degrees."""
    west, south, east, north = _boxes(roads, beside_m)
    return float(west.min()), float(south.min()), float(east.max()), float(north.max())


def _boxes(roads: RoadHeights, beside_m: float) -> tuple[Floats, Floats, Floats, Floats]:
    """West, south, east and north (n,) of each road and what is beside it, degrees."""
    high = beside_m / SHORTEST_DEGREE_M
    wide = high / np.cos(np.radians(np.clip(np.abs(roads.lat0_deg), 0, 89)))
    lon, lat = (
        np.sort([a, b], axis=0)
        for a, b in ((roads.lon0_deg, roads.lon1_deg), (roads.lat0_deg, roads.lat1_deg))
    )
    return lon[0] - wide, lat[0] - high, lon[1] + wide, lat[1] + high


def tile_name(lat: int, lon: int) -> str:
    """As ``N49E008``."""
    return f"{'N' if lat >= 0 else 'S'}{abs(lat):02d}{'E' if lon >= 0 else 'W'}{abs(lon):03d}"


def hgt_bytes(blocks: Blocks, lat: int, lon: int) -> tuple[bytes, bytes]:
    """An HGT tile (big-endian whole metres, from the north-west corner on), and a GeoTIFF of what was changed in it."""
    grid = blocks.grid
    if not isinstance(grid, ArcSeconds):
        raise TypeError("HGT tiles have posts at whole seconds of arc")
    n = grid.per_degree
    left, top = (lon + 180) * n, (89 - lat) * n
    posts = blocks.window(range(left, left + n + 1), range(top, top + n + 1))
    heights = np.clip(np.rint(filled(posts.height_m, HGT_VOID)), HGT_VOID, -HGT_VOID - 1)
    west, north = lon - 0.5 / n, lat + 1 + 0.5 / n
    profile = {
        "driver": "GTiff",
        "width": n + 1,
        "height": n + 1,
        "count": 1,
        "dtype": "uint8",
        "crs": "EPSG:4326",
    }
    profile |= {"transform": Affine(1 / n, 0, west, 0, -1 / n, north), "compress": "deflate"}
    with MemoryFile() as memory:
        with memory.open(**profile) as target:
            target.write(posts.change, 1)
            target.update_tags(DESCRIPTION=f"What became of each post: {CHANGES}", AREA_OR_POINT="Point")
        changed = memory.read()
    return heights.astype(">i2").tobytes(), changed


def write_hgt(
    path: Path,
    blocks: Blocks,
    tiles: list[tuple[int, int]],
    layout: Layout,
    about: str,
    progress: Progress = no_progress,
) -> list[str]:
    """Write an archive (zip) of the tiles, ``changed/N49E008.tif`` for each, and README.txt.

    The names of the tiles that hold voids: the model does not reach over all of them.
    """
    void = []
    with zipfile.ZipFile(path, "w") as archive:
        _put(archive, "README.txt", about.encode())
        for done, (lat, lon) in enumerate(tiles):
            progress("tiles", done / len(tiles))
            name = tile_name(lat, lon)
            heights, changed = hgt_bytes(blocks, lat, lon)
            if (np.frombuffer(heights, ">i2") == HGT_VOID).any():
                void.append(name)
            if layout is Layout.GRAPHHOPPER:
                packed = io.BytesIO()
                with zipfile.ZipFile(packed, "w") as inner:
                    _put(inner, f"{name}.hgt", heights)
                _put(archive, f"{name}.hgt.zip", packed.getvalue())
            else:
                _put(
                    archive, f"{name[:3]}/{name}.hgt" if layout is Layout.VALHALLA else f"{name}.hgt", heights
                )
            _put(archive, f"changed/{name}.tif", changed)
    return void


def _put(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    entry = zipfile.ZipInfo(name, _LONG_AGO)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, data)


def write_geotiff(
    path: Path,
    blocks: Blocks,
    bounds_deg: tuple[float, float, float, float],
    datum: str | None,
    tags: Mapping[str, str],
    progress: Progress = no_progress,
) -> int:
    """Write the posts within (west, south, east, north) and around it; how many posts were changed.

    Band 1: heights, metres, NaN void; band 2: what became of each post (``Change``). ``datum``: of the heights.
    """
    grid = blocks.grid
    west, low, right, north = bounds_deg
    u, v = grid.coordinates(np.array([west, right]), np.array([north, low]))
    columns, rows = (range(int(np.floor(w[0])), int(np.floor(w[1])) + 2) for w in (u, v))
    lon, lat = grid.axes(np.array([0.0, 1.0]) + columns.start, np.array([0.0, 1.0]) + rows.start)
    east, south = float(lon[1] - lon[0]), float(lat[1] - lat[0])
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "width": len(columns),
        "height": len(rows),
        "count": 2,
        "dtype": "float32",
        "nodata": float("nan"),
        "crs": _COMPOUND.get(datum or "", "EPSG:4326"),
        "transform": Affine(east, 0, lon[0] - east / 2, 0, south, lat[0] - south / 2),
        "tiled": True,
        "blockxsize": SIDE_POSTS,
        "blockysize": SIDE_POSTS,
        "compress": "deflate",
        "bigtiff": "if_safer",
    }
    part, changed = path.with_name(f"{path.name}.part"), 0
    try:
        with rasterio.open(part, "w", **profile) as target:
            target.update_tags(**tags, AREA_OR_POINT="Point", VERTICAL_DATUM=datum or "unknown")
            target.set_band_description(1, "height of the ground, of the road along roads")
            target.set_band_description(2, f"change: {CHANGES}")
            target.set_band_unit(1, "m")
            for across, down, mine in _windows(columns, rows):
                progress("posts", (down.start - rows.start) / len(rows))
                posts = blocks.window(across, down)
                target.write(np.stack([posts.height_m, posts.change.astype(np.float32)]), window=mine)
                changed += int(np.count_nonzero(posts.change))
        options = {
            "compress": "deflate",
            "predictor": "yes",
            "overview_resampling": "nearest",
            "bigtiff": "if_safer",
        }
        rasterio.shutil.copy(part, path, driver="COG", **options)
    finally:
        part.unlink(missing_ok=True)
    return changed


def _windows(columns: range, rows: range) -> Iterator[tuple[range, range, Window]]:
    """Pieces as wide as all and as high as a block of ``Blocks``, each with its place in the file."""
    for start in range(rows.start // SIDE_POSTS * SIDE_POSTS, rows.stop, SIDE_POSTS):
        down = range(max(start, rows.start), min(start + SIDE_POSTS, rows.stop))
        yield columns, down, Window(0, down.start - rows.start, len(columns), len(down))
