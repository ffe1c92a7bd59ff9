"""Stored vector tiles counted by zoom, and how many of them are older than what they show. Reads all of them."""

from __future__ import annotations

from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.map.tiles.tiles import tag_of
from app.map.tiles.watch import Versions

_EPOCH = text("SELECT epoch || CAST(xmin AS text) FROM tile_epoch")
_CELLS = text(
    """
    SELECT id, version, drawn_version, CAST(extract(epoch FROM changed_at) * 1000000 AS bigint) FROM cells
    """
)
# A tile's tag names the zooms by which it was built last of all: from ".MIN.FULL" on.
_TILES = text("SELECT z, x, y, tag, size_bytes FROM stored_tiles")


def tiles_by_zoom(session: Session) -> list[dict[str, Any]]:
    """For each zoom with tiles: how many, their bytes, and how many would be built anew if they were asked for."""
    versions = Versions(str(session.execute(_EPOCH).scalar() or ""))
    versions.put([(row[0], row[1], row[2], row[3]) for row in session.execute(_CELLS)])
    rows: dict[int, dict[str, Any]] = {}
    for z, x, y, tag, size_bytes in session.execute(_TILES):
        row = rows.setdefault(z, {"zoom": z, "tiles": 0, "bytes": 0, "stale": 0})
        row["tiles"] += 1
        row["bytes"] += size_bytes
        row["stale"] += not _is_fresh(versions, z, x, y, tag)
    return [rows[z] for z in sorted(rows)]


def _is_fresh(versions: Versions, z: int, x: int, y: int, tag: str) -> bool:
    least, full = tag.rstrip('"').rsplit(".", 2)[-2:]
    if not (least.isdigit() and full.isdigit()):
        return False
    return tag == tag_of(versions, z, x, y, min_zoom=int(least), full_zoom=int(full))
