"""The active set of elevation rasters in the database, and the slopes and heights of segments by them.

The files themselves are ``app.terrain.imports``' business: no raster is opened here.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core import mirror
from app.core.settings import FilePlace
from fusion.errors import TerrainError
from fusion.types import Floats, Ints


@dataclass(frozen=True)
class DemSource:
    """One stored raster: its name, its path relative to the folder, the SHA-256 of the stored bytes (hex).

    With a quality layer, the folder's name is that of both contents: the same elevations with another layer are
    another source.
    """

    name: str
    uri: str
    sha256: str


@dataclass(frozen=True)
class DemSet:
    """The active elevation rasters, and where their files are kept."""

    version_id: int
    datum: str
    imported_at: datetime
    sources: tuple[DemSource, ...]
    place: FilePlace

    @property
    def names(self) -> tuple[str, ...]:
        """The rasters' names, as attributions give them."""
        return tuple(source.name for source in self.sources)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The rasters' files on this machine, those not here yet fetched; ``TerrainError`` where one cannot be."""
        return tuple(local_raster(self.place, source) for source in self.sources)


def local_raster(place: FilePlace, source: DemSource) -> Path:
    """A raster's file on this machine, its quality layer beside it."""
    try:
        return mirror.fetch(place, source.uri, source.sha256)
    except mirror.MirrorError as error:
        raise TerrainError(
            f"The elevation raster {error} See to the storage of VERSANT_DEM_URL, then ask for it again."
        ) from error


_ACTIVE = text("SELECT id, datum, imported_at, sources FROM dem_versions WHERE active")

# At most one set is active (a unique index sees to it), so the old one retires before the new one comes.
_RETIRE = text("UPDATE dem_versions SET active = false WHERE active")
_ADD = text(
    """
    INSERT INTO dem_versions (sources, datum, active) VALUES (CAST(:sources AS jsonb), :datum, true)
    RETURNING id, datum, imported_at, sources
    """
)

# Only rows whose values change are written; NaN stands for an unknown slope in the array.
_ACTIVE_ID = text("SELECT coalesce(max(id), 0) FROM dem_versions WHERE active")

_SET_TERRAIN = text(
    """
    UPDATE segments AS s SET dem_slope_percent = t.slope, dem_heights_m = t.heights
    FROM (SELECT id, nullif(slope, 'NaN') AS slope, CAST(heights AS float8[]) AS heights
          FROM unnest(CAST(:ids AS bigint[]), CAST(:slopes AS float8[]), CAST(:heights AS text[]))
               AS u (id, slope, heights)) AS t
    WHERE s.id = t.id AND (s.dem_slope_percent, s.dem_heights_m) IS DISTINCT FROM (t.slope, t.heights)
    """
)


def current_dem(session: Session, dem_dir: FilePlace) -> DemSet | None:
    """The active rasters, or None before the first import."""
    row = session.execute(_ACTIVE).one_or_none()
    return None if row is None else _set(row, dem_dir)


def replace_dem(session: Session, sources: Sequence[DemSource], datum: str, dem_dir: FilePlace) -> DemSet:
    """Make ``sources`` the active set, as a new version. The caller owns the network."""
    session.execute(_RETIRE)
    listed = json.dumps([asdict(source) for source in sources])
    return _set(session.execute(_ADD, {"sources": listed, "datum": datum}).one(), dem_dir)


def dem_version_id(session: Session) -> int:
    """The number of the active set of rasters; 0 without any."""
    return int(session.execute(_ACTIVE_ID).scalar_one())


def set_terrain(
    session: Session, segment_ids: Ints, slope_percent: Floats, height_m: Sequence[Floats]
) -> None:
    """Write what the elevation model says of segments: slopes (n,), and heights at the knots of each; NaN unknown."""
    values = {
        "ids": segment_ids.tolist(),
        "slopes": slope_percent.tolist(),
        "heights": [_array(heights) for heights in height_m],
    }
    session.execute(_SET_TERRAIN, values)


def _array(heights_m: Floats) -> str | None:
    """PostgreSQL's text of an array; None where no height is known."""
    return "{" + ",".join(map(repr, heights_m.tolist())) + "}" if np.isfinite(heights_m).any() else None


def _set(row: Row[Any], dem_dir: FilePlace) -> DemSet:
    sources = tuple(DemSource(**source) for source in row.sources)
    return DemSet(row.id, row.datum, row.imported_at, sources, dem_dir)
