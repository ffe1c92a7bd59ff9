"""The files of an edition: what any static host can serve, byte for byte the same for the same edition.

Every file says which edition it is of, and its times are days of editions. Nothing in it depends on when it was written
or in which order drives came. ``manifest.json`` names the files with their checksums, relative to itself.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Any

from sqlalchemy.orm import Session

from app.core.db import Sessions, snapshot
from app.core.filesystems import full_is_told
from app.core.settings import Settings
from app.core.text import whole_file
from app.exports.making import Made, Request, State, make_stated, provenance, request_of
from app.releases.documents import MANIFEST, Figures
from app.releases.keeping import keep_files
from app.releases.store import Edition, identity
from fusion.types import Progress

GENERATOR = "Versant"
"""Without its version: an update of the program alone changes no file."""
SCRATCH = "releases"
"""Folder of the data folder in which files are made."""
_IN_DATABASE = {"imported_at", "version"}
"""What the origin of data has that is another in each database."""


@dataclass(frozen=True)
class Kind:
    """A file that every edition has."""

    name: str
    format: str
    driven: bool
    """Only segments with a slope, else every road."""
    title: str


KINDS = (
    Kind("slopes.pmtiles", "pmtiles", False, "Vector tiles of all roads"),
    Kind("slopes.parquet", "geoparquet", True, "Segments with a slope, as GeoParquet"),
    Kind("slopes.gpkg", "gpkg", True, "Segments with a slope, as GeoPackage, with its style for QGIS"),
)


@dataclass(frozen=True)
class EditionFile:
    """A file of an edition."""

    name: str
    media_type: str
    size_bytes: int
    sha256: str
    """Of its bytes, hex."""


def publish_files(
    live: Sessions, sessions: Sessions, edition: Edition, settings: Settings, progress: Progress
) -> Edition:
    """Write the files of the edition that ``sessions`` see and keep them; the edition with its files.

    For one process at a time: whoever makes the edition. Those of the edition before are there until then.
    """
    folder = settings.data_dir / SCRATCH
    shutil.rmtree(folder, ignore_errors=True)  # of one that was killed
    try:
        with full_is_told():
            files = write_files(sessions, folder, edition, settings, progress)
        made = replace(edition, files=[asdict(file) for file in files])
        keep_files(settings, live, made, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return made


def write_files(
    sessions: Sessions, folder: Path, edition: Edition, settings: Settings, progress: Progress
) -> list[EditionFile]:
    """Write the files of the edition that ``sessions`` see into ``folder``, and last their manifest.

    The folder is made where it is missing; files of these names in it are replaced. Each appears complete or not at
    all. Raises what ``app.exports.making.make_file`` raises.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files, entries = list[EditionFile](), list[dict[str, Any]]()
    origin: Mapping[str, Any] = {}
    with snapshot(sessions) as session:
        for kind in reversed(
            KINDS
        ):  # the tiles last: what they hold is of all roads, and so is its attribution
            request = request_of(kind.format, {}, driven=kind.driven)
            made = _make(session, settings, edition, request, folder / kind.name, progress)
            origin = made.provenance
            files.append(_file(folder / kind.name, request.format.media_type))
            entries.append({**asdict(files[-1]), "title": kind.title, request.format.holds: made.count})
    manifest = {
        "title": f"Slopes of roads, edition {edition.number}",
        "generator": GENERATOR,
        **Figures.of(edition).model_dump(),
        **{name: origin[name] for name in ("attribution", "height_datum", "roads", "elevation")},
        "files": entries[::-1],
    }
    with whole_file(folder / MANIFEST) as partial:
        partial.write_text(json.dumps(manifest, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return [*files[::-1], _file(folder / MANIFEST, "application/json")]


def _make(
    session: Session, settings: Settings, edition: Edition, request: Request, path: Path, progress: Progress
) -> Made:
    state = State(f"edition {edition.number}", datetime.combine(edition.day, time(), UTC))
    origin = _of_edition(provenance(session, settings.dem_dir, state, request), edition)
    with whole_file(path) as partial:
        return make_stated(
            session, settings, request, partial, lambda share: progress(path.name, share), state, origin
        )


def _of_edition(origin: Mapping[str, Any], edition: Edition) -> dict[str, Any]:
    """The origin of the data as a file of an edition states it."""
    elevation = origin["elevation"]
    return {
        **origin,
        "generator": GENERATOR,
        "edition": identity(edition),
        "roads": [_portable(region) for region in origin["roads"]],
        "elevation": None if elevation is None else _portable(elevation),
    }


def _portable(origin: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in origin.items() if name not in _IN_DATABASE}


def _file(path: Path, media_type: str) -> EditionFile:
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return EditionFile(path.name, media_type, path.stat().st_size, sha256)
