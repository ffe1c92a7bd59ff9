"""What a region's file said, kept so that a file of changes can be applied to it: beside the elevation rasters.

Each import keeps a file of its own, under a name that no other has, and lets that of the import before go.
"""

from __future__ import annotations

import uuid
from pathlib import Path

from app.core import mirror
from app.core.db import Bounds
from app.core.messages import say
from app.core.settings.places import FilePlace
from app.roads.store import Region
from fusion.errors import RoadsError
from fusion.roads.osm_changes import apply_changes, keep_roads


def keep_file(place: FilePlace, source: Path, region: str) -> tuple[str, str]:
    """Keep what an OSM file says of roads; under which name, and the SHA-256 of its bytes (hex)."""
    uri = f"roads-{uuid.uuid4().hex}/{region}.osm.pbf"
    target = mirror.local_folder(place) / uri
    target.parent.mkdir(parents=True)
    try:
        keep_roads(source, target)
        mirror.send(place, [uri])
        return uri, mirror.sha256_of(target)
    except BaseException as error:
        mirror.forget(place, uri)
        if isinstance(error, mirror.MirrorError):
            raise RoadsError(say("roads.cannot_be_kept", file=source.name, error=error)) from error
        raise


def kept_file(place: FilePlace, region: Region) -> Path:
    """Where a region's file is on this machine; ``RoadsError`` where nothing is kept, or what is kept is lost."""
    if region.file_uri is None or region.file_sha256 is None:
        raise RoadsError(say("roads.no_file_kept", region=region.name))
    try:
        file = mirror.fetch(place, region.file_uri, region.file_sha256)
    except mirror.MirrorError as error:
        raise RoadsError(say("roads.file_lost_by", region=region.name, error=error)) from error
    if not file.is_file():
        raise RoadsError(say("roads.file_lost", region=region.name))
    return file


def changed_file(place: FilePlace, region: Region, changes: Path, bounds_deg: Bounds, folder: Path) -> Path:
    """The region's file with changes, in a folder that the caller clears away.

    ``RoadsError`` where nothing is kept, or what is kept is lost.
    """
    target = folder / f"{region.name}.osm.pbf"
    apply_changes(kept_file(place, region), changes, target, bounds_deg)
    return target
