"""One elevation raster into a folder of the service: complete in one file, within limits, with room left on the disk.

Who reads it later opens it by one driver of a short list (``fusion.terrain.drivers``), whoever brought it.
"""

from __future__ import annotations

import gzip
import hashlib
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import rasterio.shutil
from rasterio.errors import RasterioError

from app.core.filesystems import full_is_told, require_room
from app.core.settings import Settings
from app.core.settings.places import GIB
from fusion.errors import TerrainError
from fusion.formats.container import BOMB_FREE_BYTES, BOMB_RATIO
from fusion.terrain.drivers import HGT_MOST_BYTES, is_gzipped
from fusion.terrain.raster import open_raster, read_header
from fusion.types import Progress

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
    return Limits(
        max_bytes=settings.max_import_bytes,
        max_posts=settings.max_raster_posts,
        keep_free_bytes=settings.min_free_bytes,
    )


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
            f"{path.name} cannot be copied to {folder.parent.parent}: {str(error).rstrip('.')}. Check the file and "
            "that there is room, and import it again."
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
            f"{source.name} has {raster.rows} x {raster.columns} posts, and the service takes {limits.max_posts} of a "
            "raster at most (VERSANT_MAX_RASTER_POSTS). Cut it to where the roads are, or import it by `versant "
            "import-dem` where the service runs."
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
                raise TerrainError(
                    f"{path.name} unpacks to more than {most >> 20} MiB, which no raster of its size does or the "
                    "service takes (VERSANT_MAX_IMPORT_BYTES). Give the raster itself, or a smaller part of it."
                )
            _report(progress, "unpacking", packed.tell(), path)

        try:
            _write(plain, target, limits, written)
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise TerrainError(
                f"{path.name} cannot be unpacked: {str(error).rstrip('.')}. Download it again, or give the raster "
                "itself."
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
