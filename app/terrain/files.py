"""The files of elevation rasters: copied to where they are kept, looked at, and removed when no set names them.

A copy is complete in one file, within limits, with room left on the disk. Who reads it later opens it by one driver of
a short list (``fusion.terrain.drivers``), whoever brought it. ``app.terrain.store`` has which of them are active; the
library reads heights.
"""

from __future__ import annotations

import gzip
import hashlib
import logging
import shutil
import sys
import uuid
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import BinaryIO

import numpy as np
import rasterio.shutil
from pyproj import Transformer
from pyproj.exceptions import ProjError
from rasterio.errors import RasterioError

from app.core import mirror
from app.core.db import Bounds, Sessions
from app.core.durable import rename_durably
from app.core.filesystems import full_is_told, require_room
from app.core.messages import say
from app.core.settings import Settings
from app.core.settings.places import GIB, FilePlace
from app.terrain.store import DemSource, local_raster, retired_rasters, set_sources, sources_of_all
from fusion.errors import TerrainError
from fusion.formats.container import BOMB_FREE_BYTES, BOMB_RATIO
from fusion.terrain.dem import Dem
from fusion.terrain.drivers import HGT_MOST_BYTES, is_gzipped
from fusion.terrain.quality import pair, quality_name
from fusion.terrain.raster import apply, open_raster, read_header, refuse_void
from fusion.types import Progress, no_progress

CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class Limits:
    """What is taken of a raster: ``max_bytes`` unpacked, ``max_posts``; ``keep_free_bytes`` stay free on the disk.

    ``trusted``: the operator named it on the command line. It may be of any format, of any size, and name other files.
    """

    trusted: bool = False
    max_bytes: int = 8 * GIB
    max_posts: int = 4_000_000_000
    keep_free_bytes: int = 0


def request_limits(settings: Settings) -> Limits:
    """For what a request brought."""
    return Limits(False, settings.max_import_bytes, settings.max_raster_posts, settings.min_free_bytes)


def operator_limits(settings: Settings) -> Limits:
    """For what the operator names on the command line."""
    return Limits(True, sys.maxsize, sys.maxsize, settings.min_free_bytes)


def copy_raster(path: Path, folder: Path, limits: Limits, progress: Progress) -> Path:
    """Copy a raster into a folder; the copy's path. ``TerrainError``; ``StorageFullError`` where there is no room."""
    target = folder / path.name
    try:
        with full_is_told():
            source = _unpack(path, folder / path.stem, limits, progress) if is_gzipped(path) else path
            if _to_be_rewritten(source, limits):
                return _rewritten(source, folder / f"{source.stem}.tif")
            if source is path:
                require_room(folder, path.stat().st_size, limits.keep_free_bytes)
                with path.open("rb") as file:
                    _write(file, target, limits, lambda done: _report(progress, "copying", done, path))
            return target if source is path else source
    except (RasterioError, OSError) as error:
        raise TerrainError(
            say(
                "raster.cannot_be_copied",
                file=path.name,
                folder=folder.parent.parent,
                error=str(error).rstrip("."),
            )
        ) from error


def sha256_of(path: Path, progress: Progress) -> str:
    """The SHA-256 of a file, hex."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            digest.update(chunk)
            _report(progress, "checking", file.tell(), path)
    return digest.hexdigest()


def _to_be_rewritten(source: Path, limits: Limits) -> bool:
    """Whether it says not all by itself; ``TerrainError`` for what is not taken. Nothing but headers is read."""
    raster, dataset = open_raster(source, trusted=limits.trusted)
    with dataset:
        several = limits.trusted and len(dataset.files) > 1
    if limits.trusted:
        return several or not _is_complete(source)
    if raster.posts_count > limits.max_posts:
        raise TerrainError(
            say(
                "raster.too_large",
                file=source.name,
                rows=raster.rows,
                columns=raster.columns,
                most=limits.max_posts,
            )
        )
    return False


def _is_complete(source: Path) -> bool:
    try:
        read_header(source)
    except TerrainError:
        return False
    return True


def _rewritten(source: Path, target: Path) -> Path:
    part = target.with_name(f"written-{target.name}")
    options = {"tiled": True, "compress": "deflate", "bigtiff": "if_safer"}
    rasterio.shutil.copy(source, part, driver="GTiff", **options)
    if source.parent == target.parent:  # what was unpacked
        source.unlink()
    return part.rename(target)


def _unpack(path: Path, target: Path, limits: Limits, progress: Progress) -> Path:
    packed_bytes = path.stat().st_size
    most = limits.max_bytes
    if target.suffix.lower() == ".hgt":
        most = HGT_MOST_BYTES
    elif not limits.trusted:
        most = min(most, max(BOMB_FREE_BYTES, BOMB_RATIO * packed_bytes))
    with path.open("rb") as packed, gzip.GzipFile(fileobj=packed) as plain:

        def written(done: int) -> None:
            if done > most:
                raise TerrainError(say("raster.bomb", file=path.name, most_mib=most >> 20))
            _report(progress, "unpacking", packed.tell(), path)

        try:
            _write(plain, target, limits, written)
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise TerrainError(
                say("raster.cannot_be_unpacked", file=path.name, error=str(error).rstrip("."))
            ) from error
    return target


def _write(
    source: BinaryIO | gzip.GzipFile, target: Path, limits: Limits, written: Callable[[int], None]
) -> None:
    """Write a file piece by piece, as long as there is room; ``written`` hears of each before it is there."""
    done = 0
    with target.open("wb") as file:
        while chunk := source.read(CHUNK_BYTES):
            done += len(chunk)
            written(done)
            require_room(target.parent, len(chunk), limits.keep_free_bytes)
            file.write(chunk)


def _report(progress: Progress, stage: str, done: int, path: Path) -> None:
    progress(stage, min(done / max(path.stat().st_size, 1), 1.0))


logger = logging.getLogger(__name__)

_WORLD: Bounds = (-180.0, -90.0, 180.0, 90.0)
_BOUNDS_DIGITS = 7


def store_files(
    paths: Sequence[Path], dem_dir: FilePlace, progress: Progress = no_progress, limits: Limits = Limits()
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
    """The sources, each with its bounds, which are read from the raster where they are not known yet.

    A source whose raster cannot be read stays without bounds, and counts everywhere.
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
    """Add bounds to rasters without, as versions of before 0014 have them; returns how many got bounds."""
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
    """Where a raster may give heights: its bounds and two posts more; everywhere if they are unknown."""
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
        raise TerrainError(say("raster.cannot_be_kept", file=path.name, error=error)) from error
