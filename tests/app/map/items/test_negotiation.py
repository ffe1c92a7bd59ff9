"""In which form an answer comes, what its headers say, and that nothing of a request stands in a page as it came."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest

from app.map.items.landing import CONFORMANCE
from app.map.items.pages import MOST_IN_HEADER, page

GEOJSON, SCHEMA = "application/geo+json", "application/schema+json"
OPENAPI = "application/vnd.oai.openapi+json"
EVERY = (
    "/", "/conformance", "/collections", "/collections/segments", "/collections/segments/schema", "/docs",
    "/collections/ways/queryables", "/collections/ways/sortables", "/collections/segments/items", "/openapi.json",
    "/collections/segments/items/3", "/collections/segments/items?f=html", "/openapi.json?f=openapi-3.0",
    "/openapi.json?f=html",
)  # fmt: skip


@pytest.mark.parametrize(
    ("path", "accept", "media_type"),
    [
        ("/", "*/*", "application/json"),
        ("/", "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8", "text/html"),
        ("/", "text/html;q=0.5, application/json", "application/json"),
        ("/collections/segments/items", "application/geo+json, application/json", GEOJSON),
        ("/collections/segments/items", "application/json", "application/json"),
        ("/collections/segments/items", "text/*", "text/html"),
        ("/collections/segments/schema", "application/*", SCHEMA),
        ("/collections/segments/schema", "application/xml", "application/xml"),
        ("/openapi.json", "*/*", "application/json"),
        ("/openapi.json", f"{OPENAPI};version=3.0, application/json", f"{OPENAPI};version=3.0"),
        ("/openapi.json", f"{OPENAPI};version=3.0;q=0.5, application/json", "application/json"),
        ("/openapi.json", f"{OPENAPI};version=3.1", f"{OPENAPI};version=3.1"),
        ("/openapi.json", OPENAPI, f"{OPENAPI};version=3.1"),
        ("/openapi.json", "text/html,application/xhtml+xml,*/*;q=0.8", "text/html"),
        ("/openapi.json", "application/json, text/html", "application/json"),
    ],
)
def test_the_accept_header_chooses(reading: Any, path: str, accept: str, media_type: str) -> None:
    answer = reading.client.get(path, headers={"Accept": accept})
    assert answer.status_code == 200
    assert answer.headers["content-type"].removesuffix("; charset=utf-8") == media_type
    assert "Accept" in answer.headers["vary"].split(", ")


@pytest.mark.parametrize("path", [path for path in EVERY if "?" not in path])
def test_a_form_that_there_is_not(reading: Any, path: str) -> None:
    answer = reading.client.get(path, headers={"Accept": "image/png"})
    assert answer.status_code == 406
    assert "There are: " in answer.json()["detail"]
    for wrong in ("png", "", "JSON"):
        answer = reading.client.get(path, params={"f": wrong}, headers={"Accept": "*/*"})
        assert answer.status_code == 400
        assert answer.json()["errors"][0]["field"] == "f"


@pytest.mark.parametrize("path", EVERY)
def test_everything_is_conditional_and_takes_head(reading: Any, path: str) -> None:
    first = reading.client.get(path)
    assert first.status_code == 200
    assert "no-cache" in first.headers["cache-control"]
    again = reading.client.get(path, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["etag"] == first.headers["etag"]
    assert reading.client.get(path, headers={"If-None-Match": 'W/"other"'}).status_code == 200
    head = reading.client.head(path)
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["etag"] == first.headers["etag"]


def test_forms_of_one_address_have_tags_of_their_own(reading: Any) -> None:
    items = "/collections/segments/items"
    tags = [
        reading.client.get(items, headers={"Accept": accept}).headers["etag"]
        for accept in ("*/*", "text/html")
    ]
    assert len(set(tags)) == 2


def test_the_tag_tells_that_an_item_has_changed(filled: Any, drive_maker: Any) -> None:
    addresses = ["/collections/segments/items", "/collections/segments/items/1", "/collections/segments"]
    before = [filled.client.get(address).headers["etag"] for address in addresses]
    drive_maker(filled.sessions, [0])
    for address, tag in zip(addresses, before, strict=True):
        assert filled.client.get(address, headers={"If-None-Match": tag}).status_code == 200, address


def test_links_in_the_header_are_those_of_the_document(reading: Any) -> None:
    answer = reading.client.get("/collections/segments/items", params={"limit": 3})
    links = answer.json()["links"]
    assert answer.links["next"]["url"] == next(link["href"] for link in links if link["rel"] == "next")
    # A header has an end, whatever is asked for.
    long = reading.client.get(
        "/collections/segments/items", params={"filter": "drives >= 0" + " " * 5000, "limit": 3}
    )
    assert len(long.headers["link"]) <= MOST_IN_HEADER
    following = next(link["href"] for link in long.json()["links"] if link["rel"] == "next")
    assert reading.client.get(following).json()["numberReturned"] == 3


def test_links_repeat_the_form_that_was_asked_for(reading: Any) -> None:
    answer = reading.client.get("/collections/segments/items", params={"limit": 3, "f": "html"})
    assert "f=html" in answer.links["next"]["url"]
    assert reading.client.get(answer.links["next"]["url"]).headers["content-type"].startswith("text/html")
    assert "First page" in reading.client.get(answer.links["next"]["url"]).text


@pytest.mark.parametrize("query", [{"highway": "<script>alert(1)</script>"}, {"filter": "name <> '\"><b>'"}])
def test_what_is_asked_for_stands_in_a_page_as_text(reading: Any, query: dict[str, str]) -> None:
    answer = reading.client.get("/collections/segments/items", params={**query, "f": "html", "limit": 2})
    assert answer.status_code == 200
    assert "<script" not in answer.text
    assert "<b>" not in answer.text


def test_names_of_roads_stand_in_a_page_as_text() -> None:
    hostile = "<script>alert(1)</script>"
    text = page(
        "conformance.html",
        title=hostile,
        crumbs=[(hostile, "/")],
        links=[],
        document={"conformsTo": [hostile]},
    )
    assert hostile not in text
    assert "&lt;script&gt;" in text


@pytest.mark.parametrize("rest", ["", "/items", "/items/3", "/schema", "/queryables", "/tiles/7"])
def test_an_unknown_collection_is_a_404_that_says_which_there_are(reading: Any, rest: str) -> None:
    answer = reading.client.get(f"/collections/rivers{rest}")
    assert answer.status_code == 404
    assert answer.json()["detail"] == "There is no collection 'rivers'. There are: segments, ways."


def test_each_declared_class_has_its_abstract_tests() -> None:
    """Tests are named after them: ``test_ats_`` and the class; those of CQL2 stand in one table."""
    here = Path(__file__).parent
    files = [*here.glob("test_ats_*.py"), here.parent / "tiles" / "test_ats_tiles.py"]
    trees = [ast.parse(path.read_text()) for path in files]
    functions = {node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    cases = {node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    for one in CONFORMANCE:
        name = one.rsplit("/", 1)[-1]
        kind = "tiles_" if "ogcapi-tiles" in one else ""
        prefix = f"test_ats_{kind}{name.replace('-', '_')}_"
        tested = (
            name in cases if "/cql2/" in one else any(function.startswith(prefix) for function in functions)
        )
        assert tested, one
