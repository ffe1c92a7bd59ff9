"""Each parameter of items: what it keeps, and what is refused in which words."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.core.errors import BadQueryError
from app.map.items.collections import SEGMENTS, WAYS
from app.map.items.places import CRSS, EDGE_M, EPSG3857, interval, moment, parse_datetime, span
from app.map.items.request import item_parameters, parse_item, parse_items
from items_support import Items, ids_of

EPSG_4326, EPSG_3857 = list(CRSS)[1:]


def kept(items: Items, of: Any) -> list[int]:
    return [row["id"] for row in items.stored if of(row)]


@pytest.mark.parametrize(
    ("params", "of"),
    [
        ({"highway": "primary"}, lambda r: r["highway"] == "primary"),
        ({"highway": "primary,track"}, lambda r: r["highway"] in {"primary", "track"}),
        ({"highway": 'motor"way'}, lambda r: r["highway"] == 'motor"way'),
        ({"name": "O'Brien"}, lambda r: r["name"] == "O'Brien"),
        ({"name": ""}, lambda r: r["name"] == ""),
        ({"oneway": "-1,+1"}, lambda r: r["oneway"] in {-1, 1}),
        ({"drives": "0"}, lambda r: r["drives"] == 0),
        ({"bridge": "true"}, lambda r: r["bridge"]),
        ({"bridge": "false", "tunnel": "true"}, lambda r: not r["bridge"] and r["tunnel"]),
        ({"slope_percent": "1.5,-2e0"}, lambda r: r["slope_percent"] in {1.5, -2.0}),
        ({"updated_at": "2026-11-05"}, lambda r: r["updated_at"] and r["updated_at"].date().day == 5),
        ({"driven": "true"}, lambda r: r["drives"] > 0),
        ({"driven": "false"}, lambda r: r["drives"] == 0),
        ({"datetime": "2026-11-05T00:00:00Z/.."}, lambda r: not r["updated_at"] or r["updated_at"].day >= 5),
        ({"datetime": "../2026-11-05"}, lambda r: not r["updated_at"] or r["updated_at"].day <= 5),
        ({"datetime": "/2026-11-05"}, lambda r: not r["updated_at"] or r["updated_at"].day <= 5),
        ({"datetime": "2026-11-03/2026-11-05"}, lambda r: not r["updated_at"] or 3 <= r["updated_at"].day <= 5),
        ({"highway": "primary", "filter": "oneway = 0"}, lambda r: r["highway"] == "primary" and not r["oneway"]),
    ],
)  # fmt: skip
def test_a_parameter_keeps_what_it_says(items: Items, params: dict[str, str], of: Any) -> None:
    expected = kept(items, of)
    assert items.ids(**params) == expected
    assert 0 < len(expected) < len(items.stored)


def test_a_repeated_property_is_any_of_its_values(items: Items) -> None:
    twice = items.asked([("limit", "1000"), ("highway", "primary"), ("highway", "track")])
    assert ids_of(twice) == items.ids(highway="primary,track")


def test_a_time_that_was_read_finds_its_feature(items: Items) -> None:
    """What is served ends with the millisecond, what is stored with the microsecond."""
    feature = json.loads(items.page(limit="1", driven="true").features[0])
    for name in ("datetime", "updated_at"):
        assert feature["id"] in items.ids(**{name: feature["properties"]["updated_at"]})


def test_gaps_come_where_they_are_asked_for(items: Items) -> None:
    without = items.ids(filter="slope_percent IS NOT NULL")
    with_gaps = items.ids(filter="slope_percent IS NOT NULL", gaps="true")
    assert set(without) < set(with_gaps)
    assert items.ids(driven="true", gaps="true") == items.ids(driven="true")


boxes = st.tuples(*[st.integers(-4, 30)] * 4).map(
    lambda n: (
        8.3977 + min(n[:2]) / 100,
        48.9913 + min(n[2:]) / 100,
        8.4033 + max(n[:2]) / 100,
        49.0051 + max(n[2:]) / 100,
    )
)


@settings(max_examples=20)
@given(box=boxes)
def test_a_box_is_the_same_in_every_system(items: Items, box: tuple[float, ...]) -> None:
    west, south, east, north = box
    expected = items.ids(
        filter=f"S_INTERSECTS(geometry, BBOX({west:.6f}, {south:.6f}, {east:.6f}, {north:.6f}))"
    )
    y0, y1 = (math.asinh(math.tan(math.radians(lat))) * 6378137 for lat in (south, north))
    x0, x1 = (math.radians(lon) * 6378137 for lon in (west, east))
    assert items.ids(bbox=f"{west},{south},{east},{north}") == expected
    assert items.ids(bbox=f"{west},{south},-99,{east},{north},99") == expected
    assert items.ids(**{"bbox": f"{south},{west},{north},{east}", "bbox-crs": EPSG_4326}) == expected
    assert items.ids(**{"bbox": f"{x0!r},{y0!r},{x1!r},{y1!r}", "bbox-crs": EPSG_3857}) == expected


def test_a_box_across_the_antimeridian(items: Items) -> None:
    across = items.ids(bbox="179.9,40,-179.9,60")
    assert across == sorted(items.ids(bbox="179.9,40,180,60") + items.ids(bbox="-180,40,-179.9,60"))
    assert items.ids(**{"bbox": "40,179.9,60,-179.9", "bbox-crs": EPSG_4326}) == across
    edge = math.radians(179.9) * EPSG3857_RADIUS
    assert items.ids(**{"bbox": f"{edge},4e6,-{edge},9e6", "bbox-crs": EPSG_3857}) == across
    assert 0 < len(across) < len(items.stored)


EPSG3857_RADIUS = EDGE_M / math.pi


@pytest.mark.parametrize(
    ("limit", "expected"), [("1000000", 10_000), ("9" * 60, 10_000), ("7", 7), ("007", 7)]
)
def test_a_large_limit_is_reduced(items: Items, limit: str, expected: int) -> None:
    assert parse_items(SEGMENTS, [("limit", limit)], items.settings).limit == expected


@pytest.mark.parametrize(
    ("pairs", "told"),
    [
        ([("limit", "0")], "limit: .* from 1"),
        ([("limit", "-1")], "limit: "),
        ([("limit", "ten")], "limit: "),
        ([("limit", "1.0")], "limit: "),
        ([("limit", "")], "limit: "),
        ([("limit", "\u0661")], "limit: "),
        ([("bbox", "a,b,c,d")], "bbox: 'a' is no number"),
        ([("bbox", "1,2,3")], "bbox: it needs 4 numbers"),
        ([("bbox", "1,2,3,4,5")], "bbox: "),
        ([("bbox", "8,50,9,49")], "bbox: south"),
        ([("bbox", "8,49,9,91")], "bbox: "),
        ([("bbox", "0,0,9e9,9"), ("bbox-crs", EPSG_3857)], "bbox: .*outside of the map"),
        ([("bbox", "0,0,1,1"), ("bbox-crs", "EPSG:4326")], "bbox-crs: .*CRS84.*EPSG/0/3857"),
        ([("bbox-crs", "EPSG:4326")], "bbox-crs: .*CRS84.*EPSG/0/3857"),
        ([("crs", "http://www.opengis.net/def/crs/EPSG/0/25832")], "crs: .*CRS84.*EPSG/0/3857"),
        ([("filter", "bridge"), ("filter-crs", "x")], "filter-crs: "),
        ([("filter", "bridge"), ("filter-lang", "cql-text")], "filter-lang: .*cql2-text, cql2-json"),
        ([("datetime", "yesterday")], "datetime: 'yesterday' is no time"),
        ([("datetime", "2026-02-30")], "datetime: "),
        ([("datetime", "2026-11-05T10:00:00")], "datetime: "),
        ([("datetime", "../..")], "datetime: one end"),
        ([("datetime", "2026-11-05/2026-11-04")], "datetime: .*ends before"),
        ([("datetime", "2026-11-05/2026-11-06/2026-11-07")], "datetime: .*two ends"),
        ([("datetime", "9999-12-31T23:59:59-12:00")], "datetime: "),
        ([("driven", "perhaps")], "driven: it must be true or false"),
        ([("gaps", "2")], "gaps: "),
        ([("skipGeometry", "no!")], "skipGeometry: "),
        ([("properties", "id,highwya")], "properties: .*'highwya'.*highway"),
        ([("sortby", "highwya")], "sortby: 'highwya'.*slope_percent"),
        ([("sortby", "")], "sortby: "),
        ([("sortby", "name,-name")], "sortby: name is there twice"),
        ([("sortby", "geometry")], "sortby: "),
        ([("sortby", "id,name,oneway,bridge,tunnel")], "sortby: at most 4"),
        ([("highwya", "primary")], "no parameter 'highwya'.*bbox.*highway"),
        ([("limit", "1"), ("limit", "2")], "limit: it is there twice"),
        ([("drives", "many")], "drives: it must be a whole number"),
        ([("drives", "1.5")], "drives: "),
        ([("id", "9" * 30)], "id: "),
        ([("length_m", "nan")], "length_m: it must be a number"),
        ([("length_m", "1e999")], "length_m: "),
        ([("bridge", "maybe")], "bridge: it must be true or false"),
        ([("updated_at", "now")], "updated_at: "),
        ([("name", "a\0b")], "name: character 2"),
        ([("oneway", ",".join(["1"] * 101))], "oneway: at most 100"),
        ([("after", "x")], "after: "),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(
    items: Items, pairs: list[tuple[str, str]], told: str
) -> None:
    with pytest.raises(BadQueryError, match=f"(?s){told}") as caught:
        items.asked(pairs)
    assert len(caught.value.errors) == 1


def test_ways_have_no_gaps_and_no_versions() -> None:
    assert set(item_parameters(SEGMENTS)) - set(item_parameters(WAYS)) > {"gaps", "updated_since"}
    with pytest.raises(BadQueryError, match="no parameter 'gaps'"):
        parse_item(WAYS, [("gaps", "true")])
    with pytest.raises(BadQueryError, match="no parameter 'bbox'"):
        parse_item(SEGMENTS, [("bbox", "1,2,3,4")])


def test_no_property_hides_a_parameter() -> None:
    for collection in (SEGMENTS, WAYS):
        names = item_parameters(collection)
        assert len(names) == len(set(names))


def test_a_link_repeats_what_was_asked(items: Items) -> None:
    pairs = [("highway", "a"), ("limit", "5"), ("highway", "b"), ("after", "7")]
    request = parse_items(SEGMENTS, pairs, items.settings)
    assert request.query() == pairs
    assert request.query(after="9") == [("highway", "a"), ("limit", "5"), ("highway", "b"), ("after", "9")]
    assert request.query(after=None, limit=None) == [("highway", "a"), ("highway", "b")]


moments = st.datetimes(timezones=st.just(UTC)).filter(lambda time: time.year < 9999)


@given(moments, st.sampled_from(["seconds", "milliseconds", "microseconds"]))
def test_a_time_is_as_long_as_its_digits(time: datetime, precision: str) -> None:
    first, last = span(time.isoformat(timespec=precision))
    assert first is not None
    assert last is not None
    assert first <= time or precision == "microseconds"
    assert last - first == timedelta(microseconds=0 if precision == "microseconds" else 999)
    assert interval("..", time.date().isoformat())[1] == moment(time.date().isoformat()) + timedelta(
        days=1, microseconds=-1
    )
    assert parse_datetime(f"{time.date()}/..") == (moment(time.date().isoformat()), None)


@given(st.floats(-EDGE_M, EDGE_M), st.floats(-EDGE_M, EDGE_M))
def test_metres_become_degrees(x: float, y: float) -> None:
    lon, lat = EPSG3857.to_degrees(x, y)
    assert math.radians(lon) * EPSG3857_RADIUS == pytest.approx(x, abs=1e-6)
    assert math.asinh(math.tan(math.radians(lat))) * EPSG3857_RADIUS == pytest.approx(y, abs=1e-5)
