"""OGC API Features, part 1: the abstract tests of core under their names (OGC 17-069r4).

The standard's texts are not repeated here; each test does what the abstract test of its name describes, of each
collection that the service lists.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

from ogc_support import COLLECTIONS, CRS84, DOCUMENTS, GEOJSON, ITEMS, by_rel, definition, got, parameters


@pytest.fixture(scope="module")
def api(reading: Any) -> dict[str, Any]:
    return definition(reading)


def test_ats_core_http(reading: Any) -> None:
    answer = reading.client.get("/")
    assert answer.http_version == "HTTP/1.1"
    assert reading.client.get("/collections/segments/nothing").status_code == 404
    assert reading.client.post("/collections").status_code == 405


def test_ats_core_root_op_and_root_success(reading: Any) -> None:
    landing = got(reading, "/")
    assert {link["rel"] for link in landing["links"]} >= {
        "self", "alternate", "service-desc", "service-doc", "conformance", "data",
    }  # fmt: skip
    assert all(link["type"] for link in landing["links"])


def test_ats_core_api_definition_op_and_api_definition_success(reading: Any) -> None:
    landing = got(reading, "/")
    for link in by_rel(landing, "service-desc"):
        answer = reading.client.get(link["href"], headers={"Accept": link["type"]})
        assert answer.status_code == 200
        assert answer.headers["content-type"] == link["type"]
        assert answer.json()["openapi"].startswith(link["type"].rsplit("=", 1)[-1])
    (page,) = by_rel(landing, "service-doc")
    assert "/collections/segments/items" in reading.client.get(page["href"]).text


def test_ats_core_conformance_op_and_conformance_success(reading: Any) -> None:
    classes = got(reading, "/conformance")["conformsTo"]
    assert "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core" in classes


@pytest.mark.parametrize("path", [*DOCUMENTS, *ITEMS, "/openapi.json", "/docs", "/collections/ways/schema"])
def test_ats_core_query_param_unknown(reading: Any, path: str) -> None:
    answer = reading.client.get(path, params={"unknownQueryParameter": "1"})
    assert answer.status_code == 400
    assert "There are: " in answer.json()["detail"]


@pytest.mark.parametrize("path", ITEMS)
@pytest.mark.parametrize(
    "query",
    [
        "limit=a",
        "limit=0",
        "bbox=1",
        "bbox=a,b,c,d",
        "datetime=a",
        "crs=a",
        "sortby=a",
        "after=a",
        "drives=a",
    ],
)
def test_ats_core_query_param_invalid(reading: Any, path: str, query: str) -> None:
    answer = reading.client.get(f"{path}?{query}")
    assert answer.status_code == 400
    assert [error["field"] for error in answer.json()["errors"]] == [query.partition("=")[0]]


def test_ats_core_fc_md_op_and_fc_md_success(reading: Any) -> None:
    assert [one["id"] for one in got(reading, "/collections")["collections"]] == list(COLLECTIONS)


def test_ats_core_fc_md_links(reading: Any) -> None:
    document = got(reading, "/collections")
    for rel in ("self", "alternate"):
        assert by_rel(document, rel)
        for link in by_rel(document, rel):
            answer = reading.client.get(link["href"], headers={"Accept": link["type"]})
            assert answer.headers["content-type"].startswith(link["type"])


def test_ats_core_fc_md_items_and_fc_md_items_links(reading: Any) -> None:
    for collection in got(reading, "/collections")["collections"]:
        assert {"id", "links", "title", "description", "extent", "crs", "itemType"} <= set(collection)
        links = by_rel(collection, "items")
        assert {link["type"] for link in links} == {GEOJSON, "text/html"}
        for link in links:
            answer = reading.client.get(link["href"])
            assert answer.status_code == 200
            assert answer.headers["content-type"].startswith(link["type"])


def test_ats_core_fc_md_extent_and_fc_md_extent_multi(reading: Any) -> None:
    for collection in got(reading, "/collections")["collections"]:
        extent = collection["extent"]
        ((west, south, east, north),) = extent["spatial"]["bbox"]
        assert (-180 <= west <= 180, -90 <= south <= north <= 90, -180 <= east <= 180) == (True, True, True)
        assert extent["spatial"]["crs"] == CRS84
        ((first, last),) = extent["temporal"]["interval"]
        assert first is None
        page = got(reading, f"/collections/{collection['id']}/items", GEOJSON, driven="true")
        assert all(feature["properties"]["updated_at"] <= last for feature in page["features"])


@pytest.mark.parametrize("name", COLLECTIONS)
def test_ats_core_sfc_md_op_and_sfc_md_success(reading: Any, name: str) -> None:
    alone = got(reading, f"/collections/{name}")
    (listed,) = [one for one in got(reading, "/collections")["collections"] if one["id"] == name]
    same = ("id", "title", "description", "extent", "crs", "storageCrs", "itemType", "attribution")
    assert {key: alone[key] for key in same} == {key: listed[key] for key in same}
    wanted = {(link["rel"], link["href"]) for link in listed["links"]}
    assert wanted <= {(link["rel"], link["href"]) for link in alone["links"]}


@pytest.mark.parametrize("path", ITEMS)
def test_ats_core_fc_op_and_fc_response(reading: Any, path: str) -> None:
    page = got(reading, path, GEOJSON)
    assert page["type"] == "FeatureCollection"
    assert all(feature["type"] == "Feature" for feature in page["features"])


@pytest.mark.parametrize("path", ITEMS)
def test_ats_core_fc_bbox_definition(api: Any, path: str) -> None:
    bbox = parameters(api, path)["bbox"]
    assert (bbox["in"], bbox["required"], bbox["style"], bbox["explode"]) == ("query", False, "form", False)
    assert bbox["schema"]["type"] == "array"
    assert (bbox["schema"]["minItems"], bbox["schema"]["maxItems"]) == (4, 6)
    assert bbox["schema"]["items"]["type"] == "number"


def test_ats_core_fc_bbox_response(reading: Any) -> None:
    page = got(reading, ITEMS[0], GEOJSON, bbox="8.3999,48.9999,8.4001,49.0021")
    assert page["features"]
    for feature in page["features"]:
        assert any(
            8.3999 <= lon <= 8.4001 and 48.9999 <= lat <= 49.0021
            for lon, lat in feature["geometry"]["coordinates"]
        )
    assert got(reading, ITEMS[0], GEOJSON, bbox="8.4005,49.0005,8.4006,49.0006")["features"] == []


@pytest.mark.parametrize("path", ITEMS)
def test_ats_core_fc_limit_definition(api: Any, reading: Any, path: str) -> None:
    limit = parameters(api, path)["limit"]
    assert (limit["in"], limit["required"]) == ("query", False)
    settings = reading.settings
    assert limit["schema"] == {
        "type": "integer",
        "minimum": 1,
        "maximum": settings.items_limit_max,
        "default": settings.items_limit_default,
    }


def test_ats_core_fc_limit_response(reading: Any) -> None:
    assert len(got(reading, ITEMS[0], GEOJSON, limit=3)["features"]) == 3
    assert len(got(reading, ITEMS[0], GEOJSON)["features"]) == reading.settings.items_limit_default
    assert len(got(reading, ITEMS[0], GEOJSON, limit=10**12)["features"]) == reading.settings.items_limit_max


@pytest.mark.parametrize("path", ITEMS)
def test_ats_core_fc_time_definition(api: Any, path: str) -> None:
    time = parameters(api, path)["datetime"]
    assert (time["in"], time["required"], time["schema"]) == ("query", False, {"type": "string"})


@pytest.mark.parametrize("driven", [True, False])
def test_ats_core_fc_time_response(reading: Any, driven: bool) -> None:
    """Of what was driven, what changed then; and all that has no time."""

    def ids(**params: str) -> list[int]:
        page = got(reading, ITEMS[0], GEOJSON, driven=str(driven).lower(), **params)
        return [feature["id"] for feature in page["features"]]

    everything = ids()
    times = {
        feature["id"]: feature["properties"]["updated_at"]
        for feature in got(reading, ITEMS[0], GEOJSON, driven=str(driven).lower())["features"]
    }
    assert len(everything) == (6 if driven else 20)
    assert all((time is not None) == driven for time in times.values())
    assert ids(datetime="../2020-01-01T00:00:00Z") == ([] if driven else everything)
    assert ids(datetime="2020-01-01T00:00:00Z/") == everything
    if driven:
        middle = sorted(times.values())[3]
        assert ids(datetime=f"{middle}/..") == [one for one in everything if times[one] >= middle]
        assert ids(datetime=f"/{middle}") == [one for one in everything if times[one] <= middle]
        assert ids(datetime=middle) == [one for one in everything if times[one] == middle]


def test_ats_core_fc_links_lead_to_every_item(reading: Any) -> None:
    page = got(reading, ITEMS[0], GEOJSON, limit=50)
    for rel, types in (("self", [GEOJSON]), ("alternate", ["text/html", "text/csv"]), ("next", [GEOJSON])):
        assert [link["type"] for link in by_rel(page, rel)] == types, rel
    seen: list[int] = []
    for _ in range(5):
        seen += [feature["id"] for feature in page["features"]]
        following = by_rel(page, "next")
        if not following:
            break
        page = got(reading, following[0]["href"], GEOJSON)
    assert len(seen) == len(set(seen)) == 115


@pytest.mark.parametrize("path", ITEMS)
def test_ats_core_fc_timestamp(reading: Any, path: str) -> None:
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", got(reading, path, GEOJSON)["timeStamp"])


def test_ats_core_fc_numbermatched(reading: Any) -> None:
    assert got(reading, ITEMS[0], GEOJSON)["numberMatched"] == 115
    assert got(reading, ITEMS[0], GEOJSON, driven="true", limit=2)["numberMatched"] == 6


@pytest.mark.parametrize("path", ITEMS)
def test_ats_core_fc_numberreturned(reading: Any, path: str) -> None:
    page = got(reading, path, GEOJSON, limit=7)
    assert page["numberReturned"] == len(page["features"])


def test_ats_core_f_op_f_success_and_f_links(reading: Any) -> None:
    feature = got(reading, ITEMS[0], GEOJSON)["features"][3]
    alone = got(reading, f"{ITEMS[0]}/{feature['id']}", GEOJSON)
    assert {name: alone[name] for name in feature} == feature
    for rel, media_type in (
        ("self", GEOJSON),
        ("alternate", "text/html"),
        ("collection", "application/json"),
    ):
        (link,) = by_rel(alone, rel)
        assert link["type"] == media_type
        assert reading.client.get(link["href"]).status_code == 200
    for nobody in ("999999999", "0", "x"):
        assert reading.client.get(f"{ITEMS[0]}/{nobody}").status_code == 404


def test_ats_core_crs84(reading: Any) -> None:
    page = got(reading, ITEMS[0], GEOJSON)
    assert "crs" not in page
    for feature in page["features"]:
        assert all(8 < lon < 9 and 48 < lat < 50 for lon, lat in feature["geometry"]["coordinates"])
