"""Items as CSV say what the features do, page by page."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from typing import Any

import pytest
import shapely

from app.map.items.collections import COLLECTIONS
from app.map.items.request import parse_items
from app.map.items.store import page
from app.map.items.writing import columns_of
from items_support import Items, N

ITEMS = "/collections/segments/items"


def cells(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline=""), strict=True))


def as_told(feature: dict[str, Any]) -> dict[str, Any]:
    return feature["properties"] | {"wkt": [tuple(place) for place in feature["geometry"]["coordinates"]]}


def read(row: dict[str, str], like: dict[str, Any]) -> dict[str, Any]:
    """The values of a row, of the types that the same feature has as GeoJSON."""
    found: dict[str, Any] = {}
    for name, text in row.items():
        value = like[name]
        if name == "wkt":
            found[name] = list(shapely.from_wkt(text).coords)
        elif value is None or isinstance(value, str):
            found[name] = text or ("" if value == "" else None)
        elif isinstance(value, bool):
            found[name] = {"true": True, "false": False}[text]
        else:
            found[name] = float(text)
    return found


@pytest.mark.parametrize("collection", COLLECTIONS)
@pytest.mark.parametrize("gaps", ["", "true"])
def test_every_row_says_what_the_feature_does(items: Items, collection: str, gaps: str) -> None:
    pairs = [("limit", "1000"), *([("gaps", gaps)] if gaps and collection == "segments" else [])]
    features = [as_told(json.loads(text)) for text in items.asked(pairs, collection).features]
    request = parse_items(COLLECTIONS[collection], pairs, items.settings)
    with items.sessions() as session:
        rows = page(session, replace(request, shape=replace(request.shape, table=True))).features
    header = ",".join(columns_of(request.shape.properties))
    table = cells("\r\n".join([header, *rows, ""]))
    assert len(table) == len(features) >= N / 10
    assert [read(row, like) for row, like in zip(table, features, strict=True)] == features


def test_the_next_link_of_the_header_leads_through_all(reading: Any) -> None:
    params = {"sortby": "-steepness_percent", "properties": "name,steepness_percent", "limit": "25"}
    first = answer = reading.client.get(ITEMS, params={**params, "f": "csv"})
    found = cells(answer.text)
    while "next" in answer.links:
        answer = reading.client.get(answer.links["next"]["url"], headers={"Accept": "text/csv"})
        found += cells(answer.text)
    assert list(found[0]) == ["id", "name", "steepness_percent", "wkt"]
    document, features = reading.client.get(ITEMS, params=params).json(), []
    features += document["features"]
    while following := [one["href"] for one in document["links"] if one["rel"] == "next"]:
        document = reading.client.get(following[0]).json()
        features += document["features"]
    assert [int(row["id"]) for row in found] == [feature["id"] for feature in features]
    assert (
        len(found) == int(first.headers["ogc-numbermatched"]) > int(first.headers["ogc-numberreturned"]) == 25
    )
    assert first.headers["content-type"] == "text/csv; charset=utf-8"
    assert first.links["license"]["url"].startswith("https://opendatacommons.org")
    again = {"If-None-Match": first.headers["etag"]}
    assert reading.client.get(ITEMS, params={**params, "f": "csv"}, headers=again).status_code == 304


def test_without_a_line_and_with_other_places(reading: Any) -> None:
    one = {"limit": "1", "f": "csv", "properties": "highway"}
    answer = reading.client.get(ITEMS, params={**one, "skipGeometry": "true"})
    assert list(cells(answer.text)[0]) == ["id", "highway"]
    metres = {"crs": "http://www.opengis.net/def/crs/EPSG/0/3857"}
    answer = reading.client.get(ITEMS, params={**one, **metres})
    assert answer.headers["content-crs"] == f"<{metres['crs']}>"
    assert shapely.from_wkt(cells(answer.text)[0]["wkt"]).coords[0][0] > 1e5


def test_a_page_that_could_not_name_the_next_is_refused(reading: Any) -> None:
    """Else who follows links would take the first page for everything."""
    params = {"limit": "1", "filter": "highway IN (" + ", ".join(["'residential'"] * 200) + ")"}
    answer = reading.client.get(ITEMS, params={**params, "f": "csv"})
    assert "next" in answer.links, answer.text
    params["filter"] = "highway IN (" + ", ".join(["'residential'"] * 500) + ")"
    assert reading.client.get(ITEMS, params=params).status_code == 200
    answer = reading.client.get(ITEMS, params={**params, "f": "csv"})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["field"] == "f"
