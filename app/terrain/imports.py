"""Elevation rasters come in: files into the folder, the set into the database, slopes and heights to segments.

What the database holds of them is in ``app.terrain.store``. How heights are read is the library's business.
"""

from __future__ import annotations

import gzip
import hashlib
import shutil
import uuid
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rasterio
import rasterio.shutil
from rasterio.errors import RasterioError
from rasterio.warp import transform_bounds
from sqlalchemy.orm import Session

from app.core import mirror
from app.core.db import Bounds, Sessions
from app.core.settings import FilePlace
from app.core.telemetry.events import imported
from app.network.cells import cells_over, raise_versions
from app.network.extracts import roads_within, roads_without_heights, roads_without_heights_in
from app.network.locks import own_network
from app.terrain.store import DemSet, DemSource, current_dem, local_raster, replace_dem, set_terrain
from fusion.errors import TerrainError
from fusion.network.curve import interval_count, knot_length
from fusion.network.unknowns import knot_positions
from fusion.network.window import LONGEST_GAP_M, boxes_around
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from fusion.terrain.quality import pair, quality_name
from fusion.terrain.raster import open_raster, refuse_void
from fusion.terrain.windows import dem_slopes
from fusion.types import Floats, Ints, Progress, no_progress

CHUNK_BYTES = 1 << 20
SEGMENTS_PER_UPDATE = 50_000
SEGMENTS_PER_FILL = 10_000
"""So long do drives that come and go wait: a second or so."""


@imported("elevation")
def import_dem(
    sessions: Sessions, paths: Sequence[Path], dem_dir: FilePlace, progress: Progress = no_progress
) -> DemSet:
    """Add elevation rasters to the active set; ``TerrainError`` for one that cannot be used."""
    if not paths:
        raise TerrainError("No elevation raster was named. Give one or more GeoTIFF, VRT or .hgt files.")
    sources = store_files(paths, dem_dir, progress)
    with sessions.begin() as session:
        return add_dem(session, sources, dem_dir, progress)


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


def add_dem(
    session: Session, sources: Sequence[DemSource], dem_dir: FilePlace, progress: Progress = no_progress
) -> DemSet:
    """Add stored rasters to the active set and renew slopes and heights of the segments that they cover.

    A raster that is in the set already changes nothing; one with the name of an active raster but other bytes
    takes its place. Names are compared without regard to case: N50E007.hgt and n50e007.HGT are one tile.
    Drives processed before keep their estimates; the network takes the new heights into account where later
    drives pass, or by `versant settle`. Waits for running writers of estimates.
    """
    own_network(session)
    active = current_dem(session, dem_dir)
    former = active.sources if active else ()
    new = [source for source in sources if source not in former]
    if active and not new:
        return active
    replaced = {source.name.casefold() for source in new}
    gone = [source for source in former if source.name.casefold() in replaced]
    whole = [source for source in former if source not in gone] + list(dict.fromkeys(new))
    with Dem.open([local_raster(dem_dir, source) for source in whole]) as dem:
        found = replace_dem(session, whole, dem.datum, dem_dir)
        changed = [local_raster(dem_dir, source) for source in [*new, *gone]]
        _renew_terrain(session, dem, changed, progress)
    return found


def terrain_under(active: DemSet | None, table: RoadTable) -> tuple[Floats, Floats]:
    """Each segment's slope by these rasters, percent, shape (n,), and the heights at the knots of all, m.

    NaN unknown; ``fusion.network.unknowns.knot_positions`` has the order of the knots.
    """
    if active is None or not len(table):
        return np.full(len(table), np.nan), np.full(len(knot_positions(table)[0]), np.nan)
    with Dem.open(active.paths) as dem:
        return dem_slopes(dem, table), dem.heights(*knot_positions(table))


def fill_heights(sessions: Sessions, dem_dir: FilePlace, after_id: int = 0) -> int | None:
    """Give heights to the next segments after an id that have a slope by the active rasters alone, as they were stored
    before heights were. Returns the last one's id; None: there are no more.

    One that reaches over a raster's edge has no slope and waits for the next import. In a short transaction that owns
    the network.
    """
    with sessions.begin() as session:
        own_network(session)
        active = current_dem(session, dem_dir)
        table, ids = roads_without_heights(session, after_id, SEGMENTS_PER_FILL)
        if active is None or not len(ids):
            return None
        with Dem.open(active.paths) as dem:
            _write_terrain(session, dem, table, ids)
    return int(ids.max())


def fill_heights_along(sessions: Sessions, dem_dir: FilePlace, driven: RoadTable) -> int:
    """``fill_heights`` for the roads that a drive can have a part in: driven ones and gaps beside them; of how many.

    Before the drive is solved, so that no slope is published without the elevation model, however long filling the
    whole map takes. Drives that were solved before had their roads filled, too.
    """
    ends = (driven.lon0_deg, driven.lat0_deg, driven.lon1_deg, driven.lat1_deg)
    boxes = boxes_around(*ends, LONGEST_GAP_M)
    with sessions() as session:
        if current_dem(session, dem_dir) is None or not len(roads_without_heights_in(session, boxes)[1]):
            return 0
    with sessions.begin() as session:
        own_network(session)
        active = current_dem(session, dem_dir)
        table, ids = roads_without_heights_in(session, boxes)
        if active is not None and len(ids):
            with Dem.open(active.paths) as dem:
                _write_terrain(session, dem, table, ids)
    return len(ids)


def _renew_terrain(session: Session, dem: Dem, changed: Sequence[Path], progress: Progress) -> None:
    """Write slopes and heights of all segments that the changed rasters cover."""
    for done, path in enumerate(changed):
        table, ids = roads_within(session, _bounds_deg(path))
        for start in range(0, len(ids), SEGMENTS_PER_UPDATE):
            progress("slopes", (done + start / len(ids)) / len(changed))
            part = np.arange(start, min(start + SEGMENTS_PER_UPDATE, len(ids)))
            _write_terrain(session, dem, table.subset(part), ids[part])
    progress("slopes", 1.0)


def _write_terrain(session: Session, dem: Dem, table: RoadTable, ids: Ints) -> None:
    heights = dem.heights(*knot_positions(table))
    last = np.cumsum(interval_count(knot_length(table.length_m)) + 1)[:-1]
    set_terrain(session, ids, dem_slopes(dem, table), np.split(heights, last))
    raise_versions(session, cells_over(session, ids.tolist()))


def _bounds_deg(path: Path) -> Bounds:
    """(west, south, east, north) of a raster, widened by two of its posts, degrees."""
    with rasterio.open(path) as raster:
        across, down = 2 * abs(raster.transform.a), 2 * abs(raster.transform.e)
        left, bottom, right, top = raster.bounds
        box = (left - across, bottom - down, right + across, top + down)
        bounds: Bounds = transform_bounds(raster.crs or "EPSG:4326", "EPSG:4326", *box)
        return bounds


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
        final.mkdir(exist_ok=True)
        for part in parts:
            # Renamed within one file system: the file is there complete or not at all, and after its quality layer.
            part.replace(final / part.name)
        _send(path, dem_dir, [f"{folder}/{part.name}" for part in parts])
        return DemSource(copied.name, f"{folder}/{copied.name}", sha256)
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
