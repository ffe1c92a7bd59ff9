"""The quality layer of an elevation raster: how many scenes stand behind each post (Al Assaad 2020, 2.4).

ASTER GDEM comes in pairs: ``ASTGTM2_N50E001_dem.tif`` holds elevations, ``ASTGTM2_N50E001_num.tif`` on the same
grid the number of stereo scenes that were averaged. A post that too few scenes saw was filled from another model
(SRTM, NED, CDED ...) and has a code instead of a number: negative in versions 1 and 2, whose files are signed, and
above 200 in version 3, whose files are not. What stands behind such a post is not known, so it counts as
**no scene**: a threshold of 1 keeps what ASTER measured and leaves every fill out. The rule asks for the value
alone, not for the type of the file, since tools convert types.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.errors import TerrainError
from fusion.messages import say
from fusion.terrain.raster import ALIGNED_POSTS, Raster, apply, read_header, read_stored
from fusion.types import Floats

_NAME = re.compile(r"(?P<tile>.+)_(?P<kind>dem|num)(?P<suffixes>(?:\.\w+)+)", re.IGNORECASE)
_MOST_SCENES = 200


def pair(paths: Sequence[Path]) -> list[tuple[Path, Path | None]]:
    """Each elevation raster with its quality layer: one of ``paths``, else the file beside it, else None.

    A quality layer is known by its name (``..._num.tif`` beside ``..._dem.tif``, in any case). Raises
    ``TerrainError`` for one without its elevations: its numbers must not pass for heights.
    """
    named = [(*_tile_and_kind(path), Path(path)) for path in paths]
    given = {tile: path for tile, kind, path in named if kind == "num"}
    elevations = [(tile, path) for tile, kind, path in named if kind != "num"]
    for tile, path in given.items():
        if tile not in {of for of, _ in elevations}:
            raise TerrainError(
                say(
                    "raster.is_quality",
                    file=path.name,
                    other=re.sub("num", "dem", path.name, flags=re.IGNORECASE),
                )
            )
    return [(path, given.get(tile) or _beside(path)) for tile, path in elevations]


def quality_name(path: Path) -> str:
    """The name under which the quality layer of elevations is looked for first, beside them."""
    match = _NAME.fullmatch(path.name)
    return f"{match['tile']}_num{match['suffixes']}" if match else ""


def with_quality(raster: Raster, path: Path | None) -> Raster:
    """The raster with its quality layer; ``TerrainError`` when that is unreadable or on another grid."""
    if path is None:
        return raster
    layer = read_header(path, trusted=raster.trusted)
    same_size = (layer.rows, layer.columns) == (raster.rows, raster.columns)
    if not (same_size and layer.crs == raster.crs and _same_posts(layer, raster)):
        raise TerrainError(
            say(
                "raster.quality_apart",
                file=path.name,
                raster=raster.path.name,
                rows=layer.rows,
                columns=layer.columns,
                rows2=raster.rows,
                columns2=raster.columns,
            )
        )
    return replace(raster, quality=layer)


def read_scenes(raster: Raster, dataset: Any, row: int, column: int, rows: int, columns: int) -> Floats:
    """Numbers of scenes of a window inside a quality layer; 0 for fills and where nothing is known."""
    stored = read_stored(raster, dataset, row, column, rows, columns)
    scenes = np.asarray(stored.filled(0), np.float64)
    scenes[~((scenes >= 0) & (scenes <= _MOST_SCENES))] = 0.0
    return scenes


def _tile_and_kind(path: Path) -> tuple[str, str]:
    """The tile that a file is of, and whether it is its ``dem`` or its ``num``; nothing of files of other names."""
    match = _NAME.fullmatch(Path(path).name)
    return (match["tile"].casefold(), match["kind"].lower()) if match else ("", "")


def _beside(path: Path) -> Path | None:
    """The quality layer in the raster's folder, its name spelled as the raster's or all in one case."""
    match = _NAME.fullmatch(Path(path).name)
    if match is None or match["kind"].lower() != "dem":
        return None
    plain = re.sub(r"\.gz$", "", match["suffixes"], flags=re.IGNORECASE)
    for suffixes in dict.fromkeys((match["suffixes"], plain, f"{plain}.gz", plain.lower(), plain.upper())):
        for kind in ("num", "NUM"):
            candidate = Path(path).with_name(f"{match['tile']}_{kind}{suffixes}")
            if candidate.is_file():
                return candidate
    return None


def _same_posts(a: Raster, b: Raster) -> bool:
    """Whether all corners of two grids of one size agree to a hundredth of a post."""
    size = max(abs(b.posts.a), abs(b.posts.b), abs(b.posts.d), abs(b.posts.e))
    corners = np.array([0.0, b.columns, 0.0, b.columns]), np.array([0.0, 0.0, b.rows, b.rows])
    offset = np.subtract(apply(a.posts, *corners), apply(b.posts, *corners))
    return bool(np.abs(offset).max() <= ALIGNED_POSTS * size)
