"""One elevation raster: what it covers, and its posts. Knows nothing of other rasters, nor of places on Earth."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError
from rasterio.enums import ColorInterp
from rasterio.errors import RasterioError
from rasterio.windows import Window

from fusion.errors import TerrainError
from fusion.messages import say
from fusion.terrain.drivers import is_gzipped, open_dataset, refuse_files_of_proj
from fusion.types import Floats, Progress, no_progress

LOWEST_M, HIGHEST_M = -1000.0, 9000.0
"""No road's ground lies beyond; fill values that a raster does not declare (-32768, -9999, 1e38) do."""

ALIGNED_POSTS = 0.01
"""Posts no farther apart than this share of the posting are one post: in a mosaic, and in a quality layer."""

_HGT_NAME = re.compile(r"[NS]\d\d[EW]\d\d\d", re.IGNORECASE)
_METRES_PER_UNIT = {
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us survey foot": 1200 / 3937,
    "us-ft": 1200 / 3937,
}
_AT_ONCE = _ROWS_AT_ONCE, _COLUMNS_AT_ONCE = 512, 4096  # 16 MB of heights, whole tiles of usual rasters
_MOST_LOOKED_AT = 200_000_000  # posts, a few seconds; more than any tile has
_HINT = say("raster.give")


@dataclass(frozen=True, eq=False)
class Raster:
    """The header of a raster.

    ``posts`` takes (column, row) of a post, the centre of a pixel, to the CRS's x and y (longitude and
    latitude where it is geographic); ``crs`` is the horizontal CRS, ``datum`` what heights refer to.
    Stored values times ``scale_m`` plus ``offset_m`` are metres. ``quality`` is the raster on the same grid that
    counts the scenes behind each post (``fusion.terrain.quality``), where there is one. ``trusted``: it may name other
    files (``fusion.terrain.drivers``).
    """

    path: Path
    posts: Affine
    rows: int
    columns: int
    crs: CRS
    datum: str
    scale_m: float
    offset_m: float
    quality: Raster | None = None
    trusted: bool = False

    @property
    def posts_count(self) -> int:
        """How many posts there are."""
        return self.rows * self.columns


def open_raster(path: Path, *, trusted: bool = False) -> tuple[Raster, Any]:
    """Open a raster: its header and the rasterio dataset. Raises ``TerrainError`` when it is no elevation.

    ``trusted`` is for what the operator names: it may be of any format, and name other files. All else is opened by one
    driver of a short list, which looks at no other file (``fusion.terrain.drivers``).
    """
    path = Path(path)
    _check_file(path)
    try:
        dataset = open_dataset(path, trusted=trusted)
    except (RasterioError, OSError, ValueError) as error:
        raise TerrainError(
            say("raster.unreadable_hint", file=path.name, reason=_reason(error, path), hint=_HINT)
        ) from error
    try:
        return _header_of(path, dataset, trusted=trusted), dataset
    except BaseException:
        dataset.close()
        raise


def read_header(path: Path, *, trusted: bool = False) -> Raster:
    """The header alone; as ``open_raster``."""
    raster, dataset = open_raster(path, trusted=trusted)
    dataset.close()
    return raster


def refuse_void(path: Path, progress: Progress = no_progress) -> None:
    """Raise ``TerrainError`` when a raster holds no height at all; reads only up to the first one.

    Windows all over the raster come first. Of a large one at most ``_MOST_LOOKED_AT`` posts are read: it passes then.
    """
    raster, dataset = open_raster(path)
    down, across = -(-raster.rows // _ROWS_AT_ONCE), -(-raster.columns // _COLUMNS_AT_ONCE)
    windows, looked_at = down * across, 0
    stride = _coprime(windows)
    with dataset:
        for k in range(windows):
            if looked_at > _MOST_LOOKED_AT:
                return
            progress("looking for heights", looked_at / min(raster.posts_count, _MOST_LOOKED_AT))
            row, column = (
                i * size for i, size in zip(divmod(k * stride % windows, across), _AT_ONCE, strict=True)
            )
            rows, columns = (
                min(_ROWS_AT_ONCE, raster.rows - row),
                min(_COLUMNS_AT_ONCE, raster.columns - column),
            )
            if np.isfinite(read_posts(raster, dataset, row, column, rows, columns)).any():
                return
            looked_at += rows * columns
    raise TerrainError(
        say(
            "raster.no_height",
            file=path.name,
            rows=raster.rows,
            columns=raster.columns,
            lowest_m=LOWEST_M,
            highest_m=HIGHEST_M,
            hint=_HINT,
        )
    )


def _coprime(count: int) -> int:
    """A step, about the golden section of ``count``, with which a walk around comes to each number once."""
    step = max(round(count * 0.618), 1)
    while math.gcd(step, count) > 1:
        step += 1
    return step


def read_posts(raster: Raster, dataset: Any, row: int, column: int, rows: int, columns: int) -> Floats:
    """Heights in metres of a window inside the raster, NaN for voids; ``TerrainError`` if it is damaged."""
    stored = read_stored(raster, dataset, row, column, rows, columns)
    heights = np.asarray(stored.filled(0), np.float64) * raster.scale_m + raster.offset_m
    # Undeclared fill values are recognised as stored: scaled, they could pass for heights.
    fill = np.ma.getmaskarray(stored) | (np.asarray(stored.data) == -32768)
    with np.errstate(invalid="ignore"):
        fill |= ~((heights >= LOWEST_M) & (heights <= HIGHEST_M))
    heights[fill] = np.nan
    return heights


def read_stored(raster: Raster, dataset: Any, row: int, column: int, rows: int, columns: int) -> Any:
    """A window as it is stored, declared fill values masked; ``TerrainError`` if the file is damaged."""
    try:
        return dataset.read(1, window=Window(column, row, columns, rows), masked=True)
    except (RasterioError, OSError, ValueError) as error:
        reason = _reason(error, raster.path)
        raise TerrainError(say("raster.damaged", file=raster.path.name, reason=reason)) from error


def _reason(error: Exception, path: Path) -> str:
    """GDAL's words, without folders and without repeating the name of the file."""
    cause = error.__cause__ or error
    text = str(cause).replace(f"/vsigzip/{path.absolute()}", path.name).replace(str(path), path.name)
    return text.removeprefix(f"{path.name}: ").rstrip(".")


def apply(affine: Affine, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """An affine map of points, elementwise."""
    a, b, c, d, e, f = affine[:6]
    return a * x + b * y + c, d * x + e * y + f


def _check_file(path: Path) -> None:
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as error:
        reason = error.strerror or str(error)
        raise TerrainError(say("raster.cannot_be_read", file=path, reason=reason, hint=_HINT)) from error
    if empty:
        raise TerrainError(say("raster.empty", file=path.name, hint=_HINT))
    plain = path.with_suffix("") if is_gzipped(path) else path
    if plain.suffix.lower() == ".hgt" and not _HGT_NAME.match(path.name):
        raise TerrainError(say("raster.hgt_name", file=path.name))


def _header_of(path: Path, dataset: Any, *, trusted: bool) -> Raster:
    if dataset.crs is None or dataset.transform.is_identity or dataset.transform.is_degenerate:
        raise TerrainError(say("raster.nowhere", file=path.name))
    kind = np.dtype(dataset.dtypes[0]).kind
    colour = dataset.colorinterp[0]
    if kind not in "iuf" or colour in (ColorInterp.palette, ColorInterp.red):
        raise TerrainError(say("raster.picture", file=path.name, hint=_HINT))
    try:
        wkt = dataset.crs.to_wkt()
        if not trusted:
            refuse_files_of_proj(path.name, wkt)
        crs = CRS.from_wkt(wkt)
        if not (crs.is_geographic or crs.is_projected):
            raise ProjError(f"{crs.name} is neither geographic nor projected")
        Transformer.from_crs(4326, _horizontal(crs), always_xy=True)
    except (ProjError, RasterioError) as error:
        raise TerrainError(say("raster.crs", file=path.name, error=error)) from error
    unit = str(dataset.units[0] or _vertical_unit(crs)).strip().lower()
    metres = _METRES_PER_UNIT.get(unit, 1.0)
    return Raster(
        path=path,
        # rasterio's transform is of pixel corners, even of AREA_OR_POINT=Point files (GDAL shifts them)
        posts=dataset.transform @ Affine.translation(0.5, 0.5),
        rows=dataset.height,
        columns=dataset.width,
        crs=_horizontal(crs),
        datum="EGM96" if dataset.driver == "SRTMHGT" else _datum(crs),
        scale_m=float(dataset.scales[0]) * metres,
        offset_m=float(dataset.offsets[0]) * metres,
        trusted=trusted,
    )


def _horizontal(crs: CRS) -> CRS:
    if crs.is_compound:
        return crs.sub_crs_list[0]
    return crs.to_2d()


def _vertical(crs: CRS) -> CRS | None:
    return crs.sub_crs_list[1] if crs.is_compound else None


def _vertical_unit(crs: CRS) -> str:
    vertical = _vertical(crs)
    return str(vertical.axis_info[0].unit_name) if vertical is not None and vertical.axis_info else ""


def _datum(crs: CRS) -> str:
    """The vertical reference that the CRS states, such as ``EGM2008`` or ``DHHN2016``, else ``unknown``."""
    vertical = _vertical(crs)
    if vertical is not None:
        return str(vertical.name).removesuffix(" height")
    if len(crs.axis_info) == 3:
        return f"{crs.geodetic_crs.name if crs.geodetic_crs else crs.name} ellipsoid"
    return "unknown"
