"""Editions over HTTP: who is answered, files whole and in parts, what goes with the next edition; and what is said of
privacy."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from datetime import date
from pathlib import Path

import httpx
import pytest
from pmtiles.reader import Reader, all_tiles

from access_support import Keyed, asking_for_keys
from app.access.rules import ROUTES, Rule
from app.core.blobs import EDITIONS, BlobStore
from app.core.settings import Settings
from app.map import figures
from app.map.derived.following import follow_all
from app.releases.files import publish_files
from app.releases.keeping import copy_files, folder_key, keep_files
from app.releases.routes import privacy_of
from app.releases.store import Edition, list_editions
from edition_support import add_edition, edition_sessions
from fusion.types import no_progress
from web_fixtures import Web, add_drive, fill_roads, served

NAMES = ["slopes.pmtiles", "slopes.parquet", "slopes.gpkg", "manifest.json"]
CALLERS = (None, "anna upload", "anna", "operate")


@pytest.fixture
def released(settings: Settings) -> Iterator[Keyed]:
    """A service that shows editions to whoever has no key."""
    with asking_for_keys(settings, public_map="releases") as keyed:
        fill_roads(keyed.web.sessions)
        add_drive(keyed.web.sessions, [0, 1, 2], 3.0)
        yield keyed


def make_edition(web: Web, number: int, folder: Path) -> Edition:
    """The next edition with its files, as a release makes it, and these in a folder."""
    edition = add_edition(web.sessions, number, date(2026, 11, 6 + 7 * number))
    sessions = edition_sessions(web.settings)
    edition = publish_files(web.sessions, sessions, edition, web.settings, no_progress)
    sessions.kw["bind"].dispose()
    copy_files(web.settings, edition, folder)
    return edition


def test_every_caller_reads_editions_and_their_files(released: Keyed, tmp_path: Path) -> None:
    assert released.ask(None, "GET", "/v1/editions").json()["editions"] == []
    assert released.ask(None, "GET", "/v1/editions/latest").status_code == 404
    edition = make_edition(released.web, 2, tmp_path)
    for caller in CALLERS:
        (listed,) = released.ask(caller, "GET", "/v1/editions").json()["editions"]
        assert listed["number"] == 2 and listed["day"] == "2026-11-20" and listed["owners"] == 3
        assert [file["name"] for file in listed["files"]] == NAMES
        for address in ("/v1/editions/2", "/v1/editions/latest"):
            assert released.ask(caller, "GET", address).json() == listed
        for file, at in zip(edition.files, listed["links"][1:], strict=True):
            answer = released.ask(caller, "GET", at["href"])
            assert answer.status_code == 200
            assert hashlib.sha256(answer.content).hexdigest() == file["sha256"]
            assert answer.headers["content-type"].startswith(file["media_type"])
            shown = "private" if caller else "public"
            assert shown in answer.headers["cache-control"]
    for wrong in (
        "/v1/editions/3",
        "/v1/editions/0",
        "/v1/editions/x",
        "/v1/editions/2/passwd",
        "/v1/editions/99999999999",
    ):
        assert released.ask(None, "GET", wrong).status_code == 404, wrong
    assert released.ask("wrong", "GET", "/v1/editions").status_code == 401


def test_files_come_in_parts_as_clients_of_tiles_ask(released: Keyed, tmp_path: Path) -> None:
    edition = make_edition(released.web, 1, tmp_path)
    address, content = "/v1/editions/latest/slopes.pmtiles", (tmp_path / "slopes.pmtiles").read_bytes()
    etag = f'"{edition.files[0]["sha256"]}"'

    def ask(**headers: str) -> httpx.Response:
        return released.ask(
            None, "GET", address, headers={k.replace("_", "-"): v for k, v in headers.items()}
        )

    part = ask(Range="bytes=100-299")
    assert (part.status_code, part.content) == (206, content[100:300])
    assert part.headers["content-range"] == f"bytes 100-299/{len(content)}"
    assert part.headers["etag"] == etag
    assert part.headers["content-location"] == "/v1/editions/1/slopes.pmtiles"
    assert ask(Range="bytes=0-9", If_Range='"another"').content == content
    assert ask(If_None_Match=etag).status_code == 304
    assert ask(Range=f"bytes={len(content)}-").status_code == 416
    whole = released.ask(None, "HEAD", address, headers={"Accept-Encoding": "gzip"}).headers
    assert (whole["content-length"], "content-encoding" in whole) == (str(len(content)), False)

    def read(offset: int, length: int) -> bytes:
        return ask(Range=f"bytes={offset}-{offset + length - 1}").content

    reader = Reader(read)
    assert json.loads(reader.metadata()["provenance"])["edition"]["number"] == 1
    assert len(list(all_tiles(read))) > 3


def test_what_older_editions_had_goes_with_the_next_one(released: Keyed, tmp_path: Path) -> None:
    web = released.web
    first = make_edition(web, 1, tmp_path / "1")
    blobs = BlobStore(web.settings.blob_store_url, EDITIONS)
    blobs.take(f"{EDITIONS}/1-cut-off/slopes.gpkg", tmp_path / "1" / "manifest.json")
    second = make_edition(web, 2, tmp_path / "2")
    assert blobs.keys() == [folder_key(second)]
    assert released.ask(None, "GET", "/v1/editions/1/manifest.json").status_code == 404
    listed = released.ask(None, "GET", "/v1/editions").json()["editions"]
    assert [(one["number"], len(one["files"])) for one in listed] == [(2, 4), (1, 0)]
    assert not blobs.exists(f"{folder_key(first)}/manifest.json")


def test_the_files_before_are_there_until_the_new_ones_are(released: Keyed, tmp_path: Path) -> None:
    make_edition(released.web, 1, tmp_path)
    add_edition(released.web.sessions, 2)
    assert released.ask(None, "GET", "/v1/editions/latest").json()["number"] == 2
    answer = released.ask(None, "GET", "/v1/editions/latest/manifest.json")
    assert (answer.status_code, answer.json()["number"]) == (200, 1)


def test_as_many_editions_keep_their_files_as_the_setting_says(released: Keyed, tmp_path: Path) -> None:
    web = released.web
    web.settings = web.settings.model_copy(update={"editions_kept": 2})
    for number in (1, 2, 3):
        make_edition(web, number, tmp_path / str(number))
    with web.sessions() as session:
        assert [bool(one.files) for one in list_editions(session)] == [True, True, False]
    assert len(BlobStore(web.settings.blob_store_url, EDITIONS).keys()) == 2


def test_another_database_keeps_what_only_it_may_know(released: Keyed, tmp_path: Path) -> None:
    web = released.web
    make_edition(web, 1, tmp_path / "1")
    blobs = BlobStore(web.settings.blob_store_url, EDITIONS)
    blobs.register_database("another-1")
    blobs.take(f"{EDITIONS}/7-of-another/manifest.json", tmp_path / "1" / "manifest.json")
    second = make_edition(web, 2, tmp_path / "2")
    assert blobs.keys() == [folder_key(second), f"{EDITIONS}/7-of-another"]


def test_files_that_are_gone_are_told_as_gone(released: Keyed, tmp_path: Path) -> None:
    """As after a backup, which has no files of editions, came back."""
    edition = make_edition(released.web, 1, tmp_path)
    BlobStore(released.web.settings.blob_store_url, EDITIONS).delete_folder(folder_key(edition))
    answer = released.ask(None, "GET", "/v1/editions/1/slopes.gpkg")
    assert answer.status_code == 404
    assert "next edition" in answer.json()["detail"]


def test_what_cannot_be_kept_leaves_nothing(released: Keyed, tmp_path: Path) -> None:
    edition = make_edition(released.web, 1, tmp_path)
    blobs = BlobStore(released.web.settings.blob_store_url, EDITIONS)
    blobs.delete_folder(folder_key(edition))
    (tmp_path / "slopes.gpkg").unlink()
    with pytest.raises(FileNotFoundError):
        keep_files(released.web.settings, released.web.sessions, edition, tmp_path)
    assert blobs.keys() == []


OF_NO_EDITION = {
    "/collections/segments/queryables": "of the program",
    "/collections/segments/schema": "of the program",
    "/collections/segments/sortables": "of the program",
    "/collections/ways/queryables": "of the program",
    "/collections/ways/schema": "of the program",
    "/collections/ways/sortables": "of the program",
    "/collections/{collection_id}": "there is none of that name",
    "/collections/{collection_id}/{rest:path}": "there is none of that name",
    "/names.json": "names are OpenStreetMap's, and of no drive",
    "/tiles/{z}/{x}/{y}.geojson": "a tile in which nothing changed keeps its ETag from one edition to the next",
    "/v1/changes/events": "a stream, that says what to fetch anew",
    "/v1/editions": "of every edition",
    "/v1/editions/{number}": "the edition itself",
    "/v1/editions/{number}/{name}": "a file",
    "/v1/exports/formats": "of the program",
}
"""Documents of routes of the map that do not say which edition they are of, and why."""
ASKED = {
    "/height": {"json": json.dumps({"shape": [{"lat": 49.0, "lon": 8.4}]})},
    "/v1/elevation": {"locations": "49.0,8.4"},
    "/v1/energy": {
        "json": json.dumps({"path": {"type": "LineString", "coordinates": [[8.4, 49.0], [8.41, 49.0]]}})
    },
}
TOLD = {"number": 1, "day": "2026-11-13", "owners": 3, "owners_needed": 5}


def test_every_document_of_the_map_says_which_edition_it_is_of(released: Keyed, tmp_path: Path) -> None:
    follow_all(released.web.sessions)
    make_edition(released.web, 1, tmp_path)
    items = {name: f"/collections/{name}/items" for name in ("segments", "ways")}
    ids = {
        path: released.ask(None, "GET", path, params={"limit": 1}).json()["features"][0]["id"]
        for path in items.values()
    }
    parts = {"collection": "ways", "segment_id": ids[items["segments"]], "tileMatrix": 14, "z": 14}
    seen, wrong = set(), []
    for (method, path), rule in ROUTES.items():
        if rule is not Rule.MAP or path in OF_NO_EDITION:
            continue
        known = {**parts, "item_id": ids.get(path.removesuffix("/{item_id}"))}
        address = re.sub(r"\{(\w+)\}", lambda part, known=known: str(known.get(part[1], 1)), path)
        asked = {"json": json.loads(ASKED[path]["json"])} if method == "POST" else {"params": ASKED.get(path)}
        answers = {caller: released.ask(caller, method, address, **asked) for caller in CALLERS}
        assert {answer.status_code for answer in answers.values()} <= {200, 204}, address
        if "json" not in answers[None].headers.get("content-type", ""):
            continue
        seen.add(path)
        found = {caller: answer.json().get("edition") for caller, answer in answers.items()}
        if found != {None: TOLD, "anna upload": TOLD, "anna": None, "operate": None}:
            wrong.append((method, path, found))
    assert wrong == []
    assert len(seen) > 15 and {path for _, path in ROUTES} >= set(OF_NO_EDITION)
    assert released.ask(None, "GET", "/style.json").json()["metadata"]["versant:edition"] == TOLD


def test_changes_are_told_anew_of_an_edition_that_changed_nothing(released: Keyed, tmp_path: Path) -> None:
    """What says its number has another ETag; a tile says none, and keeps its own."""
    addresses = ("/v1/changes", "/collections/segments/items", "/tiles/14/8573/5630.geojson")
    again = []
    for number in (1, 2):
        make_edition(released.web, number, tmp_path / str(number))
        again.append([released.ask(None, "GET", one).headers["etag"] for one in addresses])
    (changes, items, tile), (later_changes, later_items, later_tile) = again
    assert changes != later_changes and items != later_items and tile == later_tile
    for address, etag in zip(addresses, again[1], strict=True):
        assert released.ask(None, "GET", address, headers={"If-None-Match": etag}).status_code == 304


def test_regions_count_what_the_edition_has(
    released: Keyed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a worker counts the live map, which the public may not know."""
    make_edition(released.web, 1, tmp_path)
    add_drive(released.web.sessions, [3, 4], 3.0)
    monkeypatch.setattr("app.operations.sources.FEW_SEGMENTS", 0)
    while figures.renew_one(released.web.sessions):
        pass
    measured = {
        caller: released.ask(caller, "GET", "/v1/regions").json()["regions"][0]["measured"]
        for caller in (None, "operate")
    }
    assert measured == {None: 3, "operate": 5}


@pytest.mark.parametrize("mode", ["live", "off", "releases"])
def test_what_is_seen_by_whom_is_said(settings: Settings, mode: str) -> None:
    changed = {"access": "keys", "public_map": mode, "public_owners": 5, "public_colluders": 1}
    with served(settings.model_copy(update=changed)) as web:
        add_edition(web.sessions, 1)
        answer = web.client.get("/v1/privacy")
    said = answer.json()
    assert answer.status_code == 200
    assert said["public_map"] == mode
    assert [one["by"] for one in said["seen"]] == ["nobody", "live", "upload", "own", "operate"]
    if mode == "releases":
        assert (said["owners"], said["owners_needed"], said["days_between_editions"]) == (5, 6, 7)
        assert said["trip_ends_m"] == [150, 400]
        assert said["edition"]["day"] == "2026-11-20"
        assert "at least 6 owners" in " ".join(said["text"])
    else:
        assert said["owners"] is said["edition"] is said["trip_ends_m"] is None
        assert said["text"] == []
    nobody = said["seen"][0]["text"]
    assert nobody.startswith({"live": "The map as it is", "off": "Nothing", "releases": "The newest"}[mode])


def test_a_service_without_keys_says_so(web: Web) -> None:
    said = web.client.get("/v1/privacy").json()
    assert said["access"] == "open"
    assert said["seen"] == [{"by": "nobody", "text": "Everything. The service asks for no keys."}]


@pytest.mark.parametrize("k", [1, 3])
def test_the_words_fit_how_many_may_work_together(settings: Settings, k: int) -> None:
    chosen = settings.model_copy(
        update={"access": "keys", "public_map": "releases", "owners_map": "releases", "public_owners": k}
    )
    said = privacy_of(chosen, None, "http://x")
    words = " ".join(said.text)
    assert ("tell each other" in words, "hides nobody" in words) == (k > 1, k == 1)
    assert "newest edition" in next(one.text for one in said.seen if one.by == "own")
