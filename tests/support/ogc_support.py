"""What tests of OGC API Features share: documents as clients find them."""

from __future__ import annotations

from typing import Any

CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
GEOJSON = "application/geo+json"
OPENAPI_30 = "application/vnd.oai.openapi+json;version=3.0"
COLLECTIONS = ("segments", "ways")
DOCUMENTS = ("/", "/conformance", "/collections", *(f"/collections/{name}" for name in COLLECTIONS))
ITEMS = tuple(f"/collections/{name}/items" for name in COLLECTIONS)


def got(reading: Any, path: str, media_type: str = "application/json", **params: Any) -> dict[str, Any]:
    """The document, which is there and of this type."""
    answer = reading.client.get(path, params=params or None, headers={"Accept": media_type})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == media_type
    document: dict[str, Any] = answer.json()
    return document


def by_rel(document: dict[str, Any], rel: str) -> list[dict[str, Any]]:
    return [link for link in document["links"] if link["rel"] == rel]


def definition(reading: Any) -> dict[str, Any]:
    """The API's definition, found by its link."""
    (link,) = [one for one in by_rel(got(reading, "/"), "service-desc") if one["type"] == OPENAPI_30]
    return got(reading, link["href"], OPENAPI_30)


def parameters(api: dict[str, Any], path: str) -> dict[str, dict[str, Any]]:
    """The parameters of a GET, references resolved, by name."""
    found = [
        api["components"]["parameters"][one["$ref"].rsplit("/", 1)[-1]] if "$ref" in one else one
        for one in api["paths"][path]["get"]["parameters"]
    ]
    return {one["name"]: one for one in found}
