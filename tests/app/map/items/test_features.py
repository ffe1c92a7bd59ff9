"""OGC API Features: every item exactly once, boxes, links, conformance."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.map.items.landing import CONFORMANCE
from app.map.segment import PROPERTIES

ITEMS = "/collections/segments/items"


def pages(web: Any, **params: Any) -> list[dict[str, Any]]:
    answer = web.client.get(ITEMS, params=params)
    found = []
    for _ in range(1000):
        assert answer.status_code == 200, answer.text
        found.append(answer.json())
        following = [link["href"] for link in found[-1]["links"] if link["rel"] == "next"]
        if not following:
            return found
        answer = web.client.get(following[0])
    raise AssertionError("the next links never end")


def ids(found: list[dict[str, Any]]) -> list[int]:
    return [feature["id"] for page in found for feature in page["features"]]


class Features(list[dict[str, Any]]):
    """A list that does not print itself whole when a property fails."""

    def __repr__(self) -> str:
        return f"<{len(self)} features>"


@pytest.fixture(scope="session")
def everything(reading: Any) -> list[dict[str, Any]]:
    """All features, read in one way."""
    features = Features(f for page in pages(reading, limit=50) for f in page["features"])
    assert len(features) == 2 * 8 * 7 + 3
    return features


@settings(max_examples=40, deadline=None)
@given(limit=st.integers(1, 60), box=st.none() | st.tuples(*[st.integers(-2, 18)] * 4))
def test_next_links_reach_each_matching_item_exactly_once(
    reading: Any, everything: list[dict[str, Any]], limit: int, box: tuple[int, int, int, int] | None
) -> None:
    params: dict[str, Any] = {"limit": limit}
    expected = everything
    if box is not None:
        west, east = sorted(8.4 + 0.001 * x + 0.0003 for x in box[:2])
        south, north = sorted(49.0 + 0.001 * y + 0.0003 for y in box[2:])
        params["bbox"] = f"{west},{south},{east},{north}"
        expected = [f for f in everything if meets(f, west, south, east, north)]
    found = pages(reading, **params)
    assert ids(found) == [f["id"] for f in expected]
    assert all(page["numberReturned"] == len(page["features"]) <= min(limit, 50) for page in found)
    assert all(page["features"] for page in found[1:]), "an empty last page"


def meets(feature: dict[str, Any], west: float, south: float, east: float, north: float) -> bool:
    """For the grid's axis-parallel segments the box of the line is the line."""
    (lon0, lat0), (lon1, lat1) = feature["geometry"]["coordinates"]
    return (
        min(lon0, lon1) <= east
        and max(lon0, lon1) >= west
        and min(lat0, lat1) <= north
        and max(lat0, lat1) >= south
    )


def test_the_steepest_come_first_whichever_way_they_are_drawn(reading: Any) -> None:
    known = [f for f in ids_and_slopes(reading, driven="true") if f[1] is not None]
    expected = sorted(known, key=lambda f: (-abs(f[1]), -f[0]))
    assert {slope > 0 for _, slope in known} == {True, False}
    assert ids_and_slopes(reading, driven="true", sortby="-steepness_percent", limit=3) == expected
    least = sorted({abs(slope) for _, slope in known})[-1]
    only = ids_and_slopes(
        reading, filter=f"steepness_percent >= {least}", sortby="-steepness_percent", limit=2
    )
    assert only == [f for f in expected if abs(f[1]) >= least]


def ids_and_slopes(web: Any, **params: Any) -> list[tuple[int, Any]]:
    found = [f for page in pages(web, **params) for f in page["features"]]
    assert all(
        f["properties"]["steepness_percent"] == abs(f["properties"]["slope_percent"])
        for f in found
        if f["properties"]["drives"]
    )
    return [(f["id"], f["properties"]["slope_percent"]) for f in found]


def test_a_box_across_the_antimeridian(reading: Any) -> None:
    def ways(box: str) -> set[int]:
        found = pages(reading, bbox=box, limit=1)
        assert len(ids(found)) == len(set(ids(found)))
        return {f["properties"]["from_node"] for page in found for f in page["features"]}

    assert ways("179.992,-18,-179.99,-16") == {1000, 1001, 1002}
    assert ways("179.998,-18,-179.99,-16") == {1001, 1002}
    assert ways("-180,-18,-179.99,-16") == {1002}
    assert ways("-179.98,-18,179.98,-16") == set()


@pytest.mark.parametrize("driven", [True, False])
def test_the_driven_filter(reading: Any, everything: list[dict[str, Any]], driven: bool) -> None:
    expected = [f["id"] for f in everything if (f["properties"]["slope_percent"] is not None) == driven]
    assert ids(pages(reading, driven=driven, limit=7)) == expected
    assert len(expected) == (6 if driven else len(everything) - 6)


def test_properties_are_the_contract_s_in_its_order(everything: list[dict[str, Any]]) -> None:
    for feature in everything:
        properties = feature["properties"]
        assert tuple(properties) == PROPERTIES
        assert feature["id"] == properties["id"]
        if properties["drives"] == 0:
            assert properties["slope_percent"] is properties["slope_sigma_percent"] is None
            assert properties["updated_at"] is None
            assert properties["observations"] == 0
        else:
            assert properties["updated_at"].endswith("Z")
        assert isinstance(properties["oneway"], int)
        assert isinstance(properties["bridge"], bool)
    shared = [f["properties"] for f in everything if f["properties"]["drives"] == 2]
    assert [p["slope_percent"] for p in shared] == [1.0]
    assert shared[0]["slope_sigma_percent"] >= 0.3535, "two estimates of sigma 0.5, 4 percent apart"


def test_geojson_keeps_to_rfc_7946(reading: Any) -> None:
    answer = reading.client.get(ITEMS)
    assert answer.headers["content-type"] == "application/geo+json"
    page = answer.json()
    assert page["type"] == "FeatureCollection"
    assert "crs" not in page
    for feature in page["features"]:
        assert feature["type"] == "Feature"
        assert feature["geometry"]["type"] == "LineString"
        for lon, lat in feature["geometry"]["coordinates"]:
            assert -180 <= lon <= 180
            assert -90 <= lat <= 90
    assert "OpenStreetMap" in page["attribution"]
    assert "ODbL" in page["attribution"]


def test_number_matched_is_told_where_it_is_known(reading: Any, everything: list[dict[str, Any]]) -> None:
    first, *rest = pages(reading, limit=50)
    assert first["numberMatched"] == len(everything)
    assert all("numberMatched" not in page for page in rest)
    (only,) = pages(reading, driven=True)
    assert only["numberMatched"] == only["numberReturned"] == 6


def test_a_limit_above_the_maximum_is_reduced(reading: Any) -> None:
    assert reading.client.get(ITEMS, params={"limit": 10**9}).json()["numberReturned"] == 50


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("bbox=1,2,3", "bbox"),
        ("bbox=1,2,3,x", "bbox"),
        ("bbox=nan,2,3,4", "bbox"),
        ("bbox=8,50,9,49", "bbox"),
        ("bbox=8,49,9,91", "bbox"),
        ("bbox=-181,49,9,50", "bbox"),
        ("bbox=", "bbox"),
        ("bbox=1_0,0,11,1", "bbox"),
        ("bbox=\u0661,0,11,1", "bbox"),
        ("bbox=1e999,0,11,1", "bbox"),
        ("limit=0", "limit"),
        ("limit=-1", "limit"),
        ("limit=ten", "limit"),
        ("driven=perhaps", "driven"),
        ("datetime=yesterday", "datetime"),
        ("datetime=2026-13-45T00:00:00Z", "datetime"),
        ("datetime=2026-02-30", "datetime"),
        ("datetime=2026-01-01/2026-02-30", "datetime"),
        ("datetime=\u0662026-01-01", "datetime"),
        ("after=-1", "after"),
        ("after=99999999999999999999", "after"),
        ("highwya=primary", "highwya"),
        ("f=xml", "f"),
    ],
)
def test_a_query_that_cannot_be_used_is_a_400_that_names_the_field(
    reading: Any, query: str, field: str
) -> None:
    answer = reading.client.get(f"{ITEMS}?{query}")
    assert answer.status_code == 400, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert [error["field"] for error in problem["errors"]] == [field]
    assert problem["type"] == "/problems/bad-query"


@pytest.mark.parametrize(
    "value",
    [
        "2026-11-20",
        "2026-11-20T00:00:00Z",
        "2026-11-20T01:02:03.5z",
        "2026-11-20/..",
        "../2026-11-20",
        "2026-11-20T00:00:00+01:00/2026-11-20T00:00:00.123456789Z",
    ],
)
def test_datetime_matches_features_without_time(
    reading: Any, everything: list[dict[str, Any]], value: str
) -> None:
    page = reading.client.get(ITEMS, params={"datetime": value, "driven": False}).json()
    assert page["numberMatched"] == len(everything) - 6


def test_numbers_in_other_notations(reading: Any) -> None:
    assert ids(pages(reading, bbox="8.4,49,8.403,49.003")) == ids(
        pages(reading, bbox="840e-2, +49.,.8403e+1,49.003")
    )


def test_six_numbers_are_a_box_with_heights(reading: Any) -> None:
    flat = ids(pages(reading, bbox="8.4,49,8.403,49.003"))
    assert flat
    assert ids(pages(reading, bbox="8.4,49,-10,8.403,49.003,900")) == flat


def test_links_of_the_landing_page_lead_somewhere(reading: Any) -> None:
    landing = reading.client.get("/").json()
    links = {link["rel"]: link for link in landing["links"]}
    assert {"self", "service-desc", "conformance", "data"} <= set(links)
    for link in landing["links"]:
        assert reading.client.get(link["href"]).status_code == 200, link
    assert "loopback" in landing["description"]
    collections = reading.client.get(links["data"]["href"]).json()["collections"]
    assert [collection["id"] for collection in collections] == ["segments", "ways"]
    for collection in collections:
        for link in collection["links"]:
            if link["href"].startswith(reading.base):
                assert reading.client.get(link["href"]).status_code == 200, link
        assert {link["rel"] for link in collection["links"]} >= {"self", "items", "license"}


def test_the_extent_holds_all_items(reading: Any, everything: list[dict[str, Any]]) -> None:
    collection, _ = reading.client.get("/collections").json()["collections"]
    west, south, east, north = collection["extent"]["spatial"]["bbox"][0]
    points = list(itertools.chain.from_iterable(f["geometry"]["coordinates"] for f in everything))
    assert west == min(lon for lon, _ in points) == -180
    assert east == max(lon for lon, _ in points) == 180
    assert south == pytest.approx(min(lat for _, lat in points))
    assert north == pytest.approx(max(lat for _, lat in points))


def test_an_item_is_the_same_everywhere(reading: Any, everything: list[dict[str, Any]]) -> None:
    feature = next(f for f in everything if f["properties"]["drives"] == 2)
    for path in (f"{ITEMS}/{feature['id']}", f"/v1/segments/{feature['id']}"):
        alone = reading.client.get(path).json()
        assert {name: alone[name] for name in feature} == feature
    links = {link["rel"] for link in reading.client.get(f"{ITEMS}/{feature['id']}").json()["links"]}
    assert {"self", "collection"} <= links


def test_observations_show_the_drives_behind_a_segment(
    reading: Any, everything: list[dict[str, Any]]
) -> None:
    feature = next(f for f in everything if f["properties"]["drives"] == 2)
    answer = reading.client.get(f"/v1/segments/{feature['id']}/observations").json()
    assert sorted(o["slope_percent"] for o in answer["observations"]) == [-1.0, 3.0]
    for observation in answer["observations"]:
        assert observation["code_version"] == "test"
        assert reading.client.get(f"/v1/drives/{observation['drive_id']}").status_code == 200


def test_unchanged_items_are_answered_by_304(reading: Any) -> None:
    first = reading.client.get(ITEMS)
    again = reading.client.get(ITEMS, headers={"If-None-Match": first.headers["etag"]})
    assert again.status_code == 304
    assert not again.content


def test_the_tag_of_items_tells_pages_of_other_sizes_apart(reading: Any) -> None:
    tags = {reading.client.get(ITEMS, params={"limit": limit}).headers["etag"] for limit in (1, 2)}
    assert len(tags) == 2


def test_only_conformance_classes_that_hold_are_declared(reading: Any) -> None:
    classes = reading.client.get("/conformance").json()["conformsTo"]
    assert tuple(classes) == CONFORMANCE
    assert len(set(classes)) == len(classes)
