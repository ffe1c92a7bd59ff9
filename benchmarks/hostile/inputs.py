"""Small inputs that ask for large work, made here: none is larger than 25 MB, what they stand for is gigabytes."""

from __future__ import annotations

import gzip
from pathlib import Path

import rasterio
from rasterio import Affine

SPARSE_SIZE, SPARSE_BLOCK = 400_000, 65_536
"""Posts of each side of a raster that holds none of them."""
BOMB_BYTES, BOMB_PIECE_BYTES = 3 * 2**30, 2**25
"""What a few megabytes of gzip unpack to."""
ROWS = 3_000_000
MODULO = "slope_percent" + " % 7" * 17 + " > 1"
"""Written twice for each operator it would be 131,072 operands."""


def sparse_raster(folder: Path, lon_deg: float = 8.0, lat_deg: float = 49.5) -> bytes:
    """A GeoTIFF of 400,000 x 400,000 posts without any: some ten kilobytes."""
    path = folder / "sparse.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=SPARSE_SIZE, height=SPARSE_SIZE, count=1, dtype="float32",
        crs="EPSG:4326", transform=Affine(2.5e-6, 0, lon_deg, 0, -2.5e-6, lat_deg), nodata=-9999.0, tiled=True,
        blockxsize=SPARSE_BLOCK, blockysize=SPARSE_BLOCK, compress="deflate", BIGTIFF="YES", SPARSE_OK="TRUE",
    ):  # fmt: skip
        pass
    return path.read_bytes()


def bomb(unpacked_bytes: int = BOMB_BYTES) -> bytes:
    """Zeros, gzipped in many members, each of the same bytes."""
    return gzip.compress(bytes(BOMB_PIECE_BYTES), 9) * (unpacked_bytes // BOMB_PIECE_BYTES)


def many_rows(rows: int = ROWS, lon_deg: float = 8.4, lat_deg: float = 49.0) -> bytes:
    """A gzipped CSV of so many positions in one street, ten a second."""
    lines = [
        f"{1.7e9 + k / 10:.1f},{lat_deg + 1e-6 * (k % 2000):.6f},{lon_deg + 1e-6 * (k % 3000):.6f}"
        for k in range(rows)
    ]
    return gzip.compress("\n".join(["time_s,lat_deg,lon_deg", *lines, ""]).encode(), 1)
