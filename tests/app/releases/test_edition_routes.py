"""Editions over HTTP: who is answered, files whole and in parts, what goes with the next edition; and what is said of
privacy."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from datetime import date
from pathlib import Path

import httpx
import pytest
from pmtiles.reader import Reader, all_tiles

from access_support import Keyed, asking_for_keys
from app.core.blobs import EDITIONS, BlobStore
from app.core.settings import Settings
from app.releases.files import publish_files
from app.releases.keeping import copy_files, folder_key, keep_files
from app.releases.privacy import privacy_of
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


def test_documents_say_which_edition_they_are_of(released: Keyed, tmp_path: Path) -> None:
    make_edition(released.web, 1, tmp_path)
    told = {"number": 1, "day": "2026-11-13", "owners": 3, "owners_needed": 5}
    items = released.ask(None, "GET", "/collections/segments/items?limit=1").json()
    segment = items["features"][0]["id"]
    addresses = (
        "/tiles.json",
        "/tiles/WebMercatorQuad",
        "/tiles",
        "/collections/segments",
        "/collections/ways",
        "/collections/segments/items?limit=1",
        f"/collections/segments/items/{segment}",
        f"/v1/segments/{segment}",
    )
    for address in addresses:
        for caller in (None, "anna upload"):
            assert released.ask(caller, "GET", address).json()["edition"] == told, address
        for caller in ("anna", "operate"):
            assert "edition" not in released.ask(caller, "GET", address).json(), address
    assert released.ask(None, "GET", "/style.json").json()["metadata"]["versant:edition"] == told


@pytest.mark.parametrize("mode", ["live", "off", "releases"])
def test_what_is_seen_by_whom_is_said(settings: Settings, mode: str) -> None:
    changed = {"access": "keys", "public_map": mode, "public_owners": 5, "public_colluders": 1}
    with served(settings.model_copy(update=changed)) as web:
        add_edition(web.sessions, 1)
        answer = web.client.get("/v1/privacy")
    said = answer.json()
    assert answer.status_code == 200
    assert said["public_map"] == mode
    assert [one["by"] for one in said["seen"]] == ["nobody", "upload", "own", "operate"]
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
    assert "newest edition" in said.seen[2].text
