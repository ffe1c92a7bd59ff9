"""The files of elevation rasters: copied to where they are kept, looked at, and removed when no set names them.

Which of them count is in ``app.terrain.store``. How heights are read is the library's business.
"""

from __future__ import annotations

import gzip
import hashlib
import logging
import shutil
import uuid
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import rasterio
import rasterio.shutil
from rasterio.errors import RasterioError
from rasterio.warp import transform_bounds

from app.core import mirror
from app.core.db import Bounds, Sessions
from app.core.durable import rename_durably
from app.core.settings.places import FilePlace
from app.terrain.store import DemSource, local_raster, retired_rasters, set_sources, sources_of_all
from fusion.errors import TerrainError
from fusion.terrain.dem import Dem
from fusion.terrain.quality import pair, quality_name
from fusion.terrain.raster import open_raster, refuse_void
from fusion.types import Progress, no_progress

logger = logging.getLogger(__name__)

CHUNK_BYTES = 1 << 20
_WORLD: Bounds = (-180.0, -90.0, 180.0, 90.0)
_BOUNDS_DIGITS = 7


def store_files(
    paths: Sequence[Path], dem_dir: FilePlace, progress: Progress = no_progress
) -> list[DemSource]:
    """Copy rasters to where they are kept; ``TerrainError`` for one that cannot be read. No database is involved.

    A gzipped raster is unpacked. One that consists of one file is copied as it is, streaming; one that refers
    to others (a VRT, a file with a header beside it) is written anew as one GeoTIFF, since the references would
    break. The quality layer of a raster (``fusion.terrain.quality``) goes with it.
    """
    stored = []
    pairs = pair(paths)
    for k, (path, quality) in enumerate(pairs):
        progress("copying", k / len(pairs))
        stored.append(_store(path, quality, dem_dir))
    return stored


def with_bounds(sources: Iterable[DemSource], dem_dir: FilePlace) -> list[DemSource]:
    """The sources, each with its bounds: what is not known yet is read from its raster.

    One whose raster cannot be read stays without, and counts everywhere.
    """
    known = []
    for source in sources:
        bounds = source.bounds_deg
        if bounds is None:
            try:
                bounds = bounds_deg(local_raster(dem_dir, source))
            except (TerrainError, RasterioError) as error:
                logger.warning("where %s lies is not known: %s", source.name, error)
        known.append(replace(source, bounds_deg=bounds))
    return known


def add_bounds(sessions: Sessions, dem_dir: FilePlace) -> int:
    """Give bounds to the rasters of all versions that have none, as those of before 0014; of how many."""
    with sessions() as session:
        named = {s.uri: s for sources in sources_of_all(session).values() for s in sources}
        without = [source for source in named.values() if source.bounds_deg is None]
    found = {s.uri: s.bounds_deg for s in with_bounds(without, dem_dir) if s.bounds_deg is not None}
    if found:
        with sessions.begin() as session:
            for version, sources in sources_of_all(session).items():
                if any(s.bounds_deg is None and s.uri in found for s in sources):
                    known = [replace(s, bounds_deg=s.bounds_deg or found.get(s.uri)) for s in sources]
                    set_sources(session, version, known)
    return len(found)


def bounds_deg(path: Path, margin_posts: int = 0) -> Bounds:
    """(west, south, east, north) of a raster's pixels, widened by so many of its posts, degrees."""
    with rasterio.open(path) as raster:
        across, down = (margin_posts * abs(step) for step in (raster.transform.a, raster.transform.e))
        left, bottom, right, top = raster.bounds
        box = (left - across, bottom - down, right + across, top + down)
        west, south, east, north = transform_bounds(raster.crs or "EPSG:4326", "EPSG:4326", *box)
    if west > east:  # across the antimeridian: two boxes in one
        west, east = -180.0, 180.0
    return tuple(round(float(w), _BOUNDS_DIGITS) for w in (west, south, east, north))  # type: ignore[return-value]


def reach_deg(source: DemSource, dem_dir: FilePlace) -> Bounds:
    """Where a raster may give heights: its bounds and two posts more; everywhere, where nothing tells."""
    try:
        return bounds_deg(local_raster(dem_dir, source), margin_posts=2)
    except (TerrainError, RasterioError):
        if source.bounds_deg is None:
            return _WORLD
        west, south, east, north = source.bounds_deg
        across, down = 0.05 * abs(east - west), 0.05 * (north - south)
        return west - across, south - down, east + across, north + down


def sweep_rasters(sessions: Sessions, dem_dir: FilePlace, older_than: timedelta) -> list[str]:
    """Remove the files of rasters that have been in no active set for so long; returns their paths below the folder.

    By then no drive runs that reads them. A file that came again meanwhile stays. For who knows that no other database
    uses the folder.
    """
    with sessions() as session:
        retired = retired_rasters(session, older_than)
    return [uri for uri in retired if mirror.remove_older(dem_dir, uri.partition("/")[0], older_than)]


def _store(path: Path, quality: Path | None, dem_dir: FilePlace) -> DemSource:
    here = mirror.local_folder(dem_dir)
    incoming = here / "incoming" / uuid.uuid4().hex
    incoming.mkdir(parents=True)
    try:
        copied = _copy(path, incoming)
        folder = sha256 = _sha256(copied)
        refuse_void(copied)  # and what cannot serve as elevation at all, before it is referred to
        parts = [copied]
        if quality is not None:
            layer = _copy(quality, incoming)
            parts.insert(0, layer.rename(incoming / quality_name(copied)))
            Dem.open([copied]).close()  # does the layer fit?
            folder = hashlib.sha256(f"{sha256} {_sha256(parts[0])}".encode()).hexdigest()
        final = here / folder
        for part in parts:
            # Renamed within one file system: the file is there complete or not at all, and after its quality layer.
            rename_durably(part, final / part.name)
        _send(path, dem_dir, [f"{folder}/{part.name}" for part in parts])
        with Dem.open([final / copied.name]) as dem:
            posting_m = float(f"{max(dem.postings_m[0]):.4g}")
        return DemSource(copied.name, f"{folder}/{copied.name}", sha256, posting_m=posting_m)
    finally:
        shutil.rmtree(incoming)


def _send(path: Path, dem_dir: FilePlace, names: Sequence[str]) -> None:
    try:
        mirror.send(dem_dir, names)
    except mirror.MirrorError as error:
        raise TerrainError(
            f"{path.name} cannot be kept: {error} See to the storage of VERSANT_DEM_URL and import it again."
        ) from error


def _copy(path: Path, folder: Path) -> Path:
    if path.suffix.lower() == ".gz":
        return _unpack(path, folder / path.stem)
    dataset = open_raster(path)[1]
    with dataset:
        several = len(dataset.files) > 1
    try:
        target = folder / (f"{path.stem}.tif" if several else path.name)
        if several:
            rasterio.shutil.copy(
                path, target, driver="GTiff", tiled=True, compress="deflate", bigtiff="if_safer"
            )
        else:
            shutil.copyfile(path, target)
    except (RasterioError, OSError) as error:
        raise TerrainError(
            f"{path.name} cannot be copied to {folder.parent.parent}: {str(error).rstrip('.')}. Check the file and "
            "that there is room, and import it again."
        ) from error
    return target


def _unpack(path: Path, target: Path) -> Path:
    try:
        with gzip.open(path) as packed, target.open("wb") as plain:
            shutil.copyfileobj(packed, plain, CHUNK_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise TerrainError(
            f"{path.name} cannot be unpacked: {str(error).rstrip('.')}. Download it again, or give the raster "
            "itself."
        ) from error
    return target


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
