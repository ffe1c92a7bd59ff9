"""OGC API Features, part 1: the abstract tests of geojson, html and oas30 under their names (OGC 17-069r4)."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import pytest
from openapi_spec_validator import OpenAPIV30SpecValidator, OpenAPIV31SpecValidator

from ogc_support import COLLECTIONS, DOCUMENTS, GEOJSON, ITEMS, definition, got


@pytest.fixture(scope="module")
def api(reading: Any) -> dict[str, Any]:
    return definition(reading)


@pytest.mark.parametrize("path", ["/collections/{name}/items", "/collections/{name}/items/{{item_id}}"])
@pytest.mark.parametrize("name", COLLECTIONS)
def test_ats_geojson_definition(api: Any, path: str, name: str) -> None:
    assert GEOJSON in api["paths"][path.format(name=name)]["get"]["responses"]["200"]["content"]


def test_ats_geojson_content(reading: Any) -> None:
    page = got(reading, ITEMS[0], GEOJSON)
    assert {"type", "features", "links", "timeStamp", "numberReturned"} <= set(page)
    for feature in page["features"]:
        assert set(feature) == {"type", "id", "geometry", "properties"}
        assert feature["geometry"]["type"] == "LineString"


class Page(HTMLParser):
    """Where the links of a page lead, whether all that is opened is closed, and what it says."""

    VOID = frozenset({"meta", "link", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag not in {"script", "img", "iframe"}
        if tag not in self.VOID:
            self.open.append(tag)
        self.links += [str(value) for name, value in attrs if name == "href"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize(
    "path", [*DOCUMENTS, *ITEMS, f"{ITEMS[0]}/3", "/openapi.json?f=html", "/collections/segments/schema"]
)
def test_ats_html_content(reading: Any, path: str) -> None:
    answer = reading.client.get(path, headers={"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"})
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "unsafe" not in answer.headers["content-security-policy"]
    page = Page(answer.text)
    ours = {address for address in page.links if address.startswith(reading.base)}
    assert ours
    for address in sorted(ours)[:20]:
        assert reading.client.get(address).status_code == 200, address
    document = reading.client.get(path, headers={"Accept": "*/*"})
    if document.headers["content-type"] == "application/json":
        told = [
            link["href"]
            for link in document.json().get("links", [])
            if link["rel"] not in {"self", "alternate"}
        ]
        if path in {"/", *(f"/collections/{name}" for name in COLLECTIONS)}:
            assert set(told) <= set(page.links)


@pytest.mark.parametrize("path", [*DOCUMENTS, *ITEMS])
def test_ats_html_definition(reading: Any, path: str) -> None:
    assert reading.client.get(path, params={"f": "html"}).headers["content-type"].startswith("text/html")


def test_ats_oas30_definition_1_and_definition_2(reading: Any, api: Any) -> None:
    assert api["openapi"] == "3.0.3"
    OpenAPIV30SpecValidator(api).validate()
    OpenAPIV31SpecValidator(reading.client.get("/openapi.json").json()).validate()


def test_ats_oas30_impl_completeness_and_exception_codes(reading: Any, api: Any) -> None:
    """What is answered, is in the document: routes, status codes and media types."""
    for path in (*DOCUMENTS, *ITEMS):
        answers = api["paths"][path]["get"]["responses"]
        for params, accept in (({}, "*/*"), ({"nope": "1"}, "*/*"), ({}, "text/html"), ({}, "image/png")):
            answer = reading.client.get(path, params=params, headers={"Accept": accept})
            assert str(answer.status_code) in answers, (path, answer.status_code)
            media_type = answer.headers["content-type"].partition(";")[0]
            assert media_type in answers[str(answer.status_code)]["content"], (path, media_type)
        assert reading.client.get(path, headers={"If-None-Match": "*"}).status_code == 304
        assert "304" in answers


def test_ats_oas30_security(api: Any) -> None:
    """Each requirement is of schemes that the document has; whatever is of the standard may be had without a key."""
    declared = set(api["components"]["securitySchemes"])
    for path, item in api["paths"].items():
        for operation in item.values():
            wanted = operation.get("security", [{}])
            assert {scheme for requirement in wanted for scheme in requirement} <= declared, path
            if path.startswith(("/collections", "/conformance")) or path == "/":
                assert {} in wanted, path
