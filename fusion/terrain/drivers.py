"""Which one GDAL driver opens a raster: the content of the file decides.

GDAL has 140 drivers, and asks each whether a file is its own. Some of them read other files and addresses that the
raster names: a VRT its sources, any driver the headers and overviews beside the file. So a raster that is not the
operator's own is opened by one of the few drivers below. Their rasters are complete in one file, and nothing beside
it is looked at.
"""

from __future__ import annotations

import gzip
import re
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning

from fusion.errors import TerrainError
from fusion.messages import say

HGT_SIDES = {(1201, 1201), (1801, 3601), (3601, 3601), (7201, 7201)}
"""Columns and rows of the tiles that there are, two bytes a post."""
HGT_MOST_BYTES = 2 * max(columns * rows for columns, rows in HGT_SIDES)
BLOCK_BYTES = 64 << 20
"""The most that may have to be unpacked for one post: a block (tile or strip) of a raster with all its bands."""

_HGT_BYTES = {2 * columns * rows for columns, rows in HGT_SIDES}
_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_HEAD_BYTES = 4096
# A path in what PROJ takes for a grid or a file of parameters; names without a folder are PROJ's own.
_PROJ_FILE = re.compile(
    r"(?:grids|\b(?:init|file|model))\b[\"\s,=\[]+[^\"\]\s]*[/\\:~]|PARAMETERFILE", re.IGNORECASE
)
_ALONE = {"GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR"}
_ADVICE = say("raster.convert")


def open_dataset(path: Path, *, trusted: bool) -> Any:
    """The rasterio dataset; ``trusted``: by whatever driver, with the files that it names and those beside it.

    Raises ``TerrainError`` for what no driver of the short list is for, and what GDAL raises.
    """
    source = f"/vsigzip/{path.absolute()}" if is_gzipped(path) else path.absolute()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # answered by a sentence of ours
        if trusted:
            return rasterio.open(source)
        driver = driver_of(path)
        with rasterio.Env(**_ALONE):
            dataset = rasterio.open(source, driver=driver)
    try:
        _require_bounded(path, dataset)
    except BaseException:
        dataset.close()
        raise
    return dataset


def driver_of(path: Path) -> str:
    """The driver for a file by its first bytes; HGT tiles, which have no header, by name and size."""
    head = _head(path)
    if head.startswith(_TIFF):
        return "GTiff"
    if head.startswith(b"UHL1"):
        return "DTED"
    if _is_hgt(path):
        return "SRTMHGT"
    if b"<VRTDataset" in head:
        raise TerrainError(say("raster.vrt", file=path.name, advice=_ADVICE))
    raise TerrainError(say("raster.unknown", file=path.name, advice=_ADVICE))


def refuse_files_of_proj(name: str, wkt: str) -> None:
    """Raise ``TerrainError`` for a coordinate reference system that names a file which PROJ would open."""
    if match := _PROJ_FILE.search(wkt):
        raise TerrainError(say("raster.crs_names_file", file=name, name=match.group()[:60]))


def is_gzipped(path: Path) -> bool:
    """Archives offer HGT tiles as ``N50E007.hgt.gz``; GDAL reads what is in there when told so."""
    return path.suffix.lower() == ".gz"


def _head(path: Path) -> bytes:
    try:
        with gzip.open(path) if is_gzipped(path) else path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise TerrainError(say("raster.unreadable", file=path.name, error=str(error).rstrip("."))) from error


def _is_hgt(path: Path) -> bool:
    plain = path.with_suffix("") if is_gzipped(path) else path
    return plain.suffix.lower() == ".hgt" and (is_gzipped(path) or path.stat().st_size in _HGT_BYTES)


def _require_bounded(path: Path, dataset: Any) -> None:
    """A header can claim blocks that unpack to gigabytes for one post."""
    rows, columns = dataset.block_shapes[0]
    post_bytes = np.dtype(
        getattr(np, dataset.dtypes[0], np.complex128)
    ).itemsize  # numpy lacks integer complex
    size = rows * columns * dataset.count * post_bytes
    if size > BLOCK_BYTES:
        raise TerrainError(
            say(
                "raster.large_blocks",
                file=path.name,
                columns=columns,
                rows=rows,
                count=dataset.count,
                size_mib=size >> 20,
                most_mib=BLOCK_BYTES >> 20,
            )
        )
