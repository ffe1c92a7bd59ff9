"""One file made of what a session sees: for ``versant export`` and for exports that the service keeps.

Every file states where its data come from, whose they are, and which state of them it is. That depends on the data, the
request and the program alone, never on a clock: the same state makes the same file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.errors import BadRequestError
from app.core.messages import say
from app.core.settings import Settings
from app.core.settings.places import FilePlace
from app.core.text import dumps, utc_text
from app.core.version import code_version
from app.exports.format import Format, NoOptions, Stated, statements
from app.exports.formats import FORMATS
from app.exports.source import OnProgress, Query, Source, parts_of
from app.map import segment
from app.roads.store import all_regions, known_region
from app.terrain.coverage import sources_over
from app.terrain.store import current_dem
from fusion.errors import BadOptionsError, FusionError

# The sums tell any change of what is shown of any cell; the time tells two databases apart. A cell that was only
# locked has a row and no version.
_STATE = text("""
    SELECT c.versions, c.drawn, coalesce((SELECT turn FROM derived_upto), 0) AS derived, coalesce(r.id, 0) AS roads,
           coalesce(d.id, 0) AS dem,
           greatest(c.changed_at, r.imported_at, d.imported_at) AS changed_at
    FROM (SELECT coalesce(sum(version), 0) AS versions, coalesce(sum(drawn_version), 0) AS drawn,
                 max(changed_at) FILTER (WHERE version > 0) AS changed_at FROM cells) AS c
    LEFT JOIN (SELECT max(id) AS id, max(imported_at) AS imported_at FROM road_versions) AS r ON true
    LEFT JOIN (SELECT id, imported_at FROM dem_versions WHERE active) AS d ON true
""")
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


def provenance(session: Session, place: FilePlace, state: State, request: Request) -> dict[str, Any]:
    """The document on the origin of what a session sees: state, request, licences, regions, rasters, program."""
    active = current_dem(session, place)
    boxes: Sequence[Bounds | None] = [None] if request.bbox is None else parts_of(request.bbox)
    over = {one for box in boxes for one in sources_over(session, active, bbox=box, driven=request.driven)}
    return {
        "generator": f"Versant {code_version()}",
        "data_version": state.version,
        "changed_at": utc_text(state.changed_at),
        "request": request.document(),
        "attribution": segment.attribution(one.credit for one in over),
        "licences": [
            {
                "of": "roads, and all that derives from them",
                "attribution": segment.OSM_ATTRIBUTION,
                "attribution_url": segment.OSM_COPYRIGHT_URL,
                "name": segment.OSM_LICENSE,
                "url": segment.OSM_LICENSE_URL,
            }
        ],
        "height_datum": segment.HEIGHT_DATUM,
        "roads": [
            {
                "region": one.name,
                "file": one.source_name,
                "sha256": one.sha256,
                "imported_at": utc_text(one.imported_at),
            }
            for one in all_regions(session)
        ],
        "elevation": None
        if active is None
        else {
            "version": active.version_id,
            "datum": active.datum,
            "imported_at": utc_text(active.imported_at),
            "rasters": [
                {"name": one.name, "sha256": one.sha256, "source": one.source, "licence": one.licence}
                for one in active.sources
                if one in over
            ],
        },
    }


@dataclass(frozen=True)
class Request:
    """Which file of which part of the map. Made by ``request_of``, which checks it."""

    format: Format
    options: NoOptions
    bbox: Bounds | None = None
    region: str | None = None
    driven: bool = False
    gaps: bool = False
    suffix: str = ""
    """One of the format's."""
    most_sigma_percent: float | None = None
    least_drives: int = 0

    @property
    def file_name(self) -> str:
        """What the file is called where nobody names it."""
        return f"versant-{self.format.name}{self.suffix}"

    def document(self) -> dict[str, Any]:
        """As JSON, complete: what files state, and what ``request_of`` takes. Of files of this machine their names."""
        options = self.options.model_dump(mode="json")
        for name in self.options.local_files:
            if options.get(name) is not None:
                options[name] = Path(options[name]).name
        return {
            "format": self.format.name,
            "suffix": self.suffix,
            "bbox": None if self.bbox is None else list(self.bbox),
            "region": self.region,
            "driven": self.driven,
            "gaps": self.gaps,
            "most_sigma_percent": self.most_sigma_percent,
            "least_drives": self.least_drives,
            "options": options,
        }

    def sha256(self) -> str:
        """Equal for requests that this version of the program answers by the same file."""
        return hashlib.sha256(dumps([self.document(), code_version()]).encode()).hexdigest()

    def query(self, session: Session) -> Query:
        """The part of the map; ``RoadsError`` for a region that is not there, with those that are."""
        region = None if self.region is None else known_region(session, self.region)
        return Query(self.bbox, region, self.driven, self.gaps, self.most_sigma_percent, self.least_drives)


def request_of(
    format_name: str,
    options: Mapping[str, Any],
    *,
    bbox: Bounds | None = None,
    region: str | None = None,
    driven: bool = False,
    gaps: bool = False,
    suffix: str | None = None,
    most_sigma_percent: float | None = None,
    least_drives: int = 0,
    local: bool = False,
) -> Request:
    """The request, checked as far as that needs no database.

    ``UnknownNameError`` lists the formats there are, ``BadOptionsError`` names the option or filter at fault.
    ``suffix``: one of the format's, by default the usual one.
    ``local``: of a person at this machine, whose files may be named.
    """
    chosen = FORMATS[format_name]
    chosen.check_filters(
        driven=driven,
        gaps=gaps,
        region=region is not None,
        most_sigma_percent=most_sigma_percent is not None,
        least_drives=least_drives > 0,
    )
    if suffix is not None and suffix not in chosen.suffixes:
        known = ", ".join(chosen.suffixes)
        raise BadOptionsError(say("export.suffix", name=chosen.name, names=known), where="suffix")
    checked = chosen.parse_options(options, local=local)
    kind = suffix or chosen.suffixes[0]
    return Request(chosen, checked, bbox, region, driven, gaps, kind, most_sigma_percent, least_drives)


def asked_again(document: Mapping[str, Any]) -> Request:
    """The request of its document; ``BadRequestError`` where this version of the program cannot do that."""
    try:
        box = document["bbox"]
        bounds = None if box is None else (box[0], box[1], box[2], box[3])
        filters = {name: document[name] for name in ("region", "driven", "gaps", "suffix")}
        # Requests of versions before this one have none of them.
        filters |= {
            name: document[name] for name in ("most_sigma_percent", "least_drives") if name in document
        }
        return request_of(document["format"], document["options"], bbox=bounds, **filters)
    except FusionError as error:
        raise BadRequestError(say("export.other_version", error=error)) from error


@dataclass(frozen=True)
class Made:
    """A file that was made."""

    count: int
    """Of the things in it: segments, ways, tiles, or whatever its form consists of."""
    state: State
    provenance: Mapping[str, Any]
    stated: Stated
    """The same as files state it; companions are made of it (``Format.companions``)."""
    notes: Sequence[str]
    """What a person is to be told of it."""


def make_file(
    session: Session, settings: Settings, request: Request, path: Path, on_progress: OnProgress
) -> Made:
    """Write ``path`` anew from what the session sees, which should be a snapshot (``app.core.db``).

    The same state of the data, the same request and the same program make the same bytes. ``on_progress`` takes the
    share of the work done, and may end it by raising. Raises ``FusionError`` for what cannot be made, ``OSError`` and
    GDAL's errors.
    """
    state = data_state(session)
    origin = provenance(session, settings.dem_dir, state, request)
    return make_stated(session, settings, request, path, on_progress, state, origin)


def make_stated(
    session: Session,
    settings: Settings,
    request: Request,
    path: Path,
    on_progress: OnProgress,
    state: State,
    origin: Mapping[str, Any],
) -> Made:
    """As ``make_file``, with this document on the origin of the data in it (``provenance``)."""
    query = request.query(session)
    source = Source(session, settings.dem_dir, query, on_progress, full_zoom=settings.tile_full_zoom)
    stated = statements(origin["attribution"], origin["height_datum"])
    stated |= {"changed_at": origin["changed_at"], "provenance": dumps(origin)}
    count = request.format.write(source, path, stated, request.options)
    return Made(count, state, origin, stated, tuple(source.notes))
