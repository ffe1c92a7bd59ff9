"""The files of an edition: the same bytes for the same edition, complete, and with a manifest that is right."""

from __future__ import annotations

import hashlib
import json
import sqlite3
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pmtiles.reader import MmapSource, Reader

from app.core import databases
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.releases.files import write_files
from app.releases.store import Edition
from drawn_support import draw
from edition_support import DAY, add_edition, edition_sessions
from fusion.types import no_progress
from web_fixtures import add_drive, fill_roads

DRIVES = ([0, 1, 2], 3.0), ([2, 3, 4, 5], -1.0), ([1, 2, 20, 21], 2.5)
NAMES = ["slopes.pmtiles", "slopes.parquet", "slopes.gpkg", "manifest.json"]
Made = tuple[Sessions, Edition, Settings]


@pytest.fixture(scope="module")
def made_twice(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[list[Made]]:
    """Two services that got the same drives in another order, at another time, and the edition that each makes."""
    made, names = list[Made](), list[str]()
    for drives in (DRIVES, DRIVES[::-1]):
        names.append(new_database(template_db))
        url = cluster.url_of(names[-1])
        settings = Settings(database_url=url, data_dir=tmp_path_factory.mktemp("editions"))
        engine = make_engine(url)
        sessions = session_factory(engine)
        fill_roads(sessions)
        for rows, slope_percent in drives:
            add_drive(sessions, list(rows), slope_percent)
        draw(sessions)
        edition = add_edition(sessions, 4)
        engine.dispose()
        made.append((edition_sessions(settings), edition, settings))
        time.sleep(1.1)  # a GeoPackage's times are of seconds
    yield made
    for (sessions, _, _), name in zip(made, names, strict=True):
        sessions.kw["bind"].dispose()
        databases.drop_database(cluster.url, name)


def write(made: Made, folder: Path) -> list[dict[str, Any]]:
    sessions, edition, settings = made
    return [vars(file) for file in write_files(sessions, folder, edition, settings, no_progress)]


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def test_the_same_edition_is_the_same_bytes(made_twice: list[Made], tmp_path: Path) -> None:
    """Whenever it is written, over files that were there, and by whichever service that knows the same drives."""
    for number, made in enumerate([*made_twice, made_twice[0]]):
        write(made, tmp_path / str(number % 2))
        if number == 0:
            first = digests(tmp_path / "0")
    assert digests(tmp_path / "0") == digests(tmp_path / "1") == first
    assert sorted(first) == sorted(NAMES)


def test_the_manifest_names_every_file_with_its_checksum(made_twice: list[Made], tmp_path: Path) -> None:
    files = write(made_twice[0], tmp_path)
    assert [file["name"] for file in files] == NAMES
    for file in files:
        content = (tmp_path / file["name"]).read_bytes()
        assert (file["size_bytes"], file["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    named = [
        {key: one[key] for key in ("name", "media_type", "size_bytes", "sha256")} for one in manifest["files"]
    ]
    assert named == files[:-1]
    said = {key: manifest[key] for key in ("number", "day", "owners", "owners_needed", "withheld_share")}
    assert said == {"number": 4, "day": "2026-11-20", "owners": 3, "owners_needed": 5, "withheld_share": 0.31}
    assert manifest["segments"] == manifest["files"][1]["segments"] == manifest["files"][2]["segments"] == 8
    assert "OpenStreetMap" in manifest["attribution"]
    assert "ODbL" in manifest["licence"]["name"]
    assert not any("/" in one["name"] for one in manifest["files"])


def test_each_file_says_which_edition_it_is_of_and_no_other_time(
    made_twice: list[Made], tmp_path: Path
) -> None:
    write(made_twice[0], tmp_path)
    table = pq.read_table(tmp_path / "slopes.parquet")
    assert {str(moment.as_py()) for moment in table["updated_at"]} == {"2026-11-20 00:00:00+00:00"}
    origins = [json.loads(pq.read_metadata(tmp_path / "slopes.parquet").metadata[b"provenance"])]
    with (tmp_path / "slopes.pmtiles").open("rb") as file:
        origins.append(json.loads(Reader(MmapSource(file)).metadata()["provenance"]))
    with sqlite3.connect(tmp_path / "slopes.gpkg") as package:
        changes = {row[0] for row in package.execute("SELECT last_change FROM gpkg_contents")}
        assert changes == {f"{DAY}T00:00:00.000Z"}
        dates = {row[0] for row in package.execute("SELECT DISTINCT updated_at FROM segments")}
        assert dates == {f"{DAY}T00:00:00Z"}
    package.close()
    for origin in origins:
        assert origin["edition"] == {"number": 4, "day": "2026-11-20", "owners": 3, "owners_needed": 5}
        assert origin["changed_at"] == "2026-11-20T00:00:00.000Z"
        assert "imported_at" not in json.dumps(origin)
