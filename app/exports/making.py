"""One file made of what a session sees: for ``versant export`` and for exports that the service keeps."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.errors import BadRequestError
from app.core.settings import Settings
from app.core.text import dumps
from app.core.version import code_version
from app.exports.format import Format, NoOptions, Stated
from app.exports.formats import FORMATS
from app.exports.provenance import State, data_state, provenance, stated_of
from app.exports.source import OnProgress, Query, Source
from app.roads.store import known_region
from fusion.errors import BadOptionsError, FusionError


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
            "options": options,
        }

    def sha256(self) -> str:
        """Equal for requests that this version of the program answers by the same file."""
        return hashlib.sha256(dumps([self.document(), code_version()]).encode()).hexdigest()

    def query(self, session: Session) -> Query:
        """The part of the map; ``RoadsError`` for a region that is not there, with those that are."""
        region = None if self.region is None else known_region(session, self.region)
        return Query(self.bbox, region, self.driven, self.gaps)


def request_of(
    format_name: str,
    options: Mapping[str, Any],
    *,
    bbox: Bounds | None = None,
    region: str | None = None,
    driven: bool = False,
    gaps: bool = False,
    suffix: str | None = None,
    local: bool = False,
) -> Request:
    """The request, checked as far as that needs no database.

    ``UnknownNameError`` lists the formats there are, ``BadOptionsError`` names the option or filter at fault.
    ``suffix``: one of the format's, by default the usual one.
    ``local``: of a person at this machine, whose files may be named.
    """
    chosen = FORMATS[format_name]
    chosen.check_filters(driven=driven, gaps=gaps, region=region is not None)
    if suffix is not None and suffix not in chosen.suffixes:
        known = ", ".join(chosen.suffixes)
        raise BadOptionsError(f"suffix: {chosen.name} writes files that end in {known}.", where="suffix")
    checked = chosen.parse_options(options, local=local)
    return Request(chosen, checked, bbox, region, driven, gaps, suffix or chosen.suffixes[0])


def asked_again(document: Mapping[str, Any]) -> Request:
    """The request of its document; ``BadRequestError`` where this version of the program cannot do that."""
    try:
        box = document["bbox"]
        bounds = None if box is None else (box[0], box[1], box[2], box[3])
        filters = {name: document[name] for name in ("region", "driven", "gaps", "suffix")}
        return request_of(document["format"], document["options"], bbox=bounds, **filters)
    except FusionError as error:
        raise BadRequestError(f"This version of the program cannot make it: {error}") from error


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
    """Write ``path`` anew from what the session sees, which should be a snapshot (``app.exports.source``).

    The same state of the data, the same request and the same program make the same bytes. ``on_progress`` takes the
    share of the work done, and may end it by raising. Raises ``FusionError`` for what cannot be made, ``OSError`` and
    GDAL's errors.
    """
    query = request.query(session)
    source = Source(session, settings.dem_dir, query, on_progress, full_zoom=settings.tile_full_zoom)
    state = data_state(session)
    origin = provenance(
        session, settings.dem_dir, state, request.document(), request.bbox, driven=request.driven
    )
    stated = stated_of(origin)
    count = request.format.write(source, path, stated, request.options)
    return Made(count, state, origin, stated, tuple(source.notes))
