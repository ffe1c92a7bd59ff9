"""Parts 2 and 3 of OGC API Features, and CQL2: their abstract tests under their names.

That filters answer what SQL answers is tried with the engine (``tests/app/map/items``); here is what each class asks of
the service: that each of its operators is there, in text and in JSON, and means what it says.
"""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

ITEMS = "/collections/segments/items"
CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
EPSG = "http://www.opengis.net/def/crs/EPSG/0/"
QUERYABLES = "http://www.opengis.net/def/rel/ogc/1.0/queryables"


def page(reading: Any, **params: Any) -> Any:
    return reading.client.get(ITEMS, params={"limit": 50, **params} if params else None)


def ids(reading: Any, **params: Any) -> list[int]:
    answer = page(reading, **params)
    assert answer.status_code == 200, answer.text
    return [feature["id"] for feature in answer.json()["features"]]


@pytest.fixture(scope="module")
def grid(reading: Any) -> list[dict[str, Any]]:
    """The first items, and those that were driven."""
    found = page(reading, limit=50).json()["features"] + page(reading, driven=True).json()["features"]
    return list({feature["id"]: feature for feature in found}.values())


def test_ats_crs_uri_default_and_storage(reading: Any) -> None:
    for collection in reading.client.get("/collections").json()["collections"]:
        assert collection["crs"][0] == CRS84
        assert collection["storageCrs"] in collection["crs"]
        assert all(uri.startswith("http://www.opengis.net/def/crs/") for uri in collection["crs"])
    for address in (ITEMS, f"{ITEMS}/3"):
        assert reading.client.get(address).headers["content-crs"] == f"<{CRS84}>"


@pytest.mark.parametrize("address", [ITEMS, f"{ITEMS}/3"])
def test_ats_crs_parameter_and_transform(reading: Any, address: str) -> None:
    def line(crs: str) -> list[list[float]]:
        answer = reading.client.get(address, params={"crs": crs})
        assert answer.headers["content-crs"] == f"<{crs}>"
        document = answer.json()
        found: list[list[float]] = document.get("features", [document])[0]["geometry"]["coordinates"]
        return found

    plain = line(CRS84)
    assert line(EPSG + "4326") == [[lat, lon] for lon, lat in plain]
    for (x, y), (lon, lat) in zip(line(EPSG + "3857"), plain, strict=True):
        assert x == pytest.approx(6378137 * math.radians(lon), abs=0.002)
        assert y == pytest.approx(6378137 * math.asinh(math.tan(math.radians(lat))), abs=0.002)


def test_ats_crs_bbox_crs_parameter_and_default(reading: Any) -> None:
    expected = ids(reading, bbox="8.3999,48.9999,8.4001,49.0021")
    assert expected
    assert ids(reading, bbox="48.9999,8.3999,49.0021,8.4001", **{"bbox-crs": EPSG + "4326"}) == expected
    x0, y0, x1, y1 = (
        6378137 * value
        for lon, lat in ((8.3999, 48.9999), (8.4001, 49.0021))
        for value in (math.radians(lon), math.asinh(math.tan(math.radians(lat))))
    )
    assert ids(reading, bbox=f"{x0},{y0},{x1},{y1}", **{"bbox-crs": EPSG + "3857"}) == expected


@pytest.mark.parametrize("name", ["crs", "bbox-crs", "filter-crs"])
def test_ats_crs_parameter_invalid(reading: Any, name: str) -> None:
    other = {"bbox-crs": {"bbox": "1,2,3,4"}, "filter-crs": {"filter": "drives > 0"}}.get(name, {})
    for nothing in (EPSG + "25832", "EPSG:4326", ""):
        answer = page(reading, **{name: nothing}, **other)
        assert answer.status_code == 400
        assert EPSG + "3857" in answer.json()["detail"]


@pytest.mark.parametrize("name", ["segments", "ways"])
def test_ats_queryables_get_queryables_and_link(reading: Any, name: str) -> None:
    here = f"{reading.base}/collections/{name}"
    links = reading.client.get(here).json()["links"]
    assert [link["href"] for link in links if link["rel"] == QUERYABLES] == [f"{here}/queryables"]
    answer = reading.client.get(f"{here}/queryables", headers={"Accept": "application/schema+json"})
    assert answer.headers["content-type"] == "application/schema+json"
    document = answer.json()
    assert document["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert document["$id"] == f"{here}/queryables"
    assert document["type"] == "object"
    assert document["properties"]["geometry"]["format"] == "geometry-linestring"
    assert all("type" in one for key, one in document["properties"].items() if key != "geometry")


def test_ats_queryables_expression_construction(reading: Any) -> None:
    """Whatever is named a queryable may be named in a filter, and nothing else."""
    for name in ("segments", "ways"):
        here = f"/collections/{name}"
        for one in reading.client.get(f"{here}/queryables").json()["properties"]:
            text = f"{one} IS NOT NULL" if one != "geometry" else "S_INTERSECTS(geometry, POINT(8 49))"
            assert reading.client.get(f"{here}/items", params={"filter": text}).status_code == 200, one
        answer = reading.client.get(f"{here}/items", params={"filter": "this_is_not_a_queryable IS NULL"})
        assert answer.status_code == 400
        assert "slope_percent" in answer.json()["detail"]


def test_ats_queryables_query_parameters_parameters(reading: Any, grid: list[dict[str, Any]]) -> None:
    document = reading.client.get("/collections/segments/queryables").json()["properties"]
    described = {
        one["name"]: one["schema"]
        for one in reading.client.get("/openapi.json").json()["paths"][ITEMS]["get"]["parameters"]
    }
    feature = next(feature for feature in grid if feature["properties"]["drives"] == 2)
    for name, queryable in document.items():
        if name == "geometry":
            continue
        assert {key: queryable[key] for key in described[name]} == described[name]
        value = feature["properties"][name]
        if value is not None:
            text = str(value).lower() if isinstance(value, bool) else value
            answer = page(reading, **{name: text})
            found = answer.json()["features"]
            assert all(one["properties"][name] == value for one in found)
            assert found, name


def test_ats_filter_param_and_lang_default(reading: Any) -> None:
    tree = {"op": "is null", "args": [{"property": "name"}]}
    expected = ids(reading, filter="name IS NULL")
    assert expected
    assert ids(reading, filter="name IS NULL", **{"filter-lang": "cql2-text"}) == expected
    # One operator is spelt isNull in JSON.
    tree["op"] = "isNull"
    assert ids(reading, filter=json.dumps(tree), **{"filter-lang": "cql2-json"}) == expected
    for wrong, language in (("THIS IS NOT A FILTER", "cql2-text"), ("{", "cql2-json"), ("drives > 0", "cql")):
        assert page(reading, filter=wrong, **{"filter-lang": language}).status_code == 400


def test_ats_filter_crs_wgs84_and_param(reading: Any) -> None:
    box = "S_INTERSECTS(geometry, BBOX({}))"
    everything = ids(reading, limit=50)
    assert ids(reading, filter=box.format("-180,-17,180,49.014")) == everything
    assert page(reading, filter=box.format("1000000,1000000,2000000,2000000")).status_code == 400
    some = ids(reading, bbox="8.3999,48.9999,8.4001,49.0021")
    flipped = box.format("48.9999,8.3999,49.0021,8.4001")
    assert ids(reading, filter=flipped, **{"filter-crs": EPSG + "4326"}) == some


def test_ats_features_filter_mixing_expressions(reading: Any) -> None:
    """All parameters hold at once."""
    box = ids(reading, bbox="8.39,48.99,8.401,49.1")
    roads = ids(reading, filter="highway = 'residential'")
    both = ids(reading, bbox="8.39,48.99,8.401,49.1", filter="highway = 'residential'")
    assert both
    assert both == [one for one in box if one in set(roads)]
    assert ids(reading, bbox="8.39,48.99,8.401,49.1", highway="residential") == both


ALONG = "S_INTERSECTS(geometry, LINESTRING(8.4 49, 8.4 49.001))"
POINT = {"type": "Point", "coordinates": [8.4, 49.001]}
AREA = "POLYGON((8.39 48.99, 8.401 48.99, 8.401 49.0015, 8.39 49.0015, 8.39 48.99))"
OVER = {"op": ">", "args": [{"property": "drives"}, 0]}
IS_BRIDGE = {"op": "=", "args": [{"property": "bridge"}, True]}
LONG_AGO, NOW = "TIMESTAMP('2020-01-01T00:00:00Z')", "TIMESTAMP('2100-01-01T00:00:00Z')"
AGES = "INTERVAL('2020-01-01T00:00:00Z', '2100-01-01T00:00:00Z')"
CASES: dict[str, list[tuple[str, Any]]] = {
    "cql2-text": [
        (
            "(drives > 0 OR oneway < 0) AND NOT (bridge = TRUE)",
            lambda p: (p["drives"] > 0 or p["oneway"] < 0) and not p["bridge"],
        )
    ],
    "cql2-json": [
        (json.dumps({"op": "and", "args": [OVER, IS_BRIDGE]}), lambda p: p["drives"] > 0 and p["bridge"])
    ],
    "basic-cql2": [
        ("highway = 'primary'", lambda p: p["highway"] == "primary"),
        ("highway <> 'primary'", lambda p: p["highway"] != "primary"),
        (
            "slope_percent >= 1.0 AND slope_percent <= 3",
            lambda p: p["slope_percent"] is not None and 1 <= p["slope_percent"] <= 3,
        ),
        ("slope_percent < 0", lambda p: (p["slope_percent"] or 0) < 0),
        ("name IS NOT NULL", lambda p: p["name"] is not None),
        ("bridge = TRUE", lambda p: p["bridge"]),
        (f"updated_at > {LONG_AGO}", lambda p: p["updated_at"] is not None),
    ],
    "advanced-comparison-operators": [
        ("name LIKE 'Straße 1_'", lambda p: (p["name"] or "").startswith("Straße 1") and len(p["name"]) == 9),
        ("highway LIKE '%ra%'", lambda p: "ra" in p["highway"]),
        ("from_node BETWEEN 3 AND 9", lambda p: 3 <= p["from_node"] <= 9),
        ("highway IN ('track', 'service')", lambda p: p["highway"] in {"track", "service"}),
        ("oneway NOT IN (0, 1)", lambda p: p["oneway"] == -1),
    ],
    "case-insensitive-comparison": [
        ("CASEI(highway) = CASEI('PRIMARY')", lambda p: p["highway"] == "primary")
    ],
    "accent-insensitive-comparison": [
        ("ACCENTI(name) = ACCENTI('Stráße 2')", lambda p: p["name"] == "Straße 2")
    ],
    "basic-spatial-functions": [
        ("S_INTERSECTS(geometry, POINT(8.4 49.001))", lambda p: {p["from_node"], p["to_node"]} == {1, 2})
    ],
    "basic-spatial-functions-plus": [
        (f"S_INTERSECTS(geometry, {AREA}) AND {ALONG}", lambda p: 1 in {p["from_node"], p["to_node"]})
    ],
    "spatial-functions": [
        (f"S_DISJOINT(geometry, {AREA})", lambda p: not {1, 9} & {p["from_node"]} or p["from_node"] == 9),
        (
            f"S_WITHIN(geometry, {AREA.replace('49.0015', '49.003')})",
            lambda p: {p["from_node"], p["to_node"]} == {1, 2},
        ),
        (
            "S_EQUALS(geometry, LINESTRING(8.4 49, 8.4 49.002))",
            lambda p: {p["from_node"], p["to_node"]} == {1, 2},
        ),
        ("S_TOUCHES(geometry, POINT(8.4 49))", lambda p: 1 in {p["from_node"], p["to_node"]}),
        ("S_CONTAINS(geometry, POINT(8.4 49.001))", lambda p: {p["from_node"], p["to_node"]} == {1, 2}),
        ("S_CROSSES(geometry, LINESTRING(8.39 49.001, 8.41 49.001))", None),
        ("S_OVERLAPS(geometry, LINESTRING(8.4 49.001, 8.4 49.003))", None),
    ],
    "temporal-functions": [
        (f"T_AFTER(updated_at, {LONG_AGO})", lambda p: p["updated_at"] is not None),
        (f"T_BEFORE(updated_at, {LONG_AGO})", lambda p: False),
        (f"T_DURING(updated_at, {AGES})", lambda p: p["updated_at"] is not None),
        (f"T_DISJOINT(updated_at, {AGES})", lambda p: False),
        (f"T_INTERSECTS(updated_at, {AGES})", lambda p: p["updated_at"] is not None),
        *(
            (f"T_{name}(INTERVAL(updated_at, {NOW}), {AGES})", None)
            for name in (
                "CONTAINS",
                "EQUALS",
                "FINISHEDBY",
                "FINISHES",
                "MEETS",
                "METBY",
                "OVERLAPPEDBY",
                "OVERLAPS",
                "STARTEDBY",
                "STARTS",
            )
        ),
    ],
    "property-property": [
        ("to_node = from_node + 1", lambda p: p["to_node"] == p["from_node"] + 1),
        (
            "dem_slope_percent < slope_percent",
            lambda p: (
                None not in {p["dem_slope_percent"], p["slope_percent"]}
                and p["dem_slope_percent"] < p["slope_percent"]
            ),
        ),
    ],
    "arithmetic": [
        ("from_node * 2 - 1 = to_node + 1", lambda p: p["from_node"] * 2 - 1 == p["to_node"] + 1),
        (
            "from_node % 4 = 0 AND from_node / 4 > 1",
            lambda p: p["from_node"] % 4 == 0 and p["from_node"] / 4 > 1,
        ),
        (
            "from_node div 10 = 1 OR from_node ^ 2 = 9",
            lambda p: p["from_node"] // 10 == 1 or p["from_node"] == 3,
        ),
    ],
}


@pytest.mark.parametrize(
    ("name", "text", "holds"), [(name, *case) for name, cases in CASES.items() for case in cases]
)
def test_ats_cql2(reading: Any, grid: list[dict[str, Any]], name: str, text: str, holds: Any) -> None:
    language = "cql2-json" if text.startswith("{") else "cql2-text"
    answer = page(reading, filter=text, **{"filter-lang": language})
    assert answer.status_code == 200, answer.text
    if holds is not None:
        known = {feature["id"]: feature["properties"] for feature in grid}
        found = {feature["id"] for feature in answer.json()["features"]} & set(known)
        assert found == {one for one, properties in known.items() if holds(properties)}


def test_ats_cql2_spatial_predicates_in_json_take_geojson(reading: Any) -> None:
    tree = {"op": "s_intersects", "args": [{"property": "geometry"}, POINT]}
    assert len(ids(reading, filter=json.dumps(tree), **{"filter-lang": "cql2-json"})) == 1
