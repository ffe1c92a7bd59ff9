"""The active set of elevation rasters in the database, and the slopes of segments by them.

The files themselves lie in a folder and are ``app.terrain.imports``' business: no raster is opened here.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session

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
    """The active elevation rasters; their files are in ``folder``, on this machine's disk."""

    version_id: int
    datum: str
    imported_at: datetime
    sources: tuple[DemSource, ...]
    folder: Path

    @property
    def names(self) -> tuple[str, ...]:
        """The rasters' names, as attributions give them."""
        return tuple(source.name for source in self.sources)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The rasters' files."""
        return tuple(self.folder / source.uri for source in self.sources)


_ACTIVE = text("SELECT id, datum, imported_at, sources FROM dem_versions WHERE active")

# At most one set is active (a unique index sees to it), so the old one retires before the new one comes.
_RETIRE = text("UPDATE dem_versions SET active = false WHERE active")
_ADD = text(
    """
    INSERT INTO dem_versions (sources, datum, active) VALUES (CAST(:sources AS jsonb), :datum, true)
    RETURNING id, datum, imported_at, sources
    """
)

# Only rows whose value changes are written; NaN stands for unknown in the arrays.
_SET_SLOPES = text(
    """
    UPDATE segments AS s SET dem_slope_percent = t.slope
    FROM (SELECT id, nullif(slope, 'NaN') AS slope
          FROM unnest(CAST(:ids AS bigint[]), CAST(:slopes AS float8[])) AS u (id, slope)) AS t
    WHERE s.id = t.id AND s.dem_slope_percent IS DISTINCT FROM t.slope
    """
)


def current_dem(session: Session, dem_dir: Path) -> DemSet | None:
    """The active rasters, or None before the first import."""
    row = session.execute(_ACTIVE).one_or_none()
    return None if row is None else _set(row, dem_dir)


def replace_dem(session: Session, sources: Sequence[DemSource], datum: str, dem_dir: Path) -> DemSet:
    """Make ``sources`` the active set, as a new version. The caller owns the network."""
    session.execute(_RETIRE)
    listed = json.dumps([asdict(source) for source in sources])
    return _set(session.execute(_ADD, {"sources": listed, "datum": datum}).one(), dem_dir)


def set_dem_slopes(session: Session, segment_ids: Ints, slope_percent: Floats) -> None:
    """Write the slopes of segments by the elevation model, both of shape (n,), NaN unknown."""
    session.execute(_SET_SLOPES, {"ids": segment_ids.tolist(), "slopes": slope_percent.tolist()})


def _set(row: Row[Any], dem_dir: Path) -> DemSet:
    sources = tuple(DemSource(**source) for source in row.sources)
    return DemSet(row.id, row.datum, row.imported_at, sources, dem_dir)
