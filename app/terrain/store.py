"""The active set of elevation rasters in the database, and the slopes and heights of segments by them.

No raster is opened here; ``app.terrain.files`` handles the files.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Self

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core import mirror
from app.core.db import Bounds
from app.core.messages import say
from app.core.settings.places import FilePlace
from fusion.errors import TerrainError
from fusion.types import Floats, Ints


@dataclass(frozen=True)
class DemSource:
    """One stored raster: its name, its path relative to the folder, the SHA-256 of the stored bytes (hex).

    With a quality layer, the folder's name is that of both contents: the same elevations with another layer are
    another source. ``priority``: the higher the sooner it counts. ``bounds_deg``: west, south, east, north of its
    pixels, degrees; None of sources of before 0014 until they are needed (``app.terrain.files``). ``posting_m``: the
    distance of its posts, the larger one of rows and columns; None of sources that came before it was noted.
    ``source`` and ``licence``: whose data it is, as was said at the import; None: nobody said.
    """

    name: str
    uri: str
    sha256: str
    priority: int = 0
    bounds_deg: Bounds | None = field(default=None, compare=False)
    posting_m: float | None = field(default=None, compare=False)
    source: str | None = None
    licence: str | None = None

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Self:
        """The source of what ``dem_versions`` lists; what a later version may add is left out."""
        corners = stored.get("bounds_deg")
        bounds = None if corners is None else (corners[0], corners[1], corners[2], corners[3])
        known = stored["name"], stored["uri"], stored["sha256"], stored.get("priority") or 0
        return cls(*known, bounds, stored.get("posting_m"), stored.get("source"), stored.get("licence"))

    @property
    def credit(self) -> str:
        """Whose data it is, as attributions say it; by its name where nobody said."""
        return (self.source or self.name) + (f" ({self.licence})" if self.licence else "")

    @property
    def with_quality(self) -> bool:
        """Whether a quality layer belongs to it: its folder is named after both contents then."""
        return self.uri.partition("/")[0] != self.sha256

    def may_meet(self, bounds_deg: Bounds) -> bool:
        """Whether the raster reaches a box; of unknown bounds, that it may."""
        if self.bounds_deg is None:
            return True
        (west, south, east, north), (w, s, e, n) = self.bounds_deg, bounds_deg
        return south <= n and s <= north and ((west <= e and w <= east) or west > east)


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
        """The rasters' names."""
        return tuple(source.name for source in self.sources)

    @property
    def priorities(self) -> tuple[int, ...]:
        """The rasters' priorities, in their order."""
        return tuple(source.priority for source in self.sources)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The rasters' files on this machine, those not here yet fetched; ``TerrainError`` where one cannot be."""
        return tuple(local_raster(self.place, source) for source in self.sources)


def local_raster(place: FilePlace, source: DemSource) -> Path:
    """A raster's file on this machine, its quality layer beside it."""
    try:
        return mirror.fetch(place, source.uri, source.sha256)
    except mirror.MirrorError as error:
        raise TerrainError(say("raster.lost", error=error)) from error


_ACTIVE = text("SELECT id, datum, imported_at, sources FROM dem_versions WHERE active")

# At most one set is active (a unique index sees to it), so the old one retires before the new one comes.
_RETIRE = text("UPDATE dem_versions SET active = false WHERE active")
_ADD = text("""
    INSERT INTO dem_versions (sources, datum, active, pending)
    VALUES (CAST(:sources AS jsonb), :datum, true, CAST(:pending AS jsonb))
    RETURNING id, datum, imported_at, sources
""")
_PENDING = text("SELECT id, pending FROM dem_versions WHERE active AND pending IS NOT NULL")
_NOTE_PENDING = text("UPDATE dem_versions SET pending = CAST(:pending AS jsonb) WHERE id = :id")
_ALL_SOURCES = text("SELECT id, sources FROM dem_versions ORDER BY id FOR UPDATE")
_SET_SOURCES = text("UPDATE dem_versions SET sources = CAST(:sources AS jsonb) WHERE id = :id")

# A version retires when the next one comes; what the active one names is in use whatever was before.
_RETIRED = text("""
    WITH named AS (
        SELECT v.id, v.active, s ->> 'uri' AS uri,
               (SELECT n.imported_at FROM dem_versions AS n WHERE n.id > v.id ORDER BY n.id LIMIT 1) AS retired_at
        FROM dem_versions AS v, jsonb_array_elements(v.sources) AS s
    )
    SELECT uri FROM named GROUP BY uri HAVING NOT bool_or(active) AND max(retired_at) < now() - :age ORDER BY uri
""")


# The version that named the file first, though it may have been out of use since.
_CAME = text("""
    SELECT s ->> 'uri' AS uri, min(v.imported_at) FROM dem_versions AS v, jsonb_array_elements(v.sources) AS s
    GROUP BY s ->> 'uri'
""")
# Only rows whose values change are written; NaN stands for an unknown slope in the array.
_ACTIVE_ID = text("SELECT coalesce(max(id), 0) FROM dem_versions WHERE active")

_SET_TERRAIN = text("""
    UPDATE segments AS s SET dem_slope_percent = t.slope, dem_heights_m = t.heights
    FROM (SELECT id, nullif(slope, 'NaN') AS slope, CAST(heights AS float8[]) AS heights
          FROM unnest(CAST(:ids AS bigint[]), CAST(:slopes AS float8[]), CAST(:heights AS text[]))
               AS u (id, slope, heights)) AS t
    WHERE s.id = t.id AND (s.dem_slope_percent, s.dem_heights_m) IS DISTINCT FROM (t.slope, t.heights)
""")


def chosen(sources: Sequence[DemSource], names: Collection[str]) -> list[DemSource]:
    """The rasters of these names, in any case; ``TerrainError`` where one is not there."""
    by_name = {source.name.casefold(): source for source in sources}
    for name in names:
        if name.casefold() not in by_name:
            raise TerrainError(
                say("raster.no_such", name=name, names=", ".join(s.name for s in sources) or "none")
            )
    return list(dict.fromkeys(by_name[name.casefold()] for name in names))


def current_dem(session: Session, dem_dir: FilePlace) -> DemSet | None:
    """The active rasters, or None before the first import."""
    row = session.execute(_ACTIVE).one_or_none()
    return None if row is None or not row.sources else _set(row, dem_dir)


def replace_dem(
    session: Session,
    sources: Sequence[DemSource],
    datum: str,
    dem_dir: FilePlace,
    boxes_deg: Iterable[Bounds],
) -> DemSet:
    """Make ``sources`` the active set, as a new version; in the boxes, and where it was left to be done before, the
    heights of segments are to be renewed. The caller owns the network.
    """
    left = pending_heights(session)
    boxes = [*(left.boxes_deg if left else ()), *boxes_deg]
    session.execute(_RETIRE)
    listed = json.dumps([asdict(source) for source in sources])
    pending = json.dumps({"boxes_deg": boxes, "after_id": 0}) if boxes else None
    return _set(session.execute(_ADD, {"sources": listed, "datum": datum, "pending": pending}).one(), dem_dir)


@dataclass(frozen=True)
class PendingHeights:
    """Where segments still have heights of rasters before the active ones: those in the boxes with an id above one."""

    version_id: int
    boxes_deg: tuple[Bounds, ...]
    after_id: int


def pending_heights(session: Session) -> PendingHeights | None:
    """What is left to be renewed; None where all segments have the heights of the active rasters."""
    row = session.execute(_PENDING).one_or_none()
    if row is None:
        return None
    boxes = tuple((w, s, e, n) for w, s, e, n in row.pending["boxes_deg"])
    return PendingHeights(row.id, boxes, row.pending["after_id"])


def note_renewed(session: Session, pending: PendingHeights, after_id: int | None) -> None:
    """Note up to which segment id heights are renewed; None: all are."""
    left = None if after_id is None else json.dumps({"boxes_deg": pending.boxes_deg, "after_id": after_id})
    session.execute(_NOTE_PENDING, {"id": pending.version_id, "pending": left})


def sources_of_all(session: Session) -> dict[int, tuple[DemSource, ...]]:
    """The rasters of every version by its number, also of former ones; they stay as they are until the session ends."""
    return {row.id: tuple(map(DemSource.of, row.sources)) for row in session.execute(_ALL_SOURCES)}


def set_sources(session: Session, version_id: int, sources: Sequence[DemSource]) -> None:
    """Update what is known of a version's rasters; the rasters stay the same."""
    listed = json.dumps([asdict(source) for source in sources])
    session.execute(_SET_SOURCES, {"id": version_id, "sources": listed})


def retired_rasters(session: Session, older_than: timedelta) -> list[str]:
    """Paths of rasters that have been in no active set for so long."""
    return list(session.execute(_RETIRED, {"age": older_than}).scalars())


def rasters_came(session: Session) -> dict[str, datetime]:
    """When each raster was imported first, by its path."""
    return {row[0]: row[1] for row in session.execute(_CAME)}


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
    sources = tuple(map(DemSource.of, row.sources))
    return DemSet(row.id, row.datum, row.imported_at, sources, dem_dir)
