"""The files of elevation rasters: copied to where they are kept, looked at, and removed when no set names them.

Which of them count is in ``app.terrain.store``. How heights are read is the library's business.
"""

from __future__ import annotations

import hashlib
import logging
import shutil
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np
from pyproj import Transformer
from pyproj.exceptions import ProjError

from app.core import mirror
from app.core.db import Bounds, Sessions
from app.core.durable import rename_durably
from app.core.settings.places import FilePlace
from app.terrain.copying import Limits, copy_raster, sha256_of
from app.terrain.store import DemSource, local_raster, retired_rasters, set_sources, sources_of_all
from fusion.errors import TerrainError
from fusion.terrain.dem import Dem
from fusion.terrain.quality import pair, quality_name
from fusion.terrain.raster import apply, read_header, refuse_void
from fusion.types import Progress, no_progress

logger = logging.getLogger(__name__)

_WORLD: Bounds = (-180.0, -90.0, 180.0, 90.0)
_BOUNDS_DIGITS = 7


def store_files(
    paths: Sequence[Path],
    dem_dir: FilePlace,
    progress: Progress = no_progress,
    limits: Limits = Limits(),  # noqa: B008 - it is frozen
) -> list[DemSource]:
    """Copy rasters to where they are kept; ``TerrainError`` for one that cannot be read or is beyond the limits,
    ``StorageFullError`` where there is no room. No database is involved.

    What is kept is one GeoTIFF, HGT or DTED file that says all by itself: a gzipped raster is unpacked, and where the
    limits trust it, one of another format or one that refers to other files (a VRT, a file with a header beside it) is
    written anew as GeoTIFF. The quality layer of a raster (``fusion.terrain.quality``) goes with it.
    """
    stored = []
    pairs = pair(paths)
    for k, (path, quality) in enumerate(pairs):

        def part(stage: str, share: float, done: int = k) -> None:
            progress(stage, (done + share) / len(pairs))

        part("copying", 0.0)
        stored.append(_store(path, quality, dem_dir, part, limits))
    return stored


def with_bounds(sources: Iterable[DemSource], dem_dir: FilePlace) -> list[DemSource]:
    """The sources, each with its bounds: what is not known yet is read from its raster.

    One whose raster cannot be read stays without, and counts everywhere.
    """
    bounded = []
    for source in sources:
        bounds = source.bounds_deg
        if bounds is None:
            try:
                bounds = bounds_deg(local_raster(dem_dir, source))
            except (TerrainError, ProjError) as error:
                logger.warning("where %s lies is not known: %s", source.name, error)
        bounded.append(replace(source, bounds_deg=bounds))
    return bounded


def add_bounds(sessions: Sessions, dem_dir: FilePlace) -> int:
    """Give bounds to the rasters of all versions that have none, as those of before 0014; of how many."""
    with sessions() as session:
        named = {s.uri: s for sources in sources_of_all(session).values() for s in sources}
        without = [source for source in named.values() if source.bounds_deg is None]
    bounds = {s.uri: s.bounds_deg for s in with_bounds(without, dem_dir) if s.bounds_deg is not None}
    if bounds:
        with sessions.begin() as session:
            for version, sources in sources_of_all(session).items():
                if any(s.bounds_deg is None and s.uri in bounds for s in sources):
                    listed = [replace(s, bounds_deg=s.bounds_deg or bounds.get(s.uri)) for s in sources]
                    set_sources(session, version, listed)
    return len(bounds)


def bounds_deg(path: Path, margin_posts: int = 0) -> Bounds:
    """(west, south, east, north) of a raster's pixels, widened by so many of its posts, degrees."""
    raster = read_header(path)
    least, ends = -0.5 - margin_posts, (raster.columns - 0.5 + margin_posts, raster.rows - 0.5 + margin_posts)
    x, y = apply(raster.posts, np.array([least, ends[0]] * 2), np.array([least] * 2 + [ends[1]] * 2))
    to_degrees = Transformer.from_crs(raster.crs, 4326, always_xy=True)
    west, south, east, north = to_degrees.transform_bounds(x.min(), y.min(), x.max(), y.max())
    if west > east:  # across the antimeridian: two boxes in one
        west, east = -180.0, 180.0
    return tuple(round(float(w), _BOUNDS_DIGITS) for w in (west, south, east, north))  # type: ignore[return-value]


def reach_deg(source: DemSource, dem_dir: FilePlace) -> Bounds:
    """Where a raster may give heights: its bounds and two posts more; everywhere, where nothing tells."""
    try:
        return bounds_deg(local_raster(dem_dir, source), margin_posts=2)
    except (TerrainError, ProjError):
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


def _store(
    path: Path, quality: Path | None, dem_dir: FilePlace, progress: Progress, limits: Limits
) -> DemSource:
    here = mirror.local_folder(dem_dir)
    incoming = here / "incoming" / uuid.uuid4().hex
    incoming.mkdir(parents=True)
    try:
        copied = copy_raster(path, incoming, limits, progress)
        folder = sha256 = sha256_of(copied, progress)
        refuse_void(copied, progress)  # and what cannot serve as elevation at all, before it is referred to
        parts = [copied]
        if quality is not None:
            layer = copy_raster(quality, incoming, limits, progress)
            parts.insert(0, layer.rename(incoming / quality_name(copied)))
            Dem.open([copied]).close()  # does the layer fit?
            folder = hashlib.sha256(f"{sha256} {sha256_of(parts[0], progress)}".encode()).hexdigest()
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
