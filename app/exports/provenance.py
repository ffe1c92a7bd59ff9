"""Where the data of a file come from, whose they are, and which state of them it is: what every file states.

It depends on the data, the request and the program alone, never on a clock: the same state makes the same file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.settings.places import FilePlace
from app.core.text import dumps, utc_text
from app.core.version import code_version
from app.exports.format import Stated, statements
from app.map.attribution import OSM_ATTRIBUTION, OSM_COPYRIGHT_URL, OSM_LICENSE, OSM_LICENSE_URL, attribution
from app.map.segment import HEIGHT_DATUM
from app.roads.store import find_region, region_names
from app.terrain.coverage import rasters_over
from app.terrain.store import current_dem

# The sums tell any change of what is shown of any cell; the time tells two databases apart. A cell that was only
# locked has a row and no version.
_STATE = text(
    """
    SELECT c.versions, c.drawn, coalesce((SELECT turn FROM derived_upto), 0) AS derived, coalesce(r.id, 0) AS roads,
           coalesce(d.id, 0) AS dem,
           greatest(c.changed_at, r.imported_at, d.imported_at) AS changed_at
    FROM (SELECT coalesce(sum(version), 0) AS versions, coalesce(sum(drawn_version), 0) AS drawn,
                 max(changed_at) FILTER (WHERE version > 0) AS changed_at FROM cells) AS c
    LEFT JOIN (SELECT max(id) AS id, max(imported_at) AS imported_at FROM road_versions) AS r ON true
    LEFT JOIN (SELECT id, imported_at FROM dem_versions WHERE active) AS d ON true
    """
)
_BEGINNING = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class State:
    """Which state of the data a session sees."""

    version: str
    """Equal for equal data, also of a restored copy of the database."""
    changed_at: datetime
    """When the data last changed; 1970 of an empty database."""


def data_state(session: Session) -> State:
    """The state of all that a file can hold. Reads one row a cell of the map."""
    row = session.execute(_STATE).one()
    changed_at = row.changed_at or _BEGINNING
    changed_us = int(changed_at.timestamp()) * 1_000_000 + changed_at.microsecond
    return State(f"{row.versions}.{row.drawn}.{row.derived}.{row.roads}.{row.dem}.{changed_us:x}", changed_at)


def provenance(
    session: Session,
    place: FilePlace,
    state: State,
    request: Mapping[str, Any],
    bbox: Bounds | None,
    *,
    driven: bool,
) -> dict[str, Any]:
    """The document on the origin of what a session sees: state, request, licences, regions, rasters, program."""
    active = current_dem(session, place)
    boxes = _boxes(bbox)
    over = {name for box in boxes for name in rasters_over(session, active, bbox=box, driven=driven)}
    regions = [region for name in region_names(session) if (region := find_region(session, name))]
    return {
        "generator": f"Versant {code_version()}",
        "data_version": state.version,
        "changed_at": utc_text(state.changed_at),
        "request": dict(request),
        "attribution": attribution(over),
        "licences": [
            {
                "of": "roads, and all that derives from them",
                "attribution": OSM_ATTRIBUTION,
                "attribution_url": OSM_COPYRIGHT_URL,
                "name": OSM_LICENSE,
                "url": OSM_LICENSE_URL,
            }
        ],
        "height_datum": HEIGHT_DATUM,
        "roads": [
            {
                "region": one.name,
                "file": one.source_name,
                "sha256": one.sha256,
                "imported_at": utc_text(one.imported_at),
            }
            for one in regions
        ],
        "elevation": None
        if active is None
        else {
            "version": active.version_id,
            "datum": active.datum,
            "imported_at": utc_text(active.imported_at),
            "rasters": [
                {"name": one.name, "sha256": one.sha256} for one in active.sources if one.name in over
            ],
        },
    }


def stated_of(document: Mapping[str, Any]) -> Stated:
    """What files state, of such a document."""
    known = statements(document["attribution"], document["height_datum"])
    return known | {"changed_at": document["changed_at"], "provenance": dumps(document)}


def _boxes(bbox: Bounds | None) -> list[Bounds | None]:
    """The box in parts that do not cross the antimeridian."""
    if bbox is None or bbox[0] <= bbox[2]:
        return [bbox]
    west, south, east, north = bbox
    return [(west, south, 180.0, north), (-180.0, south, east, north)]
